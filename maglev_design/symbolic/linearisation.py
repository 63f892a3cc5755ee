"""Tangent linearisation around an arbitrary equilibrium, eqs. (6)-(10)."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.options import Equilibrium
from maglev_design.symbolic import plant as p


@dataclass(frozen=True)
class Linearisation:
    """y_delta'' = -C_U u_delta + C_Y y_delta around (Y, U(Y)), eq. (10).

    Attributes
    ----------
    implicit : Expr
        F(y'', y, u) of (6), zero on every motion.
    C_U, C_Y : Expr
        The coefficients in beta, U and Y: 2 beta U/(Y + y0)^2 and 2 beta U^2/(Y + y0)^3.
    C_U_rest, C_Y_rest : Expr
        The same with beta eliminated by (5): 2 g/U and 2 g/(Y + y0).
    A, B : Matrix
        State space of (10) in (y_delta, y_delta'), shapes (2, 2) and (2, 1).
    """

    implicit: Expr
    C_U: Expr
    C_Y: Expr
    C_U_rest: Expr
    C_Y_rest: Expr
    A: Matrix
    B: Matrix


def linearise(plant: p.Plant) -> Linearisation:
    """Return the first-order Taylor expansion of `plant` at its equilibrium (5).

    The coefficients are the partial derivatives of F; nothing about the form of the force is
    assumed.
    """
    implicit = p.acc - plant.acceleration
    rest = {p.acc: 0, p.y: p.Y, p.u: p.U}
    slope = sp.diff(implicit, p.acc).subs(rest)
    c_u = sp.factor((sp.diff(implicit, p.u) / slope).subs(rest))
    c_y = sp.factor((-sp.diff(implicit, p.y) / slope).subs(rest))
    (beta_rest,) = sp.solve(implicit.subs(rest), p.beta)
    return Linearisation(
        implicit=implicit,
        C_U=c_u,
        C_Y=c_y,
        C_U_rest=sp.factor(c_u.subs(p.beta, beta_rest)),
        C_Y_rest=sp.factor(c_y.subs(p.beta, beta_rest)),
        A=Matrix([[0, 1], [p.C_Y, 0]]),
        B=Matrix([0, -p.C_U]),
    )


def taylor_residual(plant: p.Plant, linearisation: Linearisation) -> Expr:
    """Return what is left of F at first order once (10) is subtracted; zero proves (8)-(9).

    F is evaluated at (Y'' + eps y_delta'', Y + eps y_delta, U + eps u_delta); the coefficients
    of eps^0 and eps^1 must be 0 and the left side of (10).
    """
    eps = Symbol("epsilon")
    moved = linearisation.implicit.subs(
        {p.acc: eps * p.acc_d, p.y: p.Y + eps * p.y_d, p.u: p.U + eps * p.u_d}, simultaneous=True
    ).subs(p.U, plant.equilibrium_voltage)
    at_rest = moved.subs(eps, 0)
    first = sp.diff(moved, eps).subs(eps, 0)
    linear = p.acc_d + linearisation.C_U * p.u_d - linearisation.C_Y * p.y_d
    difference = first - linear.subs(p.U, plant.equilibrium_voltage)
    return sp.simplify(at_rest) ** 2 + sp.simplify(difference) ** 2


def believed_coefficients(
    plant: p.Plant,
    linearisation: Linearisation,
    reading: Equilibrium,
) -> tuple[Expr, Expr, Expr]:
    """Return (U, C_U, C_Y) that a controller uses, for one of the three equilibrium readings.

    Parameters
    ----------
    plant, linearisation
        Of :func:`maglev_design.symbolic.plant.magnetic_levitation` and :func:`linearise`.
    reading : {"model", "appendix-a", "measured"}
        ``model``: U = sqrt(g/beta_c) (Y + y0), C_U = 2g/U, C_Y = 2g/(Y + y0).
        ``appendix-a``: U is the true equilibrium voltage (symbol U),
        C_U = 2 beta_c U/(Y + y0)^2, C_Y = 2 beta_c U^2/(Y + y0)^3 (Appendix A of the paper).
        ``measured``: U is the true equilibrium voltage, C_U = 2g/U, C_Y = 2g/(Y + y0): no beta.

    Returns
    -------
    tuple of Expr
        In beta_c, g, Y, y0 and, but for ``model``, U.
    """
    if reading == "model":
        voltage = plant.equilibrium_voltage.subs(p.beta, p.beta_c)
        return voltage, linearisation.C_U_rest.subs(p.U, voltage), linearisation.C_Y_rest
    if reading == "appendix-a":
        own = {p.beta: p.beta_c}
        return p.U, linearisation.C_U.subs(own), linearisation.C_Y.subs(own)
    return p.U, linearisation.C_U_rest, linearisation.C_Y_rest


def believed_beta(plant: p.Plant, reading: Equilibrium) -> Expr:
    """Return the beta that a controller works with where its law needs one (FEE-GPI).

    beta_c; under ``measured`` what the measured pair (Y, U) says of it, g (Y + y0)^2/U^2.
    """
    if reading != "measured":
        return p.beta_c
    (value,) = sp.solve(plant.acceleration.subs({p.y: p.Y, p.u: p.U}), p.beta)
    return value
