from __future__ import annotations

import itertools

import numpy as np
import pytest
import reference
import sympy as sp
from scipy import stats
from scipy.special import betainc

from maglev_design.lowering import lower
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.reference import (
    PAPER_ORDER,
    BezierStep,
    bezier_step,
    end_gap,
    end_time,
    flatness_at_ends,
    peak_acceleration,
    printed_coefficients,
    rest_to_rest,
    start_gap,
    start_time,
    tau,
)

ROUNDING = 1e-12
"""Sums of at most 24 positive terms, each of some dozens of products."""
COMPLEX_STEP = 1e-200
"""Imaginary step of a derivative without cancellation: exact but for rounding."""

ORDERS = [
    (order, leading)
    for order, leading in itertools.product(range(5, 25), range(3, 13))
    if leading + 2 <= order
]
SOME_ORDERS = [ORDERS[n] for n in np.random.default_rng(5).permutation(len(ORDERS))[:25]]
TAUS = np.linspace(0.0, 1.0, 101)


def numbers(step: BezierStep, expression: sp.Expr, at: np.ndarray) -> np.ndarray:
    (values,) = lower([tau], {"out": expression}).numpy()(at)
    return np.asarray(values)


@pytest.mark.parametrize(("order", "leading"), SOME_ORDERS)
def test_the_step_is_the_regularised_incomplete_beta_function(order: int, leading: int) -> None:
    step = bezier_step(order, leading)
    a, b = leading, order + 1 - leading
    assert numbers(step, step.value, TAUS) == pytest.approx(betainc(a, b, TAUS), rel=ROUNDING)
    density = stats.beta.pdf(TAUS, a, b)
    assert numbers(step, step.slope, TAUS) == pytest.approx(density, rel=1e-10, abs=ROUNDING)


@pytest.mark.parametrize(("order", "leading"), SOME_ORDERS)
def test_the_derivatives_are_the_derivatives(order: int, leading: int) -> None:
    step = bezier_step(order, leading)
    moved = TAUS + 1j * COMPLEX_STEP
    for whole, derivative in ((step.value, step.slope), (step.slope, step.curvature)):
        expected = numbers(step, whole, moved).imag / COMPLEX_STEP
        given = numbers(step, derivative, TAUS)
        assert given == pytest.approx(expected, rel=ROUNDING, abs=ROUNDING * order**2)


@pytest.mark.parametrize(("order", "leading"), SOME_ORDERS[:8])
def test_as_many_derivatives_vanish_at_the_ends_as_control_values_repeat(
    order: int, leading: int
) -> None:
    assert flatness_at_ends(bezier_step(order, leading)) == (leading - 1, order - leading)


def test_the_paper_s_step_has_the_coefficients_it_prints() -> None:
    step = bezier_step()
    assert (step.order, step.leading) == (PAPER_ORDER, PAPER_ORDER // 2)
    assert tuple(printed_coefficients(step)) == reference.BEZIER_COEFFICIENTS


@pytest.mark.parametrize(
    ("order", "leading"), [(5, 2), (16, 2), (4, 3), (8, 7), (8, 8), (0, 0), (5, 9)]
)
def test_a_step_whose_acceleration_would_jump_is_refused(order: int, leading: int) -> None:
    with pytest.raises(ValueError, match=f"order {order} with {leading} leading zeros"):
        bezier_step(order, leading)


# --- the path in time ----------------------------------------------------------------------

FROM, TO, START, END = 0.0242, 0.0120, 1.0, 6.0


def path(times: np.ndarray) -> np.ndarray:
    gap, velocity, acceleration = rest_to_rest(bezier_step())
    inputs = (p.t, start_gap, end_gap, start_time, end_time)
    outputs = {"gap": gap, "velocity": velocity, "acceleration": acceleration}
    rows = lower(inputs, outputs).numpy()(times, FROM, TO, START, END)
    return np.stack([np.broadcast_to(row, times.shape) for row in rows])


def test_the_path_rests_before_and_after_the_move() -> None:
    before, after = path(np.linspace(0, START, 9)), path(np.linspace(END, 9.0, 9))
    assert (before[0] == FROM).all()
    assert (np.abs(after[0] - TO) <= ROUNDING * FROM).all()
    assert (before[1:] == 0).all()
    assert (after[1:] == 0).all()


def test_the_path_goes_monotonically_and_never_beyond() -> None:
    gap, velocity, _ = path(np.linspace(START, END, 1001))
    assert (np.diff(gap) <= ROUNDING * FROM).all()
    assert (velocity <= 0).all()
    assert gap.min() >= TO - ROUNDING * FROM
    assert gap.max() <= FROM


STEP = 1e-4
"""[s] Step of the central differences."""
DIFFERENCES = 1e-6
"""Relative to the largest value: truncation of STEP^2 against a time scale of 0.1 s."""


def test_velocity_and_acceleration_are_the_path_s_derivatives() -> None:
    times = np.linspace(0.5, 6.5, 997)
    _, velocity, acceleration = path(times)
    ahead, behind = path(times + STEP), path(times - STEP)
    for n, derivative in ((0, velocity), (1, acceleration)):
        slope = (ahead[n] - behind[n]) / (2 * STEP)
        assert np.abs(slope - derivative).max() < DIFFERENCES * np.abs(derivative).max()


@pytest.mark.parametrize(("order", "leading"), [(5, 3), (9, 4), (PAPER_ORDER, 8)])
def test_the_peak_acceleration_is_the_largest_on_a_fine_grid(order: int, leading: int) -> None:
    step = bezier_step(order, leading)
    symbols = (start_gap, end_gap, start_time, end_time)
    (peak,) = lower(symbols, {"peak": peak_acceleration(step)}).scalar()(0.024, 0.012, 1.0, 3.0)
    grid = np.abs(numbers(step, step.curvature, np.linspace(0.0, 1.0, 20001))).max()
    assert peak == pytest.approx(0.012 * grid / 2.0**2, rel=1e-6)
