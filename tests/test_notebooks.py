"""Every notebook runs from a clean kernel, warns of nothing, and is built to be taught from."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import jupytext
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = [pytest.param(path, id=path.stem) for path in sorted(FOLDER.glob("*.py"))]
LONGEST_CELL = 300
"""[s] A kernel that hangs is a failure and not a suite that never ends; no cell comes near it."""
EXERCISES = 3


def cells(path: Path) -> list[Any]:
    return list(jupytext.read(path).cells)


def section(path: Path, title: str) -> list[Any]:
    """Return the cells from the one that starts with `## title` to the next such heading."""
    found, inside = [], False
    for cell in cells(path):
        if cell.cell_type == "markdown" and cell.source.startswith("## "):
            inside = cell.source.splitlines()[0] == f"## {title}"
        if inside:
            found.append(cell)
    return found


def test_there_is_a_notebook_for_each_subject() -> None:
    assert [path.name[:2] for path in sorted(FOLDER.glob("*.py"))] == [
        f"{letter}_" for letter in "abcdefg"
    ]


@pytest.mark.parametrize("path", NOTEBOOKS)
def test_a_notebook_runs_from_a_clean_kernel(path: Path, tmp_path: Path) -> None:
    notebook = jupytext.read(path)
    client = NotebookClient(
        notebook,
        timeout=LONGEST_CELL,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    )
    client.execute()
    outputs = [o for c in notebook.cells if c.cell_type == "code" for o in c.outputs]
    printed = "".join(o.text for o in outputs if o.output_type == "stream" and o.name == "stderr")
    assert "Warning" not in printed
    drawn = [o for o in outputs if "image/svg+xml" in o.get("data", {})]
    assert drawn, "a notebook without a figure"
    assert list(tmp_path.iterdir()) == [], "a notebook left files behind"


@pytest.mark.parametrize("path", NOTEBOOKS)
def test_a_notebook_says_what_one_will_know_and_ends_with_answered_exercises(path: Path) -> None:
    first = cells(path)[0].source
    assert first.startswith("# ")
    assert "**What you will know at the end**" in first
    (exercises,) = section(path, "Exercises")
    assert len(re.findall(r"^\d\. ", exercises.source, re.MULTILINE)) == EXERCISES
    answers = section(path, "Answers")
    assert answers[-1].source == cells(path)[-1].source
    computed = [cell for cell in answers if cell.cell_type == "code"]
    assert len(computed) == EXERCISES
    assert all("assert" in cell.source for cell in computed)


@pytest.mark.parametrize("path", NOTEBOOKS)
def test_a_notebook_checks_its_numbers_as_it_goes(path: Path) -> None:
    sources = [cell.source for cell in cells(path) if cell.cell_type == "code"]
    checks = [source for source in sources if source.startswith("# Check:")]
    assert len(checks) > EXERCISES
    assert all("assert" in source for source in checks)
