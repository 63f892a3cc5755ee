"""``report`` as a user types it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from records import tuned
from test_cli_paper import refused
from typer.testing import CliRunner

from maglev_design.cli import app
from maglev_design.files import MARK
from maglev_design.record import save
from maglev_design.reporting.pdf_form import tool


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save(tuned(), tmp_path_factory.mktemp("design"))[0]


def test_all_forms_are_written_and_named(design: Path, tmp_path: Path) -> None:
    out = tmp_path / "report"
    done = CliRunner().invoke(app, ["report", str(design), "-o", str(out), "--json"])
    assert done.exit_code == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["schema_version"] == 1
    named = {Path(name).relative_to(out).as_posix() for name in document["files"]}
    there = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
    assert named == there - {MARK}
    pdf = {"report.pdf"} if tool() else set()
    assert {"report.md", "report.tex", "report.html"} | pdf <= named


@pytest.mark.parametrize(("form", "name"), [("markdown", "report.md"), ("html", "report.html")])
def test_one_form_alone(design: Path, tmp_path: Path, form: str, name: str) -> None:
    done = CliRunner().invoke(
        app, ["report", str(design), "--format", form, "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.stderr
    assert {p.name for p in (tmp_path / "out").glob("report.*")} == {name}
    assert (tmp_path / "out" / "figures").exists() == (form == "markdown")


def test_a_folder_of_somebody_else_is_refused_and_left_alone(design: Path, tmp_path: Path) -> None:
    own = tmp_path / "report.md"
    own.write_text("mine", "utf-8")
    command = ["report", str(design), "--format", "markdown", "-o", str(tmp_path)]
    assert "--force" in refused(*command)
    assert own.read_text("utf-8") == "mine"
    assert CliRunner().invoke(app, [*command, "--force"]).exit_code == 0
    assert own.read_text("utf-8") != "mine"


def test_a_record_without_its_curves_is_reported_with_a_warning(
    design: Path, tmp_path: Path
) -> None:
    alone = tmp_path / "design.json"
    shutil.copy(design, alone)
    done = CliRunner().invoke(
        app, ["report", str(alone), "--format", "markdown", "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 0
    assert "design.npz" in done.stderr


def test_what_is_no_record_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    wrong = tmp_path / "design.json"
    wrong.write_text("{}", "utf-8")
    assert "design.json" in refused("report", str(wrong), "-o", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()
    assert "nothing.json" in refused("report", str(tmp_path / "nothing.json"))


def test_pdf_without_a_tool_names_the_tool(
    design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda _name: None)
    monkeypatch.setattr("maglev_design.reporting.pdf_form.find_spec", lambda _name: None)
    out = str(tmp_path / "out")
    assert "texlive-latex-base" in refused("report", str(design), "--format", "pdf", "-o", out)
    done = CliRunner().invoke(app, ["report", str(design), "-o", out])
    assert done.exit_code == 0
    assert "no PDF" in done.stderr
    assert not (tmp_path / "out" / "report.pdf").exists()
