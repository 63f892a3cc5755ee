"""What a whole process costs: start-up, the first kernel, memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.clock import side_by_side

START = """
import json, resource, sys, time
clock = time.perf_counter
begun = clock()
sys.path.insert(0, sys.argv[1])
from benchmarks.loops import subject
from maglev_design.simulation import build, simulate_batch
imported = clock()
of, count = subject(), int(sys.argv[2])
loop = build(of.rig, of.design.method)
built = clock()
simulate_batch(loop, [of.design], [of.scenario], backend="compiled")
first = clock()
simulate_batch(loop, [of.design], [of.scenario], backend="compiled")
second = clock()
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
before = peak()
if count:
    simulate_batch(loop, [of.design] * count, [of.scenario] * count, backend="compiled")
print(json.dumps({"imports": imported - begun, "build": built - imported,
    "first": first - built, "second": second - first, "before": before, "after": peak()}))
"""


def _environment(cache: Path) -> dict[str, str]:
    return os.environ | {"MAGLEV_DESIGN_CACHE": str(cache)}


def started(cache: Path, count: int = 0) -> dict[str, float]:
    """Return times [s] and memory [MB] of a process that runs two loops, then `count` at once."""
    command = [sys.executable, "-c", START, str(Path(__file__).parent.parent), str(count)]
    done = subprocess.run(  # noqa: S603 - our own interpreter and text
        command, env=_environment(cache), capture_output=True, text=True, check=True
    )
    found: dict[str, float] = json.loads(done.stdout)
    return found


PARTS = ("imports", "build", "first", "second")


def cold_and_warm(folder: Path, runs: int, counts: Sequence[int]) -> dict[str, Any]:
    """Return the least times with an empty cache and with a full one, and peak memory.

    Memory [MB] is that before and after a batch of each of `counts` loops.
    """
    cold = [started(folder / f"cold{n}") for n in range(runs)]
    warm = [started(folder / "cold0", count) for count in counts]
    return {
        "times": {
            name: {key: min(row[key] for row in rows) for key in PARTS}
            for name, rows in (("cold", cold), ("warm", warm))
        },
        "memory": [
            {"loops": count, "before": row["before"], "after": row["after"]}
            for count, row in zip(counts, warm, strict=True)
        ],
    }


def start_up(folder: Path, runs: int) -> dict[str, float]:
    """Return the least wall time [s] of the commands and of what they import."""
    own = ["-m", "maglev_design"]
    commands: dict[str, list[str]] = {
        "python -c pass": ["-c", "pass"],
        "maglev-design --help": [*own, "--help"],
        "maglev-design simulate": [*own, "simulate", "--json"],
        "import typer": ["-c", "import typer"],
        "import numpy": ["-c", "import numpy"],
        "import casadi": ["-c", "import casadi"],
        "import sympy": ["-c", "import sympy"],
    }

    def job(arguments: list[str]) -> Any:
        return lambda: subprocess.run(  # noqa: S603 - our own interpreter
            [sys.executable, *arguments],
            env=_environment(folder / "commands"),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=True,
        )

    return side_by_side(
        {name: job(a) for name, a in commands.items()}, runs, wall=True, before=runs > 1
    )
