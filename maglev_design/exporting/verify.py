"""An exported folder, checked: whole, built, run, compared, and run again with faults."""

from __future__ import annotations

import math
import re
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from maglev_design.exporting.behaviour import (
    Progress,
    classes_of_arguments,
    closed_loops,
    interleaved,
    single_precision,
)
from maglev_design.exporting.controller import ExportedController, controller_of
from maglev_design.exporting.cortex import on_cortex_m4
from maglev_design.exporting.emulation import on_the_emulated_rig
from maglev_design.exporting.folder import read_manifest, sha256
from maglev_design.exporting.loops import NewDevice
from maglev_design.exporting.misra import DEVIATIONS
from maglev_design.exporting.native import (
    COMPILERS,
    OPTIMISED,
    SANITIZED,
    call,
    compile_c,
    compilers,
    load_library,
    sanitizes,
)
from maglev_design.exporting.printing import printed
from maglev_design.exporting.promises import promises
from maglev_design.exporting.vectors import record_vectors
from maglev_design.exporting.verdict import Check, Part, Verdict
from maglev_design.files import digest
from maglev_design.record import load


def verify_folder(folder: Path, progress: Progress | None = None) -> Verdict:
    """Check an exported folder; nothing is written into it.

    A folder that is not as it was written is not run: the first check fails and is the only one.

    Raises
    ------
    InputError
        When the folder is no export at all.
    """
    report = progress or (lambda *_: None)
    manifest = read_manifest(folder)
    whole = _whole(folder, manifest)
    if not whole.passed:
        return Verdict((whole,), (), "")
    controller = controller_of(load(folder / "design.json"), manifest["prefix"])
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        for name in manifest["files"]:
            shutil.copyfile(folder / name, work / name)
        report("vectors", 0.1)
        recorded = _recorded(controller, work)
        report("the controller's own check", 0.2)
        own = {"c": _c, "python": _python, "matlab": _matlab}[manifest["target"]](controller, work)
        other = Part() if manifest["target"] == "python" else _printed_python(controller, work)
        new = own.new or other.new
        assert new is not None  # noqa: S101 - Python is always there
        checks = [whole, _name(controller, manifest), recorded, *own.checks, *other.checks]
        report("classes of arguments", 0.3)
        checks += [classes_of_arguments(controller, new), interleaved(new, work)]
        checks += closed_loops(controller, new, report)
        checks += promises(controller, new, report)
        checks += on_the_emulated_rig(controller, new, report)
        if manifest["target"] == "c" and own.new is not None:
            report("single precision", 0.9)
            checks += single_precision(controller, new, work)
    ran = manifest["target"] if own.new else "python"
    name = controller.record.design.sha256
    return Verdict(tuple(checks), own.skipped, ran, name, controller.doubts)


def _whole(folder: Path, manifest: dict[str, Any]) -> Check:
    """Compare every file with the manifest, and the manifest with its own digest."""
    bad = [] if manifest.get("sha256") == digest(manifest, allow_nan=True) else ["manifest.json"]
    for name, told in manifest["files"].items():
        path = folder / name
        if not path.is_file():
            bad.append(f"{name} (missing)")
        elif sha256(path.read_bytes()) != told:
            bad.append(name)
    note = f"changed since it was exported: {', '.join(bad)}" if bad else ""
    return Check.below("every file as it was exported", len(bad), 0, "files", note)


def _name(controller: ExportedController, manifest: dict[str, Any]) -> Check:
    """Compare the controller and the constants that the manifest names with ``design.json``."""
    constants = (*controller.law_constants, *controller.guard_constants)
    told = {name: x["value"] for name, x in manifest["constants"].items()}
    wrong = [c.name for c in constants if told.get(c.name) != c.value]
    if manifest.get("controller_sha256") != controller.record.design.sha256:
        wrong.append("controller_sha256")
    note = ", ".join(wrong)
    return Check.below("manifest names this controller", len(wrong), 0, "entries", note)


