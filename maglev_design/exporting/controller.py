"""What is printed: the programs of one saved design and every constant with its unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from maglev_design.controller import design as designs
from maglev_design.controller.matching import only_papers_plant
from maglev_design.errors import InputError
from maglev_design.exporting.text import plain
from maglev_design.lowering import Program
from maglev_design.options import Controller
from maglev_design.programs import (
    acceleration_program,
    bumpless_program,
    peak_program,
    reference_program,
    start_program,
    step_program,
)
from maglev_design.record import DesignRecord
from maglev_design.rig import LONGEST_GAP, MOST_SAMPLES, Emulator, Rig
from maglev_design.simulation import emulated, loop_for, nominal_scenario, simulate

if TYPE_CHECKING:
    from maglev_design.symbolic.sampling import DifferenceEquation

LARGEST_ACCELERATION = 1.0e4
"""[m/s^2] Of a reference; a thousand times gravity, which only keeps the arithmetic finite."""
ROOM = 1.001
"""Factor on the bound of the lag's state, so that its invariance survives rounding."""

SIGNALS = {
    "y": ("m", "measured gap between ball and magnet"),
    "y_ref": ("m", "reference gap y*"),
    "acc_ref": ("m/s^2", "reference acceleration, second derivative of y*, positive downwards"),
}
STATES = {
    "x1": ("m s", "integral of the error, bounded by x1_max"),
    "x2": ("m s", "lagged error"),
}
OUTPUTS = {
    "commanded": ("V", "voltage before the clamp"),
    "applied": ("V", "voltage after the clamp, the answer"),
}
EMULATED_SEEDS = 5
"""Runs on the emulated rig, each with its own noise."""

_MEANINGS = {
    "Y": ("m", "gap of the equilibrium of the design"),
    "U": ("V", "voltage of that equilibrium, as the controller believes it"),
    "u_min": ("V", "lower end of the voltage range"),
    "u_max": ("V", "upper end of the voltage range"),
    "a22": ("-", "pole of the lag"),
    "b1": ("s", "error into x1"),
    "b2": ("s", "error into x2"),
    "c1": ("V/(m s)", "x1 into the voltage"),
    "c2": ("V/(m s)", "x2 into the voltage"),
    "d": ("V/m", "error into the voltage"),
    "f_y": ("V/m", "reference gap from Y into the voltage"),
    "f_a": ("V s^2/m", "reference acceleration into the voltage"),
    "x1_max": ("m s", "bound of x1"),
}


@dataclass(frozen=True)
class Constant:
    """One number of the controller: its letter, value, unit and meaning."""

    name: str
    value: float
    unit: str
    meaning: str


@dataclass(frozen=True)
class ExportedController:
    """One saved design, ready to be printed.

    Attributes
    ----------
    record : DesignRecord
    prefix : str
        What every public name and file begins with.
    step, bumpless, path, peak, plant : Program
        The sampled law; the states that command a given voltage; the rest-to-rest reference and
        its largest acceleration; the nonlinear plant of the example.
    start : tuple of float
        The law's states before the first sample.
    law_constants : tuple of Constant
        Of `step` and `bumpless`.
    guard_constants : tuple of Constant
        What a sample has to keep to be used, the period and the reference generator's limits.
    plant_constants : tuple of Constant
    hold_samples : int
        How many unusable samples in a row are bridged with the last voltage.
    most_ticks : int
        Samples until the end of a move, at most.
    state_bound : float
        |x2| never exceeds it, whatever is measured [m s].
    doubts : tuple of str
        Why it should not be switched on, whole sentences; empty when it may be.
    """

    record: DesignRecord
    prefix: str
    step: Program
    bumpless: Program
    path: Program
    peak: Program
    plant: Program
    start: tuple[float, ...]
    law_constants: tuple[Constant, ...]
    guard_constants: tuple[Constant, ...]
    plant_constants: tuple[Constant, ...]
    hold_samples: int
    most_ticks: int
    state_bound: float
    doubts: tuple[str, ...] = ()

    @property
    def equation(self) -> DifferenceEquation:
        """The symbolic difference equation behind `step`."""
        from maglev_design.programs import derived  # noqa: PLC0415 - imports SymPy

        return derived.equation(self.record.design.method, self.record.design.controller)

    @property
    def numbers(self) -> dict[str, float]:
        """Every constant of the law and of the guards by its name."""
        return {c.name: c.value for c in (*self.law_constants, *self.guard_constants)}


