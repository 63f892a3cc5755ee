"""Scenarios in, responses out: what the closed loop does and how well."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.design import Design, reference_path
from maglev_design.figures import INDICES, PARTS
from maglev_design.rig import Rig
from maglev_design.simulation import grid as grids
from maglev_design.simulation.independent import resimulate_continuous
from maglev_design.simulation.scenario import (
    Scenario,
    check_fits,
    noise_samples,
    parameter_vector,
    start_state,
)
from maglev_design.simulation.sensitivities import Sensitivities, start_sensitivities

Array = NDArray[np.float64]

SAFETY = 2.0
"""Factor between the difference of two step sizes and the stated error bound (4th order: 16/15)."""
ROUNDING = 1e-11
"""Relative error of sums of many thousand rounded increments."""
ADAPTED = 1e-7
"""Relative error of the adaptive integrator's metrics across switches."""


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


def integrals(total: Array, parts: Array) -> dict[str, Any]:
    """Return what `Metrics` says of the indices: their sums, and a row for each part of the run."""
    columns = (dict(zip(PARTS, column, strict=True)) for column in parts.T.tolist())
    split = dict(zip((f"{name}_split" for name in INDICES), columns, strict=True))
    return dict(zip(INDICES, total.tolist(), strict=True)) | split


def simulate(
    loop: grids.LoopGraph,
    design: Design,
    scenario: Scenario,
    sensitivities: Sensitivities | None = None,
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
    sensitivities : Sensitivities, optional
        As :func:`pole_sensitivities` gives it; needs a loop built with as many directions.
    clamped : bool
        False takes the actuator's clamp away, for a search that must look beyond it.
    """
    from maglev_design.simulation import stepping  # noqa: PLC0415 - CasADi

    steps = len(loop.times) - 1
    size, width = len(loop.state_names), loop.directions
    check_fits(loop, design)
    noise = noise_samples(loop.rig, scenario, steps)
    state = start_state(loop, design, scenario, float(noise[1, 0]))
    vector = parameter_vector(loop, design, scenario, clamped=clamped)
    if width:
        seed, start = np.zeros((len(vector), width)), np.zeros((size, width))
        if sensitivities is not None:
            seed = sensitivities.parameters
            moved = sensitivities.gains
            start = start_sensitivities(loop, design, scenario, float(noise[1, 0]), moved)
        state = np.concatenate([state, start.ravel(order="F")])
        vector = np.concatenate([vector, seed.ravel(order="F")])
    states, voltages, track = (m.full() for m in stepping.run(loop, state, vector, noise))
    history = np.concatenate([state[:, None], states], axis=1)
    return _response(loop, history, voltages, track)


def _response(loop: grids.LoopGraph, history: Array, voltages: Array, track: Array) -> Response:
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
    move = (loop.ends > rig.reference.start_time) & (loop.ends <= rig.reference.end_time)
    before = loop.ends <= rig.reference.start_time
    parts = [
        [increments[mask, k].sum() for k in range(3)] for mask in (before, move, ~(before | move))
    ]
    active = slice(0, min(survived, len(commanded)))
    metrics = Metrics(
        **integrals(increments.sum(axis=0), np.array(parts)),
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
        gradients = dict(zip(INDICES, slopes, strict=True))
        gradients |= _extreme_gradients(loop, history, voltages, active)
    return Response(times, rows["y"], rows["v"], reference, commanded, applied, metrics, gradients)


def _quadrature(loop: grids.LoopGraph, history: Array, track: Array) -> tuple[Array, Array]:
    """Return the increments of every step, shape (n, 3), and the sums' slopes, shape (3, d)."""
    from maglev_design.simulation.stepping import quadrature  # noqa: PLC0415 - CasADi

    width, count = loop.directions, len(loop.ends) // (len(loop.times) - 1)
    first = history[:2, 0]
    blocks = track.reshape(1 + width, 2, count, -1).transpose(0, 1, 3, 2).reshape(1 + width, 2, -1)
    gap, velocity = blocks[0]
    if not width:
        return quadrature(loop)(gap, velocity, *first).full(), np.empty((3, 0))
    moved = [blocks[1:, k].T for k in (0, 1)]
    increments, slopes = quadrature(loop)(gap, velocity, *first, *moved)
    return increments.full(), slopes.full()


def _extreme_gradients(
    loop: grids.LoopGraph, history: Array, voltages: Array, active: slice
) -> dict[str, Array]:
    """Return the slopes of the extremes of voltage and gap, taken where they are reached."""
    size, width = len(loop.state_names), loop.directions
    gap_row = loop.state_names.index("y")
    gap = history[gap_row]
    gap_slopes = history[size:].reshape(width, size, -1)[:, gap_row]
    commanded = voltages[0][active]
    moved = voltages[2:].reshape(width, 2, -1)[:, 0]
    return {
        "peak_voltage": moved[:, int(np.argmax(commanded))],
        "min_voltage": moved[:, int(np.argmin(commanded))],
        "min_gap": gap_slopes[:, int(np.argmin(gap))],
        "max_gap": gap_slopes[:, int(np.argmax(gap))],
    }


@dataclass(frozen=True)
class StatedErrors:
    """How far ISE, IAE and ITAE may be from those of the exact loop.

    Attributes
    ----------
    relative : dict
        By ``ise``, ``iae``, ``itae``.
    bound : bool
        Whether these are bounds; estimates where the right side jumps inside an integration step.
    """

    relative: dict[str, float]
    bound: bool


def stated_errors(
    rig: Rig,
    design: Design,
    scenario: Scenario,
    *,
    continuous: bool = False,
    emulate: bool = False,
    run: Callable[..., Response] = simulate,
) -> tuple[Response, StatedErrors]:
    """Run a loop and return it with the relative errors of ISE, IAE and ITAE.

    The loop is run again with the integration steps halved; the bound is twice the difference,
    where a fourth-order method needs 16/15. Where the clamp or the anti-windup of a continuous law
    acted, whose switches lie inside the steps, it is an estimate: twice the difference from an
    integrator whose steps adapt to them. So it is for a ball that was lost, with the whole step
    in which it met its end, and where a sensor or an actuator has steps. `run` is what runs a
    loop: :func:`simulate`, or :func:`maglev_design.simulation.respond`.
    """
    loops = [
        loop_for(rig, design, continuous=continuous, refine=refine, emulate=emulate)
        for refine in (1, 2)
    ]
    coarse, fine = (run(loop, design, scenario) for loop in loops)
    crashed = coarse.metrics.crashed or fine.metrics.crashed
    found = {name: getattr(fine.metrics, name) for name in INDICES}
    off = {name: abs(getattr(coarse.metrics, name) - value) for name, value in found.items()}
    switched = continuous and not crashed and not _smooth(loops[0], design, scenario, coarse, run)
    if crashed:
        step, times = float(np.diff(loops[1].ends).max()), fine.times
        size = float(np.abs(fine.gap - fine.reference).max())
        lost = dict(zip(INDICES, (size**2, size, size * float(times[-1])), strict=True))
        off = {name: value + step * lost[name] for name, value in off.items()}
    elif switched and not emulate:
        exact = resimulate_continuous(loops[1], design, scenario)
        off = {name: abs(getattr(exact, name) - value) for name, value in found.items()}
        off = {name: value + ADAPTED * abs(found[name]) for name, value in off.items()}
    relative = {
        name: SAFETY * off[name] / scale + ROUNDING if (scale := abs(value)) else 0.0
        for name, value in found.items()
    }
    steps = loops[0].emulator is not None and bool(
        loops[0].emulator.sensor_step or loops[0].emulator.actuator_step
    )
    return fine, StatedErrors(relative, not (crashed or switched or steps))


def _smooth(
    loop: grids.LoopGraph,
    design: Design,
    scenario: Scenario,
    response: Response,
    run: Callable[..., Response],
) -> bool:
    """Whether neither clamp nor anti-windup acted: without them every number is the same."""
    free = run(loop, design, scenario, clamped=False)
    names = ("gap", "velocity", "commanded")
    return all(np.array_equal(getattr(free, x), getattr(response, x)) for x in names)


def loop_for(
    rig: Rig,
    design: Design,
    *,
    continuous: bool = False,
    refine: int = 1,
    emulate: bool = False,
) -> grids.LoopGraph:
    """Return the loop that runs `design`, with integration steps short enough for it."""
    fast = [design.named_gains.get(name, 0.0) for name in ("k3", "omega_f")]
    return grids.build(
        rig,
        None if continuous else design.method,
        controller=design.controller,
        refine=refine,
        fastest=max(*fast, *design.poles.values[1::2]) if continuous else 0.0,
        emulate=emulate,
    )
