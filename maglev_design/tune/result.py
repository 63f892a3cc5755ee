"""What a tuning found, judged at every ratio, re-simulated independently and compared."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design import loop as loops
from maglev_design.choices import EQUILIBRIA, METHODS, Method
from maglev_design.design import Design, PoleSpec, believed_equilibrium
from maglev_design.interrupt import deferred
from maglev_design.parameters import MOST_DELAYED_PERIODS
from maglev_design.simulate import Metrics, resimulate, respond, simulate_batch
from maglev_design.tune.cautions import cautions
from maglev_design.tune.emulated import (
    EmulatedRow,
    emulated_limits,
    emulated_row,
    optimum,
    relaxed_optimum,
)
from maglev_design.tune.problem import (
    Case,
    Constraint,
    TuningProblem,
    build_problem,
    certificate,
    design_at,
    linear_constraints,
    run,
    scenario_at,
)
from maglev_design.tune.relief import Relief, closest, relief
from maglev_design.tune.search import (
    SCAN,
    Candidate,
    Landscape,
    Search,
    exchange,
    explore,
    stable_somewhere,
    starting_points,
    worst_ratio,
)

VERIFICATION_TOLERANCE = 1e-5
"""Largest relative difference of the two integrators: each is good to about 1e-7 on its own."""
NOISY_RUNS = 9
"""Noise streams of the row with the rig's noise: odd, so that the median is one of them."""
SPREAD = 1.2
"""Factor by which a double pole pair is pulled apart to start a search over distinct ones."""


class Status(enum.Enum):
    """How a tuning ended; the value is a sentence with the remedy."""

    OPTIMAL = "The optimum lies inside the search bounds and meets every limit."
    ON_BOUND = (
        "The best design lies on a search bound: widen --zeta-bounds or --omega-bounds, or accept "
        "that the bound and not the rig decides."
    )
    INTERRUPTED = (
        "The search was stopped early: this is the best design found so far, not an optimum. Run "
        "it again to the end before relying on it."
    )
    JUDGED = (
        "This controller was given, not searched for: it is judged as it is, and nothing says that "
        "no other does better."
    )
    INFEASIBLE = "No poles in the search box meet every limit: relax the tightest one or the box."


@dataclass(frozen=True)
class Figures:
    """What one design does over the whole ratio interval.

    Attributes
    ----------
    worst : Metrics
        At the ratio where the objective is largest; extremes of voltage and gap are over all
        ratios and cases.
    case : Case
        Which way to run that was.
    ratio : float
        beta_c/beta there, of the plant that has the rig's y0.
    nominal : Metrics
        At ratio 1.
    ms, ms_one_more_sample : float
        Largest |S|, as it is and with one more whole sample of delay [-]; infinite where the loop
        is unstable for a plant of the family.
    radius, radius_one_more_sample : float
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
    case: Case
    ratio: float
    nominal: Metrics
    ms: float
    ms_one_more_sample: float
    radius: float
    radius_one_more_sample: float
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
class Baseline:
    """Poles to compare with, and what they do in `problem`, which has the same limits."""

    problem: TuningProblem
    poles: PoleSpec
    figures: Figures
    verification: Verification


@dataclass(frozen=True)
class Alternative:
    """The same poles, or where they were tuned anew their own, under another choice.

    `kind` is ``equilibrium``, ``method``, or ``planning`` for what a measurement would bring.
    """

    kind: str
    name: str
    poles: PoleSpec
    figures: Figures
    tuned: bool


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


@dataclass(frozen=True)
class TuneResult:
    """The answer of a tuning and everything worth inspecting.

    Attributes
    ----------
    status : Status
    problem : TuningProblem
    poles : PoleSpec
    design : Design
        As it runs on the plant that it was designed for (ratio 1).
    figures : Figures
    verification : Verification
    baseline : Baseline or None
        Other poles under the same limits: on the paper's rig the paper's zeta = 1, omega_n = 70.
    alternatives : tuple of Alternative
    landscape : Landscape
    evaluations : int
        Closed loops that the search simulated.
    emulated : EmulatedRow or None
        The design on the emulated rig; None where the rig emulates nothing.
    warnings : tuple of str
        About the rig and the problem, whatever the answer.
    with_noise : WithNoise or None
        The worst case with the rig's noise; None where it has none.
    relief : Relief or None
        What would make an infeasible problem feasible, as far as an option of a tuning can.
    """

    status: Status
    problem: TuningProblem
    poles: PoleSpec
    design: Design
    figures: Figures
    verification: Verification
    baseline: Baseline | None
    alternatives: tuple[Alternative, ...]
    landscape: Landscape | None
    evaluations: int
    emulated: EmulatedRow | None = None
    warnings: tuple[str, ...] = ()
    with_noise: WithNoise | None = None
    relief: Relief | None = None

    @property
    def improvement(self) -> float | None:
        """How many times smaller the worst case is than the baseline's; None without one."""
        if self.baseline is None:
            return None
        key = self.problem.objective.key
        before = getattr(self.baseline.figures.worst, key)
        return times_smaller(float(before), float(getattr(self.figures.worst, key)))


