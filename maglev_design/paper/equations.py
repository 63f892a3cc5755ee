"""Every numbered equation of the paper held against the derivation, letter by letter.

The derivation proves its own forms. What is left of a printed one once the derived one is
subtracted decides the verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import partial

import sympy as sp
from sympy import Expr

from maglev_design.derivation import Equation, Line
from maglev_design.derivation import terms as d
from maglev_design.paper.ledger import Finding, Value, claim, finding
from maglev_design.paper.printed import (
    GAMMA,
    GAMMAS,
    INSIDE,
    OF_THE_TEXT,
    PLAIN,
    PRINTED_BETA,
    PRINTED_PARAMETERS,
    Printed,
    Text,
    printed_forms,
    proved,
)
from maglev_design.symbolic import plant as p

LONGEST_SHOWN = 120
"""Characters of a difference that is quoted whole."""


def judge_number(number: str) -> Finding:
    """Judge an equation by its number."""
    judge = judge_beta if number == "26" else judge_form
    return judge(proved()[number], printed_forms()[number])


for _number in printed_forms():
    claim(f"eq-{_number}")(partial(judge_number, _number))


def judge_form(equation: Equation, printed: Printed) -> Finding:
    """Judge a printed form by what is left of it minus the derived form."""
    readings = OF_THE_TEXT if printed.in_gammas else ("",)
    left = {reading: left_over(equation, printed, reading) for reading in readings}
    evidence = _evidence(equation, left)
    if printed.in_gammas:
        left |= {reading: left_over(equation, printed, reading) for reading in (PLAIN, INSIDE)}
        evidence += "".join(
            f" With {reading} nothing is left." for reading in (PLAIN, INSIDE) if left[reading] == 0
        )
    values: dict[str, Value] = {
        f"printed_residual{f' ({reading})' if reading else ''}": str(rest)
        for reading, rest in left.items()
    }
    if printed.scanned:
        scanned = Printed(printed.scanned, at=printed.at)
        literal = left_over(equation, scanned, PLAIN)
        values["scan_residual"] = str(literal)
        evidence += f" The scan, dot by dot, would leave {_shown(literal)}."
    return finding(
        any(left[reading] == 0 for reading in readings)
        if equation.residual == 0
        else "not-checkable",
        " ".join(part for part in (evidence, _words(printed.note)) if part),
        _correction(equation, printed),
        residual=str(equation.residual),
        **values,
    )


def judge_beta(equation: Equation, printed: Printed) -> Finding:
    """Judge (26): formula, unit and the number to all its printed digits."""
    rest = left_over(equation, printed, "")
    numbers = {letter: sp.Rational(digits) for letter, digits in PRINTED_PARAMETERS.items()}
    exact = Fraction(str(equation.lines[0].rhs.subs(numbers)))
    half_a_digit = Fraction(1, 2 * 10 ** len(PRINTED_BETA.partition(".")[2]))
    rounds = abs(exact - Fraction(PRINTED_BETA)) <= half_a_digit
    return finding(
        equation.residual == 0 and rest == 0 and rounds,
        f"The printed m, C and K give {float(exact):.9g} m^3/(s^2 V^2) exactly computed, "
        f"which {'rounds' if rounds else 'does not round'} to the printed digits; the unit "
        f"is the same, derivation (26), residual {equation.residual}.",
        f"beta = {float(exact):.9g} m^3/(s^2 V^2)",
        beta=float(exact),
        printed=float(PRINTED_BETA),
        residual=str(rest),
    )


def left_over(equation: Equation, printed: Printed, reading: str) -> Expr:
    """Return the first row's printed minus derived form that is not zero, else zero.

    `reading` names what the gammas are, one of :data:`GAMMAS`; equations without them ignore it.
    """
    gammas = dict(zip(GAMMA, GAMMAS.get(reading, GAMMA), strict=True))
    for (lhs, rhs, *_), line in zip(printed.rows, _lines(equation, printed), strict=True):
        difference = (rhs - lhs).subs(gammas) - (line.rhs - line.lhs)
        rest = d.simplest(_expanded(difference).subs(printed.at).subs(p.y0, 0))
        if rest != 0:
            return sp.factor(rest)
    return sp.Integer(0)


def _lines(equation: Equation, printed: Printed) -> list[Line]:
    """Return the derivation's line for every printed row."""
    return [equation.lines[row[2] if len(row) > 2 else n] for n, row in enumerate(printed.rows)]


def _expanded(expression: Expr) -> Expr:
    """Return `expression` with the letters that another equation defines written out."""
    slopes = {line.lhs: line.rhs for line in proved()["8"].lines[1:]}
    rest = {d.R: proved()["A2"].lines[2].rhs}
    return expression.subs(slopes | rest)


def _evidence(equation: Equation, left: Mapping[str, Expr]) -> str:
    where = f"Derivation ({equation.id})"
    if equation.residual is None:
        return (
            "A model is a postulate: nothing stands before it from which it could be derived; "
            f"only a measurement on the rig can refute it. {where} takes it over as printed."
        )
    if equation.residual != 0:
        return f"{where} is not proved: it leaves {equation.residual}."
    found = "; ".join(
        f"printed minus derived form{f' with the gammas of {reading}' if reading else ''}: "
        f"{_shown(rest)}"
        for reading, rest in left.items()
    )
    return f"{where}, residual {equation.residual}; {found}."


def _shown(rest: Expr) -> str:
    """Return a difference as text; of a long fraction how much does not cancel."""
    whole = str(rest)
    if len(whole) <= LONGEST_SHOWN:
        return whole
    numerator, _ = sp.fraction(rest)
    terms = max(len(sp.Add.make_args(part)) for part in sp.Mul.make_args(numerator))
    return f"a fraction with {terms} terms in its numerator, none of which cancel"


def _correction(equation: Equation, printed: Printed) -> str:
    """Return the derived form without the gap offset, which the paper does not have."""
    lines = _lines(equation, printed)
    if any(line.rhs.has(d.R) for line in lines):
        lines.append(proved()["A2"].lines[2])
    forms = [f"{x.lhs.subs(p.y0, 0)} {x.relation} {x.rhs.subs(p.y0, 0)}" for x in lines]
    return _words(printed.correction) + "; ".join(dict.fromkeys(forms))


def _words(text: Text) -> str:
    return text if isinstance(text, str) else text()
