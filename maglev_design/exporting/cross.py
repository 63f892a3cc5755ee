"""A bare Cortex-M4 image of the exported C: cross-compiled, its map read, run by the emulator."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maglev_design.errors import VerificationError
from maglev_design.exporting.native import CORTEX_M4, OPTIMISED, WARNINGS
from maglev_design.exporting.replayed import FIGURES, Rows, answer_type, defined
from maglev_design.tools import call

CROSS_COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
SHIFT = 8
"""An emulated instruction takes 2**SHIFT ns."""
MACHINE = ("-machine", "mps2-an386", "-icount", f"shift={SHIFT}", "-nodefaults", "-nographic")
SEMIHOSTING = ("-semihosting-config", "enable=on,target=native")
TICK = 40
"""[ns] of SysTick: this machine's 25 MHz."""
MEMORY = "cortex-memory.ld"


def build(prefix: str, work: Path, place: Path, precision: str) -> dict[tuple[str, str], int]:
    """Cross-compile and link in `place`; return the bytes of every (object, section).

    Raises
    ------
    VerificationError
        When a tool says anything.
    """
    flags = (*OPTIMISED, *CORTEX_M4, *defined(prefix, precision), "-ffreestanding")
    own = ("-ffunction-sections", "-DBOARD_CORTEX_M4", "-I", str(work))
    names = (prefix, "cortex-replay", "plain-pid", "cortex-start")
    sources = [str(work / f"{name}.c") for name in names]
    objects = [f"{name}.o" for name in names]
    linked = ("-nostdlib", "-T", str(work / MEMORY), "-Wl,-Map=image.map", "-o", "image.elf")
    for command in (
        [CROSS_COMPILER, *WARNINGS, *flags, *own, "-c", *sources],
        [CROSS_COMPILER, *CORTEX_M4, *linked, *objects, "-lgcc"],
    ):
        done = call(command, place)
        said = (done.stderr + done.stdout).splitlines()
        if said or done.returncode != 0:
            telling = [line for line in said if "error:" in line] or said or ["it failed"]
            raise VerificationError(f"{CROSS_COMPILER} says: {telling[0]}")
    return map_sizes((place / "image.map").read_text("utf-8", errors="replace"))


def map_sizes(text: str) -> dict[tuple[str, str], int]:
    """Return the bytes of every (object or archive, input section) that a linker's map lists."""
    _, _, laid_out = text.partition("Linker script and memory map")
    sizes: dict[tuple[str, str], int] = {}
    for section, size, origin in re.findall(
        r"^ (\.\S+)\s+0x[0-9a-f]+\s+0x([0-9a-f]+) (\S.*)$", laid_out, re.MULTILINE
    ):
        key = (re.sub(r"\(.*\)$", "", Path(origin).name), section)
        sizes[key] = sizes.get(key, 0) + int(size, 16)
    return sizes


def emulate(place: Path, events: Rows, precision: str) -> tuple[Rows, dict[str, int]]:
    """Run ``image.elf`` in `place` on the events; return its answers and its figures.

    Raises
    ------
    VerificationError
        When the program does not come to its end.
    """
    (place / "events.bin").write_bytes(events.tobytes())
    done = call([EMULATOR, *MACHINE, *SEMIHOSTING, "-kernel", "image.elf"], place)
    if done.returncode != 0:
        said = [line for line in done.stderr.splitlines() if "warning:" not in line]
        raise VerificationError(said[0] if said else "the processor stopped on a fault")
    answers = np.frombuffer((place / "answers.bin").read_bytes(), answer_type(precision))
    figures = np.frombuffer((place / "figures.bin").read_bytes(), "<u4").tolist()
    if len(answers) != len(events):
        raise VerificationError(f"{len(answers)} answers to {len(events)} events")
    return answers, dict(zip(FIGURES, figures, strict=True))


def instructions(ticks: NDArray[np.uint32], clock: int) -> NDArray[np.int64]:
    """Return the instructions between two readings of the clock, less what a reading takes.

    Parameters
    ----------
    ticks : array
        Ticks between the two readings.
    clock : int
        Ticks between two readings with nothing between them.
    """
    counted = [np.rint(x * (TICK / 2**SHIFT)).astype(int) for x in (ticks, np.uint32(clock))]
    return np.asarray(counted[0] - counted[1])
