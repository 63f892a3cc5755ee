"""The exported C on a Cortex-M4: cross-compiled, emulated, compared with the host, measured.

The processor replays the recorded vectors without a C library or an operating system; files go in
and out by semihosting. In double precision (software on this processor) its answers must be those
of the vectors, in single precision (hardware) those of the host's single precision, every bit.

Instructions are counted, not estimated: the emulator takes the same virtual time for each, 256 ns,
of which the processor's own clock (SysTick, 40 ns) resolves every one. They are instructions, not
cycles: a memory with wait states, divisions and branches cost more than one. Code and static RAM
are those of the linker's map; the stack is painted before and looked at after.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from maglev_design.errors import VerificationError
from maglev_design.exporting.controller import ExportedController
from maglev_design.exporting.cross import (
    CROSS_COMPILER,
    EMULATOR,
    MEMORY,
    build,
    emulate,
    instructions,
)
from maglev_design.exporting.printing import MORE, render
from maglev_design.exporting.replayed import (
    KINDS,
    MOST_EVENTS,
    PRECISIONS,
    WIDTH,
    Rows,
    differences,
    read_events,
    replay_here,
    unlike,
)
from maglev_design.exporting.verdict import Check, Part

SOURCES = (
    "cortex-board.h",
    "cortex-replay.h",
    "cortex-replay.c",
    "cortex-start.c",
    "plain-pid.h",
    "plain-pid.c",
    MEMORY,
)
"""The hyphens keep them apart from a controller of any name."""


@dataclass(frozen=True)
class Measured:
    """What one precision costs on the processor.

    Attributes
    ----------
    code, step_code, pid_code, library_code : int
        Bytes of the controller with its reference generator, of its step alone, of the yardstick,
        and of the arithmetic that libgcc adds where the processor has none.
    structs, static, stack : int
        Bytes of RAM: of the caller's two structs, of static data, and of the deepest call.
    pid_ram : int
        Bytes of the yardstick's struct and its stack.
    most, mean : int, float
        Instructions of a step over the vectors, with its call and the loading of its arguments.
    reference_most, pid_most : int
        The same of a sample of the reference generator and of a step of the yardstick.
    """

    code: int
    step_code: int
    pid_code: int
    library_code: int
    structs: int
    static: int
    stack: int
    pid_ram: int
    most: int
    mean: float
    reference_most: int
    pid_most: int


def on_cortex_m4(controller: ExportedController, compiler: str, work: Path) -> Part:
    """Check and measure both precisions; `compiler` is the host's."""
    missing = [tool for tool in (CROSS_COMPILER, EMULATOR) if shutil.which(tool) is None]
    if missing:
        reason = " and ".join(f"{tool} is not installed" for tool in missing)
        return Part((), (("vectors, size and instructions on a Cortex-M4", reason),))
    write_sources(controller, work)
    checks: list[Check] = []
    for precision in PRECISIONS:
        try:
            checks += _precision(controller, compiler, work, precision)
        except VerificationError as error:
            name = f"Cortex-M4, {precision}: vectors"
            checks.append(Check(name, False, math.inf, 0, "rows", str(error)))
    return Part(tuple(checks))


def write_sources(controller: ExportedController, work: Path) -> None:
    """Write the replay, the yardstick and what starts the processor beside the controller."""
    numbers = {name: repr(value) for name, value in plain_pid(controller.numbers).items()}
    context = {
        "p": controller.prefix,
        "P": controller.prefix.upper(),
        "rest": repr(controller.numbers["Y"]),
        "pid": numbers,
        "most": MOST_EVENTS,
        "width": WIDTH,
        "more": [MORE[name] for name in controller.more],
    }
    for name in SOURCES:
        (work / name).write_text(render(f"cortex_m4/{name}.j2", context), "ascii")


def plain_pid(numbers: Mapping[str, float]) -> dict[str, float]:
    """Return the gains of the PID that the law is to slow errors.

    The law's lag c2 b2/(z - a22) about z = 1, to first order, and its integrator c1 b1/(z - 1),
    which give proportional, derivative and integral gain of a difference equation in samples.
    """
    lag = 1 - numbers["a22"]
    through = numbers["c2"] * numbers["b2"]
    return {
        "equilibrium": numbers["U"],
        "proportional": numbers["d"] + through / lag,
        "integral": numbers["c1"] * numbers["b1"],
        "derivative": -through / lag**2,
    }


def _precision(
    controller: ExportedController, compiler: str, work: Path, precision: str
) -> list[Check]:
    """Return the checks of one precision: the answers, then what they cost."""
    place = work / f"cortex_m4_{precision}"
    place.mkdir()
    events, recorded = read_events(work / "vectors.csv", precision)
    told = replay_here(compiler, work, controller.prefix, events, place / "host.so", precision)
    sizes = build(controller.prefix, work, place, precision)
    found, figures = emulate(place, events, precision)
    differing = differences(found, told)
    if precision == "double":
        differing |= unlike(found, events, recorded)
    m = measured(controller.prefix, sizes, found, figures)
    steps = int((events["kind"] == KINDS["step"]).sum())
    same = "as recorded" if precision == "double" else "as single precision here"
    library = f"libgcc {m.library_code} more; " if m.library_code else ""
    ram = m.structs + m.static + m.stack
    head = f"Cortex-M4, {precision}"

    def cost(name: str, value: int, unit: str, note: str) -> Check:
        return Check(f"{head}: {name}", True, value, None, unit, note)

    return [
        Check.below(f"{head}: vectors", int(differing.sum()), 0, "rows", f"of {steps}, {same}"),
        cost("code", m.code, "B", f"step alone {m.step_code}; {library}PID {m.pid_code}"),
        cost("RAM", ram, "B", f"structs {m.structs}, stack {m.stack}; PID {m.pid_ram}"),
        cost("a step", m.most, "instructions", f"at most; mean {m.mean:.0f}; PID {m.pid_most}"),
        cost("a sample of the reference", m.reference_most, "instructions", "at most"),
    ]


def measured(
    prefix: str, sizes: Mapping[tuple[str, str], int], found: Rows, figures: Mapping[str, int]
) -> Measured:
    """Return the costs, from the map and from what the processor counted."""

    def total(origin: str, *kinds: str) -> int:
        return sum(
            n for (o, section), n in sizes.items() if o == origin and section.startswith(kinds)
        )

    code = (".text", ".rodata")
    own = [f".text.{name}" for name in (f"{prefix}_step_at", "law", "usable", "in_range")]
    stepped = found[found["step_ticks"] > 0]
    clock = figures["clock"]
    steps = instructions(stepped["step_ticks"], clock)
    return Measured(
        code=total(f"{prefix}.o", *code),
        step_code=sum(sizes.get((f"{prefix}.o", section), 0) for section in own),
        pid_code=total("plain-pid.o", *code),
        library_code=total("libgcc.a", *code),
        structs=figures["state"] + figures["reference"],
        static=total(f"{prefix}.o", ".data", ".bss"),
        stack=figures["stack"],
        pid_ram=figures["pid"] + figures["pid_stack"],
        most=int(steps.max()),
        mean=float(steps.mean()),
        reference_most=int(instructions(stepped["reference_ticks"], clock).max()),
        pid_most=int(instructions(found["pid_ticks"], clock).max()),
    )
