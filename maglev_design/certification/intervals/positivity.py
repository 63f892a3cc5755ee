"""Whether a polynomial in two variables with enclosed coefficients is positive on a rectangle.

Bernstein coefficients bound a polynomial on its rectangle; de Casteljau's averages give those of
the halves. They are computed in double precision for many rectangles at once, with a bound of all
rounding: every average is of numbers no larger than the first largest one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from math import comb

import numpy as np
from flint import arb
from numpy.typing import NDArray

UNIT = 2.0**-53
"""Relative rounding of a double."""
DEEPEST = 40
"""Halvings of each side, after which it stays open."""
MOST_BOXES = 20_000
"""Rectangles looked at together, beyond which it stays open."""

Array = NDArray[np.float64]


def positive(coefficients: Sequence[Sequence[tuple[float, float]]]) -> bool:
    """Whether sum c_jk s^j t^k > 0 for all s and t in [-1, 1]; False also where it is open.

    Parameters
    ----------
    coefficients : sequence of sequence of (float, float)
        Middle and radius of the enclosure of c_jk, j and k rising.

    Examples
    --------
    >>> positive([[(2.0, 0.1), (1.0, 0.1)]]), positive([[(1.0, 0.0), (1.0, 0.1)]])
    (True, False)
    """
    table = np.array(coefficients, dtype=float)
    middle, radius = table[..., 0], table[..., 1]
    if not np.isfinite(table).all():
        return False
    rows, columns = middle.shape
    left, right = (_to_bernstein(n - 1) for n in (rows, columns))
    boxes = (left @ middle @ right.T)[None]
    # |s^j t^k| <= 1, and so are the entries of `left` and `right` (blossoms of powers at +-1)
    size = float(np.abs(middle).sum()) * (1 + (rows + columns) * UNIT)
    steps = (rows + columns) * (2 * DEEPEST + 8)
    slack = (float(radius.sum()) + steps * UNIT * size) * (1 + (rows * columns + 8) * UNIT)
    for _ in range(DEEPEST):
        if (boxes[:, [0, 0, -1, -1], [0, -1, 0, -1]] <= slack).any():
            return False
        boxes = boxes[boxes.min(axis=(1, 2)) <= slack]
        if not len(boxes):
            return True
        if len(boxes) > MOST_BOXES:
            return False
        boxes = np.concatenate(_halves(boxes))
        boxes = np.concatenate(_halves(boxes.transpose(0, 2, 1))).transpose(0, 2, 1)
    return False


def _to_bernstein(degree: int) -> Array:
    """Return what takes powers on [-1, 1] to Bernstein coefficients, shape (n + 1, n + 1)."""
    # t = 2 x - 1: t^k = sum_i C(k, i) 2^i (-1)^(k - i) x^i, and x^i has C(j, i)/C(n, i)
    return np.array(
        [
            [
                float(
                    sum(
                        Fraction(comb(k, i) * 2**i * (-1) ** (k - i) * comb(j, i), comb(degree, i))
                        for i in range(k + 1)
                    )
                )
                for k in range(degree + 1)
            ]
            for j in range(degree + 1)
        ]
    )


def _halves(boxes: Array) -> tuple[Array, Array]:
    """Return the Bernstein coefficients on both halves of the first variable."""
    level, first, second = boxes, [boxes[:, 0]], [boxes[:, -1]]
    while level.shape[1] > 1:
        level = (level[:, :-1] + level[:, 1:]) / 2
        first.append(level[:, 0])
        second.append(level[:, -1])
    return np.stack(first, axis=1), np.stack(second[::-1], axis=1)


def middle_and_radius(enclosed: arb) -> tuple[float, float]:
    """Return doubles that enclose an interval."""
    middle = float(enclosed)
    return middle, math.nextafter(float((enclosed - middle).abs_upper()), math.inf)
