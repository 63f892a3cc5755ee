from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import byhand
import control
import numpy as np
import pytest
from byhand import LAWS, OTHERS, Known
from numpy.typing import NDArray
from rigs import OFFSET, SHORT, changed, rig_with
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.signal import cont2discrete, tf2ss

from maglev_design import linear_loop as loops
from maglev_design.controller.design import PoleSpec, believed_equilibrium, make_design, plant_beta
from maglev_design.controller.family import Family, family_of
from maglev_design.errors import InputError
from maglev_design.linear_loop import Loop, build_loop
from maglev_design.options import EQUILIBRIA, METHODS, TAN_GPI, Controller, Equilibrium, Method
from maglev_design.rig import Rig
from maglev_design.simulation import Scenario, loop_for
from maglev_design.simulation.scenario import parameter_vector
from maglev_design.simulation.stepping import run

Array = NDArray[np.float64]

PAPER_MS = {"euler": (1.81, 2.61), "tustin": (1.95, 2.9)}
"""Worst Ms over +-15 % and the path at zeta = 1, omega_n = 70; then with one more sample.

Found beforehand by another program for the rig of Belmonte et al. (2021), in these digits.
"""
PAPER_DIGITS = {"euler": (0.005, 0.005), "tustin": (0.005, 0.05)}

GRID_MISS = 2e-3
"""A peak of |S| lies between the lines of the dense grid: second order in their distance."""
ROUNDING = 1e-7
"""The independent loop has other states; near z = 1 both lose digits."""
NOISE_ROUNDING = 1e-6
"""The noise of a loop with a pole near 1 loses digits."""
DOUBLINGS = 20
"""A million samples: every loop here has forgotten its start by then."""
STEP = {"Ms": 1e-5, "noise": 1e-5, "hurwitz": 1e-5, "radius": 3e-4}
"""Relative; eigenvalues that lie close to each other near z = 1 have half the digits."""
DIFFERENCE = 5e-4
"""Of central differences with these steps, of a value that a search or eigenvalues give."""

DELAYED = {
    "sampling.delay": 0.0017,
    "uncertainty.beta": 0.1,
    "operating_point.voltage": 2.15,
}
RIGS = {
    "short": rig_with(SHORT, {"uncertainty.beta": 0.1, "operating_point.voltage": 2.1}),
    "part of a sample late": rig_with(
        SHORT,
        {"sampling.delay": 0.0004, "uncertainty.beta": 0.1, "operating_point.voltage": 2.0},
    ),
    "more than a sample late": rig_with(SHORT, DELAYED),
    "offset": rig_with(OFFSET, {"uncertainty.beta": 0.1, "operating_point.voltage": 3.4}),
    "offset, late, measured voltage": rig_with(
        OFFSET, {"sampling.delay": 0.0007, "operating_point.voltage": 3.2}
    ),
}
POLES = (1.1, 75.0, 0.8, 95.0)


# --- the same loop, built without the package's formulas -----------------------------------


@dataclass(frozen=True)
class Linear:
    """The closed loop from sensor noise; its state is (plant, voltages on their way, law)."""

    A: Array
    B: Array
    y: Array
    u: Array
    through: float
    period: float

    def sensitivity(self) -> Any:
        return control.ss(self.A, self.B, self.y, [[1.0]], self.period)

    def radius(self) -> float:
        return float(np.abs(np.linalg.eigvals(self.A)).max())

    def noise(self) -> float:
        # sum of A^k B B' A'^k by doubling: solvers of Lyapunov's equation are ill-conditioned here
        covariance, power = self.B @ self.B.T, self.A
        for _ in range(DOUBLINGS):
            covariance = covariance + power @ covariance @ power.T
            power = power @ power
        return math.sqrt((self.u @ covariance @ self.u.T).item() + self.through**2)


def gains_of(poles: tuple[float, ...]) -> Array:
    (z1, w1), (z2, w2) = poles[:2], poles[2:]
    product = np.polymul([1, 2 * z1 * w1, w1**2], [1, 2 * z2 * w2, w2**2])
    return np.asarray(product[:0:-1], dtype=float)


