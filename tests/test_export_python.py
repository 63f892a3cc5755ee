from __future__ import annotations

import ast
import json
import math
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from exported import run

from maglev_design.controller.design import plant_beta, reference_path
from maglev_design.exporting import export_folder
from maglev_design.record import DesignRecord
from maglev_design.simulation import loop_for, nominal_scenario, simulate

SAME_GAP, SAME_VOLTAGE = 1e-9, 1e-5
"""[m, V] Two Runge-Kutta steps a period against one; the law's gain is some 1e4 V/m."""


@pytest.fixture(scope="module")
def folder(tuned_record: DesignRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("python")
    export_folder(tuned_record, "python", place, prefix="lev", allow_unverified=True)
    return place


@pytest.fixture(scope="module")
def lev(folder: Path) -> Any:
    module = ModuleType("lev")
    exec(compile((folder / "lev.py").read_text("ascii"), "lev.py", "exec"), module.__dict__)  # noqa: S102
    return module


def test_it_needs_nothing_but_the_standard_library(folder: Path) -> None:
    tree = ast.parse((folder / "lev.py").read_text("ascii"))
    imported = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    imported |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    assert imported == {"__future__", "enum", "typing"}


def test_its_types_are_complete(folder: Path) -> None:
    pytest.importorskip("mypy", reason="mypy is not installed (.ci/run installs it)")
    files = ("lev.py", "check.py", "example.py")
    run(folder, sys.executable, "-m", "mypy", "--strict", "--cache-dir", "/dev/null", *files)


def test_its_own_check_agrees_and_the_example_holds_the_ball(folder: Path) -> None:
    words = run(folder, sys.executable, "-B", "check.py").stdout.split()
    assert int(words[1]) > 1000
    assert words[3] == "0"
    last = run(folder, sys.executable, "-B", "example.py").stdout.splitlines()[-1]
    assert last.startswith("ball held")


def test_its_own_check_notices_a_change(folder: Path, tmp_path: Path) -> None:
    for path in folder.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    source = (folder / "lev.py").read_text("ascii")
    assert "HOLD_SAMPLES: Final = " in source
    (tmp_path / "lev.py").write_text(
        source.replace("HOLD_SAMPLES: Final = ", "HOLD_SAMPLES: Final = 1"), "ascii"
    )
    run(tmp_path, sys.executable, "-B", "check.py", code=1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, -1.0, 0.0, 1.0, 1e308])
def test_a_bad_measurement_holds_the_voltage_and_leaves_the_state(lev: Any, bad: float) -> None:
    controller, twin = lev.Controller(), lev.Controller()
    for k in range(10):
        sample = (0.0242 + 1e-5 * k, 0.0242, 0.0)
        held = controller.step(*sample)
        assert twin.step(*sample) == held
    assert controller.step(bad, 0.0242) == held
    assert controller.status is lev.Status.HELD
    assert controller.step(0.0242, 0.0242) == twin.step(0.0242, 0.0242)
    assert controller.status is lev.Status.OK


def test_a_sensor_that_stays_dead_switches_the_coil_off_until_a_reset(lev: Any) -> None:
    controller = lev.Controller()
    held = controller.step(0.0242, 0.0242)
    assert held > lev.u_min
    answers = [controller.step(math.nan, 0.0242) for _ in range(lev.HOLD_SAMPLES + 1)]
    assert answers == [held] * lev.HOLD_SAMPLES + [lev.u_min]
    assert controller.step(0.0242, 0.0242) == lev.u_min
    assert controller.status is lev.Status.TRIPPED
    controller.reset()
    assert controller.step(0.0242, 0.0242) == held


def test_before_the_first_good_sample_the_coil_is_off(lev: Any) -> None:
    assert lev.Controller().step(math.nan, 0.0242) == lev.u_min


def test_a_bumpless_start_commands_the_voltage_that_is_on_the_coil(lev: Any) -> None:
    controller = lev.Controller()
    assert controller.start_bumpless(2.0, 0.0241, 0.0242, 0.1)
    assert controller.step(0.0241, 0.0242, 0.1) == pytest.approx(2.0, rel=1e-12)
    assert not controller.start_bumpless(math.nan, 0.0241, 0.0242)
    assert not controller.start_bumpless(99.0, 0.0241, 0.0242)
    assert not controller.start_bumpless(2.0, math.nan, 0.0242)
    assert controller.voltage == lev.u_min


def test_the_reference_generator_is_the_rigs_path(lev: Any, tuned_record: DesignRecord) -> None:
    path = tuned_record.rig.reference
    generator = lev.Reference(path.start_gap)
    assert generator.retarget(path.end_gap, path.start_time, path.end_time)
    rows = np.array([generator.step() for _ in range(400)])
    times = np.arange(400, dtype=float) * tuned_record.rig.sampling.period
    assert (reference_path(tuned_record.rig, times) == rows.T).all()


def test_the_reference_generator_refuses_what_cannot_be(lev: Any) -> None:
    with pytest.raises(ValueError, match="must be in"):
        lev.Reference(math.nan)
    generator = lev.Reference(0.0242)
    for gap, start, end in (
        (math.nan, 0.0, 1.0),
        (1.0, 0.0, 1.0),
        (0.02, -1.0, 1.0),
        (0.02, 1.0, 1.0),
        (0.02, 0.0, math.inf),
        (0.02, 0.0, 0.01),
    ):
        assert not generator.retarget(gap, start, end)
    assert generator.retarget(0.02, 0.0, 1.0)
    generator.step()
    assert generator.at_rest is False
    assert not generator.retarget(0.03, 0.0, 1.0)
    for _ in range(1100):
        point = generator.step()
    assert point.gap == 0.02
    assert generator.retarget(0.0242, 0.0, 1.0)


def test_python_control_runs_the_same_loop(folder: Path, tuned_record: DesignRecord) -> None:
    text = (
        "import json, warnings; warnings.simplefilter('error'); import control_example as e; "
        "times, gaps, voltages = e.run(); c = e.controller_system(); "
        "print(json.dumps([gaps.tolist(), voltages.tolist(), c.dt, e.closed_loop().dt]))"
    )
    printed = run(folder, sys.executable, "-B", "-c", text).stdout
    gaps, voltages, own, whole = json.loads(printed)
    rig, design = tuned_record.rig, tuned_record.design
    assert own == whole == rig.sampling.period
    scenario = nominal_scenario(rig, plant_beta(rig))
    expected = simulate(loop_for(rig, design), design, scenario)
    np.testing.assert_allclose(gaps, expected.gap[:-1], rtol=0, atol=SAME_GAP)
    np.testing.assert_allclose(voltages, expected.applied, rtol=0, atol=SAME_VOLTAGE)
