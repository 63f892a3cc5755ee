"""The sampled loop proved stable at every gap of a range and every beta_c/beta of another.

The range of gaps is cut into pieces. On a piece c_0, c_n and D_{n-1} are polynomials in v and
C_Y' up to Taylor's remainder, enclosed; they are positive on the whole rectangle, and the loop is
stable at its middle: then it is stable throughout. Where that stays open, the piece is halved.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from flint import arb_series

from maglev_design.certification.intervals.arithmetic import between, number, working
from maglev_design.certification.intervals.jets import Jet, coefficients, order_for, widened
from maglev_design.certification.intervals.positivity import middle_and_radius, positive
from maglev_design.certification.intervals.routh import hurwitz_determinant, is_hurwitz
from maglev_design.certification.intervals.sampled import (
    Affine,
    Setting,
    enclose,
    expand,
)
from maglev_design.certification.intervals.sampled_interval import sampled_ratios_at
from maglev_design.certification.intervals.spans import End, Span, StableSet
from maglev_design.certification.rationals import decimal, root
from maglev_design.controller.timing import ExactTiming

Range = tuple[Fraction, Fraction]
Pair = tuple[float, float]
PIECE_PRECISION = 160
"""[bit] Pieces are wide; digits beyond these do not narrow what is enclosed on them."""
HAIR = Fraction(1, 10**30)
"""Relative width of a range of v, up to which it is one enclosed number."""
MOST_PIECES = 120
"""Pieces of a range of gaps after which a proof is given up, up to LOW_DEGREE."""
LOW_DEGREE = 8
"""Beyond it pieces soon take seconds, and fewer are allowed: as the eighth power."""
FEWEST_PIECES = 4
"""A proof that may not take as many is not begun."""
SLACKS = tuple(Fraction(1, 10**n) for n in (6, 4, 2))
"""Relative distances from an end or a crossing at which a proof for all gaps is tried, in turn."""
TRIED_GAPS = 5
"""Single gaps among which the ends over a range are looked for."""


@working(PIECE_PRECISION)
def proved_over(loop: Setting, when: ExactTiming, gaps: Range, quotients: Range) -> bool:
    """Whether the loop is proved stable at every gap and every v of two closed ranges.

    Parameters
    ----------
    gaps : tuple of Fraction
        [m]
    quotients : tuple of Fraction
        Of v in beta_c/beta = scale v^power.
    """
    done = most = 0
    for gap in gaps:
        affine = enclose(loop, when, gap)
        most = MOST_PIECES * LOW_DEGREE**8 // max(LOW_DEGREE, len(affine.alpha) - 1) ** 8
        if most < FEWEST_PIECES:
            return False
        if any(is_hurwitz(affine.at(number(v))) is False for v in quotients):
            return False  # a corner is a counterexample
    ends = sorted(loop.coefficient(gap) for gap in gaps)
    todo = [(ends[0], ends[1])]
    while todo:
        low, high = todo.pop()
        done += 1
        verdict = proved_piece(loop, when, (low, high), quotients)
        if verdict is None and done < most and low < high:
            middle = (low + high) / 2
            todo += [(low, middle), (middle, high)]
        elif not verdict:
            return False
    return True


def proved_piece(loop: Setting, when: ExactTiming, true: Range, quotients: Range) -> bool | None:
    """Return whether a rectangle in C_Y' and v is stable; None where that is open."""
    low, high = true
    half, order = (high - low) / 2, order_for(float((high - low) / 2 / high))
    at, whole = number((low + high) / 2), between(low, high)
    near = expand(loop, when, at, order - 1)
    verdict = is_hurwitz([x[0] for x in near.at(number(sum(quotients) / Fraction(2)))])
    if not verdict:
        return verdict
    try:
        rough = expand(loop, when, whole, order)
        far = Affine(
            *(
                tuple(widened(a, b[order], whole - at) for a, b in zip(mine, last, strict=True))
                for mine, last in ((near.alpha, rough.alpha), (near.beta, rough.beta))
            )
        )
        fronts = [_signs(x, quotients) for x in (near, far)]
    except (ZeroDivisionError, ValueError):  # a divisor, of series the latter, that may be zero
        return None
    reach, width = number((quotients[1] - quotients[0]) / 2), number(half)

    def table(mine: Sequence[arb_series], last: Sequence[arb_series]) -> list[list[Pair]]:
        rows = ([*coefficients(a), b[order]] for a, b in zip(mine, last, strict=True))
        return [
            [middle_and_radius(c * reach**j * width**k) for k, c in enumerate(row)]
            for j, row in enumerate(rows)
        ]

    return all(positive(table(*pair)) for pair in zip(*fronts, strict=True)) or None


