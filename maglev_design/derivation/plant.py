"""Equations (1)-(13): the plant, its tangent linearisation, flatness, the error dynamics."""

from __future__ import annotations

import sympy as sp
from sympy import Expr, Matrix

from maglev_design.derivation import terms as d
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.flatness import FlatModel, round_trip_residual
from maglev_design.symbolic.laws import reference_voltage, tan_gpi
from maglev_design.symbolic.linearisation import (
    Linearisation,
    believed_coefficients,
    taylor_residual,
)

MODEL, TANGENT, FLAT, ERROR, NUMBERS = (
    "The nonlinear model",
    "Tangent linearisation",
    "Flatness of the linearised system",
    "Error dynamics",
    "Parameters",
)
Steps = list[d.Equation]


def model(plant: p.Plant) -> Steps:
    """Return (1)-(4) and the unit of beta in (26)."""
    squared_gap = (p.y + p.y0) ** 2
    force = plant.force_balance.subs(p.i, plant.current)
    normalised = sp.Add(*[term / p.m for term in sp.Add.make_args(force)])
    return [
        d.defined(
            "1",
            MODEL,
            "Newton's second law for the ball",
            [(p.m * p.acc, plant.force_balance)],
            "Postulate: gravity pulls down, the magnet pulls up with the square of current over "
            "gap. The offset `y0` is not in the paper (`y0 = 0` gives its form); on many real rigs "
            "the force does not grow without bound at the mechanical zero of the gap.",
        ),
        d.defined(
            "2",
            MODEL,
            "Coil current",
            [(p.i, plant.current)],
            "Postulate: the current driver follows its input voltage at once.",
        ),
        d.proved(
            "3",
            MODEL,
            "Plant in the voltage",
            [(p.acc, normalised)],
            "Insert (2) in (1) and divide by the mass.",
            checks=[p.g - p.K * p.C**2 / p.m * p.u**2 / squared_gap - normalised],
        ),
        d.proved(
            "4",
            MODEL,
            "Plant with one parameter",
            [(p.acc, plant.acceleration), (p.beta, plant.beta)],
            "Collect the three constants of (3) in `beta`: only their combination acts.",
            checks=[plant.acceleration.subs(p.beta, plant.beta) - normalised],
        ),
    ]


def numbers(plant: p.Plant) -> Steps:
    """Return (26), of which only the unit is a matter of derivation."""
    units = {entry.symbol: base_units(entry.unit) for entry in p.SYMBOLS if entry.unit != "-"}
    return [
        d.proved(
            "26",
            NUMBERS,
            "Unit of beta",
            [(p.beta, plant.beta)],
            "The paper's numbers live in the preset belmonte2021; here only the unit is checked. "
            "The printed N m^2/(kg V^2) is m^3/(s^2 V^2).",
            checks=[plant.beta.subs(units, simultaneous=True) - units[p.beta]],
        )
    ]


def base_units(text: str) -> Expr:
    """Return a unit of the symbol table as a product of base units."""
    kg, metre, second, ampere, volt = sp.symbols("kg metre second ampere volt", positive=True)
    base = {"kg": kg, "m": metre, "s": second, "A": ampere, "V": volt, "rad": sp.Integer(1)}
    base["N"] = kg * metre / second**2
    return sp.sympify(text.replace(" ", "*").replace("^", "**"), locals=base)


