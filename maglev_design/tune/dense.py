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

from maglev_design.tune.problem import (
    Case,
    TuningProblem,
    coarse_slacks,
    linear_constraints,
    runs,
)

Array = NDArray[np.float64]
Pair = tuple[Case, float]
Score = Callable[[Array, Mapping[str, Array]], Array]
"""(objective, slack of each limit) of n points -> what is made small, shape (n,)."""

WIDE = 41
"""Points along each of zeta and omega_n of the grid over the whole box."""
NARROW = 13
"""Points along each axis of a grid around one point."""
CENTRES = 6
"""Best points of the wide grid around which finer ones are laid."""
LOCAL = 0.02
"""Relative half width of the first grid around a point that a local solver found."""
FINEST = 1e-4
"""Relative half width of the last grid."""
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
        breach = -np.min([slacks[name] for name in names if name in slacks], axis=0)
        return np.where(kept, breach, NONE)

    return score


def evaluated(
    problem: TuningProblem, points: Array, pairs: Sequence[Pair], clamped: bool
) -> tuple[Array, dict[str, Array]]:
    """Return the worst objective and the slack of each limit at n points, the rows of `points`.

    Unstable loops are not run; nothing of theirs but the spectral radius is told.
    """
    poles = [problem.poles(x) for x in points]
    slacks = coarse_slacks(problem, poles)
    objective = np.full(len(points), np.inf)
    stable = np.flatnonzero(slacks["spectral radius"] > 0)
    trials = [(poles[n], *pair) for n in stable for pair in pairs]
    for (n, _), run in zip(
        itertools.product(stable, pairs), runs(problem, trials, clamped=clamped), strict=True
    ):
        objective[n] = run.value if math.isinf(objective[n]) else max(objective[n], run.value)
        for limit in run.constraints:
            row = slacks.setdefault(limit.name, np.full(len(points), np.inf))
            row[n] = min(row[n], limit.slack)
    return objective, slacks


def wide_points(problem: TuningProblem) -> Array:
    """Return the grid of double pole pairs over the whole box, one point a row."""
    axes = [np.linspace(low, high, WIDE) for low, high in problem.box()[:2]]
    pairs = np.array(list(itertools.product(*axes)))
    return np.hstack([pairs, pairs]) if problem.distinct else pairs


def best_points(
    problem: TuningProblem, score: Score, pairs: Sequence[Pair], clamped: bool
) -> tuple[list[Array], int]:
    """Return the points of the wide grid with the smallest scores, apart; and the loops run."""
    points = wide_points(problem)
    scores = _scores(problem, points, score, pairs, clamped, np.zeros(0))
    cell = np.ptp(problem.box()[:2], axis=1) / (WIDE - 1)
    kept: list[Array] = []
    for n in np.argsort(scores, kind="stable"):
        apart = all(np.abs((points[n] - x)[:2] / cell).max() > 1.5 for x in kept)
        if scores[n] < NONE and apart:
            kept.append(points[n])
        if len(kept) == CENTRES:
            break
    return kept, len(points) * len(pairs)


def zoomed(
    problem: TuningProblem,
    start: Array,
    score: Score,
    pairs: Sequence[Pair],
    *,
    clamped: bool,
    told: Callable[[], None],
    width: float | None = None,
) -> tuple[Array, int]:
    """Return the best point of ever finer grids around `start`, and how many loops were run."""
    box = problem.box()
    best, count = start, 0
    width = width or float((np.ptp(box[:2], axis=1) / (WIDE - 1)).max())
    axis = np.linspace(-1, 1, NARROW)
    plane = np.array(list(itertools.product(axis, axis)))
    while width > FINEST:
        told()
        for first in range(0, len(start), 2):  # one pole pair after the other
            points = np.repeat(best[None, :], len(plane), axis=0)
            points[:, first : first + 2] += width * plane
            points = np.clip(np.vstack([best, points]), box[:, 0], box[:, 1])
            scores = _scores(problem, points, score, pairs, clamped, best)
            best = points[int(np.argmin(scores))]
            count += len(points) * len(pairs)
        width /= 2
    return best, count


def _scores(
    problem: TuningProblem,
    points: Array,
    score: Score,
    pairs: Sequence[Pair],
    clamped: bool,
    centre: Array,
) -> Array:
    """Return the scores; the coarse limits are shifted to be exact at `centre`, if there is one."""
    objective, slacks = evaluated(problem, points, pairs, clamped)
    if centre.size and slacks["spectral radius"][0] > 0:
        for limit in reversed(linear_constraints(problem, problem.poles(centre))):
            exact = limit.slack - slacks[limit.name][0]
            if math.isfinite(exact) and exact < 0:
                slacks[limit.name] = slacks[limit.name] + exact
    return np.where(slacks["spectral radius"] > 0, score(objective, slacks), NONE)
