"""The closed loop on its grid: instants, integration steps, reference, names of its rows.

All of it is numbers and names. The CasADi functions that run it are made where they are asked
for (:mod:`maglev_design.simulation.stepping`); a loop whose compiled kernel is in the cache folder
needs none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller import design as designs
from maglev_design.controller.plant import (
    on_plant,
    path_gaps,
    plant_numbers,
)
from maglev_design.controller.timing import Timing, timing
from maglev_design.errors import InputError, check_numbers, check_word
from maglev_design.options import METHODS, TAN_GPI, Controller, Method, PlantKind
from maglev_design.programs import (
    acceleration_program,
    coefficients_program,
    continuous_program,
    drive_program,
    inductance_program,
    start_program,
    step_program,
)
from maglev_design.rig import Emulator, Rig

Array = NDArray[np.float64]

STEP_PER_TIME_CONSTANT = 0.1
"""Integration step as a fraction of the fastest time constant: RK4's error a step is below 1e-7."""
FAST_DRIVE = 0.2
"""The same for a drive that settles within a period: of its current little reaches the gap."""
CONTACT = 1e-3
"""Share of Y at which a ball counts as touching the magnet when the rig gives no lower limit."""

PLANT_NAMES = ("beta", "g", "y0", "gap_low", "gap_high", "floor")
COIL = "u_coil"
"""Row of the drive's state: the coil current over C [V]."""


@dataclass(frozen=True, eq=False)
class LoopGraph:
    """A closed loop ready to run, for one rig, one method and one grid.

    Two are equal only when they are one.

    Attributes
    ----------
    rig : Rig
    kind : PlantKind
        Of the plant that runs: the rig's, behind a coil where ``[emulator]`` adds one.
    method : str or None
        None for the continuous controller.
    state_names, parameter_names : tuple of str
        Rows of the folded state and of the parameter vector.
    times : array, shape (N + 1,)
        Sampling instants and the horizon [s].
    ends : array
        The end of every integration step [s].
    directions : int
        How many sensitivities are carried along.
    controller : Controller
    emulator : Emulator or None
        Effects that act besides the plant.
    timing : Timing
        When the voltage of which sample acts; no delay for a continuous controller.
    substeps : tuple of int
        Integration steps before and after the voltage changes within a period.
    tables : tuple of array
        For every period its inputs, shape (N, n_inputs), and for every integration step its
        start [s] and its part of the run (0 before the move, 1 the move, 2 after it).
    start : tuple of float
        y*, y*' and y*'' at t = 0 [SI], and y*''' where the law reads it.
    """

    rig: Rig
    kind: PlantKind
    method: Method | None
    state_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    times: Array
    ends: Array
    directions: int
    controller: Controller
    emulator: Emulator | None
    timing: Timing
    substeps: tuple[int, int]
    tables: tuple[Array, Array, NDArray[np.uint8]]
    start: tuple[float, ...]

    @property
    def reference_names(self) -> tuple[str, ...]:
        """What is known of the reference at a node: y*, y*', y*'' and, where it is read, y*'''."""
        return reference_names(self.controller)

    @property
    def pieces(self) -> int:
        """Integration steps a period."""
        return sum(self.substeps)

    @property
    def nodes_a_piece(self) -> int:
        """Reference nodes an integration step."""
        return 2 if self.method is None else 1

    @property
    def structure(self) -> str:
        """All that the functions of the loop are made from, but for the grid, as text."""
        parts = (self.method, self.controller, self.timing.whole, self.timing.held, self.substeps)
        return repr((*parts, self.kind, self.emulator, self.directions))


SIGNALS = ("y", "v", "y_ref", "v_ref", "acc_ref", "jerk_ref")
"""What a law may read at a sample; which of them it does, its programs say."""


def reference_names(controller: Controller = TAN_GPI) -> tuple[str, ...]:
    """Return the rows of the reference that a loop with this law needs."""
    return SIGNALS[2:6] if controller.plant_order > 2 else SIGNALS[2:5]


def reference_rows(rig: Rig, times: Array, controller: Controller = TAN_GPI) -> Array:
    """Return the rows :func:`reference_names` at `times` [s], SI units."""
    return designs.reference_path(rig, times, len(reference_names(controller)) - 1)


