"""The picture of the whole box: objective and limits at every point of a grid of double pairs."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STARTS = 3
"""Local minima of the grid from which the local solver starts."""


@dataclass(frozen=True)
class Landscape:
    """Objective and limits over the box of a double pole pair.

    Attributes
    ----------
    zeta, omega_n : array, shape (n,)
    objective : array, shape (n, n)
        Worst case over the ends of the ratio interval; nan where the loop is unstable or far
        outside the limits. Rows are zeta.
    slack : dict of str to array, shape (n, n)
        Smallest slack of each limit.
    """

    zeta: Array
    omega_n: Array
    objective: Array
    slack: dict[str, Array]

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Where every limit is kept."""
        kept = np.all([s >= 0 for s in self.slack.values()], axis=0)
        return np.asarray(kept & np.isfinite(self.objective))


def stable_somewhere(landscape: Landscape) -> bool:
    """Whether any grid point gives a stable loop over the whole family."""
    return bool((landscape.slack["spectral radius"] > 0).any())


def starting_points(landscape: Landscape) -> list[tuple[float, float]]:
    """Return (zeta, omega_n) of the best local minima among the feasible grid points.

    Without a feasible point: the one that is closest to being so.
    """
    feasible = landscape.feasible
    if not feasible.any():
        worst = np.min([np.nan_to_num(s, nan=-1e6) for s in landscape.slack.values()], axis=0)
        worst = np.where(np.isfinite(landscape.objective), worst, worst - 10.0)
        i, j = np.unravel_index(int(np.argmax(worst)), worst.shape)
        return [(float(landscape.zeta[i]), float(landscape.omega_n[j]))]
    values = np.where(feasible, landscape.objective, np.inf)
    padded = np.pad(values, 1, constant_values=np.inf)
    rows, columns = values.shape
    shifts = [
        padded[1 + di : 1 + di + rows, 1 + dj : 1 + dj + columns]
        for di, dj in itertools.product((-1, 0, 1), repeat=2)
        if (di, dj) != (0, 0)
    ]
    lowest = feasible & (values <= np.min(shifts, axis=0))
    order = sorted(zip(*np.nonzero(lowest), strict=True), key=lambda ij: float(values[ij]))
    return [(float(landscape.zeta[i]), float(landscape.omega_n[j])) for i, j in order[:STARTS]]
