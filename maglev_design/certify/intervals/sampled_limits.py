"""The largest sampling period and the largest delay that the loop with exact beta survives.

The first crossing above what the rig has is looked for with eigenvalues on a grid, then enclosed:
below, stability is proved at every gap of the range; above, instability at one gap. That nothing
happens between two points of the grid is not proved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.certify.intervals.arithmetic import Arithmetic
from maglev_design.certify.intervals.routh import is_hurwitz
from maglev_design.certify.intervals.sampled import Setting, Timing, enclose, parts, timing
from maglev_design.certify.intervals.sampled_path import nominal_quotients, proved_over
from maglev_design.certify.rationals import decimal
from maglev_design.parameters import LONGEST_PERIOD, MOST_DELAYED_PERIODS

GAPS = 7
"""Gaps at which eigenvalues are computed."""
STEP = 1.02
"""Ratio of two periods of the grid."""
SHORTEST = 1e-3
"""Shortest period of the grid over the rig's."""
FRACTIONS = 10
"""Points of the grid of delays in a period."""
SLACKS = tuple(Fraction(1, 10**n) for n in (6, 4, 2))
"""Relative distances from the crossing at which proofs are tried, in turn."""


@dataclass(frozen=True)
class Limit:
    """The largest value of a time, enclosed.

    Attributes
    ----------
    stable : float
        [s] Proved stable at every gap of the range.
    unstable : float
        [s] Proved unstable at `gap`.
    gap : float
        [m]
    """

    stable: float
    unstable: float
    gap: float

    def as_dict(self) -> dict[str, Any]:
        """Return the limit for JSON."""
        return asdict(self)


def radii(loop: Setting, when: Timing, gaps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the spectral radius at exact beta and each gap [m], by eigenvalues; shape (n,)."""
    made = parts(loop.method, loop.controller, when.part > 0)
    true = float(loop.weight) / (gaps + float(loop.offset))
    period, part = float(when.period), float(when.part)
    law, plant = (
        [np.broadcast_to(x, gaps.shape) for x in values]
        for values in (
            made.law.numpy()(period, *map(float, loop.gains)),
            made.plant.numpy()(true, period, part),
        )
    )
    fixed, gain, gain_c_y = map(np.array, made.pencil(law, plant, np.zeros_like(gaps), when.whole))
    v = float(sum(nominal_quotients(loop)) / 2)
    seen = float(loop.C_Y_hat[0]) + float(loop.C_Y_hat[1]) * v
    rho = (float(loop.shape[0]) + float(loop.shape[1]) * true) / v
    rows = fixed + rho * (gain + seen * gain_c_y)
    size = len(rows) - 1
    companions = np.zeros((len(gaps), size, size))
    companions[:, 0, :] = -(rows[1:] / rows[0]).T
    companions[:, np.arange(1, size), np.arange(size - 1)] = 1.0
    return np.asarray(np.abs(np.linalg.eigvals(companions)).max(axis=1))


def largest_period(
    loop: Setting, period: float, delay: float, gaps: tuple[float, float]
) -> Limit | None:
    """Return the largest sampling period, the delay [s] as it is; None where none was found."""
    late = decimal(delay)

    def at(value: float) -> Timing:
        return timing(Fraction(value), late)

    up = np.arange(0, np.log(max(LONGEST_PERIOD / period, STEP)), np.log(STEP))
    down = np.arange(0, np.log(SHORTEST), -np.log(STEP))
    return _limit(loop, at, period * np.exp(up), period * np.exp(down), gaps)


def largest_delay(
    loop: Setting, period: float, delay: float, gaps: tuple[float, float]
) -> Limit | None:
    """Return the largest delay from sample to voltage, the period [s] as it is."""
    exact = decimal(period)

    def at(value: float) -> Timing:
        return timing(exact, Fraction(value))

    step = period / FRACTIONS
    up = np.append(
        delay, np.arange(np.floor(delay / step) + 1, MOST_DELAYED_PERIODS * FRACTIONS) * step
    )
    down = np.append(np.arange(delay, 0.0, -step), 0.0)
    return _limit(loop, at, up, down, gaps)


def _limit(
    loop: Setting,
    at: Callable[[float], Timing],
    up: NDArray[np.float64],
    down: NDArray[np.float64],
    gaps: tuple[float, float],
) -> Limit | None:
    """Return the first crossing on a grid of times, rising, or falling where it starts unstable."""
    places = np.linspace(*gaps, GAPS) if gaps[0] < gaps[1] else np.array(gaps[:1])

    def stable(value: float) -> bool:
        return bool(radii(loop, at(float(value)), places).max() < 1)

    pair = _first_change(stable, up, down)
    if pair is None:
        return None
    low, high = pair
    for _ in range(45):
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    worst = float(places[int(np.argmax(radii(loop, at(high), places)))])
    kept = _proved_stable(loop, at, low, gaps)
    lost = _proved_unstable(loop, at, high, worst)
    return None if kept is None or lost is None else Limit(kept, lost, worst)


def _first_change(
    stable: Callable[[float], bool], up: NDArray[np.float64], down: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Return a stable value and a larger unstable one next to it on the grid."""
    if stable(up[0]):
        for low, high in pairwise(up):
            if not stable(high):
                return float(low), float(high)
        return None
    for high, low in pairwise(down):
        if stable(low):
            return float(low), float(high)
    return None


def _proved_stable(
    loop: Setting, at: Callable[[float], Timing], value: float, gaps: tuple[float, float]
) -> float | None:
    exact = (decimal(gaps[0]), decimal(gaps[1]))
    for slack in SLACKS:
        kept = value * (1 - float(slack))
        if proved_over(loop, at(kept), exact, nominal_quotients(loop)):
            return kept
    return None


def _proved_unstable(
    loop: Setting, at: Callable[[float], Timing], value: float, gap: float
) -> float | None:
    arithmetic = Arithmetic()
    v = arithmetic.between(*nominal_quotients(loop))
    for slack in SLACKS:
        lost = value * (1 + float(slack))
        if is_hurwitz(enclose(loop, at(lost), decimal(gap), arithmetic).at(v)) is False:
            return lost
    return None