def _recorded(controller: ExportedController, work: Path) -> Check:
    """Record the vectors anew from the simulation and compare them line by line."""
    fresh, _ = record_vectors(controller)
    stored = (work / "vectors.csv").read_text("ascii").splitlines()
    lines = fresh.splitlines()
    wrong = sum(a != b for a, b in zip(lines, stored, strict=False)) + abs(len(lines) - len(stored))
    return Check.below("vectors are those of the simulation", wrong, 0, "lines")


def _replayed(name: str, command: list[str], work: Path) -> Check:
    """Run one of the exported checks, which prints how many rows differ."""
    done = call(command, work)
    words = next((x.split() for x in done.stdout.splitlines() if x.startswith("rows ")), None)
    if words is None:
        said = (done.stderr + done.stdout).strip().splitlines()
        return Check(name, False, math.inf, 0, "rows", said[0] if said else "it said nothing")
    passed = done.returncode == 0 and int(words[1]) > 0 and int(words[3]) == 0
    return Check(name, passed, int(words[3]), 0, "rows", f"of {words[1]}")


def _c(controller: ExportedController, work: Path) -> Part:
    """Build and run the C, here and on a Cortex-M4, while the tools that only read it do so."""
    prefix = controller.prefix
    with ThreadPoolExecutor(2) as pool:
        others = [pool.submit(_analysed, prefix, work)]
        if compilers():
            others.insert(0, pool.submit(on_cortex_m4, controller, compilers()[0], work))
        parts = [_built(prefix, work), *(part.result() for part in others)]
    checks = tuple(check for part in parts for check in part.checks)
    skipped = tuple(reason for part in parts for reason in part.skipped)
    if not compilers() or any(not check.passed for check in checks):
        return Part(checks, skipped)
    library = load_library(compilers()[0], work, prefix, work / "double.so")
    return Part(checks, skipped, library.controller)


def _built(prefix: str, work: Path) -> Part:
    """Build with every compiler that is here, without a warning, and with its sanitizers."""
    found = compilers()
    if not found:
        note = f"none is installed: {' or '.join(COMPILERS)}"
        return Part((Check("a C compiler", False, 0, None, note=note),))
    absent = [name for name in COMPILERS if name not in found]
    skipped = [(f"vectors, {name}", f"{name} is not installed") for name in absent]
    builds: list[tuple[str, str, tuple[str, ...]]] = [
        (f"vectors, {name}", name, OPTIMISED) for name in found
    ]
    if sanitizes(found[0], work):
        builds.append((f"vectors, {found[0]} with its sanitizers", found[0], SANITIZED))
    else:
        skipped.append(("vectors with sanitizers", f"{found[0]} has none here"))
    checks = []
    for title, name, flags in builds:
        said = compile_c(name, work, [f"{prefix}.c", "check.c"], work / "check", *flags)
        if said:
            checks.append(Check(title, False, math.inf, 0, "rows", said.splitlines()[0]))
        else:
            checks.append(_replayed(title, ["./check"], work))
    said = compile_c(found[0], work, [f"{prefix}.c", "example.c"], work / "example", *OPTIMISED)
    checks.append(_example("example.c", ["./example"], work, said))
    return Part(tuple(checks), tuple(skipped))


def _analysed(prefix: str, work: Path) -> Part:
    """Let the tools read the source that are here."""
    checks, skipped = [], []
    for tool, missed, found_by in (
        ("cppcheck", "MISRA C:2012", _misra),
        ("frama-c", "proof of the voltage range", _proof),
    ):
        if shutil.which(tool):
            checks.append(found_by(prefix, work))
        else:
            skipped.append((missed, f"{tool} is not installed"))
    return Part(tuple(checks), tuple(skipped))


