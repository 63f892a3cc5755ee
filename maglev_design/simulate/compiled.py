"""The closed loop as compiled C: the same CasADi step, printed in vector lanes.

The step with its tangents and the increments of the metrics are printed instruction by instruction
(:func:`printed`); ``kernel.c`` folds them over the horizon. The system's compiler is run once for
a text; what it made is kept in the user's cache folder under the hash of the text, the flags and
the machine, and checked against its own hash before it is loaded.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from maglev_design.simulate.graph import LoopGraph, metrics_program
from maglev_design.store import cache_folder

Array = NDArray[np.float64]

LANES = 4
"""Loops in one call of the step: a register of AVX2. gcc takes wider vectors apart."""
FLAGS = (
    "-std=gnu11",
    "-O3",
    "-march=native",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-w",
)
"""No fused products and no -ffast-math: the noise has the same bits in every back end."""
PARTS = 9
EXTREMES = ("peak_voltage", "min_voltage", "peak_applied", "min_gap", "max_gap")
SCALARS = (*EXTREMES, "total_variation", "final_error", "survived", "last_gap")
TANGENTS = ("ise", "iae", "itae", *EXTREMES)


@cache
def compiler() -> str | None:
    """Return the C compiler: ``CC`` where it is set, else cc, gcc or clang; None without one."""
    wanted = os.environ.get("CC")
    names = [wanted] if wanted else ["cc", "gcc", "clang"]
    return next((path for name in names if (path := shutil.which(name))), None)


_FORMS: dict[int, str] = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_SQRT: "root({0})",
    ca.OP_FABS: "absolute({0})",
    ca.OP_SIGN: "sign_of({0})",
    ca.OP_FLOOR: "lower({0})",
    ca.OP_FMIN: "smaller({0}, {1})",
    ca.OP_FMAX: "larger({0}, {1})",
    ca.OP_LT: "truth({0} < {1})",
    ca.OP_LE: "truth({0} <= {1})",
    ca.OP_EQ: "truth({0} == {1})",
    ca.OP_NE: "truth({0} != {1})",
    ca.OP_NOT: "truth({0} == 0.0)",
    ca.OP_AND: "truth(({0} != 0.0) & ({1} != 0.0))",
    ca.OP_OR: "truth(({0} != 0.0) | ({1} != 0.0))",
    ca.OP_IF_ELSE_ZERO: "guarded({0}, {1})",
}


def printed(function: ca.Function, head: str, read: Callable[[int, int], str]) -> str:
    """Return an SX function as C, one statement an instruction.

    Parameters
    ----------
    function : casadi.Function
    head : str
        Its signature; outputs are ``out0``, ``out1``, ...
    read : callable
        (input, element) -> how it is written.
    """
    names: dict[int, str] = {}
    lines = []
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if kind == ca.OP_OUTPUT:
            lines.append(f"out{targets[0]}[{targets[1]}] = {names[sources[0]]};")
            continue
        if kind == ca.OP_INPUT:
            text = read(*sources)
        elif kind == ca.OP_CONST:
            text = f"spread({float(function.instruction_constant(k))!r})"
        else:
            text = _FORMS[kind].format(*[names[s] for s in sources])
        names[targets[0]] = f"w{k}"
        lines.append(f"const real w{k} = {text};")
    body = "\n    ".join(lines)
    return f"{head}\n{{\n    {body}\n}}\n"


def source(loop: LoopGraph, lanes: int) -> str:
    """Return the C text of a loop's kernel."""
    step, width = loop.step, 1 + loop.directions
    size = len(loop.state_names)
    sizes = {
        "LANES": lanes,
        "N_STATE": size,
        "N_PARAMETER": len(loop.parameter_names),
        "N_INPUT": step.size1_in(2),
        "PIECES": loop.pieces,
        "NODES": (step.size1_in(2) - loop.pieces) // 3,
        "NODES_A_PIECE": loop.nodes_a_piece,
        "DIRECTIONS": loop.directions,
        "N_FIGURES": figures_count(loop.directions),
        "ALIVE": loop.state_names.index("alive"),
    }
    defines = "".join(f"#define {name} {value}\n" for name, value in sizes.items())

    def of_step(position: int, element: int) -> str:
        name = ("state", "parameters", "inputs", "noise")[position]
        text = f"{name}[{element}]"
        return f"spread({text})" if name == "inputs" else text

    signature = (
        "static inline void step(const real *state, const real *parameters, const double *inputs,"
        " const real *noise, real *restrict out0, real *restrict out1, real *restrict out2)"
    )
    return "\n".join(
        [
            defines,
            _resource("lanes.h"),
            "static inline real spread(double x);",
            printed(step, signature, of_step),
            *_measures(width),
            _KEEP,
            _resource("kernel.c"),
        ]
    )


