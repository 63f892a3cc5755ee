"""Real algebraic numbers: positive roots of rational polynomials, isolated exactly."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import sympy as sp
from sympy import Poly, Symbol

NARROW = Fraction(1, 10**30)
"""Width to which isolating intervals are refined, in the unit of the root."""

x = Symbol("x", positive=True)


@dataclass(frozen=True)
class Root:
    """One positive real algebraic number.

    Attributes
    ----------
    polynomial : Poly
        Its minimal polynomial over the integers.
    low, high : Fraction
        The isolating interval: no other root of `polynomial` lies in it. Equal where the number
        is rational.
    """

    polynomial: Poly
    low: Fraction
    high: Fraction

    @property
    def value(self) -> float:
        """The nearest double, to rounding."""
        return float((self.low + self.high) / 2)

    @property
    def text(self) -> str:
        """The number in closed form where its degree is at most 2, else by its polynomial."""
        if self.low == self.high:
            return str(self.low)
        if self.polynomial.degree() == 2:
            for closed in sp.roots(self.polynomial):
                if _inside(closed, self.low, self.high):
                    return str(sp.radsimp(closed))
        shown = self.polynomial.as_expr(x)
        low, high = (_decimal(end) for end in (self.low, self.high))
        return f"root of {shown} in [{low}, {high}]"


def _inside(number: sp.Expr, low: Fraction, high: Fraction) -> bool:
    return bool(number >= sp.Rational(low)) and bool(number <= sp.Rational(high))


def _decimal(number: Fraction) -> str:
    """Return a decimal near an end of an isolating interval; the interval stays isolating."""
    return str(sp.Float(sp.Rational(number), 28))


def positive_roots(polynomials: Iterable[Poly]) -> tuple[Root, ...]:
    """Return every positive root of the univariate `polynomials`, sorted, each once.

    Irreducible factors share no root; their isolating intervals are refined until they are
    disjoint and narrower than `NARROW`, or shrunk to a point.
    """
    factors = {
        factor.set_domain(sp.ZZ)
        for polynomial in polynomials
        if not polynomial.is_zero
        for factor, _ in polynomial.factor_list()[1]
        if factor.degree() > 0
    }
    found = []
    for factor in sorted(factors, key=lambda f: (f.degree(), [int(c) for c in f.all_coeffs()])):
        primitive = factor.primitive()[1]
        if primitive.degree() == 1:
            lead, constant = primitive.all_coeffs()
            at = Fraction(-int(constant), int(lead))
            ends = [(at, at)]
        else:
            intervals = primitive.intervals(eps=sp.Rational(NARROW), inf=0)
            ends = [(Fraction(a), Fraction(b)) for (a, b), _ in intervals]
        found += [Root(primitive, low, high) for low, high in ends if high > 0]
    found.sort(key=lambda root: (root.low, root.high))
    for left, right in pairwise(found):
        if left.high >= right.low:
            raise ArithmeticError(f"roots closer than {float(NARROW):g}: {left}, {right}")
    return tuple(found)


def squared(root: Root, scale: Fraction, power: int) -> Root:
    """Return scale root^power, power 1 or 2, with its minimal polynomial."""
    symbol = root.polynomial.gen
    if power == 1:
        image = root.polynomial.as_expr().subs(symbol, x / sp.Rational(scale))
    else:
        image = conjugated(root.polynomial, x / sp.Rational(scale))
    low, high = scale * root.low**power, scale * root.high**power
    candidates = [
        other
        for other in positive_roots([Poly(sp.expand(image), x)])
        if other.high >= low and other.low <= high
    ]
    if len(candidates) != 1:
        raise ArithmeticError(f"cannot tell which root of {image} is meant")
    return candidates[0]


def conjugated(polynomial: Poly, w: sp.Expr) -> sp.Expr:
    """Return p(sqrt(w)) p(-sqrt(w)) = E(w)^2 - w O(w)^2 of p(v) = E(v^2) + v O(v^2)."""
    terms = polynomial.as_dict(native=False).items()
    even, odd = (
        sp.Add(*[c * w ** (n // 2) for (n,), c in terms if n % 2 == side]) for side in (0, 1)
    )
    return even**2 - w * odd**2


def between(ends: Sequence[Root]) -> tuple[Fraction, ...]:
    """Return a simple rational in every gap of (0, oo) that the sorted `ends` leave."""
    if not ends:
        return (Fraction(1),)
    inner = [_simple(left.high, right.low) for left, right in pairwise(ends)]
    return (ends[0].low / 2, *inner, math.ceil(2 * ends[-1].high) + Fraction(1))


def _simple(low: Fraction, high: Fraction) -> Fraction:
    """Return a fraction with a small denominator strictly between two."""
    middle, span = (low + high) / 2, high - low
    return middle.limit_denominator(max(1, math.ceil(2 / span))) if span < 2 else middle
