"""The tuning problem: what is minimised, over what, subject to what.

Minimise over the poles the worst case, over the ratio interval and the cases, of an integral of
the error of the sampled nonlinear loop, subject to limits on that loop and on its linearisations
along the path. It is built once and can be looked at; :mod:`maglev_design.tuning.evaluation` says
what it gives at poles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design import linear_loop as loops
from maglev_design.controller.believed import (
    Believed,
)
from maglev_design.controller.design import (
    Design,
    PoleSpec,
    believed_equilibrium,
)
from maglev_design.controller.family import Family, family_of
from maglev_design.controller.matching import check_law, matching_law
from maglev_design.controller.plant import (
    fastest_unstable_pole,
)
from maglev_design.errors import InputError, nearest
from maglev_design.figures import DESCRIBED, OBJECTIVES, ShownFigure
from maglev_design.options import (
    DEFAULT_MAX_MS,
    TAN_GPI,
    Controller,
    Equilibrium,
    Method,
    Scenarios,
)
from maglev_design.rig import Rig
from maglev_design.simulation import LoopGraph, build, designed_for
from maglev_design.tuning.excitation import Excitation, excited

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
"""Name of the limit that a proof be found."""
Certifies = Callable[[Design], bool]
"""Whether a controller's sampled loop is proved stable over the gaps and ratios."""


@dataclass(frozen=True)
class TuningCase:
    """One way to run: the sign of the initial error, a noise stream or none, the plant's y0.

    `shift` is the plant's y0 less the rig's [m].
    """

    flipped: bool = False
    noise: bool = False
    index: int = 0
    shift: float = 0.0


@dataclass(frozen=True)
class DesignLimits:
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
    objective : ShownFigure
        An attribute of ``Metrics`` to be made small.
    equilibrium, method : str
    believed : Believed
        What every controller of this problem takes the equilibrium to be; fixed.
    limits : DesignLimits
    distinct : bool
        Whether the two pole pairs may differ (four variables instead of two).
    bounds : array, shape (2, 2)
        Rows zeta [-] and omega_n [rad/s]; lower and upper.
    cases : tuple of TuningCase
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
    objective: ShownFigure
    equilibrium: Equilibrium
    method: Method
    believed: Believed
    limits: DesignLimits
    distinct: bool
    bounds: Array
    cases: tuple[TuningCase, ...]
    seed: int
    loop: loops.Loop
    delayed_loop: loops.Loop
    family: Family
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
    controller: Controller | None = None,
    gains: tuple[float, ...] | None = None,
) -> TuningProblem:
    """Return the tuning problem of `rig`; where nothing moves, with the standard excitation.

    Parameters
    ----------
    beta_error, voltage
        As :func:`maglev_design.controller.family.family_of` and
        :func:`maglev_design.controller.design.believed_equilibrium` take them.
    controller : Controller, optional
        Default: TAN-GPI of the order of the rig's plant.
    gains : tuple of float, optional
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
    controller = controller or matching_law(rig)
    check_law(rig, controller)
    believed = believed_equilibrium(rig, equilibrium, voltage=voltage)
    over = family_of(rig, equilibrium, beta_error)
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
    plain: tuple[TuningCase, ...] = (TuningCase(),)
    if scenarios == "robust":
        noisy = [TuningCase(bool(n % 2), noise=True, index=n) for n in range(NOISE_SEEDS)]
        plain = (TuningCase(), TuningCase(flipped=True), *noisy)
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
        objective=DESCRIBED[objective],
        equilibrium=equilibrium,
        method=chosen,
        believed=believed,
        limits=DesignLimits(max_ms, noise_limit, allow_saturation),
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
