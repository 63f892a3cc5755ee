from __future__ import annotations

import dataclasses
import math
from fractions import Fraction
from typing import Any

import byhand
import numpy as np
import pytest
import reference
from byhand import LAWS
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs import MINIMAL, OFFSET, SHORT, rig_with
from scipy.signal import cont2discrete

from maglev_design.controller import checks
from maglev_design.controller import design as designs
from maglev_design.controller.believed import Believed
from maglev_design.controller.design import PoleSpec
from maglev_design.controller.plant import (
    path_gaps,
)
from maglev_design.controller.timing import Timing, timing
from maglev_design.errors import InputError
from maglev_design.options import EQUILIBRIA, METHODS, Equilibrium, Method
from maglev_design.programs import gains_program, slope_program
from maglev_design.rig import Rig

ROUNDING = 1e-12
EXPONENTIAL = 1e-10
"""scipy's numerical matrix exponential, and partial fractions with k1 - k2 k3 - k0/k3."""
POLYNOMIAL = 1e-10
"""Relative to a coefficient; numpy.poly multiplies the roots one by one."""
POINTS = 7

FACTORS = [0.85, 1.0, 1.15]


def beta_of(rig: Rig) -> float:
    plant = rig.plant
    return plant.force_constant * rig.current_gain**2 / plant.mass


# --- poles ---------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("place", range(4))
def test_poles_that_are_not_positive_are_refused(bad: float, place: int) -> None:
    values = [1.0, 70.0, 1.0, 70.0]
    values[place] = bad
    with pytest.raises(InputError, match=rf"{('zeta', 'omega_n')[place % 2]} = .*greater than 0"):
        PoleSpec((values[0], values[1]), (values[2], values[3]))


def test_a_double_pair_is_two_equal_pairs() -> None:
    assert PoleSpec.double(0.9, 104).values == (0.9, 104.0, 0.9, 104.0)
    assert all(isinstance(v, float) for v in PoleSpec.double(1, 70).values)


# --- timing --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("period", "delay", "whole", "part", "held"),
    [
        (0.001, 0.0, 0, 0.0, 0),
        (0.001, 0.0003, 0, 0.0003, 1),
        (0.001, 0.001, 1, 0.0, 1),
        (0.001, 0.0017, 1, 0.0007, 2),
        (0.001, 0.003, 3, 0.0, 3),
        (0.0001, 0.0003, 3, 0.0, 3),
        (0.1, 0.3, 3, 0.0, 3),
        (0.007, 0.07, 10, 0.0, 10),
    ],
)
def test_a_delay_is_whole_periods_and_a_part(
    period: float, delay: float, whole: int, part: float, held: int
) -> None:
    assert timing(period, delay) == Timing(whole, part, held)


