"""What the tests of the export share: a small design with a hostile name, and the tools."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from recorded import recorded
from rigs import SHORT, rig_with

from maglev_design.controller.design import PoleSpec
from maglev_design.options import Equilibrium
from maglev_design.record import DesignRecord
from maglev_design.simulation import nominal_scenario, resimulate
from maglev_design.tuning import Status, TuneResult, build_problem
from maglev_design.tuning.evaluation import design_at
from maglev_design.tuning.figures import Verification, judge

HOSTILE = "rig */ ??/ \"q\" 's' \\\n% #{U+} {{ x }} {% y %} \u2028 \u00e9 \U0001f9f2"
WARNINGS = [
    "-std=c99",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Werror",
]
EXACT = ["-O2", "-ffp-contract=off"]


def judged(
    poles: PoleSpec,
    changes: dict[str, Any] | None = None,
    equilibrium: Equilibrium = "model",
    beta_error: float | None = None,
) -> DesignRecord:
    """Return the record that a tuning with this answer writes, without the search for it."""
    rig = rig_with(SHORT, {"name": HOSTILE, "uncertainty.beta": 0.1, **(changes or {})})
    problem = build_problem(rig, equilibrium=equilibrium, beta_error=beta_error)
    figures = judge(problem, poles)
    design = design_at(problem, poles)
    check = resimulate(rig, design, nominal_scenario(rig, design.believed.beta))
    result = TuneResult(
        status=Status.OPTIMAL,
        problem=problem,
        poles=poles,
        design=design,
        figures=figures,
        verification=Verification(figures.nominal.itae, check.itae),
        baseline=None,
        alternatives=(),
        landscape=None,
        evaluations=0,
    )
    return recorded(result)


def with_document(record: DesignRecord, **changes: Any) -> DesignRecord:
    """Return the record with other entries in its document."""
    return replace(record, document={**record.document, **changes})


def needs(tool: str) -> str:
    """Return where a tool is; skip the test, saying so, where it is not."""
    found = shutil.which(tool)
    if found is None:
        pytest.skip(f"{tool} is not installed (.ci/run installs it)")
    return found


def run(folder: Path, *command: str, code: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(  # noqa: S603 - compilers and what they made
        command, cwd=folder, capture_output=True, encoding="utf-8", timeout=120, check=False
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def compiled(compiler: str, folder: Path, sources: Sequence[str], *flags: str) -> Path:
    """Compile with every warning an error and return the program; not a word may be said."""
    program = folder / "program"
    command = [needs(compiler), *WARNINGS, *flags, "-o", str(program), *sources, "-lm"]
    done = run(folder, *command)
    assert done.stderr + done.stdout == ""
    return program
