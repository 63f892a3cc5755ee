"""Sections 1, 3.1 and 3.2 on the law itself: what it is, and what it does not need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import sympy as sp
from sympy import Expr, Symbol

from maglev_design.derivation import terms as d
from maglev_design.derivation.control import FOUR
from maglev_design.paper.ledger import Finding, claim, finding
from maglev_design.paper.printed import proved, residual_is_zero
from maglev_design.paper.theory_linear import (
    AGREES,
    Array,
    LinearLoop,
    TriedRig,
    answer,
    linear_loop,
    quantity,
    refuted,
    settled,
    settling_time,
    tally,
)
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.gpi import (
    gpi_transfer,
)

KP, KI, KD, FILTER = sp.symbols("K_p K_i K_d N", real=True)
FREQUENCIES = np.geomspace(1e-2, 1e2, 25)
"""In units of omega_n, where the transfer functions are compared."""


@claim("3.1-dynamics")
def _third_order(tried: Sequence[TriedRig]) -> Finding:
    def placed(case: TriedRig) -> bool:
        loop = linear_loop(case)
        _, k1, k2, k3 = loop.gains
        share = np.array([k2 + loop.c_y, k3, k1]) / loop.c_u  # of y_d, its velocity, its integral
        matrix = np.array([[0, 1, 0], np.array([loop.c_y, 0, 0]) - loop.c_u * share, [1, 0, 0]])
        found = np.poly(matrix)
        return bool(np.allclose(found, [1, k3, k2, k1], rtol=AGREES, atol=0))

    found = tally(tried, placed)
    return finding(
        residual_is_zero("14", "15", "16", "25-n") and found.unanimous,
        "Derivation (14)-(16) and (25-n), residuals 0; for the linear plant (10). "
        + found.says("Characteristic polynomial of the state matrix"),
        **found.counts,
    )


@claim("3.1-velocity")
def _velocity() -> Finding:
    law = proved()["14"].lines[0].rhs
    share = sp.simplify(sp.diff(law, d.e1))
    return finding(
        share.is_positive,
        f"Its voltage changes by {share} for each unit of velocity, never zero.",
        share=str(share),
    )


@cache
def pid_of_gpi() -> Mapping[Symbol, Expr]:
    """Return K_p, K_i, K_d and N with K_p + K_i/s + K_d s/(1 + s/N) = G(s), the law (20)."""
    pid = KP + KI / p.s + KD * p.s / (1 + p.s / p.k3)
    over, _ = sp.fraction(sp.together(gpi_transfer(FOUR) - pid))
    unknown = (KP, KI, KD)
    (found,) = sp.solve(sp.Poly(sp.expand(over), p.s).coeffs(), unknown, dict=True)
    return {letter: sp.expand(found[letter]) for letter in unknown} | {FILTER: p.k3}


def pid_residual() -> Expr:
    """Return G(s) minus that PID; zero proves that (20) is one."""
    pid = (KP + KI / p.s + KD * p.s / (1 + p.s / FILTER)).subs(pid_of_gpi())
    return d.simplest(gpi_transfer(FOUR) - pid)


def pid_numbers(loop: LinearLoop) -> tuple[float, float, float, float]:
    """Return K_p [V/m], K_i [V/(m s)], K_d [V s/m] and N [rad/s] of a loop's controller."""
    numbers = loop.letters | {p.C_Y: loop.c_y_hat}
    kp, ki, kd, pole = (float(pid_of_gpi()[x].subs(numbers)) for x in (KP, KI, KD, FILTER))
    return kp / loop.c_u_hat, ki / loop.c_u_hat, kd / loop.c_u_hat, pole


def _printed_response(loop: LinearLoop, omega: Array) -> Array:
    """Return u_d/e of (20) as printed, y* = Y, line by line in integrals of u_d, y_d and e."""
    k0, k1, k2, k3 = loop.gains
    row = np.array([-k3 * loop.c_u_hat, k3 * loop.c_y_hat, k1, k0]) / loop.c_u_hat
    through = (k2 + loop.c_y_hat) / loop.c_u_hat
    matrix, column = np.zeros((4, 4)), np.array([through, 1.0, 1.0, 0.0])
    matrix[0], matrix[3, 2] = row, 1.0
    unit = np.eye(4)
    return np.array(
        [row @ np.linalg.solve(1j * w * unit - matrix, column) + through for w in omega]
    )


def _is_pid(case: TriedRig) -> bool:
    loop = linear_loop(case)
    kp, ki, kd, pole = pid_numbers(loop)
    omega = FREQUENCIES * case.poles.values[1]
    s = 1j * omega
    pid = kp + ki / s + kd * s / (1 + s / pole)
    return bool(np.allclose(_printed_response(loop, omega), pid, rtol=AGREES, atol=0))


@claim("3.1-filter")
def _filter(tried: Sequence[TriedRig]) -> Finding:
    rest, form = pid_residual(), pid_of_gpi()
    found = tally(tried, _is_pid)
    kp, ki, kd, pole = pid_numbers(linear_loop(tried[0]))
    return finding(
        refuted(proof=rest == 0, numbers=found),
        "From the error to the voltage (20) is, without remainder, a PID whose derivative is "
        f"filtered by a lag of first order, pole at N = k3: G(s) - PID = {rest} with "
        f"K_p = {form[KP]}, K_i = {form[KI]}, K_d = {form[KD]}, all over C_U. With the paper's "
        f"gains N = {quantity(pole, 'rad/s')}, {quantity(pole / (2 * np.pi), 'Hz')}, a time "
        f"constant of {quantity(1e3 / pole, 'ms')}; K_p = {quantity(kp, 'V/m')}, "
        f"K_i = {quantity(ki, 'V/(m s)')}, K_d = {quantity(kd, 'V s/m')}. "
        + found.says("Frequency response of (20) run as printed against that PID"),
        Kp=kp,
        Ki=ki,
        Kd=kd,
        filter_pole=pole,
        remainder=str(rest),
        **found.counts,
    )


