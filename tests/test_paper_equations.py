"""The numbered equations: every verdict computed, and different when the print is."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

from maglev_design.derivation import terms as d
from maglev_design.paper import equations, printed
from maglev_design.paper.equations import judge_beta, judge_form, left_over
from maglev_design.paper.ledger import JUDGES, Claim, statements
from maglev_design.paper.printed import (
    BOUND_TEXT,
    GAMMA,
    GAMMAS,
    INSIDE,
    OF_THE_TEXT,
    PLAIN,
    PRINTED_BOUND,
    Printed,
    Row,
    printed_forms,
    proved,
)
from maglev_design.symbolic import plant as p

IDS = [*(f"eq-{n}" for n in range(1, 30)), *(f"eq-A{n}" for n in range(1, 8))]
SAID_IN_THE_DERIVATION = {
    "A1": "Corrected",
    "A2": "Corrected",
    "A7": "Corrected",
    "24": "lacks its `s`",
    "21": "where that of the error stands",
}
"""Misprints, with the words of the derivation's reason that say so."""
BY_THEIR_GAMMAS = {"A3", "A4", "A6"}
"""Right but for the gammas, which the reason of (A2) corrects for (A2) to (A7)."""
SCAN_ONLY = {"10", "18", "20"}
"""The derivation says that the scan lost dots; nothing else is wrong."""


@pytest.fixture(scope="module")
def claims() -> dict[str, Claim]:
    return {name: JUDGES[name]() for name in IDS}


def test_every_equation_has_one_claim_in_order() -> None:
    assert [f"eq-{number}" for number in printed_forms()] == IDS
    assert list(statements())[: len(IDS)] == IDS


@pytest.mark.parametrize("number", [n for n in printed_forms() if n != "26"])
def test_what_is_stated_is_the_printed_form_under_its_name(number: str) -> None:
    equation, own = proved()[number], printed_forms()[number]
    sign = {"9": "~", "A7": ">"}.get(number, "=")
    rows = "; ".join(f"{row[0]} {sign} {row[1]}" for row in own.rows)
    expected = f"{equation.title}: {rows}.".replace(str(PRINTED_BOUND), BOUND_TEXT)
    assert statements()[f"eq-{number}"].statement == expected


def test_the_printed_numbers_stand_in_the_statements() -> None:
    said = {name: own.statement for name, own in statements().items()}
    assert f"= {printed.PRINTED_BETA} N m^2/(kg V^2)" in said["eq-26"]
    assert f"beta/beta_c > {BOUND_TEXT}." in said["A-bound"]


def test_only_the_postulates_cannot_be_checked(claims: dict[str, Claim]) -> None:
    open_ones = {claim.id for claim in claims.values() if claim.verdict == "not-checkable"}
    assert open_ones == {"eq-1", "eq-2"}
    assert all("postulate" in claims[number].evidence for number in open_ones)


def test_what_the_derivation_corrects_is_corrected_and_nothing_else(
    claims: dict[str, Claim],
) -> None:
    corrected = {claim.id[3:] for claim in claims.values() if claim.verdict == "corrected"}
    assert corrected == set(SAID_IN_THE_DERIVATION) | BY_THEIR_GAMMAS
    for number, words in SAID_IN_THE_DERIVATION.items():
        assert words in proved()[number].reason
    assert "(A2) to (A7)" in proved()["A2"].reason
    says = {number for number in claims if "Corrected" in proved()[number[3:]].reason}
    assert says == {"eq-A1", "eq-A2", "eq-A7"}


def test_lost_dots_make_no_correction(claims: dict[str, Claim]) -> None:
    for number in SCAN_ONLY:
        assert re.search(r"[Ss]can", proved()[number].reason)
        assert claims[f"eq-{number}"].verdict == "verified"
        assert "scan" in claims[f"eq-{number}"].evidence
    assert claims["eq-10"].values["scan_residual"] == "acc_d - v_d"


def test_a_correction_is_there_exactly_where_one_is_needed(claims: dict[str, Claim]) -> None:
    for claim in claims.values():
        assert bool(claim.correction) == (claim.verdict == "corrected")
        assert claim.command == "maglev-design derive"
        assert claim.statement.endswith(".")
        assert claim.evidence.endswith(".")
        assert "y0" not in claim.statement + claim.correction  # the paper has no offset


@pytest.mark.parametrize("number", [n for n in printed_forms() if n not in {"1", "2", "26"}])
def test_a_changed_print_changes_the_verdict(number: str) -> None:
    """Twice the right side of the last line that has one: no printed form stays right."""
    own = printed_forms()[number]
    if number in SAID_IN_THE_DERIVATION or number in BY_THEIR_GAMMAS:
        own = _as_corrected(number, own)
    assert judge_form(proved()[number], own).verdict == "verified"
    rows = list(own.rows)
    place = max(n for n, row in enumerate(rows) if row[1] != 0 or row[0] != row[1])
    lhs, rhs, *rest = rows[place]
    rows[place] = (lhs, 2 * rhs + p.g, *rest)
    spoilt = judge_form(proved()[number], replace(own, rows=tuple(rows)))
    assert spoilt.verdict == "corrected"
    assert spoilt.correction
    assert spoilt.values["printed_residual"] != "0"


