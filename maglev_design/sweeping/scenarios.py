"""One chunk of scenarios: from its number to the figures of every loop.

The compiled back end gets whole matrices, made from one reference vector: only what differs between
scenarios is written over it. The interpreted one gets one :class:`Scenario` after the other.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller import design as designs
from maglev_design.controller.design import Design
from maglev_design.errors import InputError
from maglev_design.figures import INDICES, OF_A_RUN
from maglev_design.simulation import (
    LoopGraph,
    Scenario,
    Summary,
    compiled,
    lanes,
    loop_for,
    simulate_batch,
)
from maglev_design.simulation.batch import first_noise
from maglev_design.simulation.scenario import parameter_vector, start_state
from maglev_design.sweeping.draws import DRIVE_NUMBERS, draw, plant_betas, plant_columns
from maglev_design.sweeping.setup import Setup

Array = NDArray[np.float64]

FIGURES = (*INDICES, *OF_A_RUN, "crash_time")
"""Of one loop, SI units; ``crash_time`` is nan where the ball levitates to the end."""

_ONE_AT_A_TIME = threading.Lock()
"""CasADi's functions are not made for several threads, which a Dask worker may have."""


@dataclass(frozen=True)
class Plants:
    """The scenarios of a chunk, one element each.

    Attributes
    ----------
    first : int
        Number of the first.
    drawn : mapping of str to array
        What was drawn, by name.
    values : mapping of str to array
        All that a :class:`Scenario` needs: beta_plant, gravity, gap_offset, initial_gap,
        initial_velocity, input_noise and position_noise; of a plant with damping, drive or offset
        also its numbers by symbol.
    """

    first: int
    drawn: dict[str, Array]
    values: dict[str, Array]

    @property
    def count(self) -> int:
        """How many."""
        return len(self.values["beta_plant"])


def plants(setup: Setup, first: int, count: int) -> Plants:
    """Return the scenarios first, ..., first + count - 1."""
    drawn = draw(
        setup.rig,
        setup.sampling,
        setup.seed,
        setup.samples,
        first,
        count,
        setup.equilibrium,
        setup.beta_error,
    )
    return plants_of(setup, first, count, drawn)


def plants_of(setup: Setup, first: int, count: int, drawn: dict[str, Array]) -> Plants:
    """Return scenarios with given drawn values; what was not drawn is the rig's."""
    rig = setup.rig
    own = {name: rig.stated(name) for name in _SCENARIO}
    values = own | {name: drawn[name] for name in _SCENARIO if name in drawn}
    values["beta_plant"] = plant_betas(rig, setup.designs[0], drawn)
    if rig.kind.order > 2 or rig.kind.damped or rig.kind.offset:
        values |= {
            name: x for name, x in plant_columns(rig, drawn).items() if name in DRIVE_NUMBERS
        }
    return Plants(first, drawn, {k: np.broadcast_to(v, count) for k, v in values.items()})


_SCENARIO = (
    "gravity",
    "gap_offset",
    "initial_gap",
    "initial_velocity",
    "input_noise",
    "position_noise",
)


def scenario(setup: Setup, drawn: Plants, n: int) -> Scenario:
    """Return element `n` as the simulator takes it."""
    own = {name: float(column[n]) for name, column in drawn.values.items()}
    known: dict[str, Any] = {name: x for name, x in own.items() if name not in DRIVE_NUMBERS}
    plant = tuple((name, own[name]) for name in DRIVE_NUMBERS if name in own)
    known |= {"seed": setup.seed, "index": drawn.first + n, "numbers": plant}
    return Scenario(noise=setup.noise, **known)


@lru_cache(maxsize=8)
def _loops(setup: Setup) -> tuple[LoopGraph, ...]:
    return tuple(loop_for(setup.rig, design) for design in setup.designs)


def run_chunk(setup: Setup, number: int, threads: int = 1) -> dict[str, Array]:
    """Return what a chunk file holds: ``drawn_NAME`` and ``DESIGN_FIGURE`` (``0_itae``).

    Raises
    ------
    InputError
        When the compiled back end was promised and there is no compiler here.
    """
    drawn = plants(setup, *setup.span(number))
    with _ONE_AT_A_TIME:
        loops = _loops(setup)
    arrays = {f"drawn_{name}": column for name, column in drawn.drawn.items()}
    for position, (loop, design) in enumerate(zip(loops, setup.designs, strict=True)):
        figures = run_loops(setup, loop, design, drawn, threads)
        arrays |= {f"{position}_{name}": column for name, column in figures.items()}
    return arrays


