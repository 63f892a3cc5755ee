from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from records import document_of
from rigs import changed
from scipy.linalg import expm
from typer.testing import CliRunner

from maglev_design.cli import app, certify_tables, certify_verb
from maglev_design.cli.commands.certify import CertifyOptions
from maglev_design.controller.design import Design, PoleSpec, make_design
from maglev_design.errors import InputError
from maglev_design.files import finite
from maglev_design.options import EQUILIBRIA, SCHEMA_VERSION
from maglev_design.record import document_bytes
from maglev_design.rig import Rig, load_rig

POLES = PoleSpec.double(1, 70)
DESIGN = make_design(load_rig("belmonte2021"), POLES)
MEASURED = {"operating_point.voltage": 2.0825}
LOOP = {"ms", "mt", "gain", "gain_up", "gain_down", "phase_deg", "delay_s", "disk"}


def rig_file(folder: Path, changes: dict[str, Any]) -> Path:
    """Write the paper's rig with other numbers as TOML."""
    rig = load_rig("belmonte2021").model_dump(exclude_none=True)
    lines = []
    for name, table in changed(rig, changes).items():
        if isinstance(table, dict):
            lines.append(f"[{name}]")
            lines += [f"{key} = {json.dumps(value)}" for key, value in table.items()]
    path = folder / "rig.toml"
    path.write_text("\n".join(lines), "utf-8")
    return path


