"""The complete set of beta_c/beta for which the sampled loop is stable, its ends enclosed.

In w a loop is stable iff all roots of c_n w^n + ... + c_0 lie to the left of the imaginary axis;
c_i = alpha_i + beta_i v. Where a coefficient is known to be negative it is not (Stodola), which
bounds the search from both sides. Inside, stability can change only at zeros of c_0 (z = 1), c_n
(z = -1) and D_{n-1} (a pair), polynomials in v whose zeros are isolated by Bernstein coefficients
in interval arithmetic. Between them one point decides. Nothing is sampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from flint import arb, arb_poly

from maglev_design.certification.intervals.arithmetic import (
    bernstein_signs,
    between,
    lower,
    number,
    sign,
    upper,
    working,
)
from maglev_design.certification.intervals.jets import coefficients, variable
from maglev_design.certification.intervals.routh import hurwitz_determinant, is_hurwitz
from maglev_design.certification.intervals.sampled import Affine, Setting, enclose
from maglev_design.certification.intervals.spans import ZERO, End, Span, StableSet, unite
from maglev_design.certification.rationals import decimal
from maglev_design.controller.timing import ExactTiming

NARROW = Fraction(1, 10**13)
"""Relative width of the enclosure of an end."""
HAIR = Fraction(1, 2**50)
"""Relative: wider than any enclosure, narrower than what a reader sees."""
FARTHEST = Fraction(10**12)
"""Where the search ends when no coefficient says that it may."""
DEEPEST = 200
"""Halvings after which a zero counts as not isolated."""
CENTRES = tuple(Fraction(n, 97) for n in (97, 101, 61, 173))
"""Where D_{n-1} is expanded, in turn, should an entry of the Routh array vanish there."""


class UndecidedError(ArithmeticError):
    """The precision does not suffice; more bits may."""


def sampled_ratios_at(loop: Setting, when: ExactTiming, gap: float) -> StableSet:
    """Return every beta_c/beta for which the sampled loop is stable at one gap [m].

    Raises
    ------
    ArithmeticError
        When a cell stays undecided: two ends closer than any precision tried tells apart.
    """
    for precision in (320, 640, 1280):
        with working(precision), suppress(UndecidedError):
            return StableSet((gap, gap), _spans(loop, enclose(loop, when, decimal(gap))))
    raise ArithmeticError(f"the stability of the sampled loop at {gap} m stays undecided")


def _spans(loop: Setting, affine: Affine) -> tuple[Span, ...]:
    def stable(v: Fraction) -> bool:
        verdict = is_hurwitz(affine.at(number(v)))
        if verdict is None:
            raise UndecidedError
        return verdict

    low, high = _possible(affine)
    if low >= high:
        return ()
    brackets = [(low, low), *_brackets(affine, low, high), (high, high)]
    cells = list(zip((a for _, a in brackets), (b for b, _ in brackets[1:]), strict=False))
    inside = [stable((a + b) / 2) for a, b in cells]
    ends = [_end(loop, *bracket) for bracket in brackets]
    if low == 0:
        ends[0] = ZERO
    if high == FARTHEST and inside[-1]:
        far = loop.scale * FARTHEST**loop.power
        ends[-1] = End(float("inf"), None, far, None)
    return unite(ends, [False, *inside, False], lambda n: _through(affine, brackets[n]))


def _through(affine: Affine, bracket: tuple[Fraction, Fraction]) -> bool:
    return is_hurwitz(affine.at(between(*bracket))) is True


def _end(loop: Setting, low: Fraction, high: Fraction) -> End:
    a, b = (loop.scale * v**loop.power for v in (low, high))
    return End(float((a + b) / 2), None, a, b)


def _possible(affine: Affine) -> tuple[Fraction, Fraction]:
    """Return a range of v outside which a coefficient is known to be negative.

    Wider than need be by a hair, so that a zero of c_0 or c_n that bounds it lies inside.
    """
    low, high = Fraction(0), FARTHEST
    for a, b in zip(affine.alpha, affine.beta, strict=True):
        if a < 0 and b < 0:
            return Fraction(0), Fraction(0)
        if b < 0:
            high = min(high, upper(-a / b) * (1 + HAIR))
        elif b > 0 and a < 0:
            low = max(low, lower(-a / b) * (1 - HAIR))
    return low, high


def determinant(affine: Affine, centre: Fraction) -> list[arb]:
    """Return the Taylor coefficients of D_{n-1} in v at `centre`, lowest first.

    Routh's array in power series of v - centre, cut off at the degree n - 1 of D_{n-1}, which is
    a polynomial: nothing is lost.
    """
    v = variable(number(centre), len(affine.alpha) - 2)
    return coefficients(hurwitz_determinant(affine.at(v)))


def _brackets(affine: Affine, low: Fraction, high: Fraction) -> list[tuple[Fraction, Fraction]]:
    """Return disjoint enclosures of all zeros of c_0, c_n and D_{n-1} between two v."""
    found = []
    for n in (0, -1):
        linear = [affine.alpha[n], affine.beta[n]]
        found += isolate(linear, Fraction(0), low, high)
    scale = Fraction(1) if low == 0 or high == FARTHEST else (low + high) / 2
    for share in CENTRES:
        try:
            taylor = determinant(affine, scale * share)
        except ZeroDivisionError:
            continue
        found += isolate(taylor, scale * share, low, high)
        break
    else:
        raise UndecidedError
    found.sort()
    merged: list[tuple[Fraction, Fraction]] = []
    for a, b in found:
        if merged and a <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(b, merged[-1][1]))
        else:
            merged.append((a, b))
    return merged


@dataclass(frozen=True)
class _Series:
    """A polynomial by its Taylor coefficients, lowest first, at a centre."""

    terms: Sequence[arb]
    centre: Fraction

    def sign(self, v: Fraction) -> int:
        """Return the sign at a point, 0 where it is open."""
        return sign(arb_poly(self.terms)(number(v - self.centre)))

    def changes(self, low: Fraction, high: Fraction) -> int | None:
        """Return the number of sign changes of the Bernstein coefficients; None where open."""
        signs = bernstein_signs(self.terms, low - self.centre, high - self.centre)
        known = [n for n, s in enumerate(signs) if s]
        if not known or not signs[0] or not signs[-1]:
            return None
        pairs = list(pairwise(known))
        if any(signs[i] == signs[j] and j > i + 1 for i, j in pairs):
            return None
        return sum(signs[i] != signs[j] for i, j in pairs)


def isolate(
    terms: Sequence[arb], centre: Fraction, low: Fraction, high: Fraction
) -> list[tuple[Fraction, Fraction]]:
    """Return disjoint narrow enclosures, between two v, of every zero of a polynomial.

    Raises
    ------
    UndecidedError
        When the polynomial cannot be told from zero on some narrow interval.
    """
    series, found, boxes = _Series(terms, centre), [], [(low, high, 0)]
    while boxes:
        a, b, depth = boxes.pop()
        changes = series.changes(a, b)
        if changes == 0:
            continue
        if changes == 1:
            found.append(_narrowed(series, a, b))
            continue
        if depth == DEEPEST:
            raise UndecidedError
        middle = next((m for m in _splits(a, b) if series.sign(m)), None)
        if middle is None:
            raise UndecidedError
        boxes += [(a, middle, depth + 1), (middle, b, depth + 1)]
    return sorted(found)


def _splits(low: Fraction, high: Fraction) -> list[Fraction]:
    """Return points to halve at, in turn: geometric where the range is wide."""
    return [low + (high - low) * share for share in (Fraction(1, 2), Fraction(7, 16))]


def _narrowed(series: _Series, low: Fraction, high: Fraction) -> tuple[Fraction, Fraction]:
    """Return a narrower enclosure of the one zero between two points of opposite sign."""
    below = series.sign(low)
    while high - low > NARROW * high:
        middle = (low + high) / 2
        sign = series.sign(middle)
        if sign == 0:
            middle = low + (high - low) * Fraction(7, 16)
            sign = series.sign(middle)
        if sign == 0:
            raise UndecidedError
        low, high = (middle, high) if sign == below else (low, middle)
    return low, high
