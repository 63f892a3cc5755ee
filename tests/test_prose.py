"""Sentences with formulas: the letters as the derivation prints them."""

from __future__ import annotations

import re

import pytest

from maglev_design.derivation import NOTATION, Equation
from maglev_design.reporting.content import Maths
from maglev_design.reporting.prose import formula, latex, markdown, plain, runs
from maglev_design.rig import fields

SPELLED = re.compile(r"[A-Za-z]+\d*(_[A-Za-z0-9]+)*\*?(\(s\))?")
SPOKEN_OTHERWISE = {
    "v": "a velocity is written with its dot",
    "acc": "an acceleration is written with its dots",
    "u_coil": "the current stands for a voltage",
    "u_rest": "a bar",
    "margin": "a name in words",
    **{f"{end}_{of}": "a bar or an index" for end in ("start", "end") for of in ("gap", "time")},
    **dict.fromkeys(("v_d", "acc_d", "v_ref", "acc_ref", "y_ref", "v_d_hat"), "dots and a star"),
    **dict.fromkeys(("C_U_true", "C_Y_true"), "a prime"),
}
"""Names of the program for letters that a sentence calls by another name."""


@pytest.mark.parametrize(
    "entry",
    [
        pytest.param(entry, id=str(entry.symbol))
        for entry in NOTATION
        if SPELLED.fullmatch(str(entry.symbol)) and str(entry.symbol) not in SPOKEN_OTHERWISE
    ],
)
def test_a_letter_in_a_sentence_is_the_letter_of_the_formulas(entry: object) -> None:
    assert formula(str(entry.symbol)) == entry.latex  # type: ignore[attr-defined]


def sentences(derived: tuple[Equation, ...]) -> list[str]:
    reasons = [equation.reason for equation in derived]
    meanings = [entry.meaning for entry in NOTATION]
    return [*reasons, *meanings, *(meaning for _, _, meaning in fields())]


def test_every_formula_of_a_sentence_is_closed_and_none_is_left_as_words(
    derived: tuple[Equation, ...],
) -> None:
    unmarked = re.compile(r"[A-Za-z]_[A-Za-z]|\b(beta|rho|tau|phi|k\d|a\d)\b|\(s\)")
    for sentence in sentences(derived):
        assert sentence.count("`") % 2 == 0, sentence
        words = " ".join(str(run) for run in runs(sentence) if not isinstance(run, Maths))
        assert not unmarked.search(words), sentence


def test_a_sentence_in_every_form() -> None:
    sentence = "Near `U*`: 5 % of `C_U_hat`, *not* `1/(4 zeta^2 + 1)`."
    assert plain(sentence) == "Near U*: 5 % of C_U_hat, *not* 1/(4 zeta^2 + 1)."
    assert latex(sentence) == r"Near $U^*$: 5 \% of $\hat{C}_U$, *not* $1/(4 \zeta^2 + 1)$."
    assert markdown(sentence) == (
        r"Near $U^{\ast}$: 5 % of $\hat{C}_U$, \*not\* $1/(4 \zeta^2 + 1)$."
    )
    assert [type(run).__name__ for run in runs("`a` and `b`")] == ["Maths", "str", "Maths"]
