"""The nonlinear loop around its rest in exact numbers: what the region's proof is about.

The continuous loop that runs (:func:`maglev_design.symbolic.sampling.continuous_equation`, guards
included) regulates at the gap r. On a plant whose voltage at rest is u_eq it is, in the deviations
z = (e, q, v, x_2, ...) from that rest, e = y - r, q = u - u_eq before the clamp, v = y',

    z' = A z + b phi,    phi = (acceleration of the plant) at r + e under clamp(u_eq + q),

b the unit vector of v. The law's integrator is replaced by q, of which it is an affine function;
while the clamp's anti-windup freezes it, A is another matrix. Nothing else switches: the bound of
the integrator is kept out of the region. The states of the law start at zero, hence at

    z(0) = (e_0, k e_0 + U_r - u_eq, v_0, 0, ...),

U_r the feedforward at r and k = du/de: under mismatch the start is offset along q.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any

import sympy as sp
from flint import fmpq, fmpq_mat
from sympy import Matrix, Rational, Symbol

from maglev_design import programs
from maglev_design.certification.intervals.arithmetic import exact
from maglev_design.certification.numbers import as_run
from maglev_design.controller.design import Design
from maglev_design.errors import InputError
from maglev_design.lowering import Program, lower
from maglev_design.rig import Rig
from maglev_design.simulation.grid import contact_gap
from maglev_design.symbolic import laws, sampling, stability
from maglev_design.symbolic import plant as p

E_ROW, Q_ROW, V_ROW = 0, 1, 2
"""Places of e, q and v in z."""
PRECISION = 2**48
"""Bounds of square roots are multiples of the root's size over this."""

q = Symbol("q", real=True)
x = Symbol("x", real=True)
"""Gap error over r + y0."""
share = Symbol("share", real=True)
"""Applied voltage over the voltage at rest."""


@dataclass(frozen=True)
class StateLimit:
    """A linear function of z that must stay within +-margin in the region.

    Attributes
    ----------
    name : str
    row : tuple of fmpq, shape (n,)
    margin : fmpq
        In the unit of ``row z``.
    """

    name: str
    row: tuple[fmpq, ...]
    margin: fmpq


@dataclass(frozen=True)
class Deviation:
    """The loop in deviations z from its rest, every number exact.

    Attributes
    ----------
    running, frozen : fmpq_mat, shape (n, n)
        A while the integrator runs and while anti-windup freezes it.
    names : tuple of str
        Of the entries of z; SI units.
    gap, offset, gravity : fmpq
        r [m], y0 [m] and g [m/s^2].
    rest : tuple of fmpq
        Interval of u_eq [V]; it contains the true value for every ratio of the claim.
    actuator : tuple of fmpq
        Range of the clamp [V], from zero or more; its upper end is None where it has none.
    feedforward, slope : fmpq
        U_r [V] and k = du/de [V/m].
    limits : tuple of StateLimit
        What the region has to respect besides V' < 0.
    """

    running: fmpq_mat
    frozen: fmpq_mat
    names: tuple[str, ...]
    gap: fmpq
    offset: fmpq
    gravity: fmpq
    rest: tuple[fmpq, fmpq]
    actuator: tuple[fmpq, fmpq | None]
    feedforward: fmpq
    slope: fmpq
    limits: tuple[StateLimit, ...]

    @property
    def order(self) -> int:
        """Number n of states."""
        return len(self.names)

    @property
    def distance(self) -> fmpq:
        """Unit r + y0 of e in the force [m]."""
        return self.gap + self.offset

    def start(self, e: Any, v: Any, rest: Any) -> list[Any]:
        """Return z(0) for the errors e [m] and v [m/s], the law's states at zero."""
        others = [0 * e] * (self.order - 3)
        return [e, self.slope * e + (self.feedforward - rest), v, *others]


