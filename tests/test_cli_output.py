"""What the command line writes and prints, into places that will not have it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from maglev_design.cli import app
from maglev_design.errors import InputError


def refused(*arguments: str | Path) -> str:
    done = CliRunner().invoke(app, [str(word) for word in arguments])
    assert isinstance(done.exception, InputError), done.output
    return str(done.exception)


@pytest.mark.parametrize(
    ("verb", "option", "name", "ending"),
    [
        ("simulate", "--csv", "a.csv", ".csv, .txt"),
        ("simulate", "--plot", "a.svg", ".png, .svg, .pdf"),
        ("derive", "-o", "a.tex", ".txt, .md, .tex"),
    ],
)
def test_a_file_is_refused_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str, option: str, name: str, ending: str
) -> None:
    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("computed")

    from maglev_design.cli import derive_verb, simulate_verb  # noqa: PLC0415

    monkeypatch.setattr(simulate_verb, "set_up", never)
    monkeypatch.setattr(derive_verb, "derivation", never)
    (tmp_path / name).write_text("kept")
    (tmp_path / "design.json").write_text("kept")
    assert "exists already" in refused(verb, option, tmp_path / name)
    assert ending in refused(verb, option, tmp_path / "design.json", "--force")
    assert {path.read_text() for path in tmp_path.iterdir()} == {"kept"}


def test_the_ending_of_a_file_is_its_form(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["derive", "-o", str(tmp_path / "a.tex")])
    assert done.exit_code == 0
    assert (tmp_path / "a.tex").read_text("utf-8").startswith("\\documentclass")
    assert "ends as markdown does" in refused(
        "derive", "-o", tmp_path / "a.md", "--format", "latex"
    )
