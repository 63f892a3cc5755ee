"""The whole of what a certificate claims, checked in rational arithmetic.

Nothing here knows a solver, a controller or a plant: matrices of :class:`fractions.Fraction` come
in, positive definite or not comes out. To trust a certificate is to trust this page, and that the
claimed polytope contains the loop (:mod:`maglev_design.certification.lyapunov.enclosure`).

Let A = sum_v w_v A_v + D with w_v >= 0, sum_v w_v = 1 and a remainder of Frobenius norm at most r.
V(x) = x'Px shrinks along x' = A x, or x_{k+1} = A x_k, with the rate `decay` = a, when P > 0 and at
every vertex, respectively,

    -(A_v'P + P A_v) - 2a P - 2r tr(P) I > 0,                                            (1)
    (1 - 2aT) P - (1 + tau) A_v'P A_v - (1 + 1/tau) r^2 tr(P) I > 0.                     (2)

Proof. 0 < P <= tr(P) I. (1) is affine in A_v, hence holds for the average, and
D'P + PD <= 2 |D| |P| I <= 2r tr(P) I. In (2), A'PA is convex in A, so that (2) holds for the
average H of the vertices, and for every tau > 0

    (H + D)'P(H + D) <= (1 + tau) H'PH + (1 + 1/tau) D'PD,  D'PD <= r^2 tr(P) I.

(1) gives V' < -2aV, (2) V_{k+1} < (1 - 2aT) V_k <= exp(-2aT) V_k: both times sqrt(V) falls at
least as exp(-a t). One P serves all members, so the gap may even change while the loop runs
(sampled: from one period to the next).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

Matrix = tuple[tuple[Fraction, ...], ...]

TAU = Fraction(1, 2**32)
"""tau of (2); remainders are near 2^-60, so that both of its shares are negligible."""


def is_positive_definite(matrix: Matrix) -> bool:
    """Return whether a symmetric matrix is positive definite: every pivot of L D L' is positive.

    Examples
    --------
    >>> one, two = Fraction(1), Fraction(2)
    >>> is_positive_definite(((two, one), (one, one)))
    True
    >>> is_positive_definite(((one, two), (two, one)))
    False
    """
    rows = [list(row) for row in matrix]
    if any(rows[i][j] != rows[j][i] for i in range(len(rows)) for j in range(i)):
        return False
    for k in range(len(rows)):
        if rows[k][k] <= 0:
            return False
        for i in range(k + 1, len(rows)):
            share = rows[i][k] / rows[k][k]
            rows[i] = [x - share * y for x, y in zip(rows[i], rows[k], strict=True)]
    return True


def continuous_slack(A: Matrix, P: Matrix, decay: Fraction, remainder: Fraction) -> Matrix:
    """Return the left side of (1)."""
    PA = product(P, A)
    size, give = range(len(P)), 2 * remainder * _trace(P)
    return tuple(
        tuple(-(PA[j][i] + PA[i][j]) - 2 * decay * P[i][j] - give * (i == j) for j in size)
        for i in size
    )


def sampled_slack(
    A: Matrix, P: Matrix, decay: Fraction, remainder: Fraction, period: Fraction
) -> Matrix:
    """Return the left side of (2)."""
    APA = product(transpose(A), product(P, A))
    keep, give = 1 - 2 * decay * period, (1 + 1 / TAU) * remainder**2 * _trace(P)
    size = range(len(P))
    return tuple(
        tuple(keep * P[i][j] - (1 + TAU) * APA[i][j] - give * (i == j) for j in size) for i in size
    )


def failing(
    vertices: Sequence[Matrix],
    P: Matrix,
    *,
    decay: Fraction,
    remainder: Fraction,
    period: Fraction | None,
) -> list[int]:
    """Return the vertices at which (1), or (2) when there is a `period`, does not hold."""
    slacks = (
        continuous_slack(A, P, decay, remainder)
        if period is None
        else sampled_slack(A, P, decay, remainder, period)
        for A in vertices
    )
    return [n for n, slack in enumerate(slacks) if not is_positive_definite(slack)]


def product(a: Matrix, b: Matrix) -> Matrix:
    """Return the matrix a b."""
    columns = transpose(b)
    return tuple(tuple(_dot(row, column) for column in columns) for row in a)


def transpose(a: Matrix) -> Matrix:
    """Return a'."""
    return tuple(zip(*a, strict=True))


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def _trace(a: Matrix) -> Fraction:
    return sum((a[i][i] for i in range(len(a))), Fraction(0))
