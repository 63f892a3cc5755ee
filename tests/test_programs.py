"""Programs that were derived before: the same to the last bit, and never those of other sources."""

from __future__ import annotations

import inspect
import json
import math
import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from maglev_design import programs
from maglev_design.files import joint_hash
from maglev_design.lowering import Operation, Program
from maglev_design.options import PAPER_PLANT, TAN_GPI, PlantKind
from maglev_design.programs import derived

POSSIBLE: dict[str, tuple[Any, ...]] = {
    "method": ("tustin", "euler", "zoh"),
    "controller": (TAN_GPI,),
    "equilibrium": ("model", "appendix-a", "measured"),
    "crossing": (True, False),
    "kind": (PlantKind("power", 2, "coil", damped=True, offset=True),),
    "derivatives": (3,),
    "order": (6,),
}


def forget() -> None:
    """Make this process forget its programs, as if it had just started."""
    programs.program.cache_clear()
    programs.fingerprint.cache_clear()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path))
    forget()
    yield tmp_path / "programs"
    forget()


def builders() -> list[str]:
    return [
        name
        for name, function in inspect.getmembers(derived, inspect.isfunction)
        if inspect.signature(function).return_annotation == "Program" and name != "lower"
    ]


def first_arguments(name: str) -> list[Any]:
    return [
        POSSIBLE[parameter][0] for parameter in inspect.signature(getattr(derived, name)).parameters
    ]


@pytest.mark.parametrize("name", builders())
def test_a_program_read_back_is_the_one_derived(name: str, folder: Path) -> None:
    arguments = first_arguments(name)
    cold = programs.program(name, *arguments)
    forget()
    warm = programs.program(name, *arguments)
    assert warm == cold == getattr(derived, name)(*arguments)
    assert len(list(folder.iterdir())) == 1


def test_constants_keep_every_bit() -> None:
    values = [-0.0, 0.1, 1 / 3, 5e-324, 1.7976931348623157e308, math.inf, -math.inf]
    constants = tuple(Operation("const", (), value) for value in values)
    names = tuple(f"out{n}" for n in range(len(values)))
    program = Program((), names, constants, tuple(range(len(values))))
    back = Program.from_json(program.to_json())
    assert back == program
    assert [math.copysign(1, c.constant) for c in back.operations[:1]] == [-1]


GOOD: list[Any] = [["x"], ["z"], [["input", [0], 0.0], ["mul", [0, 0], 0.0]], [1]]
BAD: dict[str, Any] = {
    "no JSON": "[",
    "another shape": {},
    "too few parts": GOOD[:3],
    "a name that is code": [["x"], ["z\nimport os"], GOOD[2], [1]],
    "a name that is no text": [[1], ["z"], GOOD[2], [1]],
    "two of one name": [["x"], ["x"], GOOD[2], [1]],
    "an unknown operation": [["x"], ["z"], [GOOD[2][0], ["exec", [0, 0], 0.0]], [1]],
    "an operation too narrow": [["x"], ["z"], [GOOD[2][0], ["mul", [0], 0.0]], [1]],
    "a look ahead": [["x"], ["z"], [GOOD[2][0], ["mul", [0, 1], 0.0]], [1]],
    "a look behind": [["x"], ["z"], [GOOD[2][0], ["mul", [0, -1], 0.0]], [1]],
    "a late input": [["x"], ["z"], [GOOD[2][0], ["input", [0], 0.0]], [1]],
    "a result that is not there": [["x"], ["z"], GOOD[2], [2]],
    "a constant that is no number": [["x"], ["z"], [GOOD[2][0], ["const", [], "x"]], [1]],
}


def test_the_good_text_is_a_program() -> None:
    assert Program.from_json(json.dumps(GOOD)).scalar()(3.0) == (9.0,)


