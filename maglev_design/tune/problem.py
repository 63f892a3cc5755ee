"""The tuning problem: what is minimised, over what, subject to what; and its evaluation.

Minimise over the poles the worst case, over the ratio interval and the cases, of an integral of
the error of the sampled nonlinear loop, subject to limits on that loop and on its linearisations
along the path. Values and exact gradients come from here; nothing here searches.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maglev_design import linear_loop as loops
from maglev_design import options
from maglev_design.design import (
    Believed,
    Design,
    PoleSpec,
    believed_equilibrium,
    fastest_unstable_pole,
    make_design,
)
from maglev_design.errors import InputError, nearest
from maglev_design.options import (
    DEFAULT_MAX_MS,
    TAN_GPI,
    Controller,
    Equilibrium,
    Method,
    Scenarios,
)
from maglev_design.parameters import Rig
from maglev_design.simulate import (
    LoopGraph,
    Metrics,
    Scenario,
    build,
    designed_for,
    mirrored,
    nominal_scenario,
    pole_sensitivities,
    simulate_batch,
)
from maglev_design.tune.excitation import Excitation, excited

Array = NDArray[np.float64]

DEFAULT_NOISE_SHARE = 0.05
"""Share of the voltage range that sensor noise may take."""
ZETA_BOUNDS = (0.3, 3.0)
SLOWEST_POLES, FASTEST_POLES = 0.3, 12.0
"""Search bounds of omega_n as multiples of the plant's fastest unstable pole on the path."""
FASTEST_ANGLE = 0.5
"""Largest omega_n T searched: beyond it a sample is a tenth of an oscillation."""
NOISE_SEEDS = 2
CERTIFICATE = "Lyapunov certificate"
Certifies = Callable[[Design], bool]
"""Whether a controller's sampled loop is proved stable over the gaps and ratios."""


@dataclass(frozen=True)
class Objective:
    """One row of the table of objectives: an attribute of ``Metrics`` to be made small."""

    key: options.Objective
    title: str
    unit: str


OBJECTIVES: Mapping[str, Objective] = {
    "itae": Objective("itae", "integral of t |e|", "m s^2"),
    "iae": Objective("iae", "integral of |e|", "m s"),
    "ise": Objective("ise", "integral of e^2", "m^2 s"),
}


@dataclass(frozen=True)
class Case:
    """One way to run: the sign of the initial error, a noise stream or none, the plant's y0.

    `shift` is the plant's y0 less the rig's [m].
    """

    flipped: bool = False
    noise: bool = False
    index: int = 0
    shift: float = 0.0


@dataclass(frozen=True)
class Limits:
    """What a design must keep to.

    Attributes
    ----------
    max_ms : float
        Largest |S| of the sampled loop, delay included [-].
    max_noise_voltage : float
        Standard deviation of the voltage that sensor noise makes [V].
    allow_saturation : bool
        Whether the commanded voltage may leave the actuator's range.
    """

    max_ms: float
    max_noise_voltage: float
    allow_saturation: bool