@cache
def force_program() -> Program:
    """Return the program (x, share) -> phi/g and its derivatives by x and by share.

    The plant (4) at y + y0 = (r + y0)(1 + x) with the beta that makes u_eq its voltage at rest at
    r, and u = share u_eq: phi/g = 1 - share^2/(1 + x)^2, in which nothing of the rig is left.
    """
    plant = p.magnetic_levitation()
    (beta,) = sp.solve(plant.acceleration.subs({p.y: p.Y, p.u: p.U}), p.beta)
    moved = {p.y: (p.Y + p.y0) * (1 + x) - p.y0, p.u: share * p.U, p.beta: sp.factor(beta)}
    force = sp.expand_mul(plant.acceleration.subs(moved) / p.g)
    outputs = {"phi": force, "phi_x": sp.diff(force, x), "phi_share": sp.diff(force, share)}
    return lower((x, share), outputs)


def deviation(
    rig: Rig,
    design: Design,
    ratios: tuple[Fraction, Fraction],
    gap: float | None = None,
) -> Deviation:
    """Return the loop of `design` on `rig`, regulating at `gap`, around its rest.

    Parameters
    ----------
    rig : Rig
    design : Design
        A law that adds its correction to a voltage and reads the gap alone: TAN-GPI, or a linear
        PID.
    ratios : tuple of Fraction
        Interval of beta_c/beta; the plant moves, the controller stays.
    gap : float, optional
        r [m]; default: the start of the rig's reference.

    Raises
    ------
    InputError
        For another law, or a gap, or a voltage at rest, outside the rig's limits.
    """
    gap = rig.reference.start_gap if gap is None else gap
    law = programs.law(design.controller)
    numbers = as_run(rig, design, Fraction)
    here = {p.y_ref: Rational(gap), p.acc_ref: 0, p.y: Rational(gap) + p.e}

    def evaluated(expression: sp.Expr) -> sp.Expr:
        return sp.expand(stability.believed(expression).subs(here).subs(numbers))

    rates, command = sampling.continuous_equation(law)
    flows = [evaluated(_running(rate)) for rate in rates]
    voltage = evaluated(command)
    states = (p.e, *law.states)
    slopes = {x: sp.diff(voltage, x) for x in states}
    feedforward = voltage.subs(dict.fromkeys(states, 0))
    if not _treatable(law, voltage, slopes, flows):
        raise InputError(
            f"controller = {design.controller.name}: the guaranteed region is for laws that start "
            "at zero and add a linear correction of the gap's error to a voltage: tan-gpi"
        )
    integrator, *others = law.states
    z = (p.e, q, p.v, *others)
    (own,) = sp.solve(q - sum(k * x for x, k in slopes.items()), integrator)
    rest = _voltages_at_rest(rig, design.believed.beta, ratios, gap)
    found = Deviation(
        running=_linear_part(z, slopes, flows, {integrator: own}),
        frozen=_linear_part(z, slopes, [sp.Integer(0), *flows[1:]], {integrator: own}),
        names=tuple(x.name for x in z),
        gap=exact(gap),
        offset=exact(rig.plant.gap_offset),
        gravity=exact(rig.plant.gravity),
        rest=rest,
        actuator=(exact(rig.limits.voltage[0]), _finite(rig.limits.voltage[1])),
        feedforward=exact(feedforward),
        slope=exact(slopes[p.e]),
        limits=(),
    )
    share_of_w = [exact(sp.diff(sp.expand(slopes[integrator] * own), x)) for x in z]
    return replace(found, limits=tuple(_limits(found, rig, share_of_w)))


def _running(rate: sp.Expr) -> sp.Expr:
    """Return a state's rate where no guard holds it."""
    return rate.args[-1][0] if isinstance(rate, sp.Piecewise) else rate


