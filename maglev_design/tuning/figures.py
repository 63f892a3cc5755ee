"""The figures of one design at every ratio, and the same once more with another integrator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maglev_design import linear_loop as loops
from maglev_design.controller.design import PoleSpec
from maglev_design.controller.family import Family
from maglev_design.figures import INDICES
from maglev_design.simulation import Metrics, resimulate, respond, simulate_batch
from maglev_design.tuning.emulated import emulated_limits
from maglev_design.tuning.evaluation import (
    Constraint,
    certificate,
    design_at,
    linear_constraints,
    run,
    scenario_at,
)
from maglev_design.tuning.problem import TuningCase, TuningProblem
from maglev_design.tuning.search import SCAN, Search, worst_ratio

VERIFICATION_TOLERANCE = 1e-5
"""Largest relative difference of the two integrators: each is good to about 1e-7 on its own."""
NOISY_RUNS = 9
"""Noise streams of the row with the rig's noise: odd, so that the median is one of them."""


@dataclass(frozen=True)
class Figures:
    """What one design does over the whole ratio interval.

    Attributes
    ----------
    worst : Metrics
        At the ratio where the objective is largest; extremes of voltage and gap are over all
        ratios and cases.
    case : TuningCase
        Which way to run that was.
    ratio : float
        beta_c/beta there, of the plant that has the rig's y0.
    nominal : Metrics
        At ratio 1.
    ms, ms_one_more_sample : float
        Largest |S|, as it is and with one more whole sample of delay [-]; infinite where the loop
        is unstable for a plant of the family.
    spectral_radius, spectral_radius_one_more_sample : float
        Spectral radius of the sampled loop, likewise [-].
    noise_voltage : float
        Largest standard deviation of the voltage that sensor noise makes [V]; infinite likewise.
    constraints : tuple of Constraint
        Each at its worst.
    other_sign : Metrics
        At `ratio`, with the initial error of the other sign.
    max_error, max_error_from_move : float
        Largest |y - y*| over the family, of the whole horizon and from the start of the move on;
        the second None where the path does not move [m].
    """

    worst: Metrics
    case: TuningCase
    ratio: float
    nominal: Metrics
    ms: float
    ms_one_more_sample: float
    spectral_radius: float
    spectral_radius_one_more_sample: float
    noise_voltage: float
    constraints: tuple[Constraint, ...]
    other_sign: Metrics
    max_error: float
    max_error_from_move: float | None

    @property
    def feasible(self) -> bool:
        """Whether every limit is kept."""
        return all(c.satisfied for c in self.constraints)

    @property
    def tightest(self) -> Constraint:
        """The limit with the least slack."""
        return min(self.constraints, key=lambda c: c.slack)


@dataclass(frozen=True)
class Verification:
    """The worst case once more with an independent integrator."""

    value: float
    reference: float

    @property
    def relative_difference(self) -> float:
        """|value - reference| as a share of the larger of the two."""
        if self.value == self.reference:
            return 0.0
        return abs(self.value - self.reference) / max(abs(self.value), abs(self.reference))

    @property
    def passed(self) -> bool:
        """Whether both agree to `VERIFICATION_TOLERANCE`."""
        return self.relative_difference <= VERIFICATION_TOLERANCE


@dataclass(frozen=True)
class WithNoise:
    """The worst case run with the rig's noise: medians over `seeds` streams; `lost` balls."""

    seeds: int
    ise: float
    iae: float
    itae: float
    lost: int


def times_smaller(before: float, after: float) -> float:
    """Return before/after, 1 where both are 0 and infinity where only `after` is."""
    if after == 0:
        return 1.0 if before == 0 else math.inf
    return before / after


