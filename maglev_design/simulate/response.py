"""Scenarios in, responses out: what the closed loop does and how well."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_design.choices import Controller, Method
from maglev_design.design import (
    Design,
    coefficient_inputs,
    coefficients_program,
    gain_names,
    gains_program,
    reference_path,
)
from maglev_design.parameters import Rig
from maglev_design.simulate import graph as graphs
from maglev_design.simulate.noise import INPUT_CHANNEL, POSITION_CHANNEL, standard_normals

if TYPE_CHECKING:
    import casadi as ca

Array = NDArray[np.float64]

PARTS = ("start", "move", "hold")
"""Of a run: before, during and after the move."""
SAFETY = 2.0
"""Factor between the difference of two step sizes and the stated error bound (4th order: 16/15)."""


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

    def deviations(self, rig: Rig) -> tuple[float, float]:
        """Return the standard deviations of input and position noise [V, m], 0 without noise."""
        if not self.noise:
            return 0.0, 0.0
        own = (self.input_noise, self.position_noise)
        given = (rig.noise.input, rig.noise.position)
        first, second = (g if o is None else o for o, g in zip(own, given, strict=True))
        return first, second


@dataclass(frozen=True)
class Crash:
    """Where the ball ended before its time: ``magnet`` or ``dropped``, and when [s]."""

    where: str
    time: float


@dataclass(frozen=True)
class Metrics:
    """Figures of one response, SI units; true error e = y - y* over [0, horizon].

    Attributes
    ----------
    ise, iae, itae : float
        Integrals of e^2, |e| and t |e|.
    itae_split, iae_split, ise_split : dict
        Each before (``start``), during (``move``) and after (``hold``) the move.
    peak_voltage, min_voltage : float
        Extremes of the commanded voltage, up to a crash [V].
    peak_applied : float
        Largest voltage after the clamp [V].
    min_gap, max_gap : float
        Extremes of the gap at the sampling instants [m].
    final_error : float
        e at the horizon [m].
    crash : Crash or None
    """

    ise: float
    iae: float
    itae: float
    itae_split: dict[str, float]
    iae_split: dict[str, float]
    ise_split: dict[str, float]
    peak_voltage: float
    min_voltage: float
    peak_applied: float
    min_gap: float
    max_gap: float
    final_error: float
    crash: Crash | None

    @property
    def crashed(self) -> bool:
        """Whether the ball hit the magnet or dropped."""
        return self.crash is not None

    def as_dict(self) -> dict[str, Any]:
        """Return the figures for JSON, ``crashed`` included."""
        return {**asdict(self), "crashed": self.crashed}


@dataclass(frozen=True)
class Response:
    """One closed loop over its horizon.

    Attributes
    ----------
    times : array, shape (N + 1,)
    gap, velocity, reference : array, shape (N + 1,)
        At `times` [m, m/s, m].
    commanded, applied : array, shape (N,)
        Voltage computed from the sample at times[:-1], before and after the clamp [V].
    metrics : Metrics
    gradients : mapping of str to array
        Sensitivities of itae, iae, ise, peak_voltage, min_voltage, min_gap and max_gap, each of
        shape (directions,); empty unless they were asked for.
    """

    times: Array
    gap: Array
    velocity: Array
    reference: Array
    commanded: Array
    applied: Array
    metrics: Metrics
    gradients: Mapping[str, Array]


def nominal_scenario(rig: Rig, beta_plant: float) -> Scenario:
    """Return the rig's own start on a plant with `beta_plant`, without noise."""
    return Scenario(beta_plant, rig.initial.gap, rig.initial.velocity)


def mirrored(rig: Rig, scenario: Scenario) -> Scenario:
    """Return the scenario with the initial error of the other sign."""
    start = rig.reference.start_gap
    return replace(scenario, initial_gap=2 * start - scenario.initial_gap)


