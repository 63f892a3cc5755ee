"""Interval arithmetic with many digits: mpmath's, in a context of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from math import comb
from typing import Any

from sympy import Poly

from maglev_design.certify.intervals.jets import Jet, operators
from maglev_design.lowering import Program

PRECISION = 320
"""[bit] Of every enclosure; a hundred more than the coefficients of fifteen poles cancel."""
DEEPEST = 60
"""Halvings after which a sign that is still open is called undecided."""


@dataclass(frozen=True)
class Arithmetic:
    """Outward-rounded intervals; a comparison that an interval leaves open answers None."""

    precision: int = PRECISION
    context: Any = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        from mpmath.ctx_iv import MPIntervalContext  # noqa: PLC0415 - heavy, and needed only here

        context = MPIntervalContext()
        context.prec = self.precision
        object.__setattr__(self, "context", context)

    def number(self, exact: Fraction | int) -> Any:
        """Return the narrowest enclosure of a rational."""
        exact = Fraction(exact)
        return self.context.mpf(exact.numerator) / self.context.mpf(exact.denominator)

    def between(self, low: Fraction, high: Fraction) -> Any:
        """Return an enclosure of [low, high]."""
        return self.context.mpf([self.number(low).a, self.number(high).b])

    def sqrt(self, number: Any) -> Any:
        """Return the square root."""
        return self.context.sqrt(number)

    def polynomial(self, polynomial: Poly, *values: Any) -> Any:
        """Return a rational polynomial at enclosed values, by Horner's rule in the first one."""
        total = self.number(0)
        powers: dict[int, Any] = {}
        for monomial, coefficient in polynomial.terms():
            term = self.number(Fraction(int(coefficient.p), int(coefficient.q)))
            for value, exponent in zip(values[1:], monomial[1:], strict=True):
                term = term * value**exponent
            powers[monomial[0]] = powers.get(monomial[0], self.number(0)) + term
        for exponent in range(max(powers, default=0), -1, -1):
            total = total * values[0] + powers.get(exponent, self.number(0))
        return total

    def bernstein(self, coefficients: Sequence[Any], low: Any, high: Any) -> list[Any]:
        """Return the Bernstein coefficients on [low, high] of a polynomial, highest first."""
        degree, ascending = len(coefficients) - 1, list(coefficients[::-1])
        width = high - low
        shifted = list(ascending)
        for n in range(degree):  # Taylor shift by low
            for k in range(degree - 1, n - 1, -1):
                shifted[k] = shifted[k] + low * shifted[k + 1]
        scaled = [c * width**n for n, c in enumerate(shifted)]
        return [
            sum(
                (
                    scaled[k] * self.number(Fraction(comb(j, k), comb(degree, k)))
                    for k in range(j + 1)
                ),
                self.number(0),
            )
            for j in range(degree + 1)
        ]

    def keeps_sign(self, coefficients: Sequence[Any], low: Fraction, high: Fraction) -> bool:
        """Whether a polynomial, highest power first, is known to have no zero in [low, high]."""
        open_boxes = [(low, high, 0)]
        while open_boxes:
            a, b, depth = open_boxes.pop()
            signs = self.bernstein(coefficients, self.number(a), self.number(b))
            if all((c > 0) is True for c in signs) or all((c < 0) is True for c in signs):
                continue
            if depth == DEEPEST or a == b:
                return False
            middle = (a + b) / 2
            open_boxes += [(a, middle, depth + 1), (middle, b, depth + 1)]
        return True

    def upper(self, enclosed: Any) -> Fraction:
        """Return the upper end of an enclosure."""
        return _exact(enclosed.b)

    def lower(self, enclosed: Any) -> Fraction:
        """Return the lower end of an enclosure."""
        return _exact(enclosed.a)

    def horner(self, coefficients: Sequence[Any], value: Any) -> Any:
        """Return a polynomial, highest power first, at an enclosed value."""
        total = coefficients[0]
        for coefficient in coefficients[1:]:
            total = total * value + coefficient
        return total

    @cached_property
    def _operators(self) -> Mapping[str, Callable[..., Jet]]:
        return operators(self.context)

    def run(self, program: Program, *values: Jet, wrap: Callable[[Fraction], Jet]) -> list[Jet]:
        """Run a lowered program, whose constants are doubles exactly, on jets."""
        own = dict(self._operators)
        return program.evaluate(own, *values, constant=lambda x: wrap(Fraction(x)))


def _exact(end: Any) -> Fraction:
    """Return an end of an enclosure, a binary fraction, exactly."""
    sign, mantissa, exponent, _ = end._mpi_[0]
    if exponent == "inf" or (not mantissa and exponent):
        raise ArithmeticError("an enclosure without end")
    size = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    return -size if sign else size