def signal_names(controller: Controller = TAN_GPI) -> tuple[str, ...]:
    """Return what a law reads at a sample, in the order of its arguments."""
    return tuple(name for name in start_program(controller).inputs if name in SIGNALS)


def controller_names(method: Method | None, controller: Controller = TAN_GPI) -> tuple[str, ...]:
    """Return the controller's part of the parameter vector, in order."""
    law = continuous_program(controller) if method is None else step_program(method, controller)
    moving = {*start_program(controller).outputs, *SIGNALS}
    return tuple(name for name in law.inputs if name not in moving)


def pole_names(method: Method | None, controller: Controller = TAN_GPI) -> frozenset[str]:
    """Return the parameters that the poles move: the gains and what is computed from them."""
    gains = frozenset(designs.gain_names(controller))
    if method is None:
        return gains
    return gains | coefficients_program(method, controller).depending(gains)


def contact_gap(rig: Rig) -> float:
    """Return the gap at which the ball counts as touching the magnet [m]."""
    offset = min(rig.plant.gap_offset, 0.0)
    least = CONTACT * (rig.operating_point.gap + offset) - offset
    return max(rig.limits.gap[0], least)


def floor_gap(rig: Rig) -> float:
    """Return the gap off which a ball that has crashed is kept, half of the magnetic gap there [m].

    So that a crash never divides by zero.
    """
    offset = min(rig.plant.gap_offset, 0.0)
    return (contact_gap(rig) + offset) / 2 - offset


def kind_of(rig: Rig, *, emulate: bool) -> PlantKind:
    """Return the kind of plant that runs; the coil of ``[emulator]`` is one without back-EMF.

    A coil or a lag of ``[drive]`` stands for that of ``[emulator]``.
    """
    own = rig.kind
    if emulate and rig.emulator.time_constant and own.order == 2:
        return replace(own, actuation="lag")
    return own


def drive_numbers(rig: Rig, *, emulate: bool) -> dict[str, float]:
    """Return the numbers of the plant that runs, by symbol; see :func:`kind_of`."""
    numbers = plant_numbers(rig)
    if kind_of(rig, emulate=emulate) != rig.kind:
        numbers |= {"L": rig.emulator.inductance, "R": rig.emulator.resistance}
    return numbers


@lru_cache(maxsize=64)
def build(
    rig: Rig,
    method: Method | None,
    *,
    controller: Controller = TAN_GPI,
    directions: int = 0,
    refine: int = 1,
    fastest: float = 0.0,
    emulate: bool = False,
) -> LoopGraph:
    """Return the folded closed loop of `rig`.

    Parameters
    ----------
    rig : Rig
    method : str or None
        Discretisation of the controller, or None for a continuous one (no delay then).
    controller : Controller
    directions : int
        Sensitivities carried along, each a column of the derivatives of the parameters.
    refine : int
        Integration steps per default step; 2 halves them.
    fastest : float
        [1/s] Fastest rate of the continuous controller; the plant's own is always respected.
    emulate : bool
        Whether the coil and the steps of ``[emulator]`` act.
    """
    if method is not None:
        check_word("method", method, METHODS)
    check_numbers(fastest=fastest)
    if not refine >= 1:
        raise InputError(f"refine = {refine!r}: must be a whole number from 1 on")
    period = rig.sampling.period
    when = timing(period, rig.sampling.delay) if method else Timing(0, 0.0, 0)
    smallest = float(path_gaps(rig, 2)[0])
    unstable = designs.true_equilibrium(rig, designs.plant_beta(rig), smallest).C_Y
    emulator = rig.emulator if emulate else None
    kind = kind_of(rig, emulate=emulate)
    current = _drive_speed(rig, kind, emulate=emulate)
    if kind == rig.kind and current * period > 1:
        current *= STEP_PER_TIME_CONSTANT / FAST_DRIVE
    rate = max(math.sqrt(2 * unstable), fastest, current)

    def substeps(duration: float) -> int:
        return refine * math.ceil(duration * rate / STEP_PER_TIME_CONSTANT) if duration else 0

    pieces = (substeps(when.part), substeps(period - when.part))
    times = _instants(rig.reference.horizon, period)
    durations = _durations(np.diff(times), when.part, pieces)
    halves = method is None
    nodes = _nodes(times[:-1], durations, halves)
    reference = reference_rows(rig, nodes.ravel(), controller).reshape(-1, *nodes.shape)
    stacked = np.concatenate([durations, reference.transpose(0, 2, 1).reshape(-1, len(times) - 1)])
    ends = (times[:-1] + np.cumsum(durations, axis=0)).ravel(order="F")
    held = tuple(f"held_{n}" for n in range(when.held))
    own = (*start_program(controller).outputs, *((COIL,) if kind.order > 2 else ()))
    names = (*controller_names(method, controller), *PLANT_NAMES, *plant_names(kind))
    return LoopGraph(
        rig,
        kind,
        method,
        ("y", "v", *own, *held, "alive"),
        tuple(dict.fromkeys(names)),
        times,
        ends,
        directions,
        controller,
        emulator,
        when,
        pieces,
        _tables(rig, stacked, ends, durations.ravel(order="F")),
        tuple(reference[:, 0, 0].tolist()),
    )


