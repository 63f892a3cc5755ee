from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Literal

import byhand
import control as ct
import numpy as np
import pytest
import reference
import sympy as sp
from byhand import LAWS
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from maglev_design.lowering import lower
from maglev_design.options import METHODS, Method
from maglev_design.symbolic import gpi, laws, sampling, stability
from maglev_design.symbolic import plant as p

Array = NDArray[np.float64]

LAW = laws.tan_gpi()
KS = (p.k0, p.k1, p.k2, p.k3)
GAINS = lower(
    (p.zeta, p.omega_n),
    dict(
        zip(
            ("k0", "k1", "k2", "k3"),
            gpi.match_coefficients(
                gpi.pole_pairs_polynomial([(p.zeta, p.omega_n), (p.zeta, p.omega_n)]), 4
            ),
            strict=True,
        )
    ),
).scalar()

POLYNOMIAL = 1e-8
"""Of a coefficient rebuilt from eigenvalues, relative to the product of the moduli's powers."""
EXPONENTIAL = 1e-9
"""Of a sampled matrix from scipy's numerical matrix exponential, relative."""
CASES = 20_000
RANDOM_SEED = 20

dampings = st.floats(0.3, 2.0)
speeds = st.floats(20.0, 300.0)
hats = st.tuples(st.floats(1.0, 30.0), st.floats(100.0, 4000.0))
ratios = st.floats(0.3, 3.0)
periods = st.floats(1e-4, 5e-3)


def programmed(
    names: str, inputs: Sequence[sp.Symbol], values: Sequence[sp.Expr]
) -> Callable[..., list[Any]]:
    outputs = {f"{names}{n}": x for n, x in enumerate(values)}
    return lower(inputs, outputs).numpy()


def close_polynomials(ours: Sequence[float], theirs: NDArray[Any]) -> None:
    """Compare monic polynomials, each coefficient on the scale that its roots give it."""
    assert len(ours) == len(theirs)
    assert np.abs(theirs.imag).max() <= POLYNOMIAL * np.abs(theirs).max()
    radius = max(abs(c) ** (1 / n) for n, c in enumerate(theirs) if n > 0 and c != 0)
    for n, (x, y) in enumerate(zip(ours, theirs.real, strict=True)):
        assert x == pytest.approx(y, abs=POLYNOMIAL * (2 * radius) ** n)


# --- continuous ----------------------------------------------------------------------------

CLOSED = programmed("a", (p.rho, p.C_Y_true, p.C_Y_hat, *KS), stability.closed_loop_polynomial(LAW))
CORE = lower(
    (p.C_U, p.C_Y, *KS),
    {
        f"m{n}": x
        for n, x in enumerate(
            x for m in (LAW.core.A, LAW.core.B, LAW.core.C, LAW.core.D) for x in m
        )
    },
).scalar()


def controller(c_u: float, c_y: float, gains: Sequence[float]) -> list[Array]:
    flat = np.array(CORE(c_u, c_y, *gains))
    return [
        flat[:4].reshape(2, 2),
        flat[4:6].reshape(2, 1),
        flat[6:8].reshape(1, 2),
        flat[8:, None],
    ]


@given(dampings, speeds, hats, ratios, st.floats(50.0, 8000.0))
def test_the_polynomial_has_the_poles_that_python_control_finds(
    zeta: float, omega: float, hat: tuple[float, float], rho: float, c_y: float
) -> None:
    gains = GAINS(zeta, omega)
    c_u = rho * hat[0]
    plant = ct.ss([[0, 1], [c_y, 0]], [[0], [-c_u]], [[1, 0]], 0)
    loop = ct.feedback(plant, ct.ss(*controller(*hat, gains)), sign=1)
    assert loop.nstates == 4, "nothing may be cancelled"
    ours = [float(x) for x in CLOSED(rho, c_y, hat[1], *gains)]
    close_polynomials(ours, np.poly(ct.poles(loop)))


