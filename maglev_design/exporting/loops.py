"""The exported controller in closed loop with the nonlinear plant, with and without faults."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from maglev_design.controller.plant import (
    plant_numbers,
)
from maglev_design.controller.timing import timing
from maglev_design.errors import VerificationError
from maglev_design.exporting.controller import ExportedController
from maglev_design.programs import acceleration_program, drive_program
from maglev_design.rig import Rig
from maglev_design.simulation import Scenario, resimulate
from maglev_design.simulation.grid import (
    COIL,
    contact_gap,
    floor_gap,
    reference_names,
    reference_rows,
)
from maglev_design.simulation.independent import IndependentMetrics
from maglev_design.simulation.scenario import at_rest, held_voltage

PIECES = 2
"""Runge-Kutta steps between two changes of the voltage."""
FINEST = 0.25
"""Largest such step as a share of a drive's time constant."""
LARGEST_VOLTAGE = 1e6
"""[V] A larger answer, or a nan, is no voltage."""
FEWEST = 400
"""Samples of a run, so that a fault can be got over before its end."""


class Device(Protocol):
    """One controller, wherever it runs."""

    @property
    def commanded(self) -> float:
        """Last voltage before the clamp [V]."""

    @property
    def status(self) -> int:
        """What became of the last sample."""

    def reset(self) -> None:
        """Forget errors and faults."""

    def step(self, gap: float, reference: float, acceleration: float, *more: float) -> float:
        """Return the voltage for one sample; `more` is what the law reads besides."""


NewDevice = Callable[[], Device]
Fault = Callable[[int, float, float], float]
"""From the sample's number, its gap and the last measured gap to what is measured [m]."""


@dataclass
class ExportedRun:
    """One closed loop with an exported controller.

    Attributes
    ----------
    device : Device
    fault : callable
        What the sensor makes of the gap.
    late : callable
        Whether the voltage of a sample comes one sample late.
    more : tuple of str
        What the law reads besides gap, reference and acceleration.
    gaps, errors, voltages, commanded : list of float
        True gap and error at every sample [m], voltage on the coil and before the clamp [V].
    """

    device: Device
    fault: Fault = lambda _k, gap, _last: gap
    late: Callable[[int], bool] = lambda _k: False
    more: tuple[str, ...] = ()
    gaps: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    voltages: list[float] = field(default_factory=list)
    commanded: list[float] = field(default_factory=list)
    measured: float = math.nan
    waiting: float = math.nan

    def __call__(self, sample: Mapping[str, float]) -> tuple[float, float]:
        """Answer one sample of :func:`maglev_design.simulation.resimulate`.

        Raises
        ------
        VerificationError
            When the device answers what is no voltage.
        """
        k, gap = len(self.gaps), sample["y"]
        self.gaps.append(gap)
        self.errors.append(gap - sample["y_ref"])
        self.measured = self.fault(k, gap, self.measured)
        more = [sample[name] for name in self.more]
        voltage = self.device.step(self.measured, sample["y_ref"], sample["acc_ref"], *more)
        if not abs(voltage) <= LARGEST_VOLTAGE:
            raise VerificationError(f"sample {k}: the exported controller applies {voltage} V")
        applied = self.waiting if self.late(k) and k else voltage
        self.waiting = voltage
        self.voltages.append(applied)
        self.commanded.append(self.device.commanded)
        return self.device.commanded, applied


def close(
    controller: ExportedController, run: ExportedRun, scenario: Scenario
) -> IndependentMetrics:
    """Run one closed loop over the rig's horizon and return its metrics, to nine digits."""
    record = controller.record
    run.more = controller.more
    return resimulate(record.rig, record.design, scenario, run)


@dataclass(frozen=True)
class Surroundings:
    """What stands between an exported controller and the ball, beyond the ideal plant.

    Attributes
    ----------
    lag : float
        L/R of the coil [s].
    drive : callable
        Voltage that the actuator makes of one that the controller applies [V].
    input_noise : sequence of float
        Added to it at every sample [V]; empty for none.
    """

    lag: float = 0.0
    drive: Callable[[float], float] = lambda voltage: voltage
    input_noise: Sequence[float] = ()