def plant_names(kind: PlantKind) -> tuple[str, ...]:
    """Return the numbers of a kind of plant besides g, beta and y0, by symbol."""
    known = ("g", "beta", "y0", "y", "u", "v")
    return tuple(name for name in _plant_inputs(kind) if name not in known)


def _plant_inputs(kind: PlantKind) -> tuple[str, ...]:
    read = acceleration_program(kind).inputs
    return read if kind.order == 2 else (*read, *drive_program(kind).inputs[2:])


def _drive_speed(rig: Rig, kind: PlantKind, *, emulate: bool) -> float:
    """Return the fastest R/L of the plant on its path [1/s]; 0 without a state of the drive."""
    if kind.order == 2:
        return 0.0
    program, beta = inductance_program(kind), designs.plant_beta(rig)
    numbers = drive_numbers(rig, emulate=emulate)
    least = min(
        program.scalar()(
            *on_plant(program, rig, float(gap), beta, rig.plant.gap_offset, moved=numbers)
        )[0]
        for gap in path_gaps(rig, 2)
    )
    return 1 / (least / numbers["R"])


def _tables(
    rig: Rig, stacked: Array, ends: Array, lengths: Array
) -> tuple[Array, Array, NDArray[np.uint8]]:
    """Return inputs, starts and parts of the run as :class:`LoopGraph` describes them."""
    path = rig.reference
    parts = (ends > path.start_time).astype(np.uint8) + (ends > path.end_time).astype(np.uint8)
    return np.ascontiguousarray(stacked.T), ends - lengths, parts


def _instants(horizon: float, period: float) -> Array:
    """Return 0, T, 2 T, ... and the horizon; each instant is k T rounded once."""
    count = math.ceil(Fraction(repr(horizon)) / Fraction(repr(period)))
    times: Array = np.arange(count + 1, dtype=float) * period
    times[-1] = horizon
    return times


def _durations(lengths: Array, part: float, pieces: tuple[int, int]) -> Array:
    """Return the substeps' durations, shape (sum(pieces), N); a short last period is shared."""
    early = np.minimum(part, lengths)
    late = lengths - early
    rows = [
        length / count
        for length, count in zip((early, late), pieces, strict=True)
        for _ in range(count)
    ]
    return np.asarray(np.stack(rows), dtype=float)


def _nodes(starts: Array, durations: Array, halves: bool) -> Array:
    """Return the instants at which the reference is needed, shape (N, n_nodes)."""
    ends = starts + np.cumsum(durations, axis=0)
    rows = [starts]
    for end, duration in zip(ends, durations, strict=True):
        rows += [end - duration / 2, end] if halves else [end]
    return np.stack(rows, axis=1)


def rounded(value: Any, step: float) -> Any:
    """Return `value`, a number or an expression, at the nearest multiple of `step`, if not 0."""
    import casadi as ca  # noqa: PLC0415 - only for an emulated rig

    return step * ca.floor(value / step + 0.5) if step else value
