"""The derivation: proved in symbols as it is built, and held against plain numbers here."""

from __future__ import annotations

import re
from math import comb

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import expm

from maglev_design.derivation import NOTATION, Equation
from maglev_design.derivation.plant import base_units
from maglev_design.derivation.terms import poly, proved, simplest
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as ref
from maglev_design.symbolic.stability import first_part

POSTULATES = {"1", "2"}
"""Nothing stands before these from which they could be derived."""
PAPER = {str(n) for n in range(1, 30)} | {f"A{n}" for n in range(1, 8)}
ROUNDING = 1e-9
"""Relative; the formulas are evaluated in double precision and lose at most a few digits."""
FINITE_DIFFERENCE = 1e-6
"""Relative; central differences with a step of 1e-5 of the variable err by about 1e-9."""
DIFFERENT_GAIN_UNITS = {"20-n", "25-n"}
"""Laws of another order than four: their gains carry other units than the table's."""


@pytest.fixture(scope="module")
def steps(derived: tuple[Equation, ...]) -> tuple[Equation, ...]:
    return derived


@pytest.fixture(scope="module")
def equations(steps: tuple[Equation, ...]) -> dict[str, Equation]:
    return {equation.id: equation for equation in steps}


def value(equation: Equation, name: str, numbers: dict[sp.Symbol, float]) -> float:
    """Return the right side of the line that defines `name`, in numbers."""
    (line,) = [line for line in equation.lines if str(line.lhs) == name and line.relation == "="]
    return float(line.rhs.subs(numbers))


def plant_numbers(rng: np.random.Generator) -> dict[sp.Symbol, float]:
    letters = (p.m, p.g, p.K, p.C, p.beta, p.y0, p.Y, p.U, p.C_U, p.C_Y, p.u, p.y)
    return {letter: float(rng.uniform(0.5, 2.0)) for letter in letters}


def test_every_equation_is_proved_but_the_postulates(equations: dict[str, Equation]) -> None:
    for number, equation in equations.items():
        expected = "None" if number in POSTULATES else "0"
        assert str(equation.residual) == expected, (number, equation.checks)


def test_every_check_is_the_integer_zero(equations: dict[str, Equation]) -> None:
    for equation in equations.values():
        assert all(check is sp.S.Zero for check in equation.checks or ()), equation.id


def test_all_of_the_paper_is_there_and_ids_are_unique(steps: tuple[Equation, ...]) -> None:
    ids = [equation.id for equation in steps]
    assert set(ids) >= PAPER
    assert len(ids) == len(set(ids))


def test_sections_are_contiguous(equations: dict[str, Equation]) -> None:
    sections = [equation.section for equation in equations.values()]
    changes = [s for n, s in enumerate(sections) if n == 0 or sections[n - 1] != s]
    assert len(changes) == len(set(changes))


def test_every_letter_is_in_the_table_once(equations: dict[str, Equation]) -> None:
    known = [entry.symbol for entry in NOTATION]
    assert len(known) == len(set(known))
    assert len({str(symbol) for symbol in known}) == len(known)
    for equation in equations.values():
        for line in equation.lines:
            assert line.lhs.atoms(sp.Symbol) | line.rhs.atoms(sp.Symbol) <= set(known), equation.id


def test_every_equation_says_why(equations: dict[str, Equation]) -> None:
    for equation in equations.values():
        assert equation.title
        assert equation.reason.endswith(".")


def test_a_wrong_statement_is_not_proved() -> None:
    wrong = proved("x", "s", "t", [(p.C_U, 2 * p.g / p.U)], "w.", checks=[p.g / p.U - p.C_U])
    assert wrong.residual not in {None, sp.S.Zero}


def test_a_proof_without_a_check_is_refused() -> None:
    with pytest.raises(ValueError, match="has none"):
        proved("x", "s", "t", [(p.C_U, p.C_U)], "w.", checks=[])


def test_simplest_sees_what_cancelling_does_not() -> None:
    x = sp.Symbol("x", real=True)
    assert simplest(sp.sin(x) ** 2 + sp.cos(x) ** 2 - 1) == 0
    assert simplest((x**2 - 1) / (x - 1) - x) != 0


def test_both_sides_have_the_same_unit(equations: dict[str, Equation]) -> None:
    """Change of the base units: both sides must change by the same factor."""
    rng = np.random.default_rng(1)
    checked = 0
    base = sp.symbols("kg metre second ampere volt", positive=True)
    sizes = dict(zip(base, rng.uniform(0.5, 2.0, len(base)), strict=True))
    values = {entry.symbol: float(rng.uniform(0.5, 1.5)) for entry in NOTATION}
    table = {entry.symbol: entry.unit for entry in NOTATION}
    for number in sorted(set(equations) - DIFFERENT_GAIN_UNITS):
        for line in equations[number].lines:
            sides = (line.lhs, line.rhs)
            letters = line.lhs.free_symbols | line.rhs.free_symbols
            if isinstance(line.rhs, sp.MatrixBase) or line.rhs.has(sp.Sum):
                continue
            if not line.rhs.free_symbols:
                continue
            scaled = {
                x: values[x] * (1 if table[x] == "-" else float(base_units(table[x]).subs(sizes)))
                for x in letters
            }
            factors = [complex(side.subs(scaled)) / complex(side.subs(values)) for side in sides]
            assert factors[0] == pytest.approx(factors[1], rel=ROUNDING), (number, line)
            checked += 1
    assert checked > 80


