"""Which disturbances the law (20) rejects: constants, ramps, parabolas; and what (19) needs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import sympy as sp
from scipy.linalg import expm
from sympy import Expr

from maglev_design.derivation import terms as d
from maglev_design.design import reference_path
from maglev_design.options import EQUILIBRIA, Equilibrium
from maglev_design.paper.equations import proved
from maglev_design.paper.ledger import Claim, judged
from maglev_design.paper.theory_law import FOUR
from maglev_design.paper.theory_linear import (
    AGREES,
    Array,
    Case,
    Tally,
    answer,
    bounded_matrix,
    close,
    is_stable,
    linear_loop,
    printed_matrix,
    quantity,
    settling_time,
    tally,
)
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.laws import gain_symbols, gpi_transfer
from maglev_design.symbolic.stability import closed_loop_polynomial

CLAIMS = "maglev-design claims --json"
CONSTANT, RAMP, PARABOLA = range(3)
"""Degrees n of a disturbance t^n/n!."""
ORDERS = (3, 4, 5, 6)
"""Of the law with more and more integrals of the error."""
WRONG = 1.15
"""beta_c/beta of the paper's third test."""
STEPS = 4000
"""Of the integral of |impulse response| over the settling time."""
PUSHED = sp.Symbol("int(acc_0)", real=True)
"""Integral of a disturbing acceleration."""


def wrong_beta_claims(tried: Sequence[Case]) -> tuple[Claim, ...]:
    """Return the claims of Appendix A on the disturbance that a wrong beta is."""
    return (_bounded(tried[0]), _limit(tried))


def disturbance_claims(tried: Sequence[Case]) -> tuple[Claim, ...]:
    """Return the claims on the velocity's reconstruction and on disturbances."""
    return (_reconstruction(tried), _constant(tried), _ramp(tried), _more_integrals(tried))


@cache
def error_of_disturbance(order: int = 4) -> Expr:
    """Return E(s)/D(s), D a disturbing acceleration, with the law of that order."""
    return sp.factor(1 / (p.s**2 - p.C_Y + gpi_transfer(gain_symbols(order))))


@cache
def error_when_measured() -> Expr:
    """Return E(s) over a disturbing voltage when the disturbed voltage is what (18) integrates."""
    push, voltage = sp.symbols("push voltage")
    estimate = (-p.C_U * (voltage + push) + p.C_Y * p.e) / p.s
    law = p.C_U * voltage - p.k3 * estimate
    law -= (p.k2 + p.C_Y + p.k1 / p.s + p.k0 / p.s**2) * p.e
    motion = (p.s**2 - p.C_Y) * p.e + p.C_U * (voltage + push)
    (found,) = sp.solve([law, motion], [p.e, voltage], dict=True)
    return sp.factor(found[p.e] / push)


def lasting(transfer: Expr, degree: int) -> Expr:
    """Return the limit of e for a disturbance t^degree/degree!, by the final value theorem.

    For a stable loop; infinite where the error grows.
    """
    return sp.simplify(sp.limit(sp.cancel(transfer / p.s**degree), p.s, 0, "+"))


def growth(transfer: Expr, degree: int) -> Expr:
    """Return the rate at which e grows in the end under a disturbance t^degree/degree!."""
    return sp.simplify(sp.limit(sp.cancel(p.s * transfer / p.s**degree), p.s, 0, "+"))


def simulated(case: Case, degree: int) -> tuple[float, float]:
    """Return e and its rate when t^degree/degree! [m/s^(2 + degree)] has acted for long."""
    matrix = bounded_matrix(linear_loop(case))
    time = settling_time(matrix)
    column = np.array([0.0, 1.0, 0.0, 0.0])
    state = answer(matrix, column, np.zeros(4), degree, time)
    return float(state[0]), float(state[1])


def _as_predicted(tried: Sequence[Case], degree: int) -> Tally:
    """Return on how many rigs the linear loop ends where the limits say."""
    rate = lasting(error_of_disturbance(), RAMP)

    def agrees(case: Case) -> bool:
        k0, _, _, k3 = linear_loop(case).gains
        expected = float(rate.subs({p.k0: k0, p.k3: k3}))
        error, speed = simulated(case, degree)
        if degree == CONSTANT:
            return abs(error) <= AGREES / case.poles.values[1] ** 2
        return close(error if degree == RAMP else speed, expected)

    return tally(tried, agrees)


