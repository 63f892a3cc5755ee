from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs import SHORT, rig_with
from typer.testing import CliRunner

from maglev_design.cli import app
from maglev_design.cli.emulated_text import emulated_headline, emulated_warnings
from maglev_design.controller.design import PAPER_POLES, PoleSpec, make_design, plant_beta
from maglev_design.errors import InputError
from maglev_design.record import load
from maglev_design.rig import Rig, load_rig
from maglev_design.simulation import at_own_period, emulated, loop_for, nominal_scenario, simulate
from maglev_design.simulation.transient import total_variation
from maglev_design.tuning import (
    Status,
    TuneResult,
    TuningProblem,
    as_json,
    build_problem,
    emulated_row,
    solve,
)
from maglev_design.tuning.emulated import (
    FIRST_JUDGING_SEED,
    JUDGING_SEEDS,
    ONE_MORE_SAMPLE,
    TRAINING_STREAMS,
    emulations,
    judging_seeds,
    sensitivity_peaks,
)
from maglev_design.tuning.evaluation import design_at

EFFECTS: dict[str, Any] = {
    "inductance": 0.011,
    "resistance": 22.0,
    "sensor_step": 1.0e-5,
    "actuator_step": 2.0e-3,
    "position_noise": 3.0e-6,
}
BASELINE = PoleSpec.double(1.0, 60.0)
SUMMED = 1e-9
"""The compiled loop adds the metrics in another order; quantised loops part where they round."""


def short(**more: Any) -> Rig:
    return rig_with(SHORT, {"emulator": {**EFFECTS, **more}, "uncertainty.beta": 0.1})


def document_of(rig: Rig, poles: PoleSpec, baseline: PoleSpec | None = None) -> dict[str, Any]:
    """Return what the text on the emulated rig is made from."""
    problem = build_problem(rig)
    row = emulated_row(problem, design_at(problem, poles), baseline)
    pair = baseline and {"zeta": baseline.first[0], "omega_n": baseline.first[1]}
    return {"emulated": row and row.as_dict(), "baseline": pair, "scenarios": "nominal"}


# --- a design on the emulated rig -----------------------------------------------------------


def test_without_effects_there_is_no_row() -> None:
    for changes in ({}, {"emulator.resistance": 22.0}, {"emulator.period": 0.002}):
        found = document_of(rig_with(SHORT, changes), BASELINE)
        assert found["emulated"] is None
        assert emulated_warnings(found) == []
        assert emulated_headline({**found, "baseline": {"zeta": 1.0, "omega_n": 60.0}}) is None


def test_the_row_holds_the_runs_at_the_design_s_own_period() -> None:
    rig = short(period=0.002, delay=0.0002)
    found = document_of(rig, BASELINE)["emulated"]
    own = at_own_period(rig)
    assert (own.sampling.period, own.sampling.delay) == (0.001, 0.0002)
    assert own.noise.position == EFFECTS["position_noise"]
    design = make_design(own, BASELINE)
    loop = loop_for(own, design, emulate=True)
    scenario = replace(nominal_scenario(own, plant_beta(own)), noise=True)
    runs = [simulate(loop, design, replace(scenario, seed=seed)) for seed in found["judging_seeds"]]
    itae = [r.metrics.itae for r in runs]
    assert found["period"] == 0.001
    assert (found["ratio"], found["seeds"], found["lost"]) == (1.0, JUDGING_SEEDS, 0)
    assert found["itae"]["median"] == pytest.approx(np.median(itae), rel=SUMMED)
    assert found["itae"]["low"] == pytest.approx(np.percentile(itae, 2.5), rel=SUMMED)
    variation = np.median([total_variation(r) for r in runs])
    assert found["total_variation"]["median"] == pytest.approx(variation, rel=SUMMED)
    assert found["worst"]["ratio"] in (0.9, 1.0, 1.1)
    assert found["worst"]["itae"]["median"] >= found["itae"]["median"]


def test_another_period_is_another_controller() -> None:
    other = document_of(short(period=0.002), BASELINE)["emulated"]["rediscretised"]
    assert other["period"] == 0.002
    same = document_of(short(period=0.001), BASELINE)["emulated"]
    assert same["rediscretised"] is None
    assert same["period"] == 0.001
    assert other["itae"]["median"] != same["itae"]["median"]


def test_a_lost_ball_is_said_first() -> None:
    slow_coil = short(inductance=0.66)
    found = document_of(slow_coil, PoleSpec.double(1.0, 100.0))
    assert found["emulated"]["lost"] == JUDGING_SEEDS
    (text,) = emulated_warnings(found)
    assert "THE BALL IS LOST" in text
    assert "20 of 20" in text
    assert "L/R = 30 ms" in text
    assert emulated_warnings(document_of(short(), BASELINE)) == []


def test_where_the_baseline_wins_a_sentence_says_so() -> None:
    fast, slow = PoleSpec.double(1.137, 107.3), PoleSpec.double(1.0, 70.0)
    rig = load_rig("belmonte2021")
    document = document_of(rig, fast, slow)
    own, other = document["emulated"], document["emulated"]["baseline"]
    assert own["itae"]["median"] > other["itae"]["median"]
    text = emulated_headline(document)
    assert text is not None
    assert f"ITAE {own['itae']['median']:.2g} against {other['itae']['median']:.2g}" in text
    assert "the design loses to zeta = 1, omega_n = 70" in text
    assert emulated_headline(document_of(rig, slow, fast)) is None


# --- tuned for the emulated rig -------------------------------------------------------------


