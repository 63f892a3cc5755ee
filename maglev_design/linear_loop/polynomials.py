"""Polynomials as lists of coefficients, highest power first: CasADi expressions or numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray


def sum_of(longer: Sequence[Any], shorter: Sequence[Any]) -> list[Any]:
    """Return the sum of two polynomials, highest power first."""
    pad = len(longer) - len(shorter)
    return [x + (shorter[n - pad] if n >= pad else 0) for n, x in enumerate(longer)]


def modulus(coefficients: Sequence[Any], theta: Any) -> Any:
    """Return |polynomial| at exp(j theta)."""
    powers = range(len(coefficients) - 1, -1, -1)
    real = sum(c * ca.cos(n * theta) for c, n in zip(coefficients, powers, strict=True))
    imaginary = sum(c * ca.sin(n * theta) for c, n in zip(coefficients, powers, strict=True))
    return ca.sqrt(real**2 + imaginary**2)


def mean_square(numerator: Sequence[Any], denominator: Sequence[Any]) -> Any:
    """Return the variance of numerator/denominator driven by white noise of variance one.

    Recursion of Astrom, Jury and Agniel (IEEE Trans. Automatic Control 15, 1970): exact for a
    stable denominator, both highest power first; it reduces the degree by one a turn.
    """
    a = list(denominator)
    b = [ca.SX(0)] * (len(a) - len(numerator)) + list(numerator)
    lead, total = a[0], ca.SX(0)
    while True:
        total += b[-1] ** 2 / a[0]
        if len(a) == 1:
            return total / lead
        last = len(a) - 1
        alpha, weight = a[-1] / a[0], b[-1] / a[0]
        b = [b[i] - weight * a[last - i] for i in range(last)]
        a = [a[i] - alpha * a[last - i] for i in range(last)]


def times(first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
    """Return the product of two polynomials."""
    found = [ca.SX(0)] * (len(first) + len(second) - 1)
    for i, x in enumerate(first):
        for j, y in enumerate(second):
            found[i + j] += x * y
    return found


def shifted(coefficients: Sequence[Any]) -> list[Any]:
    """Return a polynomial in w = z - 1 as one in z."""
    found = list(coefficients)
    for end in range(len(found), 1, -1):
        for k in range(1, end):
            found[k] = found[k] - found[k - 1]
    return found


def resolvent(matrix: Any) -> tuple[list[Any], list[Any]]:
    """Return det(x I - M) and the coefficients of adj(x I - M), by Leverrier and Faddeev."""
    order = matrix.shape[0]
    unit = ca.SX.eye(order)
    polynomial, adjugate = [ca.SX(1)], [unit]
    for k in range(1, order + 1):
        moved = matrix @ adjugate[-1]
        polynomial.append(-ca.trace(moved) / k)
        adjugate.append(moved + polynomial[-1] * unit)
    return polynomial, adjugate[:-1]


def polynomial_roots(rows: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the roots of polynomials, one a row, highest power first; shape (n, degree)."""
    degree = rows.shape[1] - 1
    companions = np.zeros((len(rows), degree, degree))
    companions[:, 0, :] = -rows[:, 1:] / rows[:, :1]
    companions[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(companions), dtype=complex)
