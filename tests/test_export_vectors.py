from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from types import MappingProxyType

import pytest
from rigs import SHORT, rig_with

from maglev_design.controller.design import plant_beta
from maglev_design.errors import InputError, VerificationError
from maglev_design.exporting.controller import ExportedController, controller_of
from maglev_design.exporting.vectors import HELD, OK, TRIPPED, record_vectors, short_path
from maglev_design.record import DesignRecord
from maglev_design.rig import Rig
from maglev_design.simulation import loop_for, nominal_scenario, simulate


@pytest.fixture(scope="module")
def controller(tuned_record: DesignRecord) -> ExportedController:
    return controller_of(tuned_record, "maglev")


@pytest.fixture(scope="module")
def lines(controller: ExportedController) -> list[list[str]]:
    text, rows = record_vectors(controller)
    found = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    assert rows == sum(words[0] == "step" for words in found)
    return found


def steps(lines: list[list[str]]) -> list[list[float]]:
    return [[float(x) for x in words[1:]] for words in lines if words[0] == "step"]


def test_the_first_rows_are_the_simulation_to_the_last_bit(
    tuned_record: DesignRecord, lines: list[list[str]]
) -> None:
    rig, design = tuned_record.rig, tuned_record.design
    scenario = nominal_scenario(rig, plant_beta(rig))
    response = simulate(loop_for(rig, design), design, scenario)
    rows = steps(lines)[: len(response.commanded)]
    assert [row[0] for row in rows] == response.gap[:-1].tolist()
    assert [row[1] for row in rows] == response.reference[:-1].tolist()
    assert [row[3] for row in rows] == response.commanded.tolist()
    assert [row[4] for row in rows] == response.applied.tolist()


def test_the_vectors_saturate_at_both_ends_reset_move_start_bumpless_and_fail(
    controller: ExportedController, lines: list[list[str]]
) -> None:
    n = controller.numbers
    rows = steps(lines)
    assert any(row[3] > n["u_max"] and row[4] == n["u_max"] for row in rows)
    assert any(row[3] < n["u_min"] and row[4] == n["u_min"] for row in rows)
    assert {row[5] for row in rows} == {OK, HELD, TRIPPED}
    assert len({row[1] for row in rows if math.isfinite(row[1])}) > 100
    words = Counter(words[0] for words in lines)
    assert words["reset"] >= 4
    assert words["bumpless"] == words["path"] == 1
    assert all(n["u_min"] <= row[4] <= n["u_max"] for row in rows)


def test_after_a_bumpless_start_the_first_command_is_the_voltage_asked_for(
    lines: list[list[str]],
) -> None:
    at = next(k for k, words in enumerate(lines) if words[0] == "bumpless")
    assert float(lines[at + 1][4]) == pytest.approx(float(lines[at][1]), rel=1e-9)


def test_the_vectors_are_the_same_every_time(controller: ExportedController) -> None:
    assert record_vectors(controller) == record_vectors(controller)


def test_a_law_that_is_not_the_simulated_one_is_noticed(controller: ExportedController) -> None:
    changed = [
        replace(c, value=math.nextafter(c.value, math.inf)) if c.name == "d" else c
        for c in controller.law_constants
    ]
    with pytest.raises(VerificationError, match="the last bit"):
        record_vectors(replace(controller, law_constants=tuple(changed)))


def test_a_move_that_starts_late_is_brought_forward(paper_rig: Rig) -> None:
    data = paper_rig.reference.model_copy(
        update={"start_time": 50.0, "end_time": 55.0, "horizon": 56.0}
    )
    path = short_path(paper_rig.model_copy(update={"reference": data})).reference
    assert (path.start_time, path.end_time, path.horizon) == (2.0, 7.0, 8.0)
    assert short_path(paper_rig) is paper_rig


def test_a_voltage_range_without_an_upper_end_is_refused(tuned_record: DesignRecord) -> None:
    rig = rig_with(SHORT, {"limits.voltage": [0.0, math.inf]})
    with pytest.raises(InputError, match=r"limits\.voltage"):
        controller_of(replace(tuned_record, rig=rig), "maglev")


def test_a_lag_that_could_run_away_is_refused(tuned_record: DesignRecord) -> None:
    design = tuned_record.design
    wild = replace(design, coefficients=MappingProxyType({**design.coefficients, "a22": -1.2}))
    with pytest.raises(InputError, match="--method tustin"):
        controller_of(replace(tuned_record, design=wild), "maglev")
