from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from rigs import MINIMAL, OFFSET, rig_with

from maglev_design.certification.intervals.algebraic import positive_roots, squared, x
from maglev_design.certification.intervals.interval import (
    exact_loop,
    gaps_at,
    ratios_at,
    ratios_over,
)
from maglev_design.certification.intervals.routh import hurwitz_determinant, is_hurwitz
from maglev_design.certification.intervals.spans import ZERO, End, StableSet, unite
from maglev_design.controller.design import (
    Design,
    PoleSpec,
    make_design,
    plant_beta,
    true_equilibrium,
)
from maglev_design.options import EQUILIBRIA, PAPER_PLANT, Controller, Equilibrium
from maglev_design.rig import Rig, load_rig, preset_names
from maglev_design.simulation import Scenario, loop_for, simulate

PAPER, POLES = load_rig("belmonte2021"), PoleSpec.double(1, 70)
UNEQUAL = PoleSpec((1.1, 63.7), (0.55, 120.3))
LIGHT = PoleSpec.double(0.1, 70.0)
"""So little damping that the ends are near exact beta and near Y, where a simulation can go."""
ON_THE_AXIS = 1e-9
"""Relative real part below which eigenvalues say nothing about stability."""
NEAR = 1e-7
"""Relative distance from an end at which eigenvalues are asked."""
MEASURED = rig_with(OFFSET, {"operating_point.voltage": 7.5})
EVERY = [rig for rig in map(load_rig, preset_names()) if rig.kind == PAPER_PLANT] + [
    rig_with(OFFSET),
    MEASURED,
]
SUBJECTS: tuple[tuple[Equilibrium, bool], ...] = (
    *((reading, False) for reading in EQUILIBRIA),
    *((reading, True) for reading in EQUILIBRIA),
)
"""Readings, and whether the controller is computed anew on each plant."""


def made(rig: Rig, poles: PoleSpec, reading: Equilibrium, **options: Any) -> Design:
    """The design of a rig that has its voltage measured, by default 3 % off the model's."""
    held = (
        rig.operating_point.voltage
        or 1.03 * true_equilibrium(rig, plant_beta(rig), rig.operating_point.gap).U
    )
    return make_design(rig, poles, equilibrium=reading, **({"voltage": held} | options))


def rightmost(
    rig: Rig, poles: PoleSpec, subject: tuple[Equilibrium, bool], ratio: float, gap: float
) -> float:
    """Largest real part of the TAN-GPI loop's poles, from the numbers of the design that runs."""
    reading, anew = subject
    design = made(rig, poles, reading)
    beta = design.beta_at(ratio)
    if anew:
        beta = plant_beta(rig) / ratio
        voltage = true_equilibrium(rig, beta, rig.operating_point.gap).U
        design = made(rig, poles, reading, voltage=voltage)
    true = true_equilibrium(rig, beta, gap)
    k0, k1, k2, k3 = design.gains
    rho, seen = true.C_U / design.believed.C_U, design.believed.C_Y
    law = rho * np.array([k2 + seen, k1 + k3 * seen, k0])
    polynomial = np.polyadd(np.polymul([1, k3, 0], [1, 0, -true.C_Y]), law)
    return float(np.roots(polynomial).real.max())


def ends_of(found: StableSet) -> list[tuple[float, int]]:
    """Every end above zero that is not infinite, with the side on which it is stable."""
    pairs = [(span.lower.value, 1) for span in found.spans if span.lower.value > 0]
    return pairs + [(s.upper.value, -1) for s in found.spans if math.isfinite(s.upper.value)]


# --- Routh against roots --------------------------------------------------------------------


