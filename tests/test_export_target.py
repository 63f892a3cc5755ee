"""The exported C on an emulated Cortex-M4: the same bits, and costs that are counted."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from exported import needs, run

from maglev_design.errors import VerificationError
from maglev_design.exporting import cortex, cross, replayed
from maglev_design.exporting.controller import ExportedController, controller_of
from maglev_design.exporting.folder import files_of
from maglev_design.exporting.native import CORTEX_M4
from maglev_design.exporting.replayed import KINDS, PRECISIONS, Rows
from maglev_design.exporting.verdict import Check
from maglev_design.record import DesignRecord

HEAD = "Cortex-M4, {}: "


def tools() -> None:
    """Skip, saying why, where the processor's tools are not."""
    for tool in ("gcc", cross.CROSS_COMPILER, cross.EMULATOR):
        needs(tool)


def named(checks: tuple[Check, ...], precision: str) -> dict[str, Check]:
    """Return the checks of one precision by the rest of their names."""
    head = HEAD.format(precision)
    return {c.name.removeprefix(head): c for c in checks if c.name.startswith(head)}


@pytest.fixture(scope="module")
def controller(tuned_record: DesignRecord) -> ExportedController:
    return controller_of(tuned_record, "pid")  # as the yardstick might be called


@pytest.fixture(scope="module")
def content(controller: ExportedController) -> dict[str, bytes]:
    return files_of(controller, "c")


@pytest.fixture
def work(content: dict[str, bytes], tmp_path: Path) -> Path:
    for name, data in content.items():
        (tmp_path / name).write_bytes(data)
    return tmp_path


@pytest.fixture(scope="module")
def checks(
    controller: ExportedController,
    content: dict[str, bytes],
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Check, ...]:
    tools()
    place = tmp_path_factory.mktemp("m4")
    for name, data in content.items():
        (place / name).write_bytes(data)
    part = cortex.on_cortex_m4(controller, "gcc", place)
    assert part.skipped == ()
    return part.checks


def ran(
    controller: ExportedController, work: Path, precision: str
) -> tuple[dict[tuple[str, str], int], Rows, dict[str, int]]:
    """Build and run what is in `work`: sizes, answers, figures."""
    place = work / f"again_{len(list(work.iterdir()))}"
    place.mkdir()
    events, _ = replayed.read_events(work / "vectors.csv", precision)
    sizes = cross.build(controller.prefix, work, place, precision)
    return (sizes, *cross.emulate(place, events, precision))


@pytest.mark.parametrize("precision", PRECISIONS)
def test_every_recorded_step_has_the_same_bits(
    checks: tuple[Check, ...], content: dict[str, bytes], precision: str
) -> None:
    vectors = named(checks, precision)["vectors"]
    assert (vectors.passed, vectors.value, vectors.limit) == (True, 0, 0)
    steps = content["vectors.csv"].count(b"\nstep,")
    assert steps > 1000
    assert vectors.note.startswith(f"of {steps}, ")


def test_costs_are_figures_without_a_limit_and_single_precision_is_cheaper(
    checks: tuple[Check, ...],
) -> None:
    double, single = (named(checks, precision) for precision in ("double", "single"))
    for cost in ("code", "RAM", "a step"):
        for check in (double[cost], single[cost]):
            pid = int(check.note.rpartition("PID ")[2])
            assert check.passed
            assert check.limit is None
            assert 0 < pid < check.value
        assert single[cost].value < double[cost].value
    assert "libgcc" in double["code"].note
    assert "libgcc" not in single["code"].note  # the processor's own unit does it all
    for found in (double, single):
        ram = re.fullmatch(r"structs (\d+), stack (\d+); PID \d+", found["RAM"].note)
        assert ram is not None
        assert int(ram[1]) + int(ram[2]) == found["RAM"].value  # and nothing static
        assert found["a sample of the reference"].value > 0


