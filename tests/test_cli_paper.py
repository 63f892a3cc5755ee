"""``compare``, ``claims`` and ``simulate --controller`` as a user types them."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest
from test_cli import METRICS, contents, document, rig_file, run
from typer.testing import CliRunner

from maglev_design.cli import app
from maglev_design.errors import InputError
from maglev_design.paper.ledger import chosen, statements

pytestmark = pytest.mark.xdist_group("paper on the command line")

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
VERDICTS = {"verified", "corrected", "contradicted", "not-checkable"}


def here(*arguments: str) -> dict[str, Any]:
    """Run a command in this process, where the derivation is done once; return its JSON."""
    done = CliRunner().invoke(app, [*arguments, "--json"], catch_exceptions=False)
    assert done.exit_code == 0
    return dict(json.loads(done.stdout))


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
        assert (folder / f"{name}.png").stat().st_size > 1000
        assert (folder / f"{name}.svg").stat().st_size > 1000
        assert f"({name}.png)" in page
    assert "</script>" not in page.replace("\\</script\\>", "")
    assert str(folder) not in page
    assert "maglev-design compare --rig quick.toml --seeds 2 --json" in page


def test_compare_gives_the_same_bytes_again(tmp_path: Path) -> None:
    rig = emulated_rig(tmp_path)
    quick = ("--no-survey", "--no-tuned", "--no-variants", "--seeds", "2")
    for name in ("one", "two"):
        run("compare", "--rig", rig, *quick, "-o", str(tmp_path / name))
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


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


# --- claims --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("claims")
    out = folder / "out"
    rig = rig_file(folder, period=0.001)
    done = run("claims", "--rig", rig, "--rigs", "2", "-o", str(out), "--json")
    return out, document(done)


def test_claims_have_what_the_contract_promises(judged: tuple[Path, dict[str, Any]]) -> None:
    _, found = judged
    identities = [claim["id"] for claim in found["claims"]]
    assert len(set(identities)) == len(identities)
    equations = [f"eq-{n}" for n in range(1, 30)] + [f"eq-A{n}" for n in range(1, 8)]
    assert identities[: len(equations)] == equations
    for claim in found["claims"]:
        assert claim["verdict"] in VERDICTS
        assert bool(claim["correction"]) == (claim["verdict"] == "corrected"), claim["id"]
        assert claim["statement"]
        assert claim["evidence"]
    assert {claim["verdict"] for claim in found["claims"]} == VERDICTS


def test_every_command_of_the_evidence_is_one_of_ours(
    judged: tuple[Path, dict[str, Any]],
) -> None:
    verbs = set()
    for claim in judged[1]["claims"]:
        program, verb, *_ = claim["command"].split()
        assert program == "maglev-design"
        verbs.add(verb)
    for verb in verbs:
        assert CliRunner().invoke(app, [verb, "--help"]).exit_code == 0


def test_the_ledger_is_written_for_people(judged: tuple[Path, dict[str, Any]]) -> None:
    folder, found = judged
    page = (folder / "claims.md").read_text("utf-8")
    assert sorted(path.name for path in folder.iterdir()) == [
        ".maglev-design",
        "claims.json",
        "claims.md",
    ]
    assert page.count("\n### ") == len(found["claims"])
    assert "</script>" not in page.replace("\\</script\\>", "")


def test_a_claim_is_chosen_by_its_id_or_by_the_start_of_it() -> None:
    assert [said.id for said in chosen("eq-2")] == ["eq-2"]
    assert [said.id for said in chosen("4.3")] == [
        "4.3-pid", "4.3-fee", "4.3-fee-start", "4.3-pid-tracks",
    ]  # fmt: skip
    assert chosen(None) == tuple(statements().values())


@pytest.mark.parametrize(
    ("only", "near"), [("20", "'eq-20'"), ("eq-A77", "'eq-A7'"), ("4.2-bset", "'4.1-best'")]
)
def test_an_unknown_id_is_refused_before_anything_is_computed(
    only: str, near: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("maglev_design.cli.claims_verb.load_rig", lambda _: pytest.fail("computed"))
    message = refused("claims", "--only", only)
    assert f"only = {only!r}" in message
    assert near in message


def test_the_claims_are_listed_at_once() -> None:
    done = run("claims", "--list")
    lines = done.stdout.splitlines()
    assert lines[::2] == list(statements())
    assert lines[1::2] == [f"  {said.statement}" for said in statements().values()]
    listed = here("claims", "--list", "--only", "eq-A")["claims"]
    assert [said["id"] for said in listed] == [f"eq-A{n}" for n in range(1, 8)]
    assert "--list judges nothing" in refused("claims", "--list", "-o", "folder")


def test_an_equation_is_shown_without_waiting_for_the_simulations(tmp_path: Path) -> None:
    found = here("claims", "--rig", rig_file(tmp_path), "--only", "eq-24")
    (claim,) = found["claims"]
    assert (claim["id"], claim["verdict"]) == ("eq-24", "corrected")
