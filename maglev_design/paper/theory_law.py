"""Sections 1, 3.1 and 3.2 on the law itself: what it is, and what it does not need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import sympy as sp
from sympy import Expr, Symbol

from maglev_design.derivation import terms as d
from maglev_design.paper.equations import proved
from maglev_design.paper.ledger import Claim, judged
from maglev_design.paper.theory_linear import (
    AGREES,
    Array,
    Case,
    LinearLoop,
    answer,
    bounded_matrix,
    linear_loop,
    printed_matrix,
    quantity,
    refuted,
    settling_time,
    tally,
)
from maglev_design.paper.theory_plant import DERIVE, residual_is_zero
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.laws import gpi_transfer

FOUR = (p.k0, p.k1, p.k2, p.k3)
KP, KI, KD, FILTER = sp.symbols("K_p K_i K_d N", real=True)
FREQUENCIES = np.geomspace(1e-2, 1e2, 25)
"""In units of omega_n, where the transfer functions are compared."""


def law_claims(tried: Sequence[Case]) -> tuple[Claim, ...]:
    """Return the claims on the laws (14) and (20)."""
    return (
        _third_order(tried),
        _velocity(),
        _filter(tried),
        _pid_precluded(tried),
        _analogue(tried),
        _differentiated(tried),
        _origin(tried),
    )


def _third_order(tried: Sequence[Case]) -> Claim:
    def placed(case: Case) -> bool:
        loop = linear_loop(case)
        _, k1, k2, k3 = loop.gains
        share = np.array([k2 + loop.c_y, k3, k1]) / loop.c_u  # of y_d, its velocity, its integral
        matrix = np.array([[0, 1, 0], np.array([loop.c_y, 0, 0]) - loop.c_u * share, [1, 0, 0]])
        found = np.poly(matrix)
        return bool(np.allclose(found, [1, k3, k2, k1], rtol=AGREES, atol=0))

    found = tally(tried, placed)
    return Claim(
        id="3.1-dynamics",
        place="sec. 3.1",
        statement=(
            "The state feedback (14) gives the error the dynamics (15) of third order, and any "
            "Hurwitz polynomial (16) can be had."
        ),
        verdict=judged(holds=residual_is_zero("14", "15", "16", "25-n") and found.unanimous),
        correction="",
        evidence=(
            "Derivation (14)-(16) and (25-n), residuals 0; for the linear plant (10). "
            + found.says("Characteristic polynomial of the state matrix")
        ),
        command=DERIVE,
        values={"rigs": found.tried, "agreed": found.agreed},
    )


def _velocity() -> Claim:
    law = proved()["14"].lines[0].rhs
    share = sp.simplify(sp.diff(law, d.e1))
    return Claim(
        id="3.1-velocity",
        place="sec. 3.1",
        statement="The state feedback (14) needs the ball's velocity.",
        verdict=judged(holds=share.is_positive),
        correction="",
        evidence=f"Its voltage changes by {share} for each unit of velocity, never zero.",
        command=DERIVE,
        values={"share": str(share)},
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
    numbers = dict(zip((*FOUR, p.C_Y), (*loop.gains, loop.c_y_hat), strict=True))
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


def _is_pid(case: Case) -> bool:
    loop = linear_loop(case)
    kp, ki, kd, pole = pid_numbers(loop)
    omega = FREQUENCIES * case.poles.values[1]
    s = 1j * omega
    pid = kp + ki / s + kd * s / (1 + s / pole)
    return bool(np.allclose(_printed_response(loop, omega), pid, rtol=AGREES, atol=0))


def _filter(tried: Sequence[Case]) -> Claim:
    rest, form = pid_residual(), pid_of_gpi()
    found = tally(tried, _is_pid)
    kp, ki, kd, pole = pid_numbers(linear_loop(tried[0]))
    return Claim(
        id="3.1-filter",
        place="sec. 3.1, 3.2",
        statement=(
            "With its velocity reconstructed from integrals, the law (20) does without the "
            "low-pass filter of a numerical derivative and without the filter's delay."
        ),
        verdict=refuted(proof=rest == 0, numbers=found),
        correction="",
        evidence=(
            "From the error to the voltage (20) is, without remainder, a PID whose derivative is "
            f"filtered by a lag of first order, pole at N = k3: G(s) - PID = {rest} with "
            f"K_p = {form[KP]}, K_i = {form[KI]}, K_d = {form[KD]}, all over C_U. With the paper's "
            f"gains N = {quantity(pole, 'rad/s')}, {quantity(pole / (2 * np.pi), 'Hz')}, a time "
            f"constant of {quantity(1e3 / pole, 'ms')}; K_p = {quantity(kp, 'V/m')}, "
            f"K_i = {quantity(ki, 'V/(m s)')}, K_d = {quantity(kd, 'V s/m')}. "
            + found.says("Frequency response of (20) run as printed against that PID")
        ),
        command=DERIVE,
        values={
            "Kp": kp,
            "Ki": ki,
            "Kd": kd,
            "filter_pole": pole,
            "remainder": str(rest),
            "rigs": found.tried,
            "agreed": found.agreed,
        },
    )


def _pid_precluded(tried: Sequence[Case]) -> Claim:
    found = tally(tried, _is_pid)
    rest = pid_residual()
    return Claim(
        id="1-pid-precluded",
        place="sec. 1",
        statement=(
            "Nonlinearity and instability rule conventional PID control out for more than simple "
            "tasks."
        ),
        verdict=refuted(proof=rest == 0, numbers=found),
        correction="",
        evidence=(
            "The proposed law is itself a PID with a filtered derivative, four gains for four "
            "poles, plus the feedforward of the reference (see 3.1-filter): what this law can do, "
            "that PID can. " + found.says("Frequency response of (20) against that PID")
        ),
        command=DERIVE,
        values={"remainder": str(rest), "rigs": found.tried, "agreed": found.agreed},
    )


def hold_drift(loop: LinearLoop, step: float) -> tuple[float, float, float]:
    """Return e [m] and the rates of the integrals of u_d [V] and y_d [m] held at Y + `step`.

    The linear loop with (20) as printed, after all transients.
    """
    matrix, column = printed_matrix(loop)
    time = settling_time(matrix)
    state = answer(matrix, column * step, np.zeros(6), 0, time)
    rates = matrix @ state + column * step
    return float(state[0] - step), float(rates[2]), float(rates[3])


def _analogue(tried: Sequence[Case]) -> Claim:
    case = tried[0]
    over, under = (sp.Poly(part, p.s) for part in sp.fraction(sp.together(gpi_transfer(FOUR))))
    proper = over.degree() <= under.degree() == 2
    _, voltage, _ = hold_drift(linear_loop(case), case.step)
    keeps = abs(voltage) <= AGREES
    correction = "" if proper and keeps else "in the bounded form (20-bounded), with two states"
    return Claim(
        id="1-analogue",
        place="sec. 1",
        statement="GPI laws need no sampling and can be built in analogue electronics.",
        verdict=judged(holds=proper and keeps, correction=correction),
        correction=correction,
        evidence=(
            f"G(s) is proper, of degree {over.degree()} over {under.degree()}, so two integrators "
            "of an analogue circuit realise it. The four of (20) as printed would not stay in "
            f"their range: held at the end of the path, the one of the voltage runs off at "
            f"{quantity(voltage, 'V s per s')}."
        ),
        command=DERIVE,
        values={"degree": int(under.degree()), "drift": voltage},
    )


def _differentiated(tried: Sequence[Case]) -> Claim:
    kick = 0.05

    def forgotten(case: Case) -> bool:
        loop = linear_loop(case)
        matrix, column = printed_matrix(loop)
        start = np.array([0.0, kick, 0, 0, 0, 0])
        state = answer(matrix, 0 * column, start, 0, settling_time(matrix))
        largest = kick / case.poles.values[1]
        k0, _, _, k3 = loop.gains
        held = k0 * state[5] / (k3 * kick)
        return bool(abs(state[0]) <= AGREES * largest and abs(held - 1) <= AGREES)

    found = tally(tried, forgotten)
    return Claim(
        id="3.2-initial-velocity",
        place="sec. 3.2",
        statement=(
            "The unknown initial velocity in (21) is gone after two derivatives, (22), and leaves "
            "no lasting error."
        ),
        verdict=judged(holds=residual_is_zero("21", "22") and found.unanimous),
        correction="",
        evidence=(
            "Derivation (21) and (22), residuals 0: k3 v_d(0) is a constant. In the loop the "
            "double integral takes it over, k0 int(int(e)) tends to k3 v_d(0). "
            + found.says(f"Linear loop started at {quantity(kick, 'm/s')}")
        ),
        command=DERIVE,
        values={"rigs": found.tried, "agreed": found.agreed},
    )


def _origin(tried: Sequence[Case]) -> Claim:
    def drifts(case: Case) -> bool:
        loop = linear_loop(case)
        step = case.step
        matrix, column = printed_matrix(loop)
        error, voltage, gap = hold_drift(loop, step)
        hidden = np.linalg.matrix_rank(matrix / np.abs(matrix).max(axis=1, keepdims=True)) == 4
        time = settling_time(matrix)
        own = bounded_matrix(loop)
        start = np.array([-step, 0.0, 0.0, 0.0])
        for share in (0.05, 0.1, 0.3):  # of the settling: the two realisations move alike
            seen = answer(matrix, column * step, np.zeros(6), 0, share * time)[0] - step
            twin = answer(own, np.zeros(4), start, 0, share * time)[0]
            if abs(seen - twin) > AGREES * abs(step):
                return False
        settled = abs(error) <= AGREES * abs(step)
        moving = abs(gap / step - 1) <= AGREES and abs(voltage) > 0
        return bool(hidden and settled and moving)

    found = tally(tried, drifts)
    hidden = residual_is_zero("20-hidden")
    sound = residual_is_zero("20-bounded", "22")
    case = tried[0]
    _, voltage, gap = hold_drift(linear_loop(case), case.step)
    correction = (
        "e tends to zero in the linear loop from any start; all states do with the bounded form "
        "(20-bounded) of the law, not with (20) as printed"
    )
    verdict = refuted(proof=hidden, numbers=found, correction=correction if sound else "")
    return Claim(
        id="3.2-origin",
        place="sec. 3.2",
        statement=(
            "With (20) the origin is an exponentially stable equilibrium, whatever the initial "
            "conditions of the system."
        ),
        verdict=verdict,
        correction=correction if verdict == "corrected" else "",
        evidence=(
            "The loop with (20) as printed has six states and the polynomial "
            f"{proved()['20-hidden'].lines[0].rhs}: two poles at zero, which the error does not "
            f"show. Held at the end of the path the integral of y_d runs off at "
            f"{quantity(1e3 * gap, 'mm s per s')}, that of u_d at "
            f"{quantity(voltage, 'V s per s')}, nominally, too. The bounded form with two states "
            "has the same transfer function and only p(s). Any start is meant in the linear loop; "
            "of the plant (4) only a neighbourhood. "
            + found.says("Rank, drift and both realisations moving alike by matrix exponentials")
        ),
        command=DERIVE,
        values={
            "gap_drift": gap,
            "voltage_drift": voltage,
            "rigs": found.tried,
            "agreed": found.agreed,
        },
    )