def _constant(tried: Sequence[Case]) -> Claim:
    own, measured = error_of_disturbance(), error_when_measured()
    limits = [lasting(own, CONSTANT), lasting(-p.C_U * own, CONSTANT), lasting(measured, CONSTANT)]
    found = _as_predicted(tried, CONSTANT)
    return Claim(
        id="3.2-constant",
        place="sec. 3.2",
        statement="The integrals in (20) make it robust against constant disturbances.",
        verdict=judged(holds=all(limit == 0 for limit in limits) and found.unanimous),
        correction="",
        evidence=(
            f"E(s)/D(s) = {own} has a zero at s = 0: the error tends to {limits[0]} under a "
            f"constant acceleration, to {limits[1]} under a constant voltage on the input. "
            + found.says("Linear loop under a constant acceleration")
        ),
        command=CLAIMS,
        values={"lasting_error": str(limits[0]), "rigs": found.tried, "agreed": found.agreed},
    )


def _ramp(tried: Sequence[Case]) -> Claim:
    own, measured = error_of_disturbance(), error_when_measured()
    pushed, driven = lasting(own, RAMP), lasting(-p.C_U * own, RAMP)
    seen = lasting(measured, RAMP)
    found = _as_predicted(tried, RAMP)
    rejected = pushed == 0 and driven == 0
    loop = linear_loop(tried[0])
    numbers = dict(zip((*FOUR, p.C_U), (*loop.gains, loop.c_u), strict=True))
    slope, volts = (float(x.subs(numbers)) for x in (pushed, driven))
    correction = (
        f"a ramp leaves a lasting error of {pushed} times its slope, a constant none; an error "
        "free of it takes one more integral (order 5)"
    )
    correction = "" if rejected or not found.unanimous else correction
    return Claim(
        id="3.2-ramp",
        place="sec. 3.2",
        statement=(
            "The double integral of the error makes (20) robust against ramps that nobody "
            "modelled: they leave no lasting error."
        ),
        verdict=judged(holds=rejected and found.unanimous, correction=correction),
        correction=correction,
        evidence=(
            f"The error tends to {pushed} per unit slope of an acceleration and to {driven} of a "
            f"voltage on the input: bounded, which is all a weak reading of robust asks for, but "
            "not zero. With the paper's gains "
            f"{quantity(1e6 * slope, 'um')} per m/s^3 and {quantity(1e3 * abs(volts), 'mm')} per "
            "V/s. The reconstruction (18) uses up one of the two integrals, because a disturbance "
            "it does not see drives its error; only a ramp in a voltage that is measured with the "
            f"ramp in it leaves {seen}. " + found.says("Linear loop under a ramp of acceleration")
        ),
        command=CLAIMS,
        values={
            "error_per_slope": slope,
            "error_per_volt_per_second": volts,
            "error_when_measured": str(seen),
            "rigs": found.tried,
            "agreed": found.agreed,
        },
    )


def _more_integrals(tried: Sequence[Case]) -> Claim:
    highest = {order: _degrees_rejected(error_of_disturbance(order)) for order in ORDERS}
    each_adds_one = [highest[n] for n in ORDERS] == [n - 4 for n in ORDERS]
    rate = growth(error_of_disturbance(), PARABOLA)
    found = _as_predicted(tried, PARABOLA)
    k0, _, _, k3 = linear_loop(tried[0]).gains
    number = float(rate.subs({p.k0: k0, p.k3: k3}))
    names = {-1: "none", CONSTANT: "constants", RAMP: "ramps", PARABOLA: "parabolas"}
    says = ", ".join(f"order {order}: {names[highest[order]]}" for order in ORDERS)
    return Claim(
        id="3-classical-disturbances",
        place="sec. 1, 3",
        statement=(
            "Enough iterated integrals of the error make up for constants, ramps and parabolas "
            "that the reconstruction ignores."
        ),
        verdict=judged(holds=each_adds_one and found.unanimous),
        correction="",
        evidence=(
            f"E(s)/D(s) of the law of order n has n - 3 zeros at s = 0. Rejected up to, {says}. "
            "The law (20) is of order 4 and ends at constants: under a parabola c t^2/2 its error "
            f"grows at {rate} c, {quantity(1e6 * number, 'um/s')} per m/s^4. "
            + found.says("Linear loop under a parabola of acceleration")
        ),
        command=CLAIMS,
        values={
            **{f"degree_rejected_by_order_{order}": highest[order] for order in ORDERS},
            "growth_per_m_s4": number,
            "rigs": found.tried,
            "agreed": found.agreed,
        },
    )


