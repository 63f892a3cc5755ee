"""The numbers of one controller, exact: as it was designed, and as it runs in doubles."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

from sympy import Expr, Rational, Symbol

from maglev_design import programs
from maglev_design.certification.rationals import decimal
from maglev_design.controller.design import Design
from maglev_design.errors import InputError
from maglev_design.programs import derived
from maglev_design.rig import Rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.linearisation import believed_beta, believed_coefficients, linearise

ROUNDING = 1e-12
"""Relative difference between a number as it was designed and the double that runs."""


def check_same_rig(rig: Rig, design: Design) -> None:
    """Raise `InputError` where a design was made for another rig than the one at hand."""
    for name, unit, ours, theirs in (
        ("operating_point.gap", "m", rig.operating_point.gap, design.Y),
        ("sampling.period", "s", rig.sampling.period, design.period),
        ("limits.voltage", "V", rig.limits.voltage, design.voltage_limits),
    ):
        if ours != theirs:
            raise InputError(
                f"{name} = {ours!r} [{unit}]: the design was made for {theirs!r}, another rig's; "
                "judge it on its own"
            )


def as_run(
    rig: Rig, design: Design, typed: Callable[[float], Fraction] = decimal
) -> dict[Symbol, Expr]:
    """Return the doubles that run, taken as exact, and the rig's numbers as `typed`; by symbol.

    ``beta_c`` is that of the ratio beta_c/beta.
    """
    believed = design.believed
    doubles = {p.C_U_hat: believed.C_U, p.C_Y_hat: believed.C_Y}
    doubles |= dict(zip(programs.law(design.controller).gains, design.gains, strict=True))
    plain = {p.g: rig.plant.gravity, p.y0: rig.plant.gap_offset, p.Y: design.Y}
    plain |= {p.beta_c: believed.beta, p.U: believed.U}
    exact = {symbol: Rational(value) for symbol, value in doubles.items()}
    return exact | {symbol: Rational(typed(value)) for symbol, value in plain.items()}


def as_designed(rig: Rig, design: Design) -> dict[Symbol, Expr]:
    """Return the numbers that the doubles of :func:`as_run` stand for, where those are known.

    Gains are exact for the decimals of the poles, C_U^, C_Y^ and beta_c for those of the rig and
    of U: what they round to is what runs. Numbers that come from elsewhere stay as they run.
    """
    known = as_run(rig, design)
    plant = rig.plant
    typed = {p.m: plant.mass, p.C: rig.current_gain, p.K: plant.force_constant}
    model = p.magnetic_levitation()
    numbers = known | {symbol: Rational(decimal(value)) for symbol, value in typed.items()}
    numbers[p.beta_c] = model.beta.subs(numbers)
    _, c_u, c_y = believed_coefficients(model, linearise(model), design.equilibrium)
    formulas = {p.C_U_hat: c_u, p.C_Y_hat: c_y, p.beta_c: believed_beta(model, design.equilibrium)}
    poles = dict(
        zip(derived.POLES, (Rational(decimal(x)) for x in design.poles.values), strict=True)
    )
    gains = {k: x.subs(poles) for k, x in derived.gain_expressions(design.controller).items()}
    for group in ({x: formula.subs(numbers) for x, formula in formulas.items()}, gains):
        if all(math.isclose(float(x), float(known[k]), rel_tol=ROUNDING) for k, x in group.items()):
            known |= group
    return known