_KEEP = """
#define WIDTH (1 + DIRECTIONS)
static inline void keep_larger(real *held, const real *value, int stride, real counts)
{
    const mask better = (value[0] > held[0]) & (counts > 0.0);
    for (int d = 0; d < WIDTH; d++) held[d] = chosen(better, value[d * stride], held[d]);
}
static inline void keep_smaller(real *held, const real *value, int stride, real counts)
{
    const mask better = (value[0] < held[0]) & (counts > 0.0);
    for (int d = 0; d < WIDTH; d++) held[d] = chosen(better, value[d * stride], held[d]);
}
#undef WIDTH
"""


def _measures(width: int) -> list[str]:
    """Return the increments of the metrics with their tangents, with and without a sign change."""
    names = ("before", "now", "slope", "rate")
    texts = []
    for name, crossing in (("measure", False), ("measure_crossing", True)):
        values = [ca.SX.sym(f"{n}_value") for n in names]
        seeds = [ca.SX.sym(f"{n}_tangent", width - 1) for n in names]
        start, length = ca.SX.sym("start"), ca.SX.sym("length")
        before, now, slope, rate = values
        program = metrics_program(crossing)
        sums = ca.vertcat(*program.casadi(before, now, slope, rate, start, length))
        out = [sums]
        if width > 1:
            moved = ca.jtimes(sums, ca.vertcat(*values), ca.vertcat(*[s.T for s in seeds]))
            out.append(ca.vec(moved))
        inputs = [ca.vertcat(v, s) for v, s in zip(values, seeds, strict=True)]
        function = ca.Function(name, [*inputs, start, length], [ca.vertcat(*out)])

        def read(position: int, element: int) -> str:
            if position < len(names):
                return f"{names[position]}[{element}]"
            return f"spread({('start', 'length')[position - len(names)]})"

        arrays = ", ".join(f"const real *{n}" for n in names)
        head = f"static inline void {name}({arrays}, double start, double length, real *out0)"
        texts.append(printed(function, head, read))
    return texts


def _resource(name: str) -> str:
    return (resources.files("maglev_design.simulate") / name).read_text("utf-8")


def figures_count(directions: int) -> int:
    """Return how many numbers the kernel gives for each loop."""
    return PARTS + len(SCALARS) + len(TANGENTS) * directions


@cache
def _machine() -> str:
    """Return what the compiled code depends on besides its text."""
    path = compiler() or ""
    version = subprocess.run(  # noqa: S603 - the system's compiler
        [path, "-march=native", "-Q", "--help=target"], capture_output=True, text=True, check=False
    )
    named = subprocess.run([path, "--version"], capture_output=True, text=True, check=False)  # noqa: S603
    return "\n".join((platform.machine(), version.stdout, named.stdout, " ".join(FLAGS)))


def compile_library(text: str) -> Path | None:
    """Return the shared library of a C text, from the cache or made now; None when it fails.

    Two processes that compile the same text at once both succeed: each writes a file of its own
    and renames it. A library that does not match the hash beside it is made anew.
    """
    path = compiler()
    if path is None:
        return None
    key = hashlib.sha256(f"{text}\n{_machine()}".encode()).hexdigest()[:32]
    folder = cache_folder()
    library, proof = folder / f"{key}.so", folder / f"{key}.sha256"
    try:
        if library.exists() and proof.read_text("ascii") == _digest(library):
            return library
    except OSError:
        pass  # no proof beside it, or not readable: made anew below
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as work:
            made, written = Path(work) / "loop.so", Path(work) / "loop.c"
            written.write_text(text, "utf-8")
            done = subprocess.run(  # noqa: S603 - the system's compiler on our own text
                [path, *FLAGS, "-shared", "-fPIC", "-o", str(made), str(written), "-lm"],
                capture_output=True,
                check=False,
            )
            if done.returncode:
                return None
            (Path(work) / "proof").write_text(_digest(made), "ascii")
            made.replace(library)
            (Path(work) / "proof").replace(proof)
    except OSError:
        return None
    return library


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@dataclass(frozen=True)
class Kernel:
    """A compiled loop: the library's function and what its arrays look like."""

    run: Any
    lanes: int


