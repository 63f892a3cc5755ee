"""The exported controller on the emulated rig: coil, steps of sensor and actuator, delay, noise."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import median

from maglev_design.exporting.behaviour import Progress
from maglev_design.exporting.controller import (
    EMULATED_SEEDS,
    ExportedController,
    emulated_at_own_period,
)
from maglev_design.exporting.loops import ExportedRun, NewDevice, Surroundings, fly
from maglev_design.exporting.verdict import Check
from maglev_design.figures import DESCRIBED
from maglev_design.rig import Rig
from maglev_design.simulation import nominal_scenario
from maglev_design.simulation.scenario import noise_samples


def on_the_emulated_rig(
    controller: ExportedController, new: NewDevice, report: Progress
) -> list[Check]:
    """Run a controller on the plant that ``[emulator]`` describes; none where it has no effects.

    At the period of the design, whatever the emulator's is. The plant is the nominal one.
    """
    rig = emulated_at_own_period(controller.record.rig)
    if rig is None:
        return []
    report("emulated rig", 0.95)
    found = [emulated_run(controller, new, rig, seed) for seed in range(EMULATED_SEEDS)]
    lost = sum(math.isinf(itae) for itae in found)
    note = f"of {EMULATED_SEEDS}; median ITAE {median(found):.4g} {DESCRIBED['itae'].unit}"
    period = controller.record.rig.emulator.period
    if period is not None and period != rig.sampling.period:
        note += f"; the design runs at its own period, {rig.sampling.period:g} s"
    return [Check.below("emulated rig: ball lost", lost, 0, "seeds", note)]


def emulated_run(controller: ExportedController, new: NewDevice, rig: Rig, seed: int) -> float:
    """Return the ITAE at the samples of one run [m s^2]; infinite where the ball is lost."""
    effects, period = rig.emulator, rig.sampling.period
    low, high = rig.limits.voltage
    scenario = nominal_scenario(rig, controller.record.design.believed.beta)
    count = math.ceil(round(rig.reference.horizon / period, 9))
    noise = noise_samples(rig, replace(scenario, noise=True, seed=seed), count)

    def measured(k: int, gap: float, _last: float) -> float:
        return rounded(gap + (noise[1, k] if k < count else 0.0), effects.sensor_step)

    def drive(voltage: float) -> float:
        return min(max(rounded(voltage, effects.actuator_step), low), high)

    around = Surroundings(effects.time_constant, drive, noise[0].tolist())
    run = ExportedRun(new(), measured)
    emulated = replace(controller, record=replace(controller.record, rig=rig))
    if fly(emulated, run, around=around):
        return math.inf
    return period**2 * sum(k * abs(error) for k, error in enumerate(run.errors[:count]))


def rounded(value: float, step: float) -> float:
    """Return the multiple of `step` that is nearest; `value` itself where `step` is 0."""
    return step * math.floor(value / step + 0.5) if step else value