def test_coefficients_are_the_slopes_of_the_plant(equations: dict[str, Equation]) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        numbers = plant_numbers(rng)
        gravity, beta, offset, gap = (numbers[x] for x in (p.g, p.beta, p.y0, p.Y))
        voltage = np.sqrt(gravity / beta) * (gap + offset)
        numbers[p.U] = voltage
        assert value(equations["5"], "U", numbers) == pytest.approx(voltage, rel=ROUNDING)

        def acceleration(
            y: float, u: float, g: float = gravity, b: float = beta, y0: float = offset
        ) -> float:
            return g - b * u**2 / (y + y0) ** 2

        step = 1e-5
        slope_u = (acceleration(gap, voltage + step) - acceleration(gap, voltage - step)) / 2 / step
        slope_y = (acceleration(gap + step, voltage) - acceleration(gap - step, voltage)) / 2 / step
        for number in ("10", "10-rest"):
            assert value(equations[number], "C_U", numbers) == pytest.approx(
                -slope_u, rel=FINITE_DIFFERENCE
            )
            assert value(equations[number], "C_Y", numbers) == pytest.approx(
                slope_y, rel=FINITE_DIFFERENCE
            )


def test_static_feedforward_holds_the_nonlinear_plant_anywhere(
    equations: dict[str, Equation],
) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        numbers = plant_numbers(rng)
        gravity, beta, offset, gap = (numbers[x] for x in (p.g, p.beta, p.y0, p.Y))
        elsewhere = float(rng.uniform(0.1, 3.0))
        numbers |= {p.U: np.sqrt(gravity / beta) * (gap + offset), p.y_ref: elsewhere}
        held = value(equations["11-feedforward"], "u_rest", numbers)
        assert beta * held**2 / (elsewhere + offset) ** 2 == pytest.approx(gravity, rel=ROUNDING)


def test_printed_law_has_the_roots_of_p_and_two_at_zero(equations: dict[str, Equation]) -> None:
    rng = np.random.default_rng(4)
    for _ in range(10):
        k0, k1, k2, k3, c_u, c_y = rng.uniform(0.5, 3.0, 6)
        voltage = -np.array([-(k2 + c_y), 0, k3 * c_u, -k3 * c_y, -k1, -k0]) / c_u
        motion = np.array(
            [
                [0, 1, 0, 0, 0, 0],
                -c_u * voltage + np.array([c_y, 0, 0, 0, 0, 0]),
                voltage,
                [1, 0, 0, 0, 0, 0],
                [1, 0, 0, 0, 0, 0],
                [0, 0, 0, 0, 1, 0],
            ]
        )
        numbers = dict(zip((p.k0, p.k1, p.k2, p.k3), (k0, k1, k2, k3), strict=True))
        for s in (0.3, 1.7, -2.2):
            p_of_s = value(equations["23"], "p(s)", numbers | {p.s: s})
            determinant = np.linalg.det(s * np.eye(6) - motion)
            assert determinant == pytest.approx(s**2 * p_of_s, rel=ROUNDING)
            p_6 = value(equations["20-hidden"], "p_6(s)", {p.s: s, poly: p_of_s})
            assert p_6 == pytest.approx(determinant, rel=ROUNDING)


def test_gains_place_the_poles(equations: dict[str, Equation]) -> None:
    numbers = {p.zeta: 0.7, p.omega_n: 3.0}
    gains = [value(equations["25"], name, numbers) for name in ("k3", "k2", "k1", "k0")]
    pair = [1.0, 2 * 0.7 * 3.0, 9.0]
    assert [1.0, *gains] == pytest.approx(list(np.convolve(pair, pair)), rel=ROUNDING)


def test_bezier_step_is_the_bernstein_sum(equations: dict[str, Equation]) -> None:
    printed = {line.lhs: int(line.rhs) for line in equations["29"].lines}
    for tau in np.linspace(0.0, 1.0, 23):
        bernstein = sum(comb(16, j) * tau**j * (1 - tau) ** (16 - j) for j in range(8, 17))
        phi = value(equations["28"], "phi", {**printed, ref.tau: tau})
        # the powers cancel: coefficients up to 6e5 cost six digits
        assert phi == pytest.approx(bernstein, abs=1e-9)


