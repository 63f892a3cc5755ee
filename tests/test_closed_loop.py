from __future__ import annotations

import itertools
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from rigs import OFFSET, SHORT, rig_with

from maglev_design.controller.design import (
    PoleSpec,
    believed_equilibrium,
    make_design,
    plant_beta,
    true_equilibrium,
)
from maglev_design.controller.timing import timing
from maglev_design.linear_loop import loop_of
from maglev_design.lowering import lower
from maglev_design.options import EQUILIBRIA, METHODS, TAN_GPI, Equilibrium, Method
from maglev_design.programs import derived
from maglev_design.symbolic import closed_loop as cl
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.stability import closed_loop_polynomial, first_part

ROUNDING = 1e-9
"""Relative; coefficients of polynomials with clustered roots, in double precision."""
POLES = (1.0, 60.0, 1.1, 70.0)


@pytest.mark.parametrize("reading", EQUILIBRIA)
def test_m_and_q_are_the_ratios_of_the_coefficients_of_plant_and_controller(
    reading: Equilibrium,
) -> None:
    rig, gap, ratio = rig_with(OFFSET), 0.0117, 1.23
    believed = believed_equilibrium(rig, reading, voltage=9.5)
    there = true_equilibrium(rig, believed.beta / ratio, gap)
    at = cl.at_design_gap()
    numbers = {
        p.g: rig.plant.gravity,
        p.beta_c: believed.beta,
        p.y0: rig.plant.gap_offset,
        p.Y: rig.operating_point.gap,
        p.C_U_hat: believed.C_U,
        p.y: gap,
        cl.ratio: ratio,
    }
    squared, c_y, fall = (float(x.subs(numbers)) for x in (at.gain_squared, at.C_Y, at.fall))
    assert np.sqrt(squared) * fall == pytest.approx(there.C_U / believed.C_U)
    assert c_y * fall == pytest.approx(there.C_Y)


def test_the_continuous_matrix_has_the_polynomial_of_the_loop() -> None:
    polynomial = cl.continuous_matrix().charpoly(p.s).all_coeffs()
    differences = zip(polynomial, closed_loop_polynomial(), strict=True)
    assert [sp.simplify(a - b) for a, b in differences] == [0] * 5


def test_the_continuous_matrix_is_affine_in_q_and_in_m() -> None:
    member = {p.rho: cl.m_gain * cl.q, p.C_Y_true: cl.C_Y_rest * cl.q}
    matrix = cl.continuous_matrix().subs(member)
    for variable in (cl.q, cl.m_gain):
        assert sp.simplify(sp.diff(matrix, variable, 2)) == sp.zeros(4)


@pytest.mark.parametrize("method", METHODS)
def test_the_sampled_matrix_is_affine_in_the_functions_of_q_and_in_m(method: Method) -> None:
    matrix = cl.sampled_matrix(method, 1, partial=True)
    for a, b in itertools.combinations_with_replacement(cl.HOLD, 2):
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
        cl.m_gain: there.C_U / design.believed.C_U / fall,
        p.C_U_hat: design.believed.C_U,
        **{x: design.coefficients[x.name] for x in derived.core(method, TAN_GPI)[1]},
    }
    numbers |= {symbol: float(x.subs(numbers)) for symbol, x in cl.HOLD.items()}
    matrix = cl.sampled_matrix(method, when.whole, partial=when.part > 0).subs(numbers)
    loop = loop_of(rig, design)
    expected = loop.characteristic(ca.DM(POLES), gap, ratio)[0].full().ravel()
    found = np.poly(np.array(matrix, dtype=float))
    assert found == pytest.approx(expected[: len(found)] / expected[0], rel=ROUNDING, abs=1e-7)
    assert expected[len(found) :] == pytest.approx(0, abs=1e-12)


def test_a_lowered_matrix_is_evaluated_without_rounding() -> None:
    named = derived.core("tustin", TAN_GPI)[1]
    values = {symbol: sp.Rational(n + 2, 7 * n + 3) for n, symbol in enumerate(named)}
    values |= {cl.m_gain: sp.Rational(5, 11), p.C_U_hat: sp.Rational(9, 13)}
    values |= {symbol: sp.Rational(1, n + 3) for n, symbol in enumerate(cl.HOLD)}
    matrix = cl.sampled_matrix("tustin")
    program = lower(list(values), {f"a{n}": x for n, x in enumerate(matrix)})
    found = program.exact(*[_fraction(x) for x in values.values()])
    assert found == [_fraction(x) for x in matrix.subs(values)]


def _fraction(x: sp.Rational) -> Fraction:
    return Fraction(int(x.p), int(x.q))