def told(rig: Rig, reading: Equilibrium) -> Known:
    plant, point = rig.plant, rig.operating_point
    g, Z = plant.gravity, point.gap + plant.gap_offset
    beta_c = plant.force_constant * rig.current_gain**2 / plant.mass
    U = math.sqrt(g / beta_c) * Z
    if reading != "model":
        assert point.voltage is not None
        U = point.voltage
    C_U, C_Y = 2 * g / U, 2 * g / Z
    if reading == "appendix-a":
        C_U, C_Y = 2 * beta_c * U / Z**2, 2 * beta_c * U**2 / Z**3
    if reading == "measured":
        beta_c = g * Z**2 / U**2
    return Known(point.gap, U, C_U, C_Y, beta_c, g, plant.gap_offset)


def actual(rig: Rig, gap: float, beta: float) -> tuple[float, float]:
    plant = rig.plant
    g, Z = plant.gravity, gap + plant.gap_offset
    return 2 * g / (math.sqrt(g / beta) * Z), 2 * g / Z


def linear(
    rig: Rig,
    method: Method,
    poles: tuple[float, ...],
    gap: float,
    ratio: float,
    reading: Equilibrium = "model",
    extra: int = 0,
    controller: Controller = TAN_GPI,
) -> Linear:
    T, delay = rig.sampling.period, rig.sampling.delay + extra * rig.sampling.period
    known = told(rig, reading)
    if controller == TAN_GPI:
        k0, k1, k2, k3 = gains_of(poles)
        C_U, C_Y = known.C_U, known.C_Y
        law = tf2ss(np.array([k2 + C_Y, k1 + k3 * C_Y, k0]) / C_U, [1.0, k3, 0.0])
        a, b, c, d, _ = cont2discrete(law, T, byhand.SCIPY_NAME[method])
        heard = np.array([[1.0, 0.0]])
    else:
        k = byhand.gains_of(controller, poles)
        a, b, c, d = byhand.sampled(byhand.core(controller, k, known.C_U, known.C_Y), T, method)
        heard = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
        held_at = math.sqrt(known.g * ratio / known.beta) * (gap + known.y0)
        rise = byhand.slope(controller, held_at, gap, known)
        c, d = rise * c, rise * d
    noisy = heard @ np.array([[1.0], [0.0]])  # noise is on the gap alone
    b_noise, d_noise = b @ noisy, (d @ noisy).item()
    b, d = b @ heard, d @ heard

    true_u, true_y = actual(rig, gap, known.beta / ratio)
    flow = np.zeros((3, 3))
    flow[:2] = np.array([[0.0, 1.0, 0.0], [true_y, 0.0, -true_u]])
    whole = math.floor(round(delay / T, 9))
    part = max(0.0, delay - whole * T)
    part = 0.0 if part < 1e-12 else part
    held = whole + (part > 0)
    A_1, A_0 = expm(flow * part), expm(flow * (T - part))
    fresh, stale = A_0[:2, 2], A_0[:2, :2] @ A_1[:2, 2]
    own = len(a)
    size = 2 + held + own
    u = np.zeros((1, size))
    u[0, :2], u[0, -own:] = d.ravel(), c.ravel()
    onto = [u, *np.eye(size)[None, 2 : 2 + held].transpose(1, 0, 2)]  # u_k, u_{k-1}, ...
    A = np.zeros((size, size))
    A[:2, :2] = expm(flow * T)[:2, :2]
    A[:2] += np.outer(fresh, onto[whole])
    if part:
        A[:2] += np.outer(stale, onto[whole + 1])
    B = np.zeros((size, 1))
    B[:2, 0] = fresh * d_noise if whole == 0 else 0.0
    for n in range(held):
        A[2 + n] = onto[n]
        B[2 + n] = d_noise if n == 0 else 0.0
    A[-own:, -own:], A[-own:, :2], B[-own:] = a, b, b_noise
    return Linear(A, B, np.eye(size)[:1], u, d_noise, T)


def over(rig: Rig) -> Family:
    return family_of(rig)


def loop_of(
    rig: Rig,
    method: Method = "tustin",
    reading: Equilibrium = "model",
    extra: int = 0,
    controller: Controller = TAN_GPI,
) -> Loop:
    return build_loop(
        rig,
        believed_equilibrium(rig, reading),
        method=method,
        controller=controller,
        extra_samples=extra,
    )