def parameter_vector(
    loop: graphs.LoopGraph, design: Design, scenario: Scenario, *, clamped: bool = True
) -> Array:
    """Return the numbers of `loop.parameter_names` for one controller on one plant."""
    rig = loop.rig
    low, high = rig.limits.voltage if clamped else (-math.inf, math.inf)
    values = {
        "Y": design.Y,
        "U": design.believed.U,
        "u_min": low,
        "u_max": high,
        "C_U_hat": design.believed.C_U,
        "C_Y_hat": design.believed.C_Y,
        "beta_c": design.believed.beta,
        **design.named_gains,
        **design.coefficients,
        "beta": scenario.beta_plant,
        "g": rig.plant.gravity if scenario.gravity is None else scenario.gravity,
        "y0": rig.plant.gap_offset if scenario.gap_offset is None else scenario.gap_offset,
        "gap_low": graphs.contact_gap(rig),
        "gap_high": rig.limits.gap[1],
    }
    return np.array([values[name] for name in loop.parameter_names], dtype=float)


def start_state(
    loop: graphs.LoopGraph, design: Design, scenario: Scenario, first_noise: float = 0.0
) -> Array:
    """Return the state at t = 0, SI units.

    The controller's states are zero but for a bumpless start, which reads the first sample;
    voltages that still act, and the emulated coil, are at the feedforward.
    """
    known = _first_sample(loop, design, scenario, first_noise)
    held = held_voltage(loop.rig, design, known)
    if loop.emulator is not None:
        held = float(graphs.rounded(held, loop.emulator.actuator_step))
    program = graphs.start_program(design.controller)
    own = program.scalar()(*[known[name] for name in program.inputs])
    values = {"y": scenario.initial_gap, "v": scenario.initial_velocity, "alive": 1.0}
    values |= dict(zip(program.outputs, own, strict=True)) | {graphs.COIL: held}
    return np.array([held if n.startswith("held") else values[n] for n in loop.state_names])


def _first_sample(
    loop: graphs.LoopGraph, design: Design, scenario: Scenario, first_noise: float
) -> dict[str, float]:
    """Return what a law can read before its first step, and its gains, by symbol name."""
    y_ref, v_ref, acc_ref = loop.start
    measured = scenario.initial_gap + first_noise
    if loop.emulator is not None:
        measured = float(graphs.rounded(measured, loop.emulator.sensor_step))
    return {
        "y": measured,
        "v": scenario.initial_velocity,
        "y_ref": y_ref,
        "v_ref": v_ref,
        "acc_ref": acc_ref,
        "Y": design.Y,
        **design.named_gains,
    }


def held_voltage(rig: Rig, design: Design, reference: Mapping[str, float]) -> float:
    """Return the voltage [V] that acts before the first sample: the feedforward of the start."""
    program = graphs.feedforward_program(design.method, design.controller)
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


def simulate(
    loop: graphs.LoopGraph,
    design: Design,
    scenario: Scenario,
    tangent: Tangent | None = None,
    *,
    clamped: bool = True,
) -> Response:
    """Run one closed loop with the interpreted back end.

    Parameters
    ----------
    loop : LoopGraph
        Of the same rig and method as the design.
    design : Design
    scenario : Scenario
    tangent : Tangent, optional
        As :func:`pole_tangent` gives it; needs a loop built with as many directions.
    clamped : bool
        False takes the actuator's clamp away, for a search that must look beyond it.
    """
    steps = len(loop.times) - 1
    size, width = len(loop.state_names), loop.directions
    if design.controller != loop.controller:
        raise ValueError(f"a loop of {loop.controller} cannot run {design.controller}")
    noise = noise_samples(loop.rig, scenario, steps)
    state = start_state(loop, design, scenario, float(noise[1, 0]))
    vector = parameter_vector(loop, design, scenario, clamped=clamped)
    if width:
        seed, start = np.zeros((len(vector), width)), np.zeros((size, width))
        if tangent is not None:
            seed = tangent.parameters
            start = start_tangent(loop, design, scenario, float(noise[1, 0]), tangent.gains)
        state = np.concatenate([state, start.ravel(order="F")])
        vector = np.concatenate([vector, seed.ravel(order="F")])
    outputs = loop.fold(state, vector, loop.inputs, noise)
    states, voltages, track = (matrix.full() for matrix in outputs)
    history = np.concatenate([state[:, None], states], axis=1)
    return _response(loop, history, voltages, track)


class Tangent(NamedTuple):
    """Derivatives by chosen directions of the poles, one column each.

    Attributes
    ----------
    parameters : array, shape (n_parameters, directions)
        Of the loop's parameter vector.
    gains : array, shape (n_gains, directions)
        Of the law's gains.
    """

    parameters: Array
    gains: Array


