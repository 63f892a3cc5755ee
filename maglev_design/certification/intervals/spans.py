"""What an answer looks like: a union of open intervals whose ends are known as said."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from maglev_design.options import Equilibrium


@dataclass(frozen=True)
class End:
    """One end of an interval.

    Attributes
    ----------
    value : float
        0 and inf where nothing but the sign of the quantity bounds it.
    exact : str or None
        The algebraic number; None for a transcendental one and at infinity.
    low, high : Fraction or None
        The end lies in [low, high]; None at infinity.
    """

    value: float
    exact: str | None
    low: Fraction | None
    high: Fraction | None


ZERO = End(0.0, "0", Fraction(0), Fraction(0))
INFINITY = End(math.inf, None, None, None)


@dataclass(frozen=True)
class Span:
    """An open interval (lower, upper), stable throughout."""

    lower: End
    upper: End

    def contains(self, number: Fraction) -> bool:
        """Whether `number` is known to lie inside."""
        above = self.lower.high is not None and self.lower.high < number
        return above and (self.upper.low is None or number < self.upper.low)


@dataclass(frozen=True)
class StableSet:
    """Where a loop is asymptotically stable: ratios beta_c/beta, or gaps.

    Attributes
    ----------
    gaps : tuple of float or None
        [m] Stable at every gap from the first to the second; None for a set of gaps [m].
    spans : tuple of Span
        Every stable interval, ascending; none where the loop is unstable everywhere.
    recomputed : str or None
        The reading by which the controller is computed anew on each plant; None: it stays.
    """

    gaps: tuple[float, float] | None
    spans: tuple[Span, ...]
    recomputed: Equilibrium | None = None

    def around(self, number: Fraction) -> Span | None:
        """Return the interval that contains `number`, else the first, else None."""
        inside = [span for span in self.spans if span.contains(number)]
        return next(iter([*inside, *self.spans]), None)

    def as_dict(self, number: Fraction, reading: Equilibrium) -> dict[str, Any]:
        """Return the set for JSON: the interval around `number`, and all of them.

        `reading` is that by which a controller that stays was made.
        """
        rows = [
            {
                "lower": span.lower.value,
                "upper": span.upper.value,
                "lower_exact": span.lower.exact,
                "upper_exact": span.upper.exact,
                "lower_enclosure": _pair(span.lower),
                "upper_enclosure": _pair(span.upper),
            }
            for span in self.spans
        ]
        main = self.around(number)
        chosen = rows[self.spans.index(main)] if main else dict.fromkeys(EMPTY)
        where: dict[str, Any] = {}
        if self.gaps is not None:
            low, high = self.gaps
            where = {"gap": low} if low == high else {"gap": [low, high]}
        return {
            "equilibrium": self.recomputed or reading,
            "controller": "recomputed" if self.recomputed else "fixed",
            **where,
            "stable": main is not None,
            "nominal_inside": main is not None and main.contains(number),
            **chosen,
            "intervals": rows,
        }


EMPTY = ("lower", "upper", "lower_exact", "upper_exact", "lower_enclosure", "upper_enclosure")


def _pair(end: End) -> list[float | None]:
    """Return doubles around an end, rounded outwards unless they are exact; None at infinity."""
    return [_rounded(end.low, -math.inf), _rounded(end.high, math.inf)]


def _rounded(exact: Fraction | None, towards: float) -> float | None:
    if exact is None:
        return None
    near = float(exact)
    return near if Fraction(near) == exact else math.nextafter(near, towards)


def unite(
    ends: Sequence[End],
    stable: Sequence[bool],
    passes: Callable[[int], bool],
) -> tuple[Span, ...]:
    """Return the stable intervals of (0, oo) from its cells.

    Parameters
    ----------
    ends : sequence of End
        What separates the cells, ascending.
    stable : sequence of bool
        One a cell, one more than ends.
    passes : callable
        Whether the loop is stable at the end of a number, too, so that its two cells are one.
    """
    spans: list[Span] = []
    lower: End | None = None
    for n, inside in enumerate(stable):
        left = ends[n - 1] if n else ZERO
        if inside and lower is None:
            lower = left
        elif inside and lower is not None and not passes(n - 1):
            spans.append(Span(lower, left))
            lower = left
        elif not inside and lower is not None:
            spans.append(Span(lower, left))
            lower = None
    if lower is not None:
        spans.append(Span(lower, INFINITY))
    return tuple(spans)