def fly(
    controller: ExportedController,
    run: ExportedRun,
    ratio: float = 1.0,
    *,
    beta: float | None = None,
    around: Surroundings | None = None,
) -> bool:
    """Run one closed loop by Runge-Kutta 4 and return whether the ball is lost.

    On a plant with `beta`, by default beta_c/`ratio`; a short path is followed by rest. Without
    metrics and a tenth as long as :func:`close`: for runs that are compared with one another.
    """
    around = around or Surroundings()
    rig, design = controller.record.rig, controller.record.design
    period, when = rig.sampling.period, timing(rig.sampling.period, rig.sampling.delay)
    beta = design.beta_at(ratio) if beta is None else beta
    plant = FlownPlant(rig, beta, around.lag)
    low, high = contact_gap(rig), rig.limits.gap[1]
    run.more = controller.more

    count = max(FEWEST, math.ceil(round(rig.reference.horizon / period, 9)))
    path = reference_rows(rig, np.arange(count, dtype=float) * period, design.controller)
    names = reference_names(design.controller)
    gap, velocity = rig.initial.gap, rig.initial.velocity
    sample = dict(zip(names, path[:, 0].tolist(), strict=True))
    first = around.drive(held_voltage(rig, design, sample | {"Y": design.Y}))
    acting = first
    if rig.kind.order > 2:
        held, acting = at_rest(rig, Scenario(beta, gap))
        first = around.drive(held)
    pending = deque([first] * when.held)
    for k, column in enumerate(path.T.tolist()):
        sample = dict(zip(names, column, strict=True)) | {"y": gap, "v": velocity}
        pending.append(around.drive(run(sample)[1]))
        parts = [(period - when.part, pending[1] if when.part > 0 else pending[0])]
        if when.part > 0:
            parts.insert(0, (when.part, pending[0]))
        pending.popleft()
        noise = around.input_noise[k] if k < len(around.input_noise) else 0.0
        for duration, voltage in parts:
            gap, velocity, acting = plant.after(duration, voltage + noise, (gap, velocity, acting))
        if not low < gap < high:
            return True
    return False


class FlownPlant:
    """A rig's nonlinear plant between two changes of the voltage, by classical Runge-Kutta.

    Parameters
    ----------
    rig : Rig
    beta : float
        The plant's.
    lag : float
        L/R of a coil beyond the plant [s]; one of the plant's own stands for it.
    """

    def __init__(self, rig: Rig, beta: float, lag: float) -> None:
        self.lag, self._floor, self._drive = lag, floor_gap(rig), None
        self._known = {**plant_numbers(rig), "beta": beta, "g": rig.plant.gravity}
        self._known["y0"] = rig.plant.gap_offset
        program = acceleration_program(rig.kind)
        self._names, self._pull = program.inputs, program.scalar()
        self._fastest = math.inf
        if rig.kind.order > 2:
            own = drive_program(rig.kind)
            self._behind, self._drive = own.inputs, own.scalar()
            self._fastest = rig.drive.time_constant * FINEST

    def _acceleration(self, gap: float, velocity: float, acting: float) -> float:
        now = {"y": max(gap, self._floor), "v": velocity, "u": acting}
        return self._pull(*[now[n] if n in now else self._known[n] for n in self._names])[0]

    def after(
        self, duration: float, voltage: float, state: tuple[float, float, float]
    ) -> tuple[float, float, float]:
        """Return gap, velocity and the current over C after a time under a constant voltage."""
        pieces = max(PIECES, math.ceil(duration / self._fastest))
        h = duration / pieces
        gap, velocity, acting = state
        for _ in range(pieces):
            if self._drive is not None:
                gap, velocity, acting = self._whole(h, voltage, (gap, velocity, acting))
                continue
            forces = _through_coil(acting, voltage, h, self.lag)
            gap, velocity = _runge_kutta(self._acceleration, gap, velocity, forces, h)
            acting = forces[2]
        return gap, velocity, acting

    def _whole(
        self, h: float, voltage: float, state: tuple[float, float, float]
    ) -> tuple[float, float, float]:
        """Return the state after one step with the current as a state of its own."""

        def rates(x: tuple[float, float, float]) -> tuple[float, float, float]:
            gap, velocity, acting = x
            now = {"y": max(gap, self._floor), "v": velocity, "u": voltage, COIL: acting}
            assert self._drive is not None  # noqa: S101 - asked for where there is one
            values = [now[n] if n in now else self._known[n] for n in self._behind]
            return velocity, self._acceleration(gap, velocity, acting), self._drive(*values)[0]

        def moved(by: float, along: tuple[float, float, float]) -> tuple[float, float, float]:
            y, v, i = (x + by * r for x, r in zip(state, along, strict=True))
            return y, v, i

        a = rates(state)
        b = rates(moved(h / 2, a))
        c = rates(moved(h / 2, b))
        d = rates(moved(h, c))
        y, v, i = (
            x + h * (p + 2 * (q + r) + s) / 6
            for x, p, q, r, s in zip(state, a, b, c, d, strict=True)
        )
        return y, v, i


