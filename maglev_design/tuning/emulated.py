"""A design on the emulated rig: what becomes of it there, and the search for poles that suit it.

The emulated rig has what no controller here was designed for: noise, steps of sensor and actuator,
a coil. An integral of its error is a random number that is not smooth in the poles: it is judged
by its median over noise streams, and searched by a grid and a pattern search over its mean.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

import numpy as np

from maglev_design import linear_loop as loops
from maglev_design.controller.design import Design, PoleSpec, make_design
from maglev_design.controller.matching import matching_law
from maglev_design.rig import Rig
from maglev_design.simulation import (
    Metrics,
    at_own_period,
    build,
    cores,
    emulated,
    emulator_effects,
    simulate_batch,
)
from maglev_design.simulation.noise import LARGEST_SEED
from maglev_design.tuning.evaluation import (
    Constraint,
    TuningRun,
    design_at,
    linear_constraints,
    runs,
    scenario_at,
)
from maglev_design.tuning.landscape import Landscape
from maglev_design.tuning.problem import Array, TuningCase, TuningProblem
from maglev_design.tuning.search import Candidate, Search, exchange, pattern_search

T = TypeVar("T")

ROUGH_STREAMS, TRAINING_STREAMS = 4, 12
"""Noise streams of the problem's seed: at a point of the grid, and in the search."""
JUDGING_SEEDS = 20
FIRST_JUDGING_SEED = 1000
"""Past the problem's own seed, whose streams the search has seen."""
BAND = (2.5, 50.0, 97.5)
"""Percentiles: low, median and high."""
GRID_STARTS = 2
"""Points of the grid from which the pattern search starts."""
STEPS = (0.08, 0.01)
"""Relative steps of the pattern search: smaller ones follow the noise."""
ONE_MORE_SAMPLE = "spectral radius, one more sample"


@dataclass(frozen=True)
class NoiseBand:
    """The median of a figure over noise streams, and the ends of the middle 95 %."""

    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Emulation:
    """One controller on one emulated plant.

    Attributes
    ----------
    ratio : float
        beta_c/beta.
    seeds, lost : int
        Runs, and in how many of them the ball was lost.
    itae : NoiseBand
        [m s^2]
    total_variation : NoiseBand
        Of the applied voltage [V].
    """

    ratio: float
    seeds: int
    lost: int
    itae: NoiseBand
    total_variation: NoiseBand


@dataclass(frozen=True)
class Emulations:
    """One controller on the emulated plants: at ratio 1, and where the family is worst for it."""

    period: float
    nominal: Emulation
    worst: Emulation

    def as_dict(self) -> dict[str, Any]:
        """Return plain data: the figures at ratio 1, and under ``worst`` the others."""
        return {"period": self.period, **asdict(self.nominal), "worst": asdict(self.worst)}


@dataclass(frozen=True)
class Relaxed:
    """The poles that the search finds when less robustness is asked for.

    Attributes
    ----------
    poles : PoleSpec
    max_ms : float
        The limit on Ms; infinite where the loop need only be stable, with one more sample too.
    ms, ms_one_more_sample : float
        Of these poles in the linear loop, which has no coil.
    emulations : Emulations
    """

    poles: PoleSpec
    max_ms: float
    ms: float
    ms_one_more_sample: float
    emulations: Emulations

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, the figures of the loop without the coil first."""
        own = {"poles": self.poles.pairs, "max_ms": self.max_ms, "ms": self.ms}
        return own | {"ms_one_more_sample": self.ms_one_more_sample} | self.emulations.as_dict()


@dataclass(frozen=True)
class EmulatedRow:
    """A design, and what it is compared with, on the emulated rig at the design's period.

    Attributes
    ----------
    effects : tuple of str
        What the emulated rig adds, in words.
    judging_seeds : tuple of int
        Of the noise, none of them seen by a search.
    training : tuple of int
        Noise streams of the problem's seed that the search saw; empty where it saw none.
    tuned : Emulations
    baseline : Emulations or None
    rediscretised : Emulations or None
        The same gains at the emulator's own period: another controller. None where that is the
        design's.
    relaxed : Relaxed or None
    """

    effects: tuple[str, ...]
    judging_seeds: tuple[int, ...]
    training: tuple[int, ...]
    tuned: Emulations
    baseline: Emulations | None
    rediscretised: Emulations | None
    relaxed: Relaxed | None

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, the figures of the design itself beside what they are of."""
        return {
            "effects": list(self.effects),
            "judging_seeds": list(self.judging_seeds),
            "training_streams": list(self.training),
            **self.tuned.as_dict(),
            "baseline": self.baseline and self.baseline.as_dict(),
            "rediscretised": self.rediscretised and self.rediscretised.as_dict(),
            "relaxed": self.relaxed and self.relaxed.as_dict(),
        }


