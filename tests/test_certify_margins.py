from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rigs import SHORT, rig_with

from maglev_design import linear_loop as loops
from maglev_design.certification.margins import Margin, Margins, sampled_margins
from maglev_design.controller.design import believed_equilibrium
from maglev_design.controller.family import family_of
from maglev_design.linear_loop import Loop, build_loop
from maglev_design.options import METHODS, Method
from maglev_design.rig import Rig

GRID_MISS = 1e-3
"""python-control interpolates between a thousand frequencies; the loop's own search does not."""
SIDE = 0.01
"""Relative step to either side of a margin: the interpolation is ten times better."""
POLES = (1.0, 60.0, 1.1, 70.0)
RIG = rig_with(SHORT, {"uncertainty.beta": 0.1, "sampling.delay": 0.0005})


def loop_of(rig: Rig, method: Method, extra: int = 0) -> Loop:
    believed = believed_equilibrium(rig, "model")
    return build_loop(rig, believed, method=method, extra_samples=extra)


@pytest.fixture(scope="module", params=METHODS)
def method(request: pytest.FixtureRequest) -> Method:
    return next(m for m in METHODS if m == request.param)


@pytest.fixture(scope="module")
def margins(method: Method) -> Margins:
    return sampled_margins(loop_of(RIG, method), POLES, family_of(RIG, beta_error=0.1))


def scaled_radius(loop: Loop, at: Margin, factor: float, late: int = 0) -> float:
    """Spectral radius with the loop gain times `factor` and `late` more whole samples."""
    numerator, denominator = (m.full().ravel() for m in loop.open_loop(POLES, at.gap, at.ratio))
    delayed: NDArray[np.float64] = np.append(denominator, np.zeros(late))
    return float(np.abs(np.roots(np.polyadd(delayed, factor * numerator))).max())


def test_python_control_sees_the_same_peak_of_sensitivity(method: Method, margins: Margins) -> None:
    over = family_of(RIG, beta_error=0.1)
    own = loops.peak_sensitivity(loop_of(RIG, method), POLES, over)
    assert margins.ms.value == pytest.approx(own.value, rel=GRID_MISS)
    assert [margins.ms.gap, margins.ms.ratio] == pytest.approx([own.gap, own.ratio])


@pytest.mark.parametrize("name", ["gain_up", "gain_down"])
def test_a_gain_margin_is_where_the_loop_becomes_unstable(
    method: Method, margins: Margins, name: str
) -> None:
    loop, margin = loop_of(RIG, method), getattr(margins, name)
    further = 1 if name == "gain_up" else -1
    assert (margin.value > 1) == (name == "gain_up")
    assert scaled_radius(loop, margin, margin.value * (1 - further * SIDE)) < 1
    assert scaled_radius(loop, margin, margin.value * (1 + further * SIDE)) > 1


def test_no_gain_between_the_margins_is_unstable_anywhere(method: Method, margins: Margins) -> None:
    loop = loop_of(RIG, method)
    gains = np.geomspace(
        margins.gain_down.value * (1 + SIDE), margins.gain_up.value * (1 - SIDE), 25
    )
    for gap, ratio in family_of(RIG, beta_error=0.1).grid(3, 2).T:
        at = Margin(0.0, float(gap), float(ratio))
        assert max(scaled_radius(loop, at, gain) for gain in gains) < 1


def test_whole_samples_up_to_the_delay_margin_are_survived_and_no_more(
    method: Method, margins: Margins
) -> None:
    loop, margin = loop_of(RIG, method), margins.delay_s
    whole = int(margin.value / RIG.sampling.period)
    assert whole >= 1
    assert scaled_radius(loop, margin, 1.0, whole) < 1
    assert scaled_radius(loop, margin, 1.0, whole + 1) > 1


def test_the_phase_margin_is_where_a_turned_loop_becomes_unstable(
    method: Method, margins: Margins
) -> None:
    loop, at = loop_of(RIG, method), margins.phase_deg
    numerator, denominator = (m.full().ravel() for m in loop.open_loop(POLES, at.gap, at.ratio))

    def radius(degrees: float) -> float:
        turned = numerator * np.exp(1j * math.radians(degrees))
        return float(np.abs(np.roots(np.polyadd(denominator.astype(complex), turned))).max())

    inside, outside = (at.value * (1 + sign * SIDE) for sign in (-1, 1))
    assert max(radius(inside), radius(-inside)) < 1
    assert max(radius(outside), radius(-outside)) > 1


def test_an_unstable_loop_has_no_margins() -> None:
    late = rig_with(SHORT, {"sampling.delay": 0.02})
    found = sampled_margins(loop_of(late, "tustin"), POLES, family_of(late, beta_error=0.0))
    values: list[Any] = [entry["value"] for entry in asdict(found).values()]
    assert len(values) == 7
    assert all(math.isnan(value) for value in values)


def test_the_worst_point_is_of_the_family(margins: Margins) -> None:
    over = family_of(RIG, beta_error=0.1)
    for entry in asdict(margins).values():
        assert over.gaps[0] <= entry["gap"] <= over.gaps[1]
        assert over.ratios[0] <= entry["ratio"] <= over.ratios[1]