@cache
def _start_jacobian(controller: Controller) -> ca.Function:
    """Return the derivative of the law's first states with respect to its gains."""
    import casadi as ca  # noqa: PLC0415 - only for sensitivities

    program = graphs.start_program(controller)
    inputs = {name: ca.SX.sym(name) for name in program.inputs}
    gains = ca.vertcat(*[inputs[name] for name in gain_names(controller)])
    states = ca.vertcat(*program.casadi(*inputs.values()))
    slopes = ca.jacobian(states, gains)
    return ca.Function("start", list(inputs.values()), [slopes], list(inputs), ["slopes"])


def start_tangent(
    loop: graphs.LoopGraph, design: Design, scenario: Scenario, first_noise: float, gains: Array
) -> Array:
    """Return the derivative of the loop's first state, shape (n_states, directions)."""
    known = _first_sample(loop, design, scenario, first_noise)
    jacobian = _start_jacobian(design.controller)
    rows = np.zeros((len(loop.state_names), gains.shape[1]))
    own = [loop.state_names.index(name) for name in graphs.start_program(design.controller).outputs]
    rows[own] = jacobian(*[known[name] for name in jacobian.name_in()]).full() @ gains
    return rows


def _response(loop: graphs.LoopGraph, history: Array, voltages: Array, track: Array) -> Response:
    rows = dict(zip(loop.state_names, history, strict=False))
    times, rig = loop.times, loop.rig
    reference = reference_path(rig, times)[0]
    alive = rows["alive"] > 0
    survived = int(alive.sum())
    commanded, applied = voltages[0], voltages[1]
    crash = None
    if not alive[-1]:
        where = "dropped" if rows["y"][-1] >= rig.limits.gap[1] else "magnet"
        crash = Crash(where, float(times[survived]))
    increments, slopes = _quadrature(loop, history, track)
    ise, iae, itae = increments.sum(axis=0)
    move = (loop.ends > rig.reference.start_time) & (loop.ends <= rig.reference.end_time)
    before = loop.ends <= rig.reference.start_time
    parts = dict(zip(PARTS, (before, move, ~(before | move)), strict=True))
    split = [
        {name: float(increments[mask, k].sum()) for name, mask in parts.items()} for k in range(3)
    ]
    active = slice(0, min(survived, len(commanded)))
    metrics = Metrics(
        ise=float(ise),
        iae=float(iae),
        itae=float(itae),
        itae_split=split[2],
        iae_split=split[1],
        ise_split=split[0],
        peak_voltage=float(commanded[active].max()),
        min_voltage=float(commanded[active].min()),
        peak_applied=float(applied[active].max()),
        min_gap=float(rows["y"].min()),
        max_gap=float(rows["y"].max()),
        final_error=float(rows["y"][-1] - reference[-1]),
        crash=crash,
    )
    gradients: dict[str, Array] = {}
    if loop.directions:
        gradients = dict(zip(graphs.METRICS, slopes, strict=True))
        gradients |= _extreme_gradients(loop, history, voltages, active)
    return Response(times, rows["y"], rows["v"], reference, commanded, applied, metrics, gradients)


def _quadrature(loop: graphs.LoopGraph, history: Array, track: Array) -> tuple[Array, Array]:
    """Return the increments of every step, shape (n, 3), and the sums' tangents, shape (3, d)."""
    width, count = loop.directions, len(loop.ends) // (len(loop.times) - 1)
    first = history[:2, 0]
    blocks = track.reshape(1 + width, 2, count, -1).transpose(0, 1, 3, 2).reshape(1 + width, 2, -1)
    gap, velocity = blocks[0]
    if not width:
        return loop.quadrature(gap, velocity, *first).full(), np.empty((3, 0))
    tangents = [blocks[1:, k].T for k in (0, 1)]
    increments, slopes = loop.quadrature(gap, velocity, *first, *tangents)
    return increments.full(), slopes.full()