def emulated_row(
    problem: TuningProblem,
    design: Design,
    baseline: PoleSpec | None = None,
    relaxed: tuple[PoleSpec, float] | None = None,
) -> EmulatedRow | None:
    """Return what becomes of a design on the emulated rig; None where the rig emulates nothing.

    Parameters
    ----------
    baseline : PoleSpec, optional
        Poles of TAN-GPI to compare with.
    relaxed : tuple of PoleSpec and float, optional
        As :func:`relaxed_optimum` returns them.
    """
    effects, rig = emulator_effects(problem.rig), problem.rig
    if not effects:
        return None
    seeds = judging_seeds(problem.seed)
    own = at_own_period(rig)
    other = rediscretised = None
    if baseline is not None:
        other = emulations(
            problem,
            own,
            design_at(replace(problem, controller=matching_law(problem.rig), gains=None), baseline),
            seeds,
        )
    changed = emulated(rig)
    if changed.sampling.period != rig.sampling.period:
        moved = make_design(
            changed,
            design.poles,
            controller=design.controller,
            equilibrium=design.equilibrium,
            method=design.method,
            voltage=design.believed.U,
            gains=design.gains,
        )
        rediscretised = emulations(problem, changed, moved, seeds)
    less = None
    if relaxed is not None:
        poles, max_ms = relaxed
        found = emulations(problem, own, design_at(problem, poles), seeds)
        less = Relaxed(poles, max_ms, *sensitivity_peaks(problem, poles), found)
    return EmulatedRow(
        effects,
        seeds,
        tuple(range(TRAINING_STREAMS)) if problem.emulated_runs else (),
        emulations(problem, own, design, seeds),
        other,
        rediscretised,
        less,
    )


def judging_seeds(seed: int) -> tuple[int, ...]:
    """Return the seeds that judge a design of a problem with `seed`."""
    first = seed + FIRST_JUDGING_SEED
    return tuple(n % (LARGEST_SEED + 1) for n in range(first, first + JUDGING_SEEDS))


def emulations(
    problem: TuningProblem, rig: Rig, design: Design, seeds: Sequence[int]
) -> Emulations:
    """Run a design with the emulator's effects on `rig`, which has the design's period."""
    loop = build(rig, design.method, controller=design.controller, emulate=True)
    ratios = emulated_ratios(problem)
    scenarios = [
        replace(scenario_at(problem, TuningCase(noise=True), ratio), seed=seed)
        for ratio in ratios
        for seed in seeds
    ]
    found = simulate_batch(loop, [design] * len(scenarios), scenarios, threads=cores())
    by_ratio = {
        ratio: _emulation(ratio, [(s.metrics, s.total_variation) for s in group])
        for ratio, group in zip(ratios, _groups(found, len(seeds)), strict=True)
    }
    worst = max(by_ratio.values(), key=lambda e: (e.lost, e.itae.median))
    return Emulations(rig.sampling.period, by_ratio[1.0], worst)


def _groups(found: Sequence[T], size: int) -> list[list[T]]:
    """Return what was found in lists of `size`."""
    return [list(found[n : n + size]) for n in range(0, len(found), size)]


def _emulation(ratio: float, found: Sequence[tuple[Metrics, float]]) -> Emulation:
    return Emulation(
        ratio,
        len(found),
        sum(metrics.crashed for metrics, _ in found),
        _spread([metrics.itae for metrics, _ in found]),
        _spread([variation for _, variation in found]),
    )


def _spread(values: Sequence[float]) -> NoiseBand:
    low, median, high = (float(x) for x in np.percentile(values, BAND))
    return NoiseBand(median, low, high)


def emulated_ratios(problem: TuningProblem) -> tuple[float, ...]:
    """Return the ratios that are run: 1 and the ends of the interval."""
    return tuple(dict.fromkeys((1.0, *problem.family.ratios)))


def sensitivity_peaks(problem: TuningProblem, poles: PoleSpec) -> tuple[float, float]:
    """Return Ms, and Ms with one more sample of delay; infinite for an unstable loop."""
    values, over = poles.values, problem.family
    first, second = (
        math.inf
        if loops.spectral_radius(loop, values, over).value >= 1
        else loops.peak_sensitivity(loop, values, over).value
        for loop in (problem.loop, problem.delayed_loop)
    )
    return first, second


# --- the search ----------------------------------------------------------------------------


def emulated_limits(problem: TuningProblem, poles: PoleSpec) -> tuple[Constraint, ...]:
    """Return what poles tuned on the emulated rig must keep to besides; none for other problems."""
    if problem.emulated_runs is None:
        return ()
    simulated = emulated_runs(problem, poles, TRAINING_STREAMS)
    return (one_more_sample(problem, poles), *_limits_of(simulated))


def one_more_sample(problem: TuningProblem, poles: PoleSpec) -> Constraint:
    """Return the limit that the loop be stable with one more sample of delay."""
    found = loops.spectral_radius(problem.delayed_loop, poles.values, problem.family)
    slack = 1 - found.value
    return Constraint(ONE_MORE_SAMPLE, "-", 1.0, found.value, slack, -found.gradient)


def emulated_runs(problem: TuningProblem, poles: PoleSpec, streams: int) -> list[list[TuningRun]]:
    """Simulate poles on the emulated plants, one list of `streams` runs a plant."""
    assert problem.emulated_runs is not None  # noqa: S101 - the callers tune the emulated rig
    trials = [
        (poles, TuningCase(noise=True, index=index, shift=shift), ratio)
        for ratio, shift in itertools.product(emulated_ratios(problem), problem.family.shift_values)
        for index in range(streams)
    ]
    found = runs(replace(problem, runs=problem.emulated_runs), trials)
    return _groups(found, streams)


