"""The exported C, compiled: as programs that check themselves and as a controller to call."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maglev_design.errors import VerificationError

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
LONGEST_BUILD = 120
"""[s] Before a compiler, or a program that it made, is given up."""


def compilers() -> tuple[str, ...]:
    """Return the C compilers that are installed."""
    return tuple(name for name in COMPILERS if shutil.which(name))


def call(command: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a tool in a folder and return what it said; a tool that hangs is a failure."""
    try:
        return subprocess.run(  # noqa: S603 - a tool of this machine and files that we wrote
            command,
            cwd=folder,
            env={**os.environ, "PWD": str(folder)},  # frama-c believes this rather than the system
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=LONGEST_BUILD,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(list(command), 1, "", f"no answer in {LONGEST_BUILD} s")


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


def _state_type(real: Any) -> Any:
    """Return the controller's memory as the header declares it, for one precision."""

    class State(ctypes.Structure):
        _fields_ = (
            ("x1", real),
            ("x2", real),
            ("commanded", real),
            ("voltage", real),
            ("unusable", ctypes.c_uint32),
            ("status", ctypes.c_int),
        )

    return State


@dataclass(frozen=True)
class Library:
    """A shared library of an exported controller in one precision."""

    functions: Any
    prefix: str
    State: Any

    def controller(self) -> NativeController:
        """Return a new controller with a memory of its own."""
        return NativeController(self)


class NativeController:
    """One compiled controller, as the exported Python class is called."""

    def __init__(self, library: Library) -> None:
        self._state = library.State()
        self._functions = library.functions
        self._prefix = library.prefix
        self._step = getattr(library.functions, f"{library.prefix}_step")
        self._memory = ctypes.byref(self._state)
        getattr(self._functions, f"{library.prefix}_init")(self._memory)

    @property
    def states(self) -> tuple[float, float]:
        """x1 and x2 [m s]."""
        return self._state.x1, self._state.x2

    @property
    def commanded(self) -> float:
        """Last voltage before the clamp [V]."""
        return float(self._state.commanded)

    @property
    def status(self) -> int:
        """What became of the last sample."""
        return int(self._state.status)

    def reset(self) -> None:
        """Forget errors and faults."""
        getattr(self._functions, f"{self._prefix}_reset")(self._memory)

    def step(self, gap: float, reference: float, acceleration: float) -> float:
        """Return the voltage for one sample."""
        return float(self._step(self._memory, gap, reference, acceleration))


def load_library(
    compiler: str, folder: Path, prefix: str, output: Path, *, single: bool = False
) -> Library:
    """Compile the exported controller into a shared library and load it.

    Raises
    ------
    VerificationError
        When it does not compile without a word.
    """
    flags = (f"-D{prefix.upper()}_SINGLE",) if single else ()
    said = compile_c(
        compiler, folder, [f"{prefix}.c"], output, *OPTIMISED, "-shared", "-fPIC", *flags
    )
    if said:
        raise VerificationError(f"{prefix}.c: {compiler} says: {said.splitlines()[0]}")
    real = ctypes.c_float if single else ctypes.c_double
    functions = ctypes.CDLL(str(output))
    State = _state_type(real)
    memory = ctypes.POINTER(State)
    for name, arguments, result in (
        ("init", (memory,), None),
        ("reset", (memory,), None),
        ("step", (memory, real, real, real), real),
    ):
        function = getattr(functions, f"{prefix}_{name}")
        function.argtypes, function.restype = arguments, result
    return Library(functions, prefix, State)