def linearisation(plant: p.Plant, lin: Linearisation) -> Steps:
    """Return (5)-(10): equilibrium, Taylor expansion, linear plant."""
    rest = {p.acc: 0, p.y: p.Y, p.u: p.U}
    at_voltage = {p.U: plant.equilibrium_voltage}
    gap = p.Y + p.y0
    slopes = [sp.diff(lin.implicit, x).subs(rest) for x in (p.acc, p.y, p.u)]
    eps = sp.Symbol("epsilon")
    moved = lin.implicit.subs(
        {p.acc: eps * p.acc_d, p.y: p.Y + eps * p.y_d, p.u: p.U + eps * p.u_d},
        simultaneous=True,
    )
    first = sp.diff(moved, eps).subs(eps, 0)
    chain = sum(slope * x for slope, x in zip(slopes, (p.acc_d, p.y_d, p.u_d), strict=True))
    return [
        d.proved(
            "5",
            TANGENT,
            "Equilibrium",
            [(p.y, p.Y), (p.acc, sp.Integer(0)), (p.U, plant.equilibrium_voltage)],
            "At rest the magnet carries the weight: set the acceleration in (4) to zero and take "
            "the positive root.",
            checks=[
                sp.sqrt(p.g / p.beta) * gap - plant.equilibrium_voltage,
                plant.acceleration.subs({p.y: p.Y, p.u: plant.equilibrium_voltage}),
            ],
        ),
        d.proved(
            "6",
            TANGENT,
            "Plant as an implicit equation",
            [(d.F, lin.implicit), (d.F, sp.Integer(0))],
            "Bring all of (4) to one side; `F` is zero on every motion of the plant.",
            checks=[
                p.acc - p.g + p.beta * p.u**2 / (p.y + p.y0) ** 2 - lin.implicit,
                lin.implicit.subs(p.acc, plant.acceleration),
            ],
        ),
        d.proved(
            "7",
            TANGENT,
            "F at the equilibrium",
            [(d.F_0, lin.implicit.subs(rest)), (d.F_0, sp.Integer(0))],
            "Evaluate (6) at rest and insert `U` from (5).",
            checks=[
                -p.g + p.beta * p.U**2 / gap**2 - lin.implicit.subs(rest),
                lin.implicit.subs(rest).subs(at_voltage),
            ],
        ),
        d.proved(
            "8",
            TANGENT,
            "Taylor expansion of F",
            [
                (
                    d.F_moved,
                    d.F_0 + d.F_acc * p.acc_d + d.F_y * p.y_d + d.F_u * p.u_d + d.second_order,
                ),
                *zip((d.F_acc, d.F_y, d.F_u), slopes, strict=True),
            ],
            "Move away from the equilibrium by a small multiple of the increments; the value and "
            "the slope in that multiple are the terms of order zero and one.",
            checks=[moved.subs(eps, 0) - lin.implicit.subs(rest), first - chain],
        ),
        d.proved(
            "9",
            TANGENT,
            "First order of F",
            [(d.F_moved, chain, "~")],
            "Drop the terms of higher order in (8); the term of order zero is zero by (7).",
            checks=[taylor_residual(plant, lin), chain - first],
        ),
    ]


def linear_plant(plant: p.Plant, lin: Linearisation, flat: FlatModel) -> Steps:
    """Return (10), its coefficients at rest and the three readings of a controller."""
    at_voltage = {p.U: plant.equilibrium_voltage}
    gap = p.Y + p.y0
    return [
        d.proved(
            "10",
            TANGENT,
            "Linearised plant",
            [(p.acc_d, flat.acceleration), (p.C_U, lin.C_U), (p.C_Y, lin.C_Y)],
            "Solve (9) for the acceleration. In the scan one dot of the left side is lost: it is "
            "the second derivative.",
            checks=[
                -p.C_U * p.u_d + p.C_Y * p.y_d - flat.acceleration,
                2 * p.beta * p.U / gap**2 - lin.C_U,
                2 * p.beta * p.U**2 / gap**3 - lin.C_Y,
                taylor_residual(plant, lin),
            ],
        ),
        d.proved(
            "10-rest",
            TANGENT,
            "Coefficients without beta",
            [(p.C_U, lin.C_U_rest), (p.C_Y, lin.C_Y_rest)],
            "Eliminate `beta` with (7). A measured pair of gap and voltage at rest gives both "
            "coefficients: a design from it needs no `beta` at all.",
            checks=[
                2 * p.g / p.U - lin.C_U_rest,
                2 * p.g / gap - lin.C_Y_rest,
                (lin.C_U - lin.C_U_rest).subs(at_voltage),
                (lin.C_Y - lin.C_Y_rest).subs(at_voltage),
            ],
        ),
        _readings(plant, lin),
    ]


def _readings(plant: p.Plant, lin: Linearisation) -> d.Equation:
    _, *model_pair = believed_coefficients(plant, lin, "model")
    _, *appendix_pair = believed_coefficients(plant, lin, "appendix-a")
    _, *measured_pair = believed_coefficients(plant, lin, "measured")
    pairs = (model_pair, appendix_pair, measured_pair)
    exact = {p.beta_c: p.beta, p.U: plant.equilibrium_voltage}
    true = [c.subs(exact) for c in (lin.C_U, lin.C_Y)]
    checks = [
        believed.subs(exact) - coefficient
        for pair in pairs
        for believed, coefficient in zip(pair, true, strict=True)
    ]
    return d.proved(
        "10-readings",
        TANGENT,
        "What a controller with its own beta believes",
        [line for pair in pairs for line in zip((p.C_U_hat, p.C_Y_hat), pair, strict=True)],
        "Three readings, two lines each: `U` computed from the controller's `beta` (model), `U` "
        "measured and the coefficients from (10) (appendix-a), `U` measured and the coefficients "
        "from rest (measured). With the true `beta` all three are (10).",
        checks=checks,
    )


