"""The exported controller in closed loop with the nonlinear plant, with and without faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from maglev_design.export.controller import Controller
from maglev_design.simulate import Scenario, resimulate
from maglev_design.simulate.independent import Check


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

    def step(self, gap: float, reference: float, acceleration: float) -> float:
        """Return the voltage for one sample."""


NewDevice = Callable[[], Device]
Fault = Callable[[int, float, float], float]
"""From the sample's number, its gap and the last measured gap to what is measured [m]."""


@dataclass
class Run:
    """One closed loop with an exported controller.

    Attributes
    ----------
    device : Device
    fault : callable
        What the sensor makes of the gap.
    late : callable
        Whether the voltage of a sample comes one sample late.
    gaps, errors, voltages : list of float
        True gap and error at every sample [m], voltage on the coil [V].
    """

    device: Device
    fault: Fault = lambda _k, gap, _last: gap
    late: Callable[[int], bool] = lambda _k: False
    gaps: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    voltages: list[float] = field(default_factory=list)
    measured: float = math.nan
    waiting: float = math.nan

    def __call__(self, sample: Mapping[str, float]) -> tuple[float, float]:
        """Answer one sample of :func:`maglev_design.simulate.resimulate`."""
        k, gap = len(self.gaps), sample["y"]
        self.gaps.append(gap)
        self.errors.append(gap - sample["y_ref"])
        self.measured = self.fault(k, gap, self.measured)
        voltage = self.device.step(self.measured, sample["y_ref"], sample["acc_ref"])
        applied = self.waiting if self.late(k) and k else voltage
        self.waiting = voltage
        self.voltages.append(applied)
        return self.device.commanded, applied


def close(controller: Controller, run: Run, scenario: Scenario) -> Check:
    """Run one closed loop over the rig's horizon."""
    record = controller.record
    return resimulate(record.rig, record.design, scenario, run)


@dataclass(frozen=True)
class FaultCase:
    """One kind of fault: its name, what the sensor does, and which voltages come late."""

    name: str
    fault: Fault = lambda _k, gap, _last: gap
    late: Callable[[int], bool] = lambda _k: False
    delays: bool = False


def fault_cases(controller: Controller, samples: int) -> Sequence[FaultCase]:
    """Return the faults that a run is tried with, deterministic and spread over the path."""
    burst = max(1, controller.hold_samples // 8)
    where = range(samples // 10, samples - samples // 10, max(1, samples // 10))
    struck = {start + n for start in where for n in range(burst)}
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
        FaultCase(f"{burst} samples in a row nan, ten times", lost),
        FaultCase(f"{burst} samples in a row out of range, ten times", outside),
        FaultCase(f"sensor stuck for {burst} samples, ten times", stuck),
        FaultCase("every 10th voltage one sample late", late=lambda k: k % 10 == 9, delays=True),
        FaultCase("one more sample of delay", late=lambda _k: True, delays=True),
    )
