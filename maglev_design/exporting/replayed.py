"""Recorded events replayed by compiled C, here or on another processor, and compared by bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.errors import VerificationError
from maglev_design.exporting.native import OPTIMISED, compile_c
from maglev_design.exporting.running import INTERPRETER
from maglev_design.tools import ToolAnswer, call

MOST_EVENTS = 16000
"""What the emulated memory has room for; a folder of 1 ms has about 8000."""
WIDTH = 6
"""Numbers of an event: five of a sample, and one that keeps what follows aligned."""
KINDS = {"step": 0, "reset": 1, "path": 2, "bumpless": 3}
ANSWERS = ("commanded", "voltage", "x1", "x2", "gap", "velocity", "acceleration", "pid")
VERDICTS = ("accepted", "status", "unusable")
CLOCKED = ("step_ticks", "reference_ticks", "pid_ticks")
FIGURES = ("state", "reference", "pid", "stack", "pid_stack", "clock")
PRECISIONS = {"double": np.float64, "single": np.float32}

Rows = NDArray[np.void]


def read_events(vectors: Path, precision: str) -> tuple[Rows, NDArray[np.float64]]:
    """Return the recorded events in one precision, and (commanded, voltage, status) of each.

    Numbers beyond single precision become infinite there; what an event does not record is nan.
    """
    lines = [
        line.split(",")
        for line in vectors.read_text("ascii").splitlines()
        if line and not line.startswith("#")
    ][:MOST_EVENTS]
    kind = np.dtype([("kind", "<u4"), ("unused", "<u4"), ("value", _real(precision), WIDTH)])
    events = np.zeros(len(lines), kind)
    recorded = np.full((len(lines), 3), np.nan)
    with np.errstate(over="ignore"):
        for n, (word, *values) in enumerate(lines):
            numbers = [float(value) for value in values]
            events["kind"][n] = KINDS[word]
            told = numbers[:-3] if word == "step" else numbers
            events["value"][n, : len(told)] = told
            if word == "step":
                recorded[n] = numbers[-3:]
    return events, recorded


def _real(precision: str) -> Any:
    return np.dtype(PRECISIONS[precision]).newbyteorder("<")


def answer_type(precision: str) -> np.dtype[np.void]:
    """Return the layout of ``struct answer``."""
    real = _real(precision)
    words = (*VERDICTS, *CLOCKED)
    return np.dtype([*((name, real) for name in ANSWERS), *((name, "<u4") for name in words)])


def defined(prefix: str, precision: str) -> tuple[str, ...]:
    """Return the compiler's flags that choose a precision."""
    return (f"-D{prefix.upper()}_SINGLE",) if precision == "single" else ()


def replay_here(
    compiler: str, work: Path, prefix: str, events: Rows, output: Path, precision: str
) -> Rows:
    """Return what the same replay answers when it is compiled for this machine.

    Raises
    ------
    VerificationError
        When it does not compile without a word, or does not come to its end.
    """
    sources = [f"{prefix}.c", "cortex-replay.c", "plain-pid.c"]
    flags = (*OPTIMISED, "-shared", "-fPIC", *defined(prefix, precision))
    said = compile_c(compiler, work, sources, output, *flags)
    if said:
        raise VerificationError(f"{compiler} says: {said.splitlines()[0]}")
    kind = answer_type(precision)
    asked, told, figures = (output.with_suffix(f".{name}") for name in ("asked", "told", "figures"))
    asked.write_bytes(events.tobytes())
    tables = (str(told), str(kind.itemsize * len(events)), str(figures), str(4 * len(FIGURES)))
    done = call([*INTERPRETER, "replay", str(output), str(asked), str(len(events)), *tables], work)
    if done.returncode != 0 or not told.is_file():
        raise VerificationError(f"the replay on this machine did not come to its end{_why(done)}")
    return np.frombuffer(told.read_bytes(), kind)


def _why(done: ToolAnswer) -> str:
    return f": {done.stderr.splitlines()[-1]}" if done.stderr else ""


def differences(found: Rows, told: Rows) -> NDArray[np.bool_]:
    """Return where two runs differ in any bit, the clock apart."""
    differing = np.zeros(len(found), bool)
    for name in (*ANSWERS, *VERDICTS):
        bits = f"u{found.dtype[name].itemsize}"
        differing |= found[name].copy().view(bits) != told[name].copy().view(bits)
    return differing


def unlike(found: Rows, events: Rows, recorded: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where answers in double precision are not those that were recorded."""
    steps = events["kind"] == KINDS["step"]
    given = np.stack([found[name].astype(float) for name in ("commanded", "voltage", "status")], 1)
    wrong = steps & (given.view("u8") != recorded.view("u8")).any(1)
    # a path's samples last until anything else happens
    last = np.maximum.accumulate(np.where(steps, 0, np.arange(len(events))))
    on_path = steps & (events["kind"][last] == KINDS["path"])
    wanted = np.stack([found["gap"], found["acceleration"]], 1)
    wrong |= on_path & (wanted.view("u8") != events["value"][:, 1:3].copy().view("u8")).any(1)
    refused = np.isin(events["kind"], (KINDS["path"], KINDS["bumpless"])) & (found["accepted"] != 1)
    return np.asarray(wrong | refused)
