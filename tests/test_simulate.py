from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import replace
from functools import cache
from typing import Any

import byhand
import numpy as np
import pytest
import reference
from byhand import LAWS, OTHERS
from numpy.typing import NDArray
from rigs import MINIMAL, OFFSET, SHORT, rig_with
from scipy.integrate import solve_ivp

from maglev_design.controller.design import (
    Design,
    PoleSpec,
    make_design,
    plant_beta,
    reference_path,
    voltage_on_plant,
)
from maglev_design.options import EQUILIBRIA, METHODS, Controller, Equilibrium, Method
from maglev_design.rig import Rig
from maglev_design.simulation import (
    Crash,
    LoopGraph,
    Response,
    Scenario,
    build,
    mirrored,
    nominal_scenario,
    pole_sensitivities,
    resimulate,
    simulate,
    stated_errors,
)
from maglev_design.simulation.grid import contact_gap
from maglev_design.simulation.noise import POSITION_CHANNEL, standard_normals

FIGURES = ("ise", "iae", "itae")
RIGS = {"paper": SHORT, "offset": OFFSET}

INDEPENDENT = 1e-6
"""Relative: RK4 leaves some 1e-8 at its default step, DOP853 about as much at kinks of |e|."""
INDEPENDENT_NOISE = 1e-5
"""Relative: with noise |e| has a kink at every sign change, on which DOP853 spends its accuracy."""
SAME_SAMPLES = 1e-9
"""Relative, for a voltage computed from samples of two integrators."""
DIFFERENTIATED = 1e-8
"""As SAME_SAMPLES, for a law that differentiates the gap: ten times the gain."""


def design_of(rig: Rig, zeta: float = 1.0, omega: float = 70.0, **options: Any) -> Design:
    return make_design(rig, PoleSpec.double(zeta, omega), **options)


def fastest_of(design: Design) -> float:
    fast = [design.named_gains.get(name, 0.0) for name in ("k3", "omega_f")]
    return max(*fast, *design.poles.values[1::2])


def loop_of(
    rig: Rig, design: Design, *, continuous: bool = False, refine: int = 1, directions: int = 0
) -> LoopGraph:
    own: dict[str, Any] = {
        "controller": design.controller,
        "refine": refine,
        "directions": directions,
    }
    if not continuous:
        return build(rig, design.method, **own)
    return build(rig, None, fastest=fastest_of(design), **own)


def run(
    rig: Rig,
    design: Design | None = None,
    scenario: Scenario | None = None,
    **options: Any,
) -> Response:
    design = design or design_of(rig)
    scenario = scenario or nominal_scenario(rig, plant_beta(rig))
    return simulate(loop_of(rig, design, **options), design, scenario)


def finite(response: Response) -> bool:
    arrays = (response.gap, response.velocity, response.commanded, response.applied)
    numbers = [x for x in json_numbers(response.metrics.as_dict()) if not isinstance(x, bool)]
    return bool(all(np.isfinite(a).all() for a in arrays) and np.isfinite(numbers).all())


def json_numbers(value: Any) -> list[float]:
    if isinstance(value, dict):
        return [x for v in value.values() for x in json_numbers(v)]
    return [value] if isinstance(value, int | float) else []


# --- known figures -------------------------------------------------------------------------


def test_the_continuous_loop_of_the_paper_has_the_known_figures(paper_rig: Rig) -> None:
    metrics = run(paper_rig, continuous=True).metrics
    for name, digits in reference.NOMINAL_DIGITS.items():
        assert (
            f"{getattr(metrics, name):.{digits - 1}e}"
            == f"{reference.NOMINAL[name]:.{digits - 1}e}"
        )
    assert sum(metrics.itae_split.values()) == pytest.approx(metrics.itae, rel=1e-12)
    assert metrics.itae_split["hold"] < 1e-6 * metrics.itae
    assert not metrics.crashed


WORST_POINTS = (0.85, 0.925, 1.0, 1.075, 1.15)


@pytest.mark.parametrize("equilibrium", EQUILIBRIA)
def test_the_worst_case_of_the_paper_s_gains_is_the_known_one(
    paper_rig: Rig, equilibrium: Equilibrium
) -> None:
    method: Any = reference.WORST_METHOD[equilibrium]
    loop, worst = build(paper_rig, method), 0.0
    for ratio in WORST_POINTS:
        beta = plant_beta(paper_rig) / ratio
        held = voltage_on_plant(paper_rig, beta)  # U measured anew on every plant, as in the paper
        design = design_of(paper_rig, method=method, equilibrium=equilibrium, voltage=held)
        worst = max(worst, simulate(loop, design, nominal_scenario(paper_rig, beta)).metrics.itae)
    assert f"{worst:.1e}" == f"{reference.WORST_ITAE[equilibrium]:.1e}"


# --- against the independent integrator ----------------------------------------------------


