from __future__ import annotations

import itertools
import json
import math
import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import reference
from grids import coarse
from rigs import MINIMAL, QUICK, changed, rig_with

from maglev_design import linear_loop as loops
from maglev_design.controller.design import Design, PoleSpec, believed_equilibrium
from maglev_design.errors import InputError
from maglev_design.files import finite
from maglev_design.linear_loop import build_loop
from maglev_design.rig import Rig
from maglev_design.simulation import loop_for, nominal_scenario, simulate
from maglev_design.tuning import (
    Status,
    TuneResult,
    TuningProblem,
    Unstabilisable,
    as_json,
    build_problem,
    judge,
    search,
    solve,
    solve_every_method,
    trade_off,
)
from maglev_design.tuning.evaluation import coarse_slacks, design_at, linear_constraints, run, runs
from maglev_design.tuning.problem import CERTIFICATE, TuningCase
from maglev_design.tuning.result import Baseline, alternatives_of

GRID_BETTER = 2e-3
"""The local solver stops at 3e-6 of the objective; limits are kept with a margin."""
WORSE_RATIO = 1e-4
"""Excess at which the search itself calls another ratio worse."""
VIOLATED = 1e-4
"""Slack between two of the ratios at which the limits are kept."""
STEP = 1e-6
DIFFERENCE = 2e-5
"""Central differences of relative step 1e-6; kinks of |e| move with the poles."""
INTEGRATORS = 1e-5
"""The result itself calls more a failure."""
LOCAL = 1e-3
"""Two searches of one optimum."""


def quick(changes: dict[str, Any] | None = None) -> Rig:
    return rig_with(QUICK, changes)


def solved(problem: TuningProblem, progress: Callable[[str, float], None] | None = None) -> Any:
    """Solve with coarse grids: a variant needs no last digit."""
    with coarse():
        return solved_in_full(problem, progress)


def solved_in_full(
    problem: TuningProblem, progress: Callable[[str, float], None] | None = None
) -> Any:
    found = solve(problem, progress, PoleSpec.double(*reference.POLES))
    assert isinstance(found, TuneResult)
    return found


def baseline_of(result: TuneResult) -> Baseline:
    assert result.baseline is not None
    return result.baseline


@pytest.fixture(scope="module")
def problem() -> TuningProblem:
    return build_problem(quick())


@pytest.fixture(scope="module")
def result(problem: TuningProblem) -> TuneResult:
    found: TuneResult = solved_in_full(problem)
    return found


def worst_of(problem: TuningProblem, poles: PoleSpec, result: TuneResult) -> float:
    """Worst objective over the ends and the middle, inf where a limit is broken."""
    if min(float(slack[0]) for slack in coarse_slacks(problem, [poles]).values()) < 0:
        return math.inf
    low, high = problem.family.ratios
    runs = [run(problem, poles, problem.cases[0], r) for r in (low, (low + high) / 2, high)]
    if not all(c.satisfied for one in runs for c in one.constraints):
        return math.inf
    worst = max(one.value for one in runs)
    if worst < result.figures.worst.itae and not all(
        c.satisfied for c in linear_constraints(problem, poles)
    ):
        return math.inf  # the limit is broken between the points of the cheap search
    return worst


# --- the answer ----------------------------------------------------------------------------


def test_the_answer_keeps_every_limit(result: TuneResult) -> None:
    assert result.status is Status.OPTIMAL
    assert result.figures.feasible
    names = {c.name for c in result.figures.constraints}
    assert names == {
        "spectral radius",
        "Routh-Hurwitz",
        "Ms",
        "noise voltage",
        "smallest gap",
        "largest gap",
        "smallest commanded voltage",
        "largest commanded voltage",
    }


def test_the_limits_are_kept_at_every_ratio_between(
    problem: TuningProblem, result: TuneResult
) -> None:
    for ratio in np.linspace(*problem.family.ratios, 41):
        for limit in run(problem, result.poles, TuningCase(), float(ratio)).constraints:
            assert limit.slack >= -VIOLATED, (ratio, limit.name)


