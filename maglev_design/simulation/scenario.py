"""What goes into a closed loop: the scenario, the parameters and the state at the start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.design import Design, true_equilibrium
from maglev_design.errors import InputError, check_numbers
from maglev_design.programs import feedforward_program, start_program
from maglev_design.rig import Rig
from maglev_design.simulation import grid as grids
from maglev_design.simulation.noise import INPUT_CHANNEL, POSITION_CHANNEL, standard_normals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scenario:
    """What happens to one closed loop, beyond the rig and the controller.

    Attributes
    ----------
    beta_plant : float
        The plant's true beta [m^3/(s^2 V^2)].
    initial_gap, initial_velocity : float
        y(0) [m] and y'(0) [m/s].
    noise : bool
        Whether the rig's noise acts.
    seed, index : int
        Seed and scenario number of the noise stream.
    gravity, gap_offset : float, optional
        The plant's g [m/s^2] and y0 [m] where they are not the rig's, which the controller has.
    input_noise, position_noise : float, optional
        Standard deviations [V, m] where they are not the rig's.
    numbers : tuple of (str, float)
        Further numbers of the plant, by symbol, where they are not the rig's; see
        :func:`maglev_design.controller.plant_numbers`.
    """

    beta_plant: float
    initial_gap: float
    initial_velocity: float = 0.0
    noise: bool = False
    seed: int = 0
    index: int = 0
    gravity: float | None = None
    gap_offset: float | None = None
    input_noise: float | None = None
    position_noise: float | None = None
    numbers: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        check_numbers(positive=True, beta_plant=self.beta_plant, gravity=self.gravity)
        check_numbers(
            initial_gap=self.initial_gap,
            initial_velocity=self.initial_velocity,
            gap_offset=self.gap_offset,
            input_noise=self.input_noise,
            position_noise=self.position_noise,
        )
        for name, value in (("seed", self.seed), ("index", self.index)):
            if not 0 <= value < 2**32:
                raise InputError(f"{name} = {value!r}: must be a whole number from 0 to 2^32 - 1")

    def deviations(self, rig: Rig) -> tuple[float, float]:
        """Return the standard deviations of input and position noise [V, m], 0 without noise."""
        if not self.noise:
            return 0.0, 0.0
        own = (self.input_noise, self.position_noise)
        given = (rig.noise.input, rig.noise.position)
        first, second = (g if o is None else o for o, g in zip(own, given, strict=True))
        return first, second


def nominal_scenario(rig: Rig, beta_plant: float) -> Scenario:
    """Return the rig's own start on a plant with `beta_plant`, without noise."""
    return Scenario(beta_plant, rig.initial.gap, rig.initial.velocity)


def mirrored(rig: Rig, scenario: Scenario) -> Scenario:
    """Return the scenario with the initial error of the other sign."""
    start = rig.reference.start_gap
    return replace(scenario, initial_gap=2 * start - scenario.initial_gap)


def check_fits(loop: grids.LoopGraph, design: Design) -> None:
    """Raise `ValueError` when a loop was built for another controller, method or rig.

    Another plant is none of it, nor another path: a controller may meet both.
    """
    rig = loop.rig
    sampled = loop.method is not None
    for name, own, wanted in (
        ("controller", loop.controller, design.controller),
        ("method", loop.method, design.method if sampled else None),
        ("period [s]", rig.sampling.period, design.period if sampled else rig.sampling.period),
        ("Y [m]", rig.operating_point.gap, design.Y),
        ("range of voltage [V]", tuple(rig.limits.voltage), tuple(design.voltage_limits)),
    ):
        if own != wanted:
            raise ValueError(
                f"a loop with {name} {own} cannot run a design with {wanted}: build the loop from "
                "the design's rig (loop_for), or make the design for the loop's"
            )


