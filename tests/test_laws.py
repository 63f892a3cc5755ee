from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
import reference
import sympy as sp
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from maglev_design.choices import METHODS, Method
from maglev_design.lowering import lower
from maglev_design.symbolic import laws
from maglev_design.symbolic import plant as p

LAW = laws.tan_gpi()
EQUATIONS = {method: laws.difference_equation(LAW, method) for method in METHODS}

ROUNDING = 1e-12
POLYNOMIAL = 1e-10
"""Relative to a coefficient; numpy.poly multiplies the roots one by one."""
EXPONENTIAL = 1e-11
"""scipy's cont2discrete takes a numerical matrix exponential."""

dampings = st.floats(0.2, 3.0)
speeds = st.floats(5.0, 300.0)
coefficients = st.tuples(st.floats(0.5, 50.0), st.floats(50.0, 5000.0))
periods = st.floats(1e-4, 5e-3)

PAIRS = ((p.zeta_1, p.omega_1), (p.zeta_2, p.omega_2))
GAINS = lower(
    (p.zeta_1, p.omega_1, p.zeta_2, p.omega_2),
    dict(
        zip(
            ("k0", "k1", "k2", "k3"),
            laws.match_coefficients(laws.pole_pairs_polynomial(PAIRS), 4),
            strict=True,
        )
    ),
).scalar()


def roots_of(zeta: float, omega: float) -> list[complex]:
    return [complex(r) for r in np.roots([1.0, 2 * zeta * omega, omega**2])]


# --- gains ---------------------------------------------------------------------------------


@given(dampings, speeds, dampings, speeds)
def test_the_gains_are_the_coefficients_of_the_desired_polynomial(
    zeta_1: float, omega_1: float, zeta_2: float, omega_2: float
) -> None:
    gains = GAINS(zeta_1, omega_1, zeta_2, omega_2)
    desired = np.poly([*roots_of(zeta_1, omega_1), *roots_of(zeta_2, omega_2)])
    assert [1.0, *gains[::-1]] == pytest.approx(desired.real, rel=POLYNOMIAL)


def test_the_paper_s_poles_give_the_gains_of_its_formula() -> None:
    assert GAINS(*reference.POLES, *reference.POLES) == reference.GAINS


@given(st.lists(st.floats(0.5, 9.0), min_size=2, max_size=6))
def test_poles_of_any_order_are_placed(poles: list[float]) -> None:
    exact = [sp.Rational(pole) for pole in poles]
    gains = laws.match_coefficients(sp.Mul(*[p.s + pole for pole in exact]), len(poles))
    desired = np.poly([-pole for pole in poles])[1:][::-1]
    assert [float(k) for k in gains] == pytest.approx(list(desired), rel=POLYNOMIAL)


@pytest.mark.parametrize(
    ("polynomial", "order"), [(2 * p.s**4, 4), (p.s**3, 4), (p.s**5, 4), (p.s * p.zeta, 1)]
)
def test_a_polynomial_that_is_not_monic_of_the_order_is_refused(
    polynomial: sp.Expr, order: int
) -> None:
    with pytest.raises(ValueError, match="monic of order"):
        laws.match_coefficients(polynomial, order)


# --- the law -------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_the_law_of_any_order_places_the_poles(order: int) -> None:
    gains = laws.gain_symbols(order)
    numerator, denominator = sp.fraction(sp.together(laws.gpi_transfer(gains)))
    loop = sp.Poly(sp.expand(denominator * (p.s**2 - p.C_Y) + numerator), p.s)
    desired = p.s**order + sum(k * p.s**n for n, k in enumerate(gains))
    assert sp.expand(loop.monic().as_expr() - desired) == 0


def test_the_transfer_function_is_the_known_one() -> None:
    known = ((p.k2 + p.C_Y) * p.s**2 + (p.k1 + p.k3 * p.C_Y) * p.s + p.k0) / (p.s * (p.s + p.k3))
    assert sp.simplify(laws.gpi_transfer((p.k0, p.k1, p.k2, p.k3)) - known) == 0
    assert sp.simplify(LAW.core.transfer(p.s) - known / p.C_U) == 0


def test_the_realisation_has_an_integrator_and_a_stable_lag_only() -> None:
    assert LAW.core.A.eigenvals() == {sp.Integer(0): 1, -p.k3: 1}
    assert LAW.integrators == (0,)
    assert len(LAW.states) == LAW.core.A.shape[0] == 2


def test_the_static_feedforward_is_exact_for_the_nonlinear_plant() -> None:
    plant = p.magnetic_levitation()
    at_rest = LAW.feedforward.subs({p.acc_ref: 0, p.C_Y: 2 * p.g / (p.Y + p.y0)})
    at_rest = at_rest.subs(p.C_U, 2 * p.g / p.U).subs(p.U, plant.equilibrium_voltage)
    assert sp.simplify(at_rest - plant.equilibrium_voltage.subs(p.Y, p.y_ref)) == 0


