"""The same continuous loop as others would write it: python-control, SciPy, CasADi's cvodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import control as ct
import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.loops import Numbers, Subject, numbers

BERNSTEIN = [math.comb(16, j) for j in range(8, 17)]
STEEPNESS = 16 * math.comb(15, 7)
"""The derivative of the path is STEEPNESS tau^7 (1 - tau)^8."""
SCALE = 1e6
"""ITAE is integrated times this, so that one absolute tolerance suits every state."""
ABSOLUTE = 1e-4
"""Absolute tolerance as a share of the relative one: gaps are centimetres."""

Run = Callable[[float], float]
"""(relative tolerance) -> ITAE."""


class Problem:
    """Reference, plant and law in plain Python, with an expression's operators when asked."""

    def __init__(self, of: Subject) -> None:
        path = of.rig.reference
        self.law: Numbers = numbers(of)
        self.ends = (path.start_gap, path.end_gap, path.start_time, path.end_time)
        self.horizon = path.horizon
        self.start = [of.scenario.initial_gap, 0.0, 0.0, 0.0, 0.0]

    def reference(self, t: Any, low: Any = max, high: Any = min) -> tuple[Any, Any]:
        """Return y* and y*''."""
        first, last, begin, end = self.ends
        tau = high(low((t - begin) / (end - begin), 0.0), 1.0)
        phi: Any = 0.0
        power: Any = 1.0
        for coefficient in BERNSTEIN:  # terms of one sign: the printed polynomial cancels
            phi = phi * (1 - tau) + coefficient * power
            power = power * tau
        bend = STEEPNESS * tau**6 * (1 - tau) ** 7 * (7 * (1 - tau) - 8 * tau)
        return first + (last - first) * tau**8 * phi, (last - first) / (end - begin) ** 2 * bend

    def rates(
        self, t: Any, x: Any, beta: float | None = None, low: Any = max, high: Any = min
    ) -> list[Any]:
        """Return the rates of gap, speed, the law's two states and SCALE ITAE."""
        p = self.law
        y_ref, acc_ref = self.reference(t, low, high)
        e = x[0] - y_ref
        u = p.voltage + p.static_gain * (y_ref - p.gap) + p.acceleration * acc_ref
        u = high(low(u + p.error * e + p.slow * x[2] + p.fast * x[3], p.low), p.high)
        pull = p.gravity - (p.beta if beta is None else beta) * u * u / (x[0] * x[0])
        size = ca.fabs(e) if isinstance(e, ca.SX) else abs(e)
        return [x[1], pull, e, e - p.pole * x[3], SCALE * t * size]


def scipy_loop(problem: Problem, solver: str) -> Run:
    """Return the loop for ``scipy.integrate.solve_ivp``."""

    def run(tolerance: float) -> float:
        found = solve_ivp(
            problem.rates,
            (0.0, problem.horizon),
            problem.start,
            method=solver,
            rtol=tolerance,
            atol=tolerance * ABSOLUTE,
        )
        return float(found.y[4, -1]) / SCALE

    return run


def tight_reference(problem: Problem) -> float:
    """Return the ITAE to all the digits that DOP853 gives, with steps of at most a millisecond."""
    found = solve_ivp(
        problem.rates,
        (0.0, problem.horizon),
        problem.start,
        method="DOP853",
        rtol=1e-10,
        atol=1e-14,
        max_step=1e-3,
    )
    return float(found.y[4, -1]) / SCALE


def cvodes_loop(problem: Problem) -> Run:
    """Return the loop for CasADi's cvodes; an integrator is built once a tolerance."""
    built: dict[float, ca.Function] = {}

    def run(tolerance: float) -> float:
        if tolerance not in built:
            t, x = ca.SX.sym("t"), ca.SX.sym("x", 5)
            rates = problem.rates(t, ca.vertsplit(x), None, ca.fmax, ca.fmin)
            options = {"reltol": tolerance, "abstol": tolerance * ABSOLUTE}
            options |= {"max_num_steps": 1_000_000}
            dae = {"t": t, "x": x, "ode": ca.vertcat(*rates)}
            built[tolerance] = ca.integrator("loop", "cvodes", dae, 0.0, problem.horizon, options)
        return float(built[tolerance](x0=problem.start)["xf"][4]) / SCALE

    return run


def control_loop(problem: Problem) -> Callable[[float, float | None], float]:
    """Return the loop for python-control: a plant, a controller, interconnected.

    Called with (relative tolerance, beta of the plant or None).
    """
    p = problem.law
    chosen: dict[str, float | None] = {"beta": None}

    def plant(t: float, x: Any, u: Any, _: Any) -> list[float]:
        y_ref, _ = problem.reference(t)
        beta = p.beta if chosen["beta"] is None else chosen["beta"]
        pull = p.gravity - beta * u[0] * u[0] / (x[0] * x[0])
        return [x[1], pull, SCALE * t * abs(x[0] - y_ref)]

    def law(t: float, x: Any, u: Any, _: Any) -> list[float]:
        e = u[0] - problem.reference(t)[0]
        return [e, e - p.pole * x[1]]

    def command(t: float, x: Any, u: Any, _: Any) -> float:
        y_ref, acc_ref = problem.reference(t)
        voltage = p.voltage + p.static_gain * (y_ref - p.gap) + p.acceleration * acc_ref
        voltage += p.error * (u[0] - y_ref) + p.slow * x[0] + p.fast * x[1]
        return float(min(max(voltage, p.low), p.high))

    ball = ct.nlsys(
        plant, lambda _t, x, _u, _p: x[0], inputs=["u"], outputs=["y"], states=3, name="ball"
    )
    controller = ct.nlsys(law, command, inputs=["y"], outputs=["u"], states=2, name="law")
    loop = ct.interconnect([ball, controller], inputs=[], outputs=["y", "u"], name="loop")
    times = np.array([0.0, problem.horizon])

    def run(tolerance: float, beta: float | None = None) -> float:
        chosen["beta"] = beta
        found = ct.input_output_response(
            loop,
            times,
            0.0,
            [problem.start[0], 0.0, 0.0, 0.0, 0.0],
            solve_ivp_kwargs={"rtol": tolerance, "atol": tolerance * ABSOLUTE},
        )
        return float(found.states[2, -1]) / SCALE

    return run
