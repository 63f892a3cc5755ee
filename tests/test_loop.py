from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import control
import numpy as np
import pytest
from numpy.typing import NDArray
from rigs import OFFSET, SHORT, rig_with
from scipy.linalg import expm
from scipy.signal import cont2discrete, tf2ss

from maglev_design import loop as loops
from maglev_design.choices import EQUILIBRIA, METHODS, Equilibrium, Method
from maglev_design.loop import Family, Loop, build_loop
from maglev_design.parameters import Rig

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

DELAYED = {"sampling.delay": 0.0017, "uncertainty.beta": 0.1}
RIGS = {
    "short": rig_with(SHORT, {"uncertainty.beta": 0.1}),
    "part of a sample late": rig_with(SHORT, {"sampling.delay": 0.0004, "uncertainty.beta": 0.1}),
    "more than a sample late": rig_with(SHORT, DELAYED),
    "offset": rig_with(OFFSET, {"uncertainty.beta": 0.1}),
    "offset, late, measured voltage": rig_with(
        OFFSET, {"sampling.delay": 0.0007, "operating_point.voltage": 14.0}
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


def believed(rig: Rig, reading: Equilibrium, ratio: float) -> tuple[float, float]:
    plant, point = rig.plant, rig.operating_point
    g, Z = plant.gravity, point.gap + plant.gap_offset
    beta_c = plant.force_constant * plant.current_gain**2 / plant.mass
    U = math.sqrt(g / beta_c) * Z
    if reading != "model":
        U = point.voltage or math.sqrt(g * ratio / beta_c) * Z
    if reading == "appendix-a":
        return 2 * beta_c * U / Z**2, 2 * beta_c * U**2 / Z**3
    return 2 * g / U, 2 * g / Z


def actual(rig: Rig, gap: float, ratio: float) -> tuple[float, float]:
    plant = rig.plant
    g, Z = plant.gravity, gap + plant.gap_offset
    beta = plant.force_constant * plant.current_gain**2 / plant.mass / ratio
    return 2 * g / (math.sqrt(g / beta) * Z), 2 * g / Z


def linear(
    rig: Rig,
    method: Method,
    poles: tuple[float, ...],
    gap: float,
    ratio: float,
    reading: Equilibrium = "model",
    extra: int = 0,
) -> Linear:
    T, delay = rig.sampling.period, rig.sampling.delay + extra * rig.sampling.period
    k0, k1, k2, k3 = gains_of(poles)
    C_U, C_Y = believed(rig, reading, ratio)
    law = tf2ss(np.array([k2 + C_Y, k1 + k3 * C_Y, k0]) / C_U, [1.0, k3, 0.0])
    kind = {"tustin": "bilinear", "euler": "euler", "zoh": "zoh"}[method]
    a, b, c, d, _ = cont2discrete(law, T, kind)

    true_u, true_y = actual(rig, gap, ratio)
    flow = np.zeros((3, 3))
    flow[:2] = np.array([[0.0, 1.0, 0.0], [true_y, 0.0, -true_u]])
    whole = math.floor(round(delay / T, 9))
    part = max(0.0, delay - whole * T)
    part = 0.0 if part < 1e-12 else part
    held = whole + (part > 0)
    A_1, A_0 = expm(flow * part), expm(flow * (T - part))
    fresh, stale = A_0[:2, 2], A_0[:2, :2] @ A_1[:2, 2]
    size = 4 + held
    u = np.zeros((1, size))
    u[0, 0], u[0, -2:] = d.item(), c.ravel()
    onto = [u, *np.eye(size)[None, 2 : 2 + held].transpose(1, 0, 2)]  # u_k, u_{k-1}, ...
    A = np.zeros((size, size))
    A[:2, :2] = expm(flow * T)[:2, :2]
    A[:2] += np.outer(fresh, onto[whole])
    if part:
        A[:2] += np.outer(stale, onto[whole + 1])
    B = np.zeros((size, 1))
    B[:2, 0] = fresh * d.item() if whole == 0 else 0.0
    for n in range(held):
        A[2 + n] = onto[n]
        B[2 + n] = d if n == 0 else 0.0
    A[-2:, -2:], A[-2:, :1], B[-2:] = a, b, b
    return Linear(A, B, np.eye(size)[:1], u, d.item(), T)


def over(rig: Rig) -> Family:
    return loops.family(rig, rig.uncertainty.beta)


def loop_of(
    rig: Rig, method: Method = "tustin", reading: Equilibrium = "model", extra: int = 0
) -> Loop:
    return build_loop(rig, equilibrium=reading, method=method, extra_samples=extra)


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
        (b_u, b_y), (c_u, c_y) = believed(rig, reading, ratio), actual(rig, gap, ratio)
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


@pytest.mark.parametrize("figure", ["Ms", "radius", "noise", "hurwitz"])
@pytest.mark.parametrize("name", ["short", "more than a sample late", "offset"])
@pytest.mark.parametrize("seed", range(3))
def test_gradients_by_the_four_poles_are_those_of_the_values(
    figure: str, name: str, seed: int
) -> None:
    rig = RIGS[name]
    random = np.random.default_rng(seed)
    z1, z2 = random.uniform(0.7, 1.4, 2)
    w1, w2 = random.uniform(45, 70, 2)
    poles = (float(z1), float(w1), float(z2), float(w2))
    function, where = loop_of(rig, METHODS[seed]), over(rig)

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


# --- shapes --------------------------------------------------------------------------------


def test_the_family_spans_path_start_and_equilibrium_and_the_ratios(paper_rig: Rig) -> None:
    found = loops.family(paper_rig, 0.15)
    assert found.gaps == (0.012, 0.0246)
    assert found.ratios == pytest.approx((0.85, 1.15))


def test_a_family_has_four_corners_or_fewer_when_an_interval_is_a_point() -> None:
    corners = Family((0.01, 0.02), (0.9, 1.1)).corners()
    assert {(c.gaps[0], c.ratios[0]) for c in corners} == {
        (0.01, 0.9),
        (0.01, 1.1),
        (0.02, 0.9),
        (0.02, 1.1),
    }
    assert all(c.gaps[0] == c.gaps[1] and c.ratios[0] == c.ratios[1] for c in corners)
    assert len(Family((0.01, 0.02), (1.0, 1.0)).corners()) == 2
    assert len(Family((0.01, 0.01), (1.0, 1.0)).corners()) == 1


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
