"""What a tuning says of itself: excitation, warnings, noise, infeasibility, saturated optima."""

from __future__ import annotations

import math
from typing import Any

import pytest
from grids import coarse
from rigs import MINIMAL, QUICK, STUBBORN, rig_with

from maglev_design.controller.design import (
    PoleSpec,
)
from maglev_design.controller.plant import (
    fastest_unstable_pole,
)
from maglev_design.errors import InputError
from maglev_design.files import finite
from maglev_design.rig import Rig, load_rig
from maglev_design.tuning import (
    Status,
    TuneResult,
    TuningProblem,
    Unstabilisable,
    as_json,
    build_problem,
    judge,
    solve,
)
from maglev_design.tuning.cautions import cautions
from maglev_design.tuning.evaluation import run

STUBBORN_MS = 3.2287
"""Of a search on ever finer grids for the smallest Ms and nothing else; see STUBBORN."""
ABOVE = 0.01
"""How far above, relative, the answer of `tune` may be."""
HUMUSOFT_SATURATED = 1.3855e-7
"""[m s^2] Of a dense search by another program."""
GRID_OF_ANOTHER = 2e-3


def solved(problem: TuningProblem) -> TuneResult:
    found = solve(problem)
    assert isinstance(found, TuneResult)
    return found


# --- nothing moves -------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_where_nothing_moves_the_ball_starts_two_per_cent_away(noise: float) -> None:
    problem = build_problem(rig_with(MINIMAL, {"plant.gap_offset": 0.004, "noise.position": noise}))
    assert problem.excitation is not None
    assert problem.excitation.offset == pytest.approx(0.02 * (0.0246 + 0.004))
    assert problem.rig.initial.gap == pytest.approx(0.0246 + problem.excitation.offset)
    assert problem.rig.initial.velocity == 0
    found = run(problem, PoleSpec.double(1, 70), problem.cases[0], 1.0)
    assert found.value > 0


@pytest.mark.parametrize(
    "limit",
    [{"limits.gap": [0.001, 0.0248]}, {"limits.voltage": [0.0, 2.1]}],
    ids=["gap", "voltage"],
)
def test_the_ball_starts_on_the_other_side_where_a_limit_forbids_this_one(
    limit: dict[str, Any],
) -> None:
    problem = build_problem(rig_with(MINIMAL, limit))
    assert problem.excitation is not None
    assert problem.excitation.offset == pytest.approx(-0.02 * 0.0246)


def test_limits_that_forbid_both_sides_are_refused() -> None:
    with pytest.raises(InputError, match="nothing moves"):
        build_problem(rig_with(MINIMAL, {"limits.gap": [0.0244, 0.0248]}))


@pytest.mark.parametrize(
    "moves",
    [{"initial.gap": 0.0247}, {"initial": {"gap": 0.0246, "velocity": 0.01}}],
    ids=["gap", "velocity"],
)
def test_a_rig_that_moves_is_left_alone(moves: dict[str, Any]) -> None:
    rig = rig_with(MINIMAL, moves)
    problem = build_problem(rig)
    assert problem.excitation is None
    assert problem.rig == rig


# --- warnings ------------------------------------------------------------------------------


def warned(changes: dict[str, Any], **options: Any) -> str:
    return "\n".join(cautions(build_problem(rig_with(QUICK, changes), **options)))


def test_a_quiet_rig_has_no_warning() -> None:
    assert warned({}) == ""


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"noise": {"input": 1e-3}}, ("noise.position is not given",)),
        ({"uncertainty.beta": 0.0}, ("the worst case is the nominal one",)),
        ({"operating_point.voltage": 1.0}, ("implies beta", "times K C^2/m")),
        ({"sampling.period": 0.012}, ("p T = 0.4",)),
        ({"emulator": {"sensor_step": 1e-5}}, ("emulator.sensor_step", "2.89e-06 m")),
    ],
)
def test_a_warning_names_its_cause(changes: dict[str, Any], words: tuple[str, ...]) -> None:
    text = warned(changes)
    for word in words:
        assert word in text
    assert len(text.splitlines()) == 1


def test_an_assumed_error_of_the_voltage_is_said() -> None:
    voltage = {"operating_point.voltage": 2.0825}
    assert "1 % assumed" in warned(voltage, equilibrium="measured")
    given = voltage | {"uncertainty.voltage": 0.01}
    assert "assumed" not in warned(given, equilibrium="measured")


@pytest.mark.parametrize(
    ("product", "told", "no_drive"),
    [(0.019, False, False), (0.03, True, False), (0.06, True, True)],
)
def test_the_coil_is_told_with_its_product(product: float, told: bool, no_drive: bool) -> None:
    pole = fastest_unstable_pole(rig_with(QUICK))
    assert pole == pytest.approx(math.sqrt(2 * 9.81 / 0.0180), rel=1e-12)
    emulator = {"emulator": {"inductance": product / pole, "resistance": 1.0}}
    text = warned(emulator)
    assert (f"p L/R = {product:g}" in text) == told
    assert ("no ideal drive" in text) == no_drive


