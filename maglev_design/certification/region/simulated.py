"""The plane of initial errors as simulation sees it, and what it says to the guaranteed region."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.certification.intervals.arithmetic import exact
from maglev_design.certification.rationals import decimal
from maglev_design.certification.region.guaranteed import Region
from maglev_design.controller.design import Design
from maglev_design.errors import InputError
from maglev_design.files import picked
from maglev_design.options import Backend
from maglev_design.rig import ReferencePath, Rig
from maglev_design.simulation import Scenario, loop_for, simulate_batch
from maglev_design.simulation.grid import contact_gap

Array = NDArray[np.float64]

GRID = 41
"""Points of a map along each axis; odd, so that no error at all is one of them."""
SETTLING = 40.0
"""Time constants of the slowest desired pole that a start has to converge."""
SETTLED = 1e-4
"""Error at the end, over the gap, below which a start has converged: what is left of any is less
by many orders of magnitude."""
MARGIN = 1.5
"""Size of the map around a guaranteed region over that of the region."""


@dataclass(frozen=True)
class RegionMap:
    """Which initial errors one loop survives: no crash, and convergence at the end.

    Attributes
    ----------
    e : array, shape (n,)
        Initial errors of position [m].
    v : array, shape (m,)
        Initial errors of velocity [m/s].
    survived : array, shape (m, n)
    gap : float
        Where the loop regulates [m].
    ratio : float
        beta_c/beta.
    continuous : bool
        Whether the law was the continuous one.
    """

    e: Array
    v: Array
    survived: NDArray[np.bool_]
    gap: float
    ratio: float
    continuous: bool

    @property
    def area(self) -> float:
        """Area of the survived starts inside the map [m^2/s]; each point stands for one cell."""
        cell = (self.e[1] - self.e[0]) * (self.v[1] - self.v[0])
        return float(cell * self.survived.sum())

    def as_dict(self) -> dict[str, Any]:
        """Return what the map says for JSON; SI units."""
        return {
            **picked(self, "gap", "ratio", "continuous"),
            "position_errors": [float(self.e[0]), float(self.e[-1])],
            "velocity_errors": [float(self.v[0]), float(self.v[-1])],
            "starts": int(self.survived.size),
            "survived": int(self.survived.sum()),
            "area": self.area,
        }


def simulated_map(
    rig: Rig,
    design: Design,
    extent: tuple[tuple[float, float], tuple[float, float]] | None = None,
    *,
    points: int = GRID,
    ratio: float = 1.0,
    gap: float | None = None,
    continuous: bool = True,
    threads: int = 1,
    backend: Backend = "auto",
) -> RegionMap:
    """Return which initial errors of position and velocity the loop survives, by simulation.

    Parameters
    ----------
    rig : Rig
        Regulates at `gap`; its own path is not followed.
    design : Design
        Stays; the plant's beta is the design's beta_c over the ratio.
    extent : pair of pairs, optional
        Least and largest e [m] and v [m/s]; default: :func:`whole_plane`.
    points : int
        Along each axis.
    ratio : float
    gap : float, optional
        Default: the start of the rig's reference [m].
    continuous : bool
        The continuous law, of which the guaranteed region speaks; False for the sampled one.
    threads, backend
        Of :func:`maglev_design.simulation.simulate_batch`.

    Raises
    ------
    InputError
        For fewer than two points.
    """
    if points < 2:
        raise InputError(f"points = {points}: a map needs at least 2 points along each axis")
    gap = rig.reference.start_gap if gap is None else gap
    holding = rig.model_copy(update={"reference": _hold(gap, _settling_time(design))})
    (left, right), (low, high) = whole_plane(rig, gap) if extent is None else extent
    e, v = np.linspace(left, right, points), np.linspace(low, high, points)
    beta = design.beta_at(ratio)
    scenarios = [Scenario(beta, gap + float(x), float(y)) for y in v for x in e]
    loop = loop_for(holding, design, continuous=continuous)
    found = simulate_batch(
        loop, [design] * len(scenarios), scenarios, threads=threads, backend=backend
    )
    survived = [
        not one.metrics.crashed and abs(one.metrics.final_error) <= SETTLED * gap for one in found
    ]
    return RegionMap(e, v, np.reshape(survived, (points, points)), gap, ratio, continuous)


def whole_plane(rig: Rig, gap: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the errors of every gap the rig allows, and twice the speed of a fall across them.

    A rig without an upper limit of the gap is taken to allow twice `gap`.
    """
    near, far = contact_gap(rig), rig.limits.gap[1]
    far = far if math.isfinite(far) else 2 * gap
    speed = 2 * math.sqrt(2 * rig.plant.gravity * (far - near))
    return (near - gap, far - gap), (-speed, speed)


def region_extent(region: Region) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the extent of a map around a guaranteed region; None when there is no region."""
    e, least, most = region.outline()
    if not e.size:
        return None
    centre, half = (e[-1] + e[0]) / 2, MARGIN * (e[-1] - e[0]) / 2
    low, high = float(least.min()), float(most.max())
    middle, tall = (high + low) / 2, MARGIN * (high - low) / 2
    return (centre - half, centre + half), (middle - tall, middle + tall)


def contradictions(region: Region, simulated: RegionMap) -> tuple[tuple[float, float], ...]:
    """Return the points (e, v) that are guaranteed and did not survive: there must be none.

    Raises
    ------
    ValueError
        When the map is of another gap, of a ratio outside the region's, or of the sampled law.
    """
    low, high = region.ratios
    same = simulated.continuous and exact(simulated.gap) == region.model.gap
    if not same or not low <= decimal(simulated.ratio) <= high:
        raise ValueError("the region and the map are not of the same loop")
    rows, columns = np.nonzero(~simulated.survived)
    dead = (
        (float(simulated.e[j]), float(simulated.v[i])) for i, j in zip(rows, columns, strict=True)
    )
    return tuple(point for point in dead if region.contains(*point))


def region_curves(region: Region, whole: RegionMap, near: RegionMap | None) -> dict[str, Array]:
    """Return what the figure of a region and its maps is drawn from, SI units."""
    e, least, most = region.outline()
    curves = {"outline_e": e, "outline_low": least, "outline_high": most}
    for name, one in (("whole", whole), ("near", near)):
        if one is not None:
            curves[f"{name}_e"], curves[f"{name}_v"] = one.e, one.v
            curves[f"{name}_survived"] = one.survived.astype(float)
    return curves


def _hold(gap: float, horizon: float) -> ReferencePath:
    return ReferencePath(
        start_gap=gap, end_gap=gap, start_time=0.0, end_time=horizon, horizon=horizon
    )


def _settling_time(design: Design) -> float:
    """Return the time in which a start has to converge [s]."""
    values = design.poles.values
    slowest = min(
        omega * (zeta - math.sqrt(max(zeta**2 - 1, 0.0)))
        for zeta, omega in zip(values[::2], values[1::2], strict=True)
    )
    return SETTLING / slowest
