"""What the derivation is written in: the record of one equation and the notation it adds.

The letters of the plant and of the laws are in :mod:`maglev_design.symbolic.plant`. Integrals,
derivatives of the error and transforms stand here as letters of their own, so that an equation
prints as the paper has it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as ref
from maglev_design.symbolic.gpi import (
    gain_symbols,
)
from maglev_design.symbolic.stability import first_part

Relation = Literal["=", ">", "~"]


@dataclass(frozen=True)
class Line:
    """One line of an equation: ``lhs relation rhs``; "~" is equality to first order.

    Attributes
    ----------
    lhs, rhs : Expr or Matrix
        Both sides, in the letters of :data:`NOTATION`.
    relation : {"=", ">", "~"}
    """

    lhs: Expr
    rhs: Expr
    relation: Relation = "="


@dataclass(frozen=True)
class Equation:
    """One numbered step of the derivation with its proof.

    Attributes
    ----------
    id : str
        The paper's number, with a suffix where a step adds to it ("20-bounded").
    section : str
        Heading it belongs under.
    title : str
        What it is.
    lines : tuple of Line
        The statement; one or more lines.
    reason : str
        Why it holds and how it is derived; what of the printed form was corrected.
    checks : tuple of Expr or None
        Statement minus derived expression, simplified, one entry for each thing checked; None
        for a postulate or a definition, where there is nothing to prove.
    """

    id: str
    section: str
    title: str
    lines: tuple[Line, ...]
    reason: str
    checks: tuple[Expr, ...] | None

    @property
    def residual(self) -> Expr | None:
        """Zero when every check is zero, else the first that is not; None without checks."""
        if self.checks is None:
            return None
        return next((check for check in self.checks if check != 0), sp.Integer(0))


Rows = Iterable[tuple[Expr, Expr] | tuple[Expr, Expr, Relation]]
"""Lines as a step writes them down."""


def defined(number: str, section: str, title: str, rows: Rows, reason: str) -> Equation:
    """Return a postulate or a definition: nothing to prove."""
    return Equation(number, section, title, _lines(rows), reason, None)


def proved(
    number: str, section: str, title: str, rows: Rows, reason: str, *, checks: Iterable[Expr]
) -> Equation:
    """Return an equation with its checks simplified here and now."""
    simplified = tuple(simplest(check) for check in checks)
    if not simplified:
        raise ValueError(f"equation {number} claims a proof and has none")
    return Equation(number, section, title, _lines(rows), reason, simplified)


def simplest(expression: Expr) -> Expr:
    """Return `expression` simplified; cancelling alone decides the rational ones.

    For these `simplify` finds nothing more, and may look for it for minutes.
    """
    quick = sp.cancel(sp.together(expression))
    return quick if quick.is_rational_function() else sp.simplify(quick)


def entries(difference: Matrix) -> list[Expr]:
    """Return the entries of a matrix that should be zero."""
    return list(difference)


def _lines(rows: Rows) -> tuple[Line, ...]:
    return tuple(Line(*(_frozen(part) for part in row)) for row in rows)


def _frozen(part: Expr) -> Expr:
    return part.as_immutable() if isinstance(part, sp.MatrixBase) else part


_EXTRA: list[p.Entry] = []


def _symbol(name: str, latex: str, unit: str, meaning: str) -> Symbol:
    symbol = Symbol(name, real=True)
    _EXTRA.append(p.Entry(symbol, latex, unit, meaning))
    return symbol


F = _symbol("F", "F", "m/s^2", "left side of (6), zero on every motion")
F_0 = _symbol("F(0,Y,U)", "F(0, Y, U)", "m/s^2", "`F` at the equilibrium")
F_moved = _symbol(
    "F(acc_d,Y+y_d,U+u_d)",
    r"F(\ddot{y}_\delta, Y + y_\delta, U + u_\delta)",
    "m/s^2",
    "`F` near the equilibrium",
)
F_acc = _symbol("dF/dacc", r"F_{\ddot{y}}", "-", "slope of `F` in the acceleration, at rest")
F_y = _symbol("dF/dy", "F_y", "1/s^2", "slope of `F` in the gap, at rest")
F_u = _symbol("dF/du", "F_u", "m/(s^2 V)", "slope of `F` in the voltage, at rest")
second_order = _symbol("O(2)", r"O(2)", "m/s^2", "terms of second and higher order")
ctrb = _symbol("[B,A*B]", r"\left[B,\, A B\right]", "mixed", "controllability matrix of (10)")
ctrb_det = _symbol("det[B,A*B]", r"\det\left[B,\, A B\right]", "m^2/(s^4 V^2)", "its determinant")
output_0 = _symbol("c*B", "c B", "m/(s V)", "output row times input column, `c` the row of `y_d`")
output_1 = _symbol("c*A*B", "c A B", "m/(s^2 V)", "the same, one derivative later")
u_rest = _symbol("u_rest", r"\bar{u}", "V", "voltage that holds the ball at the reference gap")

y_dr = _symbol("y_d*", r"y^*_\delta", "m", "incremental reference gap, `y^* - Y`")
u_dr = _symbol("u_d*", r"u^*_\delta", "V", "incremental voltage along the reference")
e1 = _symbol("e'", r"\dot{e}", "m/s", "first derivative of the error")
e2 = _symbol("e''", r"\ddot{e}", "m/s^2", "second derivative of the error")
e3 = _symbol("e'''", r"e^{(3)}", "m/s^3", "third derivative of the error")
e4 = _symbol("e''''", r"e^{(4)}", "m/s^4", "fourth derivative of the error")
# in brackets, because a gain is printed behind them
int_e = _symbol("int(e)", r"\bigl(\int_0^t e\,d\sigma\bigr)", "m s", "integral of the error")
iint_e = _symbol(
    "int(int(e))",
    r"\bigl(\int_0^t\!\int_0^\lambda e\,d\sigma\,d\lambda\bigr)",
    "m s^2",
    "double integral of the error",
)
int_u = _symbol(
    "int(u_d)", r"\int_0^t u_\delta\,d\sigma", "V s", "integral of the incremental voltage"
)
int_y = _symbol("int(y_d)", r"\int_0^t y_\delta\,d\sigma", "m s", "integral of the incremental gap")
v_0 = _symbol("v_d(0)", r"\dot{y}_\delta(0)", "m/s", "initial velocity, unknown to the controller")
v_hat = _symbol(
    "v_d_hat", r"\hat{\dot{y}}_\delta", "m/s", "integral reconstruction of the velocity"
)

poly = _symbol("p(s)", "p(s)", "1/s^4", "characteristic polynomial")
poly_3 = _symbol("p_3(s)", "p_3(s)", "1/s^3", "characteristic polynomial of the state feedback")
poly_n = _symbol("p_n(s)", "p_n(s)", "1/s^n", "characteristic polynomial of order `n`")
poly_des = _symbol("p_des(s)", r"p_{\mathrm{des}}(s)", "1/s^4", "desired polynomial")
poly_6 = _symbol("p_6(s)", "p_6(s)", "1/s^6", "polynomial of the loop with (20) as printed")
G = _symbol("G(s)", "G(s)", "1/s^2", "transfer function of the law (20), `e` to `C_U (u_d - u_d*)`")
G_hat = _symbol(
    "G_hat(s)", r"\hat{G}(s)", "1/s^2", "`G` with the coefficients the controller believes"
)
R = _symbol("R(s)", "R(s)", "1/s^2", "what is left of `G_hat` without `C_Y_hat`")
x1 = _symbol("x1", "x_1", "m s", "integrating state of the bounded law")
x2 = _symbol("x2", "x_2", "m s", "decaying state of the bounded law")
dx1 = _symbol("x1'", r"\dot{x}_1", "m", "its derivative")
dx2 = _symbol("x2'", r"\dot{x}_2", "m", "its derivative")
w = _symbol("w", "w", "V", "voltage on top of the feedforward, `u_d - u_d*`")

zeta_3 = _symbol("zeta_3", r"\zeta_3", "-", "damping of the third pole pair")
omega_3 = _symbol("omega_3", r"\omega_3", "rad/s", "frequency of the third pair")
pole = _symbol("a", "a", "1/s", "real pole at `-a`")
k4, k5 = gain_symbols(6)[4:]
_EXTRA.append(p.Entry(k4, "k_4", "1/s^(n-4)", "gain of a law of order `n`"))
_EXTRA.append(p.Entry(k5, "k_5", "1/s^(n-5)", "gain of a law of order `n`"))

phi = _symbol("phi", r"\phi", "-", "step of the reference from 0 to 1")
dphi = _symbol("phi'", r"\phi'", "-", "its derivative in `tau`")
ddphi = _symbol("phi''", r"\phi''", "-", "its second derivative in `tau`")
order_n = _symbol("N", "N", "-", "order of the Bezier polynomial")
leading = _symbol("p", "p", "-", "number of leading control values that are 0")
index = _symbol("j", "j", "-", "index of a sum")
r = tuple(_symbol(f"r{n}", f"r_{n}", "-", f"coefficient {n} of (28)") for n in range(1, 10))
flat_start = _symbol("n_0", "n_0", "-", "derivatives of `phi` that vanish at the start")
flat_end = _symbol("n_1", "n_1", "-", "derivatives of `phi` that vanish at the end")
_EXTRA += [
    p.Entry(ref.tau, r"\tau", "-", "time within the move, 0 to 1"),
    p.Entry(ref.start_gap, r"\bar{y}_i", "m", "gap before the move"),
    p.Entry(ref.end_gap, r"\bar{y}_f", "m", "gap after the move"),
    p.Entry(ref.start_time, "t_i", "s", "start of the move"),
    p.Entry(ref.end_time, "t_f", "s", "end of the move"),
]

mu = Symbol("mu", positive=True)
_EXTRA.append(p.Entry(mu, r"\mu", "-", "`beta/beta_c`"))
f = _symbol("f_d", r"f_\delta", "m/s^2", "disturbance that the wrong `beta` makes")
E_s = _symbol("E(s)", "E(s)", "m s", "Laplace transform of the error")
F_s = _symbol("F_d(s)", r"F_\delta(s)", "m/s", "Laplace transform of `f_d`")
a3, a2, a1, a0 = (
    _symbol(
        f"a{n}", f"a_{n}", f"1/s^{4 - n}" if n < 3 else "1/s", f"coefficient of `s^{n}` of the loop"
    )
    for n in (3, 2, 1, 0)
)
D = tuple(
    _symbol(f"D{n}", f"D_{n}", unit, f"Hurwitz determinant of order {n}")
    for n, unit in enumerate(("1/s", "1/s^3", "1/s^6", "1/s^10"), start=1)
)
margin = _symbol("margin", "M", "1/s^2", "left minus right side of the inequality")

tustin_w, euler_w, zoh_w = (
    _symbol(f"G_{name}(z)", rf"G_{{\mathrm{{{name}}}}}(z)", "1/s^2", f"sampled law, {meaning}")
    for name, meaning in (
        ("tustin", "bilinear"),
        ("euler", "forward Euler"),
        ("zoh", "step-invariant"),
    )
)
pulse = _symbol("P(z)", "P(z)", "m/V", "sampled plant, voltage to gap")
b = tuple(
    _symbol(f"b{n}", f"b_{n}", "s^2", f"numerator coefficient of `z^{n}` of the sampled plant")
    for n in (2, 1, 0)
)
_EXTRA.append(
    p.Entry(first_part, "T_1", "s", "part of a period for which the older voltage still acts")
)

NOTATION: tuple[p.Entry, ...] = (*p.SYMBOLS, *_EXTRA)
"""Every letter an equation of the derivation is written in: symbol, LaTeX, unit, meaning."""