@pytest.mark.parametrize("noise", [False, True], ids=["quiet", "noise"])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0, 1.7])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", RIGS)
def test_an_independent_integrator_finds_the_same_figures(
    name: str, method: Method, share: float, noise: bool
) -> None:
    base = RIGS[name]
    rig = rig_with(base, {"sampling.delay": share * base["sampling"]["period"]})
    design = design_of(rig, 0.9, 50.0, method=method)
    scenario = replace(nominal_scenario(rig, plant_beta(rig) / 1.05), noise=noise, seed=3, index=2)
    ours, theirs = run(rig, design, scenario).metrics, resimulate(rig, design, scenario)
    assert not ours.crashed
    assert not theirs.crashed
    for figure in FIGURES:
        assert getattr(ours, figure) == pytest.approx(
            getattr(theirs, figure), rel=INDEPENDENT_NOISE if noise else INDEPENDENT
        )
    assert ours.peak_voltage == pytest.approx(theirs.peak_voltage, rel=SAME_SAMPLES)


@pytest.mark.parametrize(
    ("base", "share", "noise"),
    [("paper", 0.0, True), ("offset", 0.3, False), ("paper", 1.7, False)],
)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", OTHERS)
def test_an_independent_integrator_finds_the_figures_of_every_controller(
    name: str, method: Method, base: str, share: float, noise: bool
) -> None:
    rig = rig_with(RIGS[base], {"sampling.delay": share * RIGS[base]["sampling"]["period"]})
    design = design_of(rig, 0.9, 50.0, method=method, controller=LAWS[name])
    scenario = replace(nominal_scenario(rig, plant_beta(rig) / 1.05), noise=noise, seed=3, index=2)
    ours, theirs = run(rig, design, scenario).metrics, resimulate(rig, design, scenario)
    assert not ours.crashed
    assert not theirs.crashed
    for figure in FIGURES:
        assert getattr(ours, figure) == pytest.approx(
            getattr(theirs, figure), rel=INDEPENDENT_NOISE if noise else INDEPENDENT
        )
    same = DIFFERENTIATED if "pid" in name else SAME_SAMPLES
    assert ours.peak_voltage == pytest.approx(theirs.peak_voltage, rel=same)


@pytest.mark.parametrize("name", LAWS)
def test_a_loop_refuses_a_design_of_another_controller(name: str) -> None:
    rig = rig_with(SHORT)
    loop = build(rig, "tustin", controller=LAWS[name])
    for other in LAWS:
        design = design_of(rig, controller=LAWS[other])
        if other == name:
            simulate(loop, design, nominal_scenario(rig, plant_beta(rig)))
            continue
        with pytest.raises(ValueError, match="cannot run"):
            simulate(loop, design, nominal_scenario(rig, plant_beta(rig)))


@pytest.mark.parametrize("horizon", [0.3001, 0.4004, 0.3999])
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_horizon_between_two_samples_is_kept(horizon: float, share: float) -> None:
    rig = rig_with(SHORT, {"reference.horizon": horizon, "sampling.delay": share * 1e-3})
    response = run(rig)
    assert response.times[-1] == horizon
    assert len(response.times) == math.ceil(horizon / 1e-3) + 1
    check = resimulate(rig, design_of(rig), nominal_scenario(rig, plant_beta(rig)))
    for figure in FIGURES:
        assert getattr(response.metrics, figure) == pytest.approx(
            getattr(check, figure), rel=INDEPENDENT
        )


# --- convergence ---------------------------------------------------------------------------

SLACK = 0.25
"""How far the observed order may be off for the fast filters of some controllers."""
PERIODS = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
ORDER = 0.2
"""How far the observed order of the last halving may be off: the next order still shows."""


@cache
def figures_at(method: Method | None, period: float) -> NDArray[np.float64]:
    rig = rig_with(SHORT, {"sampling.period": period})
    design = design_of(rig, method=method or "tustin")
    metrics = run(rig, design, continuous=method is None).metrics
    return np.array([getattr(metrics, name) for name in FIGURES])


@pytest.mark.parametrize(("method", "slack"), [("tustin", 0.3), ("euler", ORDER), ("zoh", ORDER)])
def test_the_sampled_loop_becomes_the_continuous_one(method: Method, slack: float) -> None:
    # first order whatever the method: the hold delays the voltage by half a period
    limit = figures_at(None, 1e-3)
    errors = [np.abs(figures_at(method, period) - limit) for period in PERIODS]
    assert (errors[-1] < 0.01 * limit).all()
    orders = np.log2(errors[-2] / errors[-1])
    assert orders == pytest.approx(np.ones(3), abs=slack)


@cache
def continuous_gap(name: str) -> NDArray[np.float64]:
    rig = rig_with(SHORT)
    return run(rig, design_of(rig, controller=LAWS[name]), continuous=True).gap


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", OTHERS)
def test_every_sampled_loop_becomes_its_continuous_one(name: str, method: Method) -> None:
    distances = []
    for shorter in (4, 8):
        rig = rig_with(SHORT, {"sampling.period": 1e-3 / shorter})
        response = run(rig, design_of(rig, method=method, controller=LAWS[name]))
        moved = response.gap[::shorter] - continuous_gap(name)
        distances.append(np.abs(moved).max())
    assert distances[-1] < 0.05 * np.abs(continuous_gap(name) - response.reference[::8]).max()
    assert np.log2(distances[0] / distances[1]) == pytest.approx(1.0, abs=SLACK)


CONTINUOUS = 1e-7
"""Of the largest error of the ball: RK4 leaves 1e-6 at its default step, 4e-9 at a quarter."""


