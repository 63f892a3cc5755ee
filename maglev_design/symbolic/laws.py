"""The control laws: gains by coefficient matching, and the one law that is run and exported.

A law is a linear core from the error e = y - y* to a voltage correction w, a static map from w
and the reference to the commanded voltage, the actuator's clamp, an anti-windup rule and the
bounds of its integrators. Simulation, tuning and export lower these same expressions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.choices import Method
from maglev_design.symbolic import plant as p

w = Symbol("w", real=True)
"""[V] Output of a law's linear core: the voltage on top of the feedforward."""
u_min, u_max = Symbol("u_min", real=True), Symbol("u_max", real=True)
commanded, applied = Symbol("u_cmd", real=True), Symbol("u_app", real=True)


def gain_symbols(order: int) -> tuple[Symbol, ...]:
    """Return (k_0, ..., k_{order-1}), the letters of (16) and (23) for any order."""
    return tuple(sp.Symbol(f"k{index}", positive=True) for index in range(order))


def match_coefficients(desired: Expr, order: int) -> tuple[Expr, ...]:
    """Return the gains (k_0, ..., k_{order-1}) that place the poles, eqs. (24)-(25) for any order.

    Equates s^n + k_{n-1} s^{n-1} + ... + k_0 with the monic polynomial `desired` in s.

    Raises
    ------
    ValueError
        When `desired` is not monic of that order.

    Examples
    --------
    >>> from maglev_design.symbolic.plant import s, zeta, omega_n
    >>> match_coefficients((s**2 + 2 * zeta * omega_n * s + omega_n**2) ** 2, 4)[3]
    4*omega_n*zeta
    """
    polynomial = sp.Poly(sp.expand(desired), p.s)
    if polynomial.degree() != order or polynomial.LC() != 1:
        raise ValueError(f"the desired polynomial must be monic of order {order} in s")
    unknown = gain_symbols(order)
    closed_loop = p.s**order + sum(k * p.s**index for index, k in enumerate(unknown))
    difference = sp.Poly(sp.expand(closed_loop) - polynomial.as_expr(), p.s)
    equations = [difference.coeff_monomial(p.s**index) for index in range(order)]
    ((*values,),) = sp.linsolve(equations, unknown)
    return tuple(sp.factor(value) for value in values)


def pole_pairs_polynomial(pairs: Sequence[tuple[Expr, Expr]]) -> Expr:
    """Return prod (s^2 + 2 zeta_i omega_i s + omega_i^2), eq. (24) with an `s` restored."""
    return sp.Mul(*[p.s**2 + 2 * damping * speed * p.s + speed**2 for damping, speed in pairs])


def gpi_transfer(gains: Sequence[Expr]) -> Expr:
    """Return G(s) with u_delta - u*_delta = (1/C_U) G(s) e, the law (20) for any order n >= 3.

    ``gains`` is (k_0, ..., k_{n-1}). The law as printed is solved for C_U (u_delta - u*_delta)
    in Laplace's variable, its velocity estimate (18) inserted; n = 4 gives

        G = ((k2 + C_Y) s^2 + (k1 + k3 C_Y) s + k0)/(s (s + k3)).
    """
    order = len(gains)
    effort = Symbol("effort")
    reconstructed = (-effort + p.C_Y * p.e) / p.s
    integrals = sum(gains[order - 2 - n] * p.e / p.s**n for n in range(1, order - 1))
    law = effort - (gains[order - 1] * reconstructed + (gains[order - 2] + p.C_Y) * p.e + integrals)
    (solution,) = sp.solve(law, effort)
    return sp.factor(sp.together(solution / p.e))


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B e, w = C x + D e (continuous) or its difference equation (sampled)."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix

    def transfer(self, variable: Symbol) -> Expr:
        """Return C (variable I - A)^-1 B + D."""
        order = self.A.shape[0]
        resolvent = (variable * sp.eye(order) - self.A).inv()
        return sp.factor((self.C * resolvent * self.B + self.D)[0])


