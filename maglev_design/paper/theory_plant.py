"""What the abstract and sections 2.2 to 2.3 say of the plant: unstable, controllable, flat."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import sympy as sp
from sympy import Expr, Matrix

from maglev_design import design
from maglev_design.paper.equations import proved
from maglev_design.paper.ledger import Claim, judged
from maglev_design.paper.theory_linear import Case, close, linear_loop, quantity, tally
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.linearisation import linearise

DERIVE = "maglev-design derive"


def plant_claims(tried: Sequence[Case]) -> tuple[Claim, ...]:
    """Return the claims on the plant, the first of `tried` being the paper's rig."""
    return (
        _controllable(tried),
        _unstable(tried),
        _any_equilibrium(tried),
        _flat(),
        _flat_nonlinear(),
        _cascade(),
        _flat_by_controllability(),
    )


def residual_is_zero(*numbers: str) -> bool:
    """Whether the derivation proves all of these equations."""
    return all(proved()[number].residual == 0 for number in numbers)


def _controllable(tried: Sequence[Case]) -> Claim:
    def full_rank(case: Case) -> bool:
        loops = [linear_loop(case, gap=gap) for gap in case.gaps]
        pairs = [(np.array([[0, 1], [x.c_y, 0]]), np.array([0, -x.c_u])) for x in loops]
        return all(
            np.linalg.matrix_rank(np.column_stack([b, a @ b]) / np.abs(b).max()) == 2
            for a, b in pairs
        )

    found, holds = tally(tried, full_rank), residual_is_zero("11-controllability")
    determinant = proved()["11-controllability"].lines[1].rhs
    return Claim(
        id="abstract-controllable",
        place="abstract, sec. 2.3",
        statement="The plant linearised at any equilibrium is controllable.",
        verdict=judged(holds=holds and found.unanimous and determinant.is_negative),
        correction="",
        evidence=(
            f"det [B, A B] = {determinant}, derivation (11-controllability), never zero. "
            + found.says("Rank of [B, A B] at Y and at both ends of the path")
        ),
        command=DERIVE,
        values={"determinant": str(determinant), "rigs": found.tried, "agreed": found.agreed},
    )


def _unstable(tried: Sequence[Case]) -> Claim:
    lin = linearise(p.magnetic_levitation())
    roots = set(lin.A.eigenvals())
    expected = {sp.sqrt(p.C_Y), -sp.sqrt(p.C_Y)}

    def falls(case: Case) -> bool:
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
    return Claim(
        id="2.2-unstable",
        place="abstract, sec. 2.2",
        statement="Every equilibrium of the plant without control is unstable.",
        verdict=judged(holds=roots == expected and found.unanimous),
        correction="",
        evidence=(
            "The eigenvalues of (10) are +-sqrt(C_Y) = +-sqrt(2 g/Y), one of them positive: "
            f"{quantity(rates[0], '1/s')} at Y, {quantity(rates[2], '1/s')} at the end of the "
            f"move; an error doubles in {quantity(math.log(2) / rates[0], 's')} and "
            f"{quantity(math.log(2) / rates[2], 's')}. " + found.says("Eigenvalues")
        ),
        command=DERIVE,
        values={
            "rate_at_Y": rates[0],
            "rate_at_end": rates[2],
            "rigs": found.tried,
            "agreed": found.agreed,
        },
    )


def _any_equilibrium(tried: Sequence[Case]) -> Claim:
    plant = p.magnetic_levitation()
    lin = linearise(plant)
    rest = sp.simplify(plant.acceleration.subs({p.y: p.Y, p.u: plant.equilibrium_voltage}))
    signs = [x.is_positive for x in (plant.equilibrium_voltage, lin.C_U_rest, lin.C_Y_rest)]

    def inside(case: Case) -> bool:
        beta = design.plant_beta(case.rig)
        low, high = case.rig.limits.voltage
        return all(low < design.true_equilibrium(case.rig, beta, gap).U < high for gap in case.gaps)

    found = tally(tried, inside)
    return Claim(
        id="2.2-any-equilibrium",
        place="abstract, sec. 2.2",
        statement="The point of linearisation is arbitrary: every gap has its equilibrium.",
        verdict=judged(holds=rest == 0 and all(signs) and found.unanimous),
        correction="",
        evidence=(
            f"At any gap Y > 0 the voltage {plant.equilibrium_voltage.subs(p.y0, 0)} leaves an "
            f"acceleration of {rest}; it, C_U and C_Y are positive for all positive parameters. "
            "The range of the actuator is what limits the gap. "
            + found.says("Voltage within the range at Y and at both ends of the path")
        ),
        command=DERIVE,
        values={"residual": str(rest), "rigs": found.tried, "agreed": found.agreed},
    )


