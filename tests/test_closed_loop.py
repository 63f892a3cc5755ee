from __future__ import annotations

import itertools
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from rigs import OFFSET, SHORT, rig_with

from maglev_design.choices import EQUILIBRIA, METHODS, Equilibrium, Method
from maglev_design.design import (
    PoleSpec,
    believed_equilibrium,
    make_design,
    plant_beta,
    timing,
    true_equilibrium,
)
from maglev_design.loop import build_loop
from maglev_design.lowering import lower
from maglev_design.symbolic import closed_loop as cl
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.stability import closed_loop_polynomial, first_part

ROUNDING = 1e-9
"""Relative; coefficients of polynomials with clustered roots, in double precision."""
POLES = (1.0, 60.0, 1.1, 70.0)
GAINS = (p.k0, p.k1, p.k2, p.k3)
READINGS = list(itertools.product(EQUILIBRIA, (False, True)))


@pytest.mark.parametrize(("reading", "given"), READINGS)
def test_m_falls_with_the_ratio_or_stays(reading: Equilibrium, given: bool) -> None:
    squared = cl.at_design_gap(reading, voltage_given=given).gain_squared
    power = sp.simplify(cl.ratio * sp.diff(squared, cl.ratio) / squared)
    assert power in (0, -1, -2)


@pytest.mark.parametrize(("reading", "given"), READINGS)
def test_c_y_hat_or_its_product_with_m_does_not_depend_on_the_ratio(
    reading: Equilibrium, given: bool
) -> None:
    at = cl.at_design_gap(reading, voltage_given=given)
    product = sp.simplify(at.gain_squared * at.C_Y_hat**2)
    assert not (at.C_Y_hat.has(cl.ratio) and product.has(cl.ratio))


@pytest.mark.parametrize(("reading", "given"), READINGS)
def test_m_and_q_are_the_ratios_of_the_coefficients_of_plant_and_controller(
    reading: Equilibrium, given: bool
) -> None:
    rig = rig_with(OFFSET, {"operating_point.voltage": 9.5} if given else {})
    beta_c, gap, ratio = plant_beta(rig), 0.0117, 1.23
    there = true_equilibrium(rig, beta_c / ratio, gap)
    believed = believed_equilibrium(rig, reading, beta_c, beta_c / ratio)
    at = cl.at_design_gap(reading, voltage_given=given)
    numbers = {
        p.g: rig.plant.gravity,
        p.beta_c: beta_c,
        p.y0: rig.plant.gap_offset,
        p.Y: rig.operating_point.gap,
        p.U: 9.5,
        p.y: gap,
        cl.ratio: ratio,
    }
    squared, c_y_hat, c_y, fall = (
        float(x.subs(numbers)) for x in (at.gain_squared, at.C_Y_hat, at.C_Y, at.fall)
    )
    assert np.sqrt(squared) * fall == pytest.approx(there.C_U / believed.C_U)
    assert c_y * fall == pytest.approx(there.C_Y)
    assert c_y_hat == pytest.approx(believed.C_Y)


def test_the_continuous_matrix_has_the_polynomial_of_the_loop() -> None:
    polynomial = cl.continuous_matrix().charpoly(p.s).all_coeffs()
    differences = zip(polynomial, closed_loop_polynomial(), strict=True)
    assert [sp.simplify(a - b) for a, b in differences] == [0] * 5


N = sp.Symbol("n", positive=True)


@pytest.mark.parametrize("c_y_hat", [p.C_Y_hat, N / cl.m_gain], ids=["fixed", "over m"])
def test_the_continuous_matrix_is_affine_in_q_and_in_m(c_y_hat: sp.Expr) -> None:
    member = {p.rho: cl.m_gain * cl.q, p.C_Y_true: cl.C_Y_rest * cl.q, p.C_Y_hat: c_y_hat}
    matrix = cl.continuous_matrix().subs(member)
    for variable in (cl.q, cl.m_gain):
        assert sp.simplify(sp.diff(matrix, variable, 2)) == sp.zeros(4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("c_y_hat", [p.C_Y_hat, N / cl.m_gain], ids=["fixed", "over m"])
def test_the_sampled_matrix_is_affine_in_the_functions_of_q_and_in_m(
    method: Method, c_y_hat: sp.Expr
) -> None:
    matrix = cl.sampled_matrix(method, 1, partial=True).subs(p.C_Y_hat, c_y_hat)
    functions = [*cl.HOLD, cl.lag]
    for a, b in itertools.combinations_with_replacement(functions, 2):
        assert sp.simplify(sp.diff(matrix, a, b)) == sp.zeros(6)
    assert sp.simplify(sp.diff(matrix, cl.m_gain, 2)) == sp.zeros(6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.001, 0.0023])
def test_the_sampled_matrix_has_the_polynomial_of_the_loop(method: Method, delay: float) -> None:
    rig = rig_with(SHORT, {"sampling.delay": delay})
    gap, ratio, period = 0.0213, 0.91, rig.sampling.period
    design = make_design(rig, PoleSpec(POLES[:2], POLES[2:]), method=method)
    when = timing(period, delay)
    there = true_equilibrium(rig, plant_beta(rig) / ratio, gap)
    fall = there.C_Y / design.believed.C_Y
    numbers = {
        cl.q: fall,
        cl.C_Y_rest: design.believed.C_Y,
        p.T: period,
        first_part: when.part,
        cl.lag: np.exp(-design.gains[3] * period),
        cl.m_gain: there.C_U / design.believed.C_U / fall,
        p.C_Y_hat: design.believed.C_Y,
        **dict(zip(GAINS, design.gains, strict=True)),
    }
    numbers |= {symbol: float(x.subs(numbers)) for symbol, x in cl.HOLD.items()}
    matrix = cl.sampled_matrix(method, when.whole, partial=when.part > 0).subs(numbers)
    loop = build_loop(rig, equilibrium="model", method=method)
    expected = loop.characteristic(ca.DM(POLES), gap, ratio)[0].full().ravel()
    found = np.poly(np.array(matrix, dtype=float))
    assert found == pytest.approx(expected[: len(found)] / expected[0], rel=ROUNDING, abs=1e-7)
    assert expected[len(found) :] == pytest.approx(0, abs=1e-12)


def test_a_lowered_matrix_is_evaluated_without_rounding() -> None:
    values = {symbol: sp.Rational(n + 2, 7 * n + 3) for n, symbol in enumerate(GAINS)}
    values |= {p.T: sp.Rational(1, 3), cl.m_gain: sp.Rational(5, 11), p.C_Y_hat: sp.Rational(9, 13)}
    values |= {symbol: sp.Rational(1, n + 3) for n, symbol in enumerate(cl.HOLD)}
    matrix = cl.sampled_matrix("tustin")
    program = lower(list(values), {f"a{n}": x for n, x in enumerate(matrix)})
    found = program.exact(*[_fraction(x) for x in values.values()])
    assert found == [_fraction(x) for x in matrix.subs(values)]


def _fraction(x: sp.Rational) -> Fraction:
    return Fraction(int(x.p), int(x.q))