def design_file(folder: Path, rig: Rig, design: Design, beta_error: float | None = None) -> Path:
    """Write what is read back of a saved design, made with an error of beta or the rig's."""
    document = document_of(rig, design, beta_error_given=beta_error)
    path = folder / "design.json"
    path.write_bytes(document_bytes(finite(document)))
    return path


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
    assert [row["controller"] for row in rows] == ["fixed"] * 2 + ["recomputed"] * 6
    assert [row["equilibrium"] for row in rows[::2]] == ["model", *EQUILIBRIA]
    assert {row["gap"] for row in rows[::2]} == {0.0246}
    assert {tuple(row["gap"]) for row in rows[1::2]} == {(0.012, 0.0246)}
    model = "8526400/829921"
    assert [row["upper_exact"] for row in rows[::2]] == [model, model, "5", None]
    assert rows[6]["upper"] is None
    assert rows[6]["stable"]
    assert document["controller_sha256"] == DESIGN.sha256
    assert set(document["margins"]) == LOOP == set(document["margins_continuous"])
    assert document["margins_continuous"]["gain_up"]["value"] is None  # infinite
    sampled = document["sampled"]
    assert sampled["spectral_radius"] < 1
    assert sampled["max_period_s"] == pytest.approx(7.35e-3, rel=1e-3)
    assert sampled["max_period"]["status"] == sampled["max_delay"]["status"] == "proved"
    # the further delay that the worst corner survives is no more than what exact beta does
    assert document["margins"]["delay_s"]["value"] < sampled["max_delay_s"]
    assert path.read_text("utf-8") == json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def test_the_tables_name_the_condition_and_every_end(
    saved: tuple[dict[str, Any], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    document, _ = saved
    certify_tables.print_assessment(document)
    shown = capsys.readouterr().out
    for text in (
        "rho*(C_Y_hat + omega_n**2) > 0",
        "computed anew on each plant",
        "continuous law",
        DESIGN.sha256,
        "8526400/829921",
        "no end",
        "123/1000",
        "9.936844",
        "7.35133",
        "ms, proved",
    ):
        assert text in shown


def test_both_loops_are_certified_and_the_region_contradicts_no_simulation(
    saved: tuple[dict[str, Any], Path],
) -> None:
    document, path = saved
    assert [row["loop"] for row in document["lmi"]] == ["continuous", "sampled"]
    for row in document["lmi"]:
        assert row["certified"]
        assert row["largest_beta_error"] > 0.15
        assert len(row["P"]) == len(row["states"]) == len(row["scaling"])
    assert {row["controller_sha256"] for row in document["lmi"]} == {DESIGN.sha256}
    region = document["region"]
    assert region["law"] == "continuous"
    assert "continuous law" in region["message"]
    assert region["status"] == "guaranteed"
    assert region["reach"][0] < -4e-4
    assert region["reach"][1] > 4e-4
    assert region["contradictions"] == []
    assert 0 < region["share_of_simulated"] < 1
    written = {p.name for p in path.parent.iterdir()}
    assert {"certificate.json", "region.svg"} <= written


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


def test_a_reading_a_method_and_a_family_can_be_chosen(tmp_path: Path) -> None:
    own = certify_verb._subject(
        CertifyOptions(
            rig=str(rig_file(tmp_path, MEASURED)),
            zeta=1.2,
            equilibrium="measured",
            method="zoh",
            gap_range=(0.02, 0.03),
            beta_error=0.3,
            controller="fee-gpi",
        )
    )
    assert own.design.poles.values == (1.2, 70.0, 1.2, 70.0)
    chosen = (own.design.equilibrium, own.design.method, own.design.controller.name)
    assert chosen == ("measured", "zoh", "fee-gpi")
    assert own.design.believed.U == 2.0825
    assert own.family.gaps == (0.02, 0.03)
    assert own.family.ratios == pytest.approx((0.7, 1.3))
    assert own.beta_error == 0.3


# --- one controller -------------------------------------------------------------------------


def radius(design: Design, rig: Rig, ratio: float, gap: float, delay: float) -> float:
    """Spectral radius of the loop of the exported coefficients, built from nothing else.

    The plant's exponential over one period, the remembered voltages, and y - y0 as the rig has it.
    """
    c, T = design.coefficients, design.period
    beta, z = design.beta_at(ratio), gap + rig.plant.gap_offset
    c_u = 2 * math.sqrt(beta * rig.plant.gravity) / z
    F = np.array([[0.0, 1.0, 0.0], [2 * rig.plant.gravity / z, 0.0, -c_u], [0.0, 0.0, 0.0]])
    whole = int(delay / T * (1 + 1e-12))
    part = delay - whole * T
    full, fresh = expm(F * T), expm(F * (T - part))
    held = whole + 1
    A = np.zeros((4 + held, 4 + held))
    volts = np.zeros(4 + held)
    volts[[0, 2, 3]] = c["d"], c["c1"], c["c2"]
    efforts = [volts, *np.eye(4 + held)[4:]]
    A[:2, :2] = full[:2, :2]
    A[:2] += np.outer(fresh[:2, 2], efforts[whole])
    A[:2] += np.outer(full[:2, 2] - fresh[:2, 2], efforts[whole + 1])
    A[2, [0, 2]] = c["b1"], 1.0
    A[3, [0, 3]] = c["b2"], c["a22"]
    A[4:] = efforts[:held]
    return float(np.abs(np.linalg.eigvals(A)).max())


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Design, Rig]:
    """What is printed of the paper's rig with its voltage typed in, and the controller of it."""
    path = rig_file(tmp_path_factory.mktemp("measured"), MEASURED)
    arguments = ["certify", "--rig", str(path), "--equilibrium", "measured", "--json"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certify_verb, "_region", lambda *_: None)
        done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    rig = load_rig(str(path))
    return json.loads(done.stdout), make_design(rig, POLES, equilibrium="measured"), rig


def test_a_measured_controller_is_one_and_its_interval_ends(
    measured: tuple[dict[str, Any], Design, Rig],
) -> None:
    document, design, rig = measured
    assert document["controller_sha256"] == design.sha256
    row = document["exact_interval"][0]
    assert (row["equilibrium"], row["controller"], row["gap"]) == ("measured", "fixed", 0.0246)
    assert row["upper"] == pytest.approx(8526400 / 829921)
    sampled = document["sampled_interval"][0]
    for key, inwards in (("lower", 1), ("upper", -1)):
        end = sampled[key]
        assert radius(design, rig, end * (1 + inwards * 1e-6), 0.0246, 0.0) < 1
        assert radius(design, rig, end * (1 - inwards * 1e-6), 0.0246, 0.0) > 1
    assert document["family"]["ratios"] == pytest.approx([0.99**2, 1.01**2])


def test_the_exported_coefficients_survive_the_promised_delay_and_no_more(
    measured: tuple[dict[str, Any], Design, Rig],
) -> None:
    document, design, rig = measured
    promised = document["sampled"]["max_delay_s"]
    gaps = np.linspace(0.012, 0.0246, 9)
    for delay in np.linspace(0.0, promised, 13):
        assert max(radius(design, rig, 1.0, float(gap), float(delay)) for gap in gaps) < 1
    over = max(radius(design, rig, 1.0, float(gap), 1.001 * promised) for gap in gaps)
    assert over > 1
    for family_gap in gaps:
        for ratio in document["family"]["ratios"]:
            further = document["margins"]["delay_s"]["value"]
            assert radius(design, rig, ratio, float(family_gap), 0.999 * further) < 1


def test_a_controller_is_judged_as_saved(tmp_path: Path) -> None:
    rig, design = load_rig("belmonte2021"), DESIGN
    path = design_file(tmp_path, rig, design)
    own = certify_verb._subject(CertifyOptions(design=path))
    assert own.design.sha256 == design.sha256
    assert (own.family.ratios, own.beta_error) == ((0.85, 1.15), None)
    narrow = certify_verb._subject(CertifyOptions(design=design_file(tmp_path, rig, design, 0.05)))
    assert narrow.family.ratios == pytest.approx((0.95, 1.05))
    assert narrow.beta_error == 0.05
    asked = CertifyOptions(design=tmp_path / "design.json", beta_error=0.1)
    assert certify_verb._subject(asked).family.ratios == pytest.approx((0.9, 1.1))
    path = design_file(tmp_path, rig, design)
    same = CertifyOptions(design=path, zeta=1.0, equilibrium="model", method="tustin")
    assert certify_verb._subject(same).design.sha256 == design.sha256
    for option, value in (
        ("zeta", 1.1),
        ("omega_n", 71.0),
        ("equilibrium", "measured"),
        ("method", "zoh"),
        ("controller", "fee-gpi"),
    ):
        other: dict[str, Any] = {option: value}
        with pytest.raises(InputError, match=f"--{option.replace('_', '-')} = {value}"):
            certify_verb._subject(CertifyOptions(design=path, **other))


def test_a_certificate_of_another_design_is_exit_4_and_names_both(
    saved: tuple[dict[str, Any], Path], tmp_path: Path
) -> None:
    rig = load_rig("belmonte2021")
    path, other = saved[1].parent / "certificate.json", make_design(rig, PoleSpec.double(1, 60))
    design = design_file(tmp_path, rig, DESIGN)
    same = CliRunner().invoke(app, ["certify", "--check", str(path), str(design)])
    assert same.exit_code == 0, same.output
    assert "12 mm to 24.6 mm" in same.stdout
    assert "may move" in same.stdout
    design = design_file(tmp_path, rig, other)
    done = CliRunner().invoke(app, ["certify", "--check", str(path), str(design)])
    assert done.exit_code == 4
    assert DESIGN.sha256 in done.stderr
    assert other.sha256 in done.stderr


def test_an_older_certificate_and_a_second_key_are_refused(
    saved: tuple[dict[str, Any], Path], tmp_path: Path
) -> None:
    text = (saved[1].parent / "certificate.json").read_text("utf-8")
    path = tmp_path / "old.json"
    older = json.loads(text)
    del older["certificate_version"]
    older["rig"]["voltage"] = "0"
    for content, words in (
        (json.dumps(older), ("certificate_version", "maglev-design certify design.json -o")),
        (text.replace('"delay":', '"delay": "1", "delay":', 1), ("'delay'", "twice")),
        (text.replace('"U": ', '"U": 0, "was": ', 1), ("controller.was", "unknown key")),
    ):
        path.write_text(content, "utf-8")
        with pytest.raises(InputError) as caught:
            certify_verb.check(path, CertifyOptions())
        for word in ("old.json", *words):
            assert word in str(caught.value)
    with pytest.raises(InputError, match="--zeta"):
        certify_verb.check(path, CertifyOptions(zeta=1.0))


def test_no_region_is_offered_where_the_sampled_loop_is_unstable(
    tmp_path: Path,
) -> None:
    rig = rig_file(tmp_path, {"sampling.period": 0.016})
    done = CliRunner().invoke(app, ["certify", "--rig", str(rig), "-o", str(tmp_path / "proof")])
    assert done.exit_code == 0, done.output
    assert "No region is offered" in done.stderr
    assert "0 ms, by eigenvalues" in done.stdout
    assert not (tmp_path / "proof" / "region.svg").exists()
    document = json.loads((tmp_path / "proof" / certify_verb.RESULT).read_text("utf-8"))
    assert document["region"]["status"] == "sampled-unstable"
    assert document["region"]["law"] == "continuous"
    assert document["sampled"]["max_delay_s"] is None
    assert document["sampled"]["max_delay"]["status"] == "unstable"


def test_a_voltage_that_disagrees_is_a_warning_with_the_implied_beta(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(certify_verb, "_region", lambda *_: None)
    rig = rig_file(tmp_path, {"operating_point.voltage": 4.2})
    arguments = ["certify", "--rig", str(rig), "--controller", "fee-gpi", "--json"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "operating_point.voltage = 4.2 V implies beta = 0.000336" in done.stderr


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"gap_range": (0.03, 0.02)}, "gap-range"),
        ({"gap_range": (0.0, 0.02)}, "gap-range"),
        ({"gap_range": (0.01, math.inf)}, "gap-range"),
        ({"beta_error": 1.0}, "beta error"),
        ({"beta_error": -0.1}, "beta error"),
        ({"beta_error": math.nan}, "beta error"),
        ({"zeta": -1.0}, "zeta"),
        ({"design": Path("design.json"), "rig": "belmonte2021"}, "--rig"),
        ({"design": Path("no-such-design.json")}, "no-such-design.json"),
        ({"equilibrium": "measured"}, "operating_point.voltage"),
        ({"equilibrium": "appendix-a"}, "operating_point.voltage"),
    ],
)
def test_bad_input_is_named(changes: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError, match=word):
        certify_verb._subject(CertifyOptions(**changes))
