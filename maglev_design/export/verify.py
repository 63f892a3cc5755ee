"""An exported folder, checked: whole, built, run, compared, and run again with faults."""

from __future__ import annotations

import math
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from maglev_design import design as designs
from maglev_design.export.classes import wrong_answers
from maglev_design.export.controller import Controller, controller_of, doubts
from maglev_design.export.folder import manifest_digest, printed, read_manifest, sha256
from maglev_design.export.loops import FaultCase, NewDevice, Run, close, fault_cases, fly
from maglev_design.export.misra import DEVIATIONS
from maglev_design.export.native import (
    COMPILERS,
    OPTIMISED,
    SANITIZED,
    call,
    compile_c,
    compilers,
    load_library,
    sanitizes,
)
from maglev_design.export.vectors import record_vectors
from maglev_design.record import load
from maglev_design.simulate import loop_for, nominal_scenario, simulate

Progress = Callable[[str, float], None]

SAME_LOOP = 1e-4
"""Largest relative difference of ITAE, IAE and ISE between two integrators and two quadratures,
which agree to 1e-6 on a quiet run and to a few 1e-5 where noise makes the error change sign."""
MISMATCH = 1.15
"""beta_c/beta of the paper's test 3; here the controller stays and the plant moves."""
VOLTAGE_STEPS, GAP_STEPS = 4096, 65536
"""Single precision may cost one step of a 12-bit voltage and of a 16-bit gap, no more."""
RETURN, SHARE = 1e-6, 0.05
"""How near to the run without faults the ball must be at the end of one with faults: 1 um, or this
share of the largest error without faults where that is more."""


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes
    ----------
    name : str
    passed : bool
    value : float
        What was found, in `unit`.
    limit : float or None
        What is allowed at most; None where nothing was promised and the value is for the reader.
    unit : str
    note : str
        What a person needs to know about it; empty for nothing.
    """

    name: str
    passed: bool
    value: float
    limit: float | None
    unit: str = "-"
    note: str = ""

    @classmethod
    def below(cls, name: str, value: float, limit: float, unit: str = "-", note: str = "") -> Check:
        """Return a check that passes up to `limit`; a nan does not."""
        return cls(name, value <= limit, value, limit, unit, note)


@dataclass(frozen=True)
class Verdict:
    """What became of a folder.

    Attributes
    ----------
    checks : tuple of Check
    skipped : tuple of (str, str)
        Name of a check that this machine cannot make, and the reason.
    ran : str
        Which printing of the law ran in the closed loops: the folder's own, or for MATLAB (and
        where no compiler is) Python's; empty when none did.
    doubts : tuple of str
        Why the design itself should not be switched on, whole sentences; empty when it may be.
    """

    checks: tuple[Check, ...]
    skipped: tuple[tuple[str, str], ...]
    ran: str
    doubts: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.passed for check in self.checks)


@dataclass(frozen=True)
class Part:
    """What one part of the verification found, and a way to make controllers where it runs."""

    checks: tuple[Check, ...] = ()
    skipped: tuple[tuple[str, str], ...] = ()
    new: NewDevice | None = None


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
        checks = [whole, recorded, *own.checks, *other.checks]
        report("classes of arguments", 0.3)
        checks += [_classes(controller, new), _interleaved(new, work)]
        checks += _closed_loops(controller, new, report)
        if manifest["target"] == "c" and compilers():
            report("single precision", 0.9)
            checks += _single(controller, new, work)
    ran = manifest["target"] if own.new else "python"
    return Verdict(tuple(checks), own.skipped, ran, doubts(controller.record.document))


def _whole(folder: Path, manifest: dict[str, Any]) -> Check:
    """Compare every file with the manifest, and the manifest with its own digest."""
    bad = [] if manifest.get("sha256") == manifest_digest(manifest) else ["manifest.json"]
    for name, digest in manifest["files"].items():
        path = folder / name
        if not path.is_file():
            bad.append(f"{name} (missing)")
        elif sha256(path.read_bytes()) != digest:
            bad.append(name)
    note = f"changed since it was exported: {', '.join(bad)}" if bad else ""
    return Check.below("every file as it was exported", len(bad), 0, "files", note)


def _recorded(controller: Controller, work: Path) -> Check:
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


def _c(controller: Controller, work: Path) -> Part:
    """Build with every compiler that is here, without a warning, and with its sanitizers."""
    prefix = controller.prefix
    checks: list[Check] = []
    skipped: list[tuple[str, str]] = []
    found = compilers()
    absent = [name for name in COMPILERS if name not in found]
    skipped += [(f"vectors, {name}", f"{name} is not installed") for name in absent]
    if not found:
        checks.append(Check("a C compiler", False, 0, None, note="none is installed: gcc or clang"))
        return Part(tuple(checks), tuple(skipped))
    sources = [f"{prefix}.c", "check.c"]
    builds: list[tuple[str, str, tuple[str, ...]]] = [
        (f"vectors, {name}", name, OPTIMISED) for name in found
    ]
    if sanitizes(found[0], work):
        builds.append((f"vectors, {found[0]} with its sanitizers", found[0], SANITIZED))
    else:
        skipped.append(("vectors with sanitizers", f"{found[0]} has none here"))
    for title, name, flags in builds:
        said = compile_c(name, work, sources, work / "check", *flags)
        if said:
            checks.append(Check(title, False, math.inf, 0, "rows", said.splitlines()[0]))
        else:
            checks.append(_replayed(title, ["./check"], work))
    said = compile_c(found[0], work, [f"{prefix}.c", "example.c"], work / "example", *OPTIMISED)
    checks.append(_example("example.c", ["./example"], work, said))
    for tool, missed, found_by in (
        ("cppcheck", "MISRA C:2012", _misra),
        ("frama-c", "proof of the voltage range", _proof),
    ):
        if shutil.which(tool):
            checks.append(found_by(prefix, work))
        else:
            skipped.append((missed, f"{tool} is not installed"))
    if any(not check.passed for check in checks):
        return Part(tuple(checks), tuple(skipped))
    library = load_library(found[0], work, prefix, work / "double.so")
    return Part(tuple(checks), tuple(skipped), library.controller)


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


def _python(controller: Controller, work: Path) -> Part:
    """Run the exported check and example with this interpreter."""
    checks = (
        _replayed("vectors, Python", [sys.executable, "-B", "check.py"], work),
        _example("example.py", [sys.executable, "-B", "example.py"], work),
    )
    return Part(checks, (), python_device(work / f"{controller.prefix}.py"))


def _printed_python(controller: Controller, work: Path) -> Part:
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


def _matlab(controller: Controller, work: Path) -> Part:
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


def _classes(controller: Controller, new: NewDevice) -> Check:
    wrong, answers = wrong_answers(controller, new, exact=True)
    return Check.below("nan, infinities, edges", wrong, 0, "answers", f"of {answers}")


def _interleaved(new: NewDevice, work: Path) -> Check:
    """Run two controllers in turns on different samples; each must answer as if alone."""
    rows = [
        tuple(float(x) for x in line.split(",")[1:4])
        for line in (work / "vectors.csv").read_text("ascii").splitlines()
        if line.startswith("step,")
    ]
    count = min(1000, len(rows) // 2)
    first, second = rows[:count], rows[-count:]
    alone = []
    for samples in (first, second):
        device = new()
        alone.append([device.step(*sample) for sample in samples])
    one, two = new(), new()
    wrong = 0
    for k in range(count):
        wrong += one.step(*first[k]) != alone[0][k]
        wrong += two.step(*second[k]) != alone[1][k]
    note = f"of {2 * count}"
    return Check.below("two controllers in turns", wrong, 0, "voltages", note)


def _closed_loops(controller: Controller, new: NewDevice, report: Progress) -> list[Check]:
    """Run the paper's tests and the faults with the exported controller."""
    record = controller.record
    beta = designs.plant_beta(record.rig)
    nominal = nominal_scenario(record.rig, beta)
    noisy = replace(nominal, noise=True)
    worst = replace(nominal, beta_plant=beta / record.document["worst_case"]["ratio"])
    tests = (
        ("nominal", nominal),
        ("noise", noisy),
        (f"noise, beta_c = {MISMATCH:g} beta", replace(noisy, beta_plant=beta / MISMATCH)),
        ("worst beta", worst),
    )
    checks = []
    loop = loop_for(record.rig, record.design)
    for n, (name, scenario) in enumerate(tests):
        report(f"closed loop: {name}", 0.3 + 0.05 * n)
        found = close(controller, Run(new()), scenario)
        told = simulate(loop, record.design, scenario).metrics
        checks.append(_compared(f"closed loop, {name}", found, told))
        if n == 0:
            kept = record.document["nominal"]["itae"]
            checks.append(
                Check.below(
                    "ITAE against design.json",
                    _apart(found.itae, kept),
                    SAME_LOOP,
                    "-",
                    f"{found.itae:.6g} m s^2",
                )
            )
    quiet = Run(new())
    fly(controller, quiet)
    for n, case in enumerate(fault_cases(controller, len(quiet.gaps))):
        report(f"faults: {case.name}", 0.55 + 0.05 * n)
        checks.append(_fault(controller, new, case, quiet))
    checks.append(_dead_sensor(controller, new))
    return checks


