"""Exports that somebody forged, each with a manifest that fits: none runs, none passes."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from maglev_design.errors import VerificationError
from maglev_design.exporting import export_folder, running, verify_folder
from maglev_design.exporting.folder import sha256
from maglev_design.exporting.running import Runnable
from maglev_design.files import digest
from maglev_design.record import DesignRecord

SAME = "every file as its design.json prints it"


@pytest.fixture(scope="module")
def exported(tuned_record: DesignRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("out")
    for target in ("c", "python", "matlab"):
        export_folder(tuned_record, target, place / target, allow_unverified=True)
    return place


def rehashed(folder: Path) -> None:
    """Make the manifest fit, as somebody would who means to hide a change."""
    manifest = json.loads((folder / "manifest.json").read_text("ascii"))
    names = {path.name for path in folder.iterdir()} - {"manifest.json", ".maglev-design"}
    manifest["files"] = {name: sha256((folder / name).read_bytes()) for name in sorted(names)}
    manifest["sha256"] = digest(manifest)
    (folder / "manifest.json").write_text(json.dumps(manifest), "ascii")


Forgery = Callable[[str], str]
"""From a file's text ("" for one that is new) to the forged text; TOUCH leaves a trace."""

TOUCH = "__import__('os').system('touch TRACE')\n"
BACK_DOOR = """        global seen
        seen += 1
        if seen > 30_000_000:
            return u_max
"""
FIRST = "        if self.status is Status.TRIPPED:\n            self.voltage = u_min\n"
CONSTRUCTOR = (
    "#include <stdlib.h>\n__attribute__((constructor)) static void first(void)\n"
    '{\n    if (system("touch TRACE")) { }\n}\n'
)
AGREES = 'puts("rows 9999 differing 0 largest 0.0 V"); return 0; }\n'