@claim("1-pid-precluded")
def _pid_precluded(tried: Sequence[TriedRig]) -> Finding:
    found = tally(tried, _is_pid)
    rest = pid_residual()
    return finding(
        refuted(proof=rest == 0, numbers=found),
        "The proposed law is itself a PID with a filtered derivative, four gains for four "
        "poles, plus the feedforward of the reference (see 3.1-filter): what this law can do, "
        "that PID can. " + found.says("Frequency response of (20) against that PID"),
        remainder=str(rest),
        **found.counts,
    )


def hold_drift(loop: LinearLoop, step: float) -> tuple[float, float, float]:
    """Return e [m] and the rates of the integrals of u_d [V] and y_d [m] held at Y + `step`.

    The linear loop with (20) as printed, after all transients.
    """
    matrix, column = loop.printed
    state = settled(matrix, column * step)
    rates = matrix @ state + column * step
    return float(state[0] - step), float(rates[2]), float(rates[3])


@claim("1-analogue")
def _analogue(tried: Sequence[TriedRig]) -> Finding:
    case = tried[0]
    over, under = (sp.Poly(part, p.s) for part in sp.fraction(sp.together(gpi_transfer(FOUR))))
    _, voltage, _ = hold_drift(linear_loop(case), case.step)
    return finding(
        over.degree() <= under.degree() == 2 and abs(voltage) <= AGREES,
        f"G(s) is proper, of degree {over.degree()} over {under.degree()}, so two integrators "
        "of an analogue circuit realise it. The four of (20) as printed would not stay in "
        f"their range: held at the end of the path, the one of the voltage runs off at "
        f"{quantity(voltage, 'V s per s')}.",
        "in the bounded form (20-bounded), with two states",
        degree=int(under.degree()),
        drift=voltage,
    )


@claim("3.2-initial-velocity")
def _differentiated(tried: Sequence[TriedRig]) -> Finding:
    kick = 0.05

    def forgotten(case: TriedRig) -> bool:
        loop = linear_loop(case)
        matrix, column = loop.printed
        state = settled(matrix, 0 * column, start=np.array([0.0, kick, 0, 0, 0, 0]))
        largest = kick / case.poles.values[1]
        k0, _, _, k3 = loop.gains
        held = k0 * state[5] / (k3 * kick)
        return bool(abs(state[0]) <= AGREES * largest and abs(held - 1) <= AGREES)

    found = tally(tried, forgotten)
    return finding(
        residual_is_zero("21", "22") and found.unanimous,
        "Derivation (21) and (22), residuals 0: k3 v_d(0) is a constant. In the loop the "
        "double integral takes it over, k0 int(int(e)) tends to k3 v_d(0). "
        + found.says(f"Linear loop started at {quantity(kick, 'm/s')}"),
        **found.counts,
    )


@claim("3.2-origin")
def _origin(tried: Sequence[TriedRig]) -> Finding:
    def drifts(case: TriedRig) -> bool:
        loop = linear_loop(case)
        step = case.step
        matrix, column = loop.printed
        error, voltage, gap = hold_drift(loop, step)
        hidden = np.linalg.matrix_rank(matrix / np.abs(matrix).max(axis=1, keepdims=True)) == 4
        time = settling_time(matrix)
        start = np.array([-step, 0.0, 0.0, 0.0])
        for share in (0.05, 0.1, 0.3):  # of the settling: the two realisations move alike
            seen = answer(matrix, column * step, np.zeros(6), 0, share * time)[0] - step
            twin = answer(loop.bounded, np.zeros(4), start, 0, share * time)[0]
            if abs(seen - twin) > AGREES * abs(step):
                return False
        rests = abs(error) <= AGREES * abs(step)
        moving = abs(gap / step - 1) <= AGREES and abs(voltage) > 0
        return bool(hidden and rests and moving)

    found = tally(tried, drifts)
    sound = residual_is_zero("20-bounded", "22")
    case = tried[0]
    _, voltage, gap = hold_drift(linear_loop(case), case.step)
    correction = (
        "e tends to zero in the linear loop from any start; all states do with the bounded form "
        "(20-bounded) of the law, not with (20) as printed"
    )
    return finding(
        refuted(proof=residual_is_zero("20-hidden"), numbers=found),
        "The loop with (20) as printed has six states and the polynomial "
        f"{proved()['20-hidden'].lines[0].rhs}: two poles at zero, which the error does not "
        f"show. Held at the end of the path the integral of y_d runs off at "
        f"{quantity(1e3 * gap, 'mm s per s')}, that of u_d at "
        f"{quantity(voltage, 'V s per s')}, nominally, too. The bounded form with two states "
        "has the same transfer function and only p(s). Any start is meant in the linear loop; "
        "of the plant (4) only a neighbourhood. "
        + found.says("Rank, drift and both realisations moving alike by matrix exponentials"),
        correction if sound else "",
        gap_drift=gap,
        voltage_drift=voltage,
        **found.counts,
    )