@pytest.mark.parametrize("zeta", [0.4, 1.0, 1.6])
def test_bound_on_beta_is_where_the_roots_cross(
    equations: dict[str, Equation], zeta: float
) -> None:
    speed = 70.0
    k3, k2, k1, k0 = np.convolve([1, 2 * zeta * speed, speed**2], [1, 2 * zeta * speed, speed**2])[
        1:
    ]
    bounds = [
        float(line.rhs.subs({p.zeta: zeta, p.k0: k0, p.k1: k1, p.k2: k2, p.k3: k3}))
        for line in equations["A7"].lines
    ]
    assert bounds[0] == pytest.approx(bounds[1], rel=ROUNDING)
    for mu, stable in ((0.999 * bounds[0], False), (1.001 * bounds[0], True)):
        roots = np.roots([1, k3, mu * k2, mu * k1, mu * k0])
        assert (roots.real.max() < 0) == stable


def test_general_condition_agrees_with_the_roots(equations: dict[str, Equation]) -> None:
    rng = np.random.default_rng(5)
    condition = equations["A7-general"].lines[0]
    verdicts = set()
    for _ in range(300):
        zeta, speed, rho, c_hat, c_true = rng.uniform(0.2, 2.0, 5) * [1, 1, 1, 1, 3]
        k3, k2, k1, k0 = np.convolve(
            [1, 2 * zeta * speed, speed**2], [1, 2 * zeta * speed, speed**2]
        )[1:]
        # s (s + k3) (s^2 - C_Y') + rho ((k2 + C_Y^) s^2 + (k1 + k3 C_Y^) s + k0)
        loop = np.convolve([1, k3, 0], [1, 0, -c_true])
        loop[2:] += rho * np.array([k2 + c_hat, k1 + k3 * c_hat, k0])
        numbers = dict(
            zip(
                (p.zeta, p.omega_n, p.rho, p.C_Y_hat, p.C_Y_true),
                (zeta, speed, rho, c_hat, c_true),
                strict=True,
            )
        )
        stable = bool(np.roots(loop).real.max() < 0)
        assert stable == bool(condition.lhs.subs(numbers) > condition.rhs.subs(numbers))
        verdicts.add(stable)
    assert verdicts == {True, False}


@pytest.mark.parametrize("part", [0.0, 0.4, 1.0])
def test_sampled_plant_is_the_matrix_exponential(
    equations: dict[str, Equation], part: float
) -> None:
    c_u, c_y, period, z = 9.0, 8.0, 0.2, 1.3
    delay = part * period
    block = np.array([[0, 1, 0], [c_y, 0, -c_u], [0, 0, 0]])
    fresh, stale, whole = (expm(block * x) for x in (period - delay, delay, period))
    inputs = fresh[:2, 2] + fresh[:2, :2] @ stale[:2, 2] / z
    expected = np.linalg.solve(z * np.eye(2) - whole[:2, :2], inputs)[0]
    numbers = {p.C_U_true: c_u, p.C_Y_true: c_y, p.T: period, p.z: z}
    delayed = equations["S5"]
    names = {line.lhs: line.rhs for line in delayed.lines[1:]}
    letters = numbers | {first_part: delay}
    coefficients = {name: float(rhs.subs(letters)) for name, rhs in names.items()}
    assert value(delayed, "P(z)", numbers | coefficients) == pytest.approx(expected, rel=ROUNDING)
    if part == 0.0:
        assert value(equations["S4"], "P(z)", numbers) == pytest.approx(expected, rel=ROUNDING)


def test_step_invariant_law_samples_the_step_response(equations: dict[str, Equation]) -> None:
    c_y, k0, k1, k2, k3, period, z = 1.3, 0.7, 1.9, 2.4, 1.1, 0.3, 1.7
    # companion form of G = (b2 s^2 + b1 s + b0)/(s^2 + k3 s), nothing shared with the two states
    b2, b1, b0 = k2 + c_y, k1 + k3 * c_y, k0
    block = np.array([[0, 1, 0], [0, -k3, 1], [0, 0, 0]])
    held = expm(block * period)
    row = np.array([b0, b1 - b2 * k3])
    expected = b2 + row @ np.linalg.solve(z * np.eye(2) - held[:2, :2], held[:2, 2])
    numbers = dict(
        zip(
            (p.C_Y, p.k0, p.k1, p.k2, p.k3, p.T, p.z), (c_y, k0, k1, k2, k3, period, z), strict=True
        )
    )
    assert value(equations["S3"], "G_zoh(z)", numbers) == pytest.approx(expected, rel=ROUNDING)


def test_ids_are_plain_words(equations: dict[str, Equation]) -> None:
    assert all(re.fullmatch(r"[A-Z]?\d*(-[a-z]+)?", number) for number in equations)