@pytest.mark.parametrize("base", RIGS)
@pytest.mark.parametrize("name", LAWS)
def test_a_continuous_loop_is_the_one_integrated_by_another_program(name: str, base: str) -> None:
    # law, plant and quadratures by hand, the integrator SciPy's: only the reference is shared
    rig, law = rig_with(RIGS[base]), LAWS[name]
    design = design_of(rig, 0.9, 50.0, controller=law)
    beta, believed = plant_beta(rig) / 1.05, design.believed
    response = run(rig, design, nominal_scenario(rig, beta), continuous=True, refine=4)
    g, y0 = rig.plant.gravity, rig.plant.gap_offset
    known = byhand.Known(
        *(design.Y, believed.U, believed.C_U, believed.C_Y, believed.beta), *(g, y0)
    )
    a, b, c, d = byhand.core(law, design.named_gains, believed.C_U, believed.C_Y)
    size, path = len(a), reference_path
    extremes = [math.inf, -math.inf]

    def rates(t: float, x: NDArray[np.float64]) -> list[float]:
        y_ref, v_ref, acc_ref = path(rig, np.array([t]))[:, 0]
        read = np.array([x[0] - y_ref, x[1] - v_ref, x[0] - design.Y])
        w = (c @ x[2 : 2 + size] + d @ read).item()
        u = byhand.command(law, w, y_ref, acc_ref, known)
        extremes[:] = min(extremes[0], u), max(extremes[1], u)
        pull = g - beta * u**2 / (x[0] + y0) ** 2
        error = abs(read[0])
        return [x[1], pull, *(a @ x[2 : 2 + size] + b @ read), t * error * 1e6]

    start = np.zeros(3 + size)
    start[:2] = rig.initial.gap, rig.initial.velocity
    if law.start == "bumpless":
        start[3] = (rig.initial.gap - rig.reference.start_gap) / design.named_gains["omega_f"]
    found = solve_ivp(
        rates,
        (0.0, rig.reference.horizon),
        start,
        method="DOP853",
        t_eval=response.times,
        rtol=1e-10,
        atol=1e-14,
        max_step=2e-3,
    )
    low, high = rig.limits.voltage
    assert low < extremes[0] < extremes[1] < high, "neither clamp nor anti-windup acts"
    largest = np.abs(response.gap - response.reference).max()
    assert response.gap == pytest.approx(found.y[0], abs=CONTINUOUS * largest)
    assert response.metrics.itae == pytest.approx(found.y[-1, -1] / 1e6, rel=INDEPENDENT)


@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
@pytest.mark.parametrize("name", RIGS)
def test_the_integration_is_of_fourth_order(name: str, continuous: bool) -> None:
    period = 10 * RIGS[name]["sampling"]["period"]
    rig = rig_with(RIGS[name], {"sampling.period": period})
    design = design_of(rig, 1.0, 30.0)
    rows = []
    for refine in (1, 2, 4):
        response = run(rig, design, continuous=continuous, refine=refine)
        figures = [getattr(response.metrics, figure) for figure in FIGURES]
        rows.append([response.gap[-1], response.velocity[-1], *figures])
    first, second = np.abs(np.diff(rows, axis=0))
    assert np.log2(first / second) == pytest.approx(np.full(5, 4.0), abs=ORDER)


@pytest.mark.parametrize("noise", [False, True], ids=["quiet", "noise"])
@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
@pytest.mark.parametrize(("name", "share"), [("paper", 0.0), ("offset", 0.3), ("paper", 1.7)])
def test_the_stated_stated_errors_the_error(
    name: str, share: float, continuous: bool, noise: bool
) -> None:
    base = RIGS[name]
    rig = rig_with(base, {"sampling.delay": share * base["sampling"]["period"]})
    design = design_of(rig, 0.9, 60.0)
    scenario = replace(nominal_scenario(rig, plant_beta(rig) / 1.1), noise=noise, seed=5)
    response, stated = stated_errors(rig, design, scenario, continuous=continuous)
    assert stated.bound
    best = run(rig, design, scenario, continuous=continuous, refine=16).metrics
    for figure in FIGURES:
        exact = getattr(best, figure)
        error = abs(getattr(response.metrics, figure) - exact) / exact
        assert error <= stated.relative[figure] < 1e-6


def test_the_stated_error_of_a_sampled_loop_is_a_bound_with_the_clamp_in_force() -> None:
    # the voltage changes at the ends of integration steps only: a clamp puts no kink inside one
    for gap in (0.017, 0.019, 0.028):
        rig = rig_with(SHORT, {"initial.gap": gap})
        design = design_of(rig, 1.4, 90.0)
        scenario = nominal_scenario(rig, plant_beta(rig))
        response, stated = stated_errors(rig, design, scenario)
        applied = response.applied
        assert (response.commanded != applied).any()
        assert stated.bound
        best = run(rig, design, scenario, refine=16).metrics
        for figure in FIGURES:
            exact = getattr(best, figure)
            off = abs(getattr(response.metrics, figure) - exact)
            assert off <= stated.relative[figure] * exact < 1e-6 * exact