@pytest.fixture(scope="module")
def tuned() -> TuneResult:
    problem = build_problem(short(period=0.002), scenarios="emulated", max_ms=3.0)
    found = solve(problem, None, BASELINE)
    assert isinstance(found, TuneResult)
    return found


def test_without_an_emulator_nothing_is_tuned_for_it() -> None:
    with pytest.raises(InputError, match=r"\[emulator\] has no effect.*sensor_step"):
        build_problem(rig_with(SHORT), scenarios="emulated")


def test_the_design_runs_at_the_emulator_s_period(tuned: TuneResult) -> None:
    rig = tuned.problem.rig
    assert rig == emulated(short(period=0.002))
    assert tuned.design.period == rig.sampling.period == 0.002
    assert tuned.status in (Status.OPTIMAL, Status.ON_BOUND)
    document = as_json(tuned)
    assert document["scenarios"] == "emulated"
    found = document["emulated"]
    assert found["period"] == 0.002
    assert found["rediscretised"] is None
    assert found["training_streams"] == list(range(TRAINING_STREAMS))
    assert min(found["judging_seeds"]) == tuned.problem.seed + FIRST_JUDGING_SEED


def test_the_limits_are_kept_with_one_more_sample(tuned: TuneResult) -> None:
    limits = {c.name: c for c in tuned.figures.constraints}
    assert limits[ONE_MORE_SAMPLE].satisfied
    assert limits[ONE_MORE_SAMPLE].value == tuned.figures.spectral_radius_one_more_sample
    assert tuned.figures.feasible
    assert tuned.figures.ms <= 3.0


def worst_median(problem: TuningProblem, poles: PoleSpec) -> float:
    seeds = judging_seeds(problem.seed)
    return emulations(problem, problem.rig, design_at(problem, poles), seeds).worst.itae.median


def test_no_neighbour_is_better_by_more_than_the_noise(tuned: TuneResult) -> None:
    problem, (zeta, omega_n) = tuned.problem, tuned.poles.first
    own = worst_median(problem, tuned.poles)
    for a, b in ((1.15, 1.0), (1 / 1.15, 1.0), (1.0, 1.15), (1.0, 1 / 1.15)):
        poles = PoleSpec.double(zeta * a, omega_n * b)
        if max(sensitivity_peaks(problem, poles)) < 3.0:
            assert worst_median(problem, poles) > 0.95 * own
    assert own < worst_median(problem, PoleSpec.double(2 * zeta, omega_n))


def test_the_saved_design_runs_where_it_was_tuned(tmp_path: Path) -> None:
    source = tmp_path / "rig.toml"
    lines = [f"{name} = {value!r}" for name, value in {**EFFECTS, "period": 0.002}.items()]
    plain = (
        "[plant]\nmass = 0.02\ngravity = 9.81\ncurrent_gain = 1.05\n"
        "force_constant = 2.48315625e-5\n[operating_point]\ngap = 0.0246\n[initial]\n"
        "gap = 0.0244\n[reference]\nstart_gap = 0.0242\nend_gap = 0.02\nstart_time = 0.1\n"
        "end_time = 0.3\nhorizon = 0.4\n[sampling]\nperiod = 0.001\n[limits]\n"
        "voltage = [0.0, 5.0]\n[uncertainty]\nbeta = 0.1\n"
    )
    source.write_text(plain)
    words = ["tune", "--rig", str(source), "--scenarios", "emulated", "--max-ms", "3"]
    refused = CliRunner().invoke(app, words)
    assert isinstance(refused.exception, InputError)
    source.write_text(plain + "[emulator]\n" + "\n".join(lines) + "\n")
    done = CliRunner().invoke(
        app, [*words, "--baseline", "1", "60", "--json", "-o", str(tmp_path / "design")]
    )
    assert done.exit_code == 0, done.output
    record = load(tmp_path / "design")
    assert record.design.period == record.rig.sampling.period == 0.002
    printed = json.loads(done.stdout)["emulated"]
    problem = build_problem(record.rig)
    again = emulated_row(problem, record.design)
    assert again is not None
    assert again.as_dict()["itae"] == printed["itae"]


def test_it_beats_the_paper_s_gains_and_those_tuned_without_the_effects() -> None:
    rig, paper = load_rig("belmonte2021"), PoleSpec.double(*PAPER_POLES)
    nominal = PoleSpec.double(1.137, 107.3)
    problem = build_problem(rig, scenarios="emulated")
    allowed = sensitivity_peaks(problem, paper)[0]
    found = solve(build_problem(rig, scenarios="emulated", max_ms=allowed), None, paper)
    assert isinstance(found, TuneResult)
    assert found.figures.feasible
    assert found.figures.ms <= allowed
    assert found.figures.spectral_radius_one_more_sample < 1
    seeds = range(5000, 5020)
    rows = [
        emulations(problem, problem.rig, design_at(problem, poles), seeds)
        for poles in (found.poles, paper, nominal)
    ]
    assert all(row.worst.lost == 0 for row in rows)
    for part in ("nominal", "worst"):
        own, *others = (getattr(row, part).itae.median for row in rows)
        assert own < min(others), part


def test_what_robustness_costs_is_told() -> None:
    rig, paper = load_rig("belmonte2021"), PoleSpec.double(*PAPER_POLES)
    found = solve(build_problem(rig, scenarios="emulated"), None, paper)
    assert isinstance(found, TuneResult)
    assert found.emulated is not None
    less = found.emulated.relaxed
    assert less is not None
    assert found.figures.ms <= 2.0 < less.ms <= less.max_ms
    assert less.emulations.worst.itae.median < found.emulated.tuned.worst.itae.median