def controller_of(record: DesignRecord, prefix: str) -> ExportedController:
    """Return the controller of a record.

    Raises
    ------
    InputError
        When the voltage range has no upper end, when the controller's own lag is unstable at
        this period, or when a number does not fit the targets.
    """
    rig, design = record.rig, record.design
    only_papers_plant(rig, "export", design.controller)
    _check_law(design.controller)
    low, high = rig.limits.voltage
    if not math.isfinite(high):
        raise InputError(
            "limits.voltage: the range has no upper end; an exported controller drives a coil and "
            "needs the actuator's range: add it to the rig file, [limits] voltage = [low, high] "
            "in V, and tune again"
        )
    fixed = {"Y": design.Y, "U": design.believed.U, "u_min": low, "u_max": high}
    fixed |= dict(design.coefficients)
    if not abs(fixed["a22"]) < 1:
        raise InputError(
            f"method = {design.method!r}: at T = {rig.sampling.period:g} s the controller's own "
            f"lag has its pole at {fixed['a22']:g}, outside the unit circle, so that a stuck "
            "sensor could drive its state out of all bounds; tune with --method tustin or zoh, or "
            "with a shorter period"
        )
    for name, value in fixed.items():
        if not math.isfinite(value):
            raise InputError(f"design: {name} = {value!r} is not a finite number; tune again")
    guards = _guards(rig)
    reach = guards["gap_high"].value - guards["gap_low"].value
    return ExportedController(
        record=record,
        prefix=prefix,
        step=step_program(design.method, design.controller),
        bumpless=bumpless_program(design.method, design.controller),
        path=reference_program(),
        peak=peak_program(),
        plant=acceleration_program(),
        start=_start(record),
        law_constants=tuple(Constant(name, fixed[name], *_MEANINGS[name]) for name in fixed),
        guard_constants=tuple(guards.values()),
        plant_constants=(
            Constant("g", rig.plant.gravity, "m/s^2", "gravitational acceleration"),
            Constant("beta", designs.plant_beta(rig), "m^3/(s^2 V^2)", "K C^2/m of the plant"),
            Constant("y0", rig.plant.gap_offset, "m", "magnetic offset of the gap"),
        ),
        hold_samples=_hold_samples(rig),
        most_ticks=MOST_SAMPLES,
        state_bound=ROOM * abs(fixed["b2"]) * reach / (1 - abs(fixed["a22"])),
        doubts=doubts(record),
    )


def _check_law(law: Controller) -> None:
    """Raise `InputError` for a law that the targets have no words for."""
    if law.name == "tan-gpi" or (law.name == "lin-pid" and law.derivative != "measurement"):
        if law.start == "kick":
            return
        raise InputError(
            "controller: lin-pid with a bumpless start is not exported: its first step differs "
            "from all others; make the design with --start kick"
        )
    raise InputError(
        f"controller = {law.name}{f' ({law.variant})' if law.variant else ''}: not exported; "
        "what can be is tan-gpi, and lin-pid with the derivative of the error"
    )


def _start(record: DesignRecord) -> tuple[float, ...]:
    """Return the law's states before the first sample; a saved design starts from zeros."""
    program = start_program(record.design.controller)
    known = dict.fromkeys(SIGNALS, 0.0) | {"Y": record.design.Y} | record.design.named_gains
    return program.scalar()(*[known[name] for name in program.inputs])