def _flat() -> Claim:
    holds = residual_is_zero("11", "11-controllability")
    return Claim(
        id="2.3-flat",
        place="sec. 2.3",
        statement=(
            "The linearised plant is flat with the incremental gap as the flat output, which for "
            "one input is the same as controllable."
        ),
        verdict=judged(holds=holds),
        correction="",
        evidence=(
            "Derivation (11), residual 0 both ways: the gap and its first two derivatives give "
            "state and voltage. (11-controllability): the last row of the inverse of [B, A B] "
            "singles out the output of relative degree two, and it is the incremental gap."
        ),
        command=DERIVE,
    )


def _flat_nonlinear() -> Claim:
    line = proved()["11-nonlinear"].lines[0]
    holds = residual_is_zero("11-nonlinear", "11-feedforward")
    return Claim(
        id="2.3-local",
        place="sec. 1, 2.3",
        statement="The plant is flat locally, around the equilibrium of the linearisation.",
        verdict=judged(holds=holds),
        correction="",
        evidence=(
            "More holds: the nonlinear plant (4) is flat with the same output, "
            f"{line.lhs} = {line.rhs.subs(p.y0, 0)}, wherever its acceleration stays below g, "
            "derivation (11-nonlinear), residual 0. The static part of the linear feedforward is "
            "its exact voltage at rest at any gap, (11-feedforward)."
        ),
        command=DERIVE,
    )


def _cascade() -> Claim:
    wish = sp.Symbol("nu", real=True)
    inner = proved()["11"].lines[0].rhs.subs(p.acc_d, wish)
    left = sp.simplify(proved()["10"].lines[0].rhs.subs(p.u_d, inner))
    return Claim(
        id="abstract-cascade",
        place="abstract",
        statement="Flatness gives the linearised plant the structure of a cascade.",
        verdict=judged(holds=left == wish),
        correction="",
        evidence=(
            f"With u_d = {inner} the plant (10) becomes acc_d = {left}: two integrators in a "
            "chain from the wished acceleration nu to the gap. The wish for it is what (14) and "
            "(20) add."
        ),
        command=DERIVE,
    )


def _flat_by_controllability() -> Claim:
    counter = _involutive_defect()
    holds = residual_is_zero("11-nonlinear", "11-controllability")
    return Claim(
        id="6-flat-by-controllability",
        place="sec. 6",
        statement=(
            "Because its tangent linearisation is controllable, the levitation system is locally "
            "flat."
        ),
        verdict=judged(holds=holds and counter != 0),
        correction="",
        evidence=(
            "True of this plant, which has one input and order two: its flat parameterisation "
            "stands in derivation (11-nonlinear). As a rule for any plant it would be false from "
            "order three on: x1' = x2 + x3^2, x2' = x3, x3' = u has a controllable linearisation, "
            "but g, ad_f g and their bracket are independent (determinant "
            f"{counter}), so that no feedback makes it linear."
        ),
        command=DERIVE,
        values={"determinant_of_the_counterexample": str(counter)},
    )


def _involutive_defect() -> Expr:
    """Return det [g, ad_f g, [g, ad_f g]] of the counterexample, zero were it involutive."""
    x = Matrix(sp.symbols("x1 x2 x3", real=True))
    drift, steer = Matrix([x[1] + x[2] ** 2, x[2], 0]), Matrix([0, 0, 1])

    def bracket(first: Matrix, second: Matrix) -> Matrix:
        return second.jacobian(x) * first - first.jacobian(x) * second

    once = bracket(drift, steer)
    return sp.simplify(Matrix.hstack(steer, once, bracket(steer, once)).det())
