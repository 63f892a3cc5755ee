"""A controller that somebody gives, by its poles or its gains: judged, not searched for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.believed import (
    Believed,
)
from maglev_design.controller.design import (
    PoleSpec,
    gain_names,
)
from maglev_design.controller.matching import matching_law
from maglev_design.errors import InfeasibleError, InputError, nearest
from maglev_design.options import Controller
from maglev_design.programs import gains_of_pid_program
from maglev_design.tuning.cautions import cautions
from maglev_design.tuning.emulated import emulated_row
from maglev_design.tuning.evaluation import design_at
from maglev_design.tuning.figures import judge, verify, with_noise
from maglev_design.tuning.problem import TuningProblem, changed
from maglev_design.tuning.result import (
    Status,
    TuneResult,
    judged_baseline,
)

PID_NAMES = ("Kp", "Ki", "Kd")
"""Of a PID's transfer function from y - y* to the voltage: [V/m], [V/(m s)], [V s/m]."""
FILTER, FILTER_OTHERWISE = "omega_f", "N"
"""[rad/s] Pole of the derivative's filter, and its other name."""
SAME = 1e-9
"""Relative difference below which a polynomial is the power of a shorter one."""


def parse_gains(text: str) -> dict[str, float]:
    """Return the numbers of ``name=value,...``.

    Examples
    --------
    >>> parse_gains("Kp=572, Ki=9102")
    {'Kp': 572.0, 'Ki': 9102.0}
    """
    found: dict[str, float] = {}
    for word in text.split(","):
        name, equals, value = (part.strip() for part in word.partition("="))
        if not (equals and name):
            raise InputError(f"--gains: {word.strip()!r}: must be name=value, such as Kp=572")
        if name in found:
            raise InputError(f"--gains: {name} is given twice")
        try:
            found[name] = float(value)
        except ValueError as error:
            raise InputError(f"--gains: {name} = {value!r}: must be a number") from error
        if not math.isfinite(found[name]):
            raise InputError(f"--gains: {name} = {value!r}: must be finite")
    return found


def gains_of(
    given: dict[str, float], controller: Controller, believed: Believed
) -> tuple[Controller, tuple[float, ...], PoleSpec]:
    """Return the law, its gains and the poles that they place, from gains by name.

    Parameters
    ----------
    given : dict of str to float
        By the law's own names; for a PID also Kp [V/m], Ki [V/(m s)] and Kd [V s/m], which act on
        y - y*, with the filter's pole as ``omega_f`` or ``N`` [rad/s]. Without one the filter is
        `controller.filter` times as fast as the real closed-loop pole.
    controller : Controller
    believed : Believed
        C_U and C_Y [m/(s^2 V), 1/s^2] with which a PID's gains become those of the law.

    Raises
    ------
    InputError
        For names that are not the law's, or that are missing.
    InfeasibleError
        When the gains place no stable poles.
    """
    if controller.plant_order > 2:
        raise InputError(
            "--gains: not for the third-order law, whose poles are two pairs, the second twice; "
            "give --zeta with --omega-n, or --poles"
        )
    own = tuple(name for name in gain_names(controller) if name != FILTER)
    pid = controller.name == "lin-pid"
    filters = (FILTER, FILTER_OTHERWISE) if pid else ()
    known = (*own, *(PID_NAMES if pid else ()), *filters)
    for name in given:
        if name not in known:
            alike = [x for x in known if x.lower() == name.lower()] or known
            raise InputError(
                f"--gains: {name!r} is no gain of {controller.name}{nearest(name, alike)}; known: "
                f"{', '.join(known)}"
            )
    wanted = PID_NAMES if pid and any(name in PID_NAMES for name in given) else own
    stray = [name for name in given if name not in (*wanted, *filters)]
    missing = [name for name in wanted if name not in given]
    if stray or missing:
        raise InputError(
            f"--gains: needs {', '.join(wanted)}"
            + (f"; missing: {', '.join(missing)}" if missing else "")
            + (f"; not together with these: {', '.join(stray)}" if stray else "")
        )
    gains = tuple(given[name] for name in wanted)
    if wanted is PID_NAMES:
        gains = gains_of_pid_program().scalar()(*gains, believed.C_U, believed.C_Y)
    poles = placed_by(dict(zip(own, gains, strict=True)), given)
    if not pid:
        return controller, gains, poles
    if len({FILTER, FILTER_OTHERWISE} & given.keys()) == 2:
        raise InputError(f"--gains: {FILTER} and {FILTER_OTHERWISE} are the same; give one")
    real = poles.second[1]
    speed = given.get(FILTER, given.get(FILTER_OTHERWISE, controller.filter * real))
    if not speed > 0:
        raise InputError(f"--gains: {FILTER} = {speed:g} rad/s: must be greater than 0")
    return replace(controller, filter=speed / real), (*gains, speed), poles


