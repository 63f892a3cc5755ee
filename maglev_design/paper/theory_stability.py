"""What a wrong beta does and how far the loop is stable; what the conclusions say of stability."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import sympy as sp
from scipy.linalg import expm
from sympy import Expr, Symbol

from maglev_design.controller.design import (
    believed_equilibrium,
    plant_beta,
    reference_of,
    reference_path,
    voltage_on_plant,
)
from maglev_design.controller.family import Family, family_of
from maglev_design.controller.plant import (
    path_gaps,
)
from maglev_design.derivation import terms as d
from maglev_design.linear_loop import build_loop, spectral_radius
from maglev_design.options import EQUILIBRIA, Equilibrium
from maglev_design.paper.ledger import Finding, Value, claim, finding
from maglev_design.paper.printed import designed, proved, residual_is_zero
from maglev_design.paper.theory_appendix import NEAR, PRINTED_RANGE
from maglev_design.paper.theory_disturbances import CONSTANT, RAMP, WRONG, lasting
from maglev_design.paper.theory_linear import (
    AGREES,
    Array,
    TriedRig,
    close,
    linear_loop,
    quantity,
    settled,
    settling_time,
    tally,
)
from maglev_design.programs import peak_program
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import robustness, stability
from maglev_design.symbolic.laws import tan_gpi

SPAN = Symbol("x", positive=True)
"""(y + y0)/(Y + y0): where the ball is."""
STRIDE = 1.1
"""Factor between the trials before the first unstable one is closed in on."""
DIGITS = 1e-5
"""Relative width at which a boundary counts as found."""
FARTHEST_RATIO = 1e3
"""A ratio that is stable up to here, or down to one over it, has no bound of interest."""
STEPS = 4000
"""Of the integral of |impulse response| over the settling time."""


@claim("A-bounded")
def _bounded(case: TriedRig) -> Finding:
    (largest,) = peak_program().scalar()(*reference_of(case.rig))
    at_rest = reference_path(case.rig, np.array([0.0, case.rig.reference.horizon]))[2]
    loop = linear_loop(case, ratio=WRONG, reading="appendix-a")
    gain = _largest_gain(loop.bounded)
    disturbance = abs(1 / WRONG - 1) * largest
    return finding(
        bool(np.all(at_rest == 0)) and loop.stable and math.isfinite(gain),
        f"|f_d| <= |mu - 1| max |y*''| = {quantity(1e3 * disturbance, 'mm/s^2')} for "
        f"beta_c = {WRONG} beta on the paper's path, and zero once the path rests. The "
        f"integral of |impulse response| from f_d to e is {quantity(gain, 's^2')}, so this "
        f"part of the error stays below {quantity(1e6 * gain * disturbance, 'um')}. Linear, "
        "at Y, reading appendix-a.",
        disturbance=disturbance,
        largest_gain=gain,
        error_bound=gain * disturbance,
    )


def _largest_gain(matrix: Array) -> float:
    """Return the integral of |e| after a unit impulse of acceleration [s^2]."""
    step = settling_time(matrix) / STEPS
    advance = expm(matrix * step)
    state, total, before = np.array([0.0, 1.0, 0.0, 0.0]), 0.0, 0.0
    for _ in range(STEPS):
        state = advance @ state
        total += step * (before + abs(state[0])) / 2
        before = abs(state[0])
    return float(total)


@cache
def error_of_speed() -> Expr:
    """Return the lasting error per speed of the path when the wrong beta spoils only rho.

    Readings model and measured: the term in the gap is (1 - rho) C_Y times the path from Y.
    """
    polynomial = sum(c * p.s ** (4 - n) for n, c in enumerate(stability.closed_loop_polynomial()))
    push = (1 - p.rho) * p.C_Y
    return sp.factor(push * lasting(p.s * (p.s + p.k3) / polynomial, RAMP))


def _follows(case: TriedRig) -> bool:
    """Whether the loop under the reading model follows a ramp with that error."""
    loop = linear_loop(case, ratio=WRONG)
    push = loop.c_y - loop.rho * loop.c_y_hat
    state = settled(loop.bounded, np.array([0.0, push, 0.0, 0.0]), RAMP)
    return close(float(state[0]), float(error_of_speed().subs(loop.letters)))


def _held(case: TriedRig, reading: Equilibrium, ratio: float) -> bool:
    """Whether the error vanishes when the path rests away from Y, in a loop that is stable."""
    loop = linear_loop(case, ratio=ratio, reading=reading)
    matrix, column = loop.printed
    gap = settled(matrix, column * case.step)[0] if loop.stable else case.step
    return bool(abs(gap - case.step) <= AGREES * abs(case.step))


@claim("A-limit")
def _limit(tried: Sequence[TriedRig]) -> Finding:
    end = lasting(proved()["A6"].lines[0].rhs / d.F_s, CONSTANT)
    trials = [(reading, ratio) for reading in EQUILIBRIA for ratio in (1 / WRONG, WRONG)]
    found = tally(tried, lambda case: all(_held(case, *trial) for trial in trials))
    moving = tally(tried, _follows)
    return finding(
        end == 0 and found.unanimous and moving.unanimous,
        f"The s in the numerator of (A6): the error under a constant tends to {end}, if the "
        "loop is stable. It holds for the readings model and measured, too, where the gap "
        "away from Y is one more constant; while the ball moves it leaves about "
        f"{error_of_speed()} times the speed of the path. "
        + found.says(
            f"Linear loop held at the end of the path, beta_c/beta = {WRONG:g} and "
            f"{1 / WRONG:.3g}, three readings"
        )
        + " "
        + moving.says("On a ramp"),
        lasting_error=str(end),
        **found.counts,
    )


@cache
def exact_beta_margin() -> Expr:
    """Return what is positive where the loop with exact beta is stable, in SPAN."""
    return stability.stability_condition().subs(
        {p.rho: 1 / SPAN, p.C_Y_hat: p.C_Y, p.C_Y_true: p.C_Y / SPAN}
    )


@cache
def largest_ratio(reading: Equilibrium) -> Expr | None:
    """Return in SPAN the beta_c/beta below which the loop is stable, None where none enters."""
    form = robustness.largest_ratio(tan_gpi(), reading)
    own = p.Y + p.y0
    at = {robustness.GAP: SPAN * own - p.y0, p.g: p.C_Y * own / 2}
    return form if form is None else sp.factor(form.subs(at))


def upper_ratio(case: TriedRig, reading: Equilibrium, gap: float) -> float:
    """Return the upper end of beta_c/beta of a case at a gap [m]; 0 where no ratio is stable."""
    offset, own = case.rig.plant.gap_offset, case.rig.operating_point.gap
    zeta, speed = case.poles.first
    numbers = linear_loop(case).letters | {p.zeta: zeta, p.omega_n: speed}
    numbers[SPAN] = (gap + offset) / (own + offset)
    form = largest_ratio(reading)
    if form is None:
        return math.inf if float(exact_beta_margin().subs(numbers)) > 0 else 0.0
    return float(form.subs(numbers))


def _roots_agree(case: TriedRig) -> bool:
    """Whether the eigenvalues change sides where the closed forms say, all readings, three gaps."""
    for reading in EQUILIBRIA:
        for gap in case.gaps:
            end = upper_ratio(case, reading, gap)
            trials = {0.1: True, 10.0: True} if math.isinf(end) else {0.02 * end: True}
            if not math.isinf(end):
                trials |= {(1 - NEAR) * end: True, (1 + NEAR) * end: False, 3 * end: False}
            for ratio, expected in trials.items():
                if linear_loop(case, gap=gap, ratio=ratio, reading=reading).stable != expected:
                    return False
    return True


def ratio_interval(
    case: TriedRig, reading: Equilibrium, gaps: tuple[float, float]
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
    return (0.0 if low <= 1 / FARTHEST_RATIO else low, math.inf if high >= FARTHEST_RATIO else high)


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


def _shown(end: float) -> str:
    return "without end" if math.isinf(end) else f"{end:.4g}"


def _value(end: float) -> Value:
    return "infinite" if math.isinf(end) else end


@claim("A-interval")
def _intervals(tried: Sequence[TriedRig]) -> Finding:
    case = tried[0]
    own, _, end = case.gaps
    ends = {r: (upper_ratio(case, r, own), upper_ratio(case, r, end)) for r in EQUILIBRIA}
    found = tally(tried, _roots_agree)
    printed = 1 + PRINTED_RANGE[1]
    same = all(abs(x - printed) < 1e-2 for pair in ends.values() for x in pair)
    listed = "; ".join(
        f"{reading}: {_shown(at_y)} at Y, {_shown(moved)} at {quantity(1e3 * end, 'mm')}"
        for reading, (at_y, moved) in ends.items()
    )
    forms = "; ".join(f"{r}: {largest_ratio(r)}" for r in EQUILIBRIA if largest_ratio(r))
    decided = residual_is_zero("A7-general") and found.unanimous and not same
    return finding(
        same and found.unanimous,
        "From rho (omega_n^2 + C_Y_hat) > C_Y_true + omega_n^2/(4 zeta^2 + 1), derivation "
        f"(A7-general), in closed form with x = y/Y: {forms}; with U and C_Y measured no ratio "
        "enters. The margin falls with the ratio, so that zero, itself excluded, is the lower "
        "end in every case. " + found.says("Eigenvalues on either side of every end"),
        f"0 < beta_c/beta < r, r by reading of U and gap: {listed}" if decided else "",
        **{f"upper_at_Y, {r}": _value(pair[0]) for r, pair in ends.items()},
        **{f"upper_at_end, {r}": _value(pair[1]) for r, pair in ends.items()},
        **found.counts,
    )


@claim("A-sampled")
def _sampled(case: TriedRig) -> Finding:
    own = case.rig.operating_point.gap
    at_y = {r: ratio_interval(case, r, (own, own)) for r in EQUILIBRIA}
    on_path = {r: ratio_interval(case, r, family_of(case.rig).gaps) for r in EQUILIBRIA}
    low, high = at_y["appendix-a"]
    exact = upper_ratio(case, "appendix-a", own)
    sampling = case.rig.sampling

    def listed(ends: dict[Equilibrium, tuple[float, float]]) -> str:
        return "; ".join(
            f"{r}: no end found"
            if pair == (0.0, math.inf)
            else f"{r}: {pair[0]:.3g} to {pair[1]:.4g}"
            for r, pair in ends.items()
        )

    return finding(
        low == 0.0 and high >= exact,
        f"Sampled every {quantity(1e3 * sampling.period, 'ms')} ({sampling.method}), spectral "
        f"radius below one: at Y {listed(at_y)}; at every gap of the path {listed(on_path)}. "
        "A small beta_c means a large loop gain, which a sampled loop does not stand: under "
        f"appendix-a the ends are {low:.3g}, not 0, and {high:.4g}, not {exact:.4g}.",
        f"beta_c/beta at Y, by reading of U: {listed(at_y)}",
        **{
            f"{name}_{where}, {r}": _value(pair[n])
            for where, ends in (("at_Y", at_y), ("on_path", on_path))
            for r, pair in ends.items()
            for n, name in enumerate(("lower", "upper"))
        },
    )


@claim("6-locally-stable")
def _locally_stable(tried: Sequence[TriedRig]) -> Finding:
    polynomial = [designed(k) for k in (sp.Integer(1), p.k3, p.k2, p.k1, p.k0)]
    signs = [x.is_positive for x in stability.routh_hurwitz(polynomial)]

    def everywhere(case: TriedRig) -> bool:
        return all(
            linear_loop(case, gap=gap).stable and upper_ratio(case, "model", gap) > 1
            for gap in map(float, path_gaps(case.rig, 9))
        )

    found = tally(tried, everywhere)
    case = tried[0]
    own, _, end = case.gaps
    roots = np.linalg.eigvals(linear_loop(case, gap=end).bounded)
    slowest = float(roots.real.max())
    listed = ", ".join(
        f"{root.real:.4g}{f' +- {root.imag:.4g} j' if root.imag > 0 else ''}"
        for root in sorted(roots, key=lambda z: -z.real)
        if root.imag >= 0
    )
    _, speed = case.poles.first
    (reach,) = sp.solve(exact_beta_margin(), SPAN)
    return finding(
        all(signs) and found.unanimous and slowest < 0,
        "At Y and exact beta the polynomial is (24), whose Hurwitz determinants with (25) are "
        f"positive for every zeta and omega_n: four poles of modulus {quantity(speed, '1/s')}. "
        f"At the end of the path, {quantity(1e3 * end, 'mm')}, with the gains placed at "
        f"{quantity(1e3 * own, 'mm')}, the poles are {listed} 1/s; stable at rest at any gap "
        f"below ({sp.simplify(reach)}) Y. The linear loop decides for the plant (4) near the "
        "equilibrium, with the bounded law (see 3.2-origin). "
        + found.says("Eigenvalues at nine gaps of the path"),
        slowest_at_end=slowest,
        stable_below_gap=float(reach.subs(p.zeta, case.poles.values[0])) * own,
        **found.counts,
    )


@claim("6-practical")
def _practical() -> Finding:
    return finding(
        "not-checkable",
        "Practical stability is a bound on the error for given disturbances and starts; the "
        "paper gives neither the bound nor the region, and no proof. For the linear loop "
        "A-bounded and A-limit say what can be said.",
    )


@claim("abstract-any-point")
def _any_point(tried: Sequence[TriedRig]) -> Finding:
    margin = sp.simplify(exact_beta_margin().subs(SPAN, 1))
    found = tally(tried, lambda case: linear_loop(case).stable)
    return finding(
        margin.is_positive and found.unanimous,
        f"Linearised there, at exact beta, the margin is {margin}, "
        "positive for every gap, damping and frequency. "
        + found.says("Eigenvalues with random poles at each rig's own Y"),
        margin=str(margin),
        **found.counts,
    )
