"""What runs: a law sampled or continuous, with its clamp, anti-windup and integrator bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.options import Method
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.laws import ControlLaw, StateSpace, u_max, u_min, w

commanded = Symbol("u_cmd", real=True)
SIGNALS = (p.y, p.v, p.y_ref, p.v_ref, p.acc_ref, p.jerk_ref)
"""What a law may read at a sample, in the order of its arguments."""


def discretise(core: StateSpace, method: Method) -> StateSpace:
    """Return the difference equation of a core at the sampling period T.

    ``euler`` is forward (s = (z - 1)/T), ``tustin`` bilinear (s = 2 (z - 1)/(T (z + 1))), ``zoh``
    step-invariant (exact for inputs held over the period).
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
    elif order > 2:
        return StateSpace(*_held_companion(core), core.C, core.D)
    else:
        width = core.B.shape[1]
        block = Matrix.vstack(Matrix.hstack(core.A, core.B), sp.zeros(width, order + width))
        held = (block * p.T).exp()
        sampled = StateSpace(held[:order, :order], held[:order, order:], core.C, core.D)
    simple = [m.applyfunc(sp.factor) for m in (sampled.A, sampled.B, sampled.C, sampled.D)]
    return StateSpace(*simple)


def _held_companion(core: StateSpace) -> tuple[Matrix, Matrix]:
    """Return A and B over a period of an integrator beside the companion form of s^2 - a s - b.

    With D = (a/2)^2 + b and r its root, exp(A t) = exp(a t/2) (cosh(r t) + (A - a/2) sinh(r t)/r),
    whose hyperbolic functions are those of the circle where D < 0.
    """
    a, b = core.A[1, 1], core.A[1, 2]
    companion = sp.diag(0, Matrix([[a, b], [1, 0]]))
    known = companion == core.A and Matrix([1, 1, 0]) == core.B
    if not known:
        raise ValueError("no step-invariant form of this core")
    half, bend = a / 2, (a / 2) ** 2 + b
    size = sp.sqrt(sp.Max(sp.Abs(bend), DOUBLE_ROOT * half**2))
    even = sp.Piecewise((sp.cosh(size * p.T), bend > 0), (sp.cos(size * p.T), True))
    odd = sp.Piecewise((sp.sinh(size * p.T), bend > 0), (sp.sin(size * p.T), True)) / size
    decay = sp.exp(half * p.T)
    held = Matrix(
        [[decay * (even + half * odd), decay * b * odd], [decay * odd, decay * (even - half * odd)]]
    )
    entered = Matrix([held[1, 0], (held[0, 0] - 1 - a * held[1, 0]) / b])
    return sp.diag(1, held), Matrix.vstack(Matrix([p.T]), entered)


DOUBLE_ROOT = sp.Rational(1, 2**40)
"""Share of (a/2)^2 below which two roots count as one: what it changes is less than that share."""


@dataclass(frozen=True)
class DifferenceEquation:
    """A sampled law as it is run: one step from one sample to the next, in named coefficients.

    Attributes
    ----------
    law : ControlLaw
    signals : tuple of Symbol
        What the step reads at a sample: y, y*, y*'' and, where the law uses them, y', y*', y*'''.
    next_states : tuple of Expr
        States at the next sample.
    commanded, applied : Expr
        Voltage before and after the clamp.
    coefficients : mapping of Symbol to Expr
        What the step's coefficients are in the gains, the believed coefficients, T, the
        limits and the letters of the law. The limits u_min, u_max, and Y and U are arguments of the
        step as they are.
    feedforward : Expr
        Voltage before the clamp at w = 0, in the step's coefficients.
    """

    law: ControlLaw
    signals: tuple[Symbol, ...]
    next_states: tuple[Expr, ...]
    commanded: Expr
    applied: Expr
    coefficients: Mapping[Symbol, Expr]
    feedforward: Expr


def signals(law: ControlLaw) -> tuple[Symbol, ...]:
    """Return what a law reads at a sample, in the order of its arguments."""
    used = {symbol for entry in (*law.inputs, law.command) for symbol in entry.free_symbols}
    always = (p.y, p.y_ref, p.acc_ref)
    return tuple(x for x in SIGNALS if x in always or x in used)


def clamp(voltage: Expr) -> Expr:
    """Return the voltage that the actuator makes of a commanded one."""
    return sp.Min(sp.Max(voltage, u_min), u_max)


