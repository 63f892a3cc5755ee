"""Settling, undershoot and total variation of responses made up by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from maglev_design.controller.design import PoleSpec, make_design, plant_beta
from maglev_design.rig import Rig
from maglev_design.simulation import (
    Response,
    build,
    nominal_scenario,
    settling_time,
    simulate,
    total_variation,
    undershoot,
)


@pytest.fixture(scope="module")
def response(short_rig: Rig) -> Response:
    loop = build(short_rig, "tustin")
    design = make_design(short_rig, PoleSpec.double(1.0, 70.0))
    return simulate(loop, design, nominal_scenario(short_rig, plant_beta(short_rig)))


def with_error(response: Response, error: Any) -> Response:
    return replace(response, gap=response.reference + error)


def test_an_exponential_settles_when_it_has_fallen_to_two_per_cent(
    short_rig: Rig, response: Response
) -> None:
    rate = 100.0
    decayed = with_error(response, 1e-4 * np.exp(-rate * response.times))
    period = short_rig.sampling.period
    assert settling_time(short_rig, decayed) == pytest.approx(math.log(50) / rate, abs=period)
    assert undershoot(short_rig, decayed) == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_undershoot_is_the_share_beyond_the_reference(
    short_rig: Rig, response: Response, sign: int
) -> None:
    error = sign * 1e-4 * np.exp(-40 * response.times) * np.cos(200 * response.times)
    passed = with_error(response, error)
    expected = -float((sign * error).min()) / 1e-4
    assert undershoot(short_rig, passed) == pytest.approx(expected)
    assert expected > 0.1


def test_an_error_that_stays_never_settles(short_rig: Rig, response: Response) -> None:
    assert math.isnan(settling_time(short_rig, with_error(response, 1e-4)))


def test_a_ball_that_starts_on_the_reference_has_settled(
    short_rig: Rig, response: Response
) -> None:
    on_path = with_error(response, 0.0)
    assert settling_time(short_rig, on_path) == 0
    assert math.isnan(undershoot(short_rig, on_path))


def test_what_happens_during_the_move_does_not_count(short_rig: Rig, response: Response) -> None:
    error = 1e-4 * np.exp(-200 * response.times)
    late = np.where(response.times > short_rig.reference.start_time, 1e-3, error)
    assert settling_time(short_rig, with_error(response, late)) == settling_time(
        short_rig, with_error(response, error)
    )


def test_total_variation_counts_ups_and_downs(response: Response) -> None:
    applied = np.zeros_like(response.applied)
    applied[1:4] = (2.0, -1.0, 0.5)
    assert total_variation(replace(response, applied=applied)) == pytest.approx(2 + 3 + 1.5 + 0.5)
