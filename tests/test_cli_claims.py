"""``claims`` as a user types it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from test_cli import rig_file, run
from test_cli_paper import here, refused
from typer.testing import CliRunner

from maglev_design.cli import app
from maglev_design.paper import claims
from maglev_design.paper.ledger import Claim, Statement, chosen, statements
from maglev_design.rig import Rig

VERDICTS = {"verified", "corrected", "contradicted", "not-checkable"}


@pytest.fixture(scope="module")
def judged(
    tmp_path_factory: pytest.TempPathFactory, paper_rig: Rig, paper_claims: tuple[Claim, ...]
) -> tuple[Path, dict[str, Any]]:
    """The ledger of the paper's rig, as it was judged for all tests."""
    out = tmp_path_factory.mktemp("claims") / "out"

    def known(wanted: Sequence[Statement], grounds: claims.Grounds) -> list[Claim]:
        assert (grounds.rig, grounds.rigs, grounds.seed) == (paper_rig, 6, 17)
        by_id = {claim.id: claim for claim in paper_claims}
        return [by_id[said.id] for said in wanted]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(claims, "judged", known)
        found = here("claims", "--rigs", "6", "--seed", "17", "-o", str(out))
    assert next(iter(found)) == "schema_version"
    assert found["schema_version"] == 1
    return out, found


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


def test_the_ledger_of_another_rig_is_judged_from_end_to_end(
    tmp_path: Path, paper_claims: tuple[Claim, ...]
) -> None:
    out = tmp_path / "out"
    found = here("claims", "--rig", rig_file(tmp_path), "--rigs", "2", "-o", str(out))
    assert list(found) == ["schema_version", "rig", "rigs", "seed", "claims"]
    assert (found["schema_version"], found["rigs"], found["seed"]) == (1, 2, 0)
    assert found["rig"]["sampling"]["period"] == 0.002
    assert [claim["id"] for claim in found["claims"]] == list(statements())
    assert {tuple(claim) for claim in found["claims"]} == {tuple(x.name for x in fields(Claim))}
    counts = Counter(claim["verdict"] for claim in found["claims"])
    assert set(counts) == VERDICTS
    assert counts.total() == len(statements())
    told = re.search(
        r"^(\d+) claims: (.*)\.$", (out / "claims.md").read_text("utf-8"), re.MULTILINE
    )
    assert told is not None
    assert int(told[1]) == counts.total()
    assert dict(one.split()[::-1] for one in told[2].split(", ")) == {
        verdict: str(count) for verdict, count in counts.items()
    }
    # What the paper's equations are does not depend on the rig.
    verdicts = {claim["id"]: claim["verdict"] for claim in found["claims"]}
    for claim in paper_claims:
        if claim.id.startswith("eq-"):
            assert verdicts[claim.id] == claim.verdict, claim.id


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