@dataclass(frozen=True)
class Unstabilisable:
    """No poles in the box stabilise the sampled loop; what would [s], nan where nothing does."""

    problem: TuningProblem
    largest_period: float
    largest_delay: float


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
        nominal=run(problem, poles, Case(), 1.0).metrics,
        ms=_peak(problem.loop, values, over, radius),
        ms_one_more_sample=_peak(problem.delayed_loop, values, over, later),
        radius=radius,
        radius_one_more_sample=later,
        noise_voltage=math.inf
        if radius >= 1
        else loops.noise_voltage(problem.loop, values, over, problem.position_noise).value,
        constraints=tuple(limits.values()),
        other_sign=run(problem, poles, replace(case, flipped=not case.flipped), ratio).metrics,
        max_error=whole,
        max_error_from_move=moving,
    )


def _peak(loop: loops.Loop, poles: Sequence[float], over: loops.Family, radius: float) -> float:
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


def solve(
    problem: TuningProblem,
    progress: Callable[[str, float], None] | None = None,
    baseline: PoleSpec | None = None,
) -> TuneResult | Unstabilisable:
    """Search, judge and verify; `baseline` is judged beside.

    A keyboard interrupt ends the search and returns the best design so far, marked as such; it is
    passed on when there is none yet. While the answer is judged, a matter of seconds, it waits
    for the end.
    """
    report = progress or (lambda *_: None)
    with deferred() as check:

        def checked(stage: str, done: float) -> None:
            check()
            report(stage, done)

        search = Search(problem, checked, clamped=problem.limits.allow_saturation)
        interrupted = False
        try:
            landscape = explore(search)
            if not stable_somewhere(landscape):
                return _what_would_stabilise(problem)
            searched = exchange if problem.emulated_runs is None else optimum
            found = searched(search, list(_starts(problem, landscape)))
            if not found.feasible and problem.emulated_runs is None:
                point = closest(problem, search.tell)
                found = search.candidate(found.x if point is None else point)
        except KeyboardInterrupt:
            if search.best is None:
                raise
            interrupted, found = True, search.best
        planned: tuple[Alternative, ...] = ()
        relaxed: tuple[PoleSpec, float] | None = None
        if not interrupted:
            try:
                if problem.emulated_runs is not None:
                    relaxed = relaxed_optimum(search, baseline)
                elif found.feasible:
                    planned = _planned(problem, _named(checked, "with U measured"))
            except KeyboardInterrupt:
                interrupted = True
        report("judging and verifying", 0.0)
        result = _judged(search, found, interrupted, baseline, planned, relaxed, report)
        try:
            check()
        except KeyboardInterrupt:
            return replace(result, status=Status.INTERRUPTED)
        return result


