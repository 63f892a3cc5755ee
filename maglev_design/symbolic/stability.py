"""Closed-loop polynomials, continuous and sampled, and the Routh-Hurwitz conditions (App. A).

The controller believes (C_U^, C_Y^); at the gap where the ball is, the plant has (C_U', C_Y').
Only rho = C_U'/C_U^ and C_Y' enter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, reduce
from operator import add
from typing import Any, Literal

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.options import Method
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.gpi import (
    gain_symbols,
    match_coefficients,
    pole_pairs_polynomial,
)
from maglev_design.symbolic.laws import (
    ControlLaw,
    tan_gpi,
)
from maglev_design.symbolic.sampling import discretise

first_part = Symbol("T_1", nonnegative=True)
"""[s] Part of a period for which the voltage of an earlier sample still acts."""


HATS = {
    p.C_U: p.C_U_hat,
    p.C_Y: p.C_Y_hat,
    p.delta: p.delta_hat,
    p.tau: p.tau_hat,
    p.kappa: p.kappa_hat,
}
"""The coefficients of the tangent plant, and those that a controller believes."""


def believed(expression: Expr) -> Expr:
    """Return `expression` with what the controller believes: C_U^ for C_U and so on."""
    return expression.subs(HATS)


def closed_loop_polynomial(law: ControlLaw | None = None) -> tuple[Expr, ...]:
    """Return the coefficients (highest first) of the continuous loop's polynomial in s.

    The plant e'' = C_Y' e - C_U' (u - u*) with w = H(s) e, H the core of the law, and u - u* equal
    to w times the law's slope:

        den(H) (s^2 - C_Y') + rho L num(H) = 0,

    L the loop gain that the law reckons with (C_U^ for all but FEE-GPI, where it is 1). In rho,
    C_Y', C_Y^ and the gains; C_U^ cancels.
    """
    law = law or tan_gpi()
    numerator, denominator = _monic(believed(law.transfer(p.s)), p.s)
    gain = p.rho * believed(law.loop_gain)
    characteristic = sp.expand(denominator * (p.s**2 - p.C_Y_true) + gain * numerator)
    return tuple(sp.factor(c) for c in sp.Poly(characteristic, p.s).all_coeffs())


def routh_hurwitz(coefficients: Sequence[Expr]) -> tuple[Expr, ...]:
    """Return expressions that are all positive iff the polynomial has all roots left of 0.

    The first column of the Routh array without fractions: each row is the array's row times the
    Hurwitz determinant above it, so every entry is a polynomial in the coefficients and the
    divisions that occur are exact.

    Parameters
    ----------
    coefficients : sequence of Expr
        a_n, ..., a_0, highest power first; a_n is taken to be positive.

    Returns
    -------
    tuple of Expr
        n conditions: a_{n-1} and the Hurwitz determinants of order 2 to n.

    Examples
    --------
    >>> a, b, c = sp.symbols("a b c")
    >>> routh_hurwitz([sp.Integer(1), a, b, c])
    (a, a*b - c, c*(a*b - c))
    """
    upper = [sp.sympify(c) for c in coefficients[0::2]]
    lower = [sp.sympify(c) for c in coefficients[1::2]]
    conditions, divisors = [lower[0]], [sp.Integer(1), sp.Integer(1)]
    for _ in range(len(coefficients) - 2):
        if conditions[-1].is_zero:  # not stable, and the rows below would divide by it
            conditions.append(sp.Integer(0))
            continue
        padded = [*lower, *([sp.Integer(0)] * (len(upper) - len(lower)))]
        following = [
            sp.cancel((lower[0] * upper[j + 1] - upper[0] * padded[j + 1]) / divisors[-2])
            for j in range(len(upper) - 1)
        ]
        divisors.append(lower[0])
        upper, lower = lower, following
        conditions.append(lower[0])
    return tuple(sp.factor(condition) for condition in conditions)


def routh_array(
    coefficients: Sequence[Expr], *, simple: bool = True
) -> tuple[tuple[Expr, ...], ...]:
    """Return the rows of the Routh array, that of s^n first, as textbooks print it.

    The roots lie left of 0 iff the first column has one sign; each change is a root on the right.

    Parameters
    ----------
    coefficients : sequence of Expr
        a_n, ..., a_0, highest power first.
    simple : bool
        Whether entries are brought to one fraction; as they stand they are shorter to compute.

    Examples
    --------
    >>> a, b, c = sp.symbols("a b c")
    >>> routh_array([sp.Integer(1), a, b, c])
    ((1, b), (a, c), ((a*b - c)/a,), (c,))
    """
    upper, lower = tuple(coefficients[0::2]), tuple(coefficients[1::2])
    rows = [upper, lower]
    for _ in range(len(coefficients) - 2):
        padded = (*lower, *([sp.Integer(0)] * (len(upper) - len(lower))))
        following = tuple(
            (lower[0] * upper[j + 1] - upper[0] * padded[j + 1]) / lower[0]
            for j in range(len(upper) - 1)
        )
        if simple:
            following = tuple(sp.cancel(entry) for entry in following)
        upper, lower = lower, following
        rows.append(following)
    return tuple(rows)


def hurwitz_shares(law: ControlLaw) -> tuple[Expr, ...]:
    """Return the conditions of the continuous loop over their sizes as designed.

    Designed is rho = 1 and the C_Y' that the law reckons with. The sign stays: a PID whose filter
    is too slow is unstable as designed, with a share of -1.
    """
    designed = {p.rho: 1, p.C_Y_true: believed(law.C_Y)}
    conditions = routh_hurwitz(closed_loop_polynomial(law))
    return tuple(condition / sp.Abs(condition.subs(designed)) for condition in conditions)


@cache
def stability_condition() -> Expr:
    """Return rho (omega_n^2 + C_Y^) - C_Y' - omega_n^2/(4 zeta^2 + 1) for the gains (25).

    The loop is stable iff it is positive: with the gains (25) the Hurwitz determinants are
    D1 = k3, D2 = rho (k3 k2 - k1), D3 = D1 D2 times this condition and D4 = rho k0 D3, each proved
    in the derivation (equation A7-general).
    """
    pair = (p.zeta, p.omega_n)
    gains = match_coefficients(pole_pairs_polynomial([pair, pair]), 4)
    designed = dict(zip(gain_symbols(4), gains, strict=True))
    determinant = routh_hurwitz([c.subs(designed) for c in closed_loop_polynomial()])[2]
    factors = sp.factor_list(sp.factor(determinant))[1]
    (condition,) = [factor for factor, _ in factors if factor.has(p.C_Y_true)]
    terms = sp.Poly(condition, p.rho, p.C_Y_true).terms()
    scale = -sp.Poly(condition, p.C_Y_true).coeff_monomial(p.C_Y_true)
    return sp.Add(
        *[
            sp.apart(sp.cancel(c / scale), p.omega_n) * p.rho**m * p.C_Y_true**n
            for (m, n), c in terms
        ]
    )


@dataclass(frozen=True)
class PulseTransfer:
    """A rational function of z, numerator and denominator coefficients highest power first."""

    numerator: tuple[Expr, ...]
    denominator: tuple[Expr, ...]


def sampled_plant(output: Literal["gap", "velocity"] = "gap") -> PulseTransfer:
    """Return the linearised plant seen through zero-order hold and a delay of T_1 <= T.

    From the voltage u_k computed at t_k = k T, applied from t_k + T_1 on, to y(t_k) or y'(t_k);
    exact:

        A = exp(F T),  x_{k+1} = A x_k + B_0 u_k + B_1 u_{k-1},

    F = [[0, 1], [C_Y', 0]]. Divided by -C_U'; whole periods of delay are further factors 1/z.
    The hyperbolic differences are written as products, exact for short periods, too.
    """
    a = sp.sqrt(p.C_Y_true)
    held = p.T - first_part

    def lifted(x: Expr) -> Expr:  # cosh(x) - 1 without cancellation
        return 2 * sp.sinh(x / 2) ** 2

    fresh = Matrix([lifted(a * held) / a**2, sp.sinh(a * held) / a])
    middle = a * (p.T - first_part / 2)
    half = sp.sinh(a * first_part / 2)
    stale = Matrix([2 * sp.sinh(middle) * half / a**2, 2 * sp.cosh(middle) * half / a])
    cosh, sinh = 1 + lifted(a * p.T), sp.sinh(a * p.T)
    # the row of adj(zI - A) that belongs to the output, (z - cosh) in its own place and `cross`
    # in the other, applied to (B_0 z + B_1)
    own, other, cross = (0, 1, sinh / a) if output == "gap" else (1, 0, a * sinh)
    numerator = (
        fresh[own],
        fresh[other] * cross - cosh * fresh[own] + stale[own],
        stale[other] * cross - cosh * stale[own],
    )
    return PulseTransfer(numerator, (sp.Integer(1), -2 * cosh, sp.Integer(1), sp.Integer(0)))


@dataclass(frozen=True)
class SampledLaw:
    """The core of a sampled law over one denominator, coefficients highest power first.

    Attributes
    ----------
    gap, velocity : tuple of Expr
        Numerators from the gap and from the measured velocity to w; of one length.
    denominator : tuple of Expr
        Monic, as long.
    """

    gap: tuple[Expr, ...]
    velocity: tuple[Expr, ...]
    denominator: tuple[Expr, ...]


def sampled_law(law: ControlLaw, method: Method) -> SampledLaw:
    """Return the law's core as pulse transfer functions from the gap and the velocity to w."""
    core = discretise(law.core, method)
    pencil = (p.z * sp.eye(len(law.states)) - core.A).applyfunc(believed)
    denominator = sp.Poly(sp.expand(pencil.det()), p.z)
    numerators = []
    for signal in (p.y, p.v):
        seen = sum(
            h * sp.diff(r, signal) for h, r in zip(core.transfers(p.z), law.inputs, strict=True)
        )
        over = sp.cancel(sp.together(believed(sp.sympify(seen)) * denominator.as_expr()))
        polynomial = sp.Poly(over, p.z)
        powers = range(denominator.degree(), -1, -1)
        numerators.append(tuple(sp.factor(polynomial.coeff_monomial(p.z**n)) for n in powers))
    gap, velocity = numerators
    return SampledLaw(gap, velocity, tuple(sp.factor(c) for c in denominator.all_coeffs()))


@dataclass(frozen=True)
class SampledLoop:
    """The sampled law behind the sampled plant, coefficients highest power first.

    With N and D, S = D/(D + N); whole periods of delay are further powers of z in D.

    Attributes
    ----------
    numerator, denominator : tuple of Expr
        N and D of -P H.
    effort : tuple of Expr
        E of the voltage that sensor noise makes, E/(D + N), less the law's slope.
    """

    numerator: tuple[Expr, ...]
    denominator: tuple[Expr, ...]
    effort: tuple[Expr, ...]


def sampled_loop(law: ControlLaw, method: Method, gain: Expr) -> SampledLoop:
    """Return the sampled loop, `gain` being C_U' times the law's slope."""
    core = sampled_law(law, method)
    gap, velocity = sampled_plant("gap"), sampled_plant("velocity")
    through = zip(
        product(gap.numerator, core.gap), product(velocity.numerator, core.velocity), strict=True
    )
    return SampledLoop(
        tuple(gain * (a + b) for a, b in through),
        product(gap.denominator, core.denominator),
        product(gap.denominator, core.gap),
    )


def product(first: Sequence[Any], second: Sequence[Any]) -> tuple[Any, ...]:
    """Return the coefficients of the product of two polynomials, their factors left as they are."""
    return tuple(
        reduce(add, (x * second[n - i] for i, x in enumerate(first) if 0 <= n - i < len(second)))
        for n in range(len(first) + len(second) - 1)
    )


def _monic(transfer: Expr, variable: Symbol) -> tuple[Expr, Expr]:
    """Return numerator and denominator with the denominator's leading coefficient one."""
    numerator, denominator = sp.fraction(sp.together(transfer))
    leading = sp.Poly(sp.expand(denominator), variable).LC()
    return sp.expand(sp.cancel(numerator / leading)), sp.expand(sp.cancel(denominator / leading))