CASES: list[tuple[str, Method, Equilibrium, int]] = [
    *[("short", method, "model", 0) for method in METHODS],
    *[("offset", "tustin", reading, 0) for reading in EQUILIBRIA],
    *[("part of a sample late", method, "model", 0) for method in METHODS],
    ("more than a sample late", "euler", "appendix-a", 0),
    ("short", "tustin", "model", 1),
    ("part of a sample late", "zoh", "measured", 1),
    ("offset, late, measured voltage", "tustin", "measured", 0),
    ("offset, late, measured voltage", "tustin", "appendix-a", 1),
]


# --- published and independent values ------------------------------------------------------


@pytest.mark.parametrize("method", PAPER_MS)
@pytest.mark.parametrize("extra", [0, 1])
def test_the_papers_gains_have_the_known_peak_of_sensitivity(
    paper_rig: Rig, method: Method, extra: int
) -> None:
    found = loops.peak_sensitivity(
        loop_of(paper_rig, method, extra=extra), (1, 70, 1, 70), over(paper_rig)
    )
    assert found.value == pytest.approx(
        PAPER_MS[method][extra], abs=PAPER_DIGITS[method][extra] + 0.02 * (method == "tustin")
    )
    assert [found.gap, found.ratio] == pytest.approx([0.012, 0.85])


@pytest.mark.parametrize(("name", "method", "reading", "extra"), CASES)
def test_no_point_of_a_dense_grid_has_a_higher_sensitivity(
    name: str, method: Method, reading: Equilibrium, extra: int
) -> None:
    rig = RIGS[name]
    found = loops.peak_sensitivity(loop_of(rig, method, reading, extra), POLES, over(rig))
    theta = math.pi * np.geomspace(5e-3, 1, 250)
    peak = found.omega * rig.sampling.period  # where it is sharp, look closer
    theta = np.append(theta, peak * np.linspace(0.97, 1.03, 61))
    circle = np.exp(1j * theta[theta <= math.pi])
    dense = 0.0
    for gap, ratio in over(rig).grid(5, 3).T:
        system = linear(rig, method, POLES, gap, ratio, reading, extra).sensitivity()
        dense = max(dense, float(np.abs(system(circle)).max()))
    assert dense <= found.value * (1 + ROUNDING)
    assert found.value <= dense * (1 + GRID_MISS)
    here = linear(rig, method, POLES, found.gap, found.ratio, reading, extra).sensitivity()
    at = np.exp(1j * found.omega * rig.sampling.period)
    assert abs(here(at)) == pytest.approx(found.value, rel=ROUNDING)


@pytest.mark.parametrize(("name", "method", "reading", "extra"), CASES)
def test_the_spectral_radius_is_that_of_the_state_space(
    name: str, method: Method, reading: Equilibrium, extra: int
) -> None:
    rig = RIGS[name]
    found = loops.spectral_radius(loop_of(rig, method, reading, extra), POLES, over(rig))
    radii = [
        linear(rig, method, POLES, gap, ratio, reading, extra).radius()
        for gap, ratio in over(rig).grid(5, 3).T
    ]
    assert found.value == pytest.approx(max(radii), rel=1e-6)


@pytest.mark.parametrize(("name", "method", "reading", "extra"), CASES)
def test_the_noise_voltage_is_that_of_the_state_space(
    name: str, method: Method, reading: Equilibrium, extra: int
) -> None:
    rig = RIGS[name]
    poles = (1.0, 60.0, 0.9, 50.0)
    found = loops.noise_voltage(loop_of(rig, method, reading, extra), poles, over(rig), 2e-6)
    every = [
        linear(rig, method, poles, gap, ratio, reading, extra)
        for gap, ratio in over(rig).grid(5, 3).T
    ]
    assert all(one.radius() < 1 for one in every)
    expected = 2e-6 * max(one.noise() for one in every)
    assert found.value == pytest.approx(expected, rel=NOISE_ROUNDING)