def _as_corrected(number: str, printed: Printed) -> Printed:
    lines = proved()[number].lines
    rows = [(lines[_place(row, n)], _place(row, n)) for n, row in enumerate(printed.rows)]
    return replace(printed, rows=tuple((line.lhs, line.rhs, n) for line, n in rows), scanned=())


def _place(row: Row, own: int) -> int:
    return own if len(row) == 2 else row[2]


def test_a_missing_s_is_what_is_wrong_with_24(claims: dict[str, Claim]) -> None:
    equation, printed = proved()["24"], printed_forms()["24"]
    lhs, rhs, *_ = printed.rows[0]
    restored = rhs.subs(2 * p.zeta * p.omega_n, 2 * p.zeta * p.omega_n * p.s)
    assert judge_form(equation, replace(printed, rows=((lhs, restored),))).verdict == "verified"
    rest = sp.sympify(
        str(claims["eq-24"].values["printed_residual"]),
        locals={"s": p.s, "zeta": p.zeta, "omega_n": p.omega_n},
    )
    assert rest.subs(p.s, 1) == 0  # the only frequency at which nobody would notice


def test_21_is_wrong_by_the_reference_acceleration() -> None:
    rest = left_over(proved()["21"], printed_forms()["21"], "")
    assert sp.expand(rest.subs(p.acc_d, d.e2 + p.acc_ref) + p.acc_ref) == 0


def test_the_gammas_that_make_the_appendix_right() -> None:
    forms = printed_forms()
    for number in sorted(BY_THEIR_GAMMAS):
        assert left_over(proved()[number], forms[number], PLAIN) == 0
        for reading in OF_THE_TEXT:
            assert left_over(proved()[number], forms[number], reading) != 0
    assert left_over(proved()["A1"], forms["A1"], INSIDE) == 0
    assert left_over(proved()["A1"], forms["A1"], PLAIN) != 0
    assert all(left_over(proved()["A2"], forms["A2"], reading) != 0 for reading in GAMMAS)


def test_right_gammas_in_the_text_would_verify_the_appendix(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    repaired = dict(GAMMAS) | {printed.BELOW_A6: GAMMAS[PLAIN]}
    monkeypatch.setattr(equations, "GAMMAS", repaired)
    for number in sorted(BY_THEIR_GAMMAS):
        assert judge_form(proved()[number], printed_forms()[number]).verdict == "verified"


def test_the_text_defines_gamma_1_twice_and_differently() -> None:
    first, second = (GAMMAS[reading] for reading in OF_THE_TEXT)
    assert [x == y for x, y in zip(first, second, strict=True)] == [True, False, True, True]


def test_the_printed_bound_is_not_the_derived_one(claims: dict[str, Claim]) -> None:
    assert "237/1315" in claims["eq-A7"].evidence  # 100/263 - 1/5 by hand
    assert "1/5 at zeta = 1" in claims["eq-A7"].correction
    assert "1/2.63" in claims["eq-A7"].statement
    printed = printed_forms()["A7"]
    formula = replace(printed, rows=printed.rows[:1])
    assert left_over(proved()["A7"], formula, PLAIN) == 0


def test_a7_fails_by_its_number_when_the_gammas_are_right() -> None:
    rest = left_over(proved()["A7"], printed_forms()["A7"], PLAIN)
    assert rest == sp.Rational(237, 1315)


def test_beta_is_computed_from_the_printed_parameters(
    claims: dict[str, Claim], monkeypatch: pytest.MonkeyPatch
) -> None:
    by_hand = Fraction("2.48315625e-5") * Fraction("1.05") ** 2 / Fraction("0.02")
    assert claims["eq-26"].values["beta"] == float(by_hand)
    monkeypatch.setattr(equations, "PRINTED_BETA", "0.00136885")
    assert judge_beta(proved()["26"], printed_forms()["26"]).verdict == "corrected"


def test_an_unproved_derivation_verifies_nothing() -> None:
    broken = replace(proved()["11"], checks=(p.C_U,))
    claim = judge_form(broken, printed_forms()["11"])
    assert claim.verdict == "not-checkable"
    assert "not proved" in claim.evidence


def test_printed_forms_in_numbers() -> None:
    """The transcription against figures that need no algebra: (20), (25) and (28) at a point."""
    forms = printed_forms()
    rng = np.random.default_rng(11)
    letters = (p.C_U, p.C_Y, p.k0, p.k1, p.k2, p.k3, p.e, d.int_e, d.iint_e, d.v_hat, p.v_ref)
    numbers = dict(zip((*letters, d.u_dr), rng.uniform(0.5, 2.0, 12), strict=True))
    cu, cy, k0, k1, k2, k3, e, ie, iie, v, vr, ur = numbers.values()
    law = float(forms["20"].rows[0][1].subs(numbers))
    assert law == pytest.approx(ur + (k3 * (v - vr) + (k2 + cy) * e + k1 * ie + k0 * iie) / cu)
    gains = [float(row[1].subs({p.zeta: 1, p.omega_n: 70})) for row in forms["25"].rows]
    assert [1, *gains] == list(np.poly([-70] * 4))
    assert all(letter not in forms["20"].rows[0][1].free_symbols for letter in GAMMA)
    series = forms["28"].rows[0][1]
    values = {r: row[1] for r, row in zip(d.r, forms["29"].rows, strict=True)}
    tau = next(iter(series.free_symbols - set(d.r)))
    assert series.subs(values).subs(tau, 1) == 1
    assert sp.diff(series.subs(values), tau).subs(tau, 1) == 0