# --- discretisation ------------------------------------------------------------------------

SYMBOLS = (p.C_U, p.C_Y, p.T, p.k0, p.k1, p.k2, p.k3)


def matrices(core: laws.StateSpace) -> Callable[..., list[np.ndarray]]:
    shapes = [m.shape for m in (core.A, core.B, core.C, core.D)]
    entries = [x for m in (core.A, core.B, core.C, core.D) for x in m]
    run = lower(SYMBOLS, {f"m{n}": x for n, x in enumerate(entries)}).scalar()

    def evaluate(*values: float) -> list[np.ndarray]:
        flat, result = list(run(*values)), []
        for rows, columns in shapes:
            result.append(np.array(flat[: rows * columns]).reshape(rows, columns))
            flat = flat[rows * columns :]
        return result

    return evaluate


CONTINUOUS = matrices(LAW.core)
SAMPLED = {method: matrices(laws.discretise(LAW.core, method)) for method in METHODS}
SCIPY_NAME = {"tustin": "bilinear", "euler": "euler", "zoh": "zoh"}


@pytest.mark.parametrize("method", METHODS)
@given(dampings, speeds, coefficients, periods)
def test_the_discretisation_is_scipy_s(
    method: Method, zeta: float, omega: float, pair: tuple[float, float], period: float
) -> None:
    values = (*pair, period, *GAINS(zeta, omega, 0.7 * zeta + 0.1, 1.3 * omega))
    a, b, c, d = CONTINUOUS(*values)
    *expected, _ = cont2discrete((a, b, c, d), period, SCIPY_NAME[method])
    for ours, theirs in zip(SAMPLED[method](*values), expected, strict=True):
        scale = np.abs(theirs).max()
        assert ours == pytest.approx(theirs, rel=EXPONENTIAL, abs=EXPONENTIAL * scale)


# --- the step that runs --------------------------------------------------------------------


def stepper(method: Method) -> tuple[list[str], Callable[..., Sequence[float]]]:
    """Return the names of the coefficients and the step that takes them last."""
    equation = EQUATIONS[method]
    names = list(equation.coefficients)
    inputs = (*LAW.states, p.y, p.y_ref, p.acc_ref, p.Y, p.U, laws.u_min, laws.u_max, *names)
    outputs = {f"next{n}": x for n, x in enumerate(equation.next_states)}
    outputs |= {"commanded": laws.commanded, "applied": equation.applied}
    program = lower(inputs, outputs, {laws.commanded: equation.commanded})
    return [s.name for s in names], program.scalar()


STEPS = {method: stepper(method) for method in METHODS}
NUMBERS = {
    method: lower(
        (p.C_U, p.C_Y, p.T, laws.u_min, laws.u_max, p.k0, p.k1, p.k2, p.k3),
        {s.name: x for s, x in EQUATIONS[method].coefficients.items()},
    ).scalar()
    for method in METHODS
}
HIGH = 5.0
"""[V] Upper limit of the voltage in these tests."""

REST = (0.0246, 2.0825)
"""Y, U of the runs below; any would do."""
C_U_C_Y_T = (9.4213685474, 797.56097561, 1e-3)


def run(method: Method, *state_and_inputs: float, high: float = HIGH) -> Sequence[float]:
    """Return (next states, commanded, applied) for (x1, x2, y, y*, y*'')."""
    numbers = NUMBERS[method](*C_U_C_Y_T, 0.0, high, *reference.GAINS)
    return STEPS[method][1](*state_and_inputs, *REST, 0.0, high, *numbers)


states = st.floats(-2e-5, 2e-5)
small = st.floats(-5e-4, 5e-4)


@pytest.mark.parametrize("method", METHODS)
@given(states, states, small, st.floats(0.012, 0.025), st.floats(-0.3, 0.3))
def test_inside_the_limits_the_step_is_the_linear_one(
    method: Method, x1: float, x2: float, error: float, y_ref: float, acc_ref: float
) -> None:
    *moved, commanded, applied = run(method, x1, x2, y_ref + error, y_ref, acc_ref)
    assume(0.0 < commanded < HIGH)
    a, b, c, d = SAMPLED[method](*C_U_C_Y_T, *reference.GAINS)
    state = np.array([[x1], [x2]])
    e = (y_ref + error) - y_ref
    c_u, c_y, _ = C_U_C_Y_T
    expected = REST[1] + (c_y * (y_ref - REST[0]) - acc_ref) / c_u + (c @ state + d * e)[0, 0]
    assert commanded == pytest.approx(expected, rel=1e-10, abs=1e-10)
    assert applied == commanded
    assert moved == pytest.approx((a @ state + b * e).ravel(), rel=1e-10, abs=1e-18)


