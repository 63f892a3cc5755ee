"""A polytope of rational vertices around a family of loops, and why it contains the family.

A member is a gap y of [y_1, y_2] and a ratio beta_c/beta of [r_1, r_2]; an uncertain y0 makes of
it a few such rectangles
(:meth:`maglev_design.certification.lyapunov.family.CertificateClaim.boxes`). By
:mod:`maglev_design.symbolic.closed_loop` its state matrix depends on

    q = (Y + y0)/(y + y0), on the gap alone,  and  m = C_U'(Y)/C_U^, on the ratio alone.

**Ratio.** m^2 is rational and inverse to the ratio, so m falls between its values at r_1 and r_2.
An irrational square root is replaced by the nearest multiple of 2^-64 on the outer side. The
controller is fixed: both matrices are affine in m.

**Gap, continuous loop.** A is affine in (rho, C_Y', rho C_Y^) = (m q, C_Y'(Y) q, m C_Y^ q): affine
in q at fixed m and in m at fixed q. A function that is affine in each of two variables is, over a
rectangle, a convex combination of its values at the four corners,

    A(q, m) = (1-t)(1-s) A_11 + t(1-s) A_21 + (1-t)s A_12 + ts A_22.

Hence four vertices, and not those of the box of rho times C_Y': gap moves both along a ray.

**Gap, sampled loop.** At fixed m, A is affine in the functions f(q) of
:data:`maglev_design.symbolic.closed_loop.HOLD`. Each is a power series in q with coefficients
>= 0, made of E_n(x) = sum_k x^k/(2k + n)!, x = C_Y'(Y) T^2 q:

    cosh(sqrt x) - 1 = x E_2(x),  sinh(sqrt x)/sqrt x = E_1(x).

Cut after degree d, E_n lacks between 0 and x^(d+1)/(2d+2+n)!/(1 - x/((2d+3+n)(2d+4+n))), because
each further term is less than that ratio times the one before. What is left is a vector of
polynomials in t in [0, 1], q = q_1 + (q_2 - q_1) t, and in Bernstein's form

    f(q) = sum_i B_i(t) f_i,  B_i(t) = C(D, i) t^i (1 - t)^(D-i) >= 0,  sum_i B_i(t) = 1,

so that A(q, m) is a convex combination of A(f_i, m_j), j = 1, 2, but for the cut. The functions
are nearly straight at usual periods, and so is the chain of the f_i: the hull is thin, and cutting
the interval of q into cells would gain nothing.

The controller of the sampled loop is its difference equation, coefficient by coefficient.

**Remainder.** The cut and the rounding of the vertices to multiples of 2^-64 are bounded entry by
entry; the sum of the bounds is not less than the Frobenius norm of what the polytope misses.

All of it is in scaled states S x, S diagonal and part of the document.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

from maglev_design.certification.lyapunov.exact import Matrix
from maglev_design.certification.lyapunov.family import (
    CertificateClaim,
    ExactSubject,
    NotEnclosedError,
    Vector,
    check_family,
)
from maglev_design.certification.rationals import root
from maglev_design.lowering import Program, lower
from maglev_design.options import TAN_GPI, Method
from maglev_design.programs import derived, law
from maglev_design.symbolic import closed_loop as cl
from maglev_design.symbolic import plant as p

GRID = 2**64
UNIT = Fraction(1, GRID)
"""Vertices and irrational end points are multiples of it."""
CUT = Fraction(1, 2**50)
"""Largest share of itself by which a cut series may be too small."""
HIGHEST_DEGREE = 20
"""Beyond it the plant grows by more than e^7 within one period."""


@dataclass(frozen=True)
class Polytope:
    """Matrices of the scaled states whose hull, up to a remainder, contains every member's.

    Attributes
    ----------
    vertices : tuple of matrix
    remainder : Fraction
        Bound of the Frobenius norm of a member less the nearest point of the hull.
    """

    vertices: tuple[Matrix, ...]
    remainder: Fraction


def enclose(of: ExactSubject, over: CertificateClaim, scale: Sequence[Fraction]) -> Polytope:
    """Return the polytope of a claim in the states S x.

    Raises
    ------
    InputError
        When the family is empty or holds an impossible gap or ratio.
    NotEnclosedError
        When the period is too long or the delay is too many periods.
    """
    check_family(of, over, scale)
    members: list[Matrix] = []
    missed = Fraction(0)
    for gaps, ratios in over.boxes(of.gap + of.gap_offset):
        gains = _gain_ends(of, ratios)
        span = tuple(sorted(_point(of, gap).fall for gap in gaps))
        if over.loop == "continuous":
            members += [_continuous(of, q, gain) for q in span for gain in gains]
        else:
            inside, outside = _sampled(of, span, gains, scale)
            members, missed = members + inside, max(missed, outside)
    scaled = [_rounded(_scaled(member, scale)) for member in members]
    remainder = missed + Fraction(len(scale), 2 * GRID)
    return Polytope(tuple(dict.fromkeys(scaled)), Fraction(math.ceil(remainder * GRID**2), GRID**2))


def _rounded(matrix: Matrix) -> Matrix:
    return tuple(tuple(Fraction(round(x * GRID), GRID) for x in row) for row in matrix)


def _scaled(matrix: Matrix, scale: Sequence[Fraction]) -> Matrix:
    """Return S A S^-1."""
    return tuple(
        tuple(x * to / of for x, of in zip(row, scale, strict=True))
        for row, to in zip(matrix, scale, strict=True)
    )


# --- ratio and gap -------------------------------------------------------------------------------


@cache
def _design_gap_program() -> Program:
    at = cl.at_design_gap()
    outputs = {"gain_squared": at.gain_squared, "C_Y_true_Y": at.C_Y, "fall": at.fall}
    return lower((p.g, p.beta_c, p.y0, p.Y, p.C_U_hat, p.y, cl.ratio), outputs)


class _Point(NamedTuple):
    """m^2, C_Y'(Y) and q of one gap and ratio."""

    gain_squared: Fraction
    C_Y: Fraction
    fall: Fraction


