"""Other programs, run for us: with a limit of time, and of how much of their words is kept."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

LONGEST = 120.0
"""[s] Before a program is given up, where nothing else is said."""
MOST_WORDS = 10_000_000
"""[bytes] Kept of what a program says; the rest is read and forgotten."""
FAREWELL = 2.0
"""[s] For the last words of a program that has ended."""


@dataclass(frozen=True)
class ToolAnswer:
    """How a program ended and what it said; bytes that are no UTF-8 are replaced."""

    returncode: int
    stdout: str
    stderr: str


def call(
    command: Sequence[str], folder: Path | None = None, seconds: float = LONGEST
) -> ToolAnswer:
    """Run a program to its end, or for so many seconds; it and all that it started are gone then.

    One that cannot be started or does not end is a failure that says so.
    """
    around = {} if folder is None else {"PWD": str(folder)}  # frama-c believes this
    try:
        process = subprocess.Popen(  # noqa: S603 - who calls says what runs
            command,
            cwd=folder,
            env={**os.environ, **around},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        return ToolAnswer(127, "", f"{command[0]}: cannot be started ({error})")
    said = bytearray(), bytearray()
    pipes = process.stdout, process.stderr
    readers = [
        threading.Thread(target=_heard, args=(pipe, words), daemon=True)
        for pipe, words in zip(pipes, said, strict=True)
    ]
    for reader in readers:
        reader.start()
    try:
        code = process.wait(seconds)
    except subprocess.TimeoutExpired:
        return ToolAnswer(1, "", f"no answer in {seconds:g} s")
    finally:
        end(process)
        for reader in readers:
            reader.join(FAREWELL)
    out, err = (bytes(words).decode("utf-8", "replace") for words in said)
    return ToolAnswer(code, out, err)


def _heard(pipe: IO[bytes] | None, words: bytearray) -> None:
    """Read a pipe to its end and keep the beginning."""
    assert pipe is not None  # noqa: S101 - it was asked for
    with pipe:
        while piece := os.read(pipe.fileno(), 65536):
            words += piece[: MOST_WORDS - len(words)]


def end(process: subprocess.Popen[bytes]) -> None:
    """End a program that was started in a session of its own, with all that it started."""
    with contextlib.suppress(OSError):  # gone already
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()
