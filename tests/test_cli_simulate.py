"""What ``simulate`` runs, and that it says so."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from records import document_of
from rigs import OFFSET, SHORT, changed, rig_with
from typer.testing import CliRunner

from maglev_design.cli import app
from maglev_design.cli.commands.simulate import SimulateOptions
from maglev_design.cli.simulate_setup import SimulationSetup, set_up
from maglev_design.controller.design import Design, PoleSpec, make_design, plant_beta
from maglev_design.errors import InputError
from maglev_design.files import finite
from maglev_design.options import Equilibrium
from maglev_design.record import document_bytes
from maglev_design.rig import Rig
from maglev_design.simulation import loop_for, simulate

EMULATED = {"emulator.period": 0.002, "emulator.sensor_step": 1e-6, "emulator.delay": 0.0005}
VOLTAGE = 2.2
"""[V] Not the sqrt(g/beta) Y = 2.0825 V that K, C and m promise."""


def saved(folder: Path, rig: Rig, equilibrium: Equilibrium = "model") -> tuple[Path, Design]:
    design = make_design(rig, PoleSpec((0.9, 60.0), (1.1, 65.0)), equilibrium=equilibrium)
    path = folder / "design.json"
    path.write_bytes(document_bytes(finite(document_of(rig, design))))
    return path, design


def toml(folder: Path, data: dict[str, Any]) -> str:
    path = folder / "other.toml"
    lines = [f"name = {json.dumps('another rig')}"]
    for section, values in data.items():
        lines += [f"[{section}]", *[f"{name} = {json.dumps(x)}" for name, x in values.items()]]
    path.write_text("\n".join(lines), "utf-8")
    return str(path)


def answer(*arguments: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, ["simulate", *arguments])
    if code == 0:
        assert done.exit_code == 0, done.output
        return done.stdout
    assert isinstance(done.exception, InputError)
    assert done.exception.exit_code == code
    return str(done.exception)


# --- a saved design ------------------------------------------------------------------------


@pytest.mark.parametrize("equilibrium", ["model", "measured"])
@pytest.mark.parametrize("ratio", [1.0, 0.9, 1.15])
def test_a_saved_controller_keeps_its_numbers_and_the_plant_moves(
    tmp_path: Path, equilibrium: Equilibrium, ratio: float
) -> None:
    rig = rig_with(SHORT, {"operating_point.voltage": VOLTAGE})
    path, design = saved(tmp_path, rig, equilibrium)
    run = set_up(SimulateOptions(design=path, beta_ratio=ratio))
    assert run.design == design
    assert run.design.sha256 == design.sha256
    assert run.rig == rig
    assert run.scenario.beta_plant == pytest.approx(design.believed.beta / ratio, rel=1e-12)
    if equilibrium == "measured":
        beta = rig.plant.gravity * rig.operating_point.gap**2 / VOLTAGE**2
        assert run.scenario.beta_plant == pytest.approx(beta / ratio, rel=1e-12)
    assert set_up(SimulateOptions(design=path, test="mismatch")).ratio == pytest.approx(1.15)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"zeta": 1.0}, ("--zeta 1.0", "zeta 0.9 and 1.1")),
        ({"zeta": 0.9}, ("--zeta 0.9",)),
        ({"omega_n": 60.0}, ("--omega-n 60.0", "omega_n 60 and 65 rad/s")),
        ({"equilibrium": "measured"}, ("--equilibrium measured", "reading model")),
        ({"method": "zoh"}, ("--method zoh", "method tustin")),
        ({"controller": "fee-gpi"}, ("--controller fee-gpi", "TAN-GPI")),
        ({"filter": 5.0}, ("--filter 5.0",)),
        ({"rig": "belmonte2021"}, ("--rig", "--plant belmonte2021")),
        ({"plant": "quanser-maglev", "beta_ratio": 0.9}, ("--plant", "--beta-ratio")),
        ({"plant": "quanser-maglev", "test": "mismatch"}, ("--plant", "mismatch")),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, dict) else "",
)
def test_what_would_change_a_saved_controller_is_refused_with_the_remedy(
    tmp_path: Path, options: dict[str, Any], words: tuple[str, ...]
) -> None:
    path, _ = saved(tmp_path, rig_with(SHORT))
    with pytest.raises(InputError) as error:
        set_up(SimulateOptions(design=path, **options))
    for word in (*words, "leave" if "rig" not in options else "--plant"):
        assert word in str(error.value)


def test_options_that_say_what_the_saved_controller_is_are_no_contradiction(
    tmp_path: Path,
) -> None:
    path, design = saved(tmp_path, rig_with(SHORT))
    same: dict[str, Any] = {"equilibrium": "model", "method": "tustin", "filter": 10.0}
    same["controller"] = "tan-gpi"
    run = set_up(SimulateOptions(design=path, sample_time=0.001, **same))
    assert run.design == design
    assert not run.rediscretised


def test_another_period_makes_another_controller_and_says_so(tmp_path: Path) -> None:
    path, design = saved(tmp_path, rig_with(SHORT))
    run = set_up(SimulateOptions(design=path, sample_time=0.0005))
    assert run.rediscretised
    assert "rediscretised: another controller" in str(run)
    assert run.design.period == run.rig.sampling.period == 0.0005
    assert run.design.gains == design.gains
    assert run.design.believed == design.believed
    assert run.design.sha256 != design.sha256
    again = make_design(rig_with(SHORT, {"sampling.period": 0.0005}), design.poles)
    assert run.design.coefficients == pytest.approx(again.coefficients, rel=1e-12)

    continuous = set_up(SimulateOptions(design=path, sample_time=0.0))
    assert continuous.design == design
    assert "continuous" in str(continuous)
    assert not continuous.rediscretised
    assert continuous.as_dict()["controller_sha256"] is None


def test_an_emulated_design_runs_at_its_own_period_unless_SimulateOptions(tmp_path: Path) -> None:
    rig = rig_with(SHORT, EMULATED)
    path, design = saved(tmp_path, rig)
    run = set_up(SimulateOptions(design=path, emulate=True))
    assert run.design == design
    assert run.rig.sampling.period == design.period == 0.001
    assert run.rig.sampling.delay == 0.0005
    assert run.emulate
    assert not run.rediscretised
    assert "emulated plant" in str(run)
    other = set_up(SimulateOptions(design=path, emulate=True, sample_time=0.002))
    assert other.rediscretised
    assert other.rig.sampling.period == 0.002
    # without a design the emulator's period is the controller's, as in the paper's sec. 5
    source = toml(tmp_path, changed(SHORT, EMULATED))
    assert set_up(SimulateOptions(rig=source, emulate=True)).rig.sampling.period == 0.002


def test_a_saved_controller_meets_another_plant_with_its_own_numbers(tmp_path: Path) -> None:
    own = rig_with(SHORT)
    path, design = saved(tmp_path, own)
    changes = {
        "plant.mass": 0.021,
        "plant.gap_offset": 0.0005,
        "plant.current_gain": 1.08,
        "operating_point.gap": 0.02,
        "sampling.period": 0.004,
        "limits.voltage": [0.0, 12.0],
        "limits.gap": [0.002, 0.04],
        "initial.gap": 0.0245,
        "reference.end_gap": 0.021,
        "noise.position": 3e-6,
    }
    other = rig_with(SHORT, changes)
    run = set_up(SimulateOptions(design=path, plant=toml(tmp_path, changed(SHORT, changes))))
    assert run.design == design
    assert run.scenario.beta_plant == plant_beta(other)
    assert run.ratio == pytest.approx(plant_beta(own) / plant_beta(other))
    assert run.rig.plant == other.plant
    assert run.rig.noise == other.noise
    assert run.rig.limits.gap == other.limits.gap
    assert run.scenario.initial_gap == 0.0245
    for section in ("operating_point", "reference", "sampling"):
        assert getattr(run.rig, section) == getattr(own, section)
    assert run.rig.limits.voltage == own.limits.voltage
    assert "another rig" in str(run)
    simulate(loop_for(run.rig, run.design), run.design, run.scenario)


def test_another_plant_whose_gaps_the_path_leaves_is_refused_and_named(tmp_path: Path) -> None:
    path, _ = saved(tmp_path, rig_with(SHORT))
    other = toml(tmp_path, OFFSET | {"limits": {"voltage": [0.0, 24.0], "gap": [0.0005, 0.02]}})
    with pytest.raises(InputError, match=r"--plant.*other.toml: operating_point.gap"):
        set_up(SimulateOptions(design=path, plant=other))


def test_gains_that_no_poles_placed_are_shown_as_gains(tmp_path: Path) -> None:
    _, design = saved(tmp_path, rig_with(SHORT))
    own = replace(design, gains=(2e7, 1.3e6, 28000.0, 270.0))
    run = set_up(SimulateOptions(rig="belmonte2021"))
    assert "gains k0 = 2e+07, k1 = 1.3e+06, k2 = 28000, k3 = 270" in str(replace(run, design=own))


# --- without a design ----------------------------------------------------------------------


def test_without_a_design_beta_c_moves_and_the_plant_stays() -> None:
    run = set_up(SimulateOptions(beta_ratio=1.15, zeta=0.9))
    assert run.scenario.beta_plant == plant_beta(run.rig)
    assert run.design.believed.beta == pytest.approx(1.15 * plant_beta(run.rig))
    with pytest.raises(InputError, match=r"--plant.*--design.*--rig quanser-maglev"):
        set_up(SimulateOptions(plant="quanser-maglev"))


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (
            {},
            "TAN-GPI (20), zeta 1, omega_n 70 rad/s (the paper's default), Tustin at 1 ms, reading "
            "model, beta_c/beta = 1 (the plant stays, the controller's beta_c moves, as in the "
            "paper's test 3), plant: Feedback 33-210 (Belmonte et al. 2021)",
        ),
        (
            {"controller": "lin-pid", "filter": 5.0, "zeta": 0.9, "beta_ratio": 0.9},
            "LIN-PID, filter at 5 times the pole, zeta 0.9, omega_n 70 rad/s, real pole -70 rad/s, "
            "Tustin at 1 ms, reading model, beta_c/beta = 0.9 (",
        ),
        ({"sample_time": 0.0, "omega_n": 50.0}, "omega_n 50 rad/s, continuous, reading model"),
        ({"method": "euler", "sample_time": 0.002}, "forward Euler at 2 ms"),
    ],
    ids=["default", "pid", "continuous", "euler"],
)
def test_one_line_says_what_ran(options: dict[str, Any], line: str) -> None:
    assert line in str(set_up(SimulateOptions(**options)))


@pytest.mark.parametrize(
    ("ratio", "word"),
    [
        (115.0, "is it per cent? 115 % is 1.15"),
        (85.0, "85 % is 0.85"),
        (-1.0, "0.01 to 20"),
        (0.0, "0.01 to 20"),
        (math.nan, "0.01 to 20"),
        (math.inf, "0.01 to 20"),
    ],
)
@pytest.mark.parametrize("design", [False, True])
def test_a_ratio_that_no_plant_has_is_named(
    tmp_path: Path, ratio: float, word: str, design: bool
) -> None:
    own = saved(tmp_path, rig_with(SHORT))[0] if design else None
    with pytest.raises(InputError) as error:
        set_up(SimulateOptions(beta_ratio=ratio, design=own))
    assert f"beta-ratio = {ratio!r} [-]" in str(error.value)
    assert word in str(error.value)
    assert ("per cent" in str(error.value)) == (ratio > 10)


# --- through the command line --------------------------------------------------------------


def test_what_ran_is_told_first_and_in_the_document(tmp_path: Path) -> None:
    path, design = saved(tmp_path, rig_with(SHORT, EMULATED))
    arguments = ("--design", str(path), "--beta-ratio", "0.9")
    first = answer(*arguments).splitlines()[0]
    assert "zeta 0.9 and 1.1" in first
    assert "beta_c/beta = 0.9 (the plant moves, the controller stays)" in first
    found = json.loads(answer(*arguments, "--json"))
    assert found["ran"] == first
    assert found["controller_sha256"] == design.sha256
    assert found["rediscretised"] is False
    assert found["relative_error_estimates"] is None
    assert found["relative_error_bounds"]["itae"] < 1e-6
    other = json.loads(answer(*arguments, "--sample-time", "0.0005", "--emulate", "--json"))
    assert other["rediscretised"] is True
    assert other["emulated"] is True
    assert other["relative_error_bounds"] is None, "the sensor rounds"
    assert other["controller_sha256"] != design.sha256


def test_the_table_says_whether_the_error_is_a_bound(tmp_path: Path) -> None:
    source = toml(tmp_path, changed(SHORT, {"initial.gap": 0.017}))
    assert "relative error, a bound" in answer("--rig", source)
    assert "relative error, an estimate" in answer("--rig", source, "--sample-time", "0")


@pytest.mark.parametrize("option", ["--rig", "--plant", "--controller", "--test"])
def test_a_replay_takes_nothing_else(tmp_path: Path, option: str) -> None:
    value = {"--controller": "lin-pid", "--test": "noise"}.get(option, "belmonte2021")
    text = answer("--replay", str(tmp_path / "sweep.json:1"), option, value, code=2)
    assert option in text
    assert "replay" in text


def test_a_run_names_its_law_for_every_controller() -> None:
    for name in ("tan-gpi", "fee-gpi", "lin-pid", "state-feedback"):
        run = set_up(SimulateOptions(controller=name))
        assert isinstance(run, SimulationSetup)
        assert run.as_dict()["controller"] == name
        assert len(run.as_dict()["gains"]) == len(run.design.gains)
