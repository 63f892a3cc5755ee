from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from exported import with_document

from maglev_design.record import DesignRecord, save

SLOW = 240
"""[s] A start costs seconds, more on a busy machine."""


@pytest.fixture(scope="module")
def design(tuned_record: DesignRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    record = with_document(tuned_record, certificate={"certified": False})
    return save(record, tmp_path_factory.mktemp("design"))[0]


def run(*arguments: str | Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(  # noqa: S603 - this interpreter, our own module
        [sys.executable, "-m", "maglev_design", *map(str, arguments)],
        capture_output=True,
        encoding="utf-8",
        timeout=SLOW,
        check=False,
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == code, done.stderr
    return done


def document(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    found = json.loads(done.stdout)
    assert isinstance(found, dict)
    assert next(iter(found)) == "schema_version"
    return found


def test_a_design_is_exported_and_verified(design: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    refused = run("export", design, "--target", "python", "-o", out, code=2)
    assert "--allow-unverified" in refused.stderr
    assert not out.exists()
    options = ("--target", "python", "-o", out, "--prefix", "lev", "--allow-unverified")
    found = document(run("export", design, *options, "--json"))
    assert found["files"] == list(found["sha256"])
    for name, digest in found["sha256"].items():
        assert hashlib.sha256((out / name).read_bytes()).hexdigest() == digest
    assert found["verified"] is False
    done = run("verify", out, "--json")
    checks = document(done)["checks"]
    assert {"name", "passed", "value", "limit"} <= set(checks[0])
    assert all(check["passed"] for check in checks)
    assert done.stderr.endswith("checks passed\n")
    with (out / "lev.py").open("a") as file:
        file.write(" ")
    damaged = run("verify", out, code=4)
    assert "lev.py" in damaged.stderr
    assert "NO" in damaged.stdout


def test_a_certified_design_needs_no_permission(tuned_record: DesignRecord, tmp_path: Path) -> None:
    record = with_document(tuned_record, certificate={"certified": True})
    path = save(record, tmp_path)[0]
    done = run("export", path, "--target", "c", "-o", tmp_path / "out")
    assert "manifest.json" in done.stdout
    assert "warning" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("export", "nowhere.json", "--target", "c", "-o", "out"), "cannot be read"),
        (("verify", "nowhere"), "manifest.json"),
    ],
)
def test_what_is_not_there_is_named(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    assert words in run(*arguments, code=2).stderr


def test_an_unknown_target_and_an_unusable_prefix_are_refused(design: Path, tmp_path: Path) -> None:
    run("export", design, "--target", "cobol", "-o", tmp_path / "out", code=2)
    options = ("--target", "c", "-o", tmp_path / "out", "--allow-unverified", "--prefix", "../x")
    assert "--prefix" in run("export", design, *options, code=2).stderr
    assert not (tmp_path / "out").exists()
