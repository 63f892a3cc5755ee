"""The exported C, compiled: as programs that check themselves and as a library to call."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from maglev_design.errors import VerificationError
from maglev_design.exporting.controller import ExportedController
from maglev_design.exporting.running import Runnable
from maglev_design.tools import call

COMPILERS = ("gcc", "clang")
WARNINGS = (
    "-std=c99",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Werror",
)
OPTIMISED = ("-O2", "-ffp-contract=off")
SANITIZED = ("-O1", "-g", "-ffp-contract=off", "-fsanitize=address,undefined")
CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
"""Its floating-point unit is single; double precision is computed in software."""


def compilers() -> tuple[str, ...]:
    """Return the C compilers that are installed."""
    return tuple(name for name in COMPILERS if shutil.which(name))


def compile_c(
    compiler: str, folder: Path, sources: Sequence[str], output: Path, *flags: str
) -> str:
    """Compile with every warning an error; return what the compiler said, "" when nothing."""
    done = call(
        [compiler, *WARNINGS, *flags, "-o", str(output), *sources, "-lm"],
        folder,
    )
    return (done.stderr + done.stdout).strip() or ("" if done.returncode == 0 else "it failed")


def sanitizes(compiler: str, work: Path) -> bool:
    """Return whether the compiler can link its sanitizers on this machine."""
    (work / "empty.c").write_text("int main(void)\n{\n    return 0;\n}\n", "ascii")
    return not compile_c(compiler, work, ["empty.c"], work / "empty", *SANITIZED)


def library(
    compiler: str,
    folder: Path,
    controller: ExportedController,
    output: Path,
    *,
    single: bool = False,
) -> Runnable:
    """Compile the exported controller into a shared library.

    Raises
    ------
    VerificationError
        When it does not compile without a word.
    """
    prefix = controller.prefix
    flags = (f"-D{prefix.upper()}_SINGLE",) if single else ()
    said = compile_c(
        compiler, folder, [f"{prefix}.c"], output, *OPTIMISED, "-shared", "-fPIC", *flags
    )
    if said:
        raise VerificationError(f"{prefix}.c: {compiler} says: {said.splitlines()[0]}")
    return Runnable.native(output, controller, single=single)