def test_no_point_of_a_dense_grid_is_better(problem: TuningProblem, result: TuneResult) -> None:
    zetas, omegas = (np.geomspace(low, high, 40) for low, high in problem.bounds)
    values = [
        worst_of(problem, PoleSpec.double(float(z), float(w)), result)
        for z, w in itertools.product(zetas, omegas)
    ]
    assert np.isfinite(values).sum() > 20
    assert min(values) >= result.figures.worst.itae * (1 - GRID_BETTER)


def test_no_neighbour_is_better(problem: TuningProblem, result: TuneResult) -> None:
    zeta, omega_n = result.poles.first
    values = [
        worst_of(problem, PoleSpec.double(zeta * a, omega_n * b), result)
        for a, b in itertools.product(np.geomspace(0.95, 1.05, 9), repeat=2)
    ]
    assert min(values) >= result.figures.worst.itae * (1 - GRID_BETTER)


def test_no_sampled_ratio_is_worse_than_the_worst(
    problem: TuningProblem, result: TuneResult
) -> None:
    low, high = problem.family.ratios
    values = [
        run(problem, result.poles, TuningCase(), float(r)).value for r in np.linspace(low, high, 41)
    ]
    assert max(values) <= result.figures.worst.itae * (1 + WORSE_RATIO)
    assert min(values) < 0.9 * result.figures.worst.itae  # the ratio matters
    assert low <= result.figures.ratio <= high


def test_a_loop_that_is_just_unstable_has_no_ms(problem: TuningProblem) -> None:
    late = build_problem(quick({"sampling.delay": 0.006}))
    figures = judge(late, PoleSpec.double(1.0, 70.0))
    assert 1 < figures.spectral_radius < 2
    assert figures.ms == math.inf
    (ms,) = [c for c in figures.constraints if c.name == "Ms"]
    assert (ms.value, ms.satisfied) == (math.inf, False)
    assert math.isfinite(judge(problem, PoleSpec.double(1.0, 70.0)).ms)


def test_an_independent_integrator_agrees(result: TuneResult) -> None:
    for check, figures in (
        (result.verification, result.figures),
        (baseline_of(result).verification, baseline_of(result).figures),
    ):
        assert check.passed
        assert 0 < check.relative_difference <= INTEGRATORS
        assert check.value == pytest.approx(figures.worst.itae, rel=1e-12)


def test_the_baseline_is_the_papers_poles_under_the_same_terms(
    problem: TuningProblem, result: TuneResult
) -> None:
    worst = baseline_of(result).figures.worst
    assert worst == judge(problem, PoleSpec.double(*reference.POLES)).worst
    assert result.improvement == worst.itae / result.figures.worst.itae
    assert result.improvement > 1


def test_the_other_readings_and_methods_are_shown(result: TuneResult) -> None:
    found = {(a.kind, a.name) for a in result.alternatives}
    assert found == {("planning", "measured"), ("method", "euler"), ("method", "zoh")}
    others = [a for a in result.alternatives if a.kind != "planning"]
    assert all(a.poles == result.poles and not a.tuned for a in others)


def test_readings_of_a_voltage_are_shown_where_the_rig_has_one(result: TuneResult) -> None:
    problem = build_problem(quick({"operating_point.voltage": 2.1}))
    found = {(a.kind, a.name) for a in alternatives_of(problem, result.poles)}
    assert {("equilibrium", "appendix-a"), ("equilibrium", "measured")} <= found


