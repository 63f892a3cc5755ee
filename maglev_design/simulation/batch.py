"""Many closed loops at once: compiled in vector lanes where there is a compiler, else interpreted.

What comes back is the figures of every loop; for one loop with its curves there is
:func:`respond`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.design import Design, reference_path
from maglev_design.errors import check_word
from maglev_design.figures import EXTREMES
from maglev_design.options import BACKENDS, Backend
from maglev_design.simulation import compiled, lanes
from maglev_design.simulation.grid import LoopGraph
from maglev_design.simulation.noise import POSITION_CHANNEL, standard_normals
from maglev_design.simulation.response import Crash, Metrics, Response, integrals, simulate
from maglev_design.simulation.scenario import Scenario, check_fits, parameter_vector, start_state
from maglev_design.simulation.sensitivities import Sensitivities, start_sensitivities
from maglev_design.simulation.transient import total_variation

Array = NDArray[np.float64]

MOST_PIECES = 16
"""Integration steps a period up to which a single response is compiled: 1.5 s, and 13 s for 60."""


@dataclass(frozen=True)
class Summary:
    """The figures of one closed loop.

    Attributes
    ----------
    metrics : Metrics
    total_variation : float
        Of the applied voltage [V].
    gradients : mapping of str to array
        As of :class:`maglev_design.simulation.Response`.
    """

    metrics: Metrics
    total_variation: float
    gradients: Mapping[str, Array]


def simulate_batch(
    loop: LoopGraph,
    designs: Sequence[Design],
    scenarios: Sequence[Scenario],
    sensitivities: Sequence[Sensitivities] | None = None,
    *,
    clamped: bool = True,
    threads: int = 1,
    backend: Backend = "auto",
) -> list[Summary]:
    """Run one loop for each pair of a design and a scenario.

    The compiled and the interpreted back end differ by rounding alone: the compiler may fuse a
    product and a sum, and the metrics are added in another order. Relative to the figure that is
    below 1e-10 (tested); the noise has the same bits.

    Parameters
    ----------
    loop : LoopGraph
        Of the same rig, method and controller as the designs.
    designs, scenarios : sequences of one length
    sensitivities : sequence of Sensitivities, optional
        One for each design; needs a loop built with as many directions.
    clamped : bool
        As of :func:`maglev_design.simulation.simulate`.
    threads : int
        Cores; what comes back does not depend on it.
    backend : {"auto", "compiled", "interpreted"}
        ``auto`` compiles where a compiler is found, and says once when none is.

    Raises
    ------
    RuntimeError
        When ``compiled`` is asked for and nothing can be compiled.
    """
    check_word("backend", backend, BACKENDS)
    if not designs:
        return []
    found = None
    if backend != "interpreted":
        found = compiled.kernel(loop)
        if found is None:
            reason = str(compiled.looked_for(loop))
            if backend == "compiled":
                raise RuntimeError(f"no C compiler that works: {reason}; set CC, or install gcc")
            _notice(reason)
    if found is None:
        own: Sequence[Sensitivities | None] = sensitivities or [None] * len(designs)
        return [
            _interpreted(loop, design, scenario, moved, clamped)
            for design, scenario, moved in zip(designs, scenarios, own, strict=True)
        ]
    figures, _ = _compiled(loop, found, designs, scenarios, sensitivities, clamped, threads)
    return summaries(loop, figures)


def respond(
    loop: LoopGraph, design: Design, scenario: Scenario, *, clamped: bool = True
) -> Response:
    """Run one closed loop, compiled where that is possible and takes no longer than it is worth.

    The curves are those of :func:`maglev_design.simulation.simulate`; the metrics, added in another
    order, differ from its by rounding. A loop with many integration steps a period is interpreted:
    a compiler takes seconds for it. `clamped` is as of :func:`maglev_design.simulation.simulate`.
    """
    found = compiled.kernel(loop) if loop.pieces <= MOST_PIECES else None
    if found is None:
        return simulate(loop, design, scenario, clamped=clamped)
    figures, trace = _compiled(loop, found, [design], [scenario], None, clamped, 1, trace=True)
    (summary,) = summaries(loop, figures)
    gap, velocity, commanded, applied = trace[0].T
    return Response(
        loop.times,
        np.append(scenario.initial_gap, gap),
        np.append(scenario.initial_velocity, velocity),
        reference_path(loop.rig, loop.times)[0],
        commanded,
        applied,
        summary.metrics,
        {},
    )


@cache
def _notice(reason: str) -> None:
    """Say once that loops are interpreted, and why."""
    sys.stderr.write(f"note: {reason}; closed loops are interpreted, which is slower\n")


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _interpreted(
    loop: LoopGraph,
    design: Design,
    scenario: Scenario,
    sensitivities: Sensitivities | None,
    clamped: bool,
) -> Summary:
    response = simulate(loop, design, scenario, sensitivities, clamped=clamped)
    return Summary(response.metrics, total_variation(response), response.gradients)


def _compiled(
    loop: LoopGraph,
    found: compiled.Kernel,
    designs: Sequence[Design],
    scenarios: Sequence[Scenario],
    sensitivities: Sequence[Sensitivities] | None,
    clamped: bool,
    threads: int,
    *,
    trace: bool = False,
) -> tuple[Array, Array]:
    """Return the figures, one row a loop, and the traces of :func:`compiled.run`."""
    rig, width = loop.rig, loop.directions
    states, vectors = [], []
    for n, (design, scenario) in enumerate(zip(designs, scenarios, strict=True)):
        check_fits(loop, design)
        first = first_noise(loop, scenario)
        state = start_state(loop, design, scenario, first)
        vector = parameter_vector(loop, design, scenario, clamped=clamped)
        if width:
            moved = np.zeros((len(vector), width)), np.zeros((len(state), width))
            if sensitivities is not None:
                own = sensitivities[n]
                start = start_sensitivities(loop, design, scenario, first, own.gains)
                moved = own.parameters, start
            vector = np.concatenate([vector, moved[0].ravel(order="F")])
            state = np.concatenate([state, moved[1].ravel(order="F")])
        states.append(state)
        vectors.append(vector)
    stream = np.array([(s.seed, s.index) for s in scenarios], dtype=np.uint32)
    deviation = np.array([s.deviations(rig) for s in scenarios])
    return compiled.run(
        loop,
        found,
        np.array(states),
        np.array(vectors),
        stream,
        deviation,
        noisy=any(s.noise for s in scenarios),
        trace=trace,
        threads=threads,
    )


def first_noise(loop: LoopGraph, scenario: Scenario) -> float:
    """Return the noise on the first sample of the gap [m]."""
    if not scenario.noise:
        return 0.0
    (value,) = standard_normals(scenario.seed, scenario.index, POSITION_CHANNEL, 1)
    return float(scenario.deviations(loop.rig)[1] * value)


def summaries(loop: LoopGraph, figures: Array) -> list[Summary]:
    """Return the kernel's figures, one row a loop, by their names."""
    last = float(reference_path(loop.rig, loop.times[-1:])[0, 0])
    return [_summary(loop, row, last) for row in figures]


def _summary(loop: LoopGraph, row: Array, last: float) -> Summary:
    parts = row[: lanes.PARTS].reshape(3, 3)
    head = lanes.PARTS + len(lanes.SCALARS)
    named = dict(zip(lanes.SCALARS, row[lanes.PARTS : head].tolist(), strict=True))
    survived = int(named["survived"])
    crash = None
    if survived <= len(loop.times) - 1:
        where = "dropped" if named["last_gap"] >= loop.rig.limits.gap[1] else "magnet"
        crash = Crash(where, float(loop.times[survived]))
    metrics = Metrics(
        **integrals(parts.sum(axis=0), parts),
        **{name: named[name] for name in EXTREMES},
        final_error=named["last_gap"] - last,
        crash=crash,
    )
    gradients = {}
    if loop.directions:
        slopes = row[head:].reshape(loop.directions, len(lanes.GRADIENTS))
        gradients = {name: slopes[:, k] for k, name in enumerate(lanes.GRADIENTS)}
        del gradients["peak_applied"]
    return Summary(metrics, named["total_variation"], gradients)
