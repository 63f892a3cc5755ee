from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from exported import EXACT, compiled, needs, run

from maglev_design.controller.design import reference_path
from maglev_design.exporting import export_folder
from maglev_design.exporting.controller import controller_of
from maglev_design.exporting.misra import DEVIATIONS
from maglev_design.exporting.native import library
from maglev_design.record import DesignRecord

COMPILERS = ("gcc", "clang")
PRECISIONS = {"double": (), "single": ("-DLEV_SINGLE",)}
FILES = ["lev.c", "check.c"]


@pytest.fixture(scope="module")
def folder(tuned_record: DesignRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("c")
    export_folder(tuned_record, "c", place, prefix="lev", allow_unverified=True)
    return place


def copied(folder: Path, place: Path) -> Path:
    for path in folder.iterdir():
        if path.is_file() and path.suffix in (".c", ".h", ".csv"):
            (place / path.name).write_bytes(path.read_bytes())
    return place


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("level", ["-O0", "-O3"])
def test_it_compiles_without_a_word_and_agrees_to_the_last_bit(
    folder: Path, tmp_path: Path, compiler: str, precision: str, level: str
) -> None:
    flags = (level, "-ffp-contract=off", *PRECISIONS[precision])
    program = compiled(compiler, copied(folder, tmp_path), FILES, *flags)
    words = run(tmp_path, str(program)).stdout.split()
    assert int(words[1]) > 1000
    if precision == "double":
        assert words[3] == "0"
    assert float(words[5]) < 1e-3


@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_example_holds_the_ball(folder: Path, tmp_path: Path, compiler: str) -> None:
    program = compiled(compiler, copied(folder, tmp_path), ["lev.c", "example.c"], *EXACT)
    assert run(tmp_path, str(program)).stdout.splitlines()[-1].startswith("ball held")


def test_its_own_check_notices_another_constant_and_another_order(
    folder: Path, tmp_path: Path
) -> None:
    source = (folder / "lev.c").read_text("ascii")
    changes = {
        r"d = LEV_REAL\(": "d = R(1.0) + LEV_REAL(",
        r"(const real t\d+ = U \+ t\d+);": r"\1 + R(1.0e-15);",
    }
    for old, new in changes.items():
        changed, count = re.subn(old, new, source, count=1)
        assert count == 1
        (copied(folder, tmp_path) / "lev.c").write_text(changed, "ascii")
        program = compiled("gcc", tmp_path, FILES, *EXACT)
        assert run(tmp_path, str(program), code=1).stdout.split()[3] != "0"


def test_undefined_behaviour_and_bad_memory_are_not_met(folder: Path, tmp_path: Path) -> None:
    flags = ("-O1", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover")
    program = compiled("gcc", copied(folder, tmp_path), FILES, *flags)
    assert run(tmp_path, str(program)).stderr == ""


def test_it_has_no_allocation_no_static_data_and_no_recursion(folder: Path, tmp_path: Path) -> None:
    run(copied(folder, tmp_path), needs("gcc"), "-std=c99", "-O2", "-c", "lev.c")
    symbols = [
        line.split()[-2:] for line in run(tmp_path, needs("nm"), "lev.o").stdout.splitlines()
    ]
    kinds = {kind for kind, _ in symbols}
    assert kinds <= {"T", "t", "r"}, symbols  # code and read-only constants; nothing undefined
    source = re.sub(r"/\*.*?\*/", "", (folder / "lev.c").read_text("ascii"), flags=re.DOTALL)
    assert not re.search(r"\b(for|while|do|goto|malloc|double|float)\b", source)


def test_fast_mathematics_is_refused(folder: Path, tmp_path: Path) -> None:
    done = run(copied(folder, tmp_path), needs("gcc"), "-ffast-math", "-c", "lev.c", code=1)
    assert "without -ffast-math" in done.stderr


def test_cppcheck_finds_only_the_listed_deviations_from_misra(folder: Path, tmp_path: Path) -> None:
    command = (needs("cppcheck"), "--addon=misra", "--std=c99", "--enable=style", "lev.c")
    said = run(copied(folder, tmp_path), *command).stderr
    assert set(re.findall(r"misra-c2012-([0-9.]+)", said)) == {rule for rule, _ in DEVIATIONS}
    assert not re.search(r"(error|warning):", said)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_eva_proves_it_free_of_run_time_errors_and_inside_the_voltage_range(
    folder: Path, precision: str
) -> None:
    frama_c = needs("frama-c")
    own = ["-cpp-extra-args=-DLEV_SINGLE"] if precision == "single" else []
    options = ("-eva", "-eva-precision", "3", "-eva-split-return", "full", *own)
    place = str(folder)
    said = run(folder, "env", f"PWD={place}", frama_c, *options, "proof.c", "lev.c").stdout
    assert "0 alarms generated" in said
    assert re.search(r"Assertions +8 valid +0 unknown +0 invalid", said)


def test_the_reference_generator_is_the_rigs_path_and_refuses_what_cannot_be(
    tuned_record: DesignRecord, folder: Path, tmp_path: Path
) -> None:
    path, period = tuned_record.rig.reference, tuned_record.rig.sampling.period
    program = tmp_path / "main.c"
    program.write_text(
        f"""
#include <stdio.h>
#include "lev.h"
int main(void)
{{
    lev_reference r;
    int k;
    int answers = lev_reference_init(&r, 1.0) ? 1 : 0; /* refused: out of range */
    lev_reference_init(&r, {path.start_gap!r});
    answers += lev_reference_retarget(&r, {path.end_gap!r}, 0.0, 0.001) ? 2 : 0; /* too fast */
    answers += lev_reference_retarget(&r, 0.0 / 0.0, 0.0, 1.0) ? 4 : 0;
    answers += lev_reference_retarget(&r, {path.end_gap!r}, 2.0, 1.0) ? 8 : 0;
    answers += lev_reference_retarget(&r, {path.end_gap!r}, 0.0, 1.0e300) ? 16 : 0;
    answers += lev_reference_retarget(&r, {path.end_gap!r}, {path.start_time!r}, {path.end_time!r})
                   ? 0 : 32;
    for (k = 0; k < 1000; k++) {{
        lev_point p;
        answers += (k == 200 && lev_reference_retarget(&r, 0.02, 0.0, 1.0)) ? 64 : 0; /* moving */
        answers += (k == 500) && !lev_reference_at_rest(&r) ? 128 : 0;
        answers += (k == 500) && !lev_reference_retarget(&r, {path.start_gap!r}, 0.1, 0.3)
                       ? 256 : 0;
        p = lev_reference_step(&r);
        printf("%.17g %.17g %.17g\\n", p.gap, p.velocity, p.acceleration);
    }}
    return answers;
}}
""",
        "ascii",
    )
    made = tmp_path / "main"
    flags = ("-std=c99", *EXACT, f"-I{folder}", "-o", str(made))
    run(tmp_path, needs("gcc"), *flags, "main.c", str(folder / "lev.c"))
    rows = np.array(
        [[float(x) for x in line.split()] for line in run(tmp_path, str(made)).stdout.splitlines()]
    )
    expected = reference_path(tuned_record.rig, np.arange(500, dtype=float) * period)
    assert (expected == rows[:500].T).all()
    assert rows[500, 0] == path.end_gap
    assert rows[-1, 0] == path.start_gap
    assert (rows[-1, 1:] == 0).all()


def test_two_instances_do_not_disturb_each_other(
    tuned_record: DesignRecord, folder: Path, tmp_path: Path
) -> None:
    controller = controller_of(tuned_record, "lev")
    built = library("gcc", copied(folder, tmp_path), controller, tmp_path / "lev.so")
    samples = [(0.0242 + 1e-5 * (k % 7), 0.0242, 0.0) for k in range(50)]
    with built.started() as new:
        alone = new()
        expected = [alone.step(*sample) for sample in samples]
        one, two = new(), new()
        answers = []
        for k, sample in enumerate(samples):
            answers.append(one.step(*sample))
            two.step(float("nan") if k % 2 else 0.02, 0.0242, 1.0)
    assert answers == expected


def test_it_is_a_header_for_cpp_too(folder: Path, tmp_path: Path) -> None:
    (copied(folder, tmp_path) / "main.cpp").write_text(
        '#include "lev.h"\nint main() { lev_state s; lev_init(&s); return s.status; }\n', "ascii"
    )
    run(tmp_path, needs("gcc"), "-std=c99", "-c", "lev.c")
    run(tmp_path, needs("g++"), "-Wall", "-Wextra", "-Werror", "main.cpp", "lev.o", "-o", "main")
    run(tmp_path, "./main")


def test_every_file_says_its_units(folder: Path) -> None:
    header = (folder / "lev.h").read_text("ascii")
    fields = re.findall(r"^    lev_real \w+; +/\* (.*?) \*/", header, re.MULTILINE)
    assert len(fields) == 11
    assert all(re.match(r"(m|V|s|m/s)\b", text) for text in fields)
    for a, b in itertools.pairwise(("symbol", "x1", "commanded", "a22", "gap_low")):
        assert header.index(f" {a} ") < header.index(f" {b} ")