@pytest.mark.parametrize("method", METHODS)
@given(st.floats(-1e-3, 1e-3), states, st.floats(-0.02, 0.02), st.floats(0.5, 20.0))
def test_the_applied_voltage_never_leaves_its_range(
    method: Method, x1: float, x2: float, error: float, high: float
) -> None:
    *_, commanded, applied = run(method, x1, x2, 0.02 + error, 0.02, 0.0, high=high)
    assert applied == min(max(commanded, 0.0), high)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("error", "sign"), [(4e-3, 1), (-4e-3, -1)])
def test_an_integrator_waits_while_it_would_push_into_the_clamp(
    method: Method, error: float, sign: int
) -> None:
    x1, x2, commanded, applied = run(method, 0.0, 0.0, 0.0246 + error, 0.0246, 0.0)
    assert sign * (commanded - applied) > 0, "the clamp is active"
    assert x1 == 0.0
    assert sign * x2 > 0, "the lag goes on"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("error", [4e-3, -4e-3])
def test_an_integrator_that_pulls_away_from_the_clamp_moves(method: Method, error: float) -> None:
    lag = 0.0125 * error  # its share of the voltage is opposite to the error's, and larger
    x1, _, commanded, applied = run(method, 0.0, lag, 0.0246 + error, 0.0246, 0.0)
    assert (applied - commanded) * error > 0, "the clamp is active, on the other side"
    assert x1 == pytest.approx(error * C_U_C_Y_T[2], rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
@given(st.floats(-1.0, 1.0), st.floats(-0.05, 0.05))
def test_an_integrator_s_share_of_the_voltage_stays_within_the_range(
    method: Method, x1: float, error: float
) -> None:
    _, _, c, _ = SAMPLED[method](*C_U_C_Y_T, *reference.GAINS)
    following, *_ = run(method, x1, 0.0, 0.02 + error, 0.02, 0.0)
    if following != x1:  # frozen ones stay where they are
        assert abs(c[0, 0] * following) <= HIGH * (1 + ROUNDING)


@pytest.mark.parametrize("method", METHODS)
def test_without_an_upper_limit_nothing_is_held_back(method: Method) -> None:
    x1, _, commanded, applied = run(method, 0.0, 0.0, 0.0346, 0.0246, 0.0, high=math.inf)
    assert commanded == applied > HIGH
    assert x1 > 0.0


# --- the continuous law --------------------------------------------------------------------

RATES, COMMAND = laws.continuous_equation(LAW)
FLOW = lower(
    (
        *LAW.states,
        p.y,
        p.y_ref,
        p.acc_ref,
        p.Y,
        p.U,
        laws.u_min,
        laws.u_max,
        *SYMBOLS[:2],
        *LAW.gains,
    ),
    {"rate1": RATES[0], "rate2": RATES[1], "commanded": laws.commanded},
    {laws.commanded: COMMAND},
).scalar()


def flow(x1: float, x2: float, error: float, high: float = HIGH) -> Sequence[float]:
    return FLOW(
        x1, x2, 0.0246 + error, 0.0246, 0.0, *REST, 0.0, high, *C_U_C_Y_T[:2], *reference.GAINS
    )


@given(states, states, small)
def test_the_continuous_law_is_its_state_space_inside_the_limits(
    x1: float, x2: float, error: float
) -> None:
    *rates, commanded = flow(x1, x2, error)
    assume(0.0 < commanded < HIGH)
    a, b, c, d = CONTINUOUS(*C_U_C_Y_T, *reference.GAINS)
    state, e = np.array([[x1], [x2]]), (0.0246 + error) - 0.0246
    assert rates == pytest.approx((a @ state + b * e).ravel(), rel=1e-10, abs=1e-15)
    assert commanded == pytest.approx(REST[1] + (c @ state + d * e)[0, 0], rel=1e-10)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_continuous_integrator_stops_at_the_clamp_and_at_its_bound(sign: int) -> None:
    bound = HIGH * C_U_C_Y_T[0] * reference.GAINS[3] / reference.GAINS[0]
    assert flow(0.0, 0.0, sign * 4e-3)[0] == 0.0
    assert flow(-sign * 1e-4, 0.0, sign * 4e-3)[0] == 0.0, "still pushing outwards"
    assert flow(sign * 1.01 * bound, -sign * 2e-3, sign * 1e-5)[0] == 0.0
    assert flow(sign * 1.01 * bound, 0.0, -sign * 1e-5)[0] == pytest.approx(-sign * 1e-5)