def test_twice_the_sensor_noise_makes_twice_the_voltage() -> None:
    rig = RIGS["short"]
    one, two = (loops.noise_voltage(loop_of(rig), POLES, over(rig), s) for s in (1e-6, 2e-6))
    assert two.value == pytest.approx(2 * one.value)
    assert two.gradient == pytest.approx(2 * one.gradient)


@pytest.mark.parametrize("seed", range(12))
def test_the_hurwitz_margin_is_positive_exactly_where_the_roots_are_left(seed: int) -> None:
    random = np.random.default_rng(seed)
    rig = RIGS["offset" if seed % 2 else "short"]
    reading = EQUILIBRIA[seed % 3]
    function = loop_of(rig, reading=reading)
    low, high = over(rig).gaps
    for _ in range(20):
        w = random.uniform(0.4, 3, 2) * math.sqrt(2 * 9.81 / high)
        poles = (random.uniform(0.3, 2), float(w[0]), random.uniform(0.3, 2), float(w[1]))
        gap, ratio = random.uniform(0.3 * low, high), random.uniform(0.4, 3)
        k0, k1, k2, k3 = gains_of(poles)
        known = told(rig, reading)
        (b_u, b_y), (c_u, c_y) = (known.C_U, known.C_Y), actual(rig, gap, known.beta / ratio)
        law = c_u / b_u * np.array([k2 + b_y, k1 + k3 * b_y, k0])
        polynomial = np.polyadd(np.polymul([1, 0, -c_y], [1, k3, 0]), law)
        right = float(np.roots(polynomial).real.max())
        at = Family((gap, gap), (ratio, ratio))
        assert (loops.hurwitz_margin(function, poles, at).value > 0) == (right < 0)


def test_the_hurwitz_margin_is_one_as_designed() -> None:
    rig = RIGS["offset"]
    gap = rig.operating_point.gap
    found = loops.hurwitz_margin(loop_of(rig), POLES, Family((gap, gap), (1, 1)))
    assert found.value == pytest.approx(1.0)


# --- gradients -----------------------------------------------------------------------------


def differences(function: Any, poles: tuple[float, ...], step: float) -> list[float]:
    found = []
    for n in range(4):
        up, down = list(poles), list(poles)
        up[n] *= 1 + step
        down[n] *= 1 - step
        found.append((function(up) - function(down)) / (up[n] - down[n]))
    return found


GRADIENT_CASES = [
    ("tan-gpi", name, seed)
    for name in ("short", "more than a sample late", "offset")
    for seed in range(3)
]
GRADIENT_CASES += [(law, "offset", n % 3) for n, law in enumerate(OTHERS)]


@pytest.mark.parametrize("figure", ["Ms", "radius", "noise", "hurwitz"])
@pytest.mark.parametrize(("law", "name", "seed"), GRADIENT_CASES)
def test_gradients_by_the_four_poles_are_those_of_the_values(
    figure: str, law: str, name: str, seed: int
) -> None:
    rig = RIGS[name]
    random = np.random.default_rng(seed)
    z1, z2 = random.uniform(0.7, 1.4, 2)
    w1, w2 = random.uniform(45, 70, 2)
    poles = (float(z1), float(w1), float(z2), float(w2))
    function, where = loop_of(rig, METHODS[seed], controller=LAWS[law]), over(rig)

    def value(p: Any) -> loops.Extreme:
        if figure == "Ms":
            return loops.peak_sensitivity(function, p, where)
        if figure == "radius":
            return loops.spectral_radius(function, p, where)
        if figure == "noise":
            return loops.noise_voltage(function, p, where, 1.0)
        return loops.hurwitz_margin(function, p, where)

    gradient = value(poles).gradient
    numeric = np.array(differences(lambda p: value(p).value, poles, STEP[figure]))
    scale = np.array(poles)
    size = np.abs(numeric * scale).max()
    assert size > 0
    assert np.abs((gradient - numeric) * scale).max() <= DIFFERENCE * size


# --- every controller ----------------------------------------------------------------------

POLYNOMIAL = 1e-9
"""Relative to its value on circles that enclose the roots, near 1 and all."""
CIRCLES = np.concatenate(
    [
        center + radius * np.exp(2j * np.pi * np.arange(16) / 16)
        for center, radius in ((1, 0.4), (0, 1.5))
    ]
)
LATE: dict[str, tuple[str, int]] = {
    "in time": ("short", 0),
    "part of a sample late": ("part of a sample late", 0),
    "more than a sample late": ("more than a sample late", 0),
    "a sample and more late, offset": ("offset, late, measured voltage", 1),
}