@dataclass(frozen=True)
class ControlLaw:
    """One controller, symbolic and complete.

    Attributes
    ----------
    name : str
        As on the command line.
    states : tuple of Symbol
        Controller states; all start at zero.
    core : StateSpace
        From e [m] to w [V], in the gains and the believed coefficients.
    feedforward : Expr
        Voltage [V] commanded at e = 0 with the states at zero, in y*, y*'', Y, U and the
        believed coefficients.
    integrators : tuple of int
        Positions of the states that integrate. Each is frozen while the clamp is active and the
        step would push the command further out, and bounded so that its own share of the voltage
        never exceeds the actuator's range u_max - u_min.
    gains : tuple of Symbol
        (k_0, ..., k_{n-1}).
    """

    name: str
    states: tuple[Symbol, ...]
    core: StateSpace
    feedforward: Expr
    integrators: tuple[int, ...]
    gains: tuple[Symbol, ...]


def tan_gpi() -> ControlLaw:
    """Return the TAN-GPI law (20) in its bounded two-state realisation.

    The partial fractions of G(s) give an integrator and a lag at -k3, both bounded in closed
    loop, where (20) as printed carries two hidden integrators that grow for ever:

        x1' = e,  x2' = -k3 x2 + e,
        w = (1/C_U) ((k2 + C_Y) e + (k0/k3) x1 + (k1 - k2 k3 - k0/k3) x2).
    """
    transfer = gpi_transfer((p.k0, p.k1, p.k2, p.k3))
    through = sp.limit(transfer, p.s, sp.oo)
    integral = sp.limit(p.s * transfer, p.s, 0)
    lag = sp.factor(sp.cancel((p.s + p.k3) * transfer).subs(p.s, -p.k3))
    core = StateSpace(
        A=Matrix([[0, 0], [0, -p.k3]]),
        B=Matrix([1, 1]),
        C=Matrix([[integral, lag]]) / p.C_U,
        D=Matrix([[through]]) / p.C_U,
    )
    return ControlLaw(
        name="tan-gpi",
        states=sp.symbols("x1 x2", real=True),
        core=core,
        feedforward=p.U + reference_voltage(),
        integrators=(0,),
        gains=(p.k0, p.k1, p.k2, p.k3),
    )


def reference_voltage() -> Expr:
    """Return u*_delta = -(1/C_U) (y*'' - C_Y (y* - Y)) [V], second line of (20)."""
    return (-p.acc_ref + p.C_Y * (p.y_ref - p.Y)) / p.C_U


def discretise(core: StateSpace, method: Method) -> StateSpace:
    """Return the difference equation of a core at the sampling period T.

    ``euler`` is forward (s = (z - 1)/T), ``tustin`` bilinear (s = 2 (z - 1)/(T (z + 1))), ``zoh``
    step-invariant (exact for an error held over the period).
    """
    order = core.A.shape[0]
    unit = sp.eye(order)
    if method == "euler":
        sampled = StateSpace(unit + core.A * p.T, core.B * p.T, core.C, core.D)
    elif method == "tustin":
        half = (unit - core.A * p.T / 2).inv()
        through = core.D + core.C * half * core.B * p.T / 2
        sampled = StateSpace(
            half * (unit + core.A * p.T / 2), half * core.B * p.T, core.C * half, through
        )
    else:
        block = Matrix.vstack(Matrix.hstack(core.A, core.B), sp.zeros(1, order + 1))
        held = (block * p.T).exp()
        sampled = StateSpace(held[:order, :order], held[:order, order:], core.C, core.D)
    simple = [m.applyfunc(sp.factor) for m in (sampled.A, sampled.B, sampled.C, sampled.D)]
    return StateSpace(*simple)