def _point(of: ExactSubject, gap: Fraction | None = None, ratio: Fraction = Fraction(1)) -> _Point:
    """Return what a member's matrix is made of; the gap is Y by default."""
    numbers = (of.gravity, of.beta, of.gap_offset, of.gap, of.C_U_hat)
    return _Point(*_design_gap_program().exact(*numbers, of.gap if gap is None else gap, ratio))


def _gain_ends(of: ExactSubject, ratios: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction]:
    """Return m at both ends, outwards; m falls with the ratio."""
    weak, strong = (root(_point(of, ratio=ratio).gain_squared, UNIT) for ratio in ratios)
    return weak[1], strong[0]


# --- continuous loop -----------------------------------------------------------------------------


@cache
def _continuous_program() -> Program:
    inputs = (p.rho, p.C_Y_true, p.C_Y_hat, *law().gains)
    return lower(inputs, _entries(cl.continuous_matrix(law())))


def _continuous(of: ExactSubject, q: Fraction, gain: Fraction) -> Matrix:
    values = _continuous_program().exact(gain * q, _point(of).C_Y * q, of.C_Y_hat, *of.gains)
    return _matrix(values)


# --- sampled loop --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Series:
    """A polynomial in q, lowest power first, and by how much it may be wrong on the family."""

    coefficients: Vector
    error: Fraction

    def at(self, power: int) -> Fraction:
        """Return a coefficient, 0 beyond the last."""
        return self.coefficients[power] if power < len(self.coefficients) else Fraction(0)


@cache
def _sampled_program(method: Method, whole: int, partial: bool) -> Program:
    _, coefficients = derived.core(method, TAN_GPI)
    inputs = (*cl.HOLD, cl.m_gain, p.C_U_hat, *coefficients)
    return lower(inputs, _entries(cl.sampled_matrix(method, whole, partial=partial, law=law())))