def _extreme_gradients(
    loop: graphs.LoopGraph, history: Array, voltages: Array, active: slice
) -> dict[str, Array]:
    """Return the tangents of the extremes of voltage and gap, taken where they are reached."""
    size, width = len(loop.state_names), loop.directions
    gap_row = loop.state_names.index("y")
    gap = history[gap_row]
    gap_tangent = history[size:].reshape(width, size, -1)[:, gap_row]
    commanded = voltages[0][active]
    moved = voltages[2:].reshape(width, 2, -1)[:, 0]
    return {
        "peak_voltage": moved[:, int(np.argmax(commanded))],
        "min_voltage": moved[:, int(np.argmin(commanded))],
        "min_gap": gap_tangent[:, int(np.argmin(gap))],
        "max_gap": gap_tangent[:, int(np.argmax(gap))],
    }


@cache
def _pole_jacobian(method: Method | None, controller: Controller) -> ca.Function:
    """Return the derivatives of the controller's parameters and gains by the four pole values."""
    import casadi as ca  # noqa: PLC0415 - only for sensitivities

    poles = ca.SX.sym("poles", 4)
    program = gains_program(controller)
    gains = program.casadi(*ca.vertsplit(poles))
    values = dict(zip(program.outputs, gains, strict=True))
    fixed: dict[str, Any] = {}
    if method is not None:
        program = coefficients_program(method, controller)
        fixed = {name: ca.SX.sym(name) for name in program.inputs if name not in values}
        known = fixed | values
        numbers = program.casadi(*[known[name] for name in program.inputs])
        values |= dict(zip(program.outputs, numbers, strict=True))
    names = (*graphs.controller_names(method, controller), *graphs.PLANT_NAMES)
    moving = ca.vertcat(*[values.get(name, ca.SX(0)) for name in dict.fromkeys(names)])
    return ca.Function(
        "pole_jacobian",
        [poles, *fixed.values()],
        [ca.jacobian(moving, poles), ca.jacobian(ca.vertcat(*gains), poles)],
        ["poles", *fixed],
        ["slopes", "gains"],
    )


def pole_tangent(loop: graphs.LoopGraph, design: Design, directions: Array) -> Tangent:
    """Return the derivatives of parameters and gains by the poles, times `directions`.

    Parameters
    ----------
    directions : array, shape (4, d)
        Columns in (zeta_1, omega_1, zeta_2, omega_2); [[1, 0], [0, 1], [1, 0], [0, 1]] for a
        double pair.
    """
    function = _pole_jacobian(loop.method, loop.controller)
    known = coefficient_inputs(loop.rig, design.believed)
    fixed = [known[name] for name in function.name_in()[1:]]
    slopes, gains = function(design.poles.values, *fixed)
    # An unlimited voltage makes the integrator's bound infinite, and its slope, too.
    rows = np.where(np.isfinite(slopes.full()), slopes.full(), 0.0)
    return Tangent(rows @ directions, gains.full() @ directions)


def error_bounds(
    rig: Rig,
    design: Design,
    scenario: Scenario,
    *,
    continuous: bool = False,
    emulate: bool = False,
    run: Callable[[graphs.LoopGraph, Design, Scenario], Response] = simulate,
) -> tuple[Response, dict[str, float]]:
    """Run a loop and return it with bounds on the relative error of ISE, IAE and ITAE.

    The loop is run again with the integration steps halved; the bound is twice the difference,
    where a fourth-order method needs 16/15 (and a kink of the clamp, which lowers the order, two).
    `run` is what runs a loop: :func:`simulate`, or
    :func:`maglev_design.simulate.respond`.
    """
    coarse, fine = (
        run(
            loop_for(rig, design, continuous=continuous, refine=refine, emulate=emulate),
            design,
            scenario,
        )
        for refine in (1, 2)
    )
    bounds = {}
    for name in ("ise", "iae", "itae"):
        a, b = getattr(coarse.metrics, name), getattr(fine.metrics, name)
        scale = abs(b)
        bounds[name] = SAFETY * abs(a - b) / scale if scale and math.isfinite(scale) else 0.0
    return fine, bounds


def loop_for(
    rig: Rig,
    design: Design,
    *,
    continuous: bool = False,
    refine: int = 1,
    emulate: bool = False,
) -> graphs.LoopGraph:
    """Return the loop that runs `design`, with integration steps short enough for it."""
    fast = [design.named_gains.get(name, 0.0) for name in ("k3", "omega_f")]
    return graphs.build(
        rig,
        None if continuous else design.method,
        controller=design.controller,
        refine=refine,
        fastest=max(*fast, *design.poles.values[1::2]) if continuous else 0.0,
        emulate=emulate,
    )
