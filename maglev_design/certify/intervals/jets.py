"""Truncated Taylor series of enclosed numbers, and what bounds a function over a range by them.

    f(Q) in f_0 + f_1 d + ... + f_{K-1} d^{K-1} + f_K(Q) d^K,  d = Q - q,

f_k the Taylor coefficients at the middle q of Q, f_K(Q) the last one enclosed over all of Q
(Taylor's theorem). Operations are those of R. E. Moore, Methods and Applications of Interval
Analysis (1979), sec. 3.4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

WIDEST, NARROWEST = 5, 2
"""K for wide and for narrow ranges: the last term is the K-th power of the relative width."""


def order_for(width: float) -> int:
    """Return the K with which the last term is negligible at a relative `width` of the range."""
    return WIDEST if width > 1e-2 else 3 if width > 1e-5 else NARROWEST


@dataclass(frozen=True)
class Jet:
    """Taylor coefficients f_0, ..., f_K of a function of one variable; f_0 alone for a constant.

    The coefficients are numbers, or jets in another variable.
    """

    terms: tuple[Any, ...]

    def __add__(self, other: Jet) -> Jet:
        longer, shorter = _sorted(self.terms, other.terms)
        added = (a + b for a, b in zip(longer, shorter, strict=False))
        return Jet((*added, *longer[len(shorter) :]))

    def __neg__(self) -> Jet:
        return Jet(tuple(-a for a in self.terms))

    def __sub__(self, other: Jet) -> Jet:
        return self + (-other)

    def __mul__(self, other: Jet) -> Jet:
        a, b = _sorted(self.terms, other.terms)
        if len(b) == 1:
            return Jet(tuple(x * b[0] for x in a))
        return Jet(tuple(_dot(a[: n + 1], b[n::-1]) for n in range(len(a))))

    def __truediv__(self, other: Jet) -> Jet:
        a, b = self.terms, other.terms
        if len(b) == 1:
            return Jet(tuple(x / b[0] for x in a))
        found = [a[0] / b[0]]
        for n in range(1, len(b)):
            known = _dot(found, b[n:0:-1])
            found.append((a[n] - known if n < len(a) else -known) / b[0])
        return Jet(tuple(found))

    def __abs__(self) -> Any:
        """Return the size of the leading number, by which a jet can be divided or not."""
        return abs(self.terms[0])


def _sorted(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return two tuples, the longer one first; they are of one length, or one is a constant."""
    return (a, b) if len(a) >= len(b) else (b, a)


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    products = [x * y for x, y in zip(a, b, strict=True)]
    return sum(products[1:], start=products[0])


def widened(near: Jet, last: Any, away: Any) -> Jet:
    """Return the Taylor coefficients at every point q + d, d in `away`, from those at q.

        f_k(Q) in sum_m C(m, k) f_m d^(m - k),  k <= m <= K,  f_K(Q) for the last.

    Far narrower than a direct evaluation over Q where f is a difference that nearly cancels.

    Parameters
    ----------
    near : Jet
        f_0, ..., f_{K-1} at q.
    last
        f_K(Q).
    """
    known = (*near.terms, last)
    found = []
    for k in range(len(known)):
        total = known[-1] * comb(len(known) - 1, k)
        for m in range(len(known) - 2, k - 1, -1):
            total = total * away + known[m] * comb(m, k)
        found.append(total)
    return Jet(tuple(found))


def operators(context: Any) -> Mapping[str, Callable[..., Jet]]:
    """Return what a lowered program needs to run on jets over mpmath's interval `context`."""

    def sqrt(x: Jet) -> Jet:
        root = [context.sqrt(x.terms[0])]
        for n in range(1, len(x.terms)):
            rest = x.terms[n]
            for a, b in zip(root[1:], root[:0:-1], strict=True):
                rest = rest - a * b
            root.append(rest / (2 * root[0]))
        return Jet(tuple(root))

    def exp(x: Jet) -> Jet:
        found = [context.exp(x.terms[0])]
        slope = [n * term for n, term in enumerate(x.terms)]
        for n in range(1, len(x.terms)):
            found.append(_dot(slope[1 : n + 1], found[::-1]) / n)
        return Jet(tuple(found))

    def half(x: Jet) -> Jet:
        return Jet(tuple(term / 2 for term in x.terms))

    return {
        "add": Jet.__add__,
        "sub": Jet.__sub__,
        "mul": Jet.__mul__,
        "div": Jet.__truediv__,
        "neg": Jet.__neg__,
        "sqrt": sqrt,
        "exp": exp,
        "sinh": lambda x: half(exp(x) - exp(-x)),
        "cosh": lambda x: half(exp(x) + exp(-x)),
    }