def _limits_of(plants: Iterable[Sequence[TuningRun]]) -> list[Constraint]:
    return [limit for plant in plants for run in plant for limit in run.constraints]


def worst_mean(plants: Iterable[Sequence[TuningRun]]) -> float:
    """Return the objective: the mean over the streams, at the plant where it is largest."""
    return max(float(np.mean([run.value for run in plant])) for plant in plants)


@dataclass
class EmulatedSearch(Search):
    """A search whose objective is :func:`worst_mean`; `told` learns of every better point."""

    told: Callable[[Candidate], None] = lambda _: None

    def candidate(self, x: Array, *, remember: bool = True) -> Candidate:
        """Judge `x`; what misses a linear limit is not simulated."""
        self.progress(*self.stage)
        poles = self.problem.poles(x)
        limits = [*self.linear(x), one_more_sample(self.problem, poles)]
        value = math.inf
        if min(c.slack for c in limits) >= 0:
            plants = emulated_runs(self.problem, poles, TRAINING_STREAMS)
            self.evaluations += sum(map(len, plants))
            limits += _limits_of(plants)
            value = worst_mean(plants)
        better = self.best is None or value < self.best.value
        if better and min(c.slack for c in limits) >= 0:
            limits += self.certificate(x)
        found = Candidate(x.copy(), value, min(limits, key=lambda c: c.slack))
        if remember and better and found.feasible:
            self.best = found
            self.told(found)
        return found


def optimum(search: Search, starts: Sequence[Array]) -> Candidate:
    """Return the best poles on the emulated rig; where none keeps the limits, the closest ones.

    `search` has explored the loop without the effects, whose linear limits choose what is
    simulated; it learns the best point and what was evaluated.
    """
    search.best = None

    def told(found: Candidate) -> None:
        search.best = found

    own = _search(search, search.problem, told)
    begin = _grid_starts(own, search.landscape, 0.0)
    if not begin:
        closest = exchange(search, starts)
        if not closest.feasible:
            return closest
        begin = [closest.x]
    found = _best_from(own, begin)
    search.evaluations += own.evaluations
    return found


def relaxed_optimum(search: Search, baseline: PoleSpec | None) -> tuple[PoleSpec, float] | None:
    """Return the best poles under a looser limit on Ms, and that limit.

    It is what the baseline has; without a baseline there is none, and the loop need only be
    stable, with one more sample of delay too. None where that is no looser than the problem's.
    """
    problem = search.problem
    strict = problem.limits.max_ms
    limit = math.inf if baseline is None else sensitivity_peaks(problem, baseline)[0]
    if limit <= strict:
        return None
    looser = replace(problem, limits=replace(problem.limits, max_ms=limit), certifies=None)
    own = _search(search, looser, lambda _: None)
    begin = _grid_starts(own, search.landscape, math.log(limit / strict))
    if not begin:
        return None
    found = _best_from(own, begin)
    search.evaluations += own.evaluations
    return (looser.poles(found.x), limit) if found.feasible else None


def _search(
    search: Search, problem: TuningProblem, told: Callable[[Candidate], None]
) -> EmulatedSearch:
    return EmulatedSearch(
        problem, search.progress, search.clamped, stage=("emulated rig", 0.0), told=told
    )


def _best_from(search: EmulatedSearch, begin: Sequence[Array]) -> Candidate:
    found = []
    for count, x in enumerate(begin):
        search.stage = ("emulated rig", (1 + count) / (1 + len(begin)))
        first = search.candidate(x)
        found.append(pattern_search(search, first, STEPS))
    return min(found, key=lambda c: (max(0.0, -c.tightest.slack), c.value))


def _grid_starts(search: EmulatedSearch, landscape: Landscape | None, looser: float) -> list[Array]:
    """Return the best points of a grid whose linear limits are kept, Ms by `looser` less."""
    assert landscape is not None  # noqa: S101 - explored before
    problem = search.problem
    slacks = [s + looser * (name == "Ms") for name, s in landscape.slack.items()]
    found: list[tuple[float, Array]] = []
    where = np.argwhere(np.min(slacks, axis=0) >= 0)
    for count, (i, j) in enumerate(where):
        search.progress("emulated grid", count / len(where))
        poles = PoleSpec.double(float(landscape.zeta[i]), float(landscape.omega_n[j]))
        limits = [*linear_constraints(problem, poles), one_more_sample(problem, poles)]
        if min(c.slack for c in limits) < 0:
            continue
        plants = emulated_runs(problem, poles, ROUGH_STREAMS)
        search.evaluations += sum(map(len, plants))
        if min((c.slack for c in _limits_of(plants)), default=0.0) >= 0:
            x = np.log(poles.values if problem.distinct else poles.first)
            found.append((worst_mean(plants), x))
    return [x for _, x in sorted(found, key=lambda pair: pair[0])[:GRID_STARTS]]
