"""Flat parameterisation (11), both ways, and controllability as its equivalent."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix

from maglev_design.symbolic import plant as p
from maglev_design.symbolic.linearisation import Linearisation


@dataclass(frozen=True)
class FlatModel:
    """The linearised plant in terms of its flat output y_delta, and back.

    Attributes
    ----------
    state : tuple of Expr
        (y_delta, y_delta') in the flat output and its derivatives.
    input : Expr
        u_delta of (11) in the flat output and its second derivative.
    acceleration : Expr
        Right side of (10), the way back.
    controllability : Matrix
        [B, A B], shape (2, 2).
    flat_output : Expr
        The output of relative degree two that controllability singles out, scaled to y_delta.
    nonlinear_input : Expr
        u of the nonlinear plant (4) in (y, y''): it is flat, too.
    """

    state: tuple[Expr, Expr]
    input: Expr
    acceleration: Expr
    controllability: Matrix
    flat_output: Expr
    nonlinear_input: Expr


def flat_model(plant: p.Plant, linearisation: Linearisation) -> FlatModel:
    """Return the flat parameterisation of (10), derived from its state space.

    The flat output is the last row of the inverse controllability matrix times the state, the
    output whose relative degree equals the order; its scale is chosen so that it is y_delta.
    """
    a, b = linearisation.A, linearisation.B
    controllability = Matrix.hstack(b, a * b)
    state = Matrix([p.y_d, p.v_d])
    candidate = (controllability.inv().row(-1) * state)[0]
    scale = sp.diff(candidate, p.y_d)
    acceleration = (a * state + b * p.u_d)[1]
    (inverse,) = sp.solve(p.acc_d - acceleration, p.u_d)
    nonlinear = sp.solve(p.acc - plant.acceleration, p.u**2)[0]
    return FlatModel(
        state=(p.y_d, p.v_d),
        input=sp.expand(inverse),
        acceleration=acceleration,
        controllability=controllability,
        flat_output=sp.simplify(candidate / scale),
        nonlinear_input=sp.sqrt(sp.factor(nonlinear)),
    )


def round_trip_residual(flat: FlatModel) -> Expr:
    """Return y_delta'' - f(u_delta(y_delta, y_delta'')), zero when both ways agree."""
    return sp.simplify(p.acc_d - flat.acceleration.subs(p.u_d, flat.input))


def path_input(plant: p.Plant) -> Expr:
    """Return u of a nonlinear plant of any kind in (y, y', y'') and, behind a drive, y'''.

    The coil current that y'' asks for is inserted into the drive's own equation, its rate by the
    chain rule. Real where the magnet has to pull.
    """
    kind, direct = plant.kind, plant.kind.order == 2
    none = p.u0 if kind.offset and direct else 0  # the input that makes no current
    free = plant.acceleration.subs(p.u, none)
    root = sp.Rational(1, kind.exponent)
    net = ((free - p.acc) / p.beta) ** root
    net *= sp.powdenest((1 / plant.profile.fall) ** root, force=True)
    if direct:
        return net + none
    rate = sp.diff(net, p.y) * p.v + sp.diff(net, p.v) * p.acc + sp.diff(net, p.acc) * p.jerk_ref
    by_input = sp.diff(plant.drive_rate, p.u)
    given = (rate - plant.drive_rate.subs(p.u, 0)) / by_input
    return given.subs(p.u_coil, net)
