"""Section 4 where no simulation is needed: the numbers, the sampling condition, the path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
import sympy as sp

from maglev_design import design
from maglev_design.options import METHODS
from maglev_design.paper.equations import proved
from maglev_design.paper.ledger import Claim, judged
from maglev_design.paper.theory_linear import Case, linear_loop, quantity
from maglev_design.paper.theory_plant import DERIVE
from maglev_design.paper.theory_sampled import largest_period
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as ref

CLAIMS = "maglev-design claims --json"

PRINTED_VOLTAGE = "2.0825"
"""U [V], sec. 4."""
PRINTED_POLE = -70
"""[1/s] Fourfold, sec. 4."""
PRINTED_ORDER = 16
"""Of the Bezier polynomial, sec. 4."""
PRINTED_PERIODS = {"4": 0.001, "5.2": 0.002}
"""[s] Sampling periods by section."""


def path_claims(tried: Sequence[Case]) -> tuple[Claim, ...]:
    """Return the claims on the numbers and on the path, for the paper's rig, the first."""
    case = tried[0]
    return (
        _voltage(case),
        _gains(case),
        *_sampling_conditions(case),
        _order(),
        _smooth(),
        _monotone(),
        _rest_to_rest(case),
        _initial_error(case),
    )


def _voltage(case: Case) -> Claim:
    gap = case.rig.operating_point.gap
    voltage = design.true_equilibrium(case.rig, design.plant_beta(case.rig), gap).U
    half_a_digit = 0.5 * 10.0 ** -len(PRINTED_VOLTAGE.partition(".")[2])
    holds = abs(voltage - float(PRINTED_VOLTAGE)) <= half_a_digit
    correction = "" if holds else f"U = {voltage:.6g} V"
    return Claim(
        id="4-voltage",
        place="sec. 4",
        statement=f"The equilibrium at Y = {gap:g} m needs U = {PRINTED_VOLTAGE} V.",
        verdict=judged(holds=holds, correction=correction),
        correction=correction,
        evidence=(
            f"sqrt(g/beta) Y = {voltage:.7g} V. The printed U is the computed one, so that test 3 "
            "leaves open whether a controller with a wrong beta keeps it or computes its own."
        ),
        command=CLAIMS,
        values={"U": voltage, "printed": float(PRINTED_VOLTAGE)},
    )


def _gains(case: Case) -> Claim:
    gains = linear_loop(case).gains
    wanted = sp.Poly((p.s - PRINTED_POLE) ** 4, p.s).all_coeffs()
    symbolic = [line.rhs for line in proved()["25"].lines]
    zeta, speed = case.poles.first
    exact = {p.zeta: sp.nsimplify(zeta), p.omega_n: sp.nsimplify(speed)}
    holds = [1, *(k.subs(exact) for k in symbolic)] == wanted
    agrees = [1.0, *reversed(gains)] == [float(x) for x in wanted]
    k0, k1, k2, k3 = gains
    return Claim(
        id="4-gains",
        place="sec. 4",
        statement=(
            f"zeta_d = {zeta:g} and omega_nd = {speed:g} rad/s put all poles at {PRINTED_POLE} 1/s."
        ),
        verdict=judged(holds=holds and agrees),
        correction="",
        evidence=(
            f"(25) gives k3 = {k3:.10g} 1/s, k2 = {k2:.10g} 1/s^2, k1 = {k1:.10g} 1/s^3 and "
            f"k0 = {k0:.10g} 1/s^4, the coefficients of (s + {-PRINTED_POLE})^4."
        ),
        command=DERIVE,
        values={"k3": k3, "k2": k2, "k1": k1, "k0": k0},
    )