def by_events(rig: Rig, design: Design) -> dict[str, float]:
    """Return ISE, IAE and ITAE of the continuous GPI loop, law by hand, every switch located.

    Between two switches the right side is smooth: the voltage is free or at a limit, the
    integrator moves or is frozen, the error has one sign.
    """
    g, y0, path = rig.plant.gravity, rig.plant.gap_offset, rig.reference
    low, high = rig.limits.voltage
    law, believed, beta = design.controller, design.believed, plant_beta(rig)
    known = byhand.Known(design.Y, believed.U, believed.C_U, believed.C_Y, believed.beta, g, y0)
    a, b, c, d = byhand.core(law, design.named_gains, believed.C_U, believed.C_Y)
    region = [0.0, 0.0, 0.0]

    def now(t: float, x: NDArray[np.float64]) -> tuple[float, float]:
        y_ref, v_ref, acc_ref = reference_path(rig, np.array([t]))[:, 0]
        read = np.array([x[0] - y_ref, x[1] - v_ref, x[0] - design.Y])
        w = (c @ x[2:4] + d @ read).item()
        return byhand.command(law, w, y_ref, acc_ref, known), float(read[0])

    def rates(t: float, x: NDArray[np.float64]) -> list[float]:
        over, under, side = region
        u, error = now(t, x)
        voltage = high if over > 0 else low if under < 0 else u
        frozen = (over > 0 and side > 0) or (under < 0 and side < 0)
        moved = a @ x[2:4] + b @ np.array([error, 0.0, 0.0])
        pull = g - beta * voltage**2 / (x[0] + y0) ** 2
        size = side * error
        own = [0.0 if frozen else moved[0], moved[1]]
        return [x[1], pull, *own, size * size * 1e6, size * 1e2, t * size * 1e2]

    events: list[Any] = [
        lambda t, x: now(t, x)[0] - high,
        lambda t, x: now(t, x)[0] - low,
        lambda t, x: now(t, x)[1],
    ]
    t, x = 0.0, np.array([rig.initial.gap, rig.initial.velocity, *[0.0] * 5])
    region[:] = [math.copysign(1.0, event(t, x)) for event in events]
    while t < path.horizon:
        for event, side in zip(events, region, strict=True):
            event.terminal, event.direction = True, -side  # only out of where it is
        stop = next(s for s in (path.start_time, path.end_time, path.horizon) if s > t)
        options: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-14, "max_step": 1e-3}
        found = solve_ivp(rates, (t, stop), x, method="DOP853", events=events, **options)
        t, x = float(found.t[-1]), found.y[:, -1]
        region[:] = [
            -side if len(at) else side for side, at in zip(region, found.t_events, strict=True)
        ]
    return dict(zip(FIGURES, (x[-3:] / np.array([1e6, 1e2, 1e2])).tolist(), strict=True))


@pytest.mark.parametrize(
    ("gap", "zeta", "omega"),
    [
        (0.017, 1.4, 90.0),
        (0.028, 1.0, 70.0),
        (0.0190891451760965, 1.275398242059929, 96.35383832015069),
        (0.0310, 0.76, 97.0),
        (0.0159, 1.2, 80.0),
    ],
)
def test_the_stated_error_of_a_clamped_continuous_loop_is_an_estimate_that_holds(
    gap: float, zeta: float, omega: float
) -> None:
    rig = rig_with(SHORT, {"initial.gap": gap})
    design = design_of(rig, zeta, omega)
    scenario = nominal_scenario(rig, plant_beta(rig))
    response, stated = stated_errors(rig, design, scenario, continuous=True)
    assert not stated.bound
    for figure, exact in by_events(rig, design).items():
        off = abs(getattr(response.metrics, figure) - exact)
        assert off <= stated.relative[figure] * exact < 0.02 * exact


@pytest.mark.parametrize("name", LAWS)
def test_a_continuous_loop_inside_its_voltage_range_has_a_bound(name: str) -> None:
    rig = rig_with(SHORT, {"limits.voltage": [0.0, 50.0], "initial.gap": 0.0243})
    design = design_of(rig, controller=LAWS[name])
    response, stated = stated_errors(
        rig, design, nominal_scenario(rig, plant_beta(rig)), continuous=True
    )
    assert response.metrics.min_voltage > 0
    assert stated.bound
    assert max(stated.relative.values()) < 1e-5


@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
def test_the_stated_error_of_a_lost_ball_is_an_estimate_that_holds(continuous: bool) -> None:
    rig = rig_with(SHORT, {"initial.velocity": 1.5})
    design = design_of(rig)
    scenario = nominal_scenario(rig, plant_beta(rig))
    response, stated = stated_errors(rig, design, scenario, continuous=continuous)
    assert response.metrics.crashed
    assert not stated.bound
    best = run(rig, design, scenario, continuous=continuous, refine=64).metrics
    for figure in FIGURES:
        exact = getattr(best, figure)
        off = abs(getattr(response.metrics, figure) - exact)
        assert off <= stated.relative[figure] * exact < 0.01 * exact


def test_the_stated_error_with_a_sensor_that_rounds_is_an_estimate() -> None:
    rig = rig_with(SHORT, {"emulator.sensor_step": 1e-5})
    design = design_of(rig)
    scenario = nominal_scenario(rig, plant_beta(rig))
    assert not stated_errors(rig, design, scenario, emulate=True)[1].bound
    assert stated_errors(rig, design, scenario)[1].bound


