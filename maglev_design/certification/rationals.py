"""Numbers as they were typed, and exact bounds of their square roots; all of them fractions."""

from __future__ import annotations

import math
from fractions import Fraction


def decimal(number: float) -> Fraction:
    """Return a float as the decimal that was typed.

    Examples
    --------
    >>> decimal(0.0246), decimal(0.001)
    (Fraction(123, 5000), Fraction(1, 1000))
    """
    return Fraction(repr(float(number)))


def short(number: float) -> Fraction:
    """Return the short decimal that sums and squares of decimals in doubles stand for."""
    return Fraction(f"{number:.12g}")


def root(square: Fraction, unit: Fraction) -> tuple[Fraction, Fraction]:
    """Return bounds of a square root: equal where it is rational, else neighbours in `unit`.

    Examples
    --------
    >>> root(Fraction(9, 4), Fraction(1, 10))
    (Fraction(3, 2), Fraction(3, 2))
    >>> root(Fraction(2), Fraction(1, 10))
    (Fraction(7, 5), Fraction(3, 2))
    """
    exact = Fraction(math.isqrt(square.numerator), math.isqrt(square.denominator))
    if exact**2 == square:
        return exact, exact
    below = math.isqrt(math.floor(square / unit**2))
    return below * unit, (below + 1) * unit