def evaluated(rig: Rig, system: Linear) -> Any:
    """Return det(z I - A) on the circles, and the root 0 of a delay without a part."""
    size = len(system.A)
    values = np.array([np.linalg.det(z * np.eye(size) - system.A) for z in CIRCLES])
    part = round(rig.sampling.delay / rig.sampling.period, 9) % 1
    return values if part else values * CIRCLES


@pytest.mark.parametrize("late", LATE)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", LAWS)
def test_the_characteristic_is_that_of_the_state_space(
    name: str, method: Method, late: str
) -> None:
    (case, extra), law = LATE[late], LAWS[name]
    rig = RIGS[case]
    for reading in EQUILIBRIA:
        function = loop_of(rig, method, reading, extra, law)
        for gap, ratio in ((rig.operating_point.gap, 1.0), (0.016, 0.85), (0.012, 1.2)):
            system = linear(rig, method, POLES, gap, ratio, reading, extra, law)
            row = function.characteristic(POLES, gap, ratio)[0].full().ravel()
            expected = evaluated(rig, system)
            assert np.polyval(row, CIRCLES) == pytest.approx(expected, rel=POLYNOMIAL)


OTHER_CASES: list[tuple[str, str, Method, Equilibrium, int]] = [
    (name, *case) for name in OTHERS for case in (CASES[n] for n in (1, 7, 10))
]


@pytest.mark.parametrize(("law", "name", "method", "reading", "extra"), OTHER_CASES)
def test_sensitivity_radius_and_noise_of_every_controller(
    law: str, name: str, method: Method, reading: Equilibrium, extra: int
) -> None:
    rig, poles, controller = RIGS[name], (1.0, 60.0, 0.9, 50.0), LAWS[law]
    function = loop_of(rig, method, reading, extra, controller)
    every = [
        linear(rig, method, poles, gap, ratio, reading, extra, controller)
        for gap, ratio in over(rig).grid(5, 3).T
    ]
    radius = loops.spectral_radius(function, poles, over(rig)).value
    assert radius == pytest.approx(max(one.radius() for one in every), rel=1e-6)
    if radius < 1:
        noise = loops.noise_voltage(function, poles, over(rig), 2e-6).value
        expected = 2e-6 * max(one.noise() for one in every)
        assert noise == pytest.approx(expected, rel=NOISE_ROUNDING)
    if controller.name == "state-feedback":
        return  # the noise of one of two sensors is not what |S| is about
    found = loops.peak_sensitivity(function, poles, over(rig))
    here = linear(rig, method, poles, found.gap, found.ratio, reading, extra, controller)
    at = np.exp(1j * found.omega * rig.sampling.period)
    assert abs(here.sensitivity()(at)) == pytest.approx(found.value, rel=ROUNDING)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("late", ["short", "more than a sample late"])
def test_the_sensitivity_of_the_state_feedback_is_that_of_the_loop_cut_at_the_plant(
    late: str, method: Method
) -> None:
    rig, law = RIGS[late], LAWS["state-feedback"]
    function = loop_of(rig, method, controller=law)
    for theta in (0.02, 0.1, 0.5, 2.0):
        z = np.exp(1j * theta)
        # 1/(1 + L), L = 0 when the law is deaf: the same matrices with and without feedback
        closed = linear(rig, method, POLES, 0.021, 1.1, controller=law)
        size = len(closed.A)
        chi = np.linalg.det(z * np.eye(size) - closed.A)
        a, *_ = byhand.sampled(
            byhand.core(law, byhand.gains_of(law, POLES), 1.0, 1.0), rig.sampling.period, method
        )
        _, c_y = actual(rig, 0.021, 1.1)
        flow = expm(np.array([[0, 1], [c_y, 0]]) * rig.sampling.period)
        cut = np.linalg.det(z * np.eye(2) - flow) * np.linalg.det(z * np.eye(len(a)) - a)
        cut *= z ** (size - 2 - len(a))
        found = float(function.sensitivity(POLES, 0.021, 1.1, theta)[0])
        assert found == pytest.approx(abs(cut / chi), rel=ROUNDING)