@given(dampings, speeds, hats)
def test_at_the_design_point_the_polynomial_is_the_desired_one(
    zeta: float, omega: float, hat: tuple[float, float]
) -> None:
    gains = GAINS(zeta, omega)
    ours = [float(x) for x in CLOSED(1.0, hat[1], hat[1], *gains)]
    assert ours == pytest.approx([1.0, *gains[::-1]], rel=1e-9)


UNDECIDED = 1e-7
"""Roots nearer to the axis than this share of omega_n: the eigenvalues' rounding decides."""


def companion_roots(rows: Array) -> NDArray[np.complex128]:
    degree = rows.shape[1] - 1
    matrices = np.zeros((len(rows), degree, degree))
    matrices[:, 0, :] = -rows[:, 1:] / rows[:, :1]
    matrices[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.asarray(np.linalg.eigvals(matrices), dtype=complex)


def test_the_one_condition_decides_stability() -> None:
    random = np.random.default_rng(RANDOM_SEED)
    zeta, omega = random.uniform(0.1, 3.0, CASES), np.exp(random.uniform(1.0, 6.0, CASES))
    c_y_hat = np.exp(random.uniform(2.0, 9.0, CASES))
    rho, c_y = np.exp(random.uniform(-2, 2, CASES)), c_y_hat * np.exp(random.uniform(-2, 2, CASES))
    gains = [
        np.asarray(k)
        for k in programmed("k", (p.zeta, p.omega_n), _gain_expressions())(zeta, omega)
    ]
    rows = np.stack([np.broadcast_to(x, CASES) for x in CLOSED(rho, c_y, c_y_hat, *gains)], axis=1)
    scaled = rows / omega[:, None] ** np.arange(5)
    furthest = companion_roots(scaled).real.max(axis=1)
    inputs = (p.rho, p.C_Y_true, p.C_Y_hat, p.zeta, p.omega_n)
    (condition,) = lower(inputs, {"c": stability.stability_condition()}).numpy()(
        rho, c_y, c_y_hat, zeta, omega
    )
    decided = np.abs(furthest) > UNDECIDED
    assert decided.mean() > 0.99
    stable = furthest < 0
    assert 0.1 < stable.mean() < 0.9, "both verdicts occur"
    assert (condition > 0)[decided].tolist() == stable[decided].tolist()


def _gain_expressions() -> Sequence[sp.Expr]:
    pair = (p.zeta, p.omega_n)
    return gpi.match_coefficients(gpi.pole_pairs_polynomial([pair, pair]), 4)


def test_the_condition_is_the_known_one() -> None:
    known = p.rho * (p.omega_n**2 + p.C_Y_hat) - p.C_Y_true - p.omega_n**2 / (4 * p.zeta**2 + 1)
    assert sp.simplify(stability.stability_condition() - known) == 0


def test_with_the_voltage_measured_the_appendix_s_bound_needs_no_frequency() -> None:
    mu = sp.Symbol("mu", positive=True)  # beta/beta_c = C_U'/C_U^ = C_Y'/C_Y^
    condition = stability.stability_condition().subs({p.rho: mu, p.C_Y_hat: p.C_Y_true / mu})
    (bound,) = sp.solve(condition.subs(p.zeta, 1), mu)
    assert float(bound) == reference.APPENDIX_A_BOUND


# --- Routh-Hurwitz -------------------------------------------------------------------------

DEGREES = range(2, 8)
POLYNOMIALS = 1000
"""A degree."""
MARGIN = 0.02
"""Roots of modulus about 1 nearer to the axis than this are left out: the roots that numpy finds
of a degree 7 with neighbours may be off by 1e-16 ** (1/7) = 0.005."""
GRID = 2**20
"""Coefficients are integers over this, so that the conditions are evaluated exactly."""


def random_polynomial(random: np.random.Generator, degree: int) -> list[int]:
    """Return integer coefficients whose roots are on either side, half of the time all left."""
    pairs = random.integers(0, degree // 2 + 1)
    side = -1 if random.random() < 0.5 else random.choice([-1, 1], size=degree)
    real = side * random.uniform(0.05, 1.5, degree)
    roots = [complex(x, 0) for x in real[: degree - 2 * pairs]]
    for x in real[degree - 2 * pairs :: 2][:pairs]:
        y = random.uniform(0.05, 1.5)
        roots += [complex(x, y), complex(x, -y)]
    return [round(float(c) * GRID) for c in np.poly(roots).real]


@pytest.mark.parametrize("degree", DEGREES)
def test_the_conditions_decide_where_the_roots_are(degree: int) -> None:
    symbols = sp.symbols(f"a0:{degree + 1}", positive=True)
    conditions = stability.routh_hurwitz(symbols)
    assert len(conditions) == degree
    evaluate = sp.lambdify(symbols, [sp.fraction(c)[0] for c in conditions], modules="math")
    assert all(sp.fraction(c)[1] == 1 for c in conditions), "fraction-free"
    random = np.random.default_rng(RANDOM_SEED + degree)
    verdicts = []
    for _ in range(POLYNOMIALS):
        coefficients = random_polynomial(random, degree)
        real = np.roots(coefficients).real
        if np.abs(real).min() < MARGIN:
            continue
        stable = bool(real.max() < 0)
        assert all(x > 0 for x in evaluate(*coefficients)) == stable
        verdicts.append(stable)
    assert 0.2 < np.mean(verdicts) < 0.95, "both verdicts occur"
    assert len(verdicts) > POLYNOMIALS // 2


def hurwitz_determinants(coefficients: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return the leading minors of the Hurwitz matrix, by its textbook definition."""
    n = len(coefficients) - 1

    def get(k: int) -> sp.Expr:
        return coefficients[k] if 0 <= k <= n else sp.Integer(0)

    matrix = sp.Matrix(n, n, lambda i, j: get(2 * (j + 1) - (i + 1)))
    return [matrix[:k, :k].det() for k in range(1, n + 1)]


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_the_conditions_are_the_hurwitz_determinants(degree: int) -> None:
    symbols = sp.symbols(f"a0:{degree + 1}", positive=True)
    ours = stability.routh_hurwitz(symbols)
    for condition, determinant in zip(ours, hurwitz_determinants(symbols), strict=True):
        assert sp.expand(condition - determinant) == 0


@pytest.mark.parametrize(
    "coefficients",
    [(1, 0, 2, 0, 1), (1, 0, 2, 1, 1), (1, 1, 1, 1, 1), (1, 2, 1, 2, 0), (1, 0, 0, 0)],
)
def test_a_condition_that_vanishes_is_no_stable_verdict(coefficients: tuple[int, ...]) -> None:
    conditions = stability.routh_hurwitz([sp.Integer(c) for c in coefficients])
    assert len(conditions) == len(coefficients) - 1
    assert all(condition.is_real for condition in conditions)
    assert not all(condition > 0 for condition in conditions)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_the_routh_array_counts_the_roots_on_the_right(degree: int) -> None:
    random = np.random.default_rng(RANDOM_SEED - degree)
    counts = set()
    for _ in range(40):
        coefficients = random_polynomial(random, degree)
        roots = np.roots(coefficients)
        if np.abs(roots.real).min() < MARGIN:
            continue
        rows = stability.routh_array([sp.Integer(c) for c in coefficients])
        assert [len(row) for row in rows] == [n // 2 + 1 for n in range(degree, -1, -1)]
        column = np.array([float(row[0]) for row in rows])
        changes = int((column[1:] * column[:-1] < 0).sum())
        assert changes == int((roots.real > 0).sum())
        counts.add(changes)
    assert len(counts) > 1


def test_the_routh_array_has_the_hurwitz_determinants_in_its_first_column() -> None:
    symbols = (sp.Integer(1), *sp.symbols("a3 a2 a1 a0", positive=True))
    conditions = (sp.Integer(1), *stability.routh_hurwitz(symbols))
    column = [row[0] for row in stability.routh_array(symbols)]
    for n, entry in enumerate(column[1:], 1):
        assert sp.simplify(entry - conditions[n] / conditions[n - 1]) == 0


# --- sampled -------------------------------------------------------------------------------

PULSE = stability.sampled_plant()
OUTPUTS: tuple[Literal["gap"], Literal["velocity"]] = ("gap", "velocity")
PULSES = {
    output: programmed(
        "n",
        (p.C_Y_true, p.T, stability.first_part),
        (*stability.sampled_plant(output).numerator, *PULSE.denominator),
    )
    for output in OUTPUTS
}
PULSE_NUMBERS = PULSES["gap"]
SAMPLED_LAWS = {method: stability.sampled_law(LAW, method) for method in METHODS}
LAW_NUMBERS = {
    method: programmed("n", (p.C_U_hat, p.C_Y_hat, p.T, *KS), (*pulse.gap, *pulse.denominator))
    for method, pulse in SAMPLED_LAWS.items()
}
DISCRETE = {}
for _method in METHODS:
    _core = sampling.discretise(LAW.core, _method)
    DISCRETE[_method] = lower(
        (p.C_U, p.C_Y, p.T, *KS),
        {
            f"m{n}": x
            for n, x in enumerate(x for m in (_core.A, _core.B, _core.C, _core.D) for x in m)
        },
    ).scalar()


def held_plant(c_y: float, period: float, part: float) -> tuple[Array, Array, Array]:
    """Return A, B_0, B_1 of the delayed plant with unit input gain, by matrix exponentials."""

    def moved(duration: float) -> tuple[Array, Array]:
        block = expm(np.array([[0, 1, 0], [c_y, 0, 1], [0, 0, 0]]) * duration)
        return block[:2, :2], block[:2, 2:]

    whole, _ = moved(period)
    last, fresh = moved(period - part)
    _, stale = moved(part)
    return whole, fresh, last @ stale


@pytest.mark.parametrize("output", OUTPUTS)
@given(
    st.floats(50.0, 8000.0),
    periods,
    st.floats(0.0, 0.999),
    st.complex_numbers(min_magnitude=0.5, max_magnitude=3.0),
)
def test_the_sampled_plant_is_the_matrix_exponential(
    output: Literal["gap", "velocity"], c_y: float, period: float, share: float, z: complex
) -> None:
    part = share * period
    a, fresh, stale = held_plant(c_y, period, part)
    resolvent = z * np.eye(2) - a
    if abs(np.linalg.det(resolvent)) < 1e-3:
        return
    row = OUTPUTS.index(output)
    expected = np.linalg.solve(resolvent, fresh + stale / z)[row, 0]
    numbers = [float(x) for x in PULSES[output](c_y, period, part)]
    ours = np.polyval(numbers[:3], z) / np.polyval(numbers[3:], z)
    size = (abs(fresh) + abs(stale)).max() / abs(np.linalg.det(resolvent))
    scale = size * (period if output == "gap" else 1.0)
    assert ours == pytest.approx(expected, abs=EXPONENTIAL * scale)


@pytest.mark.parametrize("method", METHODS)
@given(dampings, speeds, hats, periods, st.complex_numbers(min_magnitude=1.2, max_magnitude=3.0))
def test_the_sampled_law_is_its_state_space(
    method: Method, zeta: float, omega: float, hat: tuple[float, float], period: float, z: complex
) -> None:
    gains = GAINS(zeta, omega)
    numbers = [float(x) for x in LAW_NUMBERS[method](*hat, period, *gains)]
    a, b, c, d = split(DISCRETE[method](*hat, period, *gains))
    expected = (c @ np.linalg.solve(z * np.eye(2) - a, b) + d)[0, 0]
    ours = np.polyval(numbers[:3], z) / np.polyval(numbers[3:], z)
    assert ours == pytest.approx(expected, rel=EXPONENTIAL, abs=EXPONENTIAL * abs(d[0, 0]))


@cache
def pulses_of(name: str, method: Method) -> tuple[list[str], int, Callable[..., list[Any]]]:
    law = laws.control_law(LAWS[name])
    pulse = stability.sampled_law(law, method)
    flat = (*pulse.gap, *pulse.velocity, *pulse.denominator)
    program = programmed("n", (p.C_U_hat, p.C_Y_hat, p.T, *law.gains), flat)
    return [gain.name for gain in law.gains], len(pulse.denominator), program


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", LAWS)
@given(dampings, speeds, hats, periods, st.complex_numbers(min_magnitude=1.2, max_magnitude=3.0))
@settings(max_examples=25)
def test_every_sampled_law_is_the_one_written_by_hand(
    name: str,
    method: Method,
    zeta: float,
    omega: float,
    hat: tuple[float, float],
    period: float,
    z: complex,
) -> None:
    k = byhand.gains_of(LAWS[name], (zeta, omega, 1.1 * zeta, 0.8 * omega))
    order, size, program = pulses_of(name, method)
    numbers = [float(x) for x in program(*hat, period, *(k[gain] for gain in order))]
    assert numbers[2 * size] == 1.0, "monic"
    matrices = byhand.core(LAWS[name], k, *hat)
    a, b, c, d = byhand.sampled(matrices, period, method)
    through = (c @ np.linalg.solve(z * np.eye(len(a)) - a, b) + d)[0]
    gap, velocity, denominator = (np.polyval(numbers[n * size :][:size], z) for n in range(3))
    scale = EXPONENTIAL * np.abs(d).max() * (1 + np.abs(c).max() * np.abs(b).max())
    assert gap / denominator == pytest.approx(through[0] + through[2], rel=EXPONENTIAL, abs=scale)
    assert velocity / denominator == pytest.approx(through[1], rel=EXPONENTIAL, abs=scale)
    assert (velocity != 0) == (name == "state-feedback")


def split(flat: Sequence[float]) -> tuple[Array, Array, Array, Array]:
    m = np.array(flat)
    return m[:4].reshape(2, 2), m[4:6].reshape(2, 1), m[6:8].reshape(1, 2), m[8:, None]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("share", [0.0, 0.4])
@given(st.floats(0.5, 1.5), st.floats(40.0, 120.0), hats, ratios, st.floats(100.0, 3000.0))
@settings(max_examples=40)
def test_the_sampled_loop_s_polynomial_has_the_poles_of_its_state_space(
    method: Method,
    share: float,
    zeta: float,
    omega: float,
    hat: tuple[float, float],
    rho: float,
    c_y: float,
) -> None:
    period = 1e-3
    part = share * period
    c_u, gains = rho * hat[0], GAINS(zeta, omega)
    a, fresh, stale = held_plant(c_y, period, part)
    ca, cb, cc, cd = split(DISCRETE[method](*hat, period, *gains))
    fresh, stale = -c_u * fresh, -c_u * stale
    out = np.array([[1.0, 0.0]])
    # states: plant, controller, the voltage of the sample before
    u = np.hstack([cd @ out, cc, np.zeros((1, 1))])
    whole = np.vstack(
        [
            np.hstack([a, np.zeros((2, 2)), stale]) + fresh @ u,
            np.hstack([cb @ out, ca, np.zeros((2, 1))]),
            u,
        ]
    )
    plant = [float(x) for x in PULSE_NUMBERS(c_y, period, part)]
    law = [float(x) for x in LAW_NUMBERS[method](*hat, period, *gains)]
    ours = np.polyadd(np.polymul(plant[3:], law[3:]), c_u * np.polymul(plant[:3], law[:3]))
    close_polynomials(list(ours), np.poly(np.linalg.eigvals(whole)))


def test_short_periods_lose_no_digits() -> None:
    # numerators of order T^2 from differences of numbers near one
    period, part, c_y = 1e-6, 4e-7, 800.0
    numbers = [float(x) for x in PULSE_NUMBERS(c_y, period, part)]
    with_digits = [
        sp.N(
            x.subs(
                {
                    p.C_Y_true: 800,
                    p.T: sp.Rational(1, 10**6),
                    stability.first_part: sp.Rational(4, 10**7),
                }
            ),
            40,
        )
        for x in PULSE.numerator
    ]
    assert numbers[0] == pytest.approx(float(with_digits[0]), rel=1e-9)
    size = max(abs(float(x)) for x in with_digits)
    assert numbers[:3] == pytest.approx([float(x) for x in with_digits], abs=1e-6 * size)
    assert math.isfinite(size)