@lru_cache(maxsize=256)
def _loaded(text: str) -> Any:
    library = compile_library(text)
    if library is None:
        return None
    function = ctypes.CDLL(str(library)).run
    doubles = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    bytes_, words = (np.ctypeslib.ndpointer(t, flags="C_CONTIGUOUS") for t in (np.uint8, np.uint32))
    function.argtypes = [
        ctypes.c_int64,
        ctypes.c_int64,
        doubles,
        doubles,
        bytes_,
        doubles,
        doubles,
        words,
        doubles,
        ctypes.c_int,
        doubles,
        ctypes.c_void_p,
    ]
    function.restype = None
    return function


@lru_cache(maxsize=64)
def kernel(loop: LoopGraph, lanes: int = LANES) -> Kernel | None:
    """Return the compiled kernel of a loop; None where there is no compiler."""
    if compiler() is None:
        return None
    function = _loaded(source(loop, lanes))
    return None if function is None else Kernel(function, lanes)


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
) -> tuple[Array, Array | None]:
    """Run n loops; return their figures, shape (n, N_FIGURES), and the trace of a single one.

    Parameters
    ----------
    first, parameters : array, shape (n, size)
        State at t = 0 and parameters, tangents behind.
    stream : array of uint32, shape (n, 2)
        Seed and scenario of the noise.
    deviation : array, shape (n, 2)
        Standard deviations of input and position noise.
    trace : bool
        Return gap, velocity, commanded and applied voltage after every step, shape (n, steps, 4).
    threads : int
        Cores; the result does not depend on it.
    """
    count, lanes = len(first), found.lanes
    blocks = -(-count // lanes)
    steps = len(loop.times) - 1
    inputs, starts, parts = loop.tables

    def laned(rows: NDArray[Any]) -> NDArray[Any]:
        """Return (n, size) as (blocks, size, lanes), the last loop repeated to fill a block."""
        filled = np.concatenate([rows, np.repeat(rows[-1:], blocks * lanes - count, axis=0)])
        ordered = filled.reshape(blocks, lanes, -1).transpose(0, 2, 1)
        return _aligned(ordered)

    arrays = [laned(a) for a in (parameters, first, stream, deviation)]
    size = figures_count(loop.directions)
    figures = _aligned(np.zeros((blocks, size, lanes)))
    traces = _aligned(np.zeros((blocks, steps, 4, lanes))) if trace else None

    def work(begin: int, end: int) -> None:
        pointer = None if traces is None else traces[begin:end].ctypes.data
        cut = [a[begin:end] for a in arrays]
        found.run(
            end - begin, steps, inputs, starts, parts, *cut, int(noisy), figures[begin:end], pointer
        )

    edges = np.linspace(0, blocks, min(threads, blocks) + 1).astype(int)
    if len(edges) == 2:
        work(0, blocks)
    else:
        with ThreadPoolExecutor(len(edges) - 1) as pool:
            list(pool.map(work, edges[:-1].tolist(), edges[1:].tolist()))
    flat = figures.transpose(0, 2, 1).reshape(-1, size)[:count]
    if traces is None:
        return flat, None
    return flat, traces.transpose(0, 3, 1, 2).reshape(-1, steps, 4)[:count]


def _aligned(values: NDArray[Any]) -> NDArray[Any]:
    """Return a contiguous copy that starts where a vector register may be loaded."""
    room = np.empty(values.nbytes + 64, dtype=np.uint8)
    shift = -room.ctypes.data % 64
    copy = room[shift : shift + values.nbytes].view(values.dtype).reshape(values.shape)
    copy[...] = values
    return copy