@pytest.mark.parametrize("name", OTHERS)
def test_the_hurwitz_margin_of_every_controller_decides_stability(name: str) -> None:
    random, law = np.random.default_rng(7), LAWS[name]
    rig = RIGS["offset"]
    functions = {reading: loop_of(rig, reading=reading, controller=law) for reading in EQUILIBRIA}
    low, high = over(rig).gaps
    verdicts = []
    for n in range(60):
        reading = EQUILIBRIA[n % 3]
        w = random.uniform(0.1, 2, 2) * math.sqrt(2 * 9.81 / high)
        poles = (random.uniform(0.3, 2), float(w[0]), random.uniform(0.3, 2), float(w[1]))
        gap, ratio = random.uniform(0.3 * low, 3 * high), random.uniform(0.1, 3)
        known = told(rig, reading)
        c_u, c_y = actual(rig, gap, known.beta / ratio)
        a, b, c, d = byhand.core(law, byhand.gains_of(law, poles), known.C_U, known.C_Y)
        c_u *= byhand.slope(law, 2 * known.g / c_u, gap, known)
        heard = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
        plant = np.array([[0.0, 1.0], [c_y, 0.0]]) - c_u * np.vstack([np.zeros((1, 2)), d @ heard])
        reach = -c_u * np.vstack([np.zeros_like(c), c])
        right = np.linalg.eigvals(np.block([[plant, reach], [b @ heard, a]])).real.max()
        margin = loops.hurwitz_margin(functions[reading], poles, Family((gap, gap), (ratio, ratio)))
        assert (margin.value > 0) == (right < 0)
        verdicts.append(bool(right < 0))
    assert 0 < sum(verdicts) < len(verdicts), "both verdicts occur"


def test_a_filter_that_destabilises_the_design_has_no_hurwitz_margin() -> None:
    # the pole of the filter at half the others': the loop that (16) places is not stable with it
    rig, law = RIGS["short"], Controller("lin-pid", filter=0.5)
    gap = rig.operating_point.gap
    at, function = Family((gap, gap), (1, 1)), loop_of(rig, controller=law)
    assert loops.spectral_radius(function, (1, 60, 1, 60), at).value > 1
    assert loops.hurwitz_margin(function, (1, 60, 1, 60), at).value < 0


@pytest.mark.parametrize("name", LAWS)
def test_the_hurwitz_margin_of_every_controller_is_one_as_designed(name: str) -> None:
    rig, law = RIGS["offset"], LAWS[name]
    gap = rig.operating_point.gap
    found = loops.hurwitz_margin(loop_of(rig, controller=law), POLES, Family((gap, gap), (1, 1)))
    if law.name == "fee-gpi":  # designed for a double integrator, which no magnet is
        assert 0 < found.value < 1
    else:
        assert found.value == pytest.approx(1.0)


# --- the simulated loop, linearised --------------------------------------------------------

NUDGES = {"y": 1e-9, "v": 1e-7, "x1": 1e-11, "x2": 1e-11, "held": 1e-6}
"""Steps of the central differences [SI]."""
LINEARISED = 1e-6
"""Relative: RK4 leaves 1e-7, the central differences their squares."""


