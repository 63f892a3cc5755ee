"""Formulas in textbook order: the same formulas, in the order that is promised."""

from __future__ import annotations

import re
from collections import Counter

import pytest
import sympy as sp

from maglev_design.derivation import NOTATION, Equation
from maglev_design.derivation import terms as d
from maglev_design.reporting.formulas import ORDERS, latex, ordered_terms
from maglev_design.symbolic import plant as p

NAMES = {entry.symbol: entry.latex for entry in NOTATION}


def test_no_letter_number_or_sign_is_lost_or_added(derived: tuple[Equation, ...]) -> None:
    lines = [line for equation in derived for line in equation.lines]
    assert len(lines) > 100
    for side in (side for line in lines for side in (line.lhs, line.rhs)):
        ours, theirs = latex(side, NAMES), sp.latex(side, symbol_names=NAMES)
        counted = [Counter(re.findall(r"\\[a-z]+|\w|[-^]", text)) for text in (ours, theirs)]
        assert counted[0] == counted[1], (ours, theirs)


@pytest.mark.parametrize(
    ("expression", "written"),
    [
        (p.k0 + p.s * p.k1 + p.s**2, "s^{2} + k_1 s + k_0"),
        (p.e * p.k2 + d.e1 * p.k3 + d.int_e * p.k1 + d.e2, None),
        (p.k2 * p.k3 - p.k1, "k_2 k_3 - k_1"),
        (-(p.y + p.Y), r"- Y - y"),
        (-p.C_U * (p.y + p.Y) / p.k0, r"- \frac{C_U \left(Y + y\right)}{k_0}"),
        (-p.C_U * p.u / 3, r"- \frac{C_U u}{3}"),
        ((p.z - 1) / p.T, r"\frac{z - 1}{T}"),
        (sp.Integer(0), "0"),
    ],
)
def test_the_order_is_a_textbooks(expression: sp.Expr, written: str | None) -> None:
    expected = written or (r"\ddot{e} + k_3 \dot{e} + k_2 e + k_1 \bigl(\int_0^t e\,d\sigma\bigr)")
    assert latex(expression, NAMES) == expected


def test_every_name_of_what_moves_is_a_letter_of_the_derivation() -> None:
    assert set(ORDERS) <= {symbol.name for symbol in NAMES}


def test_the_terms_of_a_sum_are_the_sum() -> None:
    total = p.s**2 - p.C_Y * p.s + 3 * p.k0
    assert sp.Add(*ordered_terms(total)) == total
    assert ordered_terms(total)[0] == p.s**2