def test_code_is_what_the_tool_for_it_says(controller: ExportedController, work: Path) -> None:
    tools()
    cortex.write_sources(controller, work)
    sizes, _, _ = ran(controller, work, "double")
    (place,) = work.glob("again_*")
    rows = run(place, needs("arm-none-eabi-size"), "pid.o", "plain-pid.o").stdout.splitlines()[1:]
    for row in rows:
        text, data, bss, *_, name = row.split()
        own = {section: n for (origin, section), n in sizes.items() if origin == name}
        assert sum(n for section, n in own.items() if section.startswith((".t", ".r"))) == int(text)
        assert int(data) == int(bss) == 0


@pytest.mark.parametrize("count", [1, 100])
def test_instructions_are_counted_one_by_one(
    controller: ExportedController, work: Path, count: int
) -> None:
    tools()
    cortex.write_sources(controller, work)
    source = (work / "plain-pid.c").read_text("ascii")
    costs = []
    for nops in (0, count):
        added = f'__asm__ volatile(".rept {nops}\\n\\tnop\\n\\t.endr");\n    return voltage;'
        (work / "plain-pid.c").write_text(source.replace("return voltage;", added), "ascii")
        sizes, found, figures = ran(controller, work, "single")
        costs.append(cortex.measured("pid", sizes, found, figures))
    assert costs[1].pid_most - costs[0].pid_most == count
    assert costs[1].most == costs[0].most


def test_the_stack_is_as_deep_as_what_is_put_on_it(
    controller: ExportedController, work: Path
) -> None:
    tools()
    cortex.write_sources(controller, work)
    source = (work / "plain-pid.c").read_text("ascii")
    depths = []
    for room in (64, 1064):
        added = f"volatile char room[{room}] = {{0}};\n    (void)room[0];\n    pid->last = error;"
        (work / "plain-pid.c").write_text(source.replace("pid->last = error;", added), "ascii")
        sizes, found, figures = ran(controller, work, "single")
        depths.append(cortex.measured("pid", sizes, found, figures).pid_ram)
    assert depths[1] - depths[0] == 1000


def test_a_product_and_a_sum_in_one_operation_are_found(
    controller: ExportedController, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tools()
    monkeypatch.setattr(cross, "OPTIMISED", ("-O2", "-ffp-contract=fast"))
    part = cortex.on_cortex_m4(controller, "gcc", work)
    assert named(part.checks, "double")["vectors"].passed  # there is no such operation in software
    vectors = named(part.checks, "single")["vectors"]
    assert not vectors.passed
    assert vectors.value > 0


def test_an_answer_that_was_not_recorded_is_found(
    controller: ExportedController, work: Path
) -> None:
    tools()
    text = (work / "vectors.csv").read_text("ascii")
    lines = text.splitlines()
    steps = [n for n, line in enumerate(lines) if line.startswith("step,")]
    for n, field in ((steps[10], 4), (steps[20], 3), (steps[30], 6)):
        words = lines[n].split(",")
        words[field] = repr(math.nextafter(float(words[field]), 9.0))
        lines[n] = ",".join(words)
    (work / "vectors.csv").write_text("\n".join(lines), "ascii")
    vectors = named(cortex.on_cortex_m4(controller, "gcc", work).checks, "double")["vectors"]
    assert vectors.value == 3


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("return voltage;", '__asm__ volatile("udf #0");\n    return voltage;', "fault"),
        ("pid->last = error;", "int unused;\n    pid->last = error;", "unused"),
    ],
)
def test_a_processor_that_stops_and_a_compiler_that_warns_are_failures(
    controller: ExportedController, work: Path, old: str, new: str, said: str
) -> None:
    tools()
    cortex.write_sources(controller, work)
    source = (work / "plain-pid.c").read_text("ascii")
    assert source.count(old) == 1
    (work / "plain-pid.c").write_text(source.replace(old, new), "ascii")
    with pytest.raises(VerificationError, match=said):
        ran(controller, work, "single")