def _guards(rig: Rig) -> dict[str, Constant]:
    """Return the range of a usable sample, the period and the limit of a move."""
    path = rig.reference
    ends = (path.start_gap, path.end_gap, path.start_time, path.end_time)
    (own,) = peak_program().scalar()(*ends)
    low, high = rig.limits.gap
    rows = (
        Constant("T", rig.sampling.period, "s", "sampling period"),
        Constant("gap_low", low, "m", "smallest gap that is taken for a measurement"),
        Constant("gap_high", min(high, LONGEST_GAP), "m", "largest such gap"),
        Constant("acc_max", LARGEST_ACCELERATION, "m/s^2", "largest reference acceleration"),
        Constant(
            "move_max",
            max(rig.plant.gravity, own),
            "m/s^2",
            "largest acceleration of a move that the reference generator accepts",
        ),
    )
    return {row.name: row for row in rows}


def _hold_samples(rig: Rig) -> int:
    """Return the unusable samples in a row that are bridged.

    As many as fit into the time in which the ball alone moves off by a factor e at the smallest
    gap of the path, 1/sqrt(C_Y): beyond it the held voltage belongs to another gap.
    """
    smallest = float(designs.path_gaps(rig, 2)[0])
    rest = designs.true_equilibrium(rig, designs.plant_beta(rig), smallest)
    return max(1, math.floor(1 / (math.sqrt(rest.C_Y) * rig.sampling.period)))


def promise(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a record says of its own loop: the figures that an export is held to."""
    certificate = document.get("certificate")
    certified = isinstance(certificate, dict) and certificate.get("certified") is True
    verified = document["verification"].get("passed") is True
    return {
        "verified": verified,
        "certified": certified,
        "nominal": document["nominal"],
        "worst_case": document["worst_case"],
        "margins": document["margins"],
    }


def doubts(record: DesignRecord) -> tuple[str, ...]:
    """Return why a record should not be switched on, in whole sentences; empty when it may be."""
    document = record.document
    said = promise(document)
    found = []
    if not said["verified"]:
        found.append("The independent re-simulation of this design failed.")
    if not said["certified"]:
        found.append("This design has no stability certificate.")
    broken = [plain(str(c["name"])) for c in document["constraints"] if not c["satisfied"]]
    if document.get("status") == "judged" and broken:
        found.append(f"This controller breaks a limit: {', '.join(broken)}.")
    if document.get("status") in ("infeasible", "interrupted"):
        found.append(f"The tuning ended as {document['status']}.")
    lost, seeds = lost_on_the_emulated_rig(record)
    if lost:
        found.append(f"On the rig's own [emulator] it loses the ball in {lost} of {seeds} seeds.")
    return tuple(found)


def lost_on_the_emulated_rig(record: DesignRecord) -> tuple[int, int]:
    """Return in how many seeds, and of how many, the ball is lost on the emulated rig.

    As the record says; where it does not and the rig has an emulator, it is run.
    """
    told = record.document.get("emulated")
    if isinstance(told, dict):
        return int(told["lost"]), int(told["seeds"])
    rig = emulated_at_own_period(record.rig)
    if rig is None:
        return 0, 0
    loop = loop_for(rig, record.design, emulate=True)
    start = nominal_scenario(rig, record.design.believed.beta)
    runs = [
        simulate(loop, record.design, replace(start, noise=True, seed=seed)).metrics
        for seed in range(EMULATED_SEEDS)
    ]
    return sum(run.crashed for run in runs), EMULATED_SEEDS


def emulated_at_own_period(rig: Rig) -> Rig | None:
    """Return the emulated rig at the design's own period; None where it has no effects."""
    effects = rig.emulator.model_copy(update={"period": None})
    if effects == Emulator():
        return None
    return emulated(rig.model_copy(update={"emulator": effects}))
