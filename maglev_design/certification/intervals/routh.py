"""Routh's array with numbers, exact or enclosed in intervals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from math import prod
from typing import Any

from maglev_design.certification.intervals.jets import leading


def first_column(coefficients: Sequence[Any]) -> Iterator[Any]:
    """Yield the first column of the Routh array, n + 1 entries; divide only when asked for more.

    Parameters
    ----------
    coefficients : sequence of Fraction, float or interval
        Highest power first.

    Examples
    --------
    >>> list(first_column([1.0, 2.0, 4.0, 3.0]))
    [1.0, 2.0, 2.5, 3.0]
    """
    upper, lower = list(coefficients[0::2]), list(coefficients[1::2])
    yield upper[0]
    for _ in range(len(coefficients) - 1):
        yield lower[0]
        factor = upper[0] / lower[0]
        above = zip(upper[1:], lower[1:], strict=False)
        rest = upper[len(lower) :]  # below it nothing is taken away
        upper, lower = lower, [*(a - factor * b for a, b in above), *rest]


def is_hurwitz(coefficients: Sequence[Any]) -> bool | None:
    """Whether every root lies left of the imaginary axis; None where that is not decided.

    A polynomial of degree n with a positive leading coefficient is asymptotically stable iff the
    n + 1 entries of the first column of its Routh array are positive. The first entry that is
    known not to be positive decides against, whatever follows.

    Parameters
    ----------
    coefficients : sequence of Fraction, float or interval
        Highest power first; comparisons of intervals are true only where they are known to be.

    Examples
    --------
    >>> is_hurwitz([1, 2, 1]), is_hurwitz([1, 0, 1]), is_hurwitz([1, 1, 1, 2])
    (True, False, False)
    """
    for entry in first_column(coefficients):
        if not entry > 0:
            return False if entry <= 0 else None
    return True


def hurwitz_determinant(coefficients: Sequence[Any]) -> Any:
    """Return the Hurwitz determinant of order n - 1, the product of n - 1 entries of the column.

    By Orlando's formula it is, up to a factor that keeps its sign, the product of w_i + w_j over
    all pairs of roots: it vanishes where a pair crosses the imaginary axis.

    Parameters
    ----------
    coefficients : sequence of interval, or of series of intervals
        Highest power first.

    Raises
    ------
    ZeroDivisionError
        When an entry cannot be told from zero.
    """
    entries = []
    for entry in islice(first_column(coefficients), 1, len(coefficients) - 1):
        if not abs(leading(entry)) > 0:
            raise ZeroDivisionError("an entry of the Routh array cannot be told from zero")
        entries.append(entry)
    return prod(entries[1:], start=entries[0])
