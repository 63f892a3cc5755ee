"""The closed loop as compiled C: the same CasADi step, printed in vector lanes.

The step with its sensitivities and the increments of the metrics are printed instruction by
instruction (:mod:`maglev_design.simulation.printing`); ``kernel.c`` folds them over the horizon.
The text is kept in the user's cache folder under the hash of what it was printed from. The system's
compiler is run once for a text; what it made is kept under the hash of the text, the flags and the
machine once it has run in a process of its own, and checked against its own hash before it is
loaded. So a process that finds both imports neither SymPy nor CasADi and starts no compiler.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from maglev_design import rig as rigs
from maglev_design.cache import cache_folder, kept, sources
from maglev_design.controller import design as designs
from maglev_design.files import joint_hash
from maglev_design.programs import fingerprint
from maglev_design.simulation import lanes
from maglev_design.simulation.grid import LoopGraph
from maglev_design.tools import call

Array = NDArray[np.float64]

FLAGS = (
    "-std=gnu11",
    "-O3",
    "-march=native",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
    "-w",
)
"""No fused products and no -ffast-math: the noise has the same bits in every back end."""
SMALLEST = "void run(void) {}\n"
"""What a compiler is tried with that nothing was compiled with yet."""
TRIAL = """
import ctypes, sys
tables = [ctypes.create_string_buffer(1 << 22) for _ in range(9)]
number = ctypes.c_int64
ctypes.CDLL(sys.argv[1]).run(number(1), number(2), *tables[:7], ctypes.c_int(1), *tables[7:])
"""
"""Two periods of one block of loops of zeros."""
LONGEST_COMPILATION, LONGEST_TRIAL = 120.0, 20.0
"""[s]"""
HERE = Path(__file__).parent
SOURCES = (
    HERE,
    HERE / "kernel.c",
    HERE / "lanes.h",
    Path(designs.__file__),
    Path(rigs.__file__).parent,
)
"""Whose text decides what a kernel is, besides the programs."""


@cache
def command() -> tuple[str, ...] | None:
    """Return the C compiler and what goes before its arguments; None without one.

    ``CC`` where it is set (``ccache gcc`` is two words), else cc, gcc or clang.
    """
    try:
        wanted = shlex.split(os.environ.get("CC", ""))
    except ValueError:  # a quotation without an end
        return None
    choices = [wanted] if wanted else [["cc"], ["gcc"], ["clang"]]
    return next(((path, *rest) for name, *rest in choices if (path := shutil.which(name))), None)


def compiler() -> str | None:
    """Return the path of the C compiler; None without one."""
    found = command()
    return found[0] if found else None


@cache
def usable() -> bool:
    """Whether there is a compiler, and what it makes can be loaded and run here."""
    return command() is not None and isinstance(compile_library(SMALLEST), Path)


@cache
def _machine() -> str:
    """Return what compiled code depends on besides its text: processor, compiler and flags.

    The compiler is asked once in the life of its file on this machine; the answer is kept.
    """
    words = command() or ()

    def ask() -> str:
        questions = (("-march=native", "-Q", "--help=target"), ("--version",))
        answers = [
            call((*words, *question), seconds=LONGEST_TRIAL).stdout for question in questions
        ]
        return "\n".join((platform.machine(), *answers, " ".join(FLAGS)))

    files = [Path(path).stat() for word in words if (path := shutil.which(word))]
    stamps = [f"{file.st_size} {file.st_mtime_ns} {file.st_ino}" for file in files]
    key = joint_hash(*words, *stamps, *FLAGS, platform.node(), platform.machine(), _processor())
    return kept("machines", key, ask, str)


def _processor() -> str:
    """Return the name and abilities of the first processor, where the system lists them."""
    try:
        with Path("/proc/cpuinfo").open("rb") as file:
            first = file.read(8192).partition(b"\n\n")[0].decode("utf-8", "replace")
    except OSError:
        return ""
    return "\n".join(line for line in first.splitlines() if "MHz" not in line)


def compile_library(text: str) -> Path | str:
    """Return the shared library of a C text, from the cache or made now; else why there is none.

    Two processes that compile the same text at once both succeed: each writes a file of its own
    and renames it. A library that does not match the hash beside it is made anew. What was made is
    run once in a process of its own before it is kept: one that this machine or this folder does
    not let run is none.
    """
    if command() is None:
        return "no C compiler found"
    key = hashlib.sha256(f"{text}\n{_machine()}".encode()).hexdigest()[:32]
    folder = cache_folder()
    if folder is None:
        return "no folder for compiled loops"
    library, proof = folder / f"{key}.so", folder / f"{key}.sha256"
    try:
        if library.exists() and proof.read_text("ascii") == _digest(library):
            return library
    except (OSError, ValueError):
        pass  # no proof beside it, or not readable: made anew below
    try:
        with tempfile.TemporaryDirectory(dir=folder, ignore_cleanup_errors=True) as name:
            made = _compiled(text, Path(name))
            if isinstance(made, str):
                return made
            (Path(name) / "proof").write_text(_digest(made), "ascii")
            made.replace(library)
            (Path(name) / "proof").replace(proof)
    except OSError as error:
        return f"{folder}: {error.strerror}"
    return library


def _compiled(text: str, folder: Path) -> Path | str:
    """Return the library of a C text, made in `folder` and tried; else what went wrong."""
    made, written = folder / "loop.so", folder / "loop.c"
    written.write_text(text, "utf-8")
    words = [*(command() or ()), *FLAGS, "-shared", "-fPIC", "-o", str(made), str(written), "-lm"]
    done = call(words, seconds=LONGEST_COMPILATION)
    if done.returncode or not made.exists():
        return f"the C compiler failed: {_first(done.stderr) or 'it made nothing'}"
    tried = call([sys.executable, "-I", "-B", "-c", TRIAL, str(made)], seconds=LONGEST_TRIAL)
    if tried.returncode:
        last = _first("\n".join(reversed(tried.stderr.splitlines())))
        return f"what the C compiler makes does not run here: {last or tried.returncode}"
    return made


def _first(words: str) -> str:
    """Return the first line, as a note may show it."""
    line = next((line for line in words.splitlines() if line.strip()), "")
    return "".join(c if c.isprintable() else "?" for c in line)[:200]


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


Kernel = Callable[..., None]
"""A compiled loop: ``run`` of ``kernel.c``."""


@lru_cache(maxsize=256)
def _loaded(text: str) -> Kernel | str:
    library = compile_library(text)
    if isinstance(library, str):
        return library
    try:
        function = ctypes.CDLL(str(library)).run
    except (OSError, AttributeError) as error:
        return f"{library}: {error}"
    table, number = ctypes.c_void_p, ctypes.c_int64
    function.argtypes = [number, number, *[table] * 7, ctypes.c_int, table, table]
    function.restype = None
    return cast("Kernel", function)


@lru_cache(maxsize=64)
def looked_for(loop: LoopGraph) -> Kernel | str:
    """Return the compiled kernel of a loop, or why there is none."""
    return "no C compiler found" if compiler() is None else _loaded(text(loop))


def kernel(loop: LoopGraph) -> Kernel | None:
    """Return the compiled kernel of a loop; None where there is none."""
    found = looked_for(loop)
    return None if isinstance(found, str) else found


def text(loop: LoopGraph) -> str:
    """Return the C text of a loop's kernel, from the cache folder or printed now."""

    def printed() -> str:
        from maglev_design.simulation.printing import source  # noqa: PLC0415 - imports CasADi

        return source(loop)

    return kept("loops", joint_hash(_made_from(), loop.structure, str(lanes.LANES)), printed, str)


