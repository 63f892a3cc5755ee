"""What a design promises, computed again from the coefficients that were exported.

No gain, pole or reading is looked at: the plants are those of the record's family, the controller
is the difference equation that runs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from maglev_design.controller import design as designs
from maglev_design.controller.data import design_as_data
from maglev_design.controller.plant import (
    path_gaps,
)
from maglev_design.errors import InputError
from maglev_design.exporting.behaviour import Progress, apart, longest_delay
from maglev_design.exporting.controller import ExportedController
from maglev_design.exporting.linear import ExportedLoop, PlantAtRest
from maglev_design.exporting.loops import ExportedRun, NewDevice, close
from maglev_design.exporting.verdict import Check
from maglev_design.programs import sampled_core_program
from maglev_design.record import DesignRecord
from maglev_design.simulation import (
    Metrics,
    Scenario,
    loop_for,
    mirrored,
    nominal_scenario,
    simulate_batch,
)
from maglev_design.tuning.problem import NOISE_SEEDS

SAME = 1e-6
"""Largest relative difference between a promised figure and the one that is found."""
RATIOS = 13
"""Of the scan for the worst plant, ends included."""
GAPS, COARSE_RATIOS = 9, 5
"""Of the scan for the largest |S|."""
SHARES = np.linspace(0.0, 0.999, 10)
"""Of the promised delay, at which the poles are looked at. The promise is phase margin over
frequency, a fourth figure of which may be missing where a part of a period is held."""
CONSISTENT = 1e-9
"""Relative difference to which U, Y and the force constant beta_c must belong together."""


@dataclass(frozen=True)
class FamilyTrial:
    """One plant of the family and one way to run: beta_c/beta at the rig's y0, the rest fixed."""

    ratio: float
    gap_offset: float
    flipped: bool = False
    index: int | None = None


@dataclass(frozen=True)
class PromiseSubject:
    """The exported controller and the plants that its promises speak of."""

    controller: ExportedController

    @property
    def document(self) -> dict[str, Any]:
        """What the exported ``design.json`` says."""
        return self.controller.record.document

    @property
    def exported(self) -> designs.Design:
        """The controller that the difference equation in ``design.json`` makes."""
        design, k = self.controller.record.design, self.document["difference_equation"]
        return replace(
            design,
            Y=k["Y"],
            believed=replace(design.believed, U=k["U"]),
            coefficients={name: k[name] for name in design.coefficients},
        )

    @property
    def ratios(self) -> tuple[float, float]:
        """Ends of beta_c/beta at the rig's y0."""
        low, high = self.document["family"]["ratios"]
        return low, high

    @property
    def gap_offsets(self) -> tuple[float, ...]:
        """The rig's y0 and the ends of its interval [m]."""
        own = self.controller.record.rig.plant.gap_offset
        return tuple(dict.fromkeys((own, *self.document["family"]["gap_offsets"])))

    def ratio_of(self, ratio: float, gap_offset: float) -> float:
        """Return beta_c/beta of the plant with another y0.

        Where the plants are known by the voltage that holds the ball at Y, beta = g Z^q/U^p.
        """
        if not self.document["family"]["voltage_held"]:
            return ratio
        gap, plant = self.controller.record.design.Y, self.controller.record.rig.plant
        fall = plant.gap_exponent or 2
        return ratio * ((gap + plant.gap_offset) / (gap + gap_offset)) ** fall

    def beta(self, ratio: float, gap_offset: float) -> float:
        """Return a plant's beta [m^3/(s^2 V^2)]."""
        return self.controller.record.design.believed.beta / self.ratio_of(ratio, gap_offset)

    def scenario(self, trial: FamilyTrial) -> Scenario:
        """Return the closed loop of a trial."""
        rig = self.controller.record.rig
        scenario = nominal_scenario(rig, self.beta(trial.ratio, trial.gap_offset))
        if trial.flipped:
            scenario = mirrored(rig, scenario)
        if trial.gap_offset != rig.plant.gap_offset:
            scenario = replace(scenario, gap_offset=trial.gap_offset)
        if trial.index is None:
            return scenario
        return replace(scenario, noise=True, seed=self.document["seed"], index=trial.index)

    def ways(self) -> Iterator[FamilyTrial]:
        """Yield the ways to run, each on the plant of ratio 1."""
        for offset in self.gap_offsets:
            yield FamilyTrial(1.0, offset)
            if self.document["scenarios"] == "robust":
                yield FamilyTrial(1.0, offset, flipped=True)
                for n in range(NOISE_SEEDS):
                    yield FamilyTrial(1.0, offset, bool(n % 2), n)

    def linear(
        self, gap: float, ratio: float, gap_offset: float, more_delay: float = 0.0
    ) -> ExportedLoop:
        """Return the linearised loop at a gap, with some more delay [s]."""
        rig, k = self.controller.record.rig, self.document["difference_equation"]
        design = self.controller.record.design
        core = sampled_core_program(design.method, design.controller)
        plant = PlantAtRest(rig, self.beta(ratio, gap_offset), gap_offset, gap)
        return ExportedLoop(core, k, plant, k["period"], rig.sampling.delay + more_delay)

    def corners(self) -> Sequence[tuple[float, float, float]]:
        """Return (gap, ratio, y0) at the ends of the family, each once."""
        gaps = self.document["family"]["gaps"]
        return list(dict.fromkeys(itertools.product(gaps, self.ratios, self.gap_offsets)))


