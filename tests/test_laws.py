from __future__ import annotations

import math

import byhand
import numpy as np
import pytest
import reference
import sympy as sp
from byhand import LAWS, Known
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from maglev_design.lowering import lower
from maglev_design.options import CONTROLLERS, Controller
from maglev_design.symbolic import gpi, laws, stability
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.linearisation import linearise

Array = NDArray[np.float64]

LAW = laws.tan_gpi()
EVERY = {name: laws.control_law(controller) for name, controller in LAWS.items()}
PLANT = p.magnetic_levitation()

ROUNDING = 1e-12
POLYNOMIAL = 1e-10
"""Relative to a coefficient; numpy.poly multiplies the roots one by one."""

dampings = st.floats(0.2, 3.0)
speeds = st.floats(5.0, 300.0)

PAIRS = ((p.zeta_1, p.omega_1), (p.zeta_2, p.omega_2))
GAINS = lower(
    (p.zeta_1, p.omega_1, p.zeta_2, p.omega_2),
    dict(
        zip(
            ("k0", "k1", "k2", "k3"),
            gpi.match_coefficients(gpi.pole_pairs_polynomial(PAIRS), 4),
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
    gains = gpi.match_coefficients(sp.Mul(*[p.s + pole for pole in exact]), len(poles))
    desired = np.poly([-pole for pole in poles])[1:][::-1]
    assert [float(k) for k in gains] == pytest.approx(list(desired), rel=POLYNOMIAL)


@pytest.mark.parametrize(
    ("polynomial", "order"), [(2 * p.s**4, 4), (p.s**3, 4), (p.s**5, 4), (p.s * p.zeta, 1)]
)
def test_a_polynomial_that_is_not_monic_of_the_order_is_refused(
    polynomial: sp.Expr, order: int
) -> None:
    with pytest.raises(ValueError, match="monic of order"):
        gpi.match_coefficients(polynomial, order)


# --- the law -------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_the_law_of_any_order_places_the_poles(order: int) -> None:
    gains = gpi.gain_symbols(order)
    numerator, denominator = sp.fraction(sp.together(gpi.gpi_transfer(gains)))
    loop = sp.Poly(sp.expand(denominator * (p.s**2 - p.C_Y) + numerator), p.s)
    desired = p.s**order + sum(k * p.s**n for n, k in enumerate(gains))
    assert sp.expand(loop.monic().as_expr() - desired) == 0


def test_the_transfer_function_is_the_known_one() -> None:
    known = ((p.k2 + p.C_Y) * p.s**2 + (p.k1 + p.k3 * p.C_Y) * p.s + p.k0) / (p.s * (p.s + p.k3))
    assert sp.simplify(gpi.gpi_transfer((p.k0, p.k1, p.k2, p.k3)) - known) == 0
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


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_word_for_a_controller_has_its_law(name: str) -> None:
    (chosen,) = [Controller(word) for word in CONTROLLERS if word == name]
    law = laws.control_law(chosen)
    assert law.controller == chosen
    assert law.core.A.shape == (len(law.states), len(law.states))
    assert law.core.B.shape == (len(law.states), len(law.inputs))
    assert law.core.D.shape == (1, len(law.inputs))
    assert len(law.start) == len(law.states)


@pytest.mark.parametrize("name", EVERY)
def test_the_core_of_every_law_is_the_one_written_by_hand(name: str) -> None:
    law, poles = EVERY[name], (0.9, 60.0, 1.2, 75.0)
    k = byhand.gains_of(LAWS[name], poles)
    numbers = {p.C_U: 9.4, p.C_Y: 800.0} | {gain: k[gain.name] for gain in law.gains}
    a, b, c, d = byhand.core(LAWS[name], k, 9.4, 800.0)
    for s in (3j, 40.0 + 5j, 900j):
        through = (c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d)[0]
        # every one of e, e' and the gap from Y moves with the gap
        expected = through[0] + s * through[1] + through[2]
        assert complex(law.transfer(p.s).subs(numbers).subs(p.s, s)) == pytest.approx(expected)


# --- what each law makes of the loop at the design point -----------------------------------

FOURTH = p.s**4 + p.k3 * p.s**3 + p.k2 * p.s**2 + p.k1 * p.s + p.k0
"""(23)"""
THIRD = p.s**3 + p.k3 * p.s**2 + p.k2 * p.s + p.k1
"""(16)"""


def as_designed(law: laws.ControlLaw) -> sp.Expr:
    """Return the closed loop's polynomial with the gain and the plant that the law reckons with."""
    coefficients = stability.closed_loop_polynomial(law)
    designed = {p.rho: 1, p.C_Y_true: stability.believed(law.C_Y)}
    order = len(coefficients) - 1
    return sp.Add(*[c.subs(designed) * p.s ** (order - n) for n, c in enumerate(coefficients)])


@pytest.mark.parametrize(
    ("name", "desired"), [("tan-gpi", FOURTH), ("fee-gpi", FOURTH), ("state-feedback", THIRD)]
)
def test_at_the_design_point_the_loop_has_the_desired_polynomial(
    name: str, desired: sp.Expr
) -> None:
    assert sp.expand(as_designed(EVERY[name]) - desired) == 0


def test_the_feedback_linearisation_is_designed_for_a_double_integrator() -> None:
    law = EVERY["fee-gpi"]
    assert law.C_Y == 0
    coefficients = stability.closed_loop_polynomial(law)
    assert not {p.C_Y_hat, p.C_U_hat} & set().union(*(c.free_symbols for c in coefficients))
    integrators = [c.subs({p.rho: 1, p.C_Y_true: 0}) for c in coefficients]
    assert integrators == [1, p.k3, p.k2, p.k1, p.k0]


PIDS = [name for name in EVERY if "lin-pid" in name]


@pytest.mark.parametrize("name", PIDS)
def test_without_its_filter_the_pid_has_the_desired_polynomial(name: str) -> None:
    polynomial = sp.expand(as_designed(EVERY[name]) / laws.omega_f)
    assert sp.expand(sp.limit(polynomial, laws.omega_f, sp.oo) - THIRD) == 0


@pytest.mark.parametrize("name", PIDS)
def test_without_its_filter_the_pid_is_the_state_feedback(name: str) -> None:
    ideal = sp.limit(EVERY[name].transfer(p.s), laws.omega_f, sp.oo)
    assert sp.simplify(ideal - EVERY["state-feedback"].transfer(p.s)) == 0


def test_with_feedforward_the_pid_commands_what_the_state_feedback_does_at_rest() -> None:
    pid, feedback = EVERY["lin-pid with feedforward"], EVERY["state-feedback"]
    still = feedback.command.subs(feedback.constants).subs(p.acc_ref, 0)
    assert sp.expand(pid.command.subs(pid.constants) - still) == 0
    assert EVERY["lin-pid"].command.subs(laws.w, 0) == p.U


@pytest.mark.parametrize("name", ["tan-gpi", "state-feedback", "lin-pid with feedforward"])
def test_a_linear_law_s_loop_gain_is_that_of_the_plant(name: str) -> None:
    assert EVERY[name].loop_gain == p.C_U
    assert EVERY[name].slope == 1
    assert sp.diff(EVERY[name].command, laws.w) == 1


# --- exact feedforward linearisation -------------------------------------------------------

FEE = EVERY["fee-gpi"]
TRUTH = {p.beta_c: p.beta}


def test_the_feedback_linearisation_holds_the_ball_at_any_gap() -> None:
    voltage = FEE.feedforward.subs(p.acc_ref, 0).subs(TRUTH)
    assert sp.simplify(voltage - (p.y_ref + p.y0) * sp.sqrt(p.g / p.beta)) == 0
    assert sp.simplify(PLANT.acceleration.subs({p.y: p.y_ref, p.u: voltage})) == 0
    assert not {p.U, p.Y, p.C_U, p.C_Y} & FEE.feedforward.free_symbols


def test_on_its_path_the_feedback_linearisation_asks_for_the_acceleration_it_says() -> None:
    pull = sp.Symbol("pull", positive=True)  # g - y*'' + w
    command = FEE.command.subs(FEE.constants).subs(TRUTH).subs(laws.w, pull - p.g + p.acc_ref)
    moved = PLANT.acceleration.subs({p.y: p.y_ref, p.u: command})
    assert sp.simplify(moved - (p.g - pull)) == 0


def test_its_loop_gain_is_the_plant_s_coefficient_times_the_slope() -> None:
    at_rest = {p.u: PLANT.equilibrium_voltage, p.y_ref: p.Y} | TRUTH
    gain = linearise(PLANT).C_U.subs(p.U, PLANT.equilibrium_voltage) * FEE.slope.subs(at_rest)
    assert sp.simplify(gain - FEE.loop_gain) == 0


COMMAND = lower(
    (laws.w, p.y_ref, p.acc_ref, p.beta_c, p.g, p.y0), {"u": FEE.command.subs(FEE.constants)}
).scalar()
SLOPE = lower((p.u, p.y_ref, p.beta_c, p.y0), {"slope": FEE.slope}).scalar()

gaps = st.floats(2e-3, 0.05)
betas = st.floats(1e-4, 1e-1)
offsets = st.one_of(st.just(0.0), st.floats(1e-4, 0.01))
gravity = 9.81
STEP = 1e-4
"""[m/s^2] Of the central differences; their error is its square over that of g, 1e-10."""


@given(gaps, betas, offsets, st.floats(-5.0, 30.0), st.floats(-3.0, 3.0))
def test_the_slope_is_that_of_the_command(
    y_ref: float, beta: float, y0: float, w: float, acc: float
) -> None:
    ends = [COMMAND(w + sign * STEP, y_ref, acc, beta, gravity, y0)[0] for sign in (1, -1)]
    (u,) = COMMAND(w, y_ref, acc, beta, gravity, y0)
    (slope,) = SLOPE(u, y_ref, beta, y0)
    assert slope == pytest.approx((ends[0] - ends[1]) / (2 * STEP), rel=1e-8)


corrections = st.floats(-200.0, 200.0)


@given(gaps, betas, offsets, corrections, corrections)
def test_the_command_rises_with_the_correction_everywhere(
    y_ref: float, beta: float, y0: float, one: float, other: float
) -> None:
    assume(abs(one - other) > 1e-6)
    low, high = sorted((one, other))
    a, b = (COMMAND(w, y_ref, 0.1, beta, gravity, y0)[0] for w in (low, high))
    assert a < b


@given(gaps, betas, offsets, st.floats(1e-3, 100.0))
def test_beyond_free_fall_the_command_is_negative_and_odd(
    y_ref: float, beta: float, y0: float, pull: float
) -> None:
    up, down = (COMMAND(s * pull - gravity, y_ref, 0.0, beta, gravity, y0)[0] for s in (1, -1))
    assert down < 0 < up
    # g and w cancel to `pull`
    assert up + down == pytest.approx(0.0, abs=1e-11 * up / min(1.0, pull))
    known = Known(math.nan, math.nan, math.nan, math.nan, beta, gravity, y0)
    assert down == pytest.approx(byhand.command(LAWS["fee-gpi"], -pull - gravity, y_ref, 0, known))


# --- against the nonlinear loop, differentiated numerically --------------------------------


def nonlinear_rates(
    law: Controller, k: dict[str, float], x: Array, y_ref: float, beta: float, known: Known
) -> Array:
    """Return the rates of (y, y', controller states) of the nonlinear loop at a held reference."""
    a, b, c, d = byhand.core(law, k, known.C_U, known.C_Y)
    read = np.array([x[0] - y_ref, x[1], x[0] - known.Y])
    w = (c @ x[2:] + d @ read).item()
    u = byhand.command(law, w, y_ref, 0.0, known)
    pull = known.g - beta * u**2 / (x[0] + known.y0) ** 2
    return np.array([x[1], pull, *(a @ x[2:] + b @ read)])


def at_rest(law: Controller, k: dict[str, float], y_ref: float, beta: float, known: Known) -> Array:
    """Return the state in which a loop with an integrator rests at y*."""
    a, b, c, d = byhand.core(law, k, known.C_U, known.C_Y)
    u = math.sqrt(known.g / beta) * (y_ref + known.y0)
    ends = [byhand.command(law, w, y_ref, 0.0, known) for w in (0.0, 1.0)]
    w = u - ends[0]
    if law.name == "fee-gpi":
        w = known.beta * (u / (y_ref + known.y0)) ** 2 - known.g
    else:
        assert ends[1] - ends[0] == pytest.approx(1.0)
    read = np.array([0.0, 0.0, y_ref - known.Y])
    states = np.zeros(len(a))
    if len(a) > 1:
        states[1] = -(b @ read)[1] / a[1, 1]
    states[0] = (w - (c @ states + d @ read).item()) / c[0, 0]
    return np.array([y_ref, 0.0, *states])


SCALES = (1e-8, 1e-6, 1e-9, 1e-9)
"""Steps of the central differences in y, y' and the controller's states [SI]."""


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize(("share", "factor"), [(1.0, 1.0), (0.6, 0.85), (1.2, 1.15)])
def test_the_polynomial_is_that_of_the_nonlinear_loop(
    name: str, share: float, factor: float
) -> None:
    # at the gap `share` Y, the controller's beta off by `factor`
    law, symbolic = LAWS[name], EVERY[name]
    g, y0, Y, beta = 9.81, 1.5e-3, 0.0246, 1.3e-3
    beta_c = factor * beta
    U = math.sqrt(g / beta_c) * (Y + y0)
    known = Known(Y, U, 2 * g / U, 2 * g / (Y + y0), beta_c, g, y0)
    k = byhand.gains_of(law, (0.9, 60.0, 1.2, 75.0))
    y_ref = share * Y
    x = at_rest(law, k, y_ref, beta, known)
    assert nonlinear_rates(law, k, x, y_ref, beta, known) == pytest.approx(0.0, abs=1e-9)
    columns = []
    for n, step in enumerate(SCALES[: len(x)]):
        moved = step * np.eye(len(x))[n]
        ends = [nonlinear_rates(law, k, x + s * moved, y_ref, beta, known) for s in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * step))
    jacobian = np.stack(columns, axis=1)

    u = math.sqrt(g / beta) * (y_ref + y0)
    numbers = {p.u: u, p.y_ref: y_ref, p.beta_c: beta_c, p.y0: y0, p.C_U: known.C_U}
    gain = 2 * g / u * float(sp.sympify(symbolic.slope).subs(numbers))
    rho = gain / float(sp.sympify(symbolic.loop_gain).subs(numbers))
    values = {p.rho: rho, p.C_Y_true: 2 * g / (y_ref + y0), p.C_Y_hat: known.C_Y}
    values |= {gain: k[gain.name] for gain in symbolic.gains}
    ours = [float(c.subs(values)) for c in stability.closed_loop_polynomial(symbolic)]
    theirs = np.poly(np.linalg.eigvals(jacobian)).real
    assert ours == pytest.approx(theirs, rel=1e-6)