@cache
def _made_from() -> str:
    """Return the hash of what every kernel is printed from, but for the loop's own structure."""
    return joint_hash(fingerprint(), metadata.version("casadi"), *sources(*SOURCES))


def run(
    loop: LoopGraph,
    found: Kernel,
    first: Array,
    parameters: Array,
    stream: NDArray[np.uint32],
    deviation: Array,
    *,
    noisy: bool,
    trace: bool = False,
    threads: int = 1,
) -> tuple[Array, Array]:
    """Run n loops; return their figures, shape (n, N_FIGURES), and their traces.

    Parameters
    ----------
    first, parameters : array, shape (n, size)
        State at t = 0 and parameters, sensitivities behind.
    stream : array of uint32, shape (n, 2)
        Seed and scenario of the noise.
    deviation : array, shape (n, 2)
        Standard deviations of input and position noise.
    trace : bool
        Whether gap, velocity, commanded and applied voltage after every step are wanted: shape
        (n, steps, 4), or (n, 0, 4) where they are not.
    threads : int
        Cores; the result does not depend on it.
    """
    count, steps, wide = len(first), len(loop.times) - 1, lanes.LANES
    blocks = -(-count // wide)
    inputs, starts, parts = loop.tables
    filled = np.minimum(np.arange(blocks * wide), count - 1)

    def laned(rows: NDArray[Any], kind: type[np.generic] = np.float64) -> NDArray[Any]:
        """Return (n, size) as (blocks, size, lanes), the last loop repeated to fill a block."""
        return np.array(rows[filled].reshape(blocks, wide, -1).transpose(0, 2, 1), kind, order="C")

    arrays = [laned(parameters), laned(first), laned(stream, np.uint32), laned(deviation)]
    size = lanes.figures_count(loop.directions)
    figures = np.empty((blocks, size, wide))
    traces = np.empty((blocks, steps if trace else 0, 4, wide))

    def work(begin: int, end: int) -> None:
        pointers = [a.ctypes.data + begin * a.strides[0] for a in (*arrays, figures, traces)]
        *given, found_figures, found_trace = pointers
        found(
            *(end - begin, steps, *(table.ctypes.data for table in (inputs, starts, parts))),
            *(*given, int(noisy), found_figures, found_trace if trace else None),
        )

    workers = min(threads, blocks)
    if workers <= 1:
        work(0, blocks)
    else:
        edges = np.linspace(0, blocks, workers + 1).astype(int).tolist()
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(work, edges[:-1], edges[1:]))
    flat = figures.transpose(0, 2, 1).reshape(-1, size)[:count]
    return flat, traces.transpose(0, 3, 1, 2).reshape(blocks * wide, traces.shape[1], 4)[:count]