def test_what_measuring_the_voltage_would_bring_is_what_its_own_tuning_finds(
    result: TuneResult,
) -> None:
    (planned,) = [a for a in result.alternatives if a.kind == "planning"]
    rig = quick()
    volts = believed_equilibrium(rig, "model").U
    known = build_problem(quick({"operating_point.voltage": volts}), equilibrium="measured")
    found = solved_in_full(known)
    assert known.family.ratios == pytest.approx((0.99**2, 1.01**2))
    assert planned.figures.worst.itae == pytest.approx(found.figures.worst.itae, rel=1e-3)
    assert planned.figures.worst.itae < result.figures.worst.itae


def test_the_promise_is_kept_by_the_one_controller_on_every_plant(result: TuneResult) -> None:
    """What the design's numbers do on each plant, run by itself, is never above the promise."""
    volts = believed_equilibrium(quick(), "model").U
    rig = quick({"operating_point.voltage": volts, "uncertainty.voltage": 0.02})
    problem = build_problem(rig, equilibrium="measured")
    figures = judge(problem, result.poles)
    design = design_at(problem, result.poles)
    loop = loop_for(rig, design)
    seen = []
    for held in np.linspace(0.98, 1.02, 9):  # the voltage that the plant needs, over U
        plant = rig.plant.gravity * rig.operating_point.gap**2 / (held * volts) ** 2
        seen.append(simulate(loop, design, nominal_scenario(rig, plant)).metrics.itae)
    assert max(seen) == pytest.approx(figures.worst.itae, rel=1e-6)
    assert max(seen) > 1.1 * min(seen)  # one U on all of them: the ratio matters


def test_the_landscape_knows_where_the_answer_is(result: TuneResult) -> None:
    landscape = result.landscape
    assert landscape is not None
    assert landscape.feasible.any()
    assert not landscape.feasible.all()
    best = float(np.nanmin(np.where(landscape.feasible, landscape.objective, np.nan)))
    assert best >= result.figures.worst.itae * (1 - GRID_BETTER)


def test_two_searches_give_the_same_document(problem: TuningProblem, result: TuneResult) -> None:
    again = as_json(solved_in_full(build_problem(quick())))
    own = json.dumps(finite(as_json(result)))
    assert json.dumps(finite(again)) == own


# --- gradients -----------------------------------------------------------------------------


@pytest.mark.parametrize("objective", ["itae", "iae", "ise"])
@pytest.mark.parametrize(("case", "ratio"), [(TuningCase(), 0.9), (TuningCase(flipped=True), 1.08)])
def test_gradients_of_the_objective_and_of_the_limits(
    objective: str, case: TuningCase, ratio: float
) -> None:
    problem = build_problem(quick(), objective=objective, distinct=True, allow_saturation=False)
    at = np.array([1.1, 62.0, 0.9, 71.0])

    def figures(values: Any) -> tuple[Any, Any]:
        poles = PoleSpec((values[0], values[1]), (values[2], values[3]))
        (found,) = runs(problem, [(poles, case, ratio)], gradients=True)
        names = sorted({c.name for c in found.constraints})
        assert names == [
            "largest commanded voltage",
            "largest gap",
            "smallest commanded voltage",
            "smallest gap",
        ]
        tightest = [
            min((c for c in found.constraints if c.name == name), key=lambda c: c.slack)
            for name in names
        ]
        rows = [found.value, *(c.slack for c in tightest)]
        return np.array(rows), np.array([found.gradient, *(c.gradient for c in tightest)])

    _, slopes = figures(at)
    assert slopes.shape == (5, 4)
    numeric = np.empty_like(slopes)
    for n in range(4):
        step = np.zeros(4)
        step[n] = STEP * at[n]
        numeric[:, n] = (figures(at + step)[0] - figures(at - step)[0]) / (2 * step[n])
    size = np.abs(numeric * at).max(axis=1)
    assert size[0] > 0
    assert size[1] > 0
    assert size[3] > 0
    floor = 1e-9 * np.array([figures(at)[0][0], 1, 1, 1, 1])
    assert np.all(
        np.abs((slopes - numeric) * at).max(axis=1) <= np.maximum(DIFFERENCE * size, floor)
    )


