from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from maglev_design.choices import EQUILIBRIA, SCHEMA_VERSION
from maglev_design.cli import app, certify_verb
from maglev_design.cli.certify_verb import Request
from maglev_design.errors import InputError

LOOP = {"ms", "mt", "gain", "gain_up", "gain_down", "phase_deg", "delay_s", "disk"}


def request(**changes: Any) -> Request:
    empty: dict[str, Any] = dict.fromkeys(
        ("design", "rig", "controller", "zeta", "omega_n", "equilibrium", "method")
    )
    return Request(**(empty | {"gap_range": None, "beta_error": None} | changes))


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    folder = tmp_path_factory.mktemp("certified")
    done = CliRunner().invoke(app, ["certify", "--json", "-o", str(folder)])
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout, parse_constant=pytest.fail)
    return printed, folder / certify_verb.RESULT


def test_the_document_keeps_the_contract(saved: tuple[dict[str, Any], Path]) -> None:
    document, path = saved
    assert document["schema_version"] == SCHEMA_VERSION
    rows = document["exact_interval"]
    assert [row["equilibrium"] for row in rows[:3]] == list(EQUILIBRIA)
    assert {row["gap"] for row in rows[:3]} == {0.0246}
    assert {tuple(row["gap"]) for row in rows[3:]} == {(0.012, 0.0246)}
    assert [row["upper_exact"] for row in rows[:3]] == ["8526400/829921", "5", None]
    assert rows[2]["upper"] is None
    assert rows[2]["stable"]
    assert set(document["margins"]) == LOOP == set(document["margins_continuous"])
    assert document["margins_continuous"]["gain_up"]["value"] is None  # infinite
    sampled = document["sampled"]
    assert sampled["spectral_radius"] < 1
    assert sampled["max_period_s"] == pytest.approx(7.35e-3, rel=1e-3)
    # the further delay that the worst corner survives is no more than what exact beta does
    assert document["margins"]["delay_s"]["value"] < sampled["max_delay_s"]
    assert path.read_text("utf-8") == json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def test_the_tables_name_the_condition_and_every_end(
    saved: tuple[dict[str, Any], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    document, _ = saved
    certify_verb._print(document)
    shown = capsys.readouterr().out
    for text in (
        "rho*(C_Y_hat + omega_n**2) > 0",
        "8526400/829921",
        "no end",
        "123/1000",
        "9.936844",
        "7.35133",
    ):
        assert text in shown


def own_choice(own: Any) -> tuple[Any, ...]:
    return own.equilibrium, own.method, own.controller


def test_both_loops_are_certified_and_the_region_contradicts_no_simulation(
    saved: tuple[dict[str, Any], Path],
) -> None:
    document, path = saved
    assert [row["loop"] for row in document["lmi"]] == ["continuous", "sampled"]
    for row in document["lmi"]:
        assert row["certified"]
        assert row["largest_beta_error"] > 0.15
        assert len(row["P"]) == len(row["states"]) == len(row["scaling"])
    region = document["region"]
    assert region["status"] == "guaranteed"
    assert region["reach"][0] < -4e-4
    assert region["reach"][1] > 4e-4
    assert region["contradictions"] == []
    assert 0 < region["share_of_simulated"] < 1
    written = {p.name for p in path.parent.iterdir()}
    assert {"certificate.json", "region.png", "region.svg"} <= written


def test_the_written_certificate_is_checked_and_a_changed_one_is_not_believed(
    saved: tuple[dict[str, Any], Path], tmp_path: Path
) -> None:
    path = saved[1].parent / "certificate.json"
    done = CliRunner().invoke(app, ["certify", "--check", str(path), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["passed"]
    changed = tmp_path / "certificate.json"
    changed.write_text(path.read_text("utf-8").replace('"23/20"', '"5/4"'), "utf-8")
    done = CliRunner().invoke(app, ["certify", "--check", str(changed)])
    assert done.exit_code == 4
    assert "NO" in done.stdout


def test_without_a_certificate_the_earlier_one_does_not_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "certificate.json"
    path.write_text("{}", "utf-8")
    assert certify_verb._proofs((), tmp_path) == ()
    assert not path.exists()


def test_a_reading_a_method_and_a_family_can_be_chosen() -> None:
    own, design = certify_verb._subject(
        request(
            zeta=1.2,
            equilibrium="measured",
            method="zoh",
            gap_range=(0.02, 0.03),
            beta_error=0.3,
            controller="fee-gpi",
        )
    )
    assert own.poles.values == (1.2, 70.0, 1.2, 70.0)
    assert (own.equilibrium, own.method, own.controller.name) == ("measured", "zoh", "fee-gpi")
    assert (design.equilibrium, design.method, design.controller) == own_choice(own)
    assert own.family.gaps == (0.02, 0.03)
    assert own.family.ratios == pytest.approx((0.7, 1.3))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"gap_range": (0.03, 0.02)}, "gap-range"),
        ({"gap_range": (0.0, 0.02)}, "gap-range"),
        ({"gap_range": (0.01, math.inf)}, "gap-range"),
        ({"beta_error": 1.0}, "beta-error"),
        ({"beta_error": -0.1}, "beta-error"),
        ({"beta_error": math.nan}, "beta-error"),
        ({"zeta": -1.0}, "zeta"),
        ({"design": Path("design.json"), "rig": "belmonte2021"}, "--rig"),
        ({"design": Path("no-such-design.json")}, "no-such-design.json"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError, match=word):
        certify_verb._subject(request(**changes))