@dataclass(frozen=True)
class TuningProblem:
    """Everything a search needs; built once, looked at or solved.

    Attributes
    ----------
    rig : Rig
    objective : Objective
    equilibrium, method : str
    believed : Believed
        What every controller of this problem takes the equilibrium to be; fixed.
    limits : Limits
    distinct : bool
        Whether the two pole pairs may differ (four variables instead of two).
    bounds : array, shape (2, 2)
        Rows zeta [-] and omega_n [rad/s]; lower and upper.
    cases : tuple of Case
    seed : int
    loop, delayed_loop : Loop
        Linear loops, the second with one more whole sample of delay.
    family : Family
    runs, sensitivity_runs : LoopGraph
        Nonlinear loops, the second with sensitivities.
    certifies : callable or None
        Asked of every candidate that would be the best; None where no proof is required.
    controller : Controller
        Which law.
    gains : tuple of float or None
        The law's, where somebody gives them; poles are placed where they are None.
    emulated_runs : LoopGraph or None
        The loop on the emulated rig, where that is what is tuned.
    given_beta_error : float or None
        Half the width of the interval of beta_c/beta where it was asked for.
    excitation : Excitation or None
        What moves the ball of `rig` where nothing of the rig file does.
    """

    rig: Rig
    objective: Objective
    equilibrium: Equilibrium
    method: Method
    believed: Believed
    limits: Limits
    distinct: bool
    bounds: Array
    cases: tuple[Case, ...]
    seed: int
    loop: loops.Loop
    delayed_loop: loops.Loop
    family: loops.Family
    runs: LoopGraph
    sensitivity_runs: LoopGraph
    certifies: Certifies | None = None
    controller: Controller = TAN_GPI
    gains: tuple[float, ...] | None = None
    given_beta_error: float | None = None
    emulated_runs: LoopGraph | None = None
    excitation: Excitation | None = None

    @property
    def beta_error(self) -> float:
        """Half the width of the interval of beta_c/beta [-]."""
        low, high = self.family.ratios
        return float(f"{(high - low) / 2:.12g}")

    @property
    def directions(self) -> Array:
        """d(poles)/d(free variables), shape (4, 2) or (4, 4)."""
        return np.eye(4) if self.distinct else np.vstack([np.eye(2), np.eye(2)])

    @property
    def noise_matters(self) -> bool:
        """Whether the voltage that sensor noise makes is limited."""
        limited = math.isfinite(self.limits.max_noise_voltage)
        return limited and self.position_noise > 0

    @property
    def position_noise(self) -> float:
        """Standard deviation of the measured gap [m]: noise, and the sensor's quantisation."""
        step = self.rig.emulator.sensor_step
        return math.hypot(self.rig.noise.position, step / math.sqrt(12))

    def poles(self, x: Array) -> PoleSpec:
        """Return the poles of the logarithms `x` of the free variables."""
        # exp(log(bound)) need not be the bound itself; poles outside the box are not searched.
        bounds = np.vstack([self.bounds] * (len(x) // 2))
        free = np.clip(np.exp(x), bounds[:, 0], bounds[:, 1])
        zeta_1, omega_1, zeta_2, omega_2 = (float(v) for v in self.directions @ free)
        return PoleSpec((zeta_1, omega_1), (zeta_2, omega_2))

    def box(self) -> Array:
        """Return the bounds of the logarithms, shape (n, 2)."""
        return np.log(np.vstack([self.bounds] * (2 if self.distinct else 1)))


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
class Run:
    """One simulated loop inside the search: its objective and its limits, with gradients."""

    value: float
    gradient: Array
    constraints: tuple[Constraint, ...]
    metrics: Metrics


def build_problem(
    rig: Rig,
    *,
    objective: str = "itae",
    equilibrium: Equilibrium = "model",
    method: Method | None = None,
    beta_error: float | None = None,
    voltage: float | None = None,
    max_ms: float = DEFAULT_MAX_MS,
    max_noise_voltage: float | None = None,
    allow_saturation: bool = False,
    scenarios: Scenarios = "nominal",
    distinct: bool = False,
    zeta_bounds: tuple[float, float] | None = None,
    omega_bounds: tuple[float, float] | None = None,
    seed: int = 0,
    certifies: Certifies | None = None,
    controller: Controller = TAN_GPI,
    gains: tuple[float, ...] | None = None,
) -> TuningProblem:
    """Return the tuning problem of `rig`; where nothing moves, with the standard excitation.

    Parameters
    ----------
    beta_error, voltage
        As :func:`maglev_design.linear_loop.family` and
        :func:`maglev_design.design.believed_equilibrium` take them.
    controller, gains
        For a controller that is judged and not searched for.

    Raises
    ------
    InputError
        For an unknown objective, a bound that is not usable, or a reading without its voltage.
    """
    if objective not in OBJECTIVES:
        raise InputError(
            f"objective {objective!r} is unknown{nearest(objective, OBJECTIVES)}; "
            f"known: {', '.join(OBJECTIVES)}"
        )
    if scenarios == "emulated":
        rig = designed_for(rig)
    rig, excitation = excited(rig)
    believed = believed_equilibrium(rig, equilibrium, voltage=voltage)
    over = loops.family(rig, equilibrium, beta_error)
    if not max_ms > 1:
        raise InputError(f"max-ms = {max_ms!r}: must be greater than 1, the |S| of no feedback")
    low, high = rig.limits.voltage
    noise_limit = DEFAULT_NOISE_SHARE * (high - low)
    if max_noise_voltage is not None:
        noise_limit = max_noise_voltage
    if not noise_limit > 0:
        raise InputError(f"max-noise-voltage = {noise_limit!r}: must be greater than 0 V")
    chosen: Method = method or rig.sampling.method
    bounds = np.array(
        [
            _checked("zeta-bounds", zeta_bounds or ZETA_BOUNDS),
            _checked("omega-bounds", omega_bounds or default_omega_bounds(rig)),
        ]
    )
    plain: tuple[Case, ...] = (Case(),)
    if scenarios == "robust":
        noisy = [Case(bool(n % 2), noise=True, index=n) for n in range(NOISE_SEEDS)]
        plain = (Case(), Case(flipped=True), *noisy)
    cases = tuple(replace(case, shift=shift) for shift in over.shift_values for case in plain)

    def loop(extra: int) -> loops.Loop:
        return loops.build_loop(
            rig,
            believed,
            method=chosen,
            controller=controller,
            gains=gains,
            extra_samples=extra,
        )

    return TuningProblem(
        rig=rig,
        objective=OBJECTIVES[objective],
        equilibrium=equilibrium,
        method=chosen,
        believed=believed,
        limits=Limits(max_ms, noise_limit, allow_saturation),
        distinct=distinct,
        bounds=bounds,
        cases=cases,
        seed=seed,
        loop=loop(0),
        delayed_loop=loop(1),
        family=over,
        runs=build(rig, chosen, controller=controller),
        sensitivity_runs=build(rig, chosen, controller=controller, directions=4 if distinct else 2),
        certifies=certifies,
        controller=controller,
        gains=gains,
        given_beta_error=beta_error,
        emulated_runs=build(rig, chosen, controller=controller, emulate=True)
        if scenarios == "emulated"
        else None,
        excitation=excitation,
    )


def default_omega_bounds(rig: Rig) -> tuple[float, float]:
    """Return the searched frequencies [rad/s], from the plant's pole and the sampling period."""
    unstable = fastest_unstable_pole(rig)
    low = SLOWEST_POLES * unstable
    return low, max(2 * low, min(FASTEST_ANGLE / rig.sampling.period, FASTEST_POLES * unstable))


def _checked(name: str, bounds: tuple[float, float]) -> tuple[float, float]:
    low, high = bounds
    if not (math.isfinite(low) and math.isfinite(high) and 0 < low < high):
        raise InputError(f"{name} = {low!r} {high!r}: must be two numbers, 0 < lower < upper")
    return bounds


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


def scenario_at(problem: TuningProblem, case: Case, ratio: float) -> Scenario:
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
    problem: TuningProblem, poles: PoleSpec, case: Case, ratio: float, *, clamped: bool = True
) -> Run:
    """Simulate one case at one ratio, as :func:`runs` does many."""
    return runs(problem, [(poles, case, ratio)], clamped=clamped)[0]


def runs(
    problem: TuningProblem,
    trials: Sequence[tuple[PoleSpec, Case, float]],
    *,
    gradients: bool = False,
    clamped: bool = True,
) -> list[Run]:
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


def _run(problem: TuningProblem, metrics: Metrics, slopes: Mapping[str, Array]) -> Run:
    """Return what the search needs of one simulated loop; `slopes` are by the poles."""
    key = problem.objective.key
    return Run(
        value=float(getattr(metrics, key)),
        gradient=slopes.get(key, np.zeros(4)),
        constraints=(
            *_gap_constraints(problem, metrics, slopes),
            *_voltage_constraints(problem, metrics, slopes),
        ),
        metrics=metrics,
    )


def _gap_constraints(
    problem: TuningProblem, metrics: Metrics, slopes: Mapping[str, Array]
) -> Iterator[Constraint]:
    low, high = problem.rig.limits.gap
    scale = problem.rig.operating_point.gap
    for name, limit, value, key, sign in (
        ("smallest gap", low, metrics.min_gap, "min_gap", 1),
        ("largest gap", high, metrics.max_gap, "max_gap", -1),
    ):
        if math.isfinite(limit):
            slack = sign * (value - limit) / scale
            slack = slack if metrics.crash is None else min(slack, -1.0)
            gradient = sign * slopes.get(key, np.zeros(4)) / scale
            yield Constraint(name, "m", limit, value, slack, gradient)


def _voltage_constraints(
    problem: TuningProblem, metrics: Metrics, slopes: Mapping[str, Array]
) -> Iterator[Constraint]:
    """Yield the limits of the commanded voltage at its extreme samples."""
    if problem.limits.allow_saturation:
        return
    low, high = problem.rig.limits.voltage
    scale = high - low if math.isfinite(high) else 1.0
    for name, limit, value, key, sign in (
        ("smallest commanded voltage", low, metrics.min_voltage, "min_voltage", 1),
        ("largest commanded voltage", high, metrics.peak_voltage, "peak_voltage", -1),
    ):
        if math.isfinite(limit):
            slack = sign * (value - limit) / scale
            gradient = sign * slopes.get(key, np.zeros(4)) / scale
            yield Constraint(name, "V", limit, value, slack, gradient)