def test_a_double_pair_has_the_gradient_along_its_two_directions(problem: TuningProblem) -> None:
    poles = PoleSpec.double(1.1, 66.0)
    trial = (poles, TuningCase(), 0.95)
    (double,) = runs(problem, [trial], gradients=True)
    (four,) = runs(build_problem(quick(), distinct=True), [trial], gradients=True)
    along = problem.directions
    assert double.gradient @ along == pytest.approx(four.gradient @ along, rel=1e-9)


# --- other ends ----------------------------------------------------------------------------


def test_limits_that_cannot_be_met_end_infeasible_and_name_the_tightest() -> None:
    box: dict[str, Any] = {"zeta_bounds": (0.7, 1.5), "omega_bounds": (50.0, 120.0)}
    found = solved(build_problem(quick(), max_ms=1.05, **box))
    assert found.status is Status.INFEASIBLE
    assert not found.figures.feasible
    assert found.figures.tightest.name == "Ms"
    assert found.figures.tightest.limit == 1.05
    assert found.figures.tightest.value > 1.05


def stable_somewhere(problem: TuningProblem, rig: Rig) -> bool:
    loop = build_loop(rig, problem.believed, method=problem.method)
    zetas, omegas = (np.geomspace(low, high, 20) for low, high in problem.bounds)
    return any(
        loops.spectral_radius(loop, (z, w, z, w), problem.family).value < 1
        for z, w in itertools.product(zetas, omegas)
    )


@pytest.mark.parametrize(("key", "value"), [("period", 0.06), ("delay", 0.06)])
def test_a_loop_too_slow_ends_with_what_would_do(key: str, value: float) -> None:
    base = changed(QUICK, {"sampling.period": 0.01, f"sampling.{key}": value})
    problem = build_problem(rig_with(base))
    found = solve(problem)
    assert isinstance(found, Unstabilisable)
    largest = getattr(found, f"largest_{key}")
    assert 0 < largest < value
    inside, outside = (
        rig_with(base, {f"sampling.{key}": float(f"{factor * largest:.6g}")})
        for factor in (0.999, 1.1)
    )
    assert stable_somewhere(problem, inside)
    assert not stable_somewhere(problem, outside)


def test_an_answer_on_a_search_bound_says_so() -> None:
    found = solved(build_problem(quick(), omega_bounds=(20, 50)))
    assert found.status is Status.ON_BOUND
    assert found.poles.first[1] == pytest.approx(50)
    assert found.figures.feasible


def interrupting(stage: str) -> Callable[[str, float], None]:
    def progress(now: str, done: float) -> None:
        if now == stage:
            raise KeyboardInterrupt

    return progress


def test_an_interrupt_keeps_the_best_design_so_far(
    problem: TuningProblem, result: TuneResult
) -> None:
    found = solved(problem, interrupting("local solver"))
    assert found.status is Status.INTERRUPTED
    assert found.figures.feasible
    assert found.figures.worst.itae >= result.figures.worst.itae * (1 - GRID_BETTER)
    assert found.landscape is not None


@pytest.fixture(scope="module")
def timed(paper_problem: TuningProblem) -> tuple[TuneResult, float]:
    """The answer that nothing interrupts, and how long it takes [s]."""
    start = time.perf_counter()
    full = solved_in_full(paper_problem)
    return full, time.perf_counter() - start


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.4, 0.8])
def test_a_signal_at_any_moment_is_an_interrupt(
    paper_problem: TuningProblem, timed: tuple[TuneResult, float], share: float
) -> None:
    full, whole = timed
    sent = threading.Event()

    def interrupt() -> None:
        sent.set()
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(share * whole, interrupt)
    before = signal.getsignal(signal.SIGINT)
    found = None
    try:
        timer.start()
        found = solved_in_full(paper_problem)
        early = sent.is_set()
        timer.cancel()
        timer.join()
        time.sleep(0.05)  # a signal that came after the end is taken here
    except KeyboardInterrupt:
        early = False  # before anything was found, or after the end
    if found is not None and early:
        after_the_last_piece = share > 0.5 and found.poles == full.poles
        assert found.status is Status.INTERRUPTED or after_the_last_piece
        assert found.figures.feasible
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_before_anything_was_found_is_passed_on(problem: TuningProblem) -> None:
    with pytest.raises(KeyboardInterrupt):
        solve(problem, interrupting("global grid"))


