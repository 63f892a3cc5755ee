"""Which disturbances the law (20) rejects: constants, ramps, parabolas; and what (19) needs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import sympy as sp
from sympy import Expr

from maglev_design.derivation import terms as d
from maglev_design.paper.ledger import Finding, claim, finding
from maglev_design.paper.theory_linear import (
    AGREES,
    Tally,
    TriedRig,
    close,
    linear_loop,
    quantity,
    settled,
    tally,
)
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.gpi import (
    gain_symbols,
    gpi_transfer,
)

CONSTANT, RAMP, PARABOLA = range(3)
"""Degrees n of a disturbance t^n/n!."""
ORDERS = (3, 4, 5, 6)
"""Of the law with more and more integrals of the error."""
WRONG = 1.15
"""beta_c/beta of the paper's third test."""
PUSHED = sp.Symbol("int(acc_0)", real=True)
"""Integral of a disturbing acceleration."""


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


def simulated(case: TriedRig, degree: int) -> tuple[float, float]:
    """Return e and its rate when t^degree/degree! [m/s^(2 + degree)] has acted for long."""
    state = settled(linear_loop(case).bounded, np.array([0.0, 1.0, 0.0, 0.0]), degree)
    return float(state[0]), float(state[1])


def _as_predicted(tried: Sequence[TriedRig], degree: int) -> Tally:
    """Return on how many rigs the linear loop ends where the limits say."""
    rate = lasting(error_of_disturbance(), RAMP)

    def agrees(case: TriedRig) -> bool:
        expected = float(rate.subs(linear_loop(case).letters))
        error, speed = simulated(case, degree)
        if degree == CONSTANT:
            return abs(error) <= AGREES / case.poles.values[1] ** 2
        return close(error if degree == RAMP else speed, expected)

    return tally(tried, agrees)


def reconstruction_error() -> Expr:
    """Return v_d - v_d_hat for a plant disturbed by acc_0 and believed to be (C_U^, C_Y^)."""
    velocity = d.v_0 + PUSHED - p.C_U * d.int_u + p.C_Y * d.int_y
    estimate = -p.C_U_hat * d.int_u + p.C_Y_hat * d.int_y
    return sp.collect(sp.expand(velocity - estimate), (d.int_u, d.int_y))


def _drift_of_estimate(
    case: TriedRig, push: float, ratio: float, step: float
) -> tuple[float, float]:
    """Return the rate of v_d - v_d_hat [m/s^2], simulated and predicted, in the printed loop."""
    loop = linear_loop(case, ratio=ratio)
    matrix, column = loop.printed
    forcing = column * step
    forcing[1] += push
    rates = matrix @ settled(matrix, forcing) + forcing
    simulated_rate = float(rates[1] + loop.c_u_hat * rates[2] - loop.c_y_hat * rates[3])
    held = (loop.c_y * step + push) / loop.c_u  # u_d at rest
    letters = loop.letters | {d.int_u: held, d.int_y: step, d.v_0: 0, PUSHED: push}
    return simulated_rate, float(reconstruction_error().subs(letters))


@claim("3.2-reconstruction")
def _reconstruction(tried: Sequence[TriedRig]) -> Finding:
    def drifts(case: TriedRig) -> list[tuple[float, float]]:
        push = 0.01 * case.rig.plant.gravity
        trials = ((0.0, 1.0, case.step), (push, 1.0, 0.0), (0.0, WRONG, case.step))
        return [_drift_of_estimate(case, *trial) for trial in trials]

    def scale(case: TriedRig) -> float:
        return abs(linear_loop(case).c_y * case.step)

    found = tally(tried, lambda case: all(close(*pair, scale(case)) for pair in drifts(case)))
    case = tried[0]
    push = 0.01 * case.rig.plant.gravity
    exact, disturbed, wrong = (rate for rate, _ in drifts(case))
    stays = [abs(rate) <= AGREES * scale(case) for rate in (exact, disturbed, wrong)]
    correction = f"v_d - v_d_hat = {reconstruction_error()}" if stays[0] and not all(stays) else ""
    return finding(
        all(stays) and found.unanimous,
        "Constant only if the plant is (10) exactly and nothing disturbs it. At rest at Y a "
        f"disturbance of {quantity(push, 'm/s^2')}, 1 % of g, drives the estimate away at "
        f"{quantity(disturbed, 'm/s')} every second; at rest at the end of the path "
        f"beta_c = {WRONG} beta under the reading model does so at {quantity(wrong, 'm/s')} "
        "every second, for ever. "
        + found.says("Rates in the linear loop with (20) as printed against that formula"),
        correction,
        drift_exact=exact,
        drift_disturbed=disturbed,
        drift_wrong_beta=wrong,
        **found.counts,
    )


