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


def hermite(sigma: Expr) -> Expr:
    """Return the cubic through both ends at sigma = (t - t_start)/h in [0, 1]."""
    change = e_end - e_start
    quadratic = 3 * change - h * (2 * slope_start + slope_end)
    cubic = h * (slope_start + slope_end) - 2 * change
    return e_start + sigma * (h * slope_start + sigma * (quadratic + sigma * cubic))


def increments(*, crossing: bool = True) -> Increments:
    """Return the increments of one step in e_start, e_end, slope_start, slope_end, t_start, h.

    In shifted Legendre polynomials the cubic is sum_i q_i P_i(2 sigma - 1), and

        int e^2 dt = h sum_i q_i^2/(2 i + 1),  int e dt = h q_0,
        int t e dt = h (t_start q_0 + h (q_0 + q_1/3)/2).

    Without `crossing` for a step at whose ends the error has one sign: the same values there, and
    no root to look for.
    """
    x = Symbol("sigma", real=True)
    cubic = hermite(x)
    definitions: dict[Symbol, Expr] = {}
    modes = []
    for n in range(4):
        base = sp.legendre(n, 2 * x - 1)
        mode = (2 * n + 1) * sp.integrate(sp.expand(cubic * base), (x, 0, 1))
        modes.append(Symbol(f"q_{n}", real=True))
        definitions[modes[n]] = _grouped(mode)
    square = h * sp.Add(*[q**2 / (2 * n + 1) for n, q in enumerate(modes)])
    area_whole, moment_whole = Symbol("area_whole", real=True), Symbol("moment_whole", real=True)
    definitions[area_whole] = h * modes[0]
    definitions[moment_whole] = h * (t_start * modes[0] + h * (modes[0] / 2 + modes[1] / 6))
    if not crossing:
        return Increments(definitions, square, sp.Abs(area_whole), sp.Abs(moment_whole))
    split = _sign_change(x, definitions)
    area = sp.horner(sp.integrate(sp.expand(h * cubic), x), wrt=x)
    moment = sp.horner(sp.integrate(sp.expand(h * (t_start + h * x) * cubic), x), wrt=x)
    parts = []
    for name, primitive, whole in (("area", area, area_whole), ("moment", moment, moment_whole)):
        first = Symbol(f"{name}_first", real=True)
        one_sign = (whole, split >= 1)
        definitions[first] = sp.Piecewise(one_sign, (primitive.subs(x, split), True))
        parts.append(sp.Abs(first) + sp.Abs(whole - first))
    return Increments(definitions, square, *parts)


def _grouped(mode: Expr) -> Expr:
    """Return a combination of values and slopes with common factors of the slopes."""
    slopes = h * (mode.coeff(h * slope_start) * slope_start + mode.coeff(h * slope_end) * slope_end)
    return mode.coeff(e_start) * e_start + mode.coeff(e_end) * e_end + slopes


def _sign_change(x: Symbol, definitions: dict[Symbol, Expr]) -> Symbol:
    """Define the root of the cubic where the ends differ in sign, 1 where they do not."""
    slope = sp.diff(hermite(x), x)
    change = e_start - e_end
    root = Symbol("root_0", real=True)
    definitions[root] = e_start * change / (change**2 + _TINY)
    for n in (1, 2):
        rise = Symbol(f"rise_{n}", real=True)
        definitions[rise] = slope.subs(x, root)
        newton = root - hermite(root) * rise / (rise**2 + _TINY)
        root = Symbol(f"root_{n}", real=True)
        definitions[root] = sp.Min(sp.Max(newton, 0), 1)
    split = Symbol("split", real=True)
    definitions[split] = sp.Piecewise((root, e_start * e_end < 0), (sp.Integer(1), True))
    return split
