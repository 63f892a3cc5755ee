"""Every program as it is lowered from the symbolic statement; the only place that does so.

Inputs and outputs of each are described where it is fetched: :mod:`maglev_design.programs`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache

import sympy as sp

from maglev_design.lowering import Program, lower
from maglev_design.options import Controller, Equilibrium, Method
from maglev_design.symbolic import laws, sampling, stability
from maglev_design.symbolic import metrics as quadratures
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as paths
from maglev_design.symbolic.flatness import flat_model
from maglev_design.symbolic.linearisation import (
    believed_beta,
    believed_coefficients,
    linearise,
)

POLES = (p.zeta_1, p.omega_1, p.zeta_2, p.omega_2)
_FIXED = (p.Y, p.U, laws.u_min, laws.u_max)


@cache
def law(controller: Controller) -> laws.ControlLaw:
    """Return the law of a controller."""
    return laws.control_law(controller)


@cache
def equation(method: Method, controller: Controller) -> sampling.DifferenceEquation:
    """Return the symbolic difference equation of a law under `method`."""
    return sampling.difference_equation(law(controller), method)


@cache
def core(
    method: Method, controller: Controller
) -> tuple[laws.StateSpace, Mapping[sp.Symbol, sp.Expr]]:
    """Return a law's sampled core in the coefficients of its step, and what these are."""
    return sampling.named_core(law(controller), method)


@cache
def gain_expressions(controller: Controller) -> Mapping[sp.Symbol, sp.Expr]:
    """Return a law's gains, in its order, in (zeta_1, omega_1, zeta_2, omega_2)."""
    first, second = POLES[:2], POLES[2:]
    order = laws.closed_loop_order(controller)
    if order == 4:
        desired = laws.pole_pairs_polynomial([first, second])
    else:
        desired = laws.pole_pairs_polynomial([first]) * (p.s + p.omega_2)
    matched = laws.match_coefficients(desired, order)
    known = dict(zip(law(controller).gains, matched, strict=False))
    known |= {laws.omega_f: sp.Rational(repr(controller.filter)) * p.omega_2}
    return {gain: known[gain] for gain in law(controller).gains}


def gains(controller: Controller) -> Program:
    """Return the law's gains for two pole pairs, or for a pair and a real pole."""
    wanted = gain_expressions(controller)
    return lower(POLES, {gain.name: value for gain, value in wanted.items()})


def gains_of_pid() -> Program:
    """Return k1, k2 and k3 of a PID in the gains of its transfer function."""
    inputs = (laws.K_p, laws.K_i, laws.K_d, p.C_U_hat, p.C_Y_hat)
    wanted = laws.gains_of_pid()
    return lower(inputs, {k.name: stability.believed(value) for k, value in wanted.items()})


def _own_constants(expressions: Iterable[sp.Expr]) -> list[sp.Symbol]:
    """Return which of beta_c, g, Y and y0 a law's coefficients are made of."""
    used = {symbol for expression in expressions for symbol in expression.free_symbols}
    return [symbol for symbol in (p.beta_c, p.g, p.Y, p.y0) if symbol in used]


def coefficients(method: Method, controller: Controller) -> Program:
    """Return the coefficients of the difference equation."""
    wanted = equation(method, controller).coefficients
    own = _own_constants(wanted.values())
    inputs = (p.C_U_hat, p.C_Y_hat, *own, p.T, laws.u_min, laws.u_max, *law(controller).gains)
    return lower(inputs, {s.name: stability.believed(x) for s, x in wanted.items()})


def slope(controller: Controller) -> Program:
    """Return the slope of the command in w, and the believed loop gain."""
    own = law(controller)
    inputs = (p.u, p.y_ref, p.beta_c, p.y0, p.C_U_hat)
    return lower(inputs, {"slope": own.slope, "loop_gain": stability.believed(own.loop_gain)})


def believed(equilibrium: Equilibrium) -> Program:
    """Return what a controller believes under a reading of the equilibrium."""
    levitation = p.magnetic_levitation()
    known = believed_coefficients(levitation, linearise(levitation), equilibrium)
    names = ("U_hat", "C_U_hat", "C_Y_hat", "beta_hat")
    values = (*known, believed_beta(levitation, equilibrium))
    return lower((p.g, p.beta_c, p.Y, p.y0, p.U), dict(zip(names, values, strict=True)))


def plant() -> Program:
    """Return the true equilibrium and its linearisation."""
    levitation = p.magnetic_levitation()
    local = linearise(levitation)
    voltage = levitation.equilibrium_voltage.subs(p.Y, p.y)
    return lower(
        (p.g, p.beta, p.y0, p.y),
        {
            "U": voltage,
            "C_U": local.C_U_rest.subs(p.U, voltage),
            "C_Y": local.C_Y_rest.subs(p.Y, p.y),
        },
    )


def beta() -> Program:
    """Return beta of the rig's mass and constants."""
    return lower((p.m, p.C, p.K), {"beta": p.magnetic_levitation().beta})


def path_voltage() -> Program:
    """Return the voltage that following the path needs."""
    levitation = p.magnetic_levitation()
    flat = flat_model(levitation, linearise(levitation))
    return lower((p.g, p.beta, p.y0, p.y, p.acc), {"u": flat.nonlinear_input})