# --- gradients -----------------------------------------------------------------------------

POLES = np.array([0.9, 60.0, 1.2, 75.0])
DIRECTIONS = {2: np.array([[1.0, 0], [0, 1], [1, 0], [0, 1]]), 4: np.eye(4)}
DIFFERENCE_STEP = 1e-5
"""Relative step of the central differences, truncation 1e-10 and rounding 1e-16/STEP."""
GRADIENT = 1e-6
"""Of the largest component: the differences above times the curvature of a minimum of ITAE."""
DIFFERENTIABLE = ("itae", "iae", "ise", "peak_voltage", "min_voltage")


@pytest.mark.parametrize("directions", [2, 4])
@pytest.mark.parametrize("share", [0.0, 1.7])
@pytest.mark.parametrize("method", [*METHODS, None])
@pytest.mark.parametrize("name", RIGS)
def test_the_gradients_are_those_of_the_figures(
    name: str, method: Method | None, share: float, directions: int
) -> None:
    if method is None and share:
        return
    base = RIGS[name]
    rig = rig_with(base, {"sampling.delay": share * base["sampling"]["period"]})
    scenario = nominal_scenario(rig, plant_beta(rig) / 1.05)
    columns = DIRECTIONS[directions]

    def designed(poles: NDArray[np.float64]) -> Design:
        pairs = PoleSpec((poles[0], poles[1]), (poles[2], poles[3]))
        return make_design(rig, pairs, method=method or "tustin")

    fastest = 0.0 if method else 600.0  # one grid for all poles
    plain = build(rig, method, fastest=fastest)
    carrying = build(rig, method, fastest=fastest, directions=directions)
    design = designed(POLES)
    response = simulate(carrying, design, scenario, pole_sensitivities(carrying, design, columns))
    assert response.metrics == simulate(plain, design, scenario).metrics
    for figure in DIFFERENTIABLE:
        slopes = []
        for column in columns.T:
            step = DIFFERENCE_STEP * float(column @ POLES) / float(column @ column)
            ahead, behind = (
                getattr(simulate(plain, designed(POLES + s * column), scenario).metrics, figure)
                for s in (step, -step)
            )
            slopes.append((ahead - behind) / (2 * step))
        size = GRADIENT * max(abs(x) for x in slopes)
        assert response.gradients[figure] == pytest.approx(slopes, abs=size)
        assert response.gradients[figure].any()


@pytest.mark.parametrize("method", [*METHODS, None])
@pytest.mark.parametrize("name", OTHERS)
def test_the_gradients_of_every_controller_are_those_of_its_figures(
    name: str, method: Method | None
) -> None:
    rig = rig_with(SHORT, {"sampling.delay": 1.7e-3 if method == "euler" else 0.0})
    scenario = nominal_scenario(rig, plant_beta(rig) / 1.05)
    poles = 0.7 * POLES if method == "euler" else POLES

    def designed(values: NDArray[np.float64]) -> Design:
        pairs = PoleSpec((values[0], values[1]), (values[2], values[3]))
        return make_design(rig, pairs, method=method or "tustin", controller=LAWS[name])

    options: dict[str, Any] = {"controller": LAWS[name], "fastest": 0.0 if method else 800.0}
    plain, carrying = build(rig, method, **options), build(rig, method, **options, directions=4)
    design = designed(poles)
    response = simulate(carrying, design, scenario, pole_sensitivities(carrying, design, np.eye(4)))
    assert response.metrics == simulate(plain, design, scenario).metrics
    for figure in DIFFERENTIABLE:
        slopes = []
        for n, column in enumerate(np.eye(4)):
            step = DIFFERENCE_STEP * poles[n]
            ahead, behind = (
                getattr(simulate(plain, designed(poles + s * column), scenario).metrics, figure)
                for s in (step, -step)
            )
            slopes.append((ahead - behind) / (2 * step))
        size = GRADIENT * max(abs(x) for x in slopes)
        assert response.gradients[figure] == pytest.approx(slopes, abs=size)
        assert response.gradients[figure].any()


def test_an_unlimited_voltage_has_gradients_too() -> None:
    rig = rig_with(SHORT, {"limits.voltage": [0.0, math.inf]})
    limited = rig_with(SHORT, {"limits.voltage": [0.0, 1000.0]})
    gradients = []
    for one in (rig, limited):
        design = design_of(one)
        loop = loop_of(one, design, directions=2)
        scenario = nominal_scenario(one, plant_beta(one))
        sensitivities = pole_sensitivities(loop, design, DIRECTIONS[2])
        gradients.append(simulate(loop, design, scenario, sensitivities).gradients)
    for figure in DIFFERENTIABLE:
        assert np.isfinite(gradients[0][figure]).all()
        assert gradients[0][figure] == pytest.approx(gradients[1][figure], rel=1e-12)


def test_without_directions_there_are_no_gradients(short_rig: Rig) -> None:
    assert not run(short_rig).gradients


# --- crashes -------------------------------------------------------------------------------

FREE = {**MINIMAL}
"""A rig without any limit on voltage or gap."""


@dataclasses.dataclass(frozen=True)
class Fate:
    base: dict[str, Any]
    poles: tuple[float, float]
    beta_factor: float
    initial_gap: float
    where: str
    before: float


