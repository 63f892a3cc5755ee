"""What the owner of a rig must know before believing a tuning: warnings with their numbers."""

from __future__ import annotations

import math

from maglev_design.controller.checks import voltage_warning
from maglev_design.controller.matching import NO_IDEAL_DRIVE
from maglev_design.controller.plant import (
    fastest_unstable_pole,
)
from maglev_design.rig import DEFAULT_VOLTAGE_ERROR, Rig
from maglev_design.tuning.problem import TuningProblem

NOTICED_COIL = 0.02
"""p L/R from which the coil matters."""
COARSE_SAMPLING = 0.3
"""p T above which the ball falls noticeably between two samples."""


def cautions(problem: TuningProblem) -> tuple[str, ...]:
    """Return the warnings of a problem, the gravest first; none depends on the answer."""
    rig = problem.rig
    pole = fastest_unstable_pole(rig)
    found = [coil(rig, pole), voltage_warning(rig)]
    if problem.equilibrium == "measured" and rig.uncertainty.voltage is None:
        found.append(
            f"uncertainty.voltage is not given: {100 * DEFAULT_VOLTAGE_ERROR:g} % assumed for the "
            "measured operating_point.voltage"
        )
    if pole * rig.sampling.period > COARSE_SAMPLING:
        found.append(f"the sampling period is long for this plant: {sampling_product(problem)}")
    found.append(_noise(problem))
    if problem.beta_error == 0:
        found.append("the uncertainty of beta is 0: the worst case is the nominal one")
    return tuple(text for text in found if text is not None)


def sampling_product(problem: TuningProblem) -> str:
    """Return p T in words."""
    pole, period = fastest_unstable_pole(problem.rig), problem.rig.sampling.period
    return (
        f"p T = {pole * period:.2g} with the unstable pole p = {pole:.3g} 1/s at the smallest gap "
        f"and T = {1e3 * period:g} ms; a deviation grows by {math.exp(pole * period):.2g} times "
        "between two samples"
    )


def coil(rig: Rig, pole: float) -> str | None:
    """Return a warning where ``[emulator]`` has a coil that the design's plant has not."""
    product = pole * rig.emulator.time_constant
    if rig.kind.order > 2:
        if not product:
            return None
        return (
            "[emulator] inductance and resistance play no part: the plant has the "
            f"{1e3 * rig.drive.time_constant:.3g} ms of its [drive]; take them out"
        )
    if product < NOTICED_COIL:
        return None
    own = rig.emulator
    return (
        f"p L/R = {product:.2g}: the current lags the voltage by L/R = "
        f"{1e3 * own.time_constant:.3g} ms ([emulator] inductance, resistance) and the unstable "
        f"pole is p = {pole:.3g} 1/s; the design assumes an ideal current drive, i = C u at once"
        + (
            f", and >= {NO_IDEAL_DRIVE:g} is no ideal drive: do not trust these figures on the rig"
            if product >= NO_IDEAL_DRIVE
            else ""
        )
        + "; to design for the coil, take current_gain out and put in [drive] with "
        + f'kind = "voltage", resistance = {1 / rig.current_gain:.6g}, '
        + f"inductance = {own.time_constant / rig.current_gain:.4g}"
    )


def _noise(problem: TuningProblem) -> str | None:
    """Return a warning where no sensor noise is given, or where quantisation makes it."""
    own, step = problem.rig.noise.position, problem.rig.emulator.sensor_step
    if problem.position_noise == 0:
        return (
            "noise.position is not given: the voltage from sensor noise is 0 and its limit means "
            "nothing; a sensor's noise limits how fast a loop can be"
        )
    if step / math.sqrt(12) > own:
        return (
            f"emulator.sensor_step = {step:g} m counts as sensor noise, step/sqrt(12) = "
            f"{step / math.sqrt(12):.3g} m; with noise.position = {own:g} m that is "
            f"{problem.position_noise:.3g} m"
        )
    return None
