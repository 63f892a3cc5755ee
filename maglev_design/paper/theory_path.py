"""Section 4 where no simulation is needed: the numbers, the sampling condition, the path."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial

import numpy as np
import sympy as sp

from maglev_design.certification.intervals.sampled import setting
from maglev_design.certification.intervals.sampled_limits import largest_period
from maglev_design.controller import design
from maglev_design.controller.family import family_of
from maglev_design.options import METHODS, Method
from maglev_design.paper.ledger import Finding, claim, finding
from maglev_design.paper.printed import proved
from maglev_design.paper.theory_linear import TriedRig, linear_loop, quantity
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as ref

PRINTED_GAP, PRINTED_VOLTAGE = "0.0246", "2.0825"
"""Y [m] and U [V], sec. 4."""
PRINTED_POLE = -70
"""[1/s] Fourfold, sec. 4."""
PRINTED_ORDER = 16
"""Of the Bezier polynomial, sec. 4."""
PRINTED_PERIODS = {"4": 0.001, "5.2": 0.002}
"""[s] Sampling periods by section."""


@claim("4-voltage")
def _voltage(case: TriedRig) -> Finding:
    gap = case.rig.operating_point.gap
    voltage = design.true_equilibrium(case.rig, design.plant_beta(case.rig), gap).U
    half_a_digit = 0.5 * 10.0 ** -len(PRINTED_VOLTAGE.partition(".")[2])
    return finding(
        abs(voltage - float(PRINTED_VOLTAGE)) <= half_a_digit,
        f"sqrt(g/beta) Y = {voltage:.7g} V. The printed U is the computed one, so that test 3 "
        "leaves open whether a controller with a wrong beta keeps it or computes its own.",
        f"U = {voltage:.6g} V",
        U=voltage,
        printed=float(PRINTED_VOLTAGE),
    )


@claim("4-gains")
def _gains(case: TriedRig) -> Finding:
    k0, k1, k2, k3 = gains = linear_loop(case).gains
    wanted = sp.Poly((p.s - PRINTED_POLE) ** 4, p.s).all_coeffs()
    symbolic = [line.rhs for line in proved()["25"].lines]
    zeta, speed = case.poles.first
    exact = {p.zeta: sp.nsimplify(zeta), p.omega_n: sp.nsimplify(speed)}
    holds = [1, *(k.subs(exact) for k in symbolic)] == wanted
    agrees = [1.0, *reversed(gains)] == [float(x) for x in wanted]
    return finding(
        holds and agrees,
        f"(25) gives k3 = {k3:.10g} 1/s, k2 = {k2:.10g} 1/s^2, k1 = {k1:.10g} 1/s^3 and "
        f"k0 = {k0:.10g} 1/s^4, the coefficients of (s + {-PRINTED_POLE})^4.",
        k3=k3,
        k2=k2,
        k1=k1,
        k0=k0,
    )


@cache
def largest_periods(case: TriedRig) -> dict[Method, float]:
    """Return by method the period [s] up to which the loop is proved stable, without delay.

    Nominal controller and exact beta, at every gap of the path.
    """
    rig, gaps = case.rig, family_of(case.rig).gaps
    loops = {
        method: setting(rig, design.make_design(rig, case.poles, method=method))
        for method in METHODS
    }
    return {
        method: largest_period(loop, rig.sampling.period, 0.0, gaps).stable
        for method, loop in loops.items()
    }


def _sampling_condition(period: float, case: TriedRig) -> Finding:
    limits, speed = largest_periods(case), case.poles.values[1]
    found = ", ".join(
        f"{method} up to {quantity(1e3 * limit, 'ms')} (omega_n T = {limit * speed:.3g})"
        for method, limit in limits.items()
    )
    return finding(
        "not-checkable",
        "The paper cites a book for the condition and does not state it. What can be said: "
        f"omega_n T = {period * speed:.3g}, {2 * math.pi / (speed * period):.3g} samples "
        "in a period of omega_n, and the sampled linear loop is stable at every gap of the "
        f"path at exact beta, without delay, by {found}; so "
        f"{quantity(1e3 * period, 'ms')} is "
        f"{'inside' if period < min(limits.values()) else 'outside'} all of them.",
        period=period,
        omega_n_T=period * speed,
        **{f"largest_period_{method}": limit for method, limit in limits.items()},
    )


for _section, _period in PRINTED_PERIODS.items():
    claim(f"{_section}-haykin")(partial(_sampling_condition, _period))


@cache
def _step() -> ref.BezierStep:
    return ref.bezier_step()


@claim("4-bezier-order")
def _order() -> Finding:
    degree = sp.Poly(sp.expand(_step().value), ref.tau).degree()
    return finding(
        degree == PRINTED_ORDER,
        f"Degree {degree} in tau; it is the Bezier polynomial whose first "
        f"{_step().leading} control values are 0 and whose other "
        f"{_step().order + 1 - _step().leading} are 1, derivation (28) and (29), residuals 0.",
        degree=int(degree),
    )


@claim("4-bezier-smooth")
def _smooth() -> Finding:
    counted = ref.flatness_at_ends(replace(_step(), value=_printed_step()))
    return finding(
        counted == ref.flatness_at_ends(_step()) and min(counted) >= 2,
        f"{counted[0]} derivatives of the step vanish at its start and {counted[1]} at its "
        f"end: it is asymmetric, y* has {min(counted)} continuous derivatives, and y*'', which "
        "the feedforward needs, is one of them. Counted on the printed polynomial.",
        at_start=counted[0],
        at_end=counted[1],
    )


def _printed_step() -> sp.Expr:
    return proved()["28"].lines[0].rhs.subs({r.lhs: r.rhs for r in proved()["29"].lines})


@claim("4-bezier-monotone")
def _monotone() -> Finding:
    step = _printed_step()
    slope = sp.factor(sp.diff(step, ref.tau))
    scale = sp.cancel(slope / (ref.tau**7 * (1 - ref.tau) ** 8))
    ends = [step.subs(ref.tau, end) for end in (0, 1)]
    return finding(
        bool(scale.is_number and scale > 0) and ends == [0, 1],
        f"It starts at 0 and ends at 1, and its derivative is {scale} tau^7 (1 - tau)^8, "
        "nowhere negative between: monotone, without overshoot.",
        slope_factor=str(scale),
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


@claim("2.4-rest-to-rest")
def _rest_to_rest(case: TriedRig) -> Finding:
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
    peaks = [abs(velocity[fast]), abs(acceleration[hardest])]
    peaks_hold = np.allclose(np.abs(dense[1:]).max(axis=1), peaks, rtol=1e-6, atol=0)
    return finding(
        rest and gaps_fit and peaks_hold,
        f"Velocity and acceleration are zero at both ends, {quantity(path.start_time, 's')} "
        f"and {quantity(path.end_time, 's')}, where the feedforward is the plant's own voltage "
        f"at rest, {quantity(voltages[0], 'V')} and {quantity(voltages[1], 'V')}. On the way "
        f"of {quantity(1e3 * travel, 'mm')} the velocity reaches "
        f"{quantity(1e3 * velocity[fast], 'mm/s')} at {quantity(times[fast], 's')}, the "
        f"acceleration {quantity(1e3 * acceleration[hardest], 'mm/s^2')} at "
        f"{quantity(times[hardest], 's')}, "
        f"{quantity(100 * abs(acceleration[hardest]) / case.rig.plant.gravity, '% of g')}.",
        peak_velocity=float(velocity[fast]),
        peak_velocity_time=float(times[fast]),
        peak_acceleration=float(acceleration[hardest]),
        peak_acceleration_time=float(times[hardest]),
        start_voltage=voltages[0],
        end_voltage=voltages[1],
    )


@claim("4.1-initial-error")
def _initial_error(case: TriedRig) -> Finding:
    rig, loop = case.rig, linear_loop(case)
    error = rig.initial.gap - rig.reference.start_gap
    travel = abs(rig.reference.end_gap - rig.reference.start_gap)
    kick = (loop.gains[2] + loop.c_y_hat) / loop.c_u_hat * error
    beta = design.plant_beta(rig)
    held = design.true_equilibrium(rig, beta, rig.reference.start_gap).U
    high = rig.limits.voltage[1]
    shares = [100 * abs(error) / whole for whole in (rig.reference.start_gap, travel)]
    return finding(
        "not-checkable",
        "Large is a judgement. The figure: "
        f"{quantity(1e3 * error, 'mm')}, {quantity(shares[0], '%')} of the gap and "
        f"{quantity(shares[1], '%')} of the travel, the only one simulated. The law (20) "
        f"answers with {quantity(kick, 'V')} on top of {quantity(held, 'V')}, in all "
        f"{quantity(held + kick, 'V')} of the {quantity(high, 'V')} that the actuator reaches.",
        error=error,
        share_of_gap=shares[0] / 100,
        first_voltage=held + kick,
    )
