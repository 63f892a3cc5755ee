from __future__ import annotations

import dataclasses
import math

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from maglev_design.lowering import lower
from maglev_design.options import EQUILIBRIA, Equilibrium
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.linearisation import (
    believed_beta,
    believed_coefficients,
    linearise,
    taylor_residual,
)

PLANT = p.magnetic_levitation()
LOCAL = linearise(PLANT)
COEFFICIENTS = lower(
    (p.g, p.beta, p.y0, p.Y, p.U),
    {
        "c_u": LOCAL.C_U,
        "c_y": LOCAL.C_Y,
        "c_u_rest": LOCAL.C_U_rest,
        "c_y_rest": LOCAL.C_Y_rest,
    },
).scalar()
BELIEVED = {
    reading: lower(
        (p.g, p.beta_c, p.Y, p.y0, p.U),
        dict(zip("ABC", believed_coefficients(PLANT, LOCAL, reading), strict=True)),
    ).scalar()
    for reading in EQUILIBRIA
}

STEP = 1e-5
"""Relative step of the central differences: their error is about its square, 1e-10."""
DIFFERENCES = 1e-8
"""Relative; the truncation above, and rounding of 1e-16/STEP."""
ROUNDING = 1e-12

gravities = st.floats(1.0, 30.0)
betas = st.floats(1e-5, 1.0)
offsets = st.one_of(st.just(0.0), st.floats(1e-4, 0.02))
gaps = st.floats(2e-3, 0.1)


def acceleration(g: float, beta: float, y0: float, y: float, u: float) -> float:
    """The nonlinear plant (4), written by hand."""
    return g - beta * u * u / ((y + y0) * (y + y0))


@given(gravities, betas, offsets, gaps)
def test_the_coefficients_are_the_slopes_of_the_nonlinear_plant(
    g: float, beta: float, y0: float, Y: float
) -> None:
    U = math.sqrt(g / beta) * (Y + y0)
    du, dy = STEP * U, STEP * (Y + y0)
    slope_u = (acceleration(g, beta, y0, Y, U + du) - acceleration(g, beta, y0, Y, U - du)) / du / 2
    slope_y = (acceleration(g, beta, y0, Y + dy, U) - acceleration(g, beta, y0, Y - dy, U)) / dy / 2
    c_u, c_y, c_u_rest, c_y_rest = COEFFICIENTS(g, beta, y0, Y, U)
    assert c_u == pytest.approx(-slope_u, rel=DIFFERENCES)
    assert c_y == pytest.approx(slope_y, rel=DIFFERENCES)
    assert c_u_rest == pytest.approx(c_u, rel=ROUNDING)
    assert c_y_rest == pytest.approx(c_y, rel=ROUNDING)


@given(gravities, betas, offsets, gaps, st.floats(1.0, 20.0))
def test_the_three_readings_are_those_that_are_documented(
    g: float, beta_c: float, y0: float, Y: float, measured: float
) -> None:
    Z = Y + y0
    modelled = math.sqrt(g / beta_c) * Z
    expected: dict[Equilibrium, tuple[float, float, float]] = {
        "model": (modelled, 2 * g / modelled, 2 * g / Z),
        "appendix-a": (measured, 2 * beta_c * measured / Z**2, 2 * beta_c * measured**2 / Z**3),
        "measured": (measured, 2 * g / measured, 2 * g / Z),
    }
    for reading, values in expected.items():
        assert BELIEVED[reading](g, beta_c, Y, y0, measured) == pytest.approx(values, rel=ROUNDING)


@given(gravities, betas, offsets, gaps)
def test_with_the_true_beta_and_voltage_the_readings_agree(
    g: float, beta: float, y0: float, Y: float
) -> None:
    U = math.sqrt(g / beta) * (Y + y0)
    first, *others = (BELIEVED[reading](g, beta, Y, y0, U) for reading in EQUILIBRIA)
    for other in others:
        assert other == pytest.approx(first, rel=ROUNDING)


def test_each_reading_uses_only_what_it_says() -> None:
    used = {
        reading: set().union(
            *(x.free_symbols for x in believed_coefficients(PLANT, LOCAL, reading))
        )
        for reading in EQUILIBRIA
    }
    assert p.U not in used["model"]
    assert p.g not in used["appendix-a"]
    assert p.beta_c not in used["measured"]
    assert all(p.beta not in symbols for symbols in used.values())


def test_the_expansion_leaves_nothing_at_first_order() -> None:
    assert taylor_residual(PLANT, LOCAL) == 0


def test_a_wrong_coefficient_leaves_something() -> None:
    steeper = p.g - p.beta * p.u**2 / (p.y + p.y0) ** 3
    wrong = linearise(dataclasses.replace(PLANT, acceleration=steeper))
    assert taylor_residual(PLANT, wrong) != 0


def test_the_state_space_is_equation_10() -> None:
    moved = LOCAL.A * sp.Matrix([p.y_d, p.v_d]) + LOCAL.B * p.u_d
    assert moved == sp.Matrix([p.v_d, p.C_Y * p.y_d - p.C_U * p.u_d])


@given(gravities, betas, offsets, gaps, st.floats(1.0, 20.0))
def test_a_measured_equilibrium_says_what_beta_is(
    g: float, beta_c: float, y0: float, Y: float, measured: float
) -> None:
    for reading in EQUILIBRIA:
        program = lower((p.g, p.beta_c, p.Y, p.y0, p.U), {"beta": believed_beta(PLANT, reading)})
        (value,) = program.scalar()(g, beta_c, Y, y0, measured)
        if reading == "measured":
            assert value == pytest.approx(g * (Y + y0) ** 2 / measured**2, rel=ROUNDING)
            assert acceleration(g, value, y0, Y, measured) == pytest.approx(0.0, abs=1e-14 * g)
        else:
            assert value == beta_c