def _misra(prefix: str, work: Path) -> Check:
    """Count what cppcheck's MISRA addon finds beyond the deviations that the README lists."""
    command = ["cppcheck", "--addon=misra", "--std=c99", "--enable=style", f"{prefix}.c"]
    done = call(command, work)
    broken = re.findall(r"\[misra-c2012-([0-9.]+)\]", done.stderr)
    listed = {rule for rule, _ in DEVIATIONS}
    beyond = sorted(set(broken) - listed)
    other = re.findall(r": (?:error|warning|style): (?!misra)(.*)", done.stderr)
    failed = done.returncode != 0 or "Bailing out" in done.stderr
    value = math.inf if failed else len(beyond) + len(other)
    note = ", ".join([*beyond, *other]) or f"beyond rules {', '.join(sorted(listed))}"
    return Check.below("cppcheck with MISRA C:2012", value, 0, "findings", note)


def _proof(prefix: str, work: Path) -> Check:
    """Let frama-c's Eva prove, for finite arguments, what ``proof.c`` asserts."""
    options = ("-eva", "-eva-precision", "3", "-eva-split-return", "full")
    done = call(["frama-c", *options, "proof.c", f"{prefix}.c"], work)
    alarms = re.search(r"(\d+) alarms? generated", done.stdout)
    asserted = re.search(r"Assertions +(\d+) valid +(\d+) unknown +(\d+) invalid", done.stdout)
    name = "no run-time error, voltage in range (proof)"
    if done.returncode != 0 or alarms is None or asserted is None:
        return Check(name, False, math.inf, 0, "alarms", "frama-c gave no answer")
    proved, unknown, refuted = map(int, asserted.groups())
    note = f"{proved} of {proved + unknown + refuted} assertions proved"
    return Check.below(name, int(alarms[1]) + unknown + refuted, 0, "alarms", note)


def _example(name: str, command: list[str], work: Path, said: str = "") -> Check:
    """Run an exported example, which says whether the ball was held."""
    title = f"{name} holds the ball"
    if said:
        return Check(title, False, 1, 0, note=said.splitlines()[0])
    done = call(command, work)
    lines = [line for line in done.stdout.splitlines() if line.startswith("ball ")]
    held = done.returncode == 0 and bool(lines) and lines[-1].startswith("ball held")
    return Check(title, held, 0 if held else 1, 0, "lost", lines[-1] if lines else done.stderr[:60])


def _python(controller: ExportedController, work: Path) -> Part:
    """Run the exported check and example with this interpreter."""
    checks = (
        _replayed("vectors, Python", [sys.executable, "-B", "check.py"], work),
        _example("example.py", [sys.executable, "-B", "example.py"], work),
    )
    return Part(checks, (), python_device(work / f"{controller.prefix}.py"))


def _printed_python(controller: ExportedController, work: Path) -> Part:
    """Print the same design as Python and replay the folder's own vectors with it."""
    place = work / "as_python"
    place.mkdir()
    for name, content in printed(controller, "python", 0).items():
        (place / name).write_bytes(content)
    shutil.copyfile(work / "vectors.csv", place / "vectors.csv")
    found = _python(controller, place)
    name = "vectors, the same design as Python"
    return Part((replace(found.checks[0], name=name),), (), found.new)


def python_device(path: Path) -> NewDevice:
    """Return the class of an exported Python controller."""
    module = ModuleType(path.stem)
    exec(compile(path.read_bytes(), path.name, "exec"), module.__dict__)  # noqa: S102 - our own print, its digest checked
    new: NewDevice = module.__dict__["Controller"]
    return new


def _matlab(controller: ExportedController, work: Path) -> Part:
    """Run the exported scripts in Octave."""
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        reason = "octave is not installed"
        return Part((), (("vectors, Octave", reason), ("the example in Octave", reason)))
    command = [octave, "--no-gui", "--norc", "--quiet", "--eval"]
    prefix = controller.prefix
    return Part(
        (
            _replayed("vectors, Octave", [*command, f"{prefix}_check"], work),
            _example(f"{prefix}_example.m", [*command, f"{prefix}_example"], work),
        )
    )
