"""What robustness costs: the objective against the error of beta up to which a proof exists."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.design import Design, PoleSpec
from maglev_design.tuning.evaluation import design_at
from maglev_design.tuning.result import TuneResult

Array = NDArray[np.float64]
Widest = Callable[[Design], float]
"""From a controller to the largest u whose ratios [1 - u, 1 + u] are certified; nan without one."""


@dataclass(frozen=True)
class TradeOff:
    """Pole placements that keep every limit, and the optimum as the last; shape (n,) each.

    Attributes
    ----------
    zeta, omega_n : array
        Of the first pole pair.
    objective : array
        Worst case over the ratio interval of the tuning.
    certified : array
        Largest u that is certified [-]; nan without a certificate.
    """

    zeta: Array
    omega_n: Array
    objective: Array
    certified: Array

    def as_dicts(self) -> list[dict[str, float | bool]]:
        """Return one table a placement, for JSON."""
        names = ("zeta", "omega_n", "objective", "certified_beta_error", "on_front")
        columns = (self.zeta, self.omega_n, self.objective, self.certified, self.front)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return [dict(zip(names, row, strict=True)) for row in rows]

    @property
    def front(self) -> NDArray[np.bool_]:
        """Which placements no other beats in one figure without losing in the other."""
        known = ~np.isnan(self.certified)
        beaten = [
            np.any(
                known
                & (self.objective <= j)
                & (self.certified >= u)
                & ((self.objective < j) | (self.certified > u))
            )
            for j, u in zip(self.objective, self.certified, strict=True)
        ]
        return np.asarray(known & ~np.array(beaten, dtype=bool))


def trade_off(
    result: TuneResult, widest: Widest, progress: Callable[[str, float], None]
) -> TradeOff:
    """Return the objective and the certified error of beta over the grid of the search."""
    problem, landscape = result.problem, result.landscape
    found: list[tuple[float, float, float]] = []
    if landscape is not None:
        rows, columns = np.nonzero(landscape.feasible)
        points = (landscape.zeta[rows], landscape.omega_n[columns])
        values = (*points, landscape.objective[rows, columns])
        found = list(zip(*(column.tolist() for column in values), strict=True))
    best = float(getattr(result.figures.worst, problem.objective.key))
    designs = [design_at(problem, PoleSpec.double(zeta, w)) for zeta, w, _ in found]
    designs.append(result.design)
    found.append((*result.poles.first, best))
    certified = []
    for count, design in enumerate(designs):
        progress("certified errors of beta", count / len(designs))
        certified.append(widest(design))
    zeta, omega_n, objective = np.array(found).T
    return TradeOff(zeta, omega_n, objective, np.array(certified))
