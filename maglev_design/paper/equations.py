"""Every numbered equation of the paper held against the derivation, letter by letter.

The printed forms stand here by hand; the derivation proves its own. What is left of a printed
form once the derived one is subtracted decides the verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache

import sympy as sp
from sympy import Expr, Symbol

from maglev_design.derivation import Equation, Line, derivation
from maglev_design.derivation import terms as d
from maglev_design.paper.ledger import Claim, Value, Verdict, judged
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as ref

COMMAND = "maglev-design derive"

NUMBERED = (*(str(n) for n in range(1, 30)), *(f"A{n}" for n in range(1, 8)))

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

LONGEST_SHOWN = 120
"""Characters of a difference that is quoted whole."""

Row = tuple[Expr, Expr] | tuple[Expr, Expr, int]
"""Left side, right side and, where it is not the row's own place, the derivation's line."""


@dataclass(frozen=True)
class Printed:
    """An equation as the paper has it.

    Attributes
    ----------
    rows : tuple of Row
        The lines, lost dots restored.
    scanned : tuple of Row
        The lines as the scan shows them, where a lost dot can be written down at all.
    note : str
        What the scan cannot tell, or what else is printed oddly.
    correction : str
        Said in front of the derived form where the equation is wrong.
    at : mapping of Symbol to Expr
        For which values the printed form is meant.
    """

    rows: tuple[Row, ...]
    scanned: tuple[Row, ...] = ()
    note: str = ""
    correction: str = ""
    at: Mapping[Symbol, Expr] = field(default_factory=dict)

    @property
    def in_gammas(self) -> bool:
        """Whether the letters of Appendix A stand in it."""
        return any(side.has(*GAMMA) for row in self.rows for side in row[:2])


@cache
def proved() -> Mapping[str, Equation]:
    """Return the equations of the derivation by id, derived once a process."""
    return {equation.id: equation for equation in derivation()}


def text(line: Line) -> str:
    """Return a line of the derivation without the gap offset, which the paper does not have."""
    return f"{line.lhs.subs(p.y0, 0)} {line.relation} {line.rhs.subs(p.y0, 0)}"


def equation_claims() -> tuple[Claim, ...]:
    """Return one claim for each of (1)-(29) and (A1)-(A7), in this order.

    Examples
    --------
    >>> [claim.id for claim in equation_claims() if claim.verdict == "not-checkable"]
    ['eq-1', 'eq-2']
    """
    forms = printed_forms()
    return tuple(
        number_claim(proved()["26"], forms["26"])
        if number == "26"
        else claim_of(proved()[number], forms[number])
        for number in NUMBERED
    )


def claim_of(equation: Equation, printed: Printed) -> Claim:
    """Return the verdict on a printed form, from what is left of it minus the derived form."""
    readings = OF_THE_TEXT if printed.in_gammas else ("",)
    left = {reading: left_over(equation, printed, reading) for reading in readings}
    verdict, evidence = _decided(equation, left)
    values: dict[str, Value] = {"residual": str(equation.residual)}
    values |= {
        f"printed_residual{f' ({reading})' if reading else ''}": str(rest)
        for reading, rest in left.items()
    }
    if printed.in_gammas:
        for reading in (PLAIN, INSIDE):
            rest = left_over(equation, printed, reading)
            values[f"printed_residual ({reading})"] = str(rest)
            evidence += f" With {reading} nothing is left." if rest == 0 else ""
    if printed.scanned:
        literal = left_over(equation, Printed(printed.scanned, at=printed.at), PLAIN)
        values["scan_residual"] = str(literal)
        evidence += f" The scan, dot by dot, would leave {_shown(literal)}."
    wrong = verdict == "corrected"
    return Claim(
        id=f"eq-{equation.id}",
        place=f"eq. ({equation.id})",
        statement=_statement(equation, printed),
        verdict=verdict,
        correction=_correction(equation, printed) if wrong else "",
        evidence=" ".join(part for part in (evidence, printed.note) if part),
        command=COMMAND,
        values=values,
    )


def number_claim(equation: Equation, printed: Printed) -> Claim:
    """Return the verdict on (26): formula, unit and the number to all its printed digits."""
    rest = left_over(equation, printed, "")
    numbers = {letter: sp.Rational(digits) for letter, digits in PRINTED_PARAMETERS.items()}
    exact = Fraction(str(equation.lines[0].rhs.subs(numbers)))
    half_a_digit = Fraction(1, 2 * 10 ** len(PRINTED_BETA.partition(".")[2]))
    rounds = abs(exact - Fraction(PRINTED_BETA)) <= half_a_digit
    holds = equation.residual == 0 and rest == 0 and rounds
    correction = "" if holds else f"beta = {float(exact):.9g} m^3/(s^2 V^2)"
    return Claim(
        id="eq-26",
        place="eq. (26)",
        statement=f"beta = K C^2/m = {PRINTED_BETA} N m^2/(kg V^2).",
        verdict=judged(holds=holds, correction=correction),
        correction=correction,
        evidence=(
            f"The printed m, C and K give {float(exact):.9g} m^3/(s^2 V^2) exactly computed, "
            f"which {'rounds' if rounds else 'does not round'} to the printed digits; the unit "
            f"is the same, derivation (26), residual {equation.residual}."
        ),
        command=COMMAND,
        values={"beta": float(exact), "printed": float(PRINTED_BETA), "residual": str(rest)},
    )


def left_over(equation: Equation, printed: Printed, reading: str) -> Expr:
    """Return the first row's printed minus derived form that is not zero, else zero.

    `reading` names what the gammas are, one of :data:`GAMMAS`; equations without them ignore it.
    """
    gammas = dict(zip(GAMMA, GAMMAS.get(reading, GAMMA), strict=True))
    for place, (lhs, rhs, *which) in enumerate(printed.rows):
        line = equation.lines[which[0] if which else place]
        difference = (rhs - lhs).subs(gammas) - (line.rhs - line.lhs)
        rest = d.simplest(_expanded(difference).subs(printed.at).subs(p.y0, 0))
        if rest != 0:
            return sp.factor(rest)
    return sp.Integer(0)


def _expanded(expression: Expr) -> Expr:
    """Return `expression` with the letters that another equation defines written out."""
    slopes = {line.lhs: line.rhs for line in proved()["8"].lines[1:]}
    rest = {d.R: proved()["A2"].lines[2].rhs}
    return expression.subs(slopes | rest)


def _decided(equation: Equation, left: Mapping[str, Expr]) -> tuple[Verdict, str]:
    where = f"Derivation ({equation.id})"
    if equation.residual is None:
        why = (
            "A model is a postulate: nothing stands before it from which it could be derived; "
            "only a measurement on the rig can refute it."
        )
        return "not-checkable", f"{why} {where} takes it over as printed."
    if equation.residual != 0:
        return "not-checkable", f"{where} is not proved: it leaves {equation.residual}."
    found = "; ".join(
        f"printed minus derived form{f' with the gammas of {reading}' if reading else ''}: "
        f"{_shown(rest)}"
        for reading, rest in left.items()
    )
    holds = any(rest == 0 for rest in left.values())
    return judged(holds=holds, correction="see"), f"{where}, residual {equation.residual}; {found}."


def _shown(rest: Expr) -> str:
    """Return a difference as text; of a long fraction how much does not cancel."""
    whole = str(rest)
    if len(whole) <= LONGEST_SHOWN:
        return whole
    numerator, _ = sp.fraction(rest)
    terms = max(len(sp.Add.make_args(part)) for part in sp.Mul.make_args(numerator))
    return f"a fraction with {terms} terms in its numerator, none of which cancel"


def _statement(equation: Equation, printed: Printed) -> str:
    signs = [equation.lines[_place(row, n)].relation for n, row in enumerate(printed.rows)]
    rows = [f"{row[0]} {sign} {row[1]}" for row, sign in zip(printed.rows, signs, strict=True)]
    return f"{equation.title}: {'; '.join(rows)}.".replace(str(PRINTED_BOUND), BOUND_TEXT)


def _correction(equation: Equation, printed: Printed) -> str:
    lines = [equation.lines[_place(row, n)] for n, row in enumerate(printed.rows)]
    if any(line.rhs.has(d.R) for line in lines):
        lines.append(proved()["A2"].lines[2])
    return printed.correction + "; ".join(dict.fromkeys(text(line) for line in lines))


def _place(row: Row, own: int) -> int:
    return own if len(row) == 2 else row[2]


def printed_forms() -> dict[str, Printed]:
    """Return what the paper prints, by number."""
    return _model() | _linear_plant() | _control() | _gains_and_path() | _appendix()


def _model() -> dict[str, Printed]:
    force = p.beta * p.u**2 / p.y**2
    rest = -p.g + p.beta * p.U**2 / p.Y**2
    first = d.F_acc * p.acc_d + d.F_y * p.y_d + d.F_u * p.u_d
    doubled = "The index delta stands twice on the left of the printed form; nothing hangs on it."
    return {
        "1": Printed(((p.m * p.acc, p.m * p.g - p.K * p.i**2 / p.y**2),)),
        "2": Printed(((p.i, p.C * p.u),)),
        "3": Printed(((p.acc, p.g - p.K * p.C**2 / p.m * p.u**2 / p.y**2),)),
        "4": Printed(((p.acc, p.g - force), (p.beta, p.K * p.C**2 / p.m))),
        "5": Printed(
            ((p.y, p.Y), (p.acc, sp.Integer(0)), (p.U, sp.sqrt(p.g / p.beta) * p.Y)),
        ),
        "6": Printed(((d.F, p.acc - p.g + force), (d.F, sp.Integer(0)))),
        "7": Printed(((d.F_0, rest), (d.F_0, sp.Integer(0)))),
        "8": Printed(((d.F_moved, d.F_0 + first + d.second_order),), note=doubled),
        "9": Printed(((d.F_moved, first),), note=doubled),
    }


def _linear_plant() -> dict[str, Printed]:
    motion = -p.C_U * p.u_d + p.C_Y * p.y_d
    coefficients = (
        (p.C_U, 2 * p.beta * p.U / p.Y**2),
        (p.C_Y, 2 * p.beta * p.U**2 / p.Y**3),
    )
    return {
        "10": Printed(
            ((p.acc_d, motion), *coefficients),
            scanned=((p.v_d, motion), *coefficients),
            note="One dot on the left decides, and the scan loses dots; it is read as the second "
            "derivative, as (11) and (12) have it.",
        ),
        "11": Printed(((p.u_d, -p.acc_d / p.C_U + p.C_Y / p.C_U * p.y_d),)),
        "12": Printed(((p.acc_ref, -p.C_U * d.u_dr + p.C_Y * d.y_dr),)),
        "13": Printed(((d.e2 - p.C_Y * p.e, -p.C_U * (p.u_d - d.u_dr)),)),
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
        "14": Printed(((p.u_d, d.u_dr - feedback / p.C_U),)),
        "15": Printed(((d.e3 + p.k3 * d.e2 + p.k2 * d.e1 + p.k1 * p.e, sp.Integer(0)),)),
        "16": Printed(
            ((d.poly_3, p.s**3 + p.k3 * p.s**2 + p.k2 * p.s + p.k1),),
            note="The exponent is printed like an order of derivation, (3); it is a power.",
        ),
        "17": Printed(((p.v_d, integral + d.v_0),)),
        "18": Printed((estimate,), note=hat),
        "19": Printed(((p.v_d, d.v_hat + d.v_0),), note=hat),
        "20": Printed(
            (law, (d.u_dr, -(p.acc_ref - p.C_Y * d.y_dr) / p.C_U), estimate),
            scanned=(law, (d.u_dr, -(p.v_ref - p.C_Y * d.y_dr) / p.C_U), estimate),
            note=f"The dot missing in the second line the scan may have lost: (12) has it. {hat}",
        ),
        "21": Printed(
            ((p.acc_d + loop, p.k3 * d.v_0),),
            correction="for the linear plant (10) in place of (4): ",
            note=_remainder_of_the_plant(),
        ),
        "22": Printed(
            ((d.e4 + p.k3 * d.e3 + p.k2 * d.e2 + p.k1 * d.e1 + p.k0 * p.e, sp.Integer(0)),),
        ),
        "23": Printed(((d.poly, p.s**4 + p.k3 * p.s**3 + p.k2 * p.s**2 + p.k1 * p.s + p.k0),)),
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
        "24": Printed(((d.poly_des, desired),), note="The s of the middle term is missing."),
        "25": Printed(
            (
                (p.k3, 4 * p.zeta * p.omega_n),
                (p.k2, 4 * p.zeta**2 * p.omega_n**2 + 2 * p.omega_n**2),
                (p.k1, 4 * p.zeta * p.omega_n**3),
                (p.k0, p.omega_n**4),
            ),
        ),
        "26": Printed(((p.beta, p.K * p.C**2 / p.m),)),
        "27": Printed(
            ((p.y_ref, ref.start_gap + (ref.end_gap - ref.start_gap) * d.phi),),
            note="(27) and (28) list the arguments of phi in different orders.",
        ),
        "28": Printed(
            (
                (d.phi, series),
                (ref.tau, (p.t - ref.start_time) / (ref.end_time - ref.start_time)),
            ),
        ),
        "29": Printed(
            tuple((r, sp.Integer(number)) for r, number in zip(d.r, PRINTED_STEP, strict=True)),
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
    ratios = (
        (gain, d.mu),
        (p.C_Y / p.C_Y_hat, d.mu),
        (d.mu, p.beta / p.beta_c),
    )
    denominator = p.s**4 + g3 * p.s**3 + d.mu * (g2 * p.s**2 + g1 * p.s + g0)
    dots = "Lost dots and hats as in (20) are the scan's."
    left = "The dot missing on the left may be the scan's."
    plain = "gamma_n = k_n in (A2) to (A7): "
    return {
        "A1": Printed(
            (law, (d.u_dr, -(p.acc_ref - p.C_Y_hat * d.y_dr) / p.C_U_hat), estimate),
            note=f"The bracket is already divided by C_U_hat, and gamma_1 names k3 for k1. {dots}",
            correction="gamma_3 = k3, gamma_2 = k2 + C_Y_hat, gamma_1 = k1, gamma_0 = k0: ",
        ),
        "A2": Printed(
            ((p.u_d, p.C_Y_hat / p.C_U_hat * (p.y_d - p.acc_ref + fraction * p.e), 1),),
            note="C_Y_hat belongs to the increment of the gap alone.",
            correction=plain,
        ),
        "A3": Printed(
            ((moved, two_ratios),),
            scanned=((p.v_d - p.acc_ref, two_ratios),),
            note=left,
            correction=plain,
        ),
        "A4": Printed(
            ((moved, one_ratio), *ratios),
            scanned=((p.v_d - p.acc_ref, one_ratio), *ratios),
            note=f"{left} The equal ratios are the reading appendix-a.",
            correction=plain,
        ),
        "A5": Printed(((d.f, (d.mu - 1) * p.acc_ref),)),
        "A6": Printed(
            ((d.E_s, p.s * (p.s + g3) / denominator * d.F_s),),
            correction=plain,
        ),
        "A7": Printed(
            (
                (d.mu, g3**2 * g0 / (g1 * (g3 * g2 - g1))),
                (d.mu, PRINTED_BOUND),
            ),
            note=_note_on_the_bound(),
            correction=f"{plain}{_bound_at_one()} at zeta = 1, from ",
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