def judge(problem: TuningProblem, poles: PoleSpec) -> Figures:
    """Return the figures of `poles` over the whole family, every limit at its worst."""
    search = Search(problem, lambda *_: None, clamped=True, fixed=poles)
    x = np.log(poles.values if problem.distinct else poles.first)
    low, high = problem.family.ratios
    case, (ratio, worst) = max(
        ((case, worst_ratio(search, x, case)) for case in problem.cases),
        key=lambda found: found[1][1].value,
    )
    ratios = np.linspace(low, high, SCAN) if high > low else np.array([low])
    runs = search.runs(x, [(case, float(r)) for case in problem.cases for r in ratios])
    limits: dict[str, Constraint] = {}
    simulated = [c for r in (*runs, worst) for c in r.constraints]
    proved = (*certificate(problem, poles), *emulated_limits(problem, poles))
    values, over = poles.values, problem.family
    radius = loops.spectral_radius(problem.loop, values, over).value
    for limit in (*linear_constraints(problem, poles), *simulated, *proved):
        if limit.name not in limits or limit.slack < limits[limit.name].slack:
            limits[limit.name] = limit
    if radius >= 1:  # |S| of an unstable loop is no margin, and its noise grows for ever
        for name in limits.keys() & {"Ms", "noise voltage"}:
            slack = min(limits[name].slack, 1 - radius)
            limits[name] = replace(limits[name], value=math.inf, slack=slack)
    whole, moving = _max_errors(problem, poles, ratios)
    later = loops.spectral_radius(problem.delayed_loop, values, over).value
    return Figures(
        worst=_with_extremes(worst.metrics, [r.metrics for r in (*runs, worst)]),
        case=case,
        ratio=ratio,
        nominal=run(problem, poles, TuningCase(), 1.0).metrics,
        ms=_peak(problem.loop, values, over, radius),
        ms_one_more_sample=_peak(problem.delayed_loop, values, over, later),
        spectral_radius=radius,
        spectral_radius_one_more_sample=later,
        noise_voltage=math.inf
        if radius >= 1
        else loops.noise_voltage(problem.loop, values, over, problem.position_noise).value,
        constraints=tuple(limits.values()),
        other_sign=run(problem, poles, replace(case, flipped=not case.flipped), ratio).metrics,
        max_error=whole,
        max_error_from_move=moving,
    )


def _peak(loop: loops.Loop, poles: Sequence[float], over: Family, radius: float) -> float:
    """Return Ms; infinite for an unstable loop."""
    return math.inf if radius >= 1 else loops.peak_sensitivity(loop, poles, over).value


def _max_errors(
    problem: TuningProblem, poles: PoleSpec, ratios: NDArray[np.float64]
) -> tuple[float, float | None]:
    """Return the largest |y - y*| without noise, whole and from the start of the move on."""
    design, path = design_at(problem, poles), problem.rig.reference
    whole, moving = 0.0, 0.0
    for case in problem.cases:
        for ratio in ratios if not case.noise else ():
            response = respond(problem.runs, design, scenario_at(problem, case, float(ratio)))
            count = len(response.gap)
            error = np.abs(response.gap - response.reference[:count])
            whole = max(whole, float(np.nanmax(error)))
            after = error[response.times[:count] >= path.start_time]
            moving = max(moving, float(np.nanmax(after, initial=0.0)))
    return whole, moving if path.start_gap != path.end_gap else None


def _with_extremes(worst: Metrics, others: list[Metrics]) -> Metrics:
    return replace(
        worst,
        peak_voltage=max(m.peak_voltage for m in others),
        min_voltage=min(m.min_voltage for m in others),
        peak_applied=max(m.peak_applied for m in others),
        min_gap=min(m.min_gap for m in others),
        max_gap=max(m.max_gap for m in others),
        crash=worst.crash or next((m.crash for m in others if m.crash), None),
    )


def with_noise(problem: TuningProblem, poles: PoleSpec, figures: Figures) -> WithNoise | None:
    """Return the worst case with the rig's noise; None where it has none."""
    noise = problem.rig.noise
    if noise.input == noise.position == 0:
        return None
    scenarios = [
        scenario_at(problem, replace(figures.case, noise=True, index=n), figures.ratio)
        for n in range(NOISY_RUNS)
    ]
    designs = [design_at(problem, poles)] * NOISY_RUNS
    found = [x.metrics for x in simulate_batch(problem.runs, designs, scenarios)]
    ise, iae, itae = (float(np.median([getattr(m, key) for m in found])) for key in INDICES)
    return WithNoise(NOISY_RUNS, ise, iae, itae, sum(m.crashed for m in found))


def verify(problem: TuningProblem, poles: PoleSpec, figures: Figures) -> Verification:
    """Re-simulate the worst case with SciPy."""
    scenario = scenario_at(problem, figures.case, figures.ratio)
    value = run(problem, poles, figures.case, figures.ratio)
    check = resimulate(problem.rig, design_at(problem, poles), scenario)
    if value.metrics.crashed and check.crashed:
        return Verification(value.value, value.value)
    return Verification(value.value, float(getattr(check, problem.objective.key)))