# --- noise ---------------------------------------------------------------------------------


def test_quantisation_adds_to_the_noise_that_is_limited() -> None:
    step = 2e-5
    plain, coarse = (
        build_problem(rig_with(QUICK, {"emulator": {"sensor_step": s}})) for s in (0.0, step)
    )
    assert coarse.position_noise == pytest.approx(math.hypot(1e-6, step / math.sqrt(12)))
    poles = PoleSpec.double(1, 70)
    ratio = judge(coarse, poles).noise_voltage / judge(plain, poles).noise_voltage
    assert ratio == pytest.approx(coarse.position_noise / 1e-6)


@pytest.fixture(scope="module")
def result() -> TuneResult:
    return solved(build_problem(rig_with(QUICK)))


def test_the_rigs_noise_has_a_row_of_its_own(result: TuneResult) -> None:
    noisy = as_json(result)["with_noise"]
    assert noisy["itae"] > result.figures.worst.itae
    assert noisy["lost"] == 0
    quiet = solved(build_problem(rig_with(QUICK, {"noise": ...}), omega_bounds=(50, 60)))
    assert as_json(quiet)["with_noise"] is None


def test_the_largest_error_is_told_with_and_without_the_start(result: TuneResult) -> None:
    figures = result.figures
    start = abs(0.0246 - 0.0242)
    assert figures.max_error >= start
    assert figures.max_error_from_move is not None
    assert 0 < figures.max_error_from_move < figures.max_error


# --- unstable and infeasible ---------------------------------------------------------------


def test_an_unstable_loop_has_neither_ms_nor_noise_voltage() -> None:
    problem = build_problem(rig_with(QUICK, {"sampling.period": 0.02}))
    figures = judge(problem, PoleSpec.double(1, 200))
    assert figures.spectral_radius > 1
    assert figures.ms == math.inf
    assert figures.noise_voltage == math.inf
    limits = {c.name: c for c in figures.constraints}
    for name in ("Ms", "noise voltage"):
        assert finite({"value": limits[name].value}) == {"value": None}
        assert not limits[name].satisfied


@pytest.fixture(scope="module")
def stubborn() -> TuneResult:
    return solved(build_problem(rig_with(STUBBORN)))


def test_infeasible_names_the_limit_that_stands_in_the_way(stubborn: TuneResult) -> None:
    assert stubborn.status is Status.INFEASIBLE
    assert stubborn.figures.tightest.name == "Ms"
    assert STUBBORN_MS <= stubborn.figures.tightest.value <= STUBBORN_MS * (1 + ABOVE)
    assert [c.name for c in stubborn.figures.constraints if not c.satisfied] == ["Ms"]
    tightest = as_json(stubborn)["tightest"]
    assert set(tightest) >= {"name", "limit", "value", "poles", "hint"}


def test_the_hint_of_an_infeasible_problem_works(stubborn: TuneResult) -> None:
    assert stubborn.relief is not None
    assert set(stubborn.relief.options) == {"max_ms"}
    again = solved(build_problem(rig_with(STUBBORN), **stubborn.relief.options))
    assert again.figures.feasible
    assert f"--max-ms {stubborn.relief.options['max_ms']:g}" in stubborn.relief.hint


def test_the_hint_for_a_command_out_of_range_is_to_allow_saturation() -> None:
    rig = rig_with(QUICK, {"initial.gap": 0.0260, "limits.voltage": [0.0, 2.5]})
    found = solved(build_problem(rig))
    assert found.status is Status.INFEASIBLE
    assert found.relief is not None
    assert found.relief.options == {"allow_saturation": True}
    assert solved(build_problem(rig, **found.relief.options)).figures.feasible


def test_the_hint_where_only_the_proof_is_missing_is_to_do_without() -> None:
    bounds: dict[str, Any] = {"zeta_bounds": (0.9, 1.3), "omega_bounds": (60.0, 80.0)}
    with coarse():
        found = solved(build_problem(rig_with(QUICK), certifies=lambda _: False, **bounds))
    assert found.status is Status.INFEASIBLE
    assert found.relief is not None
    assert found.relief.options == {"certifies": None}


def test_a_period_too_long_is_told_with_its_product() -> None:
    rig = rig_with(QUICK, {"sampling.period": 0.06})
    found = solve(build_problem(rig))
    assert isinstance(found, Unstabilisable)
    assert f"p T = {fastest_unstable_pole(rig) * 0.06:.2g} " in str(found)


# --- saturation ----------------------------------------------------------------------------


def test_a_saturated_optimum_is_that_of_a_dense_search() -> None:
    rig: Rig = load_rig("humusoft-ce152")
    found = solved(build_problem(rig, allow_saturation=True))
    assert found.figures.feasible
    assert found.figures.worst.itae <= HUMUSOFT_SATURATED * (1 + GRID_OF_ANOTHER)