@dataclass(frozen=True)
class DifferenceEquation:
    """A sampled law as it is run: one step from one sample to the next, in named coefficients.

    Attributes
    ----------
    law : ControlLaw
    next_states : tuple of Expr
        States at the next sample.
    commanded, applied : Expr
        Voltage before and after the clamp.
    coefficients : mapping of Symbol to Expr
        What the step's coefficients are in the gains, the believed C_U and C_Y, and T. The
        limits u_min, u_max, and Y and U are arguments of the step as they are.
    feedforward : Expr
        Voltage at e = 0 and zero states, in the step's coefficients.
    """

    law: ControlLaw
    next_states: tuple[Expr, ...]
    commanded: Expr
    applied: Expr
    coefficients: Mapping[Symbol, Expr]
    feedforward: Expr


def difference_equation(law: ControlLaw, method: Method) -> DifferenceEquation:
    """Return the step of `law` under `method`: read y, y*, y*''; clamp; update the states.

    The structure does not depend on the gains; the numbers do, through ``coefficients``. An entry
    that is 0 or 1 whatever the gains stays a number.
    """
    sampled = discretise(law.core, method)
    coefficients: dict[Symbol, Expr] = {}

    def name(prefix: str, entry: Expr) -> Expr:
        if entry.is_Integer:
            return entry
        symbol = Symbol(prefix, real=True)
        coefficients[symbol] = entry
        return symbol

    order = len(law.states)
    a = Matrix(order, order, lambda r, c: name(f"a{r + 1}{c + 1}", sampled.A[r, c]))
    b = Matrix(order, 1, lambda r, _: name(f"b{r + 1}", sampled.B[r]))
    c = Matrix(1, order, lambda _, col: name(f"c{col + 1}", sampled.C[col]))
    d = name("d", sampled.D[0])
    offset = sp.diff(law.feedforward, p.y_ref)
    push = sp.diff(law.feedforward, p.acc_ref)
    feedforward = p.U + name("f_y", offset) * (p.y_ref - p.Y) + name("f_a", push) * p.acc_ref

    error = p.y - p.y_ref
    states = Matrix(law.states)
    command = feedforward + (c * states)[0] + d * error
    clamped = sp.Min(sp.Max(commanded, u_min), u_max)
    moved = a * states + b * error
    following = [
        _guarded_integrator(law.states[n], moved[n], c[n], name(f"x{n + 1}_max", bound))
        if n in law.integrators
        else moved[n]
        for n, bound in enumerate(_integrator_bounds(sampled.C))
    ]
    return DifferenceEquation(law, tuple(following), command, clamped, coefficients, feedforward)


def _integrator_bounds(gains: Matrix) -> list[Expr]:
    """Return for each state the value at which its share of the voltage is u_max - u_min."""
    return [sp.factor((u_max - u_min) / gain) for gain in gains]


def _guarded_integrator(state: Symbol, moved: Expr, gain: Expr, bound: Symbol) -> Expr:
    """Return the next value of an integrator: frozen while it pushes into the clamp, bounded."""
    step = gain * (moved - state)
    outward = sp.Or(sp.And(commanded > u_max, step > 0), sp.And(commanded < u_min, step < 0))
    return sp.Piecewise((state, outward), (sp.Min(sp.Max(moved, -bound), bound), True))


def continuous_equation(law: ControlLaw) -> tuple[tuple[Expr, ...], Expr]:
    """Return (state derivatives, commanded voltage) of the continuous law, guards included.

    In y, y*, y*'', the states, the gains and the believed coefficients; ``u_cmd`` stands for the
    commanded voltage inside the derivatives.
    """
    error = p.y - p.y_ref
    states = Matrix(law.states)
    command = law.feedforward + (law.core.C * states)[0] + law.core.D[0] * error
    rates = law.core.A * states + law.core.B * error
    guarded = []
    for n, bound in enumerate(_integrator_bounds(law.core.C)):
        if n not in law.integrators:
            guarded.append(rates[n])
            continue
        push = law.core.C[n] * rates[n]
        outward = sp.Or(
            sp.And(commanded > u_max, push > 0),
            sp.And(commanded < u_min, push < 0),
            sp.And(law.states[n] > bound, rates[n] > 0),
            sp.And(law.states[n] < -bound, rates[n] < 0),
        )
        guarded.append(sp.Piecewise((sp.Integer(0), outward), (rates[n], True)))
    return tuple(guarded), command
