"""Truncated Taylor series of enclosed numbers, and what bounds a function over a range by them.

    f(Q) in f_0 + f_1 d + ... + f_{K-1} d^{K-1} + f_K(Q) d^K,  d = Q - q,

f_k the Taylor coefficients at the middle q of Q, f_K(Q) the last one enclosed over all of Q
(Taylor's theorem; R. E. Moore, Methods and Applications of Interval Analysis (1979), sec. 3.4).
Series in one variable are Arb's; those in two have them for coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import mul
from typing import Any

from flint import arb, arb_poly, arb_series

WIDEST, NARROWEST = 5, 2
"""K for wide and for narrow ranges: the last term is the K-th power of the relative width."""


def order_for(width: float) -> int:
    """Return the K with which the last term is negligible at a relative `width` of the range."""
    return WIDEST if width > 1e-2 else 3 if width > 1e-5 else NARROWEST


def variable(value: arb, order: int) -> arb_series:
    """Return the series of a variable at an enclosed value, up to its power `order`."""
    return arb_series([value, arb(1)][: order + 1], prec=order + 1)


def coefficients(series: arb_series) -> list[arb]:
    """Return all of them that are kept, zeros included, lowest first."""
    return [series[n] for n in range(series.prec)]


def leading(x: Any) -> Any:
    """Return the leading number of a series in one variable or two, or a number itself."""
    if isinstance(x, Jet):
        x = x.terms[0]
    return x[0] if isinstance(x, arb_series) else x


@dataclass(frozen=True)
class Jet:
    """A truncated series in one variable whose coefficients are series in another."""

    terms: tuple[arb_series, ...]

    def __sub__(self, other: Jet) -> Jet:
        return Jet(tuple(a - b for a, b in zip(self.terms, other.terms, strict=True)))

    def __mul__(self, other: Jet) -> Jet:
        a, b = self.terms, other.terms
        return Jet(tuple(sum(map(mul, a[: n + 1], b[n::-1])) for n in range(len(a))))

    def __truediv__(self, other: Jet) -> Jet:
        b, found = other.terms, list[arb_series]()
        for n, a in enumerate(self.terms):
            found.append((a - sum(map(mul, found, b[n:0:-1]))) / b[0])
        return Jet(tuple(found))


def widened(near: arb_series, last: arb, away: arb) -> arb_series:
    """Return the Taylor coefficients at every point q + d, d in `away`, from those at q.

        f_k(Q) in sum_m C(m, k) f_m d^(m - k),  k <= m <= K,  f_K(Q) for the last.

    Far narrower than a direct evaluation over Q where f is a difference that nearly cancels.

    Parameters
    ----------
    near : arb_series
        f_0, ..., f_{K-1} at q.
    last : arb
        f_K(Q).
    """
    moved = arb_poly([*coefficients(near), last])(arb_poly([away, 1]))
    return arb_series(moved, prec=near.prec + 1)