def promises(controller: ExportedController, new: NewDevice, report: Progress) -> list[Check]:
    """Return one check for each figure that a design promises of its family."""
    subject = PromiseSubject(controller)
    checks = [one_controller(subject), believed_plant(subject), covered(subject)]
    if not checks[0].passed:
        return checks
    report("promises: worst case", 0.75)
    checks += worst_case(subject, new)
    report("promises: sensitivity", 0.8)
    checks += [peak_sensitivity(subject, n) for n in (0, 1)]
    report("promises: delay", 0.85)
    if subject.document["margins"]["delay_s"]["value"] is not None:
        checks += delays(subject, new)
    report("promises: certificate", 0.9)
    return [*checks, *certificate(controller)]


def one_controller(subject: PromiseSubject) -> Check:
    """Compare the controller's name and numbers wherever the record states them."""
    record, document = subject.controller.record, subject.document
    design, numbers = record.design, subject.controller.numbers
    low, high = design.voltage_limits
    told = document["difference_equation"]
    fixed = {"period": numbers["T"], "Y": design.Y, "U": design.believed.U}
    fixed |= {"u_min": numbers["u_min"], "u_max": numbers["u_max"], **design.coefficients}
    path = record.rig.reference
    places = {
        "difference_equation": told == fixed,
        "gains": document["gains"] == design.named_gains,
        "controller_sha256": document["controller_sha256"] == design.sha256,
        "design": document["design"] == design_as_data(design),
        "voltage range": (low, high) == (numbers["u_min"], numbers["u_max"]),
        "period": design.period == numbers["T"],
        "reference": design.reference
        == (path.start_gap, path.end_gap, path.start_time, path.end_time),
    }
    wrong = [name for name, same in places.items() if not same]
    note = f"of another controller: {', '.join(wrong)}" if wrong else design.sha256[:16]
    return Check.below("one controller in every place", len(wrong), 0, "places", note)


def believed_plant(subject: PromiseSubject) -> Check:
    """Compare beta_c, from which ratios count, with what U and Y or the rig's K, C, m imply."""
    rig, design = subject.controller.record.rig, subject.controller.record.design
    implied = designs.believed_equilibrium(rig, "measured", voltage=design.believed.U).beta
    beta = design.believed.beta
    off = min(abs(beta / known - 1) for known in (implied, designs.plant_beta(rig)))
    return Check.below("beta_c is that of U and Y, or of K, C and m", off, CONSISTENT)


def covered(subject: PromiseSubject) -> Check:
    """Check that the family holds every gap of the path, the initial gap and Y, and ratio 1."""
    low, high = subject.document["family"]["gaps"]
    first, last = path_gaps(subject.controller.record.rig, 2)[[0, -1]]
    weak, strong = subject.ratios
    missed = max(low - first, last - high, 0.0)
    value = 1e6 * float(missed) if weak <= 1 <= strong else math.inf
    note = f"ratios {weak:.4g} to {strong:.4g}, gaps {low:g} to {high:g} m"
    return Check.below("family covers path, initial gap and Y", value, 0, "um", note)


def worst_case(subject: PromiseSubject, new: NewDevice) -> list[Check]:
    """Return the worst objective and the extremes of the command over the family."""
    document, key = subject.document, subject.document["objective"]
    ratios = np.unique(np.linspace(*subject.ratios, RATIOS))
    trials = [replace(way, ratio=float(r)) for way in subject.ways() for r in ratios]
    runs = _runs(subject, trials)
    top = max(range(len(trials)), key=lambda n: getattr(runs[n], key))
    trial, worst = _refined(subject, trials[top], runs[top], ratios, key)
    device = ExportedRun(new())
    found = close(subject.controller, device, subject.scenario(trial))
    told = document["worst_case"]
    values = (getattr(found, key), getattr(worst, key))
    off = max(apart(value, told[key]) for value in values)
    where = (
        f"{values[0]:.6g}, promised {told[key]:.6g}; at beta_c/beta = "
        f"{subject.ratio_of(trial.ratio, trial.gap_offset):.4g}, y0 = {trial.gap_offset:g} m"
        if told[key] is not None
        else "nothing promised"
    )
    highest = max(m.peak_voltage for m in (*runs, worst))
    lowest = min(m.min_voltage for m in (*runs, worst))
    ran = max(device.commanded), min(device.commanded)
    return [
        Check.below(f"promised worst {key.upper()} of the family", off, SAME, "-", where),
        _voltage("peak", max(highest, ran[0]), told["peak_voltage"]),
        _voltage("smallest", min(lowest, ran[1]), told["min_voltage"]),
    ]


def _voltage(which: str, found: float, told: float) -> Check:
    note = f"{found:.6g} V, promised {told:.6g} V"
    return Check.below(f"promised {which} voltage", apart(found, told), SAME, "-", note)