def test_progress_goes_through_every_stage_in_order(problem: TuningProblem) -> None:
    seen: list[tuple[str, float]] = []
    narrow = replace(problem, bounds=np.array([[0.9, 1.3], [80.0, 110.0]]))
    solved(narrow, lambda stage, done: seen.append((stage, done)))
    stages = list(dict.fromkeys(stage for stage, _ in seen))
    searches = ["global grid", "local solver"]
    planned = [f"with U measured: {stage}" for stage in searches]
    assert stages == [*searches, *planned, "judging and verifying"]
    for stage in stages:
        shares = [done for name, done in seen if name == stage]
        assert shares == sorted(shares)
        assert shares[-1] == 1.0


# --- certificates --------------------------------------------------------------------------


def test_a_required_certificate_moves_the_optimum_to_where_there_is_one(
    result: TuneResult,
) -> None:
    def certifies(design: Design) -> bool:
        return design.poles.first[1] < 0.9 * result.poles.first[1]

    found = solved(build_problem(quick(), certifies=certifies))
    assert found.status is Status.OPTIMAL
    assert found.figures.feasible
    assert found.poles.first[1] < 0.9 * result.poles.first[1]
    assert found.figures.worst.itae > result.figures.worst.itae
    (proof,) = (c for c in found.figures.constraints if c.name == CERTIFICATE)
    assert proof.satisfied
    assert proof.side == "lower"


def test_without_any_certificate_nothing_is_feasible_and_it_is_named() -> None:
    narrow = replace(build_problem(quick()), bounds=np.array([[0.9, 1.3], [60.0, 80.0]]))
    found = solved(replace(narrow, certifies=lambda _: False))
    assert found.status is Status.INFEASIBLE
    assert found.figures.tightest.name == CERTIFICATE


def test_the_trade_off_holds_the_optimum_and_its_front(result: TuneResult) -> None:
    def widest(design: Design) -> float:
        zeta, omega_n = design.poles.first
        return math.nan if zeta > 2 else zeta / omega_n

    found = trade_off(result, widest, lambda *_: None)
    assert (found.zeta[-1], found.omega_n[-1]) == result.poles.first
    assert found.objective[-1] == result.figures.worst.itae == found.objective.min()
    assert result.landscape is not None
    assert len(found.zeta) == result.landscape.feasible.sum() + 1
    assert np.isnan(found.certified).any()
    assert found.front[-1]
    assert not found.front[np.isnan(found.certified)].any()
    on = found.front
    for j, u in zip(found.objective[~on], found.certified[~on], strict=True):
        beaten = (found.objective[on] <= j) & (found.certified[on] >= u)
        assert np.isnan(u) or beaten.any()
    order = np.argsort(found.objective[on])
    assert np.all(np.diff(found.certified[on][order]) >= 0)
    assert sum(bool(row["on_front"]) for row in found.as_dicts()) == on.sum()


# --- variants ------------------------------------------------------------------------------


def test_robust_scenarios_are_never_milder_at_the_same_poles(problem: TuningProblem) -> None:
    robust = build_problem(quick(), scenarios="robust")
    assert len(robust.cases) > len(problem.cases)
    for poles in (PoleSpec.double(1, 70), PoleSpec.double(1.2, 90), PoleSpec.double(0.8, 60)):
        assert judge(robust, poles).worst.itae >= judge(problem, poles).worst.itae