FATES = {
    "far too fast": Fate(FREE, (1.0, 2000.0), 1 / 1.1, 0.0256, "magnet", 0.0015),
    "too fast": Fate(FREE, (1.0, 400.0), 1 / 1.1, 0.0256, "magnet", 0.02),
    "absurd": Fate(FREE, (1.0, 1e5), 1.0, 0.0256, "magnet", 0.002),
    "far too strong": Fate(SHORT, (1.0, 70.0), 100.0, 0.0244, "magnet", 0.05),
    "far too weak": Fate(SHORT, (1.0, 70.0), 0.01, 0.0244, "dropped", 0.2),
    "weak without a floor": Fate(FREE, (1.0, 70.0), 0.01, 0.0246, "magnet", 0.5),
    "beyond the floor": Fate(SHORT, (1.0, 70.0), 1.0, 0.06, "dropped", 0.0015),
    "inside the magnet": Fate(SHORT, (1.0, 70.0), 1.0, 0.0005, "magnet", 0.0015),
}


def fate_of(fate: Fate) -> tuple[Rig, Design, Scenario]:
    rig = rig_with(fate.base)
    scenario = Scenario(plant_beta(rig) * fate.beta_factor, fate.initial_gap)
    return rig, design_of(rig, *fate.poles), scenario


@pytest.mark.parametrize("name", FATES)
def test_a_crash_is_reported_with_place_and_time_and_nothing_is_nan(name: str) -> None:
    fate = FATES[name]
    rig, design, scenario = fate_of(fate)
    response = run(rig, design, scenario)
    crash = response.metrics.crash
    assert isinstance(crash, Crash)
    assert crash.where == fate.where
    assert 0 < crash.time <= fate.before
    assert finite(response)
    step = int(np.searchsorted(response.times, crash.time - 1e-9))
    assert response.times[step] == crash.time
    low, high = contact_gap(rig), rig.limits.gap[1]
    assert (response.gap[1:step] > low).all()
    assert (response.gap[1:step] < high).all()
    assert (response.gap[step:] == response.gap[-1]).all(), "it stays where it is"
    assert not response.velocity[step:].any()
    assert response.metrics.peak_voltage == response.commanded[:step].max()
    json.dumps(response.metrics.as_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("name", "crashes"),
    [("far too strong", True), ("far too weak", True), ("weak without a floor", True)],
)
def test_a_continuous_loop_that_crashes_holds_no_nan(name: str, crashes: bool) -> None:
    rig, design, scenario = fate_of(FATES[name])
    response = run(rig, design, scenario, continuous=True)
    assert response.metrics.crashed is crashes
    assert finite(response)


@pytest.mark.parametrize("name", ["too fast", "far too fast", "far too strong", "far too weak"])
def test_the_independent_integrator_sees_the_same_crash(name: str) -> None:
    rig, design, scenario = fate_of(FATES[name])
    check = resimulate(rig, design, scenario)
    ours = run(rig, design, scenario).metrics
    assert check.crashed is ours.crashed is True
    assert check.peak_voltage == pytest.approx(ours.peak_voltage, rel=1e-6)


def test_the_gradients_of_a_crash_are_finite() -> None:
    rig, design, scenario = fate_of(FATES["far too strong"])
    loop = loop_of(rig, design, directions=2)
    sensitivities = pole_sensitivities(loop, design, DIRECTIONS[2])
    response = simulate(loop, design, scenario, sensitivities)
    assert response.metrics.crashed
    assert all(np.isfinite(g).all() for g in response.gradients.values())


@pytest.mark.parametrize("start", [0.002, 0.0499])
def test_a_start_near_a_limit_is_survived(start: float) -> None:
    rig = rig_with(SHORT)
    response = run(rig, scenario=Scenario(plant_beta(rig), start))
    assert not response.metrics.crashed
    assert finite(response)
    assert abs(response.metrics.final_error) < 1e-4


# --- voltages ------------------------------------------------------------------------------


@pytest.mark.parametrize("low", [0.0, 1.0])
@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
def test_the_applied_voltage_stays_in_its_range(low: float, continuous: bool) -> None:
    rig = rig_with(SHORT, {"limits.voltage": [low, 3.0], "initial.gap": 0.026})
    response = run(rig, continuous=continuous)
    metrics = response.metrics
    assert (response.applied == np.clip(response.commanded, low, 3.0)).all()
    assert metrics.peak_voltage > 3.0
    assert metrics.peak_applied == 3.0
    assert metrics.peak_voltage == response.commanded.max()
    assert metrics.min_voltage == response.commanded.min()


def test_no_negative_voltage_is_ever_applied() -> None:
    rig = rig_with(SHORT, {"initial.gap": 0.015, "limits.voltage": [0.0, math.inf]})
    response = run(rig)
    assert response.metrics.min_voltage < 0
    assert response.applied.min() == 0.0