def flatness(plant: p.Plant, lin: Linearisation, flat: FlatModel) -> Steps:
    """Return (11), its equivalence with controllability and what it says of the plant itself."""
    row = Matrix([[1, 0]])
    return [
        d.proved(
            "11",
            FLAT,
            "Flat parameterisation",
            [(p.u_d, flat.input), (p.acc_d, flat.acceleration)],
            "Solve (10) for the voltage: the gap and its derivatives give every variable, and "
            "inserted back they give the gap's acceleration again.",
            checks=[
                -p.acc_d / p.C_U + p.C_Y / p.C_U * p.y_d - flat.input,
                round_trip_residual(flat),
                flat.input.subs(p.acc_d, flat.acceleration) - p.u_d,
            ],
        ),
        d.proved(
            "11-controllability",
            FLAT,
            "Controllability and the flat output",
            [
                (d.ctrb, flat.controllability),
                (d.ctrb_det, flat.controllability.det()),
                (d.output_0, (row * lin.B)[0]),
                (d.output_1, (row * lin.A * lin.B)[0]),
            ],
            "The determinant is not zero, so the linear plant is controllable, which for one "
            "input is the same as flat. The last row of the inverse picks the output of relative "
            "degree two, the order of the plant: it is the incremental gap.",
            checks=[
                flat.controllability.det() + p.C_U**2,
                *d.entries(flat.controllability - Matrix.hstack(lin.B, lin.A * lin.B)),
                flat.flat_output - p.y_d,
                (row * lin.B)[0],
                (row * lin.A * lin.B)[0] + p.C_U,
            ],
        ),
        d.proved(
            "11-nonlinear",
            FLAT,
            "The nonlinear plant is flat, too",
            [(p.u, flat.nonlinear_input)],
            "Solve (4) for the positive voltage; it exists while the acceleration stays below `g`.",
            checks=[
                plant.acceleration.subs(p.u, flat.nonlinear_input) - p.acc,
                flat.nonlinear_input.subs({p.acc: 0, p.y: p.Y}) - plant.equilibrium_voltage,
            ],
        ),
        _static_feedforward(plant, lin),
    ]


def _static_feedforward(plant: p.Plant, lin: Linearisation) -> d.Equation:
    coefficients = {p.C_U: lin.C_U, p.C_Y: lin.C_Y}
    held = sp.factor(tan_gpi().feedforward.subs(p.acc_ref, 0).subs(coefficients))
    exact = {p.U: plant.equilibrium_voltage}
    return d.proved(
        "11-feedforward",
        FLAT,
        "The static feedforward is exact",
        [(p.C_Y / p.C_U, sp.cancel(lin.C_Y / lin.C_U)), (d.u_rest, held)],
        "At rest (11) asks for `U` plus `C_Y/C_U` times the increment. The ratio is `U/(Y + y0)`, "
        "so the sum is the equilibrium voltage of the nonlinear plant (4) at the reference gap, "
        "however far from `Y` that is.",
        checks=[
            lin.C_Y / lin.C_U - p.U / (p.Y + p.y0),
            p.U + p.U / (p.Y + p.y0) * (p.y_ref - p.Y) - held,
            held.subs(exact) - plant.equilibrium_voltage.subs(p.Y, p.y_ref),
            plant.acceleration.subs({p.y: p.y_ref, p.u: held}).subs(exact),
        ],
    )


def error_dynamics(flat: FlatModel) -> Steps:
    """Return (12) and (13)."""
    nominal = flat.acceleration.subs({p.y_d: d.y_dr, p.u_d: d.u_dr}, simultaneous=True)
    voltage = reference_voltage().subs(p.y_ref, p.Y + d.y_dr)
    right = -p.C_U * (p.u_d - d.u_dr)
    difference = (flat.acceleration - nominal).subs(p.y_d, d.y_dr + p.e)
    return [
        d.proved(
            "12",
            ERROR,
            "The reference as a motion of the linear plant",
            [(p.acc_ref, nominal)],
            "Along the reference (10) holds with the voltage that (11) assigns to it.",
            checks=[
                -p.C_U * d.u_dr + p.C_Y * d.y_dr - nominal,
                nominal.subs(d.u_dr, voltage) - p.acc_ref,
            ],
        ),
        d.proved(
            "13",
            ERROR,
            "Error dynamics",
            [(d.e2 - p.C_Y * p.e, right)],
            "Subtract (12) from (10); the error is the difference of the increments.",
            checks=[difference - p.C_Y * p.e - right],
        ),
    ]
