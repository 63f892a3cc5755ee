"""Nonsense from Python raises at the entrance, with what is wrong and the nearest name."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from rigs import SHORT, rig_with

from maglev_design.controller.design import PoleSpec, make_design, plant_beta
from maglev_design.errors import InputError
from maglev_design.options import Controller
from maglev_design.simulation import (
    Scenario,
    build,
    loop_for,
    nominal_scenario,
    respond,
    simulate,
    simulate_batch,
)

RIG = rig_with(SHORT)
POLES = PoleSpec.double(1.0, 70.0)
DESIGN = make_design(RIG, POLES)
BETA = plant_beta(RIG)
SCENARIO = nominal_scenario(RIG, BETA)
NUMBERS = ("initial_gap", "initial_velocity", "gravity", "gap_offset")
NOISES = ("input_noise", "position_noise")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: make_design(RIG, POLES, method=_any("bilinear")), "method = 'bilinear': unknown"),
        (lambda: make_design(RIG, POLES, method=_any("tusting")), "did you mean 'tustin'"),
        (lambda: build(RIG, _any("bilinear")), "method = 'bilinear': unknown"),
        (lambda: build(RIG, _any("eular")), "did you mean 'euler'"),
        (lambda: make_design(RIG, POLES, equilibrium=_any("measure")), "did you mean 'measured'"),
        (lambda: Controller(_any("tan-gpl")), "did you mean 'tan-gpi'"),
        (lambda: Controller("lin-pid", start=_any("bumples")), "did you mean 'bumpless'"),
        (lambda: Controller("lin-pid", derivative=_any("gap")), "derivative = 'gap'"),
        (lambda: Controller("lin-pid", feedforward=_any("statics")), "did you mean 'static'"),
        (lambda: Controller("lin-pid", filter=math.nan), "filter = nan"),
        (
            lambda: simulate_batch(
                loop_for(RIG, DESIGN), [DESIGN], [SCENARIO], backend=_any("compild")
            ),
            "did you mean 'compiled'",
        ),
    ],
)
def test_a_word_that_is_unknown_is_refused_with_the_nearest(
    make: Callable[[], Any], words: str
) -> None:
    with pytest.raises(InputError) as error:
        make()
    assert words in str(error.value)


def _any(word: str) -> Any:
    return word


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 0.0])
def test_a_force_constant_that_no_plant_has_is_refused(value: float) -> None:
    for make in (
        lambda: Scenario(value, 0.024),
        lambda: make_design(RIG, POLES, beta_c=value),
        lambda: make_design(RIG, POLES, equilibrium="measured", voltage=value),
        lambda: DESIGN.beta_at(value),
        lambda: PoleSpec.double(1.0, value),
        lambda: PoleSpec.double(value, 70.0),
    ):
        with pytest.raises(InputError, match=f"= {value!r}: must be a finite number greater than"):
            make()


@pytest.mark.parametrize("name", [*NUMBERS, *NOISES])
def test_a_scenario_holds_no_nan(name: str) -> None:
    for value in (math.nan, math.inf):
        changes: dict[str, Any] = {name: value}
        with pytest.raises(InputError, match=f"{name} = {value!r}"):
            replace(SCENARIO, **changes)


@pytest.mark.parametrize("name", ["seed", "index"])
@pytest.mark.parametrize("value", [-1, 2**32])
def test_a_stream_of_noise_that_is_not_there_is_refused(name: str, value: int) -> None:
    changes: dict[str, Any] = {name: value}
    with pytest.raises(InputError, match=f"{name} = {value}: must be a whole number"):
        replace(SCENARIO, **changes)


def test_gains_and_integration_steps_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="k1 = nan"):
        make_design(RIG, POLES, gains=(2e7, math.nan, 3e4, 280.0))
    with pytest.raises(InputError, match="refine = 0"):
        build(RIG, "tustin", refine=0)
    with pytest.raises(InputError, match="fastest = nan"):
        build(RIG, None, fastest=math.nan)


@pytest.mark.parametrize(
    ("changes", "method", "word"),
    [
        ({}, "zoh", "method"),
        ({"sampling.period": 0.002}, "tustin", "period"),
        ({"operating_point.gap": 0.024}, "tustin", "Y"),
        ({"limits.voltage": [0.0, 6.0]}, "tustin", "voltage"),
    ],
    ids=["method", "period", "gap", "voltage"],
)
def test_a_loop_of_another_rig_or_method_does_not_run_a_design(
    changes: dict[str, Any], method: Any, word: str
) -> None:
    loop = build(rig_with(SHORT, changes), method)
    runs: list[Callable[[], Any]] = [
        lambda: simulate(loop, DESIGN, SCENARIO),
        lambda: respond(loop, DESIGN, SCENARIO),
        lambda: simulate_batch(loop, [DESIGN], [SCENARIO]),
    ]
    for run in runs:
        with pytest.raises(ValueError, match=f"a loop with .*{word}.* cannot run a design with"):
            run()


def test_a_continuous_loop_runs_a_design_of_any_method_and_period() -> None:
    other = make_design(rig_with(SHORT, {"sampling.period": 0.002}), POLES, method="zoh")
    loop = loop_for(RIG, other, continuous=True)
    assert simulate(loop, other, SCENARIO).metrics == simulate(loop, DESIGN, SCENARIO).metrics
