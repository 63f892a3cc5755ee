"""How an exported controller behaves: odd arguments, two at once, closed loops, faults."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from maglev_design.errors import VerificationError
from maglev_design.exporting.classes import wrong_answers
from maglev_design.exporting.controller import ExportedController
from maglev_design.exporting.loops import ExportedRun, FaultCase, NewDevice, close, fault_cases, fly
from maglev_design.exporting.native import compilers, library
from maglev_design.exporting.verdict import Check
from maglev_design.figures import DESCRIBED, INDICES
from maglev_design.rig import MOST_DELAYED_PERIODS, make_rig
from maglev_design.simulation import loop_for, nominal_scenario, simulate

NEARLY = 0.9
"""Share of the stated longest delay with which a nudge must still die out."""
NUDGE, SETTLING = 1e-3, 4000
"""The nudge as a share of the gap, and the samples it has to die out."""
LONGEST_DELAY = 1.0
"""[s] The longest that a rig may have."""

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


def classes_of_arguments(controller: ExportedController, new: NewDevice) -> Check:
    """Try every class of argument in every state; see :mod:`maglev_design.exporting.classes`."""
    wrong, answers = wrong_answers(controller, new, exact=True)
    return Check.below("nan, infinities, edges", wrong, 0, "answers", f"of {answers}")


def interleaved(new: NewDevice, work: Path) -> Check:
    """Run two controllers in turns on different samples; each must answer as if alone."""
    rows = [
        tuple(float(x) for x in line.split(",")[1:-3])
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


def closed_loops(controller: ExportedController, new: NewDevice, report: Progress) -> list[Check]:
    """Run the paper's tests and the faults with the exported controller."""
    record = controller.record
    beta = record.design.believed.beta
    nominal = nominal_scenario(record.rig, beta)
    noisy = replace(nominal, noise=True)
    tests = (
        ("nominal", nominal),
        ("noise", noisy),
        (f"noise, beta_c = {MISMATCH:g} beta", replace(noisy, beta_plant=beta / MISMATCH)),
    )
    checks = []
    loop = loop_for(record.rig, record.design)
    for n, (name, scenario) in enumerate(tests):
        report(f"closed loop: {name}", 0.3 + 0.05 * n)
        found = close(controller, ExportedRun(new()), scenario)
        told = simulate(loop, record.design, scenario).metrics
        checks.append(_compared(f"closed loop, {name}", found, told))
        if n == 0:
            kept = record.document["nominal"]["itae"]
            checks.append(
                Check.below(
                    "ITAE against design.json",
                    apart(found.itae, kept),
                    SAME_LOOP,
                    "-",
                    f"{found.itae:.6g} {DESCRIBED['itae'].unit}",
                )
            )
    quiet = ExportedRun(new())
    fly(controller, quiet)
    for n, case in enumerate(fault_cases(controller, len(quiet.gaps))):
        report(f"faults: {case.name}", 0.55 + 0.05 * n)
        checks.append(_fault(controller, new, case, quiet))
    return [*checks, _dead_sensor(controller, new)]


def apart(a: float, b: float | None) -> float:
    """Return the relative difference; 0 for two that are both not finite."""
    if b is None or not math.isfinite(b):
        return 0.0 if not math.isfinite(a) else math.inf
    return abs(a - b) / abs(b) if b else abs(a)


def _compared(name: str, found: Any, told: Any) -> Check:
    if found.crashed and told.crashed:
        return Check(name, True, 0.0, SAME_LOOP, note="ball lost, as simulated")
    off = max(apart(getattr(found, x), getattr(told, x)) for x in INDICES)
    note = f"ITAE {found.itae:.4g} {DESCRIBED['itae'].unit}"
    return Check.below(name, off, SAME_LOOP, "-", note)


def _fault(
    controller: ExportedController,
    new: NewDevice,
    case: FaultCase,
    quiet: ExportedRun,
) -> Check:
    """Run with a fault; the ball must be held and come back to where it is without."""
    run = ExportedRun(new(), case.fault, case.late)
    lost = fly(controller, run, case.ratio)
    if case.ratio != 1.0:
        quiet = ExportedRun(new())
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


def longest_delay(
    controller: ExportedController,
    new: NewDevice,
    delay: float,
    gap: float,
    beta: float,
    offset: float,
) -> Check:
    """Run with nearly so much further delay on one plant, at rest at a gap: errors die out."""
    record = controller.record
    data = record.rig.model_dump(exclude_none=True)
    period = record.rig.sampling.period
    longest = min(MOST_DELAYED_PERIODS * period, LONGEST_DELAY)
    data["sampling"]["delay"] = min(record.rig.sampling.delay + NEARLY * delay, longest)
    data["plant"]["gap_offset"] = offset
    data["initial"] = {"gap": gap * (1 + NUDGE)}
    ends = {"start_time": 0.0, "end_time": period, "horizon": SETTLING * period}
    data["reference"] = {"start_gap": gap, "end_gap": gap} | ends
    moved = replace(record, rig=make_rig(data, "verify"))
    run = ExportedRun(new())
    lost = fly(replace(controller, record=moved), run, beta=beta)
    left = max(abs(error) for error in run.errors[-SETTLING // 4 :]) / (NUDGE * gap)
    name = f"{NEARLY:.0%} of the longest delay, worst case"
    at = f"gap {gap:g} m, y0 {offset:g} m, beta_c/beta {record.design.believed.beta / beta:.4g}"
    note = f"{1e3 * data['sampling']['delay']:.3g} ms; share of a nudge left; {at}"
    return Check.below(name, math.inf if lost else left, 0.5, "-", note)


def _dead_sensor(controller: ExportedController, new: NewDevice) -> Check:
    """Lose the sensor for good: the coil must be switched off in time and stay so."""
    rest = controller.record.rig.reference.start_gap
    device, low = new(), controller.numbers["u_min"]
    device.step(rest, rest, 0.0)
    answers = [device.step(math.nan, rest, 0.0) for _ in range(3 * controller.hold_samples)]
    answers += [device.step(rest, rest, 0.0) for _ in range(10)]
    after = next((k for k in range(len(answers)) if answers[k:] == [low] * len(answers[k:])), 10**9)
    name = "sensor dead: off after"
    return Check.below(name, after, controller.hold_samples, "samples")


def single_precision(controller: ExportedController, new: NewDevice, work: Path) -> list[Check]:
    """Compare single precision with double, on the vectors and in closed loop."""
    compiler, n = compilers()[0], controller.numbers
    try:
        built = library(compiler, work, controller, work / "single.so", single=True)
    except VerificationError as error:
        return [Check("single precision compiles", False, 1, 0, note=str(error))]
    with built.started() as new_single:
        wrong, answers = wrong_answers(controller, new_single, exact=False)
        double, single = ExportedRun(new()), ExportedRun(new_single())
        crashed = [fly(controller, run) for run in (double, single)]
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
