"""What the abstract and sections 2.2 to 2.3 say of the plant: unstable, controllable, flat."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import sympy as sp
from sympy import Expr, Matrix

from maglev_design.controller import design
from maglev_design.paper.ledger import Finding, claim, finding
from maglev_design.paper.printed import proved, residual_is_zero
from maglev_design.paper.theory_linear import TriedRig, close, linear_loop, quantity, tally
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.linearisation import linearise


@claim("abstract-controllable")
def _controllable(tried: Sequence[TriedRig]) -> Finding:
    def full_rank(case: TriedRig) -> bool:
        loops = [linear_loop(case, gap=gap) for gap in case.gaps]
        pairs = [(np.array([[0, 1], [x.c_y, 0]]), np.array([0, -x.c_u])) for x in loops]
        return all(
            np.linalg.matrix_rank(np.column_stack([b, a @ b]) / np.abs(b).max()) == 2
            for a, b in pairs
        )

    found, holds = tally(tried, full_rank), residual_is_zero("11-controllability")
    determinant = proved()["11-controllability"].lines[1].rhs
    return finding(
        holds and found.unanimous and determinant.is_negative,
        f"det [B, A B] = {determinant}, derivation (11-controllability), never zero. "
        + found.says("Rank of [B, A B] at Y and at both ends of the path"),
        determinant=str(determinant),
        **found.counts,
    )


@claim("2.2-unstable")
def _unstable(tried: Sequence[TriedRig]) -> Finding:
    lin = linearise(p.magnetic_levitation())
    roots = set(lin.A.eigenvals())
    expected = {sp.sqrt(p.C_Y), -sp.sqrt(p.C_Y)}

    def falls(case: TriedRig) -> bool:
        plant = case.rig.plant
        return all(
            close(
                float(np.linalg.eigvals(np.array([[0, 1], [loop.c_y, 0]])).real.max()),
                math.sqrt(2 * plant.gravity / (gap + plant.gap_offset)),
            )
            for gap in case.gaps
            for loop in (linear_loop(case, gap=gap),)
        )

    found = tally(tried, falls)
    rates = [math.sqrt(linear_loop(tried[0], gap=gap).c_y) for gap in tried[0].gaps]
    return finding(
        roots == expected and found.unanimous,
        "The eigenvalues of (10) are +-sqrt(C_Y) = +-sqrt(2 g/Y), one of them positive: "
        f"{quantity(rates[0], '1/s')} at Y, {quantity(rates[2], '1/s')} at the end of the "
        f"move; an error doubles in {quantity(math.log(2) / rates[0], 's')} and "
        f"{quantity(math.log(2) / rates[2], 's')}. " + found.says("Eigenvalues"),
        rate_at_Y=rates[0],
        rate_at_end=rates[2],
        **found.counts,
    )


@claim("2.2-any-equilibrium")
def _any_equilibrium(tried: Sequence[TriedRig]) -> Finding:
    plant = p.magnetic_levitation()
    lin = linearise(plant)
    rest = sp.simplify(plant.acceleration.subs({p.y: p.Y, p.u: plant.equilibrium_voltage}))
    signs = [x.is_positive for x in (plant.equilibrium_voltage, lin.C_U_rest, lin.C_Y_rest)]

    def inside(case: TriedRig) -> bool:
        beta = design.plant_beta(case.rig)
        low, high = case.rig.limits.voltage
        return all(low < design.true_equilibrium(case.rig, beta, gap).U < high for gap in case.gaps)

    found = tally(tried, inside)
    return finding(
        rest == 0 and all(signs) and found.unanimous,
        f"At any gap Y > 0 the voltage {plant.equilibrium_voltage.subs(p.y0, 0)} leaves an "
        f"acceleration of {rest}; it, C_U and C_Y are positive for all positive parameters. "
        "The range of the actuator is what limits the gap. "
        + found.says("Voltage within the range at Y and at both ends of the path"),
        residual=str(rest),
        **found.counts,
    )


@claim("2.3-flat")
def _flat() -> Finding:
    return finding(
        residual_is_zero("11", "11-controllability"),
        "Derivation (11), residual 0 both ways: the gap and its first two derivatives give "
        "state and voltage. (11-controllability): the last row of the inverse of [B, A B] "
        "singles out the output of relative degree two, and it is the incremental gap.",
    )


@claim("2.3-local")
def _flat_nonlinear() -> Finding:
    line = proved()["11-nonlinear"].lines[0]
    return finding(
        residual_is_zero("11-nonlinear", "11-feedforward"),
        "More holds: the nonlinear plant (4) is flat with the same output, "
        f"{line.lhs} = {line.rhs.subs(p.y0, 0)}, wherever its acceleration stays below g, "
        "derivation (11-nonlinear), residual 0. The static part of the linear feedforward is "
        "its exact voltage at rest at any gap, (11-feedforward).",
    )


@claim("abstract-cascade")
def _cascade() -> Finding:
    wish = sp.Symbol("nu", real=True)
    inner = proved()["11"].lines[0].rhs.subs(p.acc_d, wish)
    left = sp.simplify(proved()["10"].lines[0].rhs.subs(p.u_d, inner))
    return finding(
        left == wish,
        f"With u_d = {inner} the plant (10) becomes acc_d = {left}: two integrators in a "
        "chain from the wished acceleration nu to the gap. The wish for it is what (14) and "
        "(20) add.",
    )


@claim("6-flat-by-controllability")
def _flat_by_controllability() -> Finding:
    counter = _involutive_defect()
    return finding(
        residual_is_zero("11-nonlinear", "11-controllability") and counter != 0,
        "True of this plant, which has one input and order two: its flat parameterisation "
        "stands in derivation (11-nonlinear). As a rule for any plant it would be false from "
        "order three on: x1' = x2 + x3^2, x2' = x3, x3' = u has a controllable linearisation, "
        "but g, ad_f g and their bracket are independent (determinant "
        f"{counter}), so that no feedback makes it linear.",
        determinant_of_the_counterexample=str(counter),
    )


def _involutive_defect() -> Expr:
    """Return det [g, ad_f g, [g, ad_f g]] of the counterexample, zero were it involutive."""
    x = Matrix(sp.symbols("x1 x2 x3", real=True))
    drift, steer = Matrix([x[1] + x[2] ** 2, x[2], 0]), Matrix([0, 0, 1])

    def bracket(first: Matrix, second: Matrix) -> Matrix:
        return second.jacobian(x) * first - first.jacobian(x) * second

    once = bracket(drift, steer)
    return sp.simplify(Matrix.hstack(steer, once, bracket(steer, once)).det())