@pytest.mark.parametrize("share", [0.0, 0.4, 1.7])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", LAWS)
def test_the_linear_loop_is_the_simulated_one_for_small_deviations(
    name: str, method: Method, share: float
) -> None:
    # at rest at another gap than Y, on a plant with another beta: one period, differentiated
    period, gap, ratio, law = 1e-3, 0.0215, 1.1, LAWS[name]
    hold = {"start_gap": gap, "end_gap": gap, "start_time": 0.0, "end_time": period}
    data = changed(
        SHORT,
        {
            "sampling.delay": share * period,
            "initial.gap": gap,
            "reference": {**hold, "horizon": period},
        },
    )
    rig = rig_with(data)
    pairs = PoleSpec(POLES[:2], POLES[2:])
    beta = plant_beta(rig) / ratio
    design = make_design(rig, pairs, controller=law, method=method)
    loop = loop_for(rig, design, refine=4)
    numbers = parameter_vector(loop, design, Scenario(beta, gap))
    names, still = loop.state_names, np.zeros((2, 1))
    voltage = math.sqrt(9.81 / beta) * gap

    def moved(state: Array) -> tuple[Array, float]:
        states, volts, _ = run(loop, state, numbers, still)
        return states.full().ravel(), float(volts[0])

    rest = np.array([{"y": gap, "alive": 1.0}.get(n, 0.0) for n in names])
    rest[[n.startswith("held") for n in names]] = voltage
    if law.derivative == "measurement":
        rest[names.index("x2")] = (gap - design.Y) / design.named_gains["omega_f"]
    first = names.index("x1")

    def excess(x1: float) -> float:
        rest[first] = x1
        return moved(rest)[1] - voltage

    reach = 2.0 / design.coefficients["c1"] * (1.0 if law.name != "fee-gpi" else 9.0)
    rest[first] = brentq(excess, -reach, reach, xtol=1e-16, rtol=1e-13)
    assert moved(rest)[0] == pytest.approx(rest, abs=1e-9)
    columns = []
    for n, state in enumerate(names[:-1]):
        step = NUDGES["held" if state.startswith("held") else state]
        ends = [moved(rest + s * step * np.eye(len(names))[n])[0] for s in (1, -1)]
        columns.append((ends[0] - ends[1])[:-1] / (2 * step))
    jacobian = np.stack(columns, axis=1)
    row = loop_of(rig, method, controller=law).characteristic(POLES, gap, ratio)[0].full().ravel()
    system = Linear(jacobian, still, still, still, 0.0, period)
    ours, theirs = np.polyval(row, CIRCLES), evaluated(rig, system)
    for circle in (slice(0, 16), slice(16, 32)):
        size = LINEARISED * np.abs(theirs[circle]).max()
        assert ours[circle] == pytest.approx(theirs[circle], abs=size)


# --- shapes --------------------------------------------------------------------------------


def test_the_family_spans_path_start_and_equilibrium_and_the_ratios(paper_rig: Rig) -> None:
    found = family_of(paper_rig)
    assert found.gaps == (0.012, 0.0246)
    assert found.ratios == pytest.approx((0.85, 1.15))


def test_a_family_has_four_corners_or_fewer_when_an_interval_is_a_point() -> None:
    def corners(over: Family) -> set[tuple[float, float]]:
        columns = over.corner_columns(5, 3)
        found = {(float(gap), float(ratio)) for gap, ratio in over.grid(5, 3)[:, columns].T}
        assert len(found) == len(columns)
        return found

    assert corners(Family((0.01, 0.02), (0.9, 1.1))) == {
        (0.01, 0.9),
        (0.01, 1.1),
        (0.02, 0.9),
        (0.02, 1.1),
    }
    assert corners(Family((0.01, 0.02), (1.0, 1.0))) == {(0.01, 1.0), (0.02, 1.0)}
    assert corners(Family((0.01, 0.01), (1.0, 1.0))) == {(0.01, 1.0)}


def test_a_measured_voltage_makes_the_ratio_s_interval() -> None:
    rig = RIGS["offset"]
    assert family_of(rig, "measured").ratios == pytest.approx((0.99**2, 1.01**2))
    stated = rig_with(rig.model_dump(exclude_none=True), {"uncertainty.voltage": 0.03})
    assert family_of(stated, "measured").ratios == pytest.approx((0.97**2, 1.03**2))
    assert family_of(stated, "measured", 0.2).ratios == pytest.approx((0.8, 1.2))
    for reading in ("model", "appendix-a"):
        assert family_of(stated, reading).ratios == pytest.approx((0.9, 1.1))
    with pytest.raises(InputError, match="less than 1"):
        family_of(rig, "model", 1.0)


