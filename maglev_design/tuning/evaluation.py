"""A tuning problem at given poles: objective and limits, values and exact gradients.

Nothing here searches.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maglev_design import linear_loop as loops
from maglev_design.controller.design import Design, PoleSpec, make_design
from maglev_design.figures import DESCRIBED
from maglev_design.simulation import (
    Metrics,
    Scenario,
    mirrored,
    nominal_scenario,
    pole_sensitivities,
    simulate_batch,
)
from maglev_design.tuning.problem import CERTIFICATE, TuningCase, TuningProblem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Constraint:
    """One limit and where a design stands.

    Attributes
    ----------
    name, unit : str
    limit, value : float
    slack : float
        Dimensionless, negative when violated.
    gradient : array, shape (4,)
        Of the slack by the poles.
    """

    name: str
    unit: str
    limit: float
    value: float
    slack: float
    gradient: Array

    @property
    def satisfied(self) -> bool:
        """Whether the limit is kept."""
        return self.slack >= 0

    @property
    def side(self) -> Literal["upper", "lower"]:
        """Whether `limit` bounds the value from above or from below."""
        lower = self.name in ("Routh-Hurwitz", CERTIFICATE) or self.name.startswith("smallest")
        return "lower" if lower else "upper"


@dataclass(frozen=True)
class TuningRun:
    """One simulated loop inside the search: its objective and its limits, with gradients."""

    value: float
    gradient: Array
    constraints: tuple[Constraint, ...]
    metrics: Metrics


def linear_constraints(problem: TuningProblem, poles: PoleSpec) -> tuple[Constraint, ...]:
    """Return the limits that the linearised loops must keep, worst over gaps and ratios.

    Ms and noise appear several times, at their worst and at every corner of the family: each of
    these is smooth in the poles where their maximum is not.
    """
    values, over, limits = poles.values, problem.family, problem.limits
    radius = loops.spectral_radius(problem.loop, values, over)
    hurwitz = loops.hurwitz_margin(problem.loop, values, over)
    found = [
        Constraint("spectral radius", "-", 1.0, radius.value, 1 - radius.value, -radius.gradient),
        Constraint("Routh-Hurwitz", "-", 0.0, hurwitz.value, hurwitz.value, hurwitz.gradient),
    ]
    peaks = loops.peak_sensitivities(problem.loop, values, over)
    found += [_logarithmic("Ms", "-", limits.max_ms, peak) for peak in peaks]
    if problem.noise_matters:
        deviation = problem.position_noise
        noise = loops.noise_voltages(problem.loop, values, over, deviation)
        highest = limits.max_noise_voltage
        found += [_logarithmic("noise voltage", "V", highest, x) for x in noise]
    return tuple(found)


def coarse_slacks(problem: TuningProblem, poles: Sequence[PoleSpec]) -> dict[str, Array]:
    """Return the slack of each limit of :func:`linear_constraints` for many poles, shape (n,).

    On a coarser grid of gaps, ratios and frequencies: for the picture of a whole box.
    """
    limits = problem.limits
    columns = np.array([p.values for p in poles]).T
    figures = loops.coarse_figures(problem.loop, columns, problem.family)
    slacks = {
        "spectral radius": 1 - figures.radius,
        "Routh-Hurwitz": figures.hurwitz,
        "Ms": np.array([_log_slack(limits.max_ms, x) for x in figures.peak]),
    }
    if problem.noise_matters:
        noise = problem.position_noise * figures.noise
        slacks["noise voltage"] = np.array([_log_slack(limits.max_noise_voltage, x) for x in noise])
    return slacks


def _log_slack(limit: float, value: float) -> float:
    """Return log(limit/value), the slack of an upper limit on a positive figure."""
    if not (math.isfinite(value) and value > 0):
        return -1e3
    return math.inf if math.isinf(limit) else math.log(limit / value)


def certificate(problem: TuningProblem, poles: PoleSpec) -> tuple[Constraint, ...]:
    """Return whether the sampled loop is certified as a limit; none where that is not required."""
    if problem.certifies is None:
        return ()
    value = float(problem.certifies(design_at(problem, poles)))
    return (Constraint(CERTIFICATE, "-", 1.0, value, value - 1, np.zeros(4)),)


def _logarithmic(name: str, unit: str, limit: float, found: loops.Extreme) -> Constraint:
    """Return an upper limit on a positive figure, with its gradient."""
    slack = _log_slack(limit, found.value)
    if not (math.isfinite(found.value) and found.value > 0):
        return Constraint(name, unit, limit, math.inf, slack, np.zeros(4))
    gradient = np.zeros(4) if math.isinf(limit) else -found.gradient / found.value
    return Constraint(name, unit, limit, found.value, slack, gradient)


def design_at(problem: TuningProblem, poles: PoleSpec) -> Design:
    """Return the controller with these poles; every plant of the family meets the same one."""
    return make_design(
        problem.rig,
        poles,
        equilibrium=problem.equilibrium,
        method=problem.method,
        voltage=problem.believed.U,
        controller=problem.controller,
        gains=problem.gains,
    )


def scenario_at(problem: TuningProblem, case: TuningCase, ratio: float) -> Scenario:
    """Return the scenario of one case on the plant with a ratio beta_c/beta at the rig's y0."""
    rig = problem.rig
    actual = problem.family.ratio_at(ratio, case.shift)
    scenario = nominal_scenario(rig, problem.believed.beta / actual)
    if case.flipped:
        scenario = mirrored(rig, scenario)
    offset = rig.plant.gap_offset + case.shift if case.shift else None
    return replace(
        scenario, noise=case.noise, seed=problem.seed, index=case.index, gap_offset=offset
    )


