"""Where the sampled linear loop stops being stable: in the period and in beta_c/beta."""

from __future__ import annotations

import math
from collections.abc import Callable

from maglev_design.design import believed_equilibrium, plant_beta, voltage_on_plant
from maglev_design.family import Family, family_of
from maglev_design.linear_loop import build_loop, spectral_radius
from maglev_design.options import Equilibrium, Method
from maglev_design.paper.theory_linear import Case
from maglev_design.rig import LONGEST_PERIOD, Rig, make_rig

STRIDE = 1.1
"""Factor between the trials before the first unstable one is closed in on."""
DIGITS = 1e-5
"""Relative width at which a boundary counts as found."""
FARTHEST_RATIO = 1e3
"""A ratio that is stable up to here, or down to one over it, has no bound of interest."""


def with_period(rig: Rig, period: float, method: Method) -> Rig:
    """Return `rig` sampled at another period [s] by another method, its delay at zero."""
    data = rig.model_dump(exclude_none=True)
    data["sampling"] = {"period": period, "method": method, "delay": 0.0}
    return make_rig(data)


def largest_period(case: Case, method: Method) -> float:
    """Return the period [s] up to which the loop is stable on the whole path at exact beta.

    Nominal controller; nan if it is unstable at the rig's own period, and the longest period a
    rig may have if it is stable there.
    """
    poles = case.poles.values

    def stable(period: float) -> bool:
        rig = with_period(case.rig, period, method)
        loop = build_loop(rig, believed_equilibrium(rig, "model"), method=method)
        return spectral_radius(loop, poles, family_of(rig, beta_error=0.0)).value < 1

    return boundary(stable, case.rig.sampling.period, LONGEST_PERIOD)


def ratio_interval(
    case: Case, reading: Equilibrium, gaps: tuple[float, float]
) -> tuple[float, float]:
    """Return the ends of beta_c/beta around 1 within which the sampled loop is stable.

    As in Appendix A the controller is computed anew on each plant, with that plant's U where the
    reading measures one. At every gap of `gaps` [m], with the rig's period, delay and method; 0 and
    infinity where no end is found within a factor of a thousand.
    """
    rig, beta_c = case.rig, plant_beta(case.rig)

    def stable(ratio: float) -> bool:
        beta = beta_c / ratio
        believed = believed_equilibrium(rig, reading, voltage=voltage_on_plant(rig, beta))
        loop = build_loop(rig, believed, method=rig.sampling.method)
        same = Family(gaps, (believed.beta / beta,) * 2)
        return spectral_radius(loop, case.poles.values, same).value < 1

    low = boundary(stable, 1.0, 1 / FARTHEST_RATIO)
    high = boundary(stable, 1.0, FARTHEST_RATIO)
    return (
        0.0 if low <= 1 / FARTHEST_RATIO else low,
        math.inf if high >= FARTHEST_RATIO else high,
    )


def boundary(stable: Callable[[float], bool], start: float, end: float) -> float:
    """Return where `stable` ends on the way from `start` to `end`, both positive.

    The first change on a grid of equal factors, then bisection of its logarithm; nan if it is
    false at the start, `end` if it stays true.
    """
    if not stable(start):
        return math.nan
    direction = math.copysign(math.log(STRIDE), math.log(end / start))
    inside, ends = math.log(start), math.log(end)
    while True:
        outside = inside + direction
        outside = min(outside, ends) if direction > 0 else max(outside, ends)
        if not stable(math.exp(outside)):
            break
        if outside == ends:
            return end
        inside = outside
    while abs(outside - inside) > DIGITS:
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if stable(math.exp(middle)) else (inside, middle)
    return math.exp(inside)