def _apart(a: float, b: float | None) -> float:
    """Return the relative difference; 0 for two that are both not finite."""
    if b is None or not math.isfinite(b):
        return 0.0 if not math.isfinite(a) else math.inf
    return abs(a - b) / abs(b) if b else abs(a)


def _compared(name: str, found: Any, told: Any) -> Check:
    if found.crashed and told.crashed:
        return Check(name, True, 0.0, SAME_LOOP, note="ball lost, as simulated")
    apart = max(_apart(getattr(found, x), getattr(told, x)) for x in ("ise", "iae", "itae"))
    note = f"ITAE {found.itae:.4g} m s^2"
    return Check.below(name, apart, SAME_LOOP, "-", note)


def _fault(
    controller: Controller,
    new: NewDevice,
    case: FaultCase,
    quiet: Run,
) -> Check:
    """Run with a fault; the ball must be held and come back to where it is without."""
    run = Run(new(), case.fault, case.late)
    lost = fly(controller, run, case.ratio)
    if case.ratio != 1.0:
        quiet = Run(new())
        fly(controller, quiet, case.ratio)
    radius = controller.record.document["worst_case"]["spectral_radius_one_more_sample"]
    promised = not case.delays or (radius is not None and radius < 1)
    off = max(abs(a - b) for a, b in zip(run.gaps, quiet.gaps, strict=False))
    value = math.inf if lost else abs(run.errors[-1] - quiet.errors[-1])
    note = f"up to {1e6 * off:.3g} um away"
    if lost:
        note = f"ball lost at sample {len(run.gaps)}"
    name = f"{case.name}"
    if not promised:
        return Check(name, True, 1e6 * value, None, "um", f"{note}; not promised")
    limit = max(RETURN, SHARE * max(abs(error) for error in quiet.errors))
    return Check.below(name, 1e6 * value, 1e6 * limit, "um", note)