def placed_by(gains: dict[str, float], given: dict[str, float]) -> PoleSpec:
    """Return the poles of s^n + ... + k_0 whose coefficients the `gains` are, lowest power first.

    Raises
    ------
    InfeasibleError
        When one of them is not in the left half plane; `given` is how the message names the gains.
    """
    monic = np.array([1.0, *reversed(gains.values())])
    roots = _roots(monic)
    if not max(root.real for root in roots) < 0:
        stated = ", ".join(f"{name} = {value:.6g}" for name, value in given.items())
        coefficients = ", ".join(f"{name} = {value:.6g}" for name, value in gains.items())
        worst = max(roots, key=lambda root: root.real)
        raise InfeasibleError(
            f"{stated}: unstable on the plant that the controller believes in: its closed loop has "
            f"the coefficients {coefficients} and a pole at {worst.real:.4g} 1/s, and none may be "
            "at 0 or to the right of it (the law always integrates: no integral gain may be 0; "
            "gains act on y - y*, the gap less its reference, and are positive)",
            "Routh-Hurwitz",
        )
    pairs = [_pair(root, root.conjugate()) for root in roots if root.imag > 0]
    real = sorted((root for root in roots if root.imag == 0), key=abs)
    if len(roots) % 2:
        alone = real.pop(0)
        pairs += [_pair(a, b) for a, b in zip(real[::2], real[1::2], strict=True)]
        return PoleSpec(pairs[0], (1.0, -alone.real))
    pairs += [_pair(a, b) for a, b in zip(real[::2], real[1::2], strict=True)]
    return PoleSpec(pairs[0], pairs[1])


def _pair(a: complex, b: complex) -> tuple[float, float]:
    """Return (zeta, omega_n) of the polynomial with two roots."""
    omega_n = math.sqrt((a * b).real)
    return -(a + b).real / (2 * omega_n), omega_n


def _roots(monic: NDArray[np.float64]) -> list[complex]:
    """Return the roots, those of a power of a shorter polynomial without the error of a power."""
    degree = len(monic) - 1
    if degree == 4:
        half = np.array([1.0, monic[1] / 2, (monic[2] - (monic[1] / 2) ** 2) / 2])
        if np.allclose(np.polymul(half, half), monic, rtol=SAME, atol=0):
            return [complex(root) for root in np.roots(half)] * 2
    if degree == 3:
        root = -monic[1] / 3
        if np.allclose(np.poly([root] * 3), monic, rtol=SAME, atol=0):
            return [complex(root)] * 3
    return [complex(root) for root in np.roots(monic)]


def judged(
    problem: TuningProblem,
    poles: PoleSpec,
    baseline: PoleSpec | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> TuneResult:
    """Return what a given controller does, in the form of a tuning's result.

    Parameters
    ----------
    problem : TuningProblem
        With the controller's law and gains; its search bounds play no part.
    poles : PoleSpec
    baseline : PoleSpec, optional
        Of TAN-GPI, judged beside under the same limits; left out where it is the same controller.
    progress : callable, optional
    """
    report = progress or (lambda *_: None)
    report("judging", 0.0)
    figures = judge(problem, poles)
    report("verifying", 0.3)
    design, verification = design_at(problem, poles), verify(problem, poles, figures)
    compared = None
    if baseline is not None:
        report("comparing", 0.6)
        other = changed(problem, controller=matching_law(problem.rig), gains=None)
        if design_at(other, baseline).sha256 != design.sha256:
            compared = judged_baseline(other, baseline)
    return TuneResult(
        status=Status.JUDGED,
        problem=problem,
        poles=poles,
        design=design,
        figures=figures,
        verification=verification,
        baseline=compared,
        alternatives=(),
        landscape=None,
        evaluations=0,
        emulated=emulated_row(problem, design, None if compared is None else baseline),
        warnings=cautions(problem),
        with_noise=with_noise(problem, poles, figures),
    )