def _signs(affine: Affine, quotients: Range) -> tuple[tuple[arb_series, ...], ...]:
    """Return c_0, c_n and D_{n-1} as Taylor coefficients at the middle v, series in C_Y'.

    The first one alone, over all v, where these are a hair apart.
    """
    low, high = quotients
    if high - low <= HAIR * high:
        numbers = affine.at(between(low, high))
        return tuple((x,) for x in (numbers[-1], numbers[0], hurwitz_determinant(numbers)))
    v, rest = number((low + high) / 2), [0 * affine.alpha[0]] * (len(affine.alpha) - 3)
    series = [Jet((a + b * v, b, *rest)) for a, b in zip(affine.alpha, affine.beta, strict=True)]
    determinant: Jet = hurwitz_determinant(series)
    return tuple(x.terms for x in (series[-1], series[0], determinant))


def nominal_quotients(loop: Setting) -> Range:
    """Return a range of v, a point where it is rational, that holds beta_c/beta = 1."""
    return _quotients(loop, (Fraction(1), Fraction(1)), Fraction(1, 10**40))


def _quotients(loop: Setting, ratios: Range, hair: Fraction) -> Range:
    """Return the v of two ratios, the lower rounded down and the upper up, by less than `hair`."""
    low, high = (ratio / loop.scale for ratio in ratios)
    return (low, high) if loop.power == 1 else (root(low, hair)[0], root(high, hair)[1])


def sampled_ratios_over(loop: Setting, when: ExactTiming, gaps: tuple[float, float]) -> StableSet:
    """Return the beta_c/beta around 1 for which the loop is stable at every gap [m] of a range.

    Each end lies between a ratio up to which stability is proved for all gaps, its `value`, and
    one at which the loop is proved unstable at some gap. Empty where no proof was found.
    """
    exact = (decimal(gaps[0]), decimal(gaps[1]))
    tried = [float(gap) for gap in np.linspace(*gaps, TRIED_GAPS)]
    sets = [sampled_ratios_at(loop, when, gap) for gap in tried]
    spans = [found.around(Fraction(1)) for found in sets]
    for slack in SLACKS:
        ends = _common(spans, slack)
        if ends is None:
            break
        lower, upper = ends
        if lower.high is None or upper.low is None:
            break
        # rounded outwards by far less than the slack
        quotients = _quotients(loop, (lower.high, upper.low), slack / 10**6)
        if proved_over(loop, when, exact, quotients):
            return StableSet(gaps, (Span(lower, upper),))
    return StableSet(gaps, ())


def _common(spans: Sequence[Span | None], slack: Fraction) -> tuple[End, End] | None:
    """Return the ends of what the intervals share, drawn in by `slack`; None where nothing is."""
    known = [span for span in spans if span is not None]
    if len(known) < len(spans):
        return None
    lower = max((span.lower for span in known), key=lambda end: end.value)
    upper = min((span.upper for span in known), key=lambda end: end.value)
    if lower.high is None or upper.low is None:
        return None
    low, high = lower.high * (1 + slack), upper.low * (1 - slack)
    if low >= high:
        return None
    return End(float(low), None, lower.low, low), End(float(high), None, high, upper.high)
