"""What is printed: the programs of one saved design and every constant with its unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller import design as designs
from maglev_design.controller.plant import (
    path_gaps,
    plant_numbers,
)
from maglev_design.errors import InputError
from maglev_design.exporting.text import plain
from maglev_design.lowering import Program
from maglev_design.options import Controller
from maglev_design.programs import (
    acceleration_program,
    bumpless_program,
    drive_program,
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
LARGEST_VELOCITY, LARGEST_JERK = 1.0e3, 1.0e7
"""[m/s], [m/s^3] Of a reference, likewise."""
ROOM = 1.001
"""Factor on the bound of the lag's state, so that its invariance survives rounding."""
MOST_TERMS, NOTHING = 1_000_000, 1e-6
"""Terms of the sum that bounds the states, and the share below which the rest of it counts for
nothing: a thousandth of the room that is left."""

SIGNALS = {
    "y": ("m", "measured gap between ball and magnet"),
    "y_ref": ("m", "reference gap y*"),
    "acc_ref": ("m/s^2", "reference acceleration, second derivative of y*, positive downwards"),
}
"""What every law reads at a sample."""
MORE_SIGNALS = {
    "v_ref": ("m/s", "reference velocity, first derivative of y*"),
    "jerk_ref": ("m/s^3", "third derivative of y*"),
}
"""What a law for a plant other than the paper's reads besides, in this order."""
STATES = {
    "x1": ("m s", "integral of the error, bounded by x1_max"),
    "x2": ("m s", "lagged error"),
    "x3": ("m s^2", "integral of x2, in the same second-order filter"),
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
    "a22": ("-", "x2 into x2: the pole of the lag, where there is no x3"),
    "a23": ("1/s", "x3 into x2"),
    "a32": ("s", "x2 into x3"),
    "a33": ("-", "x3 into x3"),
    "b1": ("s", "error into x1"),
    "b2": ("s", "error into x2"),
    "b3": ("s^2", "error into x3"),
    "c1": ("V/(m s)", "x1 into the voltage"),
    "c2": ("V/(m s)", "x2 into the voltage"),
    "c3": ("V/(m s^2)", "x3 into the voltage"),
    "d": ("V/m", "error into the voltage"),
    "f_y": ("V/m", "reference gap from Y into the voltage"),
    "f_v": ("V s/m", "reference velocity into the voltage"),
    "f_a": ("V s^2/m", "reference acceleration into the voltage"),
    "f_j": ("V s^3/m", "third derivative of the reference into the voltage"),
    **{
        f"s{n}": (f"V/m^{n}" if n > 1 else "V/m", f"(y* - Y)^{n} into the voltage")
        for n in range(1, 9)
    },
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
    drive : Program or None
        Rate of the current over C, where the plant has it as a state.
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
    state_bounds : mapping of str to float
        |x2| and, where there is one, |x3| never exceed these, whatever is measured [m s, m s^2].
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
    drive: Program | None
    start: tuple[float, ...]
    law_constants: tuple[Constant, ...]
    guard_constants: tuple[Constant, ...]
    plant_constants: tuple[Constant, ...]
    hold_samples: int
    most_ticks: int
    state_bounds: Mapping[str, float]
    doubts: tuple[str, ...] = ()

    @property
    def equation(self) -> DifferenceEquation:
        """The symbolic difference equation behind `step`."""
        from maglev_design.programs import derived  # noqa: PLC0415 - imports SymPy

        return derived.equation(self.record.design.method, self.record.design.controller)

    @property
    def states(self) -> dict[str, tuple[str, str]]:
        """Unit and meaning of every state of the law, by its letter."""
        own = ("x1", *self.state_bounds)
        return {name: STATES[name] for name in own}

    @property
    def more(self) -> tuple[str, ...]:
        """What the law reads besides gap, reference and acceleration."""
        return tuple(name for name in MORE_SIGNALS if name in self.step.inputs)

    @property
    def signals(self) -> dict[str, tuple[str, str]]:
        """Unit and meaning of every signal that the law reads, by its letter."""
        known = {**SIGNALS, **MORE_SIGNALS}
        return {name: known[name] for name in (*SIGNALS, *self.more)}

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
    modulus = own_modulus(fixed)
    if not modulus < 1:
        raise InputError(
            f"method = {design.method!r}: at T = {rig.sampling.period:g} s the controller's own "
            f"filter has a pole of modulus {modulus:g}, outside the unit circle, so that a stuck "
            "sensor could drive its state out of all bounds; tune with --method tustin or zoh, or "
            "with a shorter period"
        )
    for name, value in fixed.items():
        if not math.isfinite(value):
            raise InputError(f"design: {name} = {value!r} is not a finite number; tune again")
    step = step_program(design.method, design.controller)
    guards = _guards(rig, step)
    reach = guards["gap_high"].value - guards["gap_low"].value
    return ExportedController(
        record=record,
        prefix=prefix,
        step=step,
        bumpless=bumpless_program(design.method, design.controller),
        path=reference_program(3 if "jerk_ref" in step.inputs else 2),
        peak=peak_program(),
        plant=acceleration_program(rig.kind),
        drive=drive_program(rig.kind) if rig.kind.order > 2 else None,
        start=_start(record),
        law_constants=tuple(Constant(name, fixed[name], *_MEANINGS[name]) for name in fixed),
        guard_constants=tuple(guards.values()),
        plant_constants=_plant_constants(rig),
        hold_samples=_hold_samples(rig),
        most_ticks=MOST_SAMPLES,
        state_bounds=state_bounds(fixed, reach),
        doubts=doubts(record),
    )


def own_modulus(coefficients: Mapping[str, float]) -> float:
    """Return the largest modulus of a pole of the law's filter, the integrator apart."""
    return float(np.abs(np.linalg.eigvals(_filter(coefficients)[0])).max())


def _filter(k: Mapping[str, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the matrix of the states behind x1, and how the error enters them."""
    if "b3" not in k:
        return np.array([[k["a22"]]]), np.array([k["b2"]])
    return np.array([[k["a22"], k["a23"]], [k["a32"], k["a33"]]]), np.array([k["b2"], k["b3"]])


def state_bounds(k: Mapping[str, float], reach: float) -> dict[str, float]:
    """Return bounds of x2 and x3 under any errors up to `reach` [m].

    |x| <= sum over n of |A^n b| reach. The sum is taken until what is left of it, bounded by the
    norm of a power that contracts, no longer counts.
    """
    a, b = _filter(k)
    names = ("x2", "x3")[: len(b)]
    if len(b) == 1:
        return {"x2": ROOM * abs(k["b2"]) * reach / (1 - abs(k["a22"]))}
    total, moved = np.zeros(len(b)), b.astype(float)
    for _ in range(MOST_TERMS):
        total += np.abs(moved)
        moved = a @ moved
        if (np.abs(moved) < NOTHING * total).all():
            break
    return dict(zip(names, (float(x) for x in ROOM * reach * total), strict=True))


def _plant_constants(rig: Rig) -> tuple[Constant, ...]:
    """Return the numbers of the rig's nonlinear plant."""
    power = rig.kind.exponent
    unit = "m^3/(s^2 V^2)" if rig.kind.force == "inverse-square" else "SI"
    own = plant_numbers(rig)
    names = [*acceleration_program(rig.kind).inputs]
    if rig.kind.order > 2:
        names += drive_program(rig.kind).inputs
    known = dict.fromkeys(names)
    return (
        Constant("g", rig.plant.gravity, "m/s^2", "gravitational acceleration"),
        Constant("beta", designs.plant_beta(rig), unit, f"K C^{power}/m of the plant"),
        Constant("y0", rig.plant.gap_offset, "m", "magnetic offset of the gap"),
        *(Constant(name, own[name], *_OF_PLANT[name]) for name in own if name in known),
    )


_OF_PLANT = {
    "n_gap": ("-", "exponent of the gap in the force"),
    "decay": ("m", "length over which the force falls to 1/e"),
    "delta": ("1/s", "damping of the ball over its mass"),
    "L": ("H", "inductance of the coil at Y; a lag's time constant in s where R is 1"),
    "R": ("ohm", "resistance of the coil; 1 for a lag"),
    "m": ("kg", "mass of the ball"),
    "Y": ("m", "gap of the equilibrium of the design"),
    "u0": ("V", "offset of the input"),
}


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
    known = (
        dict.fromkeys((*SIGNALS, *MORE_SIGNALS), 0.0)
        | {"Y": record.design.Y}
        | record.design.named_gains
    )
    return program.scalar()(*[known[name] for name in program.inputs])


def _guards(rig: Rig, step: Program) -> dict[str, Constant]:
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
    guards = {row.name: row for row in rows}
    if "v_ref" in step.inputs:
        what = "largest reference velocity"
        guards["vel_max"] = Constant("vel_max", LARGEST_VELOCITY, "m/s", what)
    if "jerk_ref" in step.inputs:
        what = "largest third derivative of the reference"
        guards["jerk_max"] = Constant("jerk_max", LARGEST_JERK, "m/s^3", what)
    return guards


def _hold_samples(rig: Rig) -> int:
    """Return the unusable samples in a row that are bridged.

    As many as fit into the time in which the ball alone moves off by a factor e at the smallest
    gap of the path, 1/sqrt(C_Y): beyond it the held voltage belongs to another gap.
    """
    smallest = float(path_gaps(rig, 2)[0])
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
