"""The benchmarks run and their report is complete. No time is judged here."""

from __future__ import annotations

import getpass
import json
import os
import socket
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

HERE = Path(__file__).parent
HEADINGS = (
    *("Targets", "One closed loop", "Work and precision", "Gradients", "Scenarios and cores"),
    *("Start-up", "Memory", "A robust tune", "A sweep"),
)
TARGETS = 9


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run the command once, from elsewhere."""
    folder = tmp_path_factory.mktemp("benchmarks")
    done = subprocess.run(  # noqa: S603 - our own interpreter and files
        [sys.executable, "-W", "error", str(HERE / "benchmarks"), "--quick", "-o", "reports"],
        cwd=folder,
        env=os.environ | {"HOME": str(folder), "XDG_CACHE_HOME": str(folder / ".cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    written = [folder / line for line in done.stdout.splitlines()]
    assert all(path.is_file() for path in written)
    assert len(written) == 4
    assert not (folder / ".cache" / "maglev-design").exists(), (
        "what is compiled goes to a folder of its own"
    )
    return folder / "reports"


def test_the_report_is_complete(reports: Path) -> None:
    text = (reports / "performance.md").read_text()
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == list(HEADINGS)
    assert "A quick run" in text
    for line in text.splitlines():
        if line.startswith("!["):
            assert (reports / line.rpartition("(")[2].rstrip(")")).is_file()
    for word in ("nan", "None", "inf |"):
        assert word not in text


def test_every_target_is_there(reports: Path) -> None:
    document = json.loads((reports / "performance.json").read_text())
    assert document["schema_version"] == 1
    assert len(document["targets"]) == TARGETS
    for target in document["targets"]:
        assert (target["met"] is None) == (target["reached"] is None)
        assert target["met"] or target["obstacle"], "what stands in the way is said"
    contenders = {row["contender"] for row in document["precision"]}
    assert {"C by hand", "interpreted", "SciPy LSODA", "CasADi cvodes"} <= contenders


def test_every_part_of_a_tuning_is_measured(reports: Path) -> None:
    parts = json.loads((reports / "performance.json").read_text())["tune"]["own"]
    for name in ("solve", "rows", "verification", "plain_seconds", "carrying_seconds"):
        assert parts[name] > 0, name


def test_the_figures_can_be_drawn(reports: Path) -> None:
    for path in (reports / "performance").glob("*.svg"):
        assert ET.parse(path).getroot().tag.endswith("svg")  # noqa: S314 - our own file


def test_nothing_tells_whose_machine_it_was(reports: Path) -> None:
    for path in reports.rglob("*"):
        if path.is_file():
            text = path.read_text()
            for secret in (socket.gethostname(), str(reports.parent), str(HERE)):
                assert secret not in text
            assert f"/{getpass.getuser()}/" not in text