def _through_coil(start: float, voltage: float, h: float, lag: float) -> tuple[float, float, float]:
    """Return R i at the start, middle and end of a step under a constant voltage."""
    if lag == 0:
        return voltage, voltage, voltage
    away, left = start - voltage, math.exp(-h / (2 * lag))
    return start, voltage + away * left, voltage + away * left * left


def _runge_kutta(
    pull: Callable[[float, float, float], float],
    y: float,
    v: float,
    forces: tuple[float, float, float],
    h: float,
) -> tuple[float, float]:
    """Return gap and velocity after one classical Runge-Kutta step."""
    half, (first, middle, last) = h / 2, forces
    a = pull(y, v, first)
    b = pull(y + half * v, v + half * a, middle)
    c = pull(y + half * (v + half * a), v + half * b, middle)
    d = pull(y + h * (v + half * b), v + h * c, last)
    return y + h * (v + h * (a + b + c) / 6), v + h * (a + 2 * (b + c) + d) / 6


@dataclass(frozen=True)
class FaultCase:
    """One kind of fault.

    Attributes
    ----------
    name : str
    fault : callable
        What the sensor does.
    late : callable
        Which voltages come one sample late.
    ratio : float
        beta_c/beta.
    delays : bool
        Whether it costs delay, of which a design promises no more than it has.
    """

    name: str
    fault: Fault = lambda _k, gap, _last: gap
    late: Callable[[int], bool] = lambda _k: False
    ratio: float = 1.0
    delays: bool = False


def fault_cases(controller: ExportedController, samples: int) -> Sequence[FaultCase]:
    """Return the faults that a run is tried with, deterministic and spread over the path."""
    burst = max(1, controller.hold_samples // 8)
    where = range(samples // 20, 3 * samples // 4, max(1, samples // 14))
    struck = {start + n for start in where for n in range(burst)}
    ratio = controller.record.document["margins"]["delay_s"]["ratio"]
    count = "one sample" if burst == 1 else f"{burst} samples in a row"
    nan, high = math.nan, 2 * controller.numbers["gap_high"]

    def missed(k: int, gap: float, _last: float) -> float:
        return nan if k % 50 == 49 else gap

    def lost(k: int, gap: float, _last: float) -> float:
        return nan if k in struck else gap

    def outside(k: int, gap: float, _last: float) -> float:
        return high if k in struck else gap

    def stuck(k: int, gap: float, last: float) -> float:
        return last if k in struck else gap

    return (
        FaultCase("every 50th sample missed", missed),
        FaultCase(f"{count} nan, repeatedly", lost),
        FaultCase(f"{count} out of range, repeatedly", outside),
        FaultCase(f"{count} stuck, repeatedly", stuck),
        FaultCase("every 10th voltage one sample late", late=lambda k: k % 10 == 9, delays=True),
        FaultCase("one more sample of delay", late=lambda _k: True, delays=True),
        FaultCase("and the worst beta for it", late=lambda _k: True, ratio=ratio, delays=True),
    )
