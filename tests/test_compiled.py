"""The compiler, the cache of what it made, and the arithmetic it is given."""

from __future__ import annotations

import ctypes
import math
import os
import re
import stat
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from byhand import LAWS, SOME
from numpy.typing import NDArray
from rigs import SHORT, rig_with

from maglev_design import cache
from maglev_design.controller.design import Design, PoleSpec, make_design, plant_beta
from maglev_design.options import METHODS
from maglev_design.rig import Rig
from maglev_design.simulation import (
    Scenario,
    build,
    compiled,
    lanes,
    nominal_scenario,
    printing,
    simulate_batch,
)
from maglev_design.simulation import batch as batches
from maglev_design.simulation.noise import LARGEST_SEED, standard_normals
from maglev_design.simulation.stepping import step_function

Array = NDArray[np.float64]

AGREE = 1e-10
"""Relative: what the package states for its two back ends."""


def forget() -> None:
    """Make this process forget what it found and loaded, as if it had just started."""
    cached: list[Any] = [
        value
        for module in (cache, compiled, batches)
        for value in vars(module).values()
        if hasattr(value, "cache_clear") and value.__module__ == module.__name__
    ]
    for function in cached:
        function.cache_clear()


@dataclass(frozen=True)
class Compiler:
    """A C compiler that writes down how it was called."""

    path: Path
    log: Path

    @property
    def compilations(self) -> int:
        """How many libraries were asked for."""
        calls = self.log.read_text().splitlines() if self.log.exists() else []
        return sum("-shared" in call for call in calls)


def wrapper(folder: Path, body: str = 'exec {real} "$@"') -> Compiler:
    """Return a compiler made of the real one; `body` is what it does after its log entry."""
    real = compiled.compiler()
    assert real is not None, "the tests need a C compiler"
    path, log = folder / "logged-cc", folder / "calls"
    path.write_text(f'#!/bin/sh\necho "$*" >> "{log}"\n{body.format(real=real)}\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return Compiler(path, log)


@pytest.fixture
def cc(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Compiler]:
    """Give the test a fresh process's memory, a cache folder of its own and a logged compiler."""
    forget()
    made = wrapper(tmp_path)
    forget()
    monkeypatch.setenv("CC", str(made.path))
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "cache"))
    yield made
    forget()


def example() -> tuple[Rig, Design, Scenario]:
    rig = rig_with(SHORT)
    return rig, make_design(rig, PoleSpec.double(0.9, 50.0)), nominal_scenario(rig, plant_beta(rig))


def figure(backend: Any = "compiled") -> float:
    """Run one small loop and return its ITAE."""
    rig, design, scenario = example()
    (found,) = simulate_batch(build(rig, "tustin"), [design], [scenario], backend=backend)
    return found.metrics.itae


def libraries(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "cache").glob("*.so"))


# --- the cache -----------------------------------------------------------------------------


def test_a_loop_is_compiled_once_in_a_life(cc: Compiler, tmp_path: Path) -> None:
    first = figure()
    assert cc.compilations == 1
    assert figure() == first
    forget()  # a second process
    assert figure() == first
    assert cc.compilations == 1
    assert len(libraries(tmp_path)) == 1
    leftovers = {p.suffix for p in (tmp_path / "cache").iterdir()} - {".so", ".sha256"}
    assert leftovers <= {""}, "temporary files are removed"


def test_another_loop_is_another_library(cc: Compiler, tmp_path: Path) -> None:
    figure()
    rig, design, scenario = example()
    law = LAWS["fee-gpi"]
    loop, other = (
        build(rig, "tustin", controller=law),
        make_design(rig, design.poles, controller=law),
    )
    simulate_batch(loop, [other], [scenario], backend="compiled")
    simulate_batch(loop, [other] * 2, [scenario] * 2, backend="compiled")  # the same, filled
    assert cc.compilations == len(libraries(tmp_path)) == 2


def test_other_numbers_need_no_other_library(cc: Compiler) -> None:
    scenario = example()[2]
    for changes in ({}, {"plant.mass": 0.021, "limits.voltage": [0.0, 4.0]}):
        other = rig_with(SHORT, changes)
        design = make_design(other, PoleSpec.double(1.1, 60.0))
        simulate_batch(build(other, "tustin"), [design], [scenario], backend="compiled")
    assert cc.compilations == 1


def replaced(path: Path, content: bytes) -> None:
    """Put a new file in the place of one that this process may have mapped into its memory."""
    made = path.with_suffix(".new")
    made.write_bytes(content)
    made.replace(path)


