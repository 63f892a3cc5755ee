from __future__ import annotations

import pytest
import reference
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from maglev_design.lowering import lower
from maglev_design.symbolic import plant as p

PLANT = p.magnetic_levitation()
PROGRAM = lower(
    (p.m, p.g, p.C, p.K, p.y0, p.y, p.u, p.Y),
    {
        "balance": PLANT.force_balance.subs(p.i, PLANT.current),
        "beta_value": PLANT.beta,
        "acceleration": PLANT.acceleration.subs(p.beta, PLANT.beta),
        "voltage": PLANT.equilibrium_voltage.subs(p.beta, PLANT.beta),
    },
).scalar()

ROUNDING = 1e-13
"""Relative; a dozen operations in double precision."""

masses = st.floats(1e-3, 5.0)
gravities = st.floats(1.0, 30.0)
current_gains = st.floats(0.05, 10.0)
force_constants = st.floats(1e-6, 1e-1)
offsets = st.one_of(st.just(0.0), st.floats(1e-4, 0.02))
gaps = st.floats(1e-3, 0.1)
voltages = st.floats(0.0, 50.0)


@given(masses, gravities, current_gains, force_constants, offsets, gaps, voltages)
def test_the_acceleration_is_that_of_newton_and_the_magnet(
    m: float, g: float, C: float, K: float, y0: float, y: float, u: float
) -> None:
    balance, beta, acceleration, _ = PROGRAM(m, g, C, K, y0, y, u, y)
    current = C * u
    pull = K * current**2 / (y + y0) ** 2
    size = m * g + pull
    assert balance == pytest.approx(m * g - pull, abs=ROUNDING * size)
    assert acceleration == pytest.approx((m * g - pull) / m, abs=ROUNDING * size / m)
    assert beta == pytest.approx(K * C * C / m, rel=ROUNDING)


@given(masses, gravities, current_gains, force_constants, offsets, gaps)
def test_the_equilibrium_voltage_holds_the_ball(
    m: float, g: float, C: float, K: float, y0: float, gap: float
) -> None:
    *_, voltage = PROGRAM(m, g, C, K, y0, gap, 1.0, gap)
    assert voltage > 0
    assert K * (C * voltage) ** 2 / (gap + y0) ** 2 == pytest.approx(m * g, rel=ROUNDING)


def test_the_paper_s_numbers_follow_from_its_parameters() -> None:
    _, beta, _, voltage = PROGRAM(
        0.02, 9.81, 1.05, 2.48315625e-5, 0.0, 0.01, 1.0, reference.EQUILIBRIUM_GAP
    )
    assert f"{beta:.8f}" == str(reference.BETA)
    assert f"{voltage:.4f}" == str(reference.EQUILIBRIUM_VOLTAGE)


def test_without_an_offset_the_plant_is_the_paper_s() -> None:
    assert PLANT.acceleration.subs(p.y0, 0) == p.g - p.beta * p.u**2 / p.y**2


def test_every_symbol_is_listed_once_with_unit_and_meaning() -> None:
    entries = (*p.SYMBOLS, *p.OTHER_SYMBOLS)
    names = [entry.symbol.name for entry in entries]
    assert len(set(names)) == len(names)
    assert all(entry.unit and entry.meaning and entry.latex for entry in entries)
    public = {x for x in vars(p).values() if isinstance(x, sp.Symbol)}
    assert public == {entry.symbol for entry in entries}


def test_physical_constants_are_positive_and_positions_are_not() -> None:
    assert all(x.is_positive for x in (p.m, p.g, p.C, p.K, p.beta, p.Y, p.U, p.T))
    assert p.y0.is_nonnegative
    assert p.y0.is_positive is None
    assert all(x.is_positive is None for x in (p.y, p.v, p.u, p.y_d, p.u_d, p.e))