def _dead_sensor(controller: Controller, new: NewDevice) -> Check:
    """Lose the sensor for good: the coil must be switched off in time and stay so."""
    rest = controller.record.rig.reference.start_gap
    device, low = new(), controller.numbers["u_min"]
    device.step(rest, rest, 0.0)
    answers = [device.step(math.nan, rest, 0.0) for _ in range(3 * controller.hold_samples)]
    answers += [device.step(rest, rest, 0.0) for _ in range(10)]
    after = next((k for k in range(len(answers)) if answers[k:] == [low] * len(answers[k:])), 10**9)
    name = "sensor dead: off after"
    return Check.below(name, after, controller.hold_samples, "samples")


def _single(controller: Controller, new: NewDevice, work: Path) -> list[Check]:
    """Compare single precision with double, on the vectors and in closed loop."""
    compiler, n = compilers()[0], controller.numbers
    library = load_library(compiler, work, controller.prefix, work / "single.so", single=True)
    wrong, answers = wrong_answers(controller, library.controller, exact=False)
    runs = Run(new()), Run(library.controller())
    crashed = [fly(controller, run) for run in runs]
    double, single = runs
    lost = crashed[1] and not crashed[0]
    volts = max(abs(a - b) for a, b in zip(double.voltages, single.voltages, strict=False))
    metres = max(abs(a - b) for a, b in zip(double.gaps, single.gaps, strict=False))
    span, reach = n["u_max"] - n["u_min"], n["gap_high"] - n["gap_low"]
    return [
        Check.below(
            "single precision: nan, infinities, edges", wrong, 0, "answers", f"of {answers}"
        ),
        Check.below(
            "single precision in closed loop: voltage",
            math.inf if lost else volts,
            span / VOLTAGE_STEPS,
            "V",
            "from double",
        ),
        Check.below(
            "single precision in closed loop: gap",
            math.inf if lost else 1e6 * metres,
            1e6 * reach / GAP_STEPS,
            "um",
            "from double",
        ),
    ]