@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
def test_the_first_command_is_that_of_the_first_sample(continuous: bool) -> None:
    # at zero controller state: the feedforward and (k2 + C_Y)/C_U times the initial error
    rig = rig_with(SHORT)
    design = design_of(rig, method="euler")
    _, _, k2, _ = design.gains
    believed = design.believed
    y_ref, _, acc_ref = reference_path(rig, np.zeros(1))[:, 0]
    static = believed.U + (believed.C_Y * (y_ref - design.Y) - acc_ref) / believed.C_U
    kick = (k2 + believed.C_Y) / believed.C_U * (rig.initial.gap - y_ref)
    response = run(rig, design, continuous=continuous)
    assert response.commanded[0] == pytest.approx(static + kick, rel=1e-9)
    assert response.metrics.peak_voltage >= response.commanded[0]


def first_command(law: Controller, method: Method | None, **changes: Any) -> tuple[float, Design]:
    rig = rig_with(SHORT, changes)
    design = design_of(rig, controller=law, method=method or "tustin")
    response = run(rig, design, continuous=method is None)
    return float(response.commanded[0]), design


@pytest.mark.parametrize("method", [*METHODS, None])
@pytest.mark.parametrize("derivative", ["error", "measurement"])
def test_the_first_command_kicks_unless_the_start_is_bumpless(
    derivative: Any, method: Method | None
) -> None:
    kick, quiet = (
        Controller("lin-pid", derivative=derivative, filter=6.0, start=start)
        for start in ("kick", "bumpless")
    )
    rig = rig_with(SHORT)
    kicked, design = first_command(kick, method)
    bumpless, _ = first_command(quiet, method)
    k, here = design.named_gains, design.believed
    error = rig.initial.gap - rig.reference.start_gap
    integral = k["k1"] * rig.sampling.period / 2 if method == "tustin" else 0.0
    steady = here.U + (k["k2"] + here.C_Y + integral) * error / here.C_U
    assert bumpless == pytest.approx(steady, rel=1e-12), "nothing is differentiated"
    stepped = error if derivative == "error" else rig.initial.gap - design.Y
    # the bilinear filter omega_f s/(s + omega_f) lets k3 omega_f/(1 + omega_f T/2) through
    through = k["k3"] * k["omega_f"]
    if method == "tustin":
        through /= 1 + k["omega_f"] * rig.sampling.period / 2
    assert kicked - bumpless == pytest.approx(through * stepped / here.C_U, rel=1e-9)
    assert abs(kicked - bumpless) > 1.0


