from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import pytest
from rigs import MINIMAL, rig_with

from maglev_design.certify.lyapunov.family import Subject, claim, state_names, subject
from maglev_design.certify.rationals import decimal
from maglev_design.choices import Controller
from maglev_design.design import PoleSpec, make_design
from maglev_design.errors import InputError
from maglev_design.parameters import Rig, load_rig

PAPER = load_rig("belmonte2021")


def subject_of(rig: Rig, **options: Any) -> Subject:
    return subject(make_design(rig, PoleSpec.double(1.1371, 107.346), **options), rig)


def test_the_numbers_of_the_rig_are_the_decimals_and_the_gains_the_doubles() -> None:
    of = subject_of(PAPER)
    assert of.force_constant == Fraction("2.48315625e-5")
    assert (of.period, of.delay) == (Fraction("0.001"), Fraction(0))
    assert of.voltage is None
    assert [float(k) for k in of.gains] == list(
        make_design(PAPER, PoleSpec.double(1.1371, 107.346)).gains
    )
    assert all(k.denominator & (k.denominator - 1) == 0 for k in of.gains)  # a power of two
    assert decimal(0.1) == Fraction(1, 10)


def test_a_delay_is_whole_periods_and_a_part() -> None:
    of = subject_of(rig_with(MINIMAL, {"sampling.delay": 0.0023}))
    assert (of.whole, of.part) == (2, Fraction("0.0003"))


def test_the_default_gaps_are_the_hull_of_path_initial_gap_and_Y() -> None:
    over = claim(PAPER, "sampled", Fraction(15, 100))
    assert over.gaps == (Fraction("0.012"), Fraction("0.0246"))
    assert over.ratios == (Fraction("0.85"), Fraction("1.15"))


@pytest.mark.parametrize(
    ("delay", "held"), [(0.0, 0), (0.0004, 1), (0.001, 1), (0.0014, 2), (0.002, 2)]
)
def test_the_loop_remembers_the_voltages_that_still_act(delay: float, held: int) -> None:
    of = subject_of(rig_with(MINIMAL, {"sampling.delay": delay}))
    assert state_names(of, "sampled")[4:] == ("b1", "b2")[:held]
    assert len(state_names(of, "continuous")) == 4


def test_another_controller_is_refused() -> None:
    with pytest.raises(InputError, match="tan-gpi"):
        subject_of(PAPER, controller=Controller("lin-pid"))


def test_a_design_for_another_beta_is_refused() -> None:
    with pytest.raises(InputError, match="ratios count from the rig's beta"):
        subject_of(PAPER, beta_c=1.5e-3)


def test_an_unbounded_gap_is_refused() -> None:
    with pytest.raises(InputError, match="finite"):
        claim(PAPER, "continuous", Fraction(0), (0.01, math.inf))
