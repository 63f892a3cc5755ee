"""Numbers as they were typed: what a float stands for, as a fraction."""

from __future__ import annotations

from fractions import Fraction


def decimal(number: float) -> Fraction:
    """Return a float as the decimal that was typed.

    Examples
    --------
    >>> decimal(0.0246), decimal(0.001)
    (Fraction(123, 5000), Fraction(1, 1000))
    """
    return Fraction(repr(float(number)))