@given(st.integers(1, 10**6), st.integers(0, 10**6))
def test_decimals_are_divided_as_decimals(period: int, delay: int) -> None:
    when = timing(period / 10**6, delay / 10**6)
    assert when.whole == delay // period
    assert when.part == float(Fraction(delay % period, 10**6))
    assert when.held == -(-delay // period)


# --- the rig's own numbers -----------------------------------------------------------------


def test_the_paper_s_rig_has_the_paper_s_beta_and_voltage(paper_rig: Rig) -> None:
    assert round(designs.plant_beta(paper_rig), 8) == reference.BETA
    believed = designs.believed_equilibrium(paper_rig, "model")
    assert round(believed.U, 4) == reference.EQUILIBRIUM_VOLTAGE
    assert (paper_rig.operating_point.gap, designs.PAPER_POLES) == (
        reference.EQUILIBRIUM_GAP,
        reference.POLES,
    )


@pytest.mark.parametrize("data", [SHORT, OFFSET], ids=["paper", "offset"])
def test_the_true_equilibrium_is_that_of_the_force_law(data: dict[str, Any]) -> None:
    rig = rig_with(data)
    beta, g, y0 = beta_of(rig), rig.plant.gravity, rig.plant.gap_offset
    assert designs.plant_beta(rig) == pytest.approx(beta, rel=ROUNDING)
    for gap in (0.006, 0.012, 0.02):
        here = designs.true_equilibrium(rig, beta, gap)
        U = math.sqrt(g / beta) * (gap + y0)
        expected = (U, 2 * beta * U / (gap + y0) ** 2, 2 * beta * U**2 / (gap + y0) ** 3, beta)
        assert dataclasses.astuple(here)[:4] == pytest.approx(expected, rel=ROUNDING)


def readings(rig: Rig, beta_c: float, voltage: float) -> dict[Equilibrium, tuple[float, ...]]:
    """Return (U, C_U, C_Y, beta) of the three readings as documented, Z = Y + y0."""
    g, Z = rig.plant.gravity, rig.operating_point.gap + rig.plant.gap_offset
    U = math.sqrt(g / beta_c) * Z
    return {
        "model": (U, 2 * g / U, 2 * g / Z, beta_c),
        "appendix-a": (
            *(voltage, 2 * beta_c * voltage / Z**2, 2 * beta_c * voltage**2 / Z**3),
            beta_c,
        ),
        "measured": (voltage, 2 * g / voltage, 2 * g / Z, g * Z**2 / voltage**2),
    }


@pytest.mark.parametrize("equilibrium", EQUILIBRIA)
@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("given", [None, 3.3])
def test_the_controller_believes_what_its_reading_says(
    equilibrium: Equilibrium, factor: float, given: float | None
) -> None:
    rig = rig_with(OFFSET, {"operating_point.voltage": 2.7})
    beta_c = beta_of(rig) * factor
    believed = designs.believed_equilibrium(rig, equilibrium, beta_c=beta_c, voltage=given)
    expected = readings(rig, beta_c, given or 2.7)[equilibrium]
    assert dataclasses.astuple(believed)[:4] == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize("equilibrium", ["appendix-a", "measured"])
def test_a_reading_of_a_voltage_that_nobody_measured_is_refused(equilibrium: Equilibrium) -> None:
    with pytest.raises(InputError, match=r"operating_point\.voltage \[V\] is missing.*'model'"):
        designs.make_design(rig_with(SHORT), PoleSpec.double(1, 70), equilibrium=equilibrium)


@pytest.mark.parametrize(
    ("word", "options"),
    [
        ("measured", {"equilibrium": "mesured"}),
        ("tustin", {"method": "tustn"}),
        ("known: tustin, euler, zoh", {"method": "bilinear"}),
    ],
)
def test_a_word_that_is_none_is_answered_with_the_nearest(
    word: str, options: dict[str, Any]
) -> None:
    with pytest.raises(InputError, match=word):
        designs.make_design(rig_with(SHORT), PoleSpec.double(1, 70), **options)


def test_a_controller_has_a_name_that_its_numbers_alone_decide() -> None:
    rig = rig_with(SHORT, {"operating_point.voltage": 2.1})
    own = designs.make_design(rig, PoleSpec.double(1, 70))
    assert own.sha256 == designs.make_design(rig, PoleSpec.double(1, 70)).sha256
    assert dataclasses.replace(own, equilibrium="measured").sha256 == own.sha256
    others = [
        designs.make_design(rig, PoleSpec.double(1, 70), equilibrium="measured"),
        designs.make_design(rig, PoleSpec.double(1, 70.000001)),
        designs.make_design(rig, PoleSpec.double(1, 70), method="euler"),
        designs.make_design(rig_with(SHORT, {"limits.voltage": [0, 6]}), PoleSpec.double(1, 70)),
        designs.make_design(rig_with(SHORT, {"reference.end_gap": 0.013}), PoleSpec.double(1, 70)),
        designs.make_design(rig_with(SHORT, {"sampling.period": 0.002}), PoleSpec.double(1, 70)),
    ]
    assert len({own.sha256, *(design.sha256 for design in others)}) == 1 + len(others)


@pytest.mark.parametrize(
    "change",
    [
        {"Y": 0.02},
        {"period": 0.002},
        {"voltage_limits": (-1.0, 5.0)},
        {"reference": (0.0242, 0.012, 0.1, 0.4)},
        {"gains": (1.0, 2.0, 3.0, 4.0)},
        {"coefficients": {}},
        {"method": "euler"},
        {"believed": Believed(2.0, 9.0, 790.0, 1e-3)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_no_number_of_a_controller_is_left_out_of_its_name(change: dict[str, Any]) -> None:
    own = designs.make_design(rig_with(SHORT), PoleSpec.double(1, 70))
    assert dataclasses.replace(own, **change).sha256 != own.sha256


def test_given_gains_are_the_gains() -> None:
    gains = (1.0e7, 1.0e6, 3.0e4, 270.0)
    design = designs.make_design(rig_with(SHORT), PoleSpec.double(1, 70), gains=gains)
    assert design.gains == gains
    assert (
        design.coefficients
        != designs.make_design(rig_with(SHORT), PoleSpec.double(1, 70)).coefficients
    )


def test_a_voltage_that_contradicts_the_force_constant_is_named_with_the_beta_it_implies() -> None:
    disagreeing = rig_with(SHORT, {"operating_point.voltage": 4.165, "uncertainty.beta": 0.15})
    warning = checks.voltage_warning(disagreeing)
    assert warning is not None
    assert "implies beta = 0.000342" in warning
    assert "0.25 times" in warning
    for voltage in (2.0825, 2.2, None):
        rig = rig_with(SHORT, {"operating_point.voltage": voltage, "uncertainty.beta": 0.15})
        assert checks.voltage_warning(rig) is None


# --- a whole design ------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("equilibrium", EQUILIBRIA)
def test_a_design_holds_the_difference_equation_that_its_numbers_give(
    method: Method, equilibrium: Equilibrium
) -> None:
    voltage = 2.7
    rig = rig_with(OFFSET, {"operating_point.voltage": voltage})
    poles = PoleSpec((0.8, 90.0), (1.3, 120.0))
    design = designs.make_design(rig, poles, equilibrium=equilibrium, method=method)
    assert (design.method, design.equilibrium, design.poles) == (method, equilibrium, poles)
    assert rig.operating_point.gap == design.Y
    quartic = np.polymul([1, 2 * 0.8 * 90, 90**2], [1, 2 * 1.3 * 120, 120**2])
    assert design.gains == pytest.approx(tuple(quartic[:0:-1]), rel=ROUNDING)
    k0, k1, k2, k3 = design.gains
    U, c_u, c_y, _ = readings(rig, beta_of(rig), voltage)[equilibrium]
    assert pytest.approx(U, rel=ROUNDING) == design.believed.U
    through = (k2 + c_y) / c_u
    outputs = np.array([[k0 / k3, k1 - k2 * k3 - k0 / k3]]) / c_u
    (a, b, c, d, _) = cont2discrete(
        (np.diag([0.0, -k3]), np.ones((2, 1)), outputs, np.array([[through]])),
        rig.sampling.period,
        byhand.SCIPY_NAME[method],
    )
    low, high = rig.limits.voltage
    expected = {
        "a22": a[1, 1],
        "b1": b[0, 0],
        "b2": b[1, 0],
        "c1": c[0, 0],
        "c2": c[0, 1],
        "d": d[0, 0],
        "f_y": c_y / c_u,
        "f_a": -1 / c_u,
        "x1_max": (high - low) / c[0, 0],
    }
    got = dict(design.coefficients)
    for name in set(got) - set(expected):  # entries that scipy has, too
        row, column = int(name[1]) - 1, int(name[2]) - 1
        assert name[0] == "a"
        expected[name] = a[row, column]
    assert got == pytest.approx({name: expected[name] for name in got}, rel=EXPONENTIAL)
    assert {"c1", "c2", "d", "f_y", "f_a", "x1_max"} <= set(got)


@pytest.mark.parametrize("name", LAWS)
@given(st.floats(0.2, 3.0), st.floats(5.0, 300.0), st.floats(0.2, 3.0), st.floats(5.0, 300.0))
@settings(max_examples=25)
def test_the_gains_of_every_controller_are_those_of_the_polynomial(
    name: str, zeta_1: float, omega_1: float, zeta_2: float, omega_2: float
) -> None:
    poles = (zeta_1, omega_1, zeta_2, omega_2)
    program = gains_program(LAWS[name])
    expected = byhand.gains_of(LAWS[name], poles)
    assert program.outputs == designs.gain_names(LAWS[name])
    assert set(program.outputs) == set(expected)
    ours = dict(zip(program.outputs, program.scalar()(*poles), strict=True))
    assert ours == pytest.approx(expected, rel=POLYNOMIAL)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", LAWS)
def test_every_controller_s_design_runs_what_its_numbers_give(name: str, method: Method) -> None:
    rig, law = rig_with(OFFSET, {"limits.voltage": [2.0, 24.0]}), LAWS[name]
    poles = (0.8, 90.0, 1.3, 120.0)
    pairs = PoleSpec(poles[:2], poles[2:])
    design = designs.make_design(rig, pairs, controller=law, method=method)
    assert (design.controller, design.method) == (law, method)
    assert design.named_gains == pytest.approx(byhand.gains_of(law, poles), rel=POLYNOMIAL)
    assert list(design.named_gains.values()) == list(design.gains)
    here = design.believed
    core = byhand.core(law, design.named_gains, here.C_U, here.C_Y)
    a, b, c, d = byhand.sampled(core, rig.sampling.period, method)
    (low, high), Z = rig.limits.voltage, rig.operating_point.gap + rig.plant.gap_offset
    known = byhand.Known(
        *(design.Y, here.U, here.C_U, here.C_Y, here.beta),
        *(rig.plant.gravity, rig.plant.gap_offset),
    )
    expected = {"f_y": here.C_Y / here.C_U, "f_a": -1 / here.C_U}
    expected |= {"f_g": known.g, "f_0": known.y0, "f_b": 1 / math.sqrt(here.beta)}
    expected |= {f"a{m + 1}{n + 1}": a[m, n] for m in range(len(a)) for n in range(len(a))}
    expected |= {f"b{n + 1}": b[n].sum() for n in range(len(a))}
    expected |= {f"c{n + 1}": c[0, n] for n in range(len(a))}
    expected |= {"d": d.sum(), "x1_max": byhand.span(law, low, high, known) / c[0, 0]}
    # a law with two inputs has a column each: e, then e' or the gap from Y
    if "d_2" in design.coefficients:
        expected |= {"d": d[0, 0], "d_2": d[0, 1] + d[0, 2]}
        expected |= {f"b{n + 1}": b[n, 0] for n in range(len(a))}
        expected |= {f"b{n + 1}_2": b[n, 1] + b[n, 2] for n in range(len(a))}
    got = dict(design.coefficients)
    assert got == pytest.approx({name: expected[name] for name in got}, rel=EXPONENTIAL)
    assert {"c1", "d", "x1_max"} <= set(got)
    constants = {"f_y", "f_a"} if law.name in ("tan-gpi", "state-feedback") else set()
    constants |= {"f_g", "f_0", "f_b"} if law.name == "fee-gpi" else set()
    constants |= {"f_y"} if law.feedforward == "static" else set()
    assert {name for name in got if name.startswith("f_")} == constants
    assert Z > design.Y, "the offset matters"


def test_a_measured_voltage_gives_the_feedback_linearisation_its_beta() -> None:
    rig = rig_with(OFFSET, {"operating_point.voltage": 14.0})
    fee = LAWS["fee-gpi"]
    pairs = PoleSpec.double(1, 70)
    Z = rig.operating_point.gap + rig.plant.gap_offset
    design = designs.make_design(rig, pairs, controller=fee, equilibrium="measured", beta_c=1.0)
    assert design.believed.beta == pytest.approx(rig.plant.gravity * Z**2 / 14.0**2, rel=ROUNDING)
    assert design.coefficients["f_b"] == pytest.approx(14.0 / Z / math.sqrt(rig.plant.gravity))
    own = designs.make_design(rig, pairs, controller=fee, equilibrium="model")
    assert own.believed.beta == pytest.approx(beta_of(rig), rel=ROUNDING)


SLOPE_STEP = 1e-5
"""[m/s^2] or [V] Of the central difference of a command by w."""


@pytest.mark.parametrize("name", LAWS)
def test_the_slope_program_differentiates_the_command(name: str) -> None:
    law, known = LAWS[name], byhand.Known(0.0246, 2.0, 9.5, 790.0, 1.4e-3, 9.81, 2e-3)
    w, y_ref = 0.7, 0.02
    u = byhand.command(law, w, y_ref, 0.0, known)
    ends = [byhand.command(law, w + s * SLOPE_STEP, y_ref, 0.0, known) for s in (1, -1)]
    slope, gain = slope_program(law).scalar()(u, y_ref, known.beta, known.y0, known.C_U)
    assert slope == pytest.approx((ends[0] - ends[1]) / (2 * SLOPE_STEP), rel=1e-8)
    assert slope == pytest.approx(byhand.slope(law, u, y_ref, known), rel=ROUNDING)
    assert gain == (1.0 if law.name == "fee-gpi" else known.C_U)


def test_the_paper_s_design_has_the_paper_s_gains(paper_rig: Rig) -> None:
    design = designs.make_design(paper_rig, PoleSpec.double(*reference.POLES))
    assert design.gains == reference.GAINS
    assert (design.method, design.equilibrium) == ("tustin", "model")


def test_without_an_upper_limit_the_integrator_is_unbounded() -> None:
    design = designs.make_design(rig_with(MINIMAL), PoleSpec.double(1, 70))
    assert design.coefficients["x1_max"] == math.inf
    assert all(math.isfinite(x) for n, x in design.coefficients.items() if n != "x1_max")


def test_the_controller_s_beta_is_a_choice() -> None:
    rig = rig_with(SHORT)
    own = designs.make_design(rig, PoleSpec.double(1, 70))
    other = designs.make_design(rig, PoleSpec.double(1, 70), beta_c=1.21 * beta_of(rig))
    assert pytest.approx(own.believed.U / 1.1, rel=ROUNDING) == other.believed.U
    assert other.gains == own.gains


# --- the path ------------------------------------------------------------------------------


def test_the_gaps_of_the_path_include_the_start_and_the_working_point() -> None:
    rig = rig_with(SHORT, {"initial.gap": 0.03, "reference.end_gap": 0.015})
    gaps = path_gaps(rig, POINTS)
    assert (gaps[0], gaps[-1], len(gaps)) == (0.015, 0.03, POINTS)
    hold = path_gaps(rig_with(MINIMAL), POINTS)
    assert hold.tolist() == [MINIMAL["operating_point"]["gap"]]


def test_a_rig_that_holds_has_a_constant_path() -> None:
    times = np.linspace(0, 1, POINTS)
    gap, velocity, acceleration = designs.reference_path(rig_with(MINIMAL), times)
    assert (gap == MINIMAL["operating_point"]["gap"]).all()
    assert not velocity.any()
    assert not acceleration.any()


SLOW = {"reference.end_time": 9.0, "reference.horizon": 9.5}
"""So slow a move that U = sqrt(g/beta) y = 84.655 V/m y all along it."""


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"limits.voltage": [0.0, 2.0], **SLOW}, ["needs 2.066 V", "the most", "0.0244 m"]),
        ({"limits.voltage": [1.9, 5.0], **SLOW}, ["needs 1.693 V", "the least", "0.02 m"]),
        ({"initial.gap": 0.045, "limits.voltage": [0.0, 3.0]}, ["needs 3.81 V", "0.045 m"]),
        ({"plant.mass": 20.0}, ["limits.voltage", "kg"]),
        ({"reference.end_time": 0.115}, ["reference", "gravity, 9.81 m/s^2", "more time"]),
    ],
)
def test_a_path_that_the_actuator_cannot_follow_is_refused(
    changes: dict[str, Any], words: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        checks.check_path_voltage(rig_with(SHORT, changes))
    assert [word for word in words if word not in str(caught.value)] == []


def test_a_path_that_the_actuator_can_follow_passes() -> None:
    for data in (MINIMAL, SHORT, OFFSET):
        checks.check_path_voltage(rig_with(data))