def _runs(subject: PromiseSubject, trials: Sequence[FamilyTrial]) -> list[Metrics]:
    exported = subject.exported
    loop = loop_for(subject.controller.record.rig, exported)
    scenarios = [subject.scenario(trial) for trial in trials]
    return [x.metrics for x in simulate_batch(loop, [exported] * len(trials), scenarios)]


def _refined(
    subject: PromiseSubject, trial: FamilyTrial, metrics: Metrics, ratios: Any, key: str
) -> tuple[FamilyTrial, Metrics]:
    """Return the worst ratio around the worst of the scan, and its run."""
    at = int(np.searchsorted(ratios, trial.ratio))
    if not 0 < at < len(ratios) - 1:
        return trial, metrics
    finer = minimize_scalar(
        lambda r: -getattr(_runs(subject, [replace(trial, ratio=float(r))])[0], key),
        bounds=(ratios[at - 1], ratios[at + 1]),
        method="bounded",
        options={"xatol": 1e-5 * (ratios[-1] - ratios[0])},
    )
    if -finer.fun <= getattr(metrics, key):
        return trial, metrics
    better = replace(trial, ratio=float(finer.x))
    return better, _runs(subject, [better])[0]


def peak_sensitivity(subject: PromiseSubject, more_samples: int) -> Check:
    """Return the largest |S| over gaps, ratios and y0, with whole samples of delay added."""
    name, key = "promised Ms", "ms"
    if more_samples:
        name, key = f"{name}, one more sample of delay", "ms_one_more_sample"
    late = more_samples * subject.document["difference_equation"]["period"]
    gaps, ratios = subject.document["family"]["gaps"], subject.ratios
    grid = itertools.product(
        np.unique(np.linspace(gaps[0], gaps[1], GAPS)),
        np.unique(np.linspace(*ratios, COARSE_RATIOS)),
        subject.gap_offsets,
    )
    peaks = {point: subject.linear(*point, late).peak() for point in grid}
    start = max(peaks, key=lambda point: peaks[point])
    found, told = peaks[start], subject.document["worst_case"][key]
    if math.isfinite(found):
        finer = minimize(
            lambda x: -subject.linear(x[0], x[1], start[2], late).peak(),
            start[:2],
            method="Nelder-Mead",
            bounds=(gaps, ratios),
            options={"xatol": 1e-6, "fatol": 1e-9, "maxfev": 80},
        )
        found = max(found, -float(finer.fun))
    shown = "unstable" if told is None else f"{told:.6g}"
    note = f"{found:.6g}, promised {shown}"
    return Check.below(name, apart(found, told), SAME, "-", note)


def delays(subject: PromiseSubject, new: NewDevice) -> list[Check]:
    """Return the longest delay of the linear loops, and the nonlinear loop with nearly as much.

    At every corner of the family and at the point that the record names.
    """
    margin = subject.document["margins"]["delay_s"]
    promised = margin["value"]
    named = (margin["gap"], margin["ratio"], subject.gap_offsets[0])
    corners = list(dict.fromkeys((*subject.corners(), named)))
    radii = [
        max(subject.linear(*corner, share * promised).radius() for share in SHARES)
        for corner in corners
    ]
    note = f"largest modulus of a pole, up to {1e3 * promised:.3g} ms"
    linear = Check.below("promised delay, linear loop at every corner", max(radii), 1, "-", note)
    linear = replace(linear, passed=linear.value < 1)
    runs = []
    for gap, ratio, offset in corners:
        plant = subject.beta(ratio, offset)
        runs.append(longest_delay(subject.controller, new, promised, gap, plant, offset))
    worst = max(runs, key=lambda check: check.value)
    return [linear, replace(worst, note=f"{worst.note}; worst of {len(runs)} corners")]


def certificate(controller: ExportedController) -> list[Check]:
    """Return the check of a record's certificate; none where it claims none."""
    told = controller.record.document.get("certificate")
    if not isinstance(told, dict) or told.get("certified") is not True:
        return []
    missing = certificate_check(controller.record)
    note = missing or "proved again in exact arithmetic for these coefficients"
    return [Check.below("promised certificate", int(bool(missing)), 0, "-", note)]


def certificate_check(record: DesignRecord) -> str:
    """Prove a record's certificate again; return what is missing, "" when nothing is."""
    from maglev_design.certification.lyapunov.lmi import certify_family  # noqa: PLC0415 - heavy

    document = record.document
    try:
        (found,) = certify_family(
            record.design,
            record.rig,
            beta_error=document["beta_error_given"],
            bisect=False,
            loops=("sampled",),
        )
    except InputError as error:
        return str(error)
    if not (found.certified and found.verified()):
        return found.status.value
    for name, proved in (("gaps", found.claim.gaps), ("ratios", found.claim.ratios)):
        low, high = document["certificate"].get(name) or (-math.inf, math.inf)
        if not (float(proved[0]) <= low and high <= float(proved[1])):
            return f"the proof holds for {name} {float(proved[0]):g} to {float(proved[1]):g} only"
    return ""