def test_a_robust_design_keeps_the_limits_with_both_signs_and_noise(result: TuneResult) -> None:
    found = solved(build_problem(quick(), scenarios="robust"))
    assert found.figures.feasible
    assert found.figures.worst.itae >= result.figures.worst.itae * (1 - GRID_BETTER)


def test_distinct_poles_are_not_worse_than_a_double_pair(result: TuneResult) -> None:
    found = solved(build_problem(quick(), distinct=True))
    assert found.figures.feasible
    assert found.figures.worst.itae <= result.figures.worst.itae * (1 + LOCAL)
    assert found.poles.first != found.poles.second


def test_without_uncertainty_the_worst_case_is_the_nominal_one(result: TuneResult) -> None:
    found = solved(build_problem(quick(), beta_error=0))
    assert found.figures.ratio == 1.0
    assert found.figures.worst.itae == found.figures.nominal.itae
    assert found.figures.worst.itae < result.figures.worst.itae


def test_saturation_may_be_allowed(result: TuneResult) -> None:
    found = solved(build_problem(quick(), allow_saturation=True))
    names = {c.name for c in found.figures.constraints}
    assert not any("commanded" in name for name in names)
    assert found.figures.worst.itae <= result.figures.worst.itae * (1 + LOCAL)
    worst = found.figures.worst
    assert worst.min_voltage < 0 or worst.peak_voltage > 5
    assert worst.peak_applied <= 5


def test_the_noise_limit_binds_on_a_noisy_sensor(result: TuneResult) -> None:
    free = result.figures.noise_voltage
    found = solved(build_problem(quick(), max_noise_voltage=free / 2))
    assert found.figures.feasible
    assert found.figures.noise_voltage == pytest.approx(free / 2, rel=1e-3)
    assert found.figures.worst.itae > result.figures.worst.itae


def test_the_noise_limit_is_a_share_of_the_voltage_range() -> None:
    assert build_problem(quick()).limits.max_noise_voltage == pytest.approx(0.05 * 5)


def test_a_rig_without_limits_can_be_tuned() -> None:
    found = solved(build_problem(quick({"limits": ...})))
    assert found.figures.feasible
    assert "largest commanded voltage" not in {c.name for c in found.figures.constraints}
    assert found.verification.passed


def test_a_rig_that_only_holds_can_be_tuned() -> None:
    found = solved(build_problem(quick({"reference": ...})))
    assert found.figures.feasible
    assert found.improvement is not None
    assert found.improvement > 1


def test_a_rig_with_nothing_to_do_gives_an_answer() -> None:
    rig = rig_with(MINIMAL, {"sampling.period": 0.005})
    found = solved(build_problem(rig))
    gap = rig.operating_point.gap
    assert abs(found.problem.rig.initial.gap - gap) == pytest.approx(0.02 * gap)
    assert found.figures.worst.itae > 0
    document = finite(as_json(found))
    assert document["excitation"]["share_of_Z"] == 0.02
    assert json.dumps(document, allow_nan=False)


def test_every_method_is_tuned_and_the_best_is_kept() -> None:
    bounds = {"zeta_bounds": (0.9, 1.3), "omega_bounds": (60.0, 90.0)}
    problems = {m: build_problem(quick(), method=m, **bounds) for m in ("euler", "tustin")}  # type: ignore[arg-type]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "GRID", 5)
        found = solve_every_method(problems)  # type: ignore[arg-type]
    assert isinstance(found, TuneResult)
    tuned = [a for a in found.alternatives if a.tuned and a.kind == "method"]
    assert {found.problem.method, *(a.name for a in tuned)} == {"euler", "tustin"}
    assert all(a.figures.worst.itae >= found.figures.worst.itae for a in tuned)
    assert {a.name for a in found.alternatives if a.kind == "method"} == (
        {"euler", "tustin", "zoh"} - {found.problem.method}
    )