def solve_every_method(
    problems: Mapping[Method, TuningProblem],
    progress: Callable[[str, float], None] | None = None,
    baseline: PoleSpec | None = None,
) -> TuneResult | Unstabilisable:
    """Solve one problem a discretisation; return the best, the others among its alternatives."""
    report = progress or (lambda *_: None)
    results: dict[Method, TuneResult] = {}
    failure: Unstabilisable | None = None
    for name, problem in problems.items():
        found = solve(problem, _named(report, name), baseline)
        if isinstance(found, Unstabilisable):
            failure = found
            continue
        results[name] = found
        if found.status is Status.INTERRUPTED:
            break
    if not results:
        assert failure is not None  # noqa: S101 - every problem ended in one or the other
        return failure
    key = next(iter(problems.values())).objective.key
    best = min(
        results.values(), key=lambda r: (not r.figures.feasible, getattr(r.figures.worst, key))
    )
    tuned = [
        Alternative("method", name, r.poles, r.figures, True)
        for name, r in results.items()
        if r is not best
    ]
    kept = [a for a in best.alternatives if a.kind != "method" or a.name not in results]
    return replace(
        best,
        alternatives=(*kept, *tuned),
        status=Status.INTERRUPTED
        if any(r.status is Status.INTERRUPTED for r in results.values())
        else best.status,
        evaluations=sum(r.evaluations for r in results.values()),
    )


def _named(report: Callable[[str, float], None], name: str) -> Callable[[str, float], None]:
    return lambda stage, done: report(f"{name}: {stage}", done)


def _starts(problem: TuningProblem, landscape: Landscape) -> list[Any]:
    points = starting_points(landscape)
    if not problem.distinct:
        return [np.log(point) for point in points]
    zeta, omega_n = points[0]
    spreads = ((1.0, 1.0), (SPREAD, 1.0), (SPREAD, SPREAD))
    return [np.log([zeta * a, omega_n * b, zeta / a, omega_n / b]) for a, b in spreads]


def _judged(
    search: Search,
    found: Candidate,
    interrupted: bool,
    baseline: PoleSpec | None,
    planned: tuple[Alternative, ...],
    relaxed: tuple[PoleSpec, float] | None,
    report: Callable[[str, float], None],
) -> TuneResult:
    problem = search.problem
    poles = problem.poles(found.x)
    figures = judge(problem, poles)
    compared = None if baseline is None else judged_baseline(problem, baseline)
    report("judging and verifying", 0.3)
    alternatives = (*planned, *alternatives_of(problem, poles))
    report("judging and verifying", 0.6)
    verification = verify(problem, poles, figures)
    design = design_at(problem, poles)
    emulated = emulated_row(problem, design, baseline, relaxed)
    report("judging and verifying", 1.0)
    box = problem.box()
    on_bound = bool(np.any(np.abs(found.x[:, None] - box) < 1e-4))
    if interrupted:
        status = Status.INTERRUPTED
    elif not figures.feasible:
        status = Status.INFEASIBLE
    else:
        status = Status.ON_BOUND if on_bound else Status.OPTIMAL
    return TuneResult(
        warnings=cautions(problem),
        with_noise=with_noise(problem, poles, figures),
        relief=relief(problem) if status is Status.INFEASIBLE else None,
        status=status,
        problem=problem,
        poles=poles,
        design=design,
        figures=figures,
        verification=verification,
        baseline=compared,
        alternatives=alternatives,
        landscape=search.landscape,
        evaluations=search.evaluations,
        emulated=emulated,
    )


def judged_baseline(problem: TuningProblem, poles: PoleSpec) -> Baseline:
    """Return what other poles do in the same problem."""
    figures = judge(problem, poles)
    return Baseline(problem, poles, figures, verify(problem, poles, figures))


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
    ise, iae, itae = (
        float(np.median([getattr(m, key) for m in found])) for key in ("ise", "iae", "itae")
    )
    return WithNoise(NOISY_RUNS, ise, iae, itae, sum(m.crashed for m in found))


def verify(problem: TuningProblem, poles: PoleSpec, figures: Figures) -> Verification:
    """Re-simulate the worst case with SciPy."""
    scenario = scenario_at(problem, figures.case, figures.ratio)
    value = run(problem, poles, figures.case, figures.ratio)
    check = resimulate(problem.rig, design_at(problem, poles), scenario)
    if value.metrics.crashed and check.crashed:
        return Verification(value.value, value.value)
    return Verification(value.value, float(getattr(check, problem.objective.key)))


