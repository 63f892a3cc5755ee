from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from maglev_design import tools
from maglev_design.tools import call

PYTHON = [sys.executable, "-I", "-c"]


def test_a_program_is_run_in_its_folder_and_its_words_come_back(tmp_path: Path) -> None:
    text = "import os, sys; print(os.getcwd()); print('x', file=sys.stderr); sys.exit(3)"
    done = call([*PYTHON, text], tmp_path)
    assert done.returncode == 3
    assert Path(done.stdout.strip()) == tmp_path
    assert done.stderr.strip() == "x"


def test_what_is_no_utf_8_is_replaced() -> None:
    done = call([*PYTHON, "import os; os.write(1, bytes([0x61, 0xff]))"])
    assert done.stdout == "a\ufffd"


def test_what_cannot_be_started_is_a_failure_that_says_so(tmp_path: Path) -> None:
    assert "cannot be started" in call([str(tmp_path / "absent")]).stderr
    assert call([str(tmp_path)]).returncode != 0
    assert call(["a\0b"]).returncode != 0


def test_a_program_that_hangs_is_ended_with_all_that_it_started(tmp_path: Path) -> None:
    started = tmp_path / "pid"
    text = (
        "import subprocess, sys, time; "
        f"p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)']); "
        f"open({str(started)!r}, 'w').write(str(p.pid)); time.sleep(60)"
    )
    before = time.monotonic()
    done = call([*PYTHON, text], seconds=2.0)
    assert time.monotonic() - before < 20
    assert done.returncode != 0
    assert "no answer in 2 s" in done.stderr
    if Path("/proc").is_dir():
        state = Path(f"/proc/{started.read_text()}/stat")
        for _ in range(50):
            if not state.exists() or ") Z " in state.read_text():
                return
            time.sleep(0.1)
        pytest.fail("what it started is still there")


def test_a_flood_of_words_does_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tools, "MOST_WORDS", 1000)
    done = call([*PYTHON, "for _ in range(1000): print('x' * 1000)"])
    assert done.returncode == 0
    assert len(done.stdout) == 1000


def test_without_process_groups_the_program_itself_is_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(os, "killpg", raising=False)
    done = call([*PYTHON, "import time; time.sleep(60)"], seconds=1.0)
    assert "no answer" in done.stderr
