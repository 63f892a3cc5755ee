from __future__ import annotations

import itertools
import math
from fractions import Fraction
from typing import Any

import pytest
from rigs import MINIMAL, rig_with

from maglev_design.certification.lyapunov.family import ExactSubject, claim, state_names, subject
from maglev_design.certification.rationals import decimal
from maglev_design.controller.design import PoleSpec, make_design
from maglev_design.errors import InputError
from maglev_design.options import EQUILIBRIA, Controller
from maglev_design.rig import Rig, load_rig

PAPER = load_rig("belmonte2021")


def subject_of(rig: Rig, **options: Any) -> ExactSubject:
    return subject(make_design(rig, PoleSpec.double(1.1371, 107.346), **options), rig)


def test_the_numbers_of_the_rig_are_the_decimals_and_the_gains_the_doubles() -> None:
    of = subject_of(PAPER)
    assert (of.period, of.delay, of.gap) == (Fraction("0.001"), Fraction(0), Fraction("0.0246"))
    assert of.gravity == Fraction("9.81")
    believed = make_design(PAPER, PoleSpec.double(1.1371, 107.346)).believed
    assert [float(x) for x in (of.C_U_hat, of.C_Y_hat)] == [believed.C_U, believed.C_Y]
    assert [float(k) for k in of.gains] == list(
        make_design(PAPER, PoleSpec.double(1.1371, 107.346)).gains
    )
    doubles = (*of.gains, *of.coefficients, of.C_U_hat, of.C_Y_hat)
    assert all(k.denominator & (k.denominator - 1) == 0 for k in doubles)  # a power of two
    assert decimal(0.1) == Fraction(1, 10)


def test_a_delay_is_whole_periods_and_a_part() -> None:
    of = subject_of(rig_with(MINIMAL, {"sampling.delay": 0.0023}))
    assert (of.when.whole, of.when.part) == (2, Fraction("0.0003"))


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


def test_the_ratio_counts_from_the_beta_that_the_controller_implies() -> None:
    assert subject_of(PAPER, beta_c=1.5e-3).beta == Fraction("0.0015")
    measured = subject_of(PAPER, equilibrium="measured", voltage=2.0825)
    assert float(measured.beta) == pytest.approx(9.81 * 0.0246**2 / 2.0825**2, rel=1e-15)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("operating_point.gap", 0.02),
        ("sampling.period", 0.002),
        ("limits.voltage", [0.0, 4.0]),
    ],
)
def test_a_design_of_another_rig_is_refused(name: str, value: Any) -> None:
    design = make_design(rig_with(MINIMAL), PoleSpec.double(1, 70))
    with pytest.raises(InputError, match=name):
        subject(design, rig_with(MINIMAL, {name: value}))


def test_an_uncertain_y0_is_covered_and_held_plants_carry_their_ratio() -> None:
    """A point of every plant and gap, against the boxes of the claim."""
    offset = {"plant.gap_offset": 0.001, "uncertainty.gap_offset": [0.0, 0.003]}
    voltage = {"operating_point.voltage": 2.17, "uncertainty.voltage": 0.02}
    rig, Z = rig_with(MINIMAL, offset | voltage), Fraction("0.0256")
    for reading in EQUILIBRIA:
        over = claim(rig, "sampled", None, (0.012, 0.03), reading)
        assert over.held == (reading == "measured")
        boxes = list(over.boxes(Z))
        for t, s, r in itertools.product((Fraction(n, 7) for n in range(8)), repeat=3):
            shift = over.shifts[0] + s * (over.shifts[1] - over.shifts[0])
            gap = over.gaps[0] + t * (over.gaps[1] - over.gaps[0]) + shift
            ratio = over.ratios[0] + r * (over.ratios[1] - over.ratios[0])
            if over.held:  # the same voltage at Y, hence beta = g (Z + shift)^2/U_t^2
                ratio *= (Z / (Z + shift)) ** 2
            assert any(
                low <= gap <= high and weak <= ratio <= strong
                for (low, high), (weak, strong) in boxes
            )


def test_an_unbounded_gap_is_refused() -> None:
    with pytest.raises(InputError, match="finite"):
        claim(PAPER, "continuous", Fraction(0), (0.01, math.inf))
