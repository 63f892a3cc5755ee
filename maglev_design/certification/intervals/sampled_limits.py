"""The largest sampling period and the largest delay that the loop with exact beta survives.

The first crossing above what the rig has is looked for with eigenvalues on a grid, then enclosed:
below, stability is proved at every gap of the range; above, instability at one gap. That nothing
happens between two points of the grid is not proved. At another delay the difference equation is
the same; at another period it is made anew from the same gains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.certification.intervals.arithmetic import between, working
from maglev_design.certification.intervals.routh import is_hurwitz
from maglev_design.certification.intervals.sampled import (
    Setting,
    enclose,
    parts,
)
from maglev_design.certification.intervals.sampled_path import (
    SLACKS,
    nominal_quotients,
    proved_over,
)
from maglev_design.certification.rationals import decimal
from maglev_design.controller.timing import ExactTiming, exact_timing
from maglev_design.linear_loop.polynomials import polynomial_roots
from maglev_design.rig import LONGEST_PERIOD, MOST_DELAYED_PERIODS

GAPS = 7
"""Gaps at which eigenvalues are computed."""
STEP = 1.02
"""Ratio of two periods of the grid."""
SHORTEST = 1e-3
"""Shortest period of the grid over the rig's."""
FRACTIONS = 10
"""Points of the grid of delays in a period."""
FALLBACKS = tuple(Fraction(1, 2**n) for n in range(6))
"""Shares of a time at which they are tried where none of those near it succeeds."""


class LimitStatus(Enum):
    """How the search for a largest time ended; the value says what to make of its numbers."""

    PROVED = "stable up to the first, proved there at every gap; proved unstable at the second"
    GAVE_UP = (
        "gave up: eigenvalues cross the unit circle between the two, but the proof right below was "
        "too long; the first is the longest that was proved"
    )
    BEYOND = "no end up to the longest that was looked at; the first is the longest proved"
    UNSTABLE = "unstable, by eigenvalues, at all that was looked at, from the second upwards"


@dataclass(frozen=True)
class TimeLimit:
    """The largest value of a time, as far as it is known.

    Attributes
    ----------
    status : LimitStatus
    stable : float
        [s] Proved stable at every gap of the range; 0 where nothing was.
    unstable : float or None
        [s] Proved unstable at `gap`; None where no such value was found. Of UNSTABLE the shortest
        that was looked at, by eigenvalues.
    gap : float or None
        [m]
    """

    status: LimitStatus
    stable: float
    unstable: float | None = None
    gap: float | None = None

    @property
    def value(self) -> float | None:
        """The best proved lower bound [s]; None where there is no such time."""
        return None if self.status is LimitStatus.UNSTABLE else self.stable

    def as_dict(self) -> dict[str, Any]:
        """Return the limit for JSON."""
        return {
            "status": self.status.name.lower().replace("_", "-"),
            "message": self.status.value,
            "stable": self.value,
            "unstable": self.unstable,
            "gap": self.gap,
        }


def radii(loop: Setting, when: ExactTiming, gaps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the spectral radius at exact beta and each gap [m], by eigenvalues; shape (n,)."""
    made = parts(loop.method, loop.controller, when.part > 0)
    true = loop.coefficient(gaps, float)
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
    rho = loop.shape_at(true, float) / v
    rows = fixed + rho * (gain + float(loop.C_Y_hat) * gain_c_y)
    return np.asarray(np.abs(polynomial_roots(rows.T)).max(axis=1))


def largest_period(
    loop: Setting, period: float, delay: float, gaps: tuple[float, float]
) -> TimeLimit:
    """Return the largest sampling period, the gains and the delay [s] as they are.

    Shorter periods than the delay over MOST_DELAYED_PERIODS are not looked at: no rig may have one.
    """
    late = decimal(delay)

    def at(value: float) -> ExactTiming:
        return exact_timing(Fraction(value), late)

    up = np.arange(0, np.log(max(LONGEST_PERIOD / period, STEP)), np.log(STEP))
    shortest = max(SHORTEST * period, delay / MOST_DELAYED_PERIODS)
    down = np.arange(0, np.log(shortest / period), -np.log(STEP))
    return _limit(loop, at, period * np.exp(up), np.append(period * np.exp(down), shortest), gaps)


def largest_delay(
    loop: Setting, period: float, delay: float, gaps: tuple[float, float]
) -> TimeLimit:
    """Return the largest delay from sample to voltage, the period [s] as it is."""
    exact = decimal(period)

    def at(value: float) -> ExactTiming:
        return exact_timing(exact, Fraction(value))

    step = period / FRACTIONS
    up = np.append(
        delay, np.arange(np.floor(delay / step) + 1, MOST_DELAYED_PERIODS * FRACTIONS) * step
    )
    down = np.append(np.arange(delay, 0.0, -step), 0.0)
    return _limit(loop, at, up, down, gaps)


def _limit(
    loop: Setting,
    at: Callable[[float], ExactTiming],
    up: NDArray[np.float64],
    down: NDArray[np.float64],
    gaps: tuple[float, float],
) -> TimeLimit:
    """Return the first crossing on a grid of times, rising, or falling where it starts unstable.

    No time below the last of the falling grid is looked at.
    """
    places = np.linspace(*gaps, GAPS) if gaps[0] < gaps[1] else np.array(gaps[:1])

    def stable(value: float) -> bool:
        return bool(radii(loop, at(float(value)), places).max() < 1)

    def worst_gap(value: float) -> float:
        return float(places[int(np.argmax(radii(loop, at(value), places)))])

    def kept(shares: Sequence[Fraction], value: float) -> float:
        exact, quotients = (decimal(gaps[0]), decimal(gaps[1])), nominal_quotients(loop)
        tried = (value * float(share) for share in shares)
        known = (x for x in tried if x >= down[-1] and proved_over(loop, at(x), exact, quotients))
        return next(known, 0.0)

    def longest(value: float) -> float:
        return max(kept(FALLBACKS, value), kept((Fraction(1),), float(up[0])))

    if not stable(up[0]) and not any(stable(value) for value in down):
        shortest = float(down[-1])
        return TimeLimit(LimitStatus.UNSTABLE, 0.0, shortest, worst_gap(shortest))
    pair = _first_change(stable, up, down)
    if pair is None:
        return TimeLimit(LimitStatus.BEYOND, longest(float(up[-1])))
    low, high = pair
    for _ in range(45):
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    worst = worst_gap(high)
    lost = _proved_unstable(loop, at, high, worst)
    near = kept([1 - slack for slack in SLACKS], low)
    if near and lost is not None:
        return TimeLimit(LimitStatus.PROVED, near, lost, worst)
    return TimeLimit(LimitStatus.GAVE_UP, near or longest(low), lost, worst)


def _first_change(
    stable: Callable[[float], bool], up: NDArray[np.float64], down: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Return a stable value and a larger unstable one next to it on the grid."""
    if stable(up[0]):
        pairs = ((low, high) for low, high in pairwise(up) if not stable(high))
    else:
        pairs = ((low, high) for high, low in pairwise(down) if stable(low))
    return next(((float(low), float(high)) for low, high in pairs), None)


@working()
def _proved_unstable(
    loop: Setting, at: Callable[[float], ExactTiming], value: float, gap: float
) -> float | None:
    v = between(*nominal_quotients(loop))
    for slack in SLACKS:
        lost = value * (1 + float(slack))
        if is_hurwitz(enclose(loop, at(lost), decimal(gap)).at(v)) is False:
            return lost
    return None
