"""Intervals with many digits: Arb's balls, between exact rationals and what is asked of them.

A ball encloses a number whatever the precision, which :func:`working` sets. A comparison of balls
is true only where it is known to be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from operator import add, mul, neg, sub, truediv
from typing import Any

from flint import arb, arb_poly, ctx, fmpq
from sympy import Poly, Rational

PRECISION = 320
"""[bit] Of every enclosure; a hundred more than the coefficients of fifteen poles cancel."""
LONGEST = 100_000
"""Terms of a power series, beyond which Arb cuts it off; more than any has here."""
DEEPEST = 60
"""Halvings after which a sign that is still open is called undecided."""

OPERATORS: Mapping[str, Callable[..., Any]] = {
    "add": add,
    "sub": sub,
    "mul": mul,
    "div": truediv,
    "neg": neg,
    "sqrt": lambda x: x.sqrt(),
    "exp": lambda x: x.exp(),
    "sinh": lambda x: (x.exp() - (-x).exp()) / 2,
    "cosh": lambda x: (x.exp() + (-x).exp()) / 2,
}
"""What a lowered program needs to run on enclosed numbers, on series of them and on rationals."""


@contextmanager
def working(precision: int = PRECISION) -> Iterator[None]:
    """Compute with this many bits meanwhile."""
    cap = ctx.cap
    with ctx.workprec(precision):
        ctx.cap = LONGEST
        try:
            yield
        finally:
            ctx.cap = cap


def exact(number: Fraction | Rational | float) -> fmpq:
    """Return a number as it is."""
    if isinstance(number, Rational):
        return fmpq(number.p, number.q)
    return fmpq(*number.as_integer_ratio())


def number(rational: Fraction | Rational | int) -> arb:
    """Return an enclosure of a rational, as narrow as the precision."""
    return arb(exact(rational))


def between(low: Fraction, high: Fraction) -> arb:
    """Return an enclosure of [low, high]."""
    return number(low).union(number(high))


def upper(enclosed: arb) -> Fraction:
    """Return a number that is not below the enclosed one."""
    return _exact(enclosed.upper())


def lower(enclosed: arb) -> Fraction:
    """Return a number that is not above the enclosed one."""
    return _exact(enclosed.lower())


def _exact(end: arb) -> Fraction:
    if not end.is_finite():
        raise ArithmeticError("an enclosure without end")
    rational = end.fmpq()
    return Fraction(int(rational.numerator), int(rational.denominator))


def sign(enclosed: arb) -> int:
    """Return 1 or -1, or 0 where it is open."""
    return int(enclosed > 0) - int(enclosed < 0)


def at(polynomial: Poly, *values: arb) -> arb:
    """Return a rational polynomial at enclosed values, by Horner's rule in the first one."""
    powers: dict[int, arb] = {}
    for monomial, coefficient in polynomial.terms():
        term = number(coefficient)
        for value, exponent in zip(values[1:], monomial[1:], strict=True):
            term *= value**exponent
        powers[monomial[0]] = powers.get(monomial[0], arb(0)) + term
    return arb_poly([powers.get(n, arb(0)) for n in range(max(powers, default=0) + 1)])(values[0])


def bernstein_signs(coefficients: Sequence[arb], low: Fraction, high: Fraction) -> list[int]:
    """Return the signs of the Bernstein coefficients on [low, high], from low to high, 0 for open.

    Of p(low + (high - low) t), lowest first, they are up to positive factors the coefficients of
    (1 + s)^n p(s/(1 + s)), by Taylor's shift of p with its coefficients the other way round.
    """
    size = len(coefficients)
    moved = arb_poly(coefficients)(arb_poly([number(low), number(high - low)]))
    shifted = arb_poly([moved[n] for n in range(size - 1, -1, -1)])(arb_poly([1, 1]))
    return [sign(shifted[n]) for n in range(size - 1, -1, -1)]


def keeps_sign(coefficients: Sequence[arb], low: Fraction, high: Fraction) -> bool:
    """Whether a polynomial, lowest power first, is known to have no zero in [low, high]."""
    open_boxes = [(low, high, 0)]
    while open_boxes:
        a, b, depth = open_boxes.pop()
        if abs(sum(bernstein_signs(coefficients, a, b))) == len(coefficients):
            continue
        if depth == DEEPEST or a == b:
            return False
        middle = (a + b) / 2
        open_boxes += [(a, middle, depth + 1), (middle, b, depth + 1)]
    return True