def run_loops(
    setup: Setup, loop: LoopGraph, design: Design, drawn: Plants, threads: int
) -> dict[str, Array]:
    """Return the figures of one design in every scenario of a chunk, by name."""
    if setup.backend != "compiled":
        with _ONE_AT_A_TIME:
            return _interpreted(setup, loop, design, drawn)
    with _ONE_AT_A_TIME:
        kernel = compiled.kernel(loop)
    if kernel is None:
        raise InputError(
            "backend = 'compiled': no C compiler that works was found here; set CC or install gcc "
            "(on every worker), or use --backend interpreted"
        )
    own, size = drawn.values, drawn.count
    stream = np.empty((size, 2), dtype=np.uint32)
    stream[:, 0] = setup.seed
    stream[:, 1] = np.arange(drawn.first, drawn.first + size)
    deviation = np.stack([own["input_noise"], own["position_noise"]], axis=1)
    rows, _ = compiled.run(
        loop,
        kernel,
        _states(setup, loop, design, drawn),
        _parameters(setup, loop, design, drawn),
        stream,
        deviation if setup.noise else np.zeros_like(deviation),
        noisy=setup.noise,
        threads=threads,
    )
    return _figures(loop, rows)


def _interpreted(setup: Setup, loop: LoopGraph, design: Design, drawn: Plants) -> dict[str, Array]:
    each = range(drawn.count)
    found = simulate_batch(
        loop,
        [design] * drawn.count,
        [scenario(setup, drawn, n) for n in each],
        backend="interpreted",
    )
    rows = np.array([[of_summary(summary)[name] for name in FIGURES] for summary in found])
    return dict(zip(FIGURES, np.ascontiguousarray(rows.T), strict=True))


def of_summary(summary: Summary) -> dict[str, float]:
    """Return the figures of one loop by name."""
    metrics = summary.metrics
    crash = metrics.crash
    other = {
        "total_variation": summary.total_variation,
        "crash_time": np.nan if crash is None else crash.time,
    }
    return {name: other[name] if name in other else getattr(metrics, name) for name in FIGURES}


def _parameters(setup: Setup, loop: LoopGraph, design: Design, drawn: Plants) -> Array:
    """Return the parameters of every loop, one row each."""
    reference = parameter_vector(loop, design, scenario(setup, drawn, 0))
    rows = np.tile(reference, (drawn.count, 1))
    own = drawn.values
    moving = {"beta": own["beta_plant"], "g": own["gravity"], "y0": own["gap_offset"]}
    moving |= {name: own[name] for name in DRIVE_NUMBERS if name in own}
    for name, column in moving.items():
        if name in loop.parameter_names:
            rows[:, loop.parameter_names.index(name)] = column
    return rows


def _states(setup: Setup, loop: LoopGraph, design: Design, drawn: Plants) -> Array:
    """Return the first state of every loop, one row each.

    A bumpless start depends on the first sample, the current of a coil on its plant: each is asked
    for alone, which is slower.
    """
    if design.controller.start == "bumpless" or loop.kind.order > 2:
        rows = []
        for n in range(drawn.count):
            one = scenario(setup, drawn, n)
            rows.append(start_state(loop, design, one, first_noise(loop, one)))
        return np.array(rows)
    states = np.tile(start_state(loop, design, scenario(setup, drawn, 0)), (drawn.count, 1))
    states[:, loop.state_names.index("y")] = drawn.values["initial_gap"]
    states[:, loop.state_names.index("v")] = drawn.values["initial_velocity"]
    return states


def _figures(loop: LoopGraph, rows: Array) -> dict[str, Array]:
    """Return the kernel's figures by name, without an object a loop."""
    parts = rows[:, : lanes.PARTS].reshape(-1, 3, 3)
    totals = parts[:, 0] + parts[:, 1] + parts[:, 2]
    named = {name: rows[:, lanes.PARTS + n] for n, name in enumerate(lanes.SCALARS)}
    named |= {name: totals[:, n] for n, name in enumerate(INDICES)}
    last = float(designs.reference_path(loop.rig, loop.times[-1:])[0, 0])
    named["final_error"] = named["last_gap"] - last
    survived = named["survived"].astype(int)
    steps = len(loop.times) - 1
    fell = loop.times[np.minimum(survived, steps)]
    named["crash_time"] = np.where(survived <= steps, fell, np.nan)
    return {name: np.ascontiguousarray(named[name]) for name in FIGURES}