def _degrees_rejected(transfer: Expr) -> int:
    """Return the highest degree of a disturbance that leaves no error; -1 if a constant does."""
    degree = -1
    while lasting(transfer, degree + 1) == 0:
        degree += 1
    return degree


def reconstruction_error() -> Expr:
    """Return v_d - v_d_hat for a plant disturbed by acc_0 and believed to be (C_U^, C_Y^)."""
    velocity = d.v_0 + PUSHED - p.C_U * d.int_u + p.C_Y * d.int_y
    estimate = -p.C_U_hat * d.int_u + p.C_Y_hat * d.int_y
    return sp.collect(sp.expand(velocity - estimate), (d.int_u, d.int_y))


def _drift_of_estimate(case: Case, push: float, ratio: float, step: float) -> tuple[float, float]:
    """Return the rate of v_d - v_d_hat [m/s^2], simulated and predicted, in the printed loop."""
    loop = linear_loop(case, ratio=ratio)
    matrix, column = printed_matrix(loop)
    forcing = column * step
    forcing[1] += push
    state = answer(matrix, forcing, np.zeros(6), 0, settling_time(matrix))
    rates = matrix @ state + forcing
    simulated_rate = float(rates[1] + loop.c_u_hat * rates[2] - loop.c_y_hat * rates[3])
    held = (loop.c_y * step + push) / loop.c_u  # u_d at rest
    gaps = {"C_U": loop.c_u, "C_Y": loop.c_y, "C_U_hat": loop.c_u_hat, "C_Y_hat": loop.c_y_hat}
    letters = {d.int_u: held, d.int_y: step, d.v_0: 0, PUSHED: push}
    letters |= {letter: gaps[str(letter)] for letter in (p.C_U, p.C_Y, p.C_U_hat, p.C_Y_hat)}
    return simulated_rate, float(reconstruction_error().subs(letters))


def _reconstruction(tried: Sequence[Case]) -> Claim:
    def agrees(case: Case) -> bool:
        step = case.step
        scale = abs(linear_loop(case).c_y * step)
        trials = ((0.0, 1.0, step), (0.01 * case.rig.plant.gravity, 1.0, 0.0), (0.0, WRONG, step))
        return all(
            close(*_drift_of_estimate(case, push, ratio, gap), scale) for push, ratio, gap in trials
        )

    found = tally(tried, agrees)
    case = tried[0]
    step = case.step
    push = 0.01 * case.rig.plant.gravity
    scale = abs(linear_loop(case).c_y * step)
    exact, disturbed, wrong = (
        rates[0]
        for rates in (
            _drift_of_estimate(case, 0.0, 1.0, step),
            _drift_of_estimate(case, push, 1.0, 0.0),
            _drift_of_estimate(case, 0.0, WRONG, step),
        )
    )
    stays = [abs(rate) <= AGREES * scale for rate in (exact, disturbed, wrong)]
    correction = f"v_d - v_d_hat = {reconstruction_error()}" if stays[0] and not all(stays) else ""
    return Claim(
        id="3.2-reconstruction",
        place="sec. 3.2, eq. (19)",
        statement="The reconstructed velocity is off by the initial velocity, a constant.",
        verdict=judged(holds=all(stays) and found.unanimous, correction=correction),
        correction=correction,
        evidence=(
            "Constant only if the plant is (10) exactly and nothing disturbs it. At rest at Y a "
            f"disturbance of {quantity(push, 'm/s^2')}, 1 % of g, drives the estimate away at "
            f"{quantity(disturbed, 'm/s')} every second; at rest at the end of the path "
            f"beta_c = {WRONG} beta under the reading model does so at {quantity(wrong, 'm/s')} "
            "every second, for ever. "
            + found.says("Rates in the linear loop with (20) as printed against that formula")
        ),
        command=CLAIMS,
        values={
            "drift_exact": exact,
            "drift_disturbed": disturbed,
            "drift_wrong_beta": wrong,
            "rigs": found.tried,
            "agreed": found.agreed,
        },
    )