@pytest.mark.parametrize("damage", ["cut", "bit", "empty", "gone", "proof gone", "proof wrong"])
def test_a_damaged_library_is_noticed_and_made_anew(
    damage: str, cc: Compiler, tmp_path: Path
) -> None:
    first = figure()
    (library,) = libraries(tmp_path)
    proof, whole = library.with_suffix(".sha256"), library.read_bytes()
    if damage == "cut":
        replaced(library, whole[: len(whole) // 2])
    elif damage == "bit":
        replaced(library, whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:])
    elif damage == "empty":
        replaced(library, b"")
    elif damage == "gone":
        library.unlink()
    elif damage == "proof gone":
        proof.unlink()
    else:
        proof.write_text("0" * 64)
    forget()
    assert figure() == first
    assert cc.compilations == 2
    forget()
    assert figure() == first
    assert cc.compilations == 2, "what was made anew is whole"


def test_a_compiler_of_another_version_compiles_again(cc: Compiler, tmp_path: Path) -> None:
    figure()
    forget()
    body = 'case "$*" in --version) echo another;; *) exec {real} "$@";; esac'
    os.environ.pop("CC")
    wrapper(tmp_path, body)
    os.environ["CC"] = str(cc.path)
    forget()
    figure()
    assert cc.compilations == 2


ANSWER = "void run(void) {}\nint answer(void) { return 42; }\n"
RACER = """
import sys, time
from pathlib import Path
from maglev_design.simulation import compiled

gate, text = Path(sys.argv[1]), Path(sys.argv[2]).read_text()
compiled._machine()
Path(sys.argv[3]).touch()
while not gate.exists():
    time.sleep(0.002)
library = compiled.compile_library(text)
import ctypes
print(library, ctypes.CDLL(str(library)).answer())
"""


def test_processes_that_compile_the_same_at_once_all_succeed(tmp_path: Path) -> None:
    forget()
    made = wrapper(tmp_path, 'case "$*" in *-shared*) sleep 0.4;; esac; exec {real} "$@"')
    cache = tmp_path / "cache"
    environment = os.environ | {"CC": str(made.path), "MAGLEV_DESIGN_CACHE": str(cache)}
    script, text, gate = tmp_path / "racer.py", tmp_path / "text.c", tmp_path / "gate"
    script.write_text(RACER)
    text.write_text(ANSWER)
    ready = [tmp_path / f"ready{n}" for n in range(3)]
    racers = [
        subprocess.Popen(  # noqa: S603 - our own interpreter and text
            [sys.executable, str(script), str(gate), str(text), str(mark)],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for mark in ready
    ]
    while not all(mark.exists() for mark in ready):
        assert all(r.poll() is None for r in racers)
    gate.touch()
    answers = [racer.communicate(timeout=60) for racer in racers]
    assert [racer.returncode for racer in racers] == [0, 0, 0]
    assert {err for _, err in answers} == {""}
    assert len({out for out, _ in answers}) == 1
    assert answers[0][0].split()[1] == "42"
    assert made.compilations >= 2, "they did overlap"
    assert len(list(cache.glob("*.so"))) == 1
    (proof,) = cache.glob("*.sha256")
    assert proof.read_text() == compiled._digest(proof.with_suffix(".so"))
    forget()


def test_a_library_is_the_same_wherever_it_is_made(cc: Compiler, tmp_path: Path) -> None:
    # what a second process writes over the first one's library fits the first one's proof
    digests = set()
    for name in ("one", "two"):
        os.environ["MAGLEV_DESIGN_CACHE"] = str(tmp_path / name)
        library = compiled.compile_library(ANSWER)
        assert isinstance(library, Path)
        digests.add(compiled._digest(library))
    assert len(digests) == 1


# --- without a compiler --------------------------------------------------------------------


def no_compiler(_: Path) -> str:
    return "/nonexistent"


def a_compiler_that_fails(tmp_path: Path) -> str:
    return str(wrapper(tmp_path, "exit 1").path)


def a_compiler_that_makes_nothing(tmp_path: Path) -> str:
    return str(wrapper(tmp_path, "exit 0").path)


def half_a_quotation(_: Path) -> str:
    return '"'


def a_folder(tmp_path: Path) -> str:
    return str(tmp_path)


def a_compiler_whose_words_are_no_utf_8(tmp_path: Path) -> str:
    return str(wrapper(tmp_path, "printf '\\377\\376\\n' >&2; exit 1").path)


def a_compiler_of(tmp_path: Path, text: str) -> str:
    """Return a compiler that compiles another text than it is given."""
    other = tmp_path / "other.c"
    other.write_text(text)
    given = f'case "$a" in *.c) set -- "$@" {other};; *) set -- "$@" "$a";; esac; shift'
    return str(wrapper(tmp_path, f'for a; do {given}; done; exec {{real}} "$@"').path)


def a_compiler_that_forgets_run(tmp_path: Path) -> str:
    return a_compiler_of(tmp_path, "int other(void) { return 0; }\n")


def a_compiler_whose_code_crashes(tmp_path: Path) -> str:
    return a_compiler_of(tmp_path, "#include <stdlib.h>\nvoid run(void) { abort(); }\n")


def a_compiler_whose_code_exits(tmp_path: Path) -> str:
    return a_compiler_of(tmp_path, "#include <stdlib.h>\nvoid run(void) { exit(3); }\n")


@pytest.mark.parametrize(
    "chosen",
    [
        no_compiler,
        half_a_quotation,
        a_folder,
        a_compiler_that_fails,
        a_compiler_whose_words_are_no_utf_8,
        a_compiler_that_makes_nothing,
        a_compiler_that_forgets_run,
        a_compiler_whose_code_crashes,
        a_compiler_whose_code_exits,
    ],
)
def test_without_a_compiler_loops_are_interpreted_and_that_is_said_once(
    chosen: Callable[[Path], str],
    cc: Compiler,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    expected = figure()
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "another"))
    monkeypatch.delenv("CC")
    forget()
    monkeypatch.setenv("CC", chosen(tmp_path))
    forget()
    capfd.readouterr()
    assert figure("auto") == pytest.approx(expected, rel=AGREE)
    assert figure("auto") == pytest.approx(expected, rel=AGREE)
    out, err = capfd.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert "interpreted" in err
    assert figure("interpreted") == figure("auto")
    with pytest.raises(RuntimeError, match="compiler"):
        figure("compiled")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("slow", ["the compiler", "its code"])
def test_what_hangs_is_given_up(
    slow: str, cc: Compiler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endless = "void run(void) { for (;;) { } }\n"
    sleep = 'case "$*" in *-shared*) sleep 60;; esac'
    monkeypatch.delenv("CC")
    forget()
    body = wrapper(tmp_path, sleep).path if slow == "the compiler" else None
    monkeypatch.setenv("CC", str(body or a_compiler_of(tmp_path, endless)))
    monkeypatch.setattr(compiled, "LONGEST_COMPILATION", 1.0 if body else 60.0)
    monkeypatch.setattr(compiled, "LONGEST_TRIAL", 1.0)
    forget()
    found = compiled.compile_library(ANSWER)
    assert isinstance(found, str)
    assert "no answer in 1 s" in found
    assert not libraries(tmp_path)


def test_a_sweep_is_interpreted_where_nothing_that_is_compiled_runs(
    cc: Compiler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compiled.usable()
    monkeypatch.setenv("CC", a_compiler_that_fails(tmp_path))
    forget()
    assert compiled.compiler() is not None
    assert not compiled.usable()


def test_asked_for_or_not_interpreting_says_nothing(
    cc: Compiler, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", "/nonexistent")
    figure("interpreted")
    assert capfd.readouterr() == ("", "")


def test_a_cache_that_cannot_be_written_costs_time_alone(
    cc: Compiler,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    expected = figure()
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "file" / "cache"))
    forget()
    assert [figure(), figure()] == [expected] * 2
    assert cc.compilations == 2, "compiled all the same, once"
    (note,) = capfd.readouterr().err.splitlines()
    assert "nothing is kept" in note
    assert "MAGLEV_DESIGN_CACHE" in note


def test_a_compiler_may_have_arguments_of_its_own(
    cc: Compiler, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", f"env '{cc.path}' -DOWN")
    forget()
    assert compiled.compiler() is not None
    figure()
    assert cc.compilations == 1
    assert all(call.startswith("-DOWN ") for call in cc.log.read_text().splitlines())


def test_a_compiler_is_asked_who_it_is_once_in_a_life(cc: Compiler) -> None:
    figure()
    calls = cc.log.read_text()
    forget()
    figure()
    assert cc.log.read_text() == calls


def test_a_process_without_a_compiler_reports_and_goes_on(tmp_path: Path) -> None:
    code = textwrap.dedent("""
        import sys
        sys.path.insert(0, sys.argv[1])
        from test_compiled import figure
        print(figure("auto").hex(), figure("auto").hex())
    """)
    done = subprocess.run(  # noqa: S603 - our own interpreter and text
        [sys.executable, "-c", code, str(Path(__file__).parent)],
        env=os.environ | {"CC": "/nonexistent", "MAGLEV_DESIGN_CACHE": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert [float.fromhex(x) for x in done.stdout.split()] == [figure("interpreted")] * 2
    assert len(done.stderr.splitlines()) == 1
    assert not list(tmp_path.glob("*.so"))


# --- the noise -----------------------------------------------------------------------------


def resource(name: str) -> str:
    return (resources.files("maglev_design.simulation") / name).read_text("utf-8")


def library_of(text: str, folder: Path) -> Any:
    """Compile a C text just as a loop is and load it."""
    path = compiled.compiler()
    assert path is not None
    written, made = folder / "text.c", folder / "text.so"
    written.write_text(text)
    subprocess.run(  # noqa: S603 - the system's compiler on our own text
        [path, *compiled.FLAGS, "-shared", "-fPIC", "-o", str(made), str(written), "-lm"],
        check=True,
    )
    return ctypes.CDLL(str(made))


FILL = """
void fill(uint32_t seed, uint32_t index, uint32_t channel, int64_t steps, double *out)
{
    const word own[2] = {WORD_ZERO + seed, WORD_ZERO + index};
    for (int64_t n = 0; n < steps; n++) {
        real both[2];
        standard_normals(joined(own[0], own[0]), joined(own[1], own[1]), (uint32_t)n, both);
        ((real *)out)[n] = both[channel];
    }
}
"""


def test_the_noise_has_the_same_bits(tmp_path: Path) -> None:
    kernel = resource("kernel.c")
    start = kernel.index("static inline pair joined(")
    function = kernel[start : kernel.index("/* One block of LANES loops.")]
    text = f"#define LANES {lanes.LANES}\n{resource('lanes.h')}\n{function}{FILL}"
    fill, steps = library_of(text, tmp_path).fill, 20_000
    for seed, index, channel in ((0, 0, 0), (1, 0, 1), (3, 2, 1), (LARGEST_SEED, 77, 0)):
        out = aligned((steps, lanes.LANES))
        words = [ctypes.c_uint32(word) for word in (seed, index, channel)]
        fill(*words, ctypes.c_int64(steps), ctypes.c_void_p(out.ctypes.data))
        expected = standard_normals(seed, index, channel, steps)
        for lane in range(lanes.LANES):
            assert (out[:, lane] == expected).all()


# --- the arithmetic ------------------------------------------------------------------------

HUGE, TINY = 1.7976931348623157e308, 5e-324
NUMBERS = (0.0, -0.0, 1.0, -1.0, 0.3, -0.7, 2.5, -2.5, 1e10, -3e-9, HUGE, -HUGE, TINY, 1e-310)
INFINITE = (*NUMBERS, math.inf, -math.inf)
BINARY = [code for code, form in printing._FORMS.items() if "{1}" in form]
OTHER = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}


def operation(code: int) -> ca.Function:
    """Return the function of one operation, two inputs even where it reads one."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    value = ca.SX.binary(code, x, y) if code in BINARY else ca.SX.unary(code, x)
    return ca.Function("operation", [x, y], [value])


def lowered(functions: dict[str, ca.Function], folder: Path) -> Any:
    """Compile functions of two inputs, each with a loop over arrays in front of it."""
    parts = [f"#define LANES {lanes.LANES}", resource("lanes.h")]
    parts.append("static inline real spread(double x) { return ZERO + x; }")
    for name, function in functions.items():
        head = f"static void {name}(const real *x, const real *y, real *out0)"
        parts.append(printing.printed(function, head, lambda k, n: f"{'xy'[k]}[{n}]"))
        parts.append(
            f"void run_{name}(int64_t n, const double *x, const double *y, double *out) {{"
            " for (int64_t k = 0; k < n; k++)"
            f" {name}((const real *)x + k, (const real *)y + k, (real *)out + k); }}"
        )
    return library_of("\n".join(parts), folder)


def aligned(shape: tuple[int, int]) -> Array:
    """Return an empty array that starts where a vector register may be loaded."""
    room = np.empty(shape[0] * shape[1] + 8)
    start = -(room.ctypes.data // 8) % 8
    return room[start : start + shape[0] * shape[1]].reshape(shape)


def applied(function: Any, x: Array, y: Array) -> Array:
    blocks = len(x) // lanes.LANES
    arrays = [aligned((blocks, lanes.LANES)) for _ in range(3)]
    for room, values in zip(arrays, (x, y), strict=False):
        room[...] = values.reshape(room.shape)
    function(ctypes.c_int64(blocks), *[ctypes.c_void_p(a.ctypes.data) for a in arrays])
    return arrays[2].ravel()


def test_every_operation_is_that_of_the_interpreter(tmp_path: Path) -> None:
    functions = {f"op{code}": operation(code) for code in printing._FORMS}
    library = lowered(functions, tmp_path)
    x, y = (grid.ravel() for grid in np.meshgrid(INFINITE, INFINITE))
    for code in printing._FORMS:
        name = f"op{code}"
        codes = {functions[name].instruction_id(k) for k in range(functions[name].n_instructions())}
        assert codes == OTHER & codes | {code} or code == ca.OP_ASSIGN, "it is the operation"
        found = applied(getattr(library, f"run_{name}"), x, y)
        with np.errstate(all="ignore"):
            expected = functions[name](x[None], y[None]).full().ravel()
        assert np.array_equal(found, expected, equal_nan=True), name


def test_slopes_of_min_and_max_need_no_division(tmp_path: Path) -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    functions = {
        name: ca.Function("slope", [x, y], [ca.gradient(3 * value, x)])
        for name, value in (("of_max", ca.fmax(x, y)), ("of_min", ca.fmin(x, y)))
    }
    for function in functions.values():
        text = printing.printed(function, "void f()", lambda k, _: "xy"[k])
        assert "shared(" in text
        assert "/" not in text
    library = lowered(functions, tmp_path)
    first = np.array([1.0, 2.0, 2.0, -0.0])
    second = np.array([2.0, 1.0, 2.0, 0.0])
    for name, function in functions.items():
        expected = function(first[None], second[None]).full().ravel()
        assert set(expected) == {0.0, 1.5, 3.0}
        assert np.array_equal(applied(getattr(library, f"run_{name}"), first, second), expected)


def test_a_value_is_divided_by_once() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [x / y, (x + 1) / y, (x + 2) / y])
    text = printing.printed(function, "void f()", lambda k, _: "xy"[k])
    assert len(re.findall(r"= w\d+ / w\d+;", text)) == 1
    assert text.count("* (1.0 / w") == 2


def test_constants_keep_every_bit(tmp_path: Path) -> None:
    values = [0.0, 1 / 3, math.pi, 1e-300, -1e300, HUGE, 2.0**-1074, 1.0, -7.0, 123456789.0]
    values += [math.inf, -math.inf, math.nan]
    x = ca.SX.sym("x")
    functions = {
        f"c{n}": ca.Function("f", [x, ca.SX.sym("y")], [ca.SX(value)])
        for n, value in enumerate(values)
    }
    library, zeros = lowered(functions, tmp_path), np.zeros(lanes.LANES)
    for n, value in enumerate(values):
        found = applied(getattr(library, f"run_c{n}"), zeros, zeros)
        assert found.tobytes() == np.full(lanes.LANES, value).tobytes(), value


def test_an_operation_without_a_form_is_an_error_and_not_a_wrong_number() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(KeyError):
        printing.printed(ca.Function("f", [x], [ca.sin(x)]), "void f()", lambda *_: "x")


EMULATOR = {"emulator.inductance": 8e-3, "emulator.resistance": 4.0}
EMULATOR |= {"emulator.sensor_step": 1e-6, "emulator.actuator_step": 2e-3}


@pytest.mark.parametrize("method", [*METHODS, None])
@pytest.mark.parametrize("controller", SOME, ids=lambda c: c.name)
def test_no_loop_holds_an_operation_without_a_form(controller: Any, method: Any) -> None:
    rig = rig_with(SHORT, EMULATOR | ({"sampling.delay": 1.3e-3} if method else {}))
    for emulate in (False, True):
        loop = build(rig, method, controller=controller, directions=2, emulate=emulate)
        step = step_function(loop)
        codes = {step.instruction_id(k) for k in range(step.n_instructions())}
        assert codes - OTHER - set(printing._FORMS) == set()
        assert printing.source(loop).count("static inline void measure") == 2


def test_the_metrics_hold_no_operation_without_a_form() -> None:
    for directions in (1, 4):
        assert len(printing._measures(1 + directions)) == 2


@pytest.mark.parametrize("directions", [0, 2])
def test_the_text_compiles_without_a_warning(directions: int, tmp_path: Path) -> None:
    text = printing.source(build(rig_with(SHORT), "tustin", directions=directions))
    written, path = tmp_path / "loop.c", compiled.compiler()
    written.write_text(text)
    assert path is not None
    flags = [flag for flag in compiled.FLAGS if flag not in ("-w", "-O3")]
    done = subprocess.run(  # noqa: S603 - the system's compiler on our own text
        [path, *flags, "-O1", "-Wall", "-Wextra", "-c", "-o", str(tmp_path / "o"), str(written)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
