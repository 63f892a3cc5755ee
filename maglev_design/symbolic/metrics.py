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


def increments() -> Increments:
    """Return the increments of one step in e_start, e_end, slope_start, slope_end, t_start, h."""
    x = Symbol("sigma", real=True)
    cubic = hermite(x)
    slope = sp.diff(cubic, x)
    area = sp.horner(sp.integrate(sp.expand(h * cubic), x), wrt=x)
    moment = sp.horner(sp.integrate(sp.expand(h * (t_start + h * x) * cubic), x), wrt=x)

    change = e_start - e_end
    root = Symbol("root_0", real=True)
    definitions: dict[Symbol, Expr] = {root: e_start * change / (change**2 + _TINY)}
    for n in (1, 2):
        rise = Symbol(f"rise_{n}", real=True)
        definitions[rise] = slope.subs(x, root)
        newton = root - hermite(root) * rise / (rise**2 + _TINY)
        root = Symbol(f"root_{n}", real=True)
        definitions[root] = sp.Min(sp.Max(newton, 0), 1)
    split = Symbol("split", real=True)
    definitions[split] = sp.Piecewise((root, e_start * e_end < 0), (sp.Integer(1), True))

    def absolute(name: str, primitive: Expr) -> Expr:
        first, whole = Symbol(f"{name}_first", real=True), Symbol(f"{name}_whole", real=True)
        definitions[first] = primitive.subs(x, split)
        definitions[whole] = primitive.subs(x, 1)
        return sp.Abs(first) + sp.Abs(whole - first)

    square = sp.integrate(sp.expand(cubic**2), (x, 0, 1))
    iae, itae = absolute("area", area), absolute("moment", moment)
    return Increments(definitions, ise=h * sp.expand(square), iae=iae, itae=itae)