def run(
    problem: TuningProblem, poles: PoleSpec, case: TuningCase, ratio: float, *, clamped: bool = True
) -> TuningRun:
    """Simulate one case at one ratio, as :func:`runs` does many."""
    return runs(problem, [(poles, case, ratio)], clamped=clamped)[0]


def runs(
    problem: TuningProblem,
    trials: Sequence[tuple[PoleSpec, TuningCase, float]],
    *,
    gradients: bool = False,
    clamped: bool = True,
) -> list[TuningRun]:
    """Simulate trials of (poles, case, ratio) side by side; with `gradients` by the poles, too.

    Without the clamp (``clamped=False``) the objective goes on smoothly where a design commands
    more than the actuator has; where the limits are kept it makes no difference.
    """
    placed = {poles: design_at(problem, poles) for poles in dict.fromkeys(p for p, _, _ in trials)}
    designs = [placed[poles] for poles, _, _ in trials]
    scenarios = [scenario_at(problem, case, ratio) for _, case, ratio in trials]
    if not gradients:
        found = simulate_batch(problem.runs, designs, scenarios, clamped=clamped)
        return [_run(problem, x.metrics, {}) for x in found]
    graph, back = problem.sensitivity_runs, np.linalg.pinv(problem.directions).T
    moving = {
        key: pole_sensitivities(graph, design, problem.directions) for key, design in placed.items()
    }
    sensitivities = [moving[poles] for poles, _, _ in trials]
    found = simulate_batch(graph, designs, scenarios, sensitivities, clamped=clamped)
    return [
        _run(problem, x.metrics, {name: back @ by for name, by in x.gradients.items()})
        for x in found
    ]


def _run(problem: TuningProblem, metrics: Metrics, slopes: Mapping[str, Array]) -> TuningRun:
    """Return what the search needs of one simulated loop; `slopes` are by the poles."""
    key = problem.objective.key
    return TuningRun(
        value=float(getattr(metrics, key)),
        gradient=slopes.get(key, np.zeros(4)),
        constraints=tuple(_extremes(problem, metrics, slopes)),
        metrics=metrics,
    )


def _extremes(
    problem: TuningProblem, metrics: Metrics, slopes: Mapping[str, Array]
) -> Iterator[Constraint]:
    """Yield the limits of the gap and of the commanded voltage, at their extreme samples."""
    rig, (low, high) = problem.rig, problem.rig.limits.voltage
    limited = [("min_gap", "max_gap", rig.limits.gap, rig.operating_point.gap)]
    if not problem.limits.allow_saturation:
        span = high - low if math.isfinite(high) else 1.0
        limited.append(("min_voltage", "peak_voltage", (low, high), span))
    for *keys, bounds, scale in limited:
        for key, limit in zip(keys, bounds, strict=True):
            if not math.isfinite(limit):
                continue
            told, value = DESCRIBED[key], getattr(metrics, key)
            sign = 1 if told.worse == "low" else -1
            slack = sign * (value - limit) / scale
            if metrics.crashed and told.unit == "m":
                slack = min(slack, -1.0)
            gradient = sign * slopes.get(key, np.zeros(4)) / scale
            yield Constraint(told.label, told.unit, limit, value, slack, gradient)
