"""The rest-to-rest Bezier reference (27)-(29), for any order.

A Bezier polynomial of order N whose first p control values are 0 and the others 1,

    phi(tau) = sum_{j=p}^{N} binom(N, j) tau^j (1 - tau)^(N - j),

leaves 0 like tau^p and reaches 1 like (1 - tau)^(N + 1 - p): p - 1 derivatives vanish at the
start and N - p at the end. The paper's is N = 16, p = 8.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

from maglev_design.symbolic import plant as p

tau = Symbol("tau", real=True)
"""Normalised time (t - t_i)/(t_f - t_i)."""
start_gap = Symbol("start_gap", positive=True)
end_gap = Symbol("end_gap", positive=True)
start_time = Symbol("start_time", nonnegative=True)
end_time = Symbol("end_time", positive=True)

PAPER_ORDER = 16


@dataclass(frozen=True)
class BezierStep:
    """phi(tau) from 0 to 1 and its first two derivatives, free of cancellation on [0, 1].

    Attributes
    ----------
    order, leading : int
        N and p.
    value, slope, curvature : Expr
        phi, phi', phi'' in tau, each a sum or product of terms of one sign where possible.
    """

    order: int
    leading: int
    value: Expr
    slope: Expr
    curvature: Expr


def bezier_step(order: int = PAPER_ORDER, leading: int | None = None) -> BezierStep:
    """Return the step of `order` N whose first `leading` control values are 0 (default N // 2).

    Raises
    ------
    ValueError
        Unless 3 <= leading and leading + 2 <= order, without which y*'' jumps at an end.

    Examples
    --------
    >>> step = bezier_step(5, 3)
    >>> sp.expand(step.value)
    6*tau**5 - 15*tau**4 + 10*tau**3
    """
    first = order // 2 if leading is None else leading
    if not (first >= 3 and first + 2 <= order):
        raise ValueError(
            f"order {order} with {first} leading zeros: y*'' is continuous only for at least 3 "
            "leading zeros and an order larger by 2"
        )
    value = sp.Add(
        *[
            sp.binomial(order, j) * tau**j * (1 - tau) ** (order - j)
            for j in range(first, order + 1)
        ]
    )
    rise, fall = first - 1, order - first
    scale = order * sp.binomial(order - 1, rise)
    slope = scale * tau**rise * (1 - tau) ** fall
    curvature = (
        scale * tau ** (rise - 1) * (1 - tau) ** (fall - 1) * (rise * (1 - tau) - fall * tau)
    )
    return BezierStep(order, first, value, slope, curvature)


def printed_coefficients(step: BezierStep) -> list[int]:
    """Return r_1, r_2, ... of (28)-(29): phi = tau^p (r_1 - r_2 tau + r_3 tau^2 - ...)."""
    series = sp.Poly(sp.expand(step.value), tau)
    return [
        int((-1) ** (j - step.leading) * series.coeff_monomial(tau**j))
        for j in range(step.leading, step.order + 1)
    ]


def flatness_at_ends(step: BezierStep) -> tuple[int, int]:
    """Return how many derivatives of phi vanish at tau = 0 and at tau = 1.

    Examples
    --------
    >>> flatness_at_ends(bezier_step())
    (7, 8)
    """
    counts = []
    for end in (0, 1):
        derivative, count = sp.Poly(sp.expand(step.value), tau).diff(tau), 0
        while derivative.eval(end) == 0:
            derivative, count = derivative.diff(tau), count + 1
        counts.append(count)
    return counts[0], counts[1]


def rest_to_rest(step: BezierStep, derivatives: int = 2) -> tuple[Expr, ...]:
    """Return y*(t) and its first derivatives, two by default [m, m/s, m/s^2], eq. (27).

    Expressions in t, start_gap, end_gap, start_time and end_time, constant outside the move.
    """
    duration = end_time - start_time
    travel = end_gap - start_gap
    inside = {tau: sp.Min(sp.Max((p.t - start_time) / duration, 0), 1)}
    gap = start_gap + travel * step.value.subs(inside)
    velocity = travel / duration * step.slope.subs(inside)
    acceleration = travel / duration**2 * step.curvature.subs(inside)
    known = (gap, velocity, acceleration)
    if derivatives == 2:
        return known
    jerk = travel / duration**3 * sp.factor(sp.diff(step.curvature, tau)).subs(inside)
    return (*known, jerk)


def peak_acceleration(step: BezierStep) -> Expr:
    """Return the largest |y*''| of the move [m/s^2], |end_gap - start_gap| max |phi''|/duration^2.

    Examples
    --------
    >>> step = bezier_step(5, 3)
    >>> sp.simplify(peak_acceleration(step) / peak_acceleration(step).subs(end_time, 1))
    (start_time - 1)**2/(end_time - start_time)**2
    """
    turning = sp.Poly(sp.diff(step.curvature, tau), tau).real_roots(multiple=True)
    inside = {root for root in turning if 0 <= root <= 1}
    largest = max((sp.Abs(step.curvature.subs(tau, root)) for root in inside), key=sp.N)
    travel = end_gap - start_gap
    scale = sp.Rational(str(sp.N(largest, 30)))
    return sp.Max(travel, -travel) * scale / (end_time - start_time) ** 2
