from __future__ import annotations

import re
from pathlib import Path

import pytest
from exported import needs, run

from maglev_design.exporting import export_folder
from maglev_design.record import DesignRecord


@pytest.fixture(scope="module")
def folder(tuned_record: DesignRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("matlab")
    export_folder(tuned_record, "matlab", place, prefix="lev", allow_unverified=True)
    return place


def octave(folder: Path, script: str, code: int = 0) -> str:
    command = (needs("octave-cli"), "--no-gui", "--norc", "--quiet", "--eval", script)
    return run(folder, *command, code=code).stdout


def test_octave_agrees_to_the_last_bit(folder: Path) -> None:
    words = octave(folder, "lev_check").split()
    assert int(words[1]) > 1000
    assert words[3] == "0"


def test_the_example_holds_the_ball(folder: Path) -> None:
    assert octave(folder, "lev_example").splitlines()[-1].startswith("ball held")


def test_its_own_check_notices_another_constant(folder: Path, tmp_path: Path) -> None:
    for path in folder.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    source = (folder / "lev_step.m").read_text("ascii")
    changed, count = re.subn(r"^( *)d = ", r"\1d = 1 + ", source, flags=re.MULTILINE)
    assert count == 1
    (tmp_path / "lev_step.m").write_text(changed, "ascii")
    assert octave(tmp_path, "lev_check", code=1).split()[3] != "0"


def test_a_function_is_named_like_its_file(folder: Path) -> None:
    for path in folder.glob("*.m"):
        first = path.read_text("ascii").splitlines()[0]
        if not path.stem.endswith(("_check", "_example")):
            assert re.fullmatch(rf"function (.* = )?{path.stem}\(.*\)", first)
