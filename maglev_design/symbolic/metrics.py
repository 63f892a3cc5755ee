"""ISE, IAE and ITAE of the true error over one integration step.

Between two instants the error is replaced by the cubic that shares its values and slopes at both
ends (Hermite). The cubic's integrals are exact, |.| included: where the error changes sign the
root splits the step. The interpolation leaves at most h^5/720 max|e''''| a step in IAE.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

e_start, e_end = Symbol("e_start", real=True), Symbol("e_end", real=True)
slope_start, slope_end = Symbol("slope_start", real=True), Symbol("slope_end", real=True)
t_start, h = Symbol("t_start", real=True), Symbol("h", positive=True)

_TINY = sp.Rational(1, 10**60)
"""Keeps 0/0 out where there is no root; far below the square of any error in metres."""


@dataclass(frozen=True)
class Increments:
    """What one step of length h from t_start adds to the metrics.

    Attributes
    ----------
    definitions : mapping of Symbol to Expr
        Intermediate values, in order: the root of the cubic and the primitives there.
    ise : Expr
        int e^2 dt [m^2 s].
    iae : Expr
        int |e| dt [m s].
    itae : Expr
        int t |e| dt [m s^2].
    """

    definitions: Mapping[Symbol, Expr]
    ise: Expr
    iae: Expr
    itae: Expr


CUBIC = tuple(sp.symbols("c_1:4", real=True))
"""The cubic through both ends is e_start + c_1 sigma + c_2 sigma^2 + c_3 sigma^3."""
_middle, _change = Symbol("e_middle", real=True), Symbol("e_change", real=True)
_total, _tilt = Symbol("slope_total", real=True), Symbol("slope_tilt", real=True)


def hermite(sigma: Expr) -> Expr:
    """Return the cubic through both ends at sigma = (t - t_start)/h in [0, 1]."""
    return _cubic(sigma).subs(_coefficients()).subs(_ends())


def _ends() -> dict[Symbol, Expr]:
    """Return the sums and differences of both ends that everything is made of."""
    return {
        _middle: (e_start + e_end) / 2,
        _change: e_end - e_start,
        _total: h * (slope_start + slope_end),
        _tilt: h * (slope_end - slope_start),
    }


def _coefficients() -> dict[Symbol, Expr]:
    first = h * slope_start
    return dict(
        zip(CUBIC, (first, 3 * _change - _total - first, _total - 2 * _change), strict=True)
    )


def _cubic(sigma: Expr, *weights: Expr) -> Expr:
    """Return the cubic in Horner's form, its four coefficients times `weights`."""
    first, *rest = weights or (sp.Integer(1),) * 4
    value = sp.Integer(0)
    for c, weight in zip(reversed(CUBIC), reversed(rest), strict=True):
        value = sigma * (weight * c + value)
    return first * e_start + value


def increments(*, crossing: bool = True) -> Increments:
    """Return the increments of one step in e_start, e_end, slope_start, slope_end, t_start, h.

    In shifted Legendre polynomials the cubic is sum_i q_i P_i(2 sigma - 1), and

        int e^2 dt = h sum_i q_i^2/(2 i + 1),  int e dt = h q_0,
        int t e dt = t_start int e dt + h^2 (q_0/2 + q_1/6).

    Without `crossing` for a step at whose ends the error has one sign: the same values there, and
    no root to look for.
    """
    definitions = _ends()
    modes = []
    for n, mode in enumerate(_modes()):
        modes.append(Symbol(f"q_{n}", real=True))
        definitions[modes[n]] = mode
    square = h * sp.Add(*[q**2 / (2 * n + 1) for n, q in enumerate(modes)])
    area_whole, moment_whole = Symbol("area_whole", real=True), Symbol("moment_whole", real=True)
    definitions[area_whole] = h * modes[0]
    definitions[moment_whole] = t_start * area_whole + h**2 * (modes[0] / 2 + modes[1] / 6)
    if not crossing:
        return Increments(definitions, square, sp.Abs(area_whole), sp.Abs(moment_whole))
    definitions |= _coefficients()
    split = _sign_change(definitions)
    area, moment = Symbol("area_first", real=True), Symbol("moment_first", real=True)
    below, lever = (  # int_0^split of the cubic, and of sigma times the cubic
        split ** (n + 1) * _cubic(split, *(sp.Rational(1, k + n + 1) for k in range(4)))
        for n in (0, 1)
    )
    definitions[area] = sp.Piecewise((area_whole, split >= 1), (h * below, True))
    definitions[moment] = sp.Piecewise(
        (moment_whole, split >= 1), (t_start * area + h**2 * lever, True)
    )
    return Increments(
        definitions,
        square,
        sp.Abs(area) + sp.Abs(area_whole - area),
        sp.Abs(moment) + sp.Abs(moment_whole - moment),
    )


def _modes() -> list[Expr]:
    """Return the cubic's coefficients q_0 to q_3 in shifted Legendre polynomials."""
    x = Symbol("sigma", real=True)
    cubic = hermite(x)
    back = {
        e_start: _middle - _change / 2,
        e_end: _middle + _change / 2,
        slope_start: (_total - _tilt) / (2 * h),
        slope_end: (_total + _tilt) / (2 * h),
    }
    projections = (
        (2 * n + 1) * sp.integrate(sp.expand(cubic * sp.legendre(n, 2 * x - 1)), (x, 0, 1))
        for n in range(4)
    )
    return [sp.expand(projection.subs(back)) for projection in projections]


def _sign_change(definitions: dict[Symbol, Expr]) -> Symbol:
    """Define the root of the cubic where the ends differ in sign, 1 where they do not."""
    x = Symbol("sigma", real=True)
    slope = sp.horner(sp.diff(_cubic(x), x), wrt=x)
    root = Symbol("root_0", real=True)
    definitions[root] = -e_start * _change / (_change**2 + _TINY)
    for n in (1, 2):
        rise = Symbol(f"rise_{n}", real=True)
        definitions[rise] = slope.subs(x, root)
        newton = root - _cubic(root) * rise / (rise**2 + _TINY)
        root = Symbol(f"root_{n}", real=True)
        definitions[root] = sp.Min(sp.Max(newton, 0), 1)
    split = Symbol("split", real=True)
    definitions[split] = sp.Piecewise((root, e_start * e_end < 0), (sp.Integer(1), True))
    return split
