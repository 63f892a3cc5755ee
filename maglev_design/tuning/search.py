"""The search: a grid for the whole box, SLSQP from its best points, ratios by exchange.

The worst case over the ratio interval is a semi-infinite program. It is solved by exchange: a
finite set of (case, ratio) pairs is active; after each solution the interval is searched for a
worse ratio, which joins the set until none is found.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from maglev_design.controller.design import PoleSpec
from maglev_design.tuning import dense
from maglev_design.tuning.evaluation import (
    Constraint,
    TuningRun,
    certificate,
    coarse_slacks,
    linear_constraints,
    runs,
)
from maglev_design.tuning.landscape import Landscape
from maglev_design.tuning.problem import TuningCase, TuningProblem

Array = NDArray[np.float64]
Pair = tuple[TuningCase, float]
Progress = Callable[[str, float], None]

GRID = 17
"""Points of the first grid along each of zeta and omega_n."""
SCAN = 7
"""Ratios tried over the interval before the worst one is refined."""
MARGIN = 1e-5
"""Slack kept inside the local solver: more than it may violate a limit by when it has converged."""
CONVERGED = 3e-6
"""Change of the scaled objective at which the local solver stops."""
MOST_ITERATIONS, MOST_ROUGH_ITERATIONS = 25, 8
"""Of the local solver; the second where a search by grids follows."""
EQUAL = 1e-9
"""Relative difference below which two objectives are one: above rounding, below any cause."""
WORSE = 1e-4
"""Relative excess by which a ratio must be worse to join the active set."""
LOOK_BEYOND = math.log(1.5)
"""Grid points that miss a linear limit by up to this much are simulated too, to draw the edge."""


@dataclass(frozen=True)
class Candidate:
    """A point of the search and what is known of it."""

    x: Array
    value: float
    tightest: Constraint

    @property
    def feasible(self) -> bool:
        """Whether every limit is kept on the active set."""
        return self.tightest.slack >= 0


@dataclass
class Search:
    """The state of one search: evaluations are counted and the best feasible point is kept.

    ``progress`` is told the stage before every evaluation, and may raise KeyboardInterrupt there.
    ``fixed`` are poles that are judged and not moved: they need not lie in the box.
    """

    problem: TuningProblem
    progress: Progress
    clamped: bool
    fixed: PoleSpec | None = None
    evaluations: int = 0
    best: Candidate | None = None
    landscape: Landscape | None = None
    stage: tuple[str, float] = ("local solver", 0.0)
    pairs: list[Pair] = field(default_factory=list)
    _runs: dict[tuple[bytes, Pair, bool], TuningRun] = field(default_factory=dict)
    _linear: dict[bytes, tuple[Constraint, ...]] = field(default_factory=dict)
    _certificates: dict[bytes, tuple[Constraint, ...]] = field(default_factory=dict)

    def tell(self) -> None:
        """Say how far the search is; a wish to stop is heard here."""
        self.progress(*self.stage)

    def runs(self, x: Array, pairs: Sequence[Pair], *, gradients: bool = False) -> list[TuningRun]:
        """Return simulated loops, from memory when they were simulated before."""
        self.tell()
        keys = [(x.tobytes(), pair) for pair in pairs]
        new = [key for key in dict.fromkeys(keys) if (*key, gradients) not in self._runs]
        if new:
            self.evaluations += len(new)
            poles = self.fixed or self.problem.poles(x)
            trials = [(poles, *pair) for _, pair in new]
            found = runs(self.problem, trials, gradients=gradients, clamped=self.clamped)
            for key, run in zip(new, found, strict=True):
                self._runs[*key, gradients] = run
                self._runs[*key, False] = run
        return [self._runs[*key, gradients] for key in keys]

    def linear(self, x: Array) -> tuple[Constraint, ...]:
        """Return the limits of the linearised loops at `x`."""
        key = x.tobytes()
        if key not in self._linear:
            self._linear[key] = linear_constraints(self.problem, self.problem.poles(x))
        return self._linear[key]

    def certificate(self, x: Array) -> tuple[Constraint, ...]:
        """Return whether `x` is certified, where that is required."""
        key = x.tobytes()
        if key not in self._certificates:
            self._certificates[key] = certificate(self.problem, self.problem.poles(x))
        return self._certificates[key]

    def candidate(self, x: Array, *, remember: bool = True) -> Candidate:
        """Judge `x` on the active set; keep it when it is the best feasible point so far.

        A certificate takes long; it is asked for only where `x` would be the best.
        """
        runs = self.runs(x, self.pairs)
        limits = [*self.linear(x), *itertools.chain(*(r.constraints for r in runs))]
        value, best = max(r.value for r in runs), self.best
        better = best is None or not best.feasible or value < best.value
        if better and min(c.slack for c in limits) >= 0:
            limits += self.certificate(x)
        found = Candidate(x.copy(), value, min(limits, key=lambda c: c.slack))
        if remember and found.feasible and better:
            self.best = found
        return found


def end_ratios(problem: TuningProblem) -> tuple[float, ...]:
    """Return the ends of the ratio interval, once when they coincide."""
    low, high = problem.family.ratios
    return (low, high) if low < high else (low,)


def explore(search: Search) -> Landscape:
    """Evaluate the grid over the box of double pole pairs, one row of zeta after another."""
    problem = search.problem
    zeta, omega_n = (np.geomspace(low, high, GRID) for low, high in problem.bounds)
    objective = np.full((GRID, GRID), np.nan)
    slack: dict[str, Array] = {}
    for i in range(GRID):
        row = [PoleSpec.double(float(zeta[i]), float(w)) for w in omega_n]
        slacks = coarse_slacks(problem, row)
        near = (slacks["spectral radius"] >= 0) & (slacks["Routh-Hurwitz"] >= 0)
        near &= np.min(list(slacks.values()), axis=0) > -LOOK_BEYOND
        for j, found in _simulated(search, row, np.flatnonzero(near)):
            objective[i, j] = max(r.value for r in found)
            for limit in itertools.chain(*(r.constraints for r in found)):
                values = slacks.setdefault(limit.name, np.full(GRID, np.inf))
                values[j] = min(values[j], limit.slack)
        for name, values in slacks.items():
            slack.setdefault(name, np.full((GRID, GRID), np.inf))[i] = values
        kept = np.min(list(slacks.values()), axis=0) >= 0
        feasible = np.flatnonzero(near & kept)
        for n in feasible[np.argsort(objective[i, feasible], kind="stable")]:
            _keep(search, row[n], float(objective[i, n]))
        search.progress("global grid", (i + 1) / GRID)
    landscape = Landscape(zeta, omega_n, objective, slack)
    search.landscape = landscape
    return landscape


def _simulated(
    search: Search, row: Sequence[PoleSpec], which: Iterable[int]
) -> Iterator[tuple[int, list[TuningRun]]]:
    """Yield the runs of some poles of a row, first case, at the ends of the ratio interval."""
    problem, columns = search.problem, [int(j) for j in which]
    ratios = end_ratios(problem)
    trials = [(row[j], problem.cases[0], ratio) for j in columns for ratio in ratios]
    search.evaluations += len(trials)
    found = iter(runs(problem, trials))
    for j in columns:
        yield j, [next(found) for _ in ratios]


def _keep(search: Search, poles: PoleSpec, value: float) -> None:
    """Remember a grid point when it is the best so far and feasible in every case."""
    problem = search.problem
    if search.best and value >= search.best.value:
        return
    refined = [*linear_constraints(problem, poles), *certificate(problem, poles)]
    if min(c.slack for c in refined) < 0:
        return
    trials = [(poles, *pair) for pair in itertools.product(problem.cases, end_ratios(problem))]
    search.evaluations += len(trials)
    found = runs(problem, trials)
    value = max(r.value for r in found)
    tightest = min(
        [*refined, *itertools.chain(*(r.constraints for r in found))], key=lambda c: c.slack
    )
    if tightest.slack >= 0 and not (search.best and value >= search.best.value):
        x = np.log(poles.values if problem.distinct else poles.first)
        search.best = Candidate(x, value, tightest)


def descend(
    search: Search, start: Array, *, feasibility: bool = False, finish: bool = True
) -> Candidate:
    """Return the local optimum near `start` on the active set.

    SLSQP on the epigraph: minimise t subject to t >= J_i/J_0 and the limits. With `feasibility`
    the limits themselves are relaxed by t instead, which is then minimised. Without `finish` what
    the solver leaves rough, where the voltage may saturate, stays so.
    """
    box = search.problem.box()
    start = np.clip(start, box[:, 0], box[:, 1])
    first = search.candidate(start)
    scale = first.value if math.isfinite(first.value) and first.value > 0 else 1.0
    directions = search.problem.directions

    def rows(z: Array, gradients: bool) -> tuple[Array, Array]:
        x = z[:-1]
        runs = search.runs(x, search.pairs, gradients=gradients)
        limits = [*search.linear(x), *itertools.chain(*(r.constraints for r in runs))]
        values, slopes = _without_repetitions(limits)
        relaxed = [1.0 if feasibility else 0.0] * len(limits)
        values = [v - MARGIN + relaxed[0] * z[-1] for v in values]
        if not feasibility:
            values += [z[-1] - r.value / scale for r in runs]
            slopes += [-r.gradient / scale for r in runs]
            relaxed += [1.0] * len(runs)
        moved = np.array(slopes) @ directions * np.exp(x)
        return np.array(values), np.column_stack([moved, relaxed])

    t = max(0.0, -first.tightest.slack) + MARGIN if feasibility else first.value / scale
    rough = search.problem.limits.allow_saturation
    most = MOST_ROUGH_ITERATIONS if rough else MOST_ITERATIONS
    selector = np.zeros(len(start) + 1)
    selector[-1] = 1.0
    solution = minimize(
        lambda z: z[-1],
        np.append(start, t),
        jac=lambda _: selector,
        method="SLSQP",
        bounds=[*map(tuple, box), (-1.0 if feasibility else 0.0, None)],
        constraints={
            "type": "ineq",
            "fun": lambda z: rows(z, gradients=False)[0],
            "jac": lambda z: rows(z, gradients=True)[1],
        },
        options={"maxiter": most, "ftol": CONVERGED},
        callback=lambda z: search.candidate(np.asarray(z[:-1])) and None,
    )
    found = search.candidate(np.clip(solution.x[:-1], box[:, 0], box[:, 1]))
    ranked = [c for c in (found, first, search.best) if c is not None]
    best = min(ranked, key=lambda c: (max(0.0, -c.tightest.slack), c.value))
    converged = solution.success and best is found and not rough
    done = feasibility or converged or not best.feasible
    return best if done or (rough and not finish) else polish(search, best)


def _without_repetitions(limits: Sequence[Constraint]) -> tuple[list[float], list[Array]]:
    """Return slacks and gradients; what repeats an earlier limit, or is none, becomes neutral.

    A limit is listed at its worst and at the corners, and the two may coincide; equal rows would
    make the solver's quadratic program singular, a varying number of rows would confuse it.
    """
    seen: set[tuple[str, float]] = set()
    values, slopes = [], []
    for limit in limits:
        counts = math.isfinite(limit.slack) and (limit.name, limit.value) not in seen
        seen.add((limit.name, limit.value))
        values.append(limit.slack if counts else 1.0)
        slopes.append(limit.gradient if counts else np.zeros(4))
    return values, slopes


def pattern_search(search: Search, best: Candidate, steps: tuple[float, float]) -> Candidate:
    """Return the best point of a shrinking pattern search around `best`.

    For where no gradient leads: the line search of the local solver got stuck at a kink of a
    limit, or the voltage saturates; then the samples at which the integrator is frozen change one
    by one with the poles and the objective has small jumps.
    """
    step, smallest = steps
    box = search.problem.box()
    axes = len(best.x)
    compass = [np.array(d) for d in itertools.product((-1.0, 0.0, 1.0), repeat=2) if any(d)]
    pads = [np.zeros((axes, 2)) for _ in range(axes // 2)]
    for n, pad in enumerate(pads):
        pad[2 * n : 2 * n + 2] = np.eye(2)
    while step > smallest:
        trials = [best.x + step * pad @ d for pad in pads for d in compass]
        found = [search.candidate(np.clip(x, box[:, 0], box[:, 1])) for x in trials]
        better = [c for c in found if c.feasible and c.value < best.value]
        if better:
            best = min(better, key=lambda c: c.value)
        else:
            step /= 2
    return best


def polish(search: Search, best: Candidate) -> Candidate:
    """Return the best point of ever finer grids around `best`."""
    point, _, count = dense.zoomed(
        search.problem,
        best.x,
        dense.least_objective,
        search.pairs,
        clamped=search.clamped,
        told=search.tell,
        width=dense.LOCAL,
    )
    search.evaluations += count
    return _better(search, best, point)


def _polished_everywhere(search: Search, best: Candidate) -> Candidate:
    """Return the best point around `best` and of the whole box, by grids.

    For where the voltage may saturate: the objective has many small valleys.
    """
    point, count = dense.lowest(
        search.problem,
        dense.least_objective,
        search.pairs,
        clamped=search.clamped,
        told=search.tell,
    )
    search.evaluations += count
    return _better(search, polish(search, best), point)


def _better(search: Search, best: Candidate, point: Array | None) -> Candidate:
    if point is None:
        return best
    found = search.candidate(point)
    return found if found.feasible and found.value < best.value else best


def worst_ratio(search: Search, x: Array, case: TuningCase) -> tuple[float, TuningRun]:
    """Return the ratio of the interval at which the objective is largest, and the run there."""
    low, high = search.problem.family.ratios
    ratios = [float(r) for r in np.linspace(low, high, SCAN)] if high > low else [low]
    values = np.array([r.value for r in search.runs(x, [(case, ratio) for ratio in ratios])])
    top = int(np.argmax(values))
    worst = ratios[top], float(values[top])
    # where the objective does not depend on the ratio rounding picks the top: both ends of the
    # plateau are refined, because the actuator's limit may begin to act just beyond one
    plateau = np.flatnonzero(values >= values[top] * (1 - EQUAL))
    for edge in sorted({int(plateau[0]), int(plateau[-1])}):
        if not 0 < edge < len(ratios) - 1:
            continue
        finer = minimize_scalar(
            lambda r: -search.runs(x, [(case, float(r))])[0].value,
            bounds=(ratios[edge - 1], ratios[edge + 1]),
            method="bounded",
            options={"xatol": 1e-4 * (high - low)},
        )
        if -finer.fun > worst[1] * (1 + EQUAL):
            worst = float(finer.x), -float(finer.fun)
    return worst[0], search.runs(x, [(case, worst[0])])[0]


def exchange(search: Search, starts: Sequence[Array]) -> Candidate:
    """Solve on the active set, add the worst ratios until none is worse; return the best."""
    problem = search.problem
    search.pairs = [(case, ratio) for case in problem.cases for ratio in end_ratios(problem)]
    if search.best is not None:
        search.best = search.candidate(search.best.x, remember=False)
    found = []
    for count, start in enumerate(starts):
        found.append(descend(search, start, finish=False))
        search.stage = ("local solver", (count + 1) / (len(starts) + 1))
    best = min(found, key=lambda c: (max(0.0, -c.tightest.slack), c.value))
    if best.feasible and problem.limits.allow_saturation:
        best = _polished_everywhere(search, best)
    if not best.feasible:
        best = descend(search, best.x, feasibility=True)
        if not best.feasible:
            return best
        best = descend(search, best.x)
    for _ in range(5):
        added = _worse_pairs(search, best)
        if not added:
            break
        search.pairs += added
        search.best = search.candidate(best.x, remember=False)
        best = descend(search, best.x)
    search.progress("local solver", 1.0)
    return best


def _worse_pairs(search: Search, best: Candidate) -> list[Pair]:
    """Return the pairs outside the active set that are worse or break a limit at `best`."""
    added: list[Pair] = []
    low, high = search.problem.family.ratios
    for case in search.problem.cases:
        ratio, at = worst_ratio(search, best.x, case)
        if at.value > best.value * (1 + WORSE):
            added.append((case, ratio))
        pairs = [(case, float(r)) for r in (np.linspace(low, high, SCAN) if high > low else ())]
        for pair, found in zip(pairs, search.runs(best.x, pairs), strict=True):
            if any(not c.satisfied for c in found.constraints):
                added.append(pair)
    return [pair for pair in dict.fromkeys(added) if pair not in search.pairs]