def parameter_vector(
    loop: grids.LoopGraph, design: Design, scenario: Scenario, *, clamped: bool = True
) -> Array:
    """Return the numbers of `loop.parameter_names` for one controller on one plant."""
    rig = loop.rig
    low, high = rig.limits.voltage if clamped else (-math.inf, math.inf)
    values = {
        **grids.drive_numbers(rig, emulate=loop.emulator is not None),
        **dict(scenario.numbers),
        "Y": design.Y,
        "U": design.believed.U,
        "u_min": low,
        "u_max": high,
        **design.believed.as_inputs(),
        **design.named_gains,
        **design.coefficients,
        "beta": scenario.beta_plant,
        "g": rig.plant.gravity if scenario.gravity is None else scenario.gravity,
        "y0": rig.plant.gap_offset if scenario.gap_offset is None else scenario.gap_offset,
        "gap_low": grids.contact_gap(rig),
        "gap_high": rig.limits.gap[1],
        "floor": grids.floor_gap(rig),
    }
    return np.array([values[name] for name in loop.parameter_names], dtype=float)


def start_state(
    loop: grids.LoopGraph, design: Design, scenario: Scenario, first_noise: float = 0.0
) -> Array:
    """Return the state at t = 0, SI units.

    The controller's states are zero but for a bumpless start, which reads the first sample;
    voltages that still act, and the emulated coil, are at the feedforward. Behind a drive of the
    plant's own they are what holds the ball where it starts.
    """
    known = first_sample(loop, design, scenario, first_noise)
    held = held_voltage(loop.rig, design, known)
    current = held
    if loop.rig.kind.order > 2:
        held, current = at_rest(loop.rig, scenario)
    if loop.emulator is not None:
        held = float(grids.rounded(held, loop.emulator.actuator_step))
        current = held if loop.rig.kind.order == 2 else current
    program = start_program(design.controller)
    own = program.scalar()(*[known[name] for name in program.inputs])
    values = {"y": scenario.initial_gap, "v": scenario.initial_velocity, "alive": 1.0}
    values |= dict(zip(program.outputs, own, strict=True)) | {grids.COIL: current}
    return np.array([held if n.startswith("held") else values[n] for n in loop.state_names])


def first_sample(
    loop: grids.LoopGraph, design: Design, scenario: Scenario, first_noise: float
) -> dict[str, float]:
    """Return what a law can read before its first step, and its gains, by symbol name."""
    measured = scenario.initial_gap + first_noise
    if loop.emulator is not None:
        measured = float(grids.rounded(measured, loop.emulator.sensor_step))
    return {
        "y": measured,
        "v": scenario.initial_velocity,
        **dict(zip(loop.reference_names, loop.start, strict=True)),
        "Y": design.Y,
        **design.named_gains,
    }


def at_rest(rig: Rig, scenario: Scenario) -> tuple[float, float]:
    """Return the input voltage [V] that holds the ball where it starts, and the current over C [V].

    Of the scenario's plant; clamped to the actuator's range.
    """
    other = {"g": scenario.gravity, "y0": scenario.gap_offset}
    moved = dict(scenario.numbers) | {x: value for x, value in other.items() if value is not None}
    rest = true_equilibrium(rig, scenario.beta_plant, scenario.initial_gap, moved)
    low, high = rig.limits.voltage
    held = min(max(rest.U, low), high)
    return held, held - moved.get("u0", rig.drive.input_offset)


def held_voltage(rig: Rig, design: Design, reference: Mapping[str, float]) -> float:
    """Return the voltage [V] that acts before the first sample: the feedforward of the start."""
    program = feedforward_program(design.method, design.controller)
    low, high = rig.limits.voltage
    known = {**reference, "U": design.believed.U, "u_min": low, "u_max": high}
    known |= design.coefficients
    (voltage,) = program.scalar()(*[known[name] for name in program.inputs])
    return voltage


def noise_samples(rig: Rig, scenario: Scenario, steps: int) -> Array:
    """Return input and position noise, shape (2, steps) [V, m]; zeros without noise."""
    if not scenario.noise:
        return np.zeros((2, steps))
    channels = (INPUT_CHANNEL, POSITION_CHANNEL)
    return np.stack(
        [
            deviation * standard_normals(scenario.seed, scenario.index, channel, steps)
            for channel, deviation in zip(channels, scenario.deviations(rig), strict=True)
        ]
    )