def test_a_bumpless_start_reads_the_first_sample_with_its_noise() -> None:
    law = Controller("lin-pid", start="bumpless")
    rig = rig_with(SHORT, {"noise.position": 1e-5, "noise.input": 0.0})
    design = design_of(rig, controller=law)
    scenario = replace(nominal_scenario(rig, plant_beta(rig)), noise=True, seed=4)
    first = float(run(rig, design, scenario).commanded[0])
    quiet = float(run(rig, design).commanded[0])
    noise = 1e-5 * standard_normals(4, 0, POSITION_CHANNEL, 1)[0]
    k, here = design.named_gains, design.believed
    share = (k["k2"] + here.C_Y + k["k1"] * rig.sampling.period / 2) / here.C_U
    assert first - quiet == pytest.approx(share * noise, rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
def test_every_controller_is_clamped(name: str, continuous: bool) -> None:
    rig = rig_with(SHORT, {"limits.voltage": [1.0, 3.0], "initial.gap": 0.026})
    response = run(rig, design_of(rig, controller=LAWS[name]), continuous=continuous)
    assert (response.applied == np.clip(response.commanded, 1.0, 3.0)).all()
    assert response.metrics.peak_voltage > response.metrics.peak_applied == 3.0
    assert not response.metrics.crashed
    assert abs(response.metrics.final_error) < 5e-4


@pytest.mark.parametrize("name", LAWS)
def test_the_voltage_held_at_the_start_is_the_feedforward(name: str) -> None:
    # until the first voltage acts the ball sees what the law commands without a correction
    rig = rig_with(OFFSET, {"sampling.delay": 0.0017, "initial.velocity": 0.0})
    design = design_of(rig, controller=LAWS[name])
    here, g, y0 = design.believed, rig.plant.gravity, rig.plant.gap_offset
    known = byhand.Known(design.Y, here.U, here.C_U, here.C_Y, here.beta, g, y0)
    beta = plant_beta(rig) / 1.1
    response = run(rig, design, nominal_scenario(rig, beta))
    u = byhand.command(LAWS[name], 0.0, rig.reference.start_gap, 0.0, known)
    pull = g - beta * u**2 / (rig.initial.gap + y0) ** 2
    time = rig.sampling.period
    assert response.velocity[1] == pytest.approx(pull * time, rel=1e-4)
    if LAWS[name].name == "fee-gpi" or LAWS[name].feedforward == "static":
        still = run(rig, design, Scenario(plant_beta(rig), rig.reference.start_gap))
        assert still.gap[:80] == pytest.approx(rig.reference.start_gap, abs=1e-12)


def test_a_held_voltage_acts_after_its_delay() -> None:
    # two and a half periods: until then the ball sees only the feedforward
    rig = rig_with(SHORT, {"sampling.delay": 0.0025, "initial.gap": 0.0242})
    moved = rig_with(SHORT, {"sampling.delay": 0.0025, "initial.gap": 0.02421})
    still, away = run(rig), run(moved)
    assert still.gap[:90] == pytest.approx(np.full(90, 0.0242), abs=1e-9)
    free = 0.0242 + 1e-5 * np.cosh(math.sqrt(2 * 9.81 / 0.0242) * away.times[:3])
    assert away.gap[:3] == pytest.approx(free, abs=1e-10)
    assert abs(away.gap[4] - 0.0242 - 1e-5 * math.cosh(0.004 * math.sqrt(2 * 9.81 / 0.0242))) > 1e-8


# --- noise, repetition, scenarios ----------------------------------------------------------


def noisy(rig: Rig, seed: int = 1, index: int = 0) -> Response:
    scenario = replace(nominal_scenario(rig, plant_beta(rig)), noise=True, seed=seed, index=index)
    return run(rig, scenario=scenario)


def test_the_same_run_twice_gives_the_same_bits() -> None:
    rig = rig_with(SHORT)
    for one, other in ((run(rig), run(rig)), (noisy(rig), noisy(rig))):
        assert one.metrics == other.metrics
        assert one.gap.tobytes() == other.gap.tobytes()
        assert one.commanded.tobytes() == other.commanded.tobytes()


def test_the_noise_does_not_depend_on_the_horizon() -> None:
    short, long = (noisy(rig_with(SHORT, {"reference.horizon": h})) for h in (0.4, 0.5))
    assert short.gap.tobytes() == long.gap[: len(short.gap)].tobytes()


def test_seed_and_scenario_number_choose_the_noise() -> None:
    rig = rig_with(SHORT)
    gaps = {noisy(rig, seed, index).gap.tobytes() for seed in (1, 2) for index in (0, 1)}
    assert len(gaps) == 4
    assert run(rig).gap.tobytes() not in gaps


def test_each_channel_of_noise_acts_where_it_should() -> None:
    only_position = rig_with(SHORT, {"noise.input": 0.0, "noise.position": 1e-6})
    only_input = rig_with(SHORT, {"noise.input": 1e-2, "noise.position": 0.0})
    quiet = run(rig_with(SHORT))
    # a noisy sample changes the first command; a noisy voltage the first motion only
    assert noisy(only_position).commanded[0] != quiet.commanded[0]
    assert noisy(only_input).commanded[0] == quiet.commanded[0]
    assert noisy(only_input).gap[1] != quiet.gap[1]
    assert noisy(only_input).applied[0] == quiet.applied[0]


def test_a_mirrored_scenario_has_the_initial_error_of_the_other_sign() -> None:
    rig = rig_with(SHORT)
    scenario = nominal_scenario(rig, plant_beta(rig))
    other = mirrored(rig, scenario)
    start = rig.reference.start_gap
    assert other.initial_gap - start == pytest.approx(start - scenario.initial_gap, abs=1e-17)
    assert mirrored(rig, other).initial_gap == pytest.approx(scenario.initial_gap, abs=1e-17)


def test_a_ball_at_rest_at_its_equilibrium_stays_there() -> None:
    rig = rig_with(MINIMAL)
    for continuous in (False, True):
        response = run(rig, continuous=continuous)
        assert np.abs(response.gap - 0.0246).max() < 1e-15
        assert response.metrics.itae < 1e-15


def test_the_initial_velocity_is_where_the_ball_starts() -> None:
    rig = rig_with(SHORT)
    scenario = Scenario(plant_beta(rig), 0.0242, 0.05)
    response = run(rig, scenario=scenario)
    assert response.velocity[0] == 0.05
    assert response.gap[1] - 0.0242 == pytest.approx(0.05 * 1e-3, rel=0.01)


def test_the_split_of_itae_is_by_the_move() -> None:
    rig = rig_with(SHORT)
    response = run(rig)
    split, path = response.metrics.itae_split, rig.reference
    error = np.abs(response.gap - response.reference) * response.times
    parts = {
        "start": response.times <= path.start_time,
        "move": (response.times >= path.start_time) & (response.times <= path.end_time),
        "hold": response.times >= path.end_time,
    }
    for name, mask in parts.items():
        assert split[name] == pytest.approx(
            np.trapezoid(error[mask], response.times[mask]), rel=0.05
        )
    assert sum(split.values()) == pytest.approx(response.metrics.itae, rel=1e-12)


def test_the_reference_of_a_response_is_the_path() -> None:
    rig = rig_with(OFFSET)
    response = run(rig)
    assert (response.reference == reference_path(rig, response.times)[0]).all()
    assert response.metrics.final_error == response.gap[-1] - response.reference[-1]
    assert (response.metrics.min_gap, response.metrics.max_gap) == (
        response.gap.min(),
        response.gap.max(),
    )


CLOSE_TO_REST = 2e-5
"""[m] After the move the ball is this close to its goal, from a start 0.2 mm off."""


@pytest.mark.parametrize("equilibrium", EQUILIBRIA)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", RIGS)
def test_every_reading_and_method_follows_the_path(
    name: str, method: Method, equilibrium: Equilibrium
) -> None:
    rig = rig_with(RIGS[name])
    held = voltage_on_plant(rig, plant_beta(rig))
    design = design_of(rig, method=method, equilibrium=equilibrium, voltage=held)
    metrics = run(rig, design).metrics
    assert not metrics.crashed
    assert abs(metrics.final_error) < CLOSE_TO_REST