@claim("3.2-constant")
def _constant(tried: Sequence[TriedRig]) -> Finding:
    own = error_of_disturbance()
    pushes = (own, -p.C_U * own, error_when_measured())
    limits = [lasting(push, CONSTANT) for push in pushes]
    found = _as_predicted(tried, CONSTANT)
    return finding(
        all(limit == 0 for limit in limits) and found.unanimous,
        f"E(s)/D(s) = {own} has a zero at s = 0: the error tends to {limits[0]} under a "
        f"constant acceleration, to {limits[1]} under a constant voltage on the input. "
        + found.says("Linear loop under a constant acceleration"),
        lasting_error=str(limits[0]),
        **found.counts,
    )


@claim("3.2-ramp")
def _ramp(tried: Sequence[TriedRig]) -> Finding:
    pushed, driven = (lasting(x * error_of_disturbance(), RAMP) for x in (1, -p.C_U))
    seen = lasting(error_when_measured(), RAMP)
    found = _as_predicted(tried, RAMP)
    letters = linear_loop(tried[0]).letters
    slope, volts = (float(x.subs(letters)) for x in (pushed, driven))
    correction = (
        f"a ramp leaves a lasting error of {pushed} times its slope, a constant none; an error "
        "free of it takes one more integral (order 5)"
    )
    return finding(
        pushed == driven == 0 and found.unanimous,
        f"The error tends to {pushed} per unit slope of an acceleration and to {driven} of a "
        f"voltage on the input: bounded, which is all a weak reading of robust asks for, but "
        "not zero. With the paper's gains "
        f"{quantity(1e6 * slope, 'um')} per m/s^3 and {quantity(1e3 * abs(volts), 'mm')} per "
        "V/s. The reconstruction (18) uses up one of the two integrals, because a disturbance "
        "it does not see drives its error; only a ramp in a voltage that is measured with the "
        f"ramp in it leaves {seen}. " + found.says("Linear loop under a ramp of acceleration"),
        correction if found.unanimous else "",
        error_per_slope=slope,
        error_per_volt_per_second=volts,
        error_when_measured=str(seen),
        **found.counts,
    )


@claim("3-classical-disturbances")
def _more_integrals(tried: Sequence[TriedRig]) -> Finding:
    highest = {order: _degrees_rejected(error_of_disturbance(order)) for order in ORDERS}
    rate = growth(error_of_disturbance(), PARABOLA)
    found = _as_predicted(tried, PARABOLA)
    number = float(rate.subs(linear_loop(tried[0]).letters))
    names = {-1: "none", CONSTANT: "constants", RAMP: "ramps", PARABOLA: "parabolas"}
    says = ", ".join(f"order {order}: {names[highest[order]]}" for order in ORDERS)
    return finding(
        all(highest[n] == n - 4 for n in ORDERS) and found.unanimous,
        f"E(s)/D(s) of the law of order n has n - 3 zeros at s = 0. Rejected up to, {says}. "
        "The law (20) is of order 4 and ends at constants: under a parabola c t^2/2 its error "
        f"grows at {rate} c, {quantity(1e6 * number, 'um/s')} per m/s^4. "
        + found.says("Linear loop under a parabola of acceleration"),
        **{f"degree_rejected_by_order_{order}": highest[order] for order in ORDERS},
        growth_per_m_s4=number,
        **found.counts,
    )


def _degrees_rejected(transfer: Expr) -> int:
    """Return the highest degree of a disturbance that leaves no error; -1 if a constant does."""
    degree = -1
    while lasting(transfer, degree + 1) == 0:
        degree += 1
    return degree
