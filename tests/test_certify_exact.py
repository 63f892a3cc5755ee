from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from maglev_design.certification.lyapunov.exact import (
    TAU,
    Matrix,
    continuous_slack,
    failing,
    is_positive_definite,
    product,
    sampled_slack,
    transpose,
)

NONE = Fraction(0)
PERIOD = Fraction(1, 100)


def exact(matrix: Any) -> Matrix:
    return tuple(tuple(Fraction(x).limit_denominator(10**6) for x in row) for row in matrix)


def floats(matrix: Matrix) -> NDArray[np.float64]:
    return np.array(matrix, dtype=float)


def lyapunov(A: NDArray[np.float64], decay: float, *, sampled: bool = False) -> Matrix:
    """P of A'P + PA + 2 decay P = -I, or of A'PA - P = -I."""
    unit, n = np.eye(len(A)), len(A)
    shifted = A + decay * unit
    operator = (
        np.kron(A.T, A.T) - np.eye(n * n)
        if sampled
        else np.kron(shifted.T, unit) + np.kron(unit, shifted.T)
    )
    P = np.linalg.solve(operator, -unit.ravel()).reshape(n, n)
    return exact((P + P.T) / 2)


def test_positive_definite_agrees_with_the_eigenvalues_of_random_matrices() -> None:
    generator = np.random.default_rng(3)
    seen = set()
    for _ in range(300):
        raw = generator.integers(-5, 6, (4, 4))
        matrix = exact((raw + raw.T + 8 * np.eye(4)).tolist())
        smallest = float(np.linalg.eigvalsh(floats(matrix)).min())
        if abs(smallest) > 1e-9:
            assert is_positive_definite(matrix) == (smallest > 0)
            seen.add(smallest > 0)
    assert seen == {True, False}


def test_the_hilbert_matrix_is_positive_definite_where_floating_point_cannot_tell() -> None:
    hilbert = tuple(tuple(Fraction(1, i + j + 1) for j in range(14)) for i in range(14))
    assert is_positive_definite(hilbert)
    assert np.linalg.eigvalsh(floats(hilbert)).min() < 1e-16
    last = hilbert[13][13] - Fraction(1, 10**12)
    lowered = (*hilbert[:13], (*hilbert[13][:13], last))
    assert not is_positive_definite(lowered)


@pytest.mark.parametrize(
    "matrix",
    [[[0]], [[1, 1], [1, 1]], [[1, 2], [0, 5]], [[-1, 0], [0, -1]], [[0, 1], [1, 0]]],
    ids=["zero", "singular", "not symmetric", "negative", "zero pivot"],
)
def test_what_is_not_positive_definite_is_refused(matrix: Any) -> None:
    assert not is_positive_definite(exact(matrix))


def test_products_are_those_of_numpy() -> None:
    generator = np.random.default_rng(5)
    a, b = (exact(generator.integers(-9, 9, (3, 3)).tolist()) for _ in range(2))
    assert floats(product(a, b)) == pytest.approx(floats(a) @ floats(b))
    assert floats(transpose(a)) == pytest.approx(floats(a).T)


def test_the_slacks_are_the_inequalities_of_the_page() -> None:
    generator = np.random.default_rng(11)
    A, raw = (generator.normal(size=(3, 3)) for _ in range(2))
    a, p = exact(A), exact(raw + raw.T)
    A, P = floats(a), floats(p)
    decay, remainder = Fraction(3, 2), Fraction(1, 1000)
    trace, unit = np.trace(P), np.eye(3)
    continuous = -(A.T @ P + P @ A) - 2 * 1.5 * P - 2e-3 * trace * unit
    assert floats(continuous_slack(a, p, decay, remainder)) == pytest.approx(continuous)
    tau = float(TAU)
    sampled = (1 - 2 * 1.5 * 0.01) * P - (1 + tau) * A.T @ P @ A
    sampled -= (1 + 1 / tau) * 1e-6 * trace * unit
    assert floats(sampled_slack(a, p, decay, remainder, PERIOD)) == pytest.approx(sampled)


def test_a_vertex_without_the_decay_is_named() -> None:
    good = np.array([[-1.0, 2.0], [0.0, -3.0]])
    P = lyapunov(good, 0.5)
    vertices = [exact(good), exact(-good), exact(good)]
    assert failing(vertices, P, decay=Fraction(1, 2), remainder=NONE, period=None) == [1]
    assert failing(vertices[:1], P, decay=Fraction(2), remainder=NONE, period=None) == [0]


@pytest.mark.parametrize("sampled", [False, True])
def test_a_certified_remainder_covers_every_matrix_so_near(sampled: bool) -> None:
    """The largest remainder that passes, and 200 matrices at that distance: V falls for each."""
    generator = np.random.default_rng(13)
    A = np.array([[0.6, 0.3], [-0.2, 0.5]]) if sampled else np.array([[-1.0, 2.0], [0.0, -3.0]])
    p, period = lyapunov(A, 0.0, sampled=sampled), PERIOD if sampled else None
    radii = [Fraction(1, 2**n) for n in range(40)]
    radius = next(
        r for r in radii if not failing([exact(A)], p, decay=NONE, remainder=r, period=period)
    )
    assert radius < radii[0]
    P = floats(p)
    for _ in range(200):
        direction = generator.normal(size=(2, 2))
        near = A + float(radius) * direction / np.linalg.norm(direction)
        change = near.T @ P @ near - P if sampled else near.T @ P + P @ near
        assert np.linalg.eigvalsh(change).max() < 0