def _bounded(case: Case) -> Claim:
    path = case.rig.reference
    times = np.linspace(path.start_time, path.end_time, 4001)
    fastest = float(np.abs(reference_path(case.rig, times)[2]).max())
    at_rest = reference_path(case.rig, np.array([0.0, path.horizon]))[2]
    matrix = bounded_matrix(linear_loop(case, ratio=WRONG, reading="appendix-a"))
    gain = _largest_gain(matrix)
    disturbance = abs(1 / WRONG - 1) * fastest
    holds = bool(np.all(at_rest == 0)) and is_stable(matrix) and np.isfinite(gain)
    return Claim(
        id="A-bounded",
        place="app. A, below (A5) and (A6)",
        statement=(
            "The disturbance (A5) is bounded and settles to a constant, so the error is bounded "
            "where the loop is stable."
        ),
        verdict=judged(holds=bool(holds)),
        correction="",
        evidence=(
            f"|f_d| <= |mu - 1| max |y*''| = {quantity(1e3 * disturbance, 'mm/s^2')} for "
            f"beta_c = {WRONG} beta on the paper's path, and zero once the path rests. The "
            f"integral of |impulse response| from f_d to e is {quantity(gain, 's^2')}, so this "
            f"part of the error stays below {quantity(1e6 * gain * disturbance, 'um')}. Linear, "
            "at Y, reading appendix-a."
        ),
        command=CLAIMS,
        values={
            "disturbance": disturbance,
            "largest_gain": gain,
            "error_bound": gain * disturbance,
        },
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
    polynomial = sum(c * p.s ** (4 - n) for n, c in enumerate(closed_loop_polynomial()))
    push = (1 - p.rho) * p.C_Y
    return sp.factor(push * lasting(p.s * (p.s + p.k3) / polynomial, RAMP))


def _follows(case: Case) -> bool:
    """Whether the loop under the reading model follows a ramp with that error."""
    loop = linear_loop(case, ratio=WRONG)
    matrix = bounded_matrix(loop)
    push = loop.c_y - loop.rho * loop.c_y_hat
    column = np.array([0.0, push, 0.0, 0.0])
    state = answer(matrix, column, np.zeros(4), RAMP, settling_time(matrix))
    k0, _, _, k3 = loop.gains
    numbers = {p.rho: loop.rho, p.C_Y: loop.c_y, p.k0: k0, p.k3: k3}
    return close(float(state[0]), float(error_of_speed().subs(numbers)))


def _held(case: Case, reading: Equilibrium, ratio: float) -> bool:
    """Whether the error vanishes when the path rests away from Y, in a loop that is stable."""
    loop = linear_loop(case, ratio=ratio, reading=reading)
    if not is_stable(bounded_matrix(loop)):
        return True
    matrix, column = printed_matrix(loop)
    state = answer(matrix, column * case.step, np.zeros(6), 0, settling_time(matrix))
    return bool(abs(state[0] - case.step) <= AGREES * abs(case.step))


def _limit(tried: Sequence[Case]) -> Claim:
    end = lasting(proved()["A6"].lines[0].rhs / d.F_s, CONSTANT)
    trials = [(reading, ratio) for reading in EQUILIBRIA for ratio in (1 / WRONG, WRONG)]
    found = tally(tried, lambda case: all(_held(case, *trial) for trial in trials))
    moving = tally(tried, _follows)
    return Claim(
        id="A-limit",
        place="app. A, below (A6)",
        statement="With a wrong beta the error still tends to zero once the path rests.",
        verdict=judged(holds=end == 0 and found.unanimous and moving.unanimous),
        correction="",
        evidence=(
            f"The s in the numerator of (A6): the error under a constant tends to {end}, if the "
            "loop is stable. It holds for the readings model and measured, too, where the gap "
            "away from Y is one more constant; while the ball moves it leaves about "
            f"{error_of_speed()} times the speed of the path. "
            + found.says(
                f"Linear loop held at the end of the path, beta_c/beta = {WRONG:g} and "
                f"{1 / WRONG:.3g}, three readings"
            )
            + " "
            + moving.says("On a ramp")
        ),
        command=CLAIMS,
        values={"lasting_error": str(end), "rigs": found.tried, "agreed": found.agreed},
    )