@pytest.mark.parametrize("degree", [3, 4, 5, 6])
def test_routh_agrees_with_the_roots_of_random_polynomials(degree: int) -> None:
    random = np.random.default_rng(degree)
    some = random.standard_normal((5000, degree))
    # half of them with roots of their own, so that many are stable
    roots = random.standard_normal((2500, degree)) - 0.7
    some[2500:] = [np.poly(row)[1:] for row in roots]
    companions = np.zeros((5000, degree, degree))
    companions[:, 0, :] = -some
    companions[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    eigenvalues = np.asarray(np.linalg.eigvals(companions), dtype=complex)
    largest = eigenvalues.real.max(axis=1)
    sure = np.abs(largest) > ON_THE_AXIS * np.abs(eigenvalues).max(axis=1)
    answers = np.array([is_hurwitz([1.0, *row]) for row in some])
    assert sure.sum() > 4900
    assert 100 < (largest < 0).sum() < 4900
    assert (answers == (largest < 0))[sure].all()


def test_the_determinant_is_that_of_hurwitz_s_matrix_and_open_where_an_entry_vanishes() -> None:
    a4, a3, a2, a1, a0 = 2.0, 3.0, 7.0, 5.0, 1.5
    by_hand = np.linalg.det(np.array([[a3, a1, 0], [a4, a2, a0], [0, a3, a1]]))
    assert hurwitz_determinant([a4, a3, a2, a1, a0]) == pytest.approx(by_hand, rel=1e-12)
    with pytest.raises(ZeroDivisionError):
        hurwitz_determinant(list(np.polymul([1.0, 0.0, 4.0], [1.0, 3.0])))


# --- algebraic numbers ----------------------------------------------------------------------


def test_a_square_has_its_own_minimal_polynomial() -> None:
    import sympy as sp  # noqa: PLC0415

    (root,) = positive_roots([sp.Poly(x**2 - 2 * x - 1, x)])  # 1 + sqrt(2)
    assert root.text == "1 + sqrt(2)"
    image = squared(root, Fraction(1, 3), 2)
    assert image.value == pytest.approx((1 + math.sqrt(2)) ** 2 / 3, rel=1e-15)
    assert image.text == "2*sqrt(2)/3 + 1"
    (cubic,) = positive_roots([sp.Poly(x**3 - 2, x)])
    assert cubic.text.startswith("root of x**3 - 2 in [1.25992")
    assert squared(cubic, Fraction(1), 2).value == pytest.approx(2 ** (2 / 3), rel=1e-15)


def test_cells_join_only_where_the_end_between_them_is_stable() -> None:
    ends = [End(1.0, "1", Fraction(1), Fraction(1)), End(2.0, "2", Fraction(2), Fraction(2))]
    joined = unite(ends, [True, True, False], lambda n: n == 0)
    assert [(s.lower.value, s.upper.value) for s in joined] == [(0.0, 2.0)]
    apart = unite(ends, [True, True, False], lambda _: False)
    assert [(s.lower.value, s.upper.value) for s in apart] == [(0.0, 1.0), (1.0, 2.0)]
    assert unite(ends, [False] * 3, lambda _: False) == ()
    assert unite((), [True], lambda _: False)[0].lower is ZERO


# --- exact ends -----------------------------------------------------------------------------


def test_the_paper_s_rig_has_the_ends_that_the_condition_gives() -> None:
    found = {r: exact_loop(PAPER, make_design(PAPER, POLES), r) for r in EQUILIBRIA}
    at_y = {r: ratios_at(x, 0.0246).spans[0].upper for r, x in found.items()}
    assert at_y["appendix-a"].exact == "5"
    # by hand: ((w^2 + C)/(w^2/5 + C))^2 with w = 70 and C = 2 g/Y
    own = Fraction(981, 100) * 2 / Fraction(246, 10000)
    by_hand = ((4900 + own) / (980 + own)) ** 2
    assert at_y["model"].exact == str(by_hand)
    assert at_y["model"].value == pytest.approx(10.27, abs=0.005)
    assert at_y["measured"].value == math.inf
    assert at_y["measured"].exact is None
    for loop in found.values():
        (span,) = gaps_at(loop).spans
        assert (span.lower.exact, span.upper.exact) == ("0", "123/1000")  # 5 Y


@pytest.mark.parametrize("poles", [POLES, UNEQUAL, LIGHT], ids=["double", "unequal", "light"])
@pytest.mark.parametrize("reading", SUBJECTS, ids=str)
@pytest.mark.parametrize("rig", EVERY, ids=lambda rig: rig.name[:12] or "rig")
def test_roots_change_sides_at_every_end_and_nowhere_else(
    rig: Rig, reading: tuple[Equilibrium, bool], poles: PoleSpec
) -> None:
    own = rig.operating_point.gap
    loop = exact_loop(rig, made(rig, poles, reading[0]), reading[0] if reading[1] else None)
    found = ratios_at(loop, own)
    for end, inwards in ends_of(found):
        assert rightmost(rig, poles, reading, end * (1 + inwards * NEAR), own) < 0
        assert rightmost(rig, poles, reading, end * (1 - inwards * NEAR), own) > 0
    for ratio in np.geomspace(1e-3, 1e3, 61):
        inside = any(s.lower.value < ratio < s.upper.value for s in found.spans)
        assert (rightmost(rig, poles, reading, float(ratio), own) < 0) == inside
    gaps = gaps_at(loop)
    for end, inwards in ends_of(gaps):
        assert rightmost(rig, poles, reading, 1.0, end * (1 + inwards * NEAR)) < 0
        assert rightmost(rig, poles, reading, 1.0, end * (1 - inwards * NEAR)) > 0


@pytest.mark.parametrize("name", ["tan-gpi", "fee-gpi", "lin-pid", "state-feedback"])
@pytest.mark.parametrize("reading", [None, *EQUILIBRIA])
def test_over_a_range_of_gaps_the_sets_of_its_gaps_are_intersected(
    reading: Equilibrium | None, name: str
) -> None:
    design = make_design(PAPER, UNEQUAL, controller=Controller(name))  # type: ignore[arg-type]
    loop = exact_loop(PAPER, design, reading)
    over = ratios_over(loop, (0.012, 0.06))
    single = [ratios_at(loop, float(gap)) for gap in np.linspace(0.012, 0.06, 13)]
    for ratio in np.geomspace(0.01, 100, 200):
        everywhere = all(
            any(s.lower.value < ratio < s.upper.value for s in found.spans) for found in single
        )
        assert any(s.lower.value < ratio < s.upper.value for s in over.spans) == everywhere


def test_an_irrational_root_of_the_scale_is_met() -> None:
    loop = exact_loop(MEASURED, make_design(MEASURED, UNEQUAL, equilibrium="appendix-a"))
    assert loop.power == 2
    assert math.isqrt(loop.scale.numerator) ** 2 != loop.scale.numerator
    (span,) = gaps_at(loop).spans
    assert span.upper.exact is not None
    assert "sqrt" in span.upper.exact or "root" in span.upper.exact


def test_a_loop_that_is_nowhere_stable_has_an_empty_set() -> None:
    # FEE-GPI places no pole for the plant's own instability, which a short magnet makes fast
    rig = load_rig("humusoft-ce152")
    loop = exact_loop(rig, make_design(rig, POLES, controller=Controller("fee-gpi")), "measured")
    found = ratios_at(loop, rig.operating_point.gap)
    shown = found.as_dict(Fraction(1), "model")
    assert found.spans == ()
    assert not shown["stable"]
    assert shown["upper"] is None
    assert shown["intervals"] == []


# --- the nonlinear plant --------------------------------------------------------------------


def growth(rig: Rig, ratio: float) -> float:
    """Late over early amplitude on the nonlinear plant, continuous law; inf if the ball is lost."""
    design = make_design(rig, LIGHT)
    scenario = Scenario(design.beta_at(ratio), rig.reference.start_gap + 1e-6)
    response = simulate(loop_for(rig, design, continuous=True), design, scenario)
    if response.metrics.crash is not None:
        return math.inf
    error = response.gap - rig.reference.start_gap
    half = len(error) // 2
    early, late = error[half // 2 : half], error[-half // 2 :]
    return float(np.ptp(late) / np.ptp(early))


def held_at(gap: float) -> Rig:
    path = {"start_gap": gap, "end_gap": gap, "start_time": 0.5, "end_time": 1.0, "horizon": 2.0}
    return rig_with(MINIMAL, {"reference": path, "initial": {"gap": gap}})


def test_the_nonlinear_loop_grows_beyond_an_end_and_calms_down_before_it() -> None:
    rig = held_at(0.0246)
    loop = exact_loop(rig, make_design(rig, LIGHT))
    (span,) = ratios_at(loop, 0.0246).spans
    assert growth(rig, 0.98 * span.upper.value) < 0.9
    assert growth(rig, 1.02 * span.upper.value) > 1.1
    (gaps,) = gaps_at(loop).spans
    assert growth(held_at(0.98 * gaps.upper.value), 1.0) < 0.9
    assert growth(held_at(1.02 * gaps.upper.value), 1.0) > 1.1
