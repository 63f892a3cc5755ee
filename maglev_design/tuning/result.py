"""A tuning from the problem to the answer: searched, judged, compared."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maglev_design.controller.design import Design, PoleSpec, believed_equilibrium
from maglev_design.interrupt import deferred
from maglev_design.options import EQUILIBRIA, METHODS, Method
from maglev_design.tuning.alternatives import other_laws_and_drives
from maglev_design.tuning.cautions import cautions
from maglev_design.tuning.emulated import (
    EmulatedRow,
    emulated_row,
    optimum,
    relaxed_optimum,
)
from maglev_design.tuning.evaluation import design_at
from maglev_design.tuning.figures import (
    Figures,
    Verification,
    WithNoise,
    judge,
    times_smaller,
    verify,
    with_noise,
)
from maglev_design.tuning.landscape import Landscape, stable_somewhere, starting_points
from maglev_design.tuning.problem import TuningProblem, changed
from maglev_design.tuning.relief import (
    Relief,
    Unstabilisable,
    closest,
    relief,
    what_would_stabilise,
)
from maglev_design.tuning.search import Candidate, Search, exchange, explore

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
class Baseline:
    """Poles to compare with, and what they do in `problem`, which has the same limits."""

    problem: TuningProblem
    poles: PoleSpec
    figures: Figures
    verification: Verification


@dataclass(frozen=True)
class Alternative:
    """The same poles, or where they were tuned anew their own, under another choice.

    `kind` is ``equilibrium``, ``method``, ``planning`` for what a measurement would bring, ``law``
    or ``drive`` for another law or drive of a rig with a coil. `supply_voltage` [V] is what a drive
    needs.
    """

    kind: str
    name: str
    poles: PoleSpec
    figures: Figures
    tuned: bool
    supply_voltage: float | None = None


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
                return what_would_stabilise(problem)
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
                    planned += _with_other_drives(problem, checked)
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
        relief=relief(problem, figures.tightest.name) if status is Status.INFEASIBLE else None,
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
    poles = _quickly(other, report)
    if poles is None:
        return ()
    return (Alternative("planning", "measured", poles, judge(other, poles), True),)


def _quickly(problem: TuningProblem, report: Callable[[str, float], None]) -> PoleSpec | None:
    """Return the poles of a problem that is an aside; None where none are stable."""
    search = Search(problem, report, clamped=problem.limits.allow_saturation)
    landscape = explore(search)
    if not stable_somewhere(landscape):
        return None
    return problem.poles(exchange(search, list(_starts(problem, landscape))).x)


def _with_other_drives(
    problem: TuningProblem, report: Callable[[str, float], None]
) -> tuple[Alternative, ...]:
    """Return what another law or drive would bring on a rig with a coil, tuned anew."""
    named = _named(report, "another law or drive")
    found = other_laws_and_drives(problem, lambda other: _quickly(other, named))
    return tuple(Alternative(*row[:4], True, row[4]) for row in found)


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