FORGED: dict[str, tuple[str, str, Forgery]] = {
    "a command in the source": ("python", "maglev.py", lambda t: t + TOUCH),
    "an exit with 0": ("python", "maglev.py", lambda t: t + TOUCH + "raise SystemExit(0)\n"),
    "an exit of the interpreter": (
        "python",
        "maglev.py",
        lambda t: t + TOUCH + "__import__('os')._exit(0)\n",
    ),
    "a back door after 3e7 steps": (
        "python",
        "maglev.py",
        lambda t: t.replace(FIRST, BACK_DOOR + FIRST) + "\n\nseen = 0\n",
    ),
    "a check that lies": (
        "python",
        "check.py",
        lambda _: TOUCH + "print('rows 9999 differing 0 largest 0.0 V')\n",
    ),
    "an example that lies": ("python", "example.py", lambda _: TOUCH + "print('ball held')\n"),
    "a module that shadows the library": ("python", "struct.py", lambda _: TOUCH),
    "a constructor": ("c", "maglev.c", lambda t: t + CONSTRUCTOR),
    "a check in C that lies": (
        "c",
        "check.c",
        lambda _: "#include <stdio.h>\n" + CONSTRUCTOR + "int main(void) { " + AGREES,
    ),
    "a header": ("c", "maglev.h", lambda t: t.replace("#endif", CONSTRUCTOR + "#endif", 1)),
    "a shipped binary": ("c", "check", lambda _: "#!/bin/sh\ntouch TRACE\n"),
    "a shipped library": ("c", "double.so", lambda _: "#!/bin/sh\ntouch TRACE\n"),
    "a script of MATLAB": ("matlab", "maglev_step.m", lambda t: t + "\nsystem('touch TRACE');\n"),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_export_is_named_and_nothing_of_it_runs(
    exported: Path, tmp_path: Path, name: str
) -> None:
    target, file, forge = FORGED[name]
    shutil.copytree(exported / target, folder := tmp_path / "export")
    trace = tmp_path / "trace"
    path = folder / file
    text = path.read_text("ascii") if path.exists() else ""
    forged = forge(text).replace("TRACE", str(trace))
    assert forged != text
    path.write_text(forged, "ascii")
    path.chmod(0o755)
    rehashed(folder)
    verdict = verify_folder(folder)
    (check,) = verdict.checks
    assert (check.name, check.passed, verdict.ran) == (SAME, False, "")
    assert file in check.note
    assert not trace.exists()


def test_what_lies_beside_the_files_of_an_export_is_never_run(
    exported: Path, tmp_path: Path
) -> None:
    shutil.copytree(exported / "python", folder := tmp_path / "export")
    trace = tmp_path / "trace"
    for name in ("struct.py", "enum.py", "sitecustomize.py"):
        (folder / name).write_text(TOUCH.replace("TRACE", str(trace)))
    assert verify_folder(folder).passed
    assert not trace.exists()


@pytest.mark.parametrize(
    "name", ["a command in the source", "an exit with 0", "an exit of the interpreter"]
)
def test_run_as_it_is_a_forged_export_does_not_pass(
    exported: Path, tmp_path: Path, name: str
) -> None:
    _, file, forge = FORGED[name]
    shutil.copytree(exported / "python", folder := tmp_path / "export")
    trace = tmp_path / "trace"
    text = (folder / file).read_text("ascii")
    (folder / file).write_text(forge(text).replace("TRACE", str(trace)), "ascii")
    rehashed(folder)
    verdict = verify_folder(folder, run_untrusted=True)
    assert trace.exists()
    assert not verdict.passed
    assert not verdict.checks[0].passed
    ends = next((c for c in verdict.checks if c.name == "the exported controller answers"), None)
    assert (ends is not None) == ("exit" in name)


def test_another_version_of_the_program_is_named(exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported / "python", folder := tmp_path / "export")
    manifest = json.loads((folder / "manifest.json").read_text("ascii"))
    manifest["versions"]["exporter"] = "0.0.1\x1b[2J"
    (folder / "manifest.json").write_text(json.dumps(manifest), "ascii")
    rehashed(folder)
    (check,) = verify_folder(folder).checks
    assert not check.passed
    assert "printed by version 0.0.1{U+001B}" in check.note


def source(folder: Path, step: str) -> Path:
    path = folder / "odd.py"
    path.write_text(
        "import os, time\nclass Controller:\n    commanded = 1.0\n    status = 0\n"
        f"    def step(self, gap, reference, acceleration):\n        {step}\n"
    )
    return path


@pytest.mark.parametrize("step", ["os._exit(0)", "raise SystemExit(0)", "return 'x'", "os.abort()"])
def test_a_controller_that_ends_its_process_is_an_error(tmp_path: Path, step: str) -> None:
    with Runnable.python(source(tmp_path, step)).started() as new:
        device = new()
        with pytest.raises(VerificationError, match="ended instead of answering"):
            device.step(1.0, 2.0, 3.0)


def test_a_controller_that_does_not_answer_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "LONGEST_ANSWER", 1.0)
    with Runnable.python(source(tmp_path, "time.sleep(60)")).started() as new:
        device = new()
        with pytest.raises(VerificationError, match="no answer in 1 s"):
            device.step(1.0, 2.0, 3.0)


def test_what_a_controller_prints_is_no_answer(tmp_path: Path) -> None:
    text = "print('x' * 100); os.write(1, b'y' * 100); return gap + reference"
    with Runnable.python(source(tmp_path, text)).started() as new:
        assert new().step(1.0, 2.0, 3.0) == 3.0


def test_two_processes_are_let_go_to_every_core_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    with Runnable.python(source(tmp_path, "return gap")).started() as new:
        new()
    if before is not None:
        assert os.sched_getaffinity(0) == before
    monkeypatch.delattr(os, "sched_setaffinity", raising=False)
    with Runnable.python(source(tmp_path, "return gap")).started() as new:
        assert new().step(1.5, 2.0, 3.0) == 1.5