# --- bad arguments -------------------------------------------------------------------------

NAN = math.nan


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"objective": "itea"}, r"'itea' is unknown \(did you mean 'itae'\?\)"),
        ({"beta_error": 1.0}, "beta error = 1.0 .*less than 1"),
        ({"beta_error": -0.1}, "beta error"),
        ({"beta_error": NAN}, "beta error"),
        ({"max_ms": 1.0}, "max-ms = 1.0: must be greater than 1"),
        ({"max_ms": NAN}, "max-ms"),
        ({"max_noise_voltage": 0.0}, "max-noise-voltage = 0.0"),
        ({"max_noise_voltage": NAN}, "max-noise-voltage"),
        ({"zeta_bounds": (2.0, 1.0)}, "zeta-bounds = 2.0 1.0"),
        ({"zeta_bounds": (0.0, 1.0)}, "zeta-bounds"),
        ({"omega_bounds": (10.0, math.inf)}, "omega-bounds"),
        ({"omega_bounds": (NAN, 10.0)}, "omega-bounds"),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_problem(quick(), **arguments)


# --- the paper's rig in full ---------------------------------------------------------------


@pytest.fixture(scope="module")
def paper_result(paper_rig: Rig) -> TuneResult:
    found: TuneResult = solved_in_full(build_problem(paper_rig))
    return found


@pytest.fixture(scope="module")
def paper_problem(paper_rig: Rig) -> TuningProblem:
    return build_problem(paper_rig, scenarios="robust")


PAPER_OPTIMUM = (1.137, 107.3)
"""zeta [-], omega_n [rad/s]; Tustin, model reading, +-15 %, Ms <= 2, command inside 0 to 5 V."""
PAPER_OPTIMUM_ITAE = 9.934e-06
"""[m s^2] A dense search by another program, moving the controller's beta, found (1.10, 101)."""
FLAT = 5e-3
"""The optimum is flat: half a per cent in the poles is 1e-4 in the objective."""
EULER_TRAP = (1.25, 215.0)
"""Forward Euler with saturation: the optimum of a dense search done beforehand."""


def test_the_papers_rig_is_tuned_to_the_known_optimum(paper_result: TuneResult) -> None:
    assert paper_result.status is Status.OPTIMAL
    assert paper_result.poles.first == pytest.approx(PAPER_OPTIMUM, rel=FLAT)
    assert paper_result.figures.worst.itae == pytest.approx(PAPER_OPTIMUM_ITAE, rel=1e-3)
    assert paper_result.figures.ratio == pytest.approx(0.85)
    assert paper_result.figures.tightest.name in ("Ms", "largest commanded voltage")
    assert paper_result.verification.passed


def test_the_papers_poles_are_beaten_by_the_known_factor(paper_result: TuneResult) -> None:
    base = baseline_of(paper_result).figures
    assert base.worst.itae == pytest.approx(reference.WORST_ITAE["model"], abs=0.05e-5)
    assert base.feasible
    assert paper_result.improvement is not None
    assert paper_result.improvement >= 2.7
    assert paper_result.improvement == pytest.approx(3.12, abs=0.01)


def test_euler_with_saturation_is_a_trap_on_the_papers_rig(paper_rig: Rig) -> None:
    problem = build_problem(
        paper_rig, method="euler", allow_saturation=True, max_noise_voltage=math.inf
    )
    tuned = judge(problem, PoleSpec.double(*EULER_TRAP))
    base = judge(problem, PoleSpec.double(*reference.POLES))
    assert tuned.feasible
    assert base.worst.itae / tuned.worst.itae == pytest.approx(23, abs=0.5)
    assert tuned.worst.peak_voltage > 15
    assert tuned.spectral_radius < 1 < tuned.spectral_radius_one_more_sample
    assert tuned.noise_voltage > 10 * base.noise_voltage
