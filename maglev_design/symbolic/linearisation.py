"""Tangent linearisation around an arbitrary equilibrium, eqs. (6)-(10)."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.options import DesignModel, Equilibrium
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
    implicit = p.acc - plant.static
    rest = {p.acc: 0, p.v: 0, p.y: p.Y, p.u: p.U}
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


@dataclass(frozen=True)
class Tangent:
    """A plant of any kind, linearised at rest at a gap y.

    Attributes
    ----------
    A : Matrix
        State matrix in (y_delta, y_delta') and, behind a drive with a state, u_i,delta.
    B : Matrix
        Input matrix, shape (n, 1).
    """

    A: Matrix
    B: Matrix

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    @property
    def denominator(self) -> sp.Poly:
        """det(s I - A), monic in s."""
        return sp.Poly((p.s * sp.eye(self.order) - self.A).det(), p.s)

    @property
    def flat_gain(self) -> Expr:
        """The number c A^(n-1) b, with y_delta^(n) + ... = (this) u_delta.

        Raises
        ------
        ValueError
            Where y is no flat output: c b, ..., c A^(n-2) b do not all vanish. Controllability
            alone would leave zeros.
        """
        row, chain = Matrix([[1, *[0] * (self.order - 1)]]), []
        for _ in range(self.order):
            chain.append(sp.simplify((row * self.B)[0]))
            row = row * self.A
        if any(entry != 0 for entry in chain[:-1]) or chain[-1] == 0:
            raise ValueError("the gap is no flat output of this plant")
        return chain[-1]


def tangent_at_rest(plant: p.Plant) -> Tangent:
    """Return the linearisation of a plant at rest at the gap y, in its own numbers.

    The voltage that holds the ball at y stands for the input and, where there is one, for the state
    of the drive.
    """
    held = plant.equilibrium_voltage.subs(p.Y, p.y)
    net = held - p.u0 if plant.kind.offset else held
    acting = p.u_coil if plant.kind.order > 2 else p.u
    rest = {p.v: 0, p.u_coil: net, p.u: held}
    rates = [p.v, plant.acceleration.subs(p.u, acting), plant.drive_rate]
    states = [p.y, p.v, p.u_coil]
    order = plant.kind.order

    def slope(row: int, by: Symbol) -> Expr:
        # rest first in the voltages alone: the gap is both a state and where the plant rests
        return sp.simplify(sp.diff(rates[row], by).subs(rest))

    return Tangent(
        Matrix(order, order, lambda r, c: slope(r, states[c])),
        Matrix(order, 1, lambda r, _: slope(r, p.u)),
    )


def design_tangent(model: DesignModel) -> Tangent:
    """Return the tangent plant that a controller is designed with, in C_U, C_Y, delta, tau, kappa.

    ``undamped``: (10). ``damped``: s^2 + delta s - C_Y. ``lag``: u_i behind a drive of time
    constant tau with the back-EMF kappa/C_U,

        [(1 + tau s)(s^2 + delta s - C_Y) + kappa s] y_delta = -C_U u_delta.
    """
    damping = p.delta if model != "undamped" else sp.Integer(0)
    if model != "lag":
        return Tangent(Matrix([[0, 1], [p.C_Y, -damping]]), Matrix([0, -p.C_U]))
    return Tangent(
        Matrix(
            [
                [0, 1, 0],
                [p.C_Y, -damping, -p.C_U],
                [0, p.kappa / (p.C_U * p.tau), -1 / p.tau],
            ]
        ),
        Matrix([0, 0, 1 / p.tau]),
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


def believed_drive(plant: p.Plant, c_u: Expr, held: Expr) -> tuple[Expr, Expr, Expr]:
    """Return (delta, tau, kappa) that a controller uses, at its C_U and its voltage U less u0.

    tau = L/R, L being the inductance at Y; kappa = C_U times the back-EMF of a velocity, which by
    the balance of forces at Y is p m g R/(U - u0).
    """
    kind, zero = plant.kind, sp.Integer(0)
    damping = p.delta if kind.damped else zero
    if kind.actuation == "ideal":
        return damping, zero, zero
    emf = kind.exponent * p.m * p.g * p.R / held if kind.actuation == "coil" else zero
    return damping, p.L / p.R, sp.factor(c_u * emf)


def believed_beta(plant: p.Plant, reading: Equilibrium) -> Expr:
    """Return the beta that a controller works with where its law needs one (FEE-GPI).

    beta_c; under ``measured`` what the measured pair (Y, U) says of it, g (Y + y0)^2/U^2.
    """
    if reading != "measured":
        return p.beta_c
    (value,) = sp.solve(plant.static.subs({p.y: p.Y, p.v: 0, p.u: p.U}), p.beta)
    return value