def reference() -> Program:
    """Return the path and its derivatives."""
    gap, velocity, acceleration = paths.rest_to_rest(paths.bezier_step())
    inputs = (p.t, paths.start_gap, paths.end_gap, paths.start_time, paths.end_time)
    return lower(inputs, {"y_ref": gap, "v_ref": velocity, "acc_ref": acceleration})


def peak() -> Program:
    """Return the largest acceleration of a move."""
    inputs = (paths.start_gap, paths.end_gap, paths.start_time, paths.end_time)
    return lower(inputs, {"peak": paths.peak_acceleration(paths.bezier_step())})


def acceleration() -> Program:
    """Return the acceleration of the plant."""
    levitation = p.magnetic_levitation()
    return lower((p.g, p.beta, p.y0, p.y, p.u), {"acc": levitation.acceleration})


def routh(controller: Controller) -> Program:
    """Return the continuous loop's polynomial and its Routh array, row by row."""
    polynomial = stability.closed_loop_polynomial(law(controller))
    letters = [sp.Symbol(f"a{n}") for n in range(len(polynomial) - 1, -1, -1)]
    outputs: dict[str, sp.Expr] = {s.name: s for s in letters}
    for power, row in zip(range(len(letters) - 1, -1, -1), _array(letters), strict=True):
        outputs |= {f"row{power}_{n}": entry for n, entry in enumerate(row)}
    inputs = (p.rho, p.C_Y_true, p.C_Y_hat, *law(controller).gains)
    return lower(inputs, outputs, dict(zip(letters, polynomial, strict=True)))


def _array(letters: Sequence[sp.Symbol]) -> tuple[tuple[sp.Expr, ...], ...]:
    return stability.routh_array([sp.Integer(1), *letters[1:]])


def sampled_loop(method: Method, controller: Controller) -> Program:
    """Return the sampled open loop and what sensor noise does to the voltage."""
    own = law(controller)
    gain = sp.Symbol("loop_gain")
    loop = stability.sampled_loop(own, method, gain)
    inputs = (gain, p.C_U_hat, p.C_Y_hat, p.C_Y_true, p.T, stability.first_part, *own.gains)
    return lower(inputs, named(num=loop.numerator, den=loop.denominator, effort=loop.effort))


def metrics(crossing: bool) -> Program:
    """Return the increments of the metrics over one step."""
    steps = quadratures.increments(crossing=crossing)
    inputs = (
        quadratures.e_start,
        quadratures.e_end,
        quadratures.slope_start,
        quadratures.slope_end,
        quadratures.t_start,
        quadratures.h,
    )
    outputs = {"ise": steps.ise, "iae": steps.iae, "itae": steps.itae}
    return lower(inputs, outputs, steps.definitions)


def coil() -> Program:
    """Return the rate of the emulated coil."""
    return lower((p.u_coil, p.u, p.L, p.R), {"rate": p.magnetic_levitation().coil_rate})


def step(method: Method, controller: Controller) -> Program:
    """Return the sampled law's step."""
    own = equation(method, controller)
    states = own.law.states
    inputs = [*states, *own.signals, *_FIXED, *own.coefficients]
    outputs = {f"{s.name}_next": x for s, x in zip(states, own.next_states, strict=True)}
    outputs |= {"commanded": sampling.commanded, "applied": own.applied}
    return lower(inputs, outputs, {sampling.commanded: own.commanded})


def bumpless(method: Method, controller: Controller) -> Program:
    """Return the states that command a given voltage."""
    own = equation(method, controller)
    inputs = [*own.signals, p.u, *_FIXED, *own.coefficients]
    start = sampling.bumpless_start(own)
    return lower(inputs, {x.name: s for x, s in zip(own.law.states, start, strict=True)})


def feedforward(method: Method, controller: Controller) -> Program:
    """Return the clamped voltage at w = 0."""
    own = equation(method, controller)
    inputs = [p.y_ref, p.acc_ref, *_FIXED, *own.coefficients]
    return lower(inputs, {"applied": sampling.clamp(own.feedforward)})


def start(controller: Controller) -> Program:
    """Return the law's states before the first sample."""
    own = law(controller)
    inputs = [*sampling.signals(own), p.Y, *own.gains]
    return lower(inputs, {x.name: s for x, s in zip(own.states, own.start, strict=True)})


def continuous(controller: Controller) -> Program:
    """Return the continuous law's rates and command."""
    own = law(controller)
    rates, command = sampling.continuous_equation(own)
    read = command.free_symbols | rates[0].free_symbols
    inputs = [
        *own.states,
        *sampling.signals(own),
        *_FIXED,
        p.C_U_hat,
        p.C_Y_hat,
        *[x for x in (p.beta_c, p.g, p.y0) if x in read],
        *own.gains,
    ]
    outputs = {
        f"{state.name}_rate": stability.believed(rate)
        for state, rate in zip(own.states, rates, strict=True)
    }
    outputs["commanded"] = sampling.commanded
    return lower(inputs, outputs, {sampling.commanded: stability.believed(command)})


def hurwitz(controller: Controller) -> Program:
    """Return the Routh-Hurwitz conditions, each divided by its value as designed."""
    own = law(controller)
    inputs = (p.rho, p.C_Y_true, p.C_Y_hat, *own.gains)
    return lower(inputs, named(share=stability.hurwitz_shares(own)))


def named(**groups: Sequence[sp.Expr]) -> dict[str, sp.Expr]:
    """Return the entries of groups by the name of the group and their number."""
    return {f"{name}{n}": x for name, group in groups.items() for n, x in enumerate(group)}
