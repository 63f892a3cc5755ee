from __future__ import annotations

import math

import control as ct
import control.flatsys as fs
import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from maglev_design.lowering import lower
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.flatness import flat_model, round_trip_residual
from maglev_design.symbolic.linearisation import linearise

PLANT = p.magnetic_levitation()
LOCAL = linearise(PLANT)
FLAT = flat_model(PLANT, LOCAL)
INPUT = lower((p.C_U, p.C_Y, p.y_d, p.acc_d), {"u": FLAT.input}).scalar()
ACCELERATION = lower((p.C_U, p.C_Y, p.y_d, p.v_d, p.u_d), {"acc": FLAT.acceleration}).scalar()
NONLINEAR = lower((p.g, p.beta, p.y0, p.y, p.acc), {"u": FLAT.nonlinear_input}).scalar()

ROUNDING = 1e-12
MATRICES = 1e-9
"""python-control finds the flat output with numerical inverses, condition about C_U C_Y."""

coefficients = st.tuples(st.floats(0.5, 50.0), st.floats(50.0, 5000.0))
increments = st.floats(-5e-3, 5e-3)
accelerations = st.floats(-20.0, 20.0)


@given(coefficients, increments, accelerations)
def test_the_flat_input_makes_the_acceleration_it_is_asked_for(
    pair: tuple[float, float], y_d: float, acc_d: float
) -> None:
    c_u, c_y = pair
    (u_d,) = INPUT(c_u, c_y, y_d, acc_d)
    size = abs(acc_d) + c_y * abs(y_d) + 1.0
    assert -c_u * u_d + c_y * y_d == pytest.approx(acc_d, abs=ROUNDING * size)
    (back,) = ACCELERATION(c_u, c_y, y_d, 0.3, u_d)
    assert back == pytest.approx(acc_d, abs=ROUNDING * size)


@given(coefficients, increments, st.floats(-1.0, 1.0), st.floats(-3.0, 3.0))
def test_python_control_finds_the_same_flat_output(
    pair: tuple[float, float], y_d: float, v_d: float, u_d: float
) -> None:
    c_u, c_y = pair
    system = fs.LinearFlatSystem(ct.ss([[0, 1], [c_y, 0]], [[0], [-c_u]], [[1, 0]], 0))
    scale = system.forward([1.0, 0.0], [0.0], {})[0][0]
    (flag,) = system.forward([y_d, v_d], [u_d], {})
    assert FLAT.flat_output == p.y_d
    expected = (y_d, v_d, -c_u * u_d + c_y * y_d)
    tolerance = MATRICES * (1 + c_y)
    assert flag / scale == pytest.approx(np.array(expected), rel=MATRICES, abs=tolerance)
    state, effort = system.reverse([np.array(expected) * scale], {})
    assert state == pytest.approx([y_d, v_d], rel=MATRICES, abs=tolerance)
    assert effort[0] == pytest.approx(INPUT(c_u, c_y, y_d, expected[2])[0], abs=tolerance)


@given(
    st.floats(1.0, 30.0),
    st.floats(1e-5, 1.0),
    st.one_of(st.just(0.0), st.floats(1e-4, 0.02)),
    st.floats(2e-3, 0.1),
    st.floats(-3.0, 0.99),
)
def test_the_nonlinear_plant_is_flat_too(
    g: float, beta: float, y0: float, y: float, share: float
) -> None:
    acc = share * g
    (u,) = NONLINEAR(g, beta, y0, y, acc)
    assert u > 0
    assert g - beta * u**2 / (y + y0) ** 2 == pytest.approx(acc, rel=ROUNDING, abs=ROUNDING * g)
    (rest,) = NONLINEAR(g, beta, y0, y, 0.0)
    assert rest == pytest.approx(math.sqrt(g / beta) * (y + y0), rel=ROUNDING)


def test_flat_and_controllable_are_the_same() -> None:
    assert FLAT.controllability.det() == -(p.C_U**2)
    assert FLAT.state == (p.y_d, p.v_d)
    assert round_trip_residual(FLAT) == 0


def test_the_input_is_equation_11() -> None:
    assert sp.simplify(FLAT.input - (-p.acc_d + p.C_Y * p.y_d) / p.C_U) == 0