@pytest.mark.parametrize("what", BAD)
def test_what_is_no_program_is_not_read_as_one(what: str, folder: Path) -> None:
    text = BAD[what] if isinstance(BAD[what], str) else json.dumps(BAD[what])
    with pytest.raises(ValueError, match="not a program"):
        Program.from_json(text)
    good = programs.program("beta", PAPER_PLANT)
    (path,) = folder.iterdir()
    path.write_bytes(f"{joint_hash(text)}\n{text}".encode())  # whole, and yet no program
    forget()
    assert programs.program("beta", PAPER_PLANT) == good


def test_another_source_is_another_program(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs.program("beta", PAPER_PLANT)
    before = programs.fingerprint()
    copies = []
    for place in programs.SOURCES:
        copies.append(tmp_path / "copy" / place.name)
        (shutil.copytree if place.is_dir() else shutil.copy)(place, copies[-1])
    monkeypatch.setattr(programs, "SOURCES", tuple(copies))
    forget()
    assert programs.fingerprint() == before
    seen = {before}
    for file in (copies[0] / "plant.py", copies[1] / "emission.py", copies[2] / "derived.py"):
        file.write_text(file.read_text() + "\n")
        forget()
        seen.add(programs.fingerprint())
        programs.program("beta", PAPER_PLANT)
    assert len(seen) == len(list(folder.iterdir())) == 4


def test_another_sympy_is_another_program(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = programs.fingerprint()
    monkeypatch.setattr(metadata, "version", lambda _: "0")
    forget()
    assert programs.fingerprint() != before


# --- whole processes -----------------------------------------------------------------------

SIMULATE = """
import sys
from maglev_design.cli import app
app(sys.argv[1:], standalone_mode=False)
print(*sorted({n.partition('.')[0] for n in sys.modules}), file=sys.stderr)
"""
RUN = ("simulate", "--json")


def started(folder: Path, *arguments: str, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603 - our own interpreter and text
        [sys.executable, "-c", SIMULATE, *arguments],
        env=os.environ | {"MAGLEV_DESIGN_CACHE": str(folder)} | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finished(process: subprocess.Popen[str]) -> tuple[str, list[str]]:
    """Return what a process printed, and behind its notes what it had loaded."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    *notes, loaded = err.splitlines()
    assert len(notes) <= 1, err
    return out, loaded.split()


def test_reading_a_design_back_needs_no_search() -> None:
    code = "import sys, maglev_design.record; print(*{n.partition('.')[0] for n in sys.modules})"
    done = subprocess.run(  # noqa: S603 - our own interpreter and text
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not {"sympy", "casadi", "scipy", "control"} & set(done.stdout.split())


def logged_compiler(folder: Path) -> tuple[Path, Path]:
    path, log = folder / "logged-cc", folder / "calls"
    path.write_text(f'#!/bin/sh\necho "$*" >> "{log}"\nexec cc "$@"\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path, log


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_warm_process_neither_derives_nor_compiles(tmp_path: Path) -> None:
    path, log = logged_compiler(tmp_path)
    racers = [started(tmp_path / "cache", *RUN, CC=str(path)) for _ in range(2)]
    (cold, loaded), other = (finished(racer) for racer in racers)
    assert "sympy" in loaded
    assert other[0] == cold, "two cold processes at once"
    calls = log.read_text()
    assert "-shared" in calls
    warm, loaded = finished(started(tmp_path / "cache", *RUN, CC=str(path)))
    assert warm == cold
    assert not {"sympy", "casadi", "scipy", "matplotlib", "control", "rich"} & set(loaded)
    assert log.read_text() == calls, "no compiler was started, not even to be asked its name"


def test_a_warm_process_that_interprets_does_not_derive(tmp_path: Path) -> None:
    cold, _ = finished(started(tmp_path, *RUN, CC="/nonexistent"))
    warm, loaded = finished(started(tmp_path, *RUN, CC="/nonexistent"))
    assert warm == cold
    assert "casadi" in loaded
    assert not {"sympy", "scipy"} & set(loaded)