def _planned(
    problem: TuningProblem, report: Callable[[str, float], None]
) -> tuple[Alternative, ...]:
    """Return what measuring U would bring, tuned anew; nothing where U is measured already.

    The voltage is the rig's where it has one, else what K, C and m promise.
    """
    if problem.equilibrium == "measured" or problem.beta_error == 0:
        return ()
    rig = problem.rig
    voltage = rig.operating_point.voltage or believed_equilibrium(rig, "model").U
    other = changed(problem, equilibrium="measured", beta_error=None, voltage=voltage)
    search = Search(other, report, clamped=other.limits.allow_saturation)
    landscape = explore(search)
    if not stable_somewhere(landscape):
        return ()
    poles = other.poles(exchange(search, list(_starts(other, landscape))).x)
    return (Alternative("planning", "measured", poles, judge(other, poles), True),)


def alternatives_of(problem: TuningProblem, poles: PoleSpec) -> tuple[Alternative, ...]:
    """Return the same poles under the other equilibrium readings and discretisations.

    Readings of a voltage that the rig does not give are left out.
    """
    known = EQUILIBRIA if problem.rig.operating_point.voltage is not None else ("model",)
    found = []
    for name in known:
        if name != problem.equilibrium:
            other = changed(problem, equilibrium=name, voltage=None)
            found.append(Alternative("equilibrium", name, poles, judge(other, poles), False))
    for method in METHODS:
        if method != problem.method:
            other = changed(problem, method=method)
            found.append(Alternative("method", method, poles, judge(other, poles), False))
    return tuple(found)


def changed(problem: TuningProblem, **options: Any) -> TuningProblem:
    """Return the problem with other options of :func:`build_problem`."""
    known: dict[str, Any] = {
        "objective": problem.objective.key,
        "equilibrium": problem.equilibrium,
        "method": problem.method,
        "beta_error": problem.given_beta_error,
        "voltage": problem.believed.U,
        "max_ms": problem.limits.max_ms,
        "max_noise_voltage": problem.limits.max_noise_voltage,
        "allow_saturation": problem.limits.allow_saturation,
        "scenarios": "robust" if any(case.flipped for case in problem.cases) else "nominal",
        "distinct": problem.distinct,
        "zeta_bounds": tuple(problem.bounds[0]),
        "omega_bounds": tuple(problem.bounds[1]),
        "seed": problem.seed,
        "certifies": problem.certifies,
        "controller": problem.controller,
        "gains": problem.gains,
    }
    return build_problem(problem.rig, **known | options)


def _what_would_stabilise(problem: TuningProblem) -> Unstabilisable:
    """Return the largest period and, at the rig's period, the largest delay that could work."""
    sampling = problem.rig.sampling
    shortest = sampling.delay / MOST_DELAYED_PERIODS
    return Unstabilisable(
        problem,
        _largest(problem, shortest, sampling.period, lambda value: {"period": value}),
        _largest(problem, 0.0, sampling.delay, lambda value: {"delay": value}),
    )


def _largest(
    problem: TuningProblem, low: float, high: float, change: Callable[[float], dict[str, float]]
) -> float:
    """Bisect from `low` to the hopeless `high` for the largest value that still works."""
    found = math.nan
    for _ in range(10):
        middle = (low + high) / 2
        if _stabilisable(problem, change(middle)):
            low = found = middle
        else:
            high = middle
    return found


def _stabilisable(problem: TuningProblem, change: dict[str, float]) -> bool:
    rig = problem.rig
    sampling = rig.sampling.model_copy(update=change)
    moved = rig.model_copy(update={"sampling": sampling})
    loop = loops.build_loop(moved, problem.believed, method=problem.method)
    zeta, omega_n = (np.geomspace(low, high, 12) for low, high in problem.bounds)
    return any(
        loops.spectral_radius(loop, (z, w, z, w), problem.family).value < 1
        for z in zeta
        for w in omega_n
    )
