"""Every program as it is lowered from the symbolic statement; the only place that does so.

Inputs and outputs of each are described where it is fetched: :mod:`maglev_design.programs`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache

import sympy as sp

from maglev_design.lowering import Program, lower
from maglev_design.options import PAPER_PLANT, Controller, Equilibrium, Method, PlantKind
from maglev_design.symbolic import gpi, laws, sampling, stability
from maglev_design.symbolic import metrics as quadratures
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as paths
from maglev_design.symbolic.flatness import flat_model, path_input
from maglev_design.symbolic.linearisation import (
    believed_beta,
    believed_coefficients,
    believed_drive,
    linearise,
    tangent_at_rest,
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
    if order == 3:
        desired = gpi.pole_pairs_polynomial([first]) * (p.s + p.omega_2)
    else:  # the second pair as often as the order asks for
        desired = gpi.pole_pairs_polynomial([first, *[second] * (order // 2 - 1)])
    matched = gpi.match_coefficients(desired, order)
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


HATS = (p.C_U_hat, p.C_Y_hat, p.delta_hat, p.tau_hat, p.kappa_hat, *laws.STATIC)
"""Of these a law's coefficients are made where it is one for a plant other than the paper's."""


def _hats(expressions: Iterable[sp.Expr]) -> list[sp.Symbol]:
    """Return C_U^, C_Y^ and which further coefficients of its plant a law reckons with."""
    used = {symbol for expression in expressions for symbol in expression.free_symbols}
    return [x for x in HATS if x in HATS[:2] or x in used]


def _believed(expressions: Mapping[sp.Symbol, sp.Expr]) -> dict[sp.Symbol, sp.Expr]:
    return {letter: stability.believed(x) for letter, x in expressions.items()}


def coefficients(method: Method, controller: Controller) -> Program:
    """Return the coefficients of the difference equation."""
    wanted = _believed(equation(method, controller).coefficients)
    own = law(controller)
    letters = _believed(own.definitions)
    every = (*wanted.values(), *letters.values())
    inputs = (*_hats(every), *_own_constants(every), p.T, laws.u_min, laws.u_max, *own.gains)
    return lower(inputs, {s.name: x for s, x in wanted.items()}, letters)


def sampled_core(method: Method, controller: Controller) -> Program:
    """Return the matrices of a law's sampled core in the coefficients of its step."""
    named_matrices, letters = core(method, controller)
    return lower(tuple(letters), _entries(named_matrices, law(controller)))


def continuous_core(controller: Controller) -> Program:
    """Return the matrices of a law's continuous core."""
    own = law(controller)
    letters = _believed(own.definitions)
    parts = _entries(own.core, own)
    wanted = {name: stability.believed(x) for name, x in parts.items()}
    every = (*wanted.values(), *letters.values())
    return lower((*_hats(every), *_own_constants(every), *own.gains), wanted, letters)


def _entries(matrices: laws.StateSpace, own: laws.ControlLaw) -> dict[str, sp.Expr]:
    """Return the entries of a core by name, row by row: A0, A1, ..., B0, ..., C0, ..., D0, ...

    R is what the law reads of gap and velocity, one row an input.
    """
    reads = [sp.diff(r, x) for r in own.inputs for x in (p.y, p.v)]
    return named(A=matrices.A, B=matrices.B, C=matrices.C, D=matrices.D, R=reads)


def slope(controller: Controller) -> Program:
    """Return the slope of the command in w, and the believed loop gain."""
    own = law(controller)
    inputs = (p.u, p.y_ref, p.beta_c, p.y0, p.C_U_hat)
    return lower(inputs, {"slope": own.slope, "loop_gain": stability.believed(own.loop_gain)})


def believed(equilibrium: Equilibrium, kind: PlantKind) -> Program:
    """Return what a controller believes under a reading of the equilibrium."""
    levitation = p.magnetic_levitation(kind)
    known = believed_coefficients(levitation, linearise(levitation), equilibrium)
    held, c_u, c_y = known
    values = {
        "U_hat": held,
        "C_U_hat": c_u,
        "C_Y_hat": c_y,
        "beta_hat": believed_beta(levitation, equilibrium),
    }
    if kind.order > 2 or kind.damped:
        own = held - p.u0 if kind.offset else held
        drive = believed_drive(levitation, c_u, own)
        values |= dict(zip(("delta_hat", "tau_hat", "kappa_hat"), drive, strict=True))
    return lower((p.g, p.beta_c, p.Y, p.y0, p.U, *_extras(levitation)), values)


def _extras(levitation: p.Plant) -> list[sp.Symbol]:
    """Return the plant's further numbers, but for the gap Y of the design, which is asked for."""
    return [x for x in levitation.extras if x != p.Y]


def plant(kind: PlantKind) -> Program:
    """Return the true equilibrium and the two coefficients of its linearisation."""
    levitation = p.magnetic_levitation(kind)
    local = linearise(levitation)
    voltage = levitation.equilibrium_voltage.subs(p.Y, p.y)
    return lower(
        (p.g, p.beta, p.y0, p.y, *levitation.extras),
        {
            "U": voltage,
            "C_U": local.C_U_rest.subs(p.U, voltage).subs(p.Y, p.y),
            "C_Y": local.C_Y_rest.subs(p.Y, p.y),
        },
    )


def tangent(kind: PlantKind) -> Program:
    """Return A and B of the plant at rest at a gap."""
    levitation = p.magnetic_levitation(kind)
    local = tangent_at_rest(levitation)
    return lower((p.g, p.beta, p.y0, p.y, *levitation.extras), named(A=local.A, B=local.B))


