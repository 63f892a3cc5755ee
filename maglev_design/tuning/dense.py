"""Shrinking grids of closed loops in batches: for where no gradient leads.

The line search of a local solver gets stuck at a kink of a limit; where the voltage saturates, the
samples at which the integrator is frozen change one by one with the poles, and the objective has
small jumps; where nothing is feasible there is no objective to follow at all.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from maglev_design.tuning.evaluation import coarse_slacks, linear_constraints, runs
from maglev_design.tuning.problem import TuningCase, TuningProblem

Array = NDArray[np.float64]
Pair = tuple[TuningCase, float]
Score = Callable[[Array, Mapping[str, Array]], Array]
"""(objective, slack of each limit) of n points -> what is made small, shape (n,)."""

WIDE = 41
"""Points along each of zeta and omega_n of the grid over the whole box."""
NARROW = 13
"""Points along each axis of a grid around one point."""
CENTRES = 6
"""Best points of the wide grid around which finer ones are laid."""
APART = 1.5
"""Steps of the wide grid between two centres."""
LOCAL = 0.02
"""Relative half width of the first grid around a point that a local solver found."""
FINEST = 2e-4
"""Relative half width of the last grid."""
FEW = 2
"""Valleys that are followed to the end."""
NONE = 1e9
"""Score of a point that does not count: an unstable loop, or a limit broken that must not be."""


def least_objective(objective: Array, slacks: Mapping[str, Array]) -> Array:
    """Return the objective where every limit is kept."""
    kept = np.min(list(slacks.values()), axis=0) >= 0
    return np.asarray(np.where(kept, objective, NONE))


def least_violation(_: Array, slacks: Mapping[str, Array]) -> Array:
    """Return by how much the limit that is broken most is broken."""
    return np.asarray(-np.min(list(slacks.values()), axis=0))


def least_breach_of(names: Sequence[str]) -> Score:
    """Return the score that breaks only the limits of these names, and them as little as it can."""

    def score(_: Array, slacks: Mapping[str, Array]) -> Array:
        others = [s for name, s in slacks.items() if name not in names]
        kept = np.min(others, axis=0) >= 0
        named = [slacks[name] for name in names if name in slacks]
        breach = -np.min([np.full(kept.shape, np.inf), *named], axis=0)
        return np.where(kept, breach, NONE)

    return score


def linear_slacks(problem: TuningProblem, points: Array, centre: Array | None) -> dict[str, Array]:
    """Return the slacks of the linear loop, coarse, but no milder than is exact at `centre`."""
    slacks = coarse_slacks(problem, [problem.poles(x) for x in points])
    if centre is None:
        return slacks
    at = coarse_slacks(problem, [problem.poles(centre)])
    if at["spectral radius"][0] <= 0:
        return slacks
    lack = dict.fromkeys(at, 0.0)
    for limit in linear_constraints(problem, problem.poles(centre)):
        exact = limit.slack - float(at[limit.name][0])
        lack[limit.name] = min(lack[limit.name], exact if math.isfinite(exact) else 0.0)
    return {name: slack + lack[name] for name, slack in slacks.items()}


def scored(
    problem: TuningProblem,
    points: Array,
    score: Score,
    pairs: Sequence[Pair],
    *,
    clamped: bool,
    centre: Array | None = None,
) -> tuple[Array, dict[str, Array], int]:
    """Return scores and slacks of n points, the rows of `points`, and how many loops were run.

    Loops that are unstable, or whose score the linear limits alone decide, are not run.
    """
    slacks = linear_slacks(problem, points, centre)
    stable = slacks["spectral radius"] > 0
    objective = np.zeros(len(points))
    which = np.flatnonzero(stable & (score(objective, slacks) < NONE))
    trials = [(problem.poles(points[n]), *pair) for n in which for pair in pairs]
    found = runs(problem, trials, clamped=clamped)
    for (n, _), run in zip(itertools.product(which, pairs), found, strict=True):
        objective[n] = max(objective[n], run.value)
        for limit in run.constraints:
            row = slacks.setdefault(limit.name, np.full(len(points), np.inf))
            row[n] = min(row[n], limit.slack)
    return np.where(stable, score(objective, slacks), NONE), slacks, len(trials)


def wide_points(problem: TuningProblem) -> Array:
    """Return the grid of double pole pairs over the whole box, one point a row."""
    axes = [np.linspace(low, high, WIDE) for low, high in problem.box()[:2]]
    pairs = np.array(list(itertools.product(*axes)))
    return np.hstack([pairs, pairs]) if problem.distinct else pairs


def best_points(
    problem: TuningProblem, score: Score, pairs: Sequence[Pair], *, clamped: bool
) -> tuple[list[Array], int]:
    """Return the points of the wide grid with the smallest scores, apart; and the loops run."""
    points = wide_points(problem)
    scores, _, count = scored(problem, points, score, pairs, clamped=clamped)
    cell = _cell(problem)
    kept: list[Array] = []
    for n in np.argsort(scores, kind="stable"):
        apart = all(np.abs((points[n] - x)[:2] / cell).max() > APART for x in kept)
        if scores[n] < NONE and apart:
            kept.append(points[n])
        if len(kept) == CENTRES:
            break
    return kept, count


def _cell(problem: TuningProblem) -> Array:
    """Return the steps of the wide grid in log zeta and log omega_n."""
    return np.asarray(np.ptp(problem.box()[:2], axis=1) / (WIDE - 1))


def zoomed(
    problem: TuningProblem,
    start: Array,
    score: Score,
    pairs: Sequence[Pair],
    *,
    clamped: bool,
    told: Callable[[], None],
    width: float | None = None,
    finest: float = FINEST,
) -> tuple[Array, float, int]:
    """Return the best point of ever finer grids around `start`, its score, and the loops run."""
    box = problem.box()
    best, value, count = start, NONE, 0
    width = width or float(_cell(problem).max())
    axis = np.linspace(-1, 1, NARROW)
    plane = np.array(list(itertools.product(axis, axis)))
    while width > finest:
        told()
        for first in range(0, len(start), 2):  # one pole pair after the other
            points = np.repeat(best[None, :], len(plane), axis=0)
            points[:, first : first + 2] += width * plane
            points = np.clip(np.vstack([best, points]), box[:, 0], box[:, 1])
            scores, _, ran = scored(problem, points, score, pairs, clamped=clamped, centre=best)
            best, value = points[int(np.argmin(scores))], float(scores.min())
            count += ran
        width /= 2
    return best, value, count


def lowest(
    problem: TuningProblem,
    score: Score,
    pairs: Sequence[Pair],
    *,
    clamped: bool,
    told: Callable[[], None],
) -> tuple[Array | None, int]:
    """Return the best point of the whole box, None where none counts, and the loops run.

    Around each of the best points of the wide grid finer ones are laid; the best few valleys are
    followed to the end.
    """
    starts, count = best_points(problem, score, pairs, clamped=clamped)
    valleys = []
    for start in starts:
        point, value, ran = zoomed(
            problem, start, score, pairs, clamped=clamped, told=told, finest=LOCAL
        )
        valleys.append((value, point))
        count += ran
    ends = []
    for _, valley in sorted(valleys, key=lambda item: item[0])[:FEW]:
        point, value, ran = zoomed(
            problem, valley, score, pairs, clamped=clamped, told=told, width=LOCAL
        )
        ends.append((value, point))
        count += ran
    return (min(ends, key=lambda item: item[0])[1] if ends else None), count