def _treatable(
    law: laws.ControlLaw, voltage: sp.Expr, slopes: Mapping[Symbol, sp.Expr], flows: list[sp.Expr]
) -> bool:
    """Return whether the law is an integrator of e, lags, a linear command, and starts at zero."""
    at_rest = dict.fromkeys(slopes, 0)
    linear = all(k.is_Rational for k in slopes.values()) and voltage.free_symbols <= set(slopes)
    quiet = all(flow.free_symbols <= set(slopes) and flow.subs(at_rest) == 0 for flow in flows)
    alone = law.integrators == (0,) and flows[0] == p.e and set(law.start) == {sp.Integer(0)}
    return bool(linear and quiet and alone and slopes[law.states[0]] > 0)


def _linear_part(
    z: tuple[Symbol, ...],
    slopes: Mapping[Symbol, sp.Expr],
    flows: list[sp.Expr],
    known: Mapping[Symbol, sp.Expr],
) -> fmpq_mat:
    """Return the Jacobian of z' without the force, the integrator expressed in z."""
    moving = dict(zip(list(slopes)[1:], flows, strict=True))
    by_q = slopes[p.e] * p.v + sum(slopes[x] * flow for x, flow in moving.items())
    others = [moving[x] for x in z[3:]]
    rows = [p.v, by_q, sp.Integer(0), *others]
    slope = Matrix([row.subs(known) for row in rows]).jacobian(z)
    return fmpq_mat(len(z), len(z), [exact(entry) for entry in slope])


def _voltages_at_rest(
    rig: Rig, beta_c: float, ratios: tuple[Fraction, Fraction], gap: float
) -> tuple[fmpq, fmpq]:
    """Return bounds of the plant's voltage at rest at `gap` over the ratios, a little apart."""
    plant = p.magnetic_levitation()
    known = {p.g: rig.plant.gravity, p.y0: rig.plant.gap_offset, p.Y: gap}
    nominal = {x: Rational(value) for x, value in known.items()}
    beta = Rational(beta_c)

    def square(ratio: Fraction) -> fmpq:
        moved = beta / Rational(ratio)
        return exact((plant.equilibrium_voltage**2).subs({p.beta: moved}).subs(nominal))

    unit = fmpq(1, PRECISION)  # wider than what rounding does to beta in a simulation
    return root_below(square(min(ratios))) - unit, root_above(square(max(ratios))) + unit


def _limits(model: Deviation, rig: Rig, integral: list[fmpq]) -> Iterator[StateLimit]:
    """Yield what the region has to respect; raise where the rest itself does not."""
    low, high = model.actuator
    if model.rest[0] <= low or (high is not None and model.rest[1] >= high):
        raise InputError(
            f"limits.voltage = {list(rig.limits.voltage)} V: rest at {float(model.gap):.4g} m "
            f"needs {float(model.rest[0]):.4g} to {float(model.rest[1]):.4g} V over the ratios; "
            "allowed is a range with these in its interior"
        )
    near, far = exact(contact_gap(rig)), _finite(rig.limits.gap[1])
    room = [model.gap - near] + ([] if far is None else [far - model.gap])
    if min(room) <= 0:
        raise InputError(
            f"limits.gap = {list(rig.limits.gap)} m: the gap of the rest, {float(model.gap):.4g} "
            "m, must lie inside"
        )
    yield StateLimit("gap", tuple(fmpq(int(n == E_ROW)) for n in range(model.order)), min(room))
    if high is not None:
        taken = max(abs(rest - model.feedforward) for rest in model.rest)
        yield StateLimit("integrator bound", tuple(integral), high - low - taken)


def _finite(bound: float) -> fmpq | None:
    return exact(bound) if math.isfinite(bound) else None


def root_below(square: fmpq) -> fmpq:
    """Return a fraction at most sqrt(square) and less than 1/PRECISION away."""
    return fmpq((square * PRECISION**2).floor().isqrt(), PRECISION)


def root_above(square: fmpq) -> fmpq:
    """Return a fraction above sqrt(square) and at most 1/PRECISION away."""
    return root_below(square) + fmpq(1, PRECISION)