def test_without_the_tools_nothing_is_checked_and_that_is_said(
    controller: ExportedController, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    part = cortex.on_cortex_m4(controller, "gcc", tmp_path)
    assert part.checks == ()
    ((name, reason),) = part.skipped
    assert "Cortex-M4" in name
    assert reason == "arm-none-eabi-gcc is not installed and qemu-system-arm is not installed"


def test_the_map_gives_every_section_to_its_object() -> None:
    text = """
Discarded input sections

 .text          0x00000000      0x111 lev.o

Linker script and memory map

 .text.lev_step
                0x00000040      0x10c lev.o
 .text          0x00000200       0x20 /usr/lib/gcc/hard/libgcc.a(_arm_muldf3.o)
 .text          0x00000220       0x10 /usr/lib/gcc/hard/libgcc.a(_arm_addsubdf3.o)
                0x00000220                __aeabi_drsub
 *fill*         0x00000230        0x4
 .bss           0x20000000        0x8 lev.o
"""
    assert cross.map_sizes(text) == {
        ("lev.o", ".text.lev_step"): 0x10C,
        ("libgcc.a", ".text"): 0x30,
        ("lev.o", ".bss"): 8,
    }


def test_an_instruction_is_a_whole_number_of_them_wherever_the_clock_stands() -> None:
    counts = np.arange(1, 3000)
    for phase in range(cross.TICK):
        ticks = (phase + counts * 2**cross.SHIFT) // cross.TICK
        assert (cross.instructions(ticks.astype(np.uint32), 0) == counts).all()


def test_events_are_what_the_vectors_say(work: Path) -> None:
    path = work / "some.csv"
    path.write_text(
        "# a comment\npath,0.02,0.01,0.0,1.0\nstep,0.1,-0.0,nan,1e300,2.0,1\nreset,0.0\n", "ascii"
    )
    events, recorded = replayed.read_events(path, "double")
    assert events["kind"].tolist() == [KINDS["path"], KINDS["step"], KINDS["reset"]]
    assert events["value"][0].tolist() == [0.02, 0.01, 0.0, 1.0, 0.0, 0.0]
    assert events["value"][1, 0] == 0.1
    assert math.copysign(1.0, events["value"][1, 1]) == -1.0
    assert math.isnan(events["value"][1, 2])
    assert recorded[1].tolist() == [1e300, 2.0, 1.0]
    path.write_text("step,1e300,0.1,-1e300,0.0,0.0,0\n", "ascii")
    events, _ = replayed.read_events(path, "single")
    assert events["value"][0].tolist() == [math.inf, float(np.float32(0.1)), -math.inf, 0, 0, 0]
    assert events.itemsize == 32


def law_and_pid(controller: ExportedController) -> Iterator[float]:
    """Yield the difference of the two linear answers to an error that grows by 1 um a sample."""
    n, pid = controller.numbers, cortex.plain_pid(controller.numbers)
    x1 = x2 = 0.0
    integral, last = pid["equilibrium"], 0.0
    for k in range(2000):
        e = 1e-6 * k
        law = n["U"] + n["c1"] * x1 + n["c2"] * x2 + n["d"] * e
        x1, x2 = x1 + n["b1"] * e, n["a22"] * x2 + n["b2"] * e
        yield law - (integral + pid["proportional"] * e + pid["derivative"] * (e - last))
        integral, last = integral + pid["integral"] * e, e


def test_the_yardstick_is_the_law_to_slow_errors(controller: ExportedController) -> None:
    apart = list(law_and_pid(controller))
    assert abs(apart[-1]) < 1e-9


def test_the_readme_says_how_it_is_built(content: dict[str, bytes]) -> None:
    readme = content["README.md"].decode("ascii")
    command = re.search(r"^arm-none-eabi-gcc (.*?)\n```", readme, re.MULTILINE | re.DOTALL)
    assert command is not None
    flags = command[1].replace("\\\n", " ").split()
    assert flags[-3:] == ["-DPID_SINGLE", "-c", "pid.c"]
    assert {*CORTEX_M4, "-ffp-contract=off", "-ffreestanding"} < set(flags)
    assert not re.search(r"\d+ (bytes|instructions)", readme)