@pytest.mark.parametrize("reading", ["model", "measured"])
def test_another_offset_is_another_direction_of_the_family(reading: Equilibrium) -> None:
    """Every plant of the family, built by itself, is as the family's rectangles say."""
    data = RIGS["offset"].model_dump(exclude_none=True)
    y0, Y = RIGS["offset"].plant.gap_offset, RIGS["offset"].operating_point.gap
    offsets = (y0 - 0.0005, y0 + 0.001)
    rig = rig_with(data, {"uncertainty.gap_offset": list(offsets)})
    own, whole = believed_equilibrium(rig, reading), family_of(rig, reading)
    known = loops.peak_sensitivity(loop_of(rig, reading=reading), POLES, whole).value
    found = []
    for offset in (offsets[0], y0, offsets[1]):
        other = rig_with(data, {"plant.gap_offset": offset})
        loop = build_loop(other, own, method="tustin")
        for ratio in whole.ratios:
            beta = own.beta / ratio
            if reading == "measured":  # the plants that hold the ball at Y with the same U
                beta *= ((Y + offset) / (Y + y0)) ** 2
                U = math.sqrt(rig.plant.gravity / beta) * (Y + offset)
                assert pytest.approx(own.U * math.sqrt(ratio), rel=1e-12) == U
            true = own.beta / beta
            assert whole.ratio_at(ratio, offset - y0) == pytest.approx(true, rel=1e-12)
            for gap in whole.gaps:
                at = Family((gap, gap), (true, true))
                found.append(loops.peak_sensitivity(loop, POLES, at).value)
    assert max(found) <= known * (1 + ROUNDING)
    assert known <= max(found) * (1 + GRID_MISS)


@pytest.mark.parametrize("extra", [0, 1])
def test_every_corner_s_peak_and_noise_are_those_of_the_corner_alone(extra: int) -> None:
    rig = rig_with(SHORT)
    function, whole = loop_of(rig, extra=extra), over(rig)
    corners = whole.grid(5, 3)[:, whole.corner_columns(5, 3)]
    for several in (loops.peak_sensitivities, _noises):
        _, *found = several(function, POLES, whole)
        for (gap, ratio), one in zip(corners.T, found, strict=True):
            point = Family((gap, gap), (ratio, ratio))
            alone = several(function, POLES, point)[0]
            assert one.value == pytest.approx(alone.value, rel=1e-9)
            assert one.gradient == pytest.approx(alone.gradient, rel=1e-4, abs=1e-9)


def _noises(function: loops.Loop, poles: Sequence[float], at: Family) -> tuple[loops.Extreme, ...]:
    return loops.noise_voltages(function, poles, at, 1.0)


def test_the_figures_of_a_box_are_those_of_each_of_its_points() -> None:
    rig = rig_with(SHORT)
    function, whole = loop_of(rig), over(rig)
    columns = np.array([[1.0, 70.0, 1.0, 70.0], [0.8, 55.0, 1.2, 90.0]]).T
    found = loops.coarse_figures(function, columns, whole)
    for n, poles in enumerate(columns.T):
        assert found.radius[n] == pytest.approx(
            loops.spectral_radius(function, poles, whole).value, rel=1e-9
        )
        assert found.hurwitz[n] == pytest.approx(
            loops.hurwitz_margin(function, poles, whole).value, rel=1e-2
        )
        fine = loops.peak_sensitivity(function, poles, whole).value
        assert fine * 0.99 <= found.peak[n] <= fine * (1 + 1e-12)
        assert found.noise[n] == pytest.approx(
            loops.noise_voltage(function, poles, whole, 1.0).value, rel=1e-2
        )


def test_a_grid_has_its_ends_and_no_point_twice() -> None:
    grid = Family((0.01, 0.02), (0.9, 1.1)).grid(3, 2)
    assert grid.shape == (2, 6)
    assert len(np.unique(grid, axis=1).T) == 6
    assert set(grid[0]) == {0.01, 0.015, 0.02}
    assert Family((0.01, 0.01), (0.9, 1.1)).grid(5, 3).shape == (2, 3)


def test_one_more_sample_is_one_more_period_of_delay() -> None:
    late = rig_with(SHORT, {"sampling.delay": 0.0014})
    point = (POLES, 0.021, 1.05)
    a = loop_of(rig_with(SHORT, {"sampling.delay": 0.0004}), extra=1).characteristic(*point)[0]
    b = loop_of(late).characteristic(*point)[0]
    assert a.full() == pytest.approx(b.full(), rel=1e-9)
