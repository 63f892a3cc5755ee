"""An exported folder, checked: printed again, compared, built, run, and run with faults."""

from __future__ import annotations

import math
import re
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from maglev_design import __version__
from maglev_design.errors import InputError, VerificationError
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
from maglev_design.exporting.folder import MANIFEST, files_of, read_manifest, sha256
from maglev_design.exporting.misra import DEVIATIONS
from maglev_design.exporting.native import (
    COMPILERS,
    OPTIMISED,
    SANITIZED,
    compile_c,
    compilers,
    library,
    sanitizes,
)
from maglev_design.exporting.printing import printed
from maglev_design.exporting.promises import promises
from maglev_design.exporting.running import Runnable
from maglev_design.exporting.text import plain
from maglev_design.exporting.verdict import Check, Part, Verdict
from maglev_design.files import digest, read_bytes
from maglev_design.record import LARGEST_RECORD, load
from maglev_design.tools import call

DATA = ("design.json", "vectors.csv")
"""What a folder is held to is never its own."""


def verify_folder(
    folder: Path, progress: Progress | None = None, *, run_untrusted: bool = False
) -> Verdict:
    """Check an exported folder; nothing is written into it, and nothing that lies in it is run.

    What runs is what this program prints from the folder's ``design.json``, once it is the same as
    the folder byte for byte: built anew, elsewhere, in processes of its own. A folder that is not
    the same is not run: the first check fails and is the only one.

    Parameters
    ----------
    folder : Path
    progress : callable, optional
        Told the stage, and the share of it that is done.
    run_untrusted : bool
        Whether the files of a folder that is not the same are run nevertheless, with all that they
        may do to this machine. The first check stays failed.

    Raises
    ------
    InputError
        When the folder is no export at all.
    """
    report = progress or (lambda *_: None)
    manifest = read_manifest(folder)
    found = _read(folder, manifest)
    changed = _changed(found, manifest)
    if changed and not run_untrusted:
        return Verdict((_same(changed, "changed since it was exported"),), (), "")
    report("printed again", 0.05)
    controller = controller_of(load(folder / "design.json"), manifest["prefix"])
    own = files_of(controller, manifest["target"])
    names = sorted(own.keys() | found.keys())
    other = [name for name in names if own.get(name) != found.get(name)]
    if other and not run_untrusted:
        return Verdict((_same(other, _unlike(manifest)),), (), "")
    same = _same(other, f"{_unlike(manifest)}; run as it is")
    run = found | {name: own[name] for name in DATA} if other else own
    name = controller.record.design.sha256
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        for file, content in run.items():
            (work / file).write_bytes(content)
        checks, skipped, ran = _ran(controller, manifest["target"], work, report)
    return Verdict((same, *checks), skipped, ran, name, controller.doubts)


def _read(folder: Path, manifest: dict[str, Any]) -> dict[str, bytes]:
    """Return the files that the manifest names, and itself; what cannot be read is left out."""
    found = {}
    for name in (*manifest["files"], MANIFEST):
        with suppress(InputError):
            found[name] = read_bytes(folder / name, LARGEST_RECORD)
    return found


def _changed(found: dict[str, bytes], manifest: dict[str, Any]) -> list[str]:
    """Return the files that are not as the manifest has them, itself by its own digest."""
    bad = [] if manifest.get("sha256") == digest(manifest, allow_nan=True) else [MANIFEST]
    for name, told in manifest["files"].items():
        if name not in found:
            bad.append(f"{name} (missing)")
        elif sha256(found[name]) != told:
            bad.append(name)
    return bad


def _unlike(manifest: dict[str, Any]) -> str:
    """Return in words why a whole folder is not what this program prints."""
    versions = manifest.get("versions")
    printer = versions.get("exporter") if isinstance(versions, dict) else None
    if printer == __version__:
        return "not what its design.json prints"
    return f"printed by version {plain(str(printer))}, this is {__version__}; export again; differs"


def _same(other: list[str], why: str) -> Check:
    note = f"{why}: {', '.join(other)}" if other else ""
    return Check.below("every file as its design.json prints it", len(other), 0, "files", note)


def _ran(
    controller: ExportedController, target: str, work: Path, report: Progress
) -> tuple[list[Check], tuple[tuple[str, str], ...], str]:
    """Build and run what lies in `work`; return checks, what was skipped and which text ran."""
    report("the controller's own check", 0.2)
    own = {"c": _c, "python": _python, "matlab": _matlab}[target](controller, work)
    checks, built = list(own.checks), own.built
    if target != "python":
        python = _printed_python(controller, work)
        checks += python.checks
        built = built or python.built
    assert built is not None  # noqa: S101 - Python is always there
    try:
        with built.started() as new:
            report("classes of arguments", 0.3)
            checks += [classes_of_arguments(controller, new), interleaved(new, work)]
            checks += closed_loops(controller, new, report)
            checks += promises(controller, new, report)
            checks += on_the_emulated_rig(controller, new, report)
            if target == "c" and own.built is not None:
                report("single precision", 0.9)
                checks += single_precision(controller, new, work)
    except VerificationError as error:
        checks.append(Check("the exported controller answers", False, 1, 0, note=str(error)))
    return checks, own.skipped, target if own.built else "python"


def _replayed(name: str, command: list[str], work: Path) -> Check:
    """Run one of the exported checks, which prints how many rows differ."""
    done = call(command, work)
    words = re.search(r"^rows (\d{1,9}) differing (\d{1,9}) ", done.stdout, re.MULTILINE)
    if words is None:
        said = (done.stderr + done.stdout).strip().splitlines()
        return Check(name, False, math.inf, 0, "rows", said[0] if said else "it said nothing")
    rows, differing = map(int, words.groups())
    passed = done.returncode == 0 and rows > 0 and differing == 0
    return Check(name, passed, differing, 0, "rows", f"of {rows}")


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
    return Part(checks, skipped, library(compilers()[0], work, controller, work / "double.so"))


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
    return Part(checks, (), Runnable.python(work / f"{controller.prefix}.py"))


def _printed_python(controller: ExportedController, work: Path) -> Part:
    """Print the same design as Python and replay the folder's own vectors with it."""
    place = work / "as_python"
    place.mkdir()
    for name, content in printed(controller, "python", 0).items():
        (place / name).write_bytes(content)
    shutil.copyfile(work / "vectors.csv", place / "vectors.csv")
    found = _python(controller, place)
    name = "vectors, the same design as Python"
    return Part((replace(found.checks[0], name=name),), (), found.built)


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
