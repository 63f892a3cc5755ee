"""``compare`` and ``simulate --controller`` as a user types them."""

from __future__ import annotations

import itertools
import json
import sys
from pathlib import Path
from typing import Any

import pytest
from test_cli import METRICS, contents, document, rig_file, run
from typer.testing import CliRunner

from maglev_design.cli import app
from maglev_design.errors import InputError

EMULATOR = """
[emulator]
inductance = 0.01
resistance = 20.0
sensor_step = 1e-5
actuator_step = 1e-3
period = 0.002
delay = 0.0005
position_noise = 1e-6
"""


def here(*arguments: str) -> dict[str, Any]:
    """Run a command in this process, where the derivation is done once; return its JSON."""
    done = CliRunner().invoke(app, [*arguments, "--json"], catch_exceptions=False)
    assert done.exit_code == 0
    return dict(json.loads(done.stdout, parse_constant=pytest.fail))


def refused(*arguments: str) -> str:
    """Return the message with which a command in this process refuses its input."""
    done = CliRunner().invoke(app, list(arguments))
    assert isinstance(done.exception, InputError) or done.exit_code == 2
    return str(done.exception) if isinstance(done.exception, InputError) else done.stderr


def emulated_rig(folder: Path) -> str:
    path = Path(rig_file(folder, period=0.001))
    path.write_text(path.read_text("utf-8") + EMULATOR, "utf-8")
    return str(path)


# --- simulate ------------------------------------------------------------------------------


@pytest.mark.parametrize("controller", ["tan-gpi", "fee-gpi", "lin-pid", "state-feedback"])
def test_every_controller_is_simulated(tmp_path: Path, controller: str) -> None:
    rig = rig_file(tmp_path)
    for sample_time in ("0", "0.002"):
        found = here(
            "simulate", "--rig", rig, "--controller", controller, "--sample-time", sample_time
        )
        assert set(found) >= METRICS
        assert found["controller"] == controller
        assert not found["crashed"]


def test_the_options_of_the_pid_change_the_run(tmp_path: Path) -> None:
    rig = rig_file(tmp_path)
    choices = [
        [],
        ["--feedforward", "static"],
        ["--derivative", "measurement"],
        ["--start", "bumpless"],
        ["--filter", "5"],
    ]
    found = [here("simulate", "--rig", rig, "--controller", "lin-pid", *extra) for extra in choices]
    assert found[0]["variant"] == "default"
    for one, other in itertools.combinations(found, 2):
        assert one["itae"] != other["itae"]
        assert one["variant"] != other["variant"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--controller", "fee-gpi", "--filter", "5"], ["--filter", "lin-pid", "fee-gpi"]),
        (["--controller", "lin-pid", "--filter", "0"], ["filter", "greater than 0"]),
        (["--controller", "lin-pid", "--filter", "nan"], ["filter", "finite"]),
        (["--emulate"], ["emulator", "inductance", "[H]"]),
    ],
)
def test_bad_options_are_named(tmp_path: Path, arguments: list[str], words: list[str]) -> None:
    message = refused("simulate", "--rig", rig_file(tmp_path), *arguments)
    for word in words:
        assert word in message


def test_the_emulated_rig_is_simulated(tmp_path: Path) -> None:
    rig = emulated_rig(tmp_path)
    plain = here("simulate", "--rig", rig)
    found = here("simulate", "--rig", rig, "--emulate")
    assert found["emulated"]
    assert not plain["emulated"]
    assert found["sample_time"] == 0.002
    assert found["itae"] != plain["itae"]
    assert "sampled" in refused("simulate", "--rig", rig, "--emulate", "--sample-time", "0")


# --- compare -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("compare")
    rig = emulated_rig(folder)
    out = folder / "out"
    done = run("compare", "--rig", rig, "--seeds", "2", "-o", str(out), "--json")
    return out, document(done)


def test_compare_has_what_the_contract_promises(compared: tuple[Path, dict[str, Any]]) -> None:
    _, found = compared
    for result in found["results"]:
        assert {"test", "controller", "variant", "ise", "iae", "itae"} <= set(result)
        assert bool(result["spread"]) == (result["test"] != "nominal")
    tests = [test["name"] for test in found["tests"]]
    assert tests == ["nominal", "noise", "mismatch", "emulator"]
    for test in tests:
        names = [r["controller"] for r in found["results"] if r["test"] == test]
        assert names[:4] == ["tan-gpi", "lin-pid", "fee-gpi", "tan-gpi"]
        first = next(r for r in found["results"] if r["test"] == test and r["label"] == "LIN-PID")
        assert first["variant"] == "default"
    assert {o["outcome"] for o in found["orderings"]} <= {"always", "depends", "never"}


def test_compare_writes_a_page_with_every_figure(compared: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = compared
    page = (folder / "comparison.md").read_text("utf-8")
    for number in (*range(3, 13), 15, 16, 17, 18):
        name = f"figure_{number:02}"
        assert (folder / f"{name}.svg").stat().st_size > 1000
        assert f"({name}.svg)" in page
    assert "</script>" not in page.replace("\\</script\\>", "")
    assert str(folder) not in page
    assert "maglev-design compare --rig quick.toml --seeds 2 --json" in page


def test_compare_gives_the_same_bytes_again(
    compared: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Page, data and figures of all that is compared, in another process."""
    words = ("compare", "--rig", emulated_rig(tmp_path), "--seeds", "2")
    monkeypatch.setattr(sys, "argv", ["maglev-design", *words, "--json"])  # the page tells it
    assert here(*words, "-o", str(tmp_path / "two")) == compared[1]
    assert contents(tmp_path / "two") == contents(compared[0])


def test_compare_prints_tables_and_names_the_guesses(tmp_path: Path) -> None:
    done = run(
        "compare", "--rig", rig_file(tmp_path), "--no-survey", "--no-tuned", "--no-variants",
        "--method", "all", "--seeds", "1",
    )  # fmt: skip
    assert "LIN-PID* is a guess" in done.stdout
    for method in ("tustin", "euler", "zoh"):
        assert f"TAN-GPI, {method}" in done.stdout
    assert "…" not in done.stdout


def test_compare_takes_continuous_controllers_and_the_other_start(tmp_path: Path) -> None:
    rig = rig_file(tmp_path)
    quick = ("--no-survey", "--no-tuned", "--no-variants", "--seeds", "1")
    found = here("compare", "--rig", rig, "--sample-time", "0", *quick)
    assert {r["method"] for r in found["results"]} == {None}
    other = here("compare", "--rig", rig, "--opposite-error", *quick)
    same = here("compare", "--rig", rig, *quick)
    assert other["results"][0]["ise"] != same["results"][0]["ise"]


@pytest.mark.parametrize(
    "arguments", [["--position-noise", "-1"], ["--position-noise", "nan"], ["--seeds", "0"],
                  ["--sample-time", "-0.001"], ["--design", "no.json"]],
)  # fmt: skip
def test_compare_refuses_bad_input(tmp_path: Path, arguments: list[str]) -> None:
    assert refused("compare", "--rig", rig_file(tmp_path), "--no-survey", *arguments)