def _sampled(
    of: ExactSubject, span: Sequence[Fraction], gains: Sequence[Fraction], scale: Sequence[Fraction]
) -> tuple[list[Matrix], Fraction]:
    """Return A at every control point and end of m, and the norm of what they miss."""
    program = _sampled_program(of.method, of.when.whole, of.when.part > 0)
    functions = hold_series(of, span[-1])
    degree = max(len(f.coefficients) for f in functions) - 1

    def member(values: Sequence[Fraction], gain: Fraction) -> Matrix:
        return _matrix(program.exact(*values, gain, of.C_U_hat, *of.coefficients))

    points = list(zip(*[control_points(f, span, degree) for f in functions], strict=True))
    members = [member(point, gain) for point in points for gain in gains]

    def norm_missed(gain: Fraction) -> Fraction:  # A is affine in the functions
        base, total = member(points[0], gain), Fraction(0)
        for n, function in enumerate(functions):
            moved = list(points[0])
            moved[n] += function.error
            change = _scaled(_difference(member(moved, gain), base), scale)
            total += sum((abs(x) for row in change for x in row), Fraction(0))
        return total

    return members, max(norm_missed(gain) for gain in gains)


def hold_series(of: ExactSubject, q_max: Fraction) -> list[Series]:
    """Return the series of :data:`maglev_design.symbolic.closed_loop.HOLD`, in its order."""
    period, held, rest = of.period, of.period - of.when.part, _point(of).C_Y
    degree = _degree(rest * period**2 * q_max)

    def entire(n: int, time: Fraction, factor: Fraction, power: int) -> Series:
        """Return factor q^power E_n(C_Y'(Y) time^2 q)."""
        step = rest * time**2
        terms = [factor * step**k / math.factorial(2 * k + n) for k in range(degree + 1)]
        cut = factor * q_max**power * _cut(n, step * q_max, degree)
        return Series((*[Fraction(0)] * power, *terms), cut)

    gap, fresh = (entire(2, time, time**2, 1) for time in (period, held))
    speed, fresh_speed = (entire(1, time, time, 1) for time in (period, held))
    return [
        entire(2, period, rest * period**2, 1),
        entire(1, period, period, 0),
        entire(1, period, rest * period, 1),
        fresh,
        fresh_speed,
        _minus(gap, fresh),
        _minus(speed, fresh_speed),
    ]


def _cut(n: int, x: Fraction, degree: int) -> Fraction:
    """Return a bound of what E_n lacks between 0 and x after `degree`, infinite terms included."""
    ratio = x / ((2 * degree + 3 + n) * (2 * degree + 4 + n))
    return x ** (degree + 1) / math.factorial(2 * degree + 2 + n) / (1 - ratio)


def _degree(x: Fraction) -> int:
    """Return the least degree after which E_1 and E_2 up to `x` are cut by at most CUT."""
    for degree in range(1, HIGHEST_DEGREE + 1):
        if x < (2 * degree + 4) * (2 * degree + 5) and _cut(1, x, degree) <= CUT:
            return degree
    raise NotEnclosedError(
        "period: the ball falls by more than e^7 within one period at the smallest gap; sample "
        "faster or take larger gaps"
    )


def _minus(a: Series, b: Series) -> Series:
    size = range(len(a.coefficients))
    return Series(tuple(a.at(k) - b.at(k) for k in size), a.error + b.error)


def control_points(series: Series, span: Sequence[Fraction], degree: int) -> list[Fraction]:
    """Return the coefficients f_i in Bernstein's form of a degree over the span of q.

    With q = q_1 + (q_2 - q_1) t and sum_k c_k q^k = sum_j d_j t^j,
    f_i = sum_{j <= i} C(i, j)/C(D, j) d_j, D the degree.
    """
    low, width = span[0], span[-1] - span[0]
    powers = range(degree + 1)

    def shifted(j: int) -> Fraction:
        terms = (math.comb(k, j) * series.at(k) * low ** (k - j) for k in powers if k >= j)
        return width**j * sum(terms, Fraction(0))

    d = [shifted(j) / math.comb(degree, j) for j in powers]
    return [sum((math.comb(i, j) * d[j] for j in range(i + 1)), Fraction(0)) for i in powers]


# --- matrices ------------------------------------------------------------------------------------


def _entries(matrix: Any) -> dict[str, Any]:
    rows, columns = matrix.shape
    return {f"A_{i}_{j}": matrix[i, j] for i in range(rows) for j in range(columns)}


def _matrix(values: Sequence[Fraction]) -> Matrix:
    size = math.isqrt(len(values))
    return tuple(tuple(values[i * size : (i + 1) * size]) for i in range(size))


def _difference(a: Matrix, b: Matrix) -> Matrix:
    return tuple(tuple(x - y for x, y in zip(r, s, strict=True)) for r, s in zip(a, b, strict=True))