def named_core(law: ControlLaw, method: Method) -> tuple[StateSpace, dict[Symbol, Expr]]:
    """Return the sampled core of `law` in the step's coefficients, and what these are.

    The structure does not depend on the gains; the numbers do. An entry that is 0 or 1 whatever the
    gains stays a number.
    """
    sampled = discretise(law.core, method)
    coefficients: dict[Symbol, Expr] = {}

    def name(prefix: str, entry: Expr) -> Expr:
        if entry.is_Integer:
            return entry
        symbol = Symbol(prefix, real=True)
        coefficients[symbol] = entry
        return symbol

    order, width = len(law.states), len(law.inputs)
    a = Matrix(order, order, lambda r, c: name(f"a{r + 1}{c + 1}", sampled.A[r, c]))
    b = Matrix(order, width, lambda r, n: name(f"b{r + 1}{_suffix(n)}", sampled.B[r, n]))
    c = Matrix(1, order, lambda _, col: name(f"c{col + 1}", sampled.C[col]))
    d = Matrix(1, width, lambda _, n: name(f"d{_suffix(n)}", sampled.D[n]))
    return StateSpace(a, b, c, d), coefficients


def difference_equation(law: ControlLaw, method: Method) -> DifferenceEquation:
    """Return the step of `law` under `method`: read the sample; clamp; update the states."""
    core, coefficients = named_core(law, method)
    coefficients |= {x: sp.factor(value) for x, value in law.constants.items()}

    states, read = Matrix(law.states), Matrix(law.inputs)
    # in this order of terms, because the exported code adds in it, too
    command = law.command.subs(w, (core.C * states)[0] + (core.D * read)[0])
    moved = core.A * states + core.B * read
    bounds = _integrator_bounds(law, core.C.subs(coefficients))
    limits = {n: Symbol(f"x{n + 1}_max", real=True) for n in law.integrators}
    coefficients |= {limit: bounds[n] for n, limit in limits.items()}
    following = [
        _guarded_integrator(law.states[n], moved[n], core.C[n], limits[n])
        if n in law.integrators
        else moved[n]
        for n in range(len(law.states))
    ]
    return DifferenceEquation(
        law,
        signals(law),
        tuple(following),
        command,
        clamp(commanded),
        coefficients,
        law.command.subs(w, 0),
    )


def bumpless_start(equation: DifferenceEquation) -> tuple[Expr, ...]:
    """Return the states from which the first command is a given voltage u.

    The states that do not integrate start where the first sample, if it stayed, would leave them;
    the integrator makes up the rest of the voltage, as far as its bound allows. In the signals,
    u, Y, U and the step's coefficients.

    Raises
    ------
    ValueError
        For a law without exactly one integrator, or whose command is not linear in it.
    """
    law = equation.law
    if len(law.integrators) != 1:
        raise ValueError(f"{law.controller.name}: one integrator is needed for a bumpless start")
    (n,) = law.integrators
    integrator = law.states[n]
    stay = {
        state: following - state
        for k, (state, following) in enumerate(zip(law.states, equation.next_states, strict=True))
        if k != n
    }
    (solved,) = sp.solve(list(stay.values()), list(stay), dict=True) if stay else ({},)
    rest = {state: sp.factor(solved[state]) for state in stay}
    gain = sp.diff(equation.commanded, integrator)
    if gain.free_symbols & {integrator, *equation.signals}:
        raise ValueError(f"{law.controller.name}: the command is not linear in its integrator")
    others = equation.commanded.subs({**rest, integrator: 0})
    bound = next(x for x in equation.coefficients if x.name == f"x{n + 1}_max")
    needed = sp.Min(sp.Max((p.u - others) / gain, -bound), bound)
    return tuple(needed if k == n else rest[state] for k, state in enumerate(law.states))


def _suffix(column: int) -> str:
    return f"_{column + 1}" if column else ""


def _integrator_bounds(law: ControlLaw, gains: Matrix) -> list[Expr]:
    """Return for each state the value at which its share of w is the law's span."""
    return [sp.factor(law.span / gain) for gain in gains]


def _guarded_integrator(state: Symbol, moved: Expr, gain: Expr, bound: Symbol) -> Expr:
    """Return the next value of an integrator: frozen while it pushes into the clamp, bounded."""
    step = gain * (moved - state)
    outward = sp.Or(sp.And(commanded > u_max, step > 0), sp.And(commanded < u_min, step < 0))
    return sp.Piecewise((state, outward), (sp.Min(sp.Max(moved, -bound), bound), True))


def continuous_equation(law: ControlLaw) -> tuple[tuple[Expr, ...], Expr]:
    """Return (state derivatives, commanded voltage) of the continuous law, guards included.

    In what the law reads, the states, the gains and the believed coefficients; ``u_cmd`` stands
    for the commanded voltage inside the derivatives.
    """
    states, read = Matrix(law.states), Matrix(law.inputs)
    correction = (law.core.C * states)[0] + (law.core.D * read)[0]
    command = law.command.subs(law.constants).subs(w, correction)
    rates = law.core.A * states + law.core.B * read
    guarded = []
    for n, bound in enumerate(_integrator_bounds(law, law.core.C)):
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