def beta(kind: PlantKind) -> Program:
    """Return beta of the rig's mass and constants."""
    return lower((p.m, p.C, p.K), {"beta": p.magnetic_levitation(kind).beta})


def path_voltage(kind: PlantKind) -> Program:
    """Return the voltage that following the path needs."""
    levitation = p.magnetic_levitation(kind)
    if kind == PAPER_PLANT:
        needed = flat_model(levitation, linearise(levitation)).nonlinear_input
        return lower((p.g, p.beta, p.y0, p.y, p.acc), {"u": needed})
    inputs = [p.g, p.beta, p.y0, p.y, p.v, p.acc, *levitation.extras]
    inputs += [p.jerk_ref] * (kind.order > 2)
    return lower(inputs, {"u": path_input(levitation)})


def static_series(kind: PlantKind) -> Program:
    """Return the power series of the static voltage around Y."""
    levitation = p.magnetic_levitation(kind)
    held, terms, factorial = levitation.equilibrium_voltage, {}, 1
    for n, letter in enumerate(laws.STATIC, 1):
        held, factorial = sp.diff(held, p.Y), factorial * n
        terms[letter.name] = sp.simplify(held) / factorial
    return lower((p.g, p.beta, p.y0, p.Y, *_extras(levitation)), terms)


def reference(derivatives: int) -> Program:
    """Return the path and its derivatives."""
    rows = paths.rest_to_rest(paths.bezier_step(), derivatives)
    inputs = (p.t, paths.start_gap, paths.end_gap, paths.start_time, paths.end_time)
    names = ("y_ref", "v_ref", "acc_ref", "jerk_ref")
    return lower(inputs, dict(zip(names, rows, strict=False)))


def peak() -> Program:
    """Return the largest acceleration of a move."""
    inputs = (paths.start_gap, paths.end_gap, paths.start_time, paths.end_time)
    return lower(inputs, {"peak": paths.peak_acceleration(paths.bezier_step())})


def acceleration(kind: PlantKind) -> Program:
    """Return the acceleration of the plant."""
    levitation = p.magnetic_levitation(kind)
    inputs = [p.g, p.beta, p.y0, p.y, p.u, *levitation.extras]
    inputs += [p.v] * kind.damped
    return lower(inputs, {"acc": levitation.acceleration})


def routh(controller: Controller) -> Program:
    """Return the continuous loop's polynomial and its Routh array, row by row."""
    polynomial = stability.closed_loop_polynomial(law(controller))
    letters = [sp.Symbol(f"a{n}") for n in range(len(polynomial) - 1, -1, -1)]
    outputs: dict[str, sp.Expr] = {s.name: s for s in letters}
    for power, row in zip(range(len(letters) - 1, -1, -1), _array(letters), strict=True):
        outputs |= {f"row{power}_{n}": entry for n, entry in enumerate(row)}
    inputs = (p.rho, p.C_Y_true, p.C_Y_hat, *law(controller).gains)
    return lower(inputs, outputs, dict(zip(letters, polynomial, strict=True)))


def _array(letters: list[sp.Symbol]) -> tuple[tuple[sp.Expr, ...], ...]:
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


def drive(kind: PlantKind) -> Program:
    """Return the rate of the drive's state."""
    levitation = p.magnetic_levitation(kind)
    inputs = [p.u_coil, p.u]
    if kind.actuation == "coil":
        inputs += [p.y, p.v, p.beta, p.y0]
    return lower((*inputs, *levitation.extras), {"rate": levitation.drive_rate})


def inductance(kind: PlantKind) -> Program:
    """Return the inductance of the coil."""
    levitation = p.magnetic_levitation(kind)
    inputs = (p.y, p.beta, p.y0, *levitation.extras)
    return lower(inputs, {"inductance": levitation.inductance})


def conditions(order: int) -> Program:
    """Return the first column of the Routh array of s^n + a_{n-1} s^(n-1) + ... + a_0."""
    letters = [sp.Symbol(f"a{n}") for n in range(order - 1, -1, -1)]
    rows = stability.routh_array([sp.Integer(1), *letters], simple=False)
    return lower(letters, named(condition=[row[0] for row in rows[1:]]))


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
    read = [x for x in own.signals if x not in (p.y, p.v)]
    if not controller.of_other_plant:
        read = [p.y_ref, p.acc_ref]
    inputs = [*read, *_FIXED, *own.coefficients]
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
    letters = _believed(own.definitions)
    every = [stability.believed(x) for x in (*rates, command)] + [*letters.values()]
    read = command.free_symbols | rates[0].free_symbols
    inputs = [
        *own.states,
        *sampling.signals(own),
        *_FIXED,
        *_hats(every),
        *[x for x in (p.beta_c, p.g, p.y0) if x in read],
        *own.gains,
    ]
    outputs = {
        f"{state.name}_rate": stability.believed(rate)
        for state, rate in zip(own.states, rates, strict=True)
    }
    outputs["commanded"] = sampling.commanded
    return lower(inputs, outputs, letters | {sampling.commanded: stability.believed(command)})


def hurwitz(controller: Controller) -> Program:
    """Return the Routh-Hurwitz conditions, each divided by its value as designed."""
    own = law(controller)
    inputs = (p.rho, p.C_Y_true, p.C_Y_hat, *own.gains)
    return lower(inputs, named(share=stability.hurwitz_shares(own)))


def named(**groups: Iterable[sp.Expr]) -> dict[str, sp.Expr]:
    """Return the entries of groups by the name of the group and their number."""
    return {f"{name}{n}": x for name, group in groups.items() for n, x in enumerate(group)}