def _sampling_conditions(case: Case) -> tuple[Claim, ...]:
    limits = {method: largest_period(case, method) for method in METHODS}
    speed = case.poles.values[1]
    found = ", ".join(
        f"{method} up to {quantity(1e3 * limit, 'ms')} (omega_n T = {limit * speed:.3g})"
        for method, limit in limits.items()
    )
    return tuple(
        Claim(
            id=f"{section}-haykin",
            place=f"sec. {section}",
            statement=(
                f"A sampling period of {quantity(1e3 * period, 'ms')} meets Haykin's condition for "
                f"the poles at {PRINTED_POLE} 1/s."
            ),
            verdict="not-checkable",
            correction="",
            evidence=(
                "The paper cites a book for the condition and does not state it. What can be said: "
                f"omega_n T = {period * speed:.3g}, {2 * math.pi / (speed * period):.3g} samples "
                "in a period of omega_n, and the sampled linear loop is stable at every gap of the "
                f"path at exact beta, without delay, by {found}; so "
                f"{quantity(1e3 * period, 'ms')} is "
                f"{'inside' if period < min(limits.values()) else 'outside'} all of them."
            ),
            command=CLAIMS,
            values={
                "period": period,
                "omega_n_T": period * speed,
                **{f"largest_period_{method}": limit for method, limit in limits.items()},
            },
        )
        for section, period in PRINTED_PERIODS.items()
    )


@cache
def _step() -> ref.BezierStep:
    return ref.bezier_step()


def _order() -> Claim:
    degree = sp.Poly(sp.expand(_step().value), ref.tau).degree()
    holds = degree == PRINTED_ORDER
    return Claim(
        id="4-bezier-order",
        place="sec. 4",
        statement=f"The step (28) is a Bezier polynomial of order {PRINTED_ORDER}.",
        verdict=judged(holds=holds),
        correction="",
        evidence=(
            f"Degree {degree} in tau; it is the Bezier polynomial whose first "
            f"{_step().leading} control values are 0 and whose other "
            f"{_step().order + 1 - _step().leading} are 1, derivation (28) and (29), residuals 0."
        ),
        command=DERIVE,
        values={"degree": int(degree)},
    )


def _smooth() -> Claim:
    at_start, at_end = ref.flatness_at_ends(_step())
    printed = sp.Poly(proved()["28"].lines[0].rhs.subs(_printed_numbers()), ref.tau)
    counted = (_vanishing(printed, 0), _vanishing(printed, 1))
    holds = counted == (at_start, at_end) and min(counted) >= 2
    return Claim(
        id="4-bezier-smooth",
        place="sec. 4",
        statement="The path from rest to rest is smooth.",
        verdict=judged(holds=holds),
        correction="",
        evidence=(
            f"{counted[0]} derivatives of the step vanish at its start and {counted[1]} at its "
            f"end: it is asymmetric, y* has {min(counted)} continuous derivatives, and y*'', which "
            "the feedforward needs, is one of them. Counted on the printed polynomial."
        ),
        command=DERIVE,
        values={"at_start": counted[0], "at_end": counted[1]},
    )


def _printed_numbers() -> dict[sp.Symbol, sp.Expr]:
    return {line.lhs: line.rhs for line in proved()["29"].lines}


def _vanishing(step: sp.Poly, end: int) -> int:
    derivative, count = step.diff(ref.tau), 0
    while derivative.eval(end) == 0:
        derivative, count = derivative.diff(ref.tau), count + 1
    return count


def _monotone() -> Claim:
    step = proved()["28"].lines[0].rhs.subs(_printed_numbers())
    slope = sp.factor(sp.diff(step, ref.tau))
    scale = sp.cancel(slope / (ref.tau**7 * (1 - ref.tau) ** 8))
    holds = bool(scale.is_number and scale > 0) and step.subs(ref.tau, 0) == 0
    holds = holds and step.subs(ref.tau, 1) == 1
    return Claim(
        id="4-bezier-monotone",
        place="sec. 4",
        statement="The step interpolates between 0 and 1.",
        verdict=judged(holds=holds),
        correction="",
        evidence=(
            f"It starts at 0 and ends at 1, and its derivative is {scale} tau^7 (1 - tau)^8, "
            "nowhere negative between: monotone, without overshoot."
        ),
        command=DERIVE,
        values={"slope_factor": str(scale)},
    )


@cache
def extreme_times() -> tuple[sp.Expr, ...]:
    """Return where in (0, 1) the step's slope or curvature is extreme, exactly."""
    found = [
        root
        for derivative in (_step().curvature, sp.diff(_step().curvature, ref.tau))
        for factor, _ in sp.factor_list(derivative)[1]
        for root in sp.Poly(factor, ref.tau).real_roots()
        if 0 < root < 1
    ]
    return tuple(sorted(found))


