"""What the paper prints, equation by equation, and the letters of Appendix A.

The printed forms stand here by hand; lost dots are restored, and what the scan shows stands beside.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import sympy as sp
from sympy import Expr, Symbol

from maglev_design.derivation import Equation, derivation
from maglev_design.derivation import terms as d
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as ref

GAMMA = sp.symbols("gamma_0 gamma_1 gamma_2 gamma_3", real=True)
"""The letters of Appendix A, defined twice in its text."""

BELOW_A1, BELOW_A6 = "the text below (A1)", "the text below (A6)"
PLAIN, INSIDE = "gamma_n = k_n", "gamma_2 = k2 + C_Y_hat, else k_n"
GAMMAS: Mapping[str, tuple[Expr, Expr, Expr, Expr]] = {
    BELOW_A1: (
        p.k0 / p.C_U_hat,
        (p.k3 + p.C_Y_hat) / p.C_U_hat,
        (p.k2 + p.C_Y_hat) / p.C_U_hat,
        p.k3,
    ),
    BELOW_A6: (
        p.k0 / p.C_U_hat,
        (p.k3 * p.C_Y_hat + p.k1) / p.C_U_hat,
        (p.k2 + p.C_Y_hat) / p.C_U_hat,
        p.k3,
    ),
    PLAIN: (p.k0, p.k1, p.k2, p.k3),
    INSIDE: (p.k0, p.k1, p.k2 + p.C_Y_hat, p.k3),
}
"""Values of the gammas: the two of the text, then the two that make (A3)-(A7) and (A1) right."""
OF_THE_TEXT = (BELOW_A1, BELOW_A6)

PRINTED_BOUND, BOUND_TEXT = sp.Rational(100, 263), "1/2.63"
"""Bound on beta/beta_c in the text of (A7), for zeta = 1, and as it is printed."""
PRINTED_BETA = "0.00136884"
"""[m^3/(s^2 V^2)] Eq. (26), as printed."""
PRINTED_PARAMETERS: Mapping[Symbol, str] = {p.C: "1.05", p.m: "0.02", p.K: "2.48315625e-5"}
"""A/V, kg and N m^2/A^2, in the lines above (26)."""
PRINTED_STEP = (12870, 91520, 288288, 524160, 600600, 443520, 205920, 54912, 6435)
"""Eq. (29), as printed."""

Row = tuple[Expr, Expr] | tuple[Expr, Expr, int]
"""Left side, right side and, where it is not the row's own place, the derivation's line."""
Text = str | Callable[[], str]
"""Words, or what finds them in the derivation, which takes its time."""


@dataclass(frozen=True)
class Printed:
    """An equation as the paper has it.

    Attributes
    ----------
    rows : tuple of Row
        The lines, lost dots restored.
    scanned : tuple of Row
        The lines as the scan shows them, where a lost dot can be written down at all.
    note : Text
        What the scan cannot tell, or what else is printed oddly.
    correction : Text
        Said in front of the derived form where the equation is wrong.
    at : mapping of Symbol to Expr
        For which values the printed form is meant.
    """

    rows: tuple[Row, ...]
    scanned: tuple[Row, ...] = ()
    note: Text = ""
    correction: Text = ""
    at: Mapping[Symbol, Expr] = field(default_factory=dict)

    @property
    def in_gammas(self) -> bool:
        """Whether the letters of Appendix A stand in it."""
        return any(side.has(*GAMMA) for row in self.rows for side in row[:2])


@cache
def proved() -> Mapping[str, Equation]:
    """Return the equations of the derivation by id, derived once a process."""
    return {equation.id: equation for equation in derivation()}


def residual_is_zero(*numbers: str) -> bool:
    """Whether the derivation proves all of these equations."""
    return all(proved()[number].residual == 0 for number in numbers)


def designed(expression: Expr) -> Expr:
    """Return `expression` with the gains (25)."""
    return expression.subs({line.lhs: line.rhs for line in proved()["25"].lines})


@cache
def printed_forms() -> Mapping[str, Printed]:
    """Return what the paper prints, by number, in its order."""
    return _model() | _linear_plant() | _control() | _gains_and_path() | _appendix()


def _form(*rows: Row, **rest: Any) -> Printed:
    return Printed(rows, **rest)


def _model() -> dict[str, Printed]:
    force = p.beta * p.u**2 / p.y**2
    rest = -p.g + p.beta * p.U**2 / p.Y**2
    first = d.F_acc * p.acc_d + d.F_y * p.y_d + d.F_u * p.u_d
    doubled = "The index delta stands twice on the left of the printed form; nothing hangs on it."
    return {
        "1": _form((p.m * p.acc, p.m * p.g - p.K * p.i**2 / p.y**2)),
        "2": _form((p.i, p.C * p.u)),
        "3": _form((p.acc, p.g - p.K * p.C**2 / p.m * p.u**2 / p.y**2)),
        "4": _form((p.acc, p.g - force), (p.beta, p.K * p.C**2 / p.m)),
        "5": _form((p.y, p.Y), (p.acc, sp.Integer(0)), (p.U, sp.sqrt(p.g / p.beta) * p.Y)),
        "6": _form((d.F, p.acc - p.g + force), (d.F, sp.Integer(0))),
        "7": _form((d.F_0, rest), (d.F_0, sp.Integer(0))),
        "8": _form((d.F_moved, d.F_0 + first + d.second_order), note=doubled),
        "9": _form((d.F_moved, first), note=doubled),
    }


def _linear_plant() -> dict[str, Printed]:
    motion = -p.C_U * p.u_d + p.C_Y * p.y_d
    coefficients = ((p.C_U, 2 * p.beta * p.U / p.Y**2), (p.C_Y, 2 * p.beta * p.U**2 / p.Y**3))
    return {
        "10": _form(
            (p.acc_d, motion),
            *coefficients,
            scanned=((p.v_d, motion), *coefficients),
            note="One dot on the left decides, and the scan loses dots; it is read as the second "
            "derivative, as (11) and (12) have it.",
        ),
        "11": _form((p.u_d, -p.acc_d / p.C_U + p.C_Y / p.C_U * p.y_d)),
        "12": _form((p.acc_ref, -p.C_U * d.u_dr + p.C_Y * d.y_dr)),
        "13": _form((d.e2 - p.C_Y * p.e, -p.C_U * (p.u_d - d.u_dr))),
    }


def _control() -> dict[str, Printed]:
    feedback = -p.k3 * d.e1 - (p.k2 + p.C_Y) * p.e - p.k1 * d.int_e
    bracket = -p.k3 * (d.v_hat - p.v_ref) - (p.k2 + p.C_Y) * p.e
    bracket += -p.k1 * d.int_e - p.k0 * d.iint_e
    integral = -p.C_U * d.int_u + p.C_Y * d.int_y
    law, estimate = (p.u_d, d.u_dr - bracket / p.C_U), (d.v_hat, integral)
    loop = p.k3 * d.e1 + p.k2 * p.e + p.k1 * d.int_e + p.k0 * d.iint_e
    hat = "In the scan the estimate has a hat and no dot; whether the dot was printed it cannot "
    hat += "tell. It is read as the estimate of the velocity."
    return {
        "14": _form((p.u_d, d.u_dr - feedback / p.C_U)),
        "15": _form((d.e3 + p.k3 * d.e2 + p.k2 * d.e1 + p.k1 * p.e, sp.Integer(0))),
        "16": _form(
            (d.poly_3, p.s**3 + p.k3 * p.s**2 + p.k2 * p.s + p.k1),
            note="The exponent is printed like an order of derivation, (3); it is a power.",
        ),
        "17": _form((p.v_d, integral + d.v_0)),
        "18": _form(estimate, note=hat),
        "19": _form((p.v_d, d.v_hat + d.v_0), note=hat),
        "20": _form(
            law,
            (d.u_dr, -(p.acc_ref - p.C_Y * d.y_dr) / p.C_U),
            estimate,
            scanned=(law, (d.u_dr, -(p.v_ref - p.C_Y * d.y_dr) / p.C_U), estimate),
            note=f"The dot missing in the second line the scan may have lost: (12) has it. {hat}",
        ),
        "21": _form(
            (p.acc_d + loop, p.k3 * d.v_0),
            correction="for the linear plant (10) in place of (4): ",
            note=_remainder_of_the_plant,
        ),
        "22": _form((d.e4 + p.k3 * d.e3 + p.k2 * d.e2 + p.k1 * d.e1 + p.k0 * p.e, sp.Integer(0))),
        "23": _form((d.poly, p.s**4 + p.k3 * p.s**3 + p.k2 * p.s**2 + p.k1 * p.s + p.k0)),
    }


def _remainder_of_the_plant() -> str:
    """Say why (21) needs both of its corrections: the letter, and the plant it is for."""
    eps = sp.Symbol("epsilon")
    moved = p.magnetic_levitation().acceleration.subs(
        {p.y: p.Y + eps * p.y_d, p.u: p.U + eps * p.u_d, p.y0: 0}, simultaneous=True
    )
    weight = {p.beta: p.g * p.Y**2 / p.U**2}
    second = sp.factor((sp.diff(moved, eps, 2) / 2).subs(eps, 0).subs(weight))
    return (
        "A letter is wrong, not a dot: with y for e the reference acceleration is left, and two "
        "derivatives of it would not give (22). A misread letter in the scan cannot be excluded, "
        "the text can: it inserts (20) in the nonlinear (4), which adds the terms of second and "
        f"higher order, of second order {second}."
    )


def _gains_and_path() -> dict[str, Printed]:
    desired = (p.s**2 + 2 * p.zeta * p.omega_n + p.omega_n**2) ** 2
    series = ref.tau**8 * sum((-1) ** n * r * ref.tau**n for n, r in enumerate(d.r))
    return {
        "24": _form((d.poly_des, desired), note="The s of the middle term is missing."),
        "25": _form(
            (p.k3, 4 * p.zeta * p.omega_n),
            (p.k2, 4 * p.zeta**2 * p.omega_n**2 + 2 * p.omega_n**2),
            (p.k1, 4 * p.zeta * p.omega_n**3),
            (p.k0, p.omega_n**4),
        ),
        "26": _form((p.beta, p.K * p.C**2 / p.m)),
        "27": _form(
            (p.y_ref, ref.start_gap + (ref.end_gap - ref.start_gap) * d.phi),
            note="(27) and (28) list the arguments of phi in different orders.",
        ),
        "28": _form(
            (d.phi, series), (ref.tau, (p.t - ref.start_time) / (ref.end_time - ref.start_time))
        ),
        "29": _form(
            *((r, sp.Integer(number)) for r, number in zip(d.r, PRINTED_STEP, strict=True))
        ),
    }


def _appendix() -> dict[str, Printed]:
    g0, g1, g2, g3 = GAMMA
    fraction = (g2 * p.s**2 + g1 * p.s + g0) / (p.s * (p.s + g3))
    bracket = -g3 * (d.v_hat - p.v_ref) - g2 * p.e - g1 * d.int_e - g0 * d.iint_e
    law = (p.u_d, d.u_dr - bracket / p.C_U_hat)
    estimate = (d.v_hat, -p.C_U_hat * d.int_u + p.C_Y_hat * d.int_y)
    gain = p.C_U / p.C_U_hat
    moved = p.acc_d - p.acc_ref
    two_ratios = (
        p.C_Y_hat * (-gain + p.C_Y / p.C_Y_hat) * p.y_d
        + (gain - 1) * p.acc_ref
        - gain * fraction * p.e
    )
    one_ratio = (d.mu - 1) * p.acc_ref - d.mu * fraction * p.e
    ratios = ((gain, d.mu), (p.C_Y / p.C_Y_hat, d.mu), (d.mu, p.beta / p.beta_c))
    denominator = p.s**4 + g3 * p.s**3 + d.mu * (g2 * p.s**2 + g1 * p.s + g0)
    dots = "Lost dots and hats as in (20) are the scan's."
    left = "The dot missing on the left may be the scan's."
    plain = "gamma_n = k_n in (A2) to (A7): "
    return {
        "A1": _form(
            law,
            (d.u_dr, -(p.acc_ref - p.C_Y_hat * d.y_dr) / p.C_U_hat),
            estimate,
            note=f"The bracket is already divided by C_U_hat, and gamma_1 names k3 for k1. {dots}",
            correction="gamma_3 = k3, gamma_2 = k2 + C_Y_hat, gamma_1 = k1, gamma_0 = k0: ",
        ),
        "A2": _form(
            (p.u_d, p.C_Y_hat / p.C_U_hat * (p.y_d - p.acc_ref + fraction * p.e), 1),
            note="C_Y_hat belongs to the increment of the gap alone.",
            correction=plain,
        ),
        "A3": _form(
            (moved, two_ratios),
            scanned=((p.v_d - p.acc_ref, two_ratios),),
            note=left,
            correction=plain,
        ),
        "A4": _form(
            (moved, one_ratio),
            *ratios,
            scanned=((p.v_d - p.acc_ref, one_ratio), *ratios),
            note=f"{left} The equal ratios are the reading appendix-a.",
            correction=plain,
        ),
        "A5": _form((d.f, (d.mu - 1) * p.acc_ref)),
        "A6": _form((d.E_s, p.s * (p.s + g3) / denominator * d.F_s), correction=plain),
        "A7": _form(
            (d.mu, g3**2 * g0 / (g1 * (g3 * g2 - g1))),
            (d.mu, PRINTED_BOUND),
            note=_note_on_the_bound,
            correction=lambda: f"{plain}{_bound_at_one()} at zeta = 1, from ",
            at={p.zeta: sp.Integer(1)},
        ),
    }


def _bound_at_one() -> Expr:
    return proved()["A7"].lines[1].rhs.subs(p.zeta, 1)


def _note_on_the_bound() -> str:
    formula, _ = proved()["A7"].lines
    gammas = dict(zip(GAMMAS[PLAIN], GAMMA, strict=True))
    g0, g1, g2, g3 = GAMMA
    right = d.simplest(formula.rhs.subs(gammas) - g3**2 * g0 / (g1 * (g3 * g2 - g1))) == 0
    return (
        f"With {PLAIN} (A7) as a formula is {'right' if right else 'wrong, too'}; of the number "
        f"{BOUND_TEXT} printed for zeta = 1 is left {PRINTED_BOUND - _bound_at_one()}."
    )