def _rest_to_rest(case: Case) -> Claim:
    path, beta = case.rig.reference, design.plant_beta(case.rig)
    travel, duration = path.end_gap - path.start_gap, path.end_time - path.start_time
    taus = np.array([float(tau) for tau in extreme_times()])
    times = path.start_time + duration * taus
    _, velocity, acceleration = design.reference_path(case.rig, times)
    hardest, fast = int(np.argmax(np.abs(acceleration))), int(np.argmax(np.abs(velocity)))
    ends = design.reference_path(case.rig, np.array([path.start_time, path.end_time]))
    rest = bool(np.all(ends[1:] == 0))
    gaps_fit = np.allclose(ends[0], [path.start_gap, path.end_gap], rtol=1e-12, atol=0)
    voltages = [design.true_equilibrium(case.rig, beta, float(gap)).U for gap in ends[0]]
    dense = design.reference_path(case.rig, np.linspace(path.start_time, path.end_time, 20001))
    peaks_hold = bool(
        np.isclose(np.abs(dense[1]).max(), abs(velocity[fast]), rtol=1e-6)
        and np.isclose(np.abs(dense[2]).max(), abs(acceleration[hardest]), rtol=1e-6)
    )
    return Claim(
        id="2.4-rest-to-rest",
        place="sec. 2.4, 4",
        statement="The path leaves one equilibrium and arrives at another in a given time.",
        verdict=judged(holds=rest and gaps_fit and peaks_hold),
        correction="",
        evidence=(
            f"Velocity and acceleration are zero at both ends, {quantity(path.start_time, 's')} "
            f"and {quantity(path.end_time, 's')}, where the feedforward is the plant's own voltage "
            f"at rest, {quantity(voltages[0], 'V')} and {quantity(voltages[1], 'V')}. On the way "
            f"of {quantity(1e3 * travel, 'mm')} the velocity reaches "
            f"{quantity(1e3 * velocity[fast], 'mm/s')} at {quantity(times[fast], 's')}, the "
            f"acceleration {quantity(1e3 * acceleration[hardest], 'mm/s^2')} at "
            f"{quantity(times[hardest], 's')}, "
            f"{quantity(100 * abs(acceleration[hardest]) / case.rig.plant.gravity, '% of g')}."
        ),
        command=CLAIMS,
        values={
            "peak_velocity": float(velocity[fast]),
            "peak_velocity_time": float(times[fast]),
            "peak_acceleration": float(acceleration[hardest]),
            "peak_acceleration_time": float(times[hardest]),
            "start_voltage": voltages[0],
            "end_voltage": voltages[1],
        },
    )


def _initial_error(case: Case) -> Claim:
    rig, loop = case.rig, linear_loop(case)
    error = rig.initial.gap - rig.reference.start_gap
    travel = abs(rig.reference.end_gap - rig.reference.start_gap)
    kick = (loop.gains[2] + loop.c_y_hat) / loop.c_u_hat * error
    beta = design.plant_beta(rig)
    held = design.true_equilibrium(rig, beta, rig.reference.start_gap).U
    high = rig.limits.voltage[1]
    shares = [100 * abs(error) / whole for whole in (rig.reference.start_gap, travel)]
    return Claim(
        id="4.1-initial-error",
        place="sec. 2.4, 4.1, 6",
        statement="The ball starts far from the path: the initial error is large.",
        verdict="not-checkable",
        correction="",
        evidence=(
            "Large is a judgement. The figure: "
            f"{quantity(1e3 * error, 'mm')}, {quantity(shares[0], '%')} of the gap and "
            f"{quantity(shares[1], '%')} of the travel, the only one simulated. The law (20) "
            f"answers with {quantity(kick, 'V')} on top of {quantity(held, 'V')}, in all "
            f"{quantity(held + kick, 'V')} of the {quantity(high, 'V')} that the actuator reaches."
        ),
        command="maglev-design simulate",
        values={"error": error, "share_of_gap": shares[0] / 100, "first_voltage": held + kick},
    )
