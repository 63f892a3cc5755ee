"""The loop as a function of beta_c/beta and of the gap: what enters, and how.

The controller stays, the plant's beta is beta_c/r. Every polynomial of the loop is a *pencil*

    chi = fixed + rho (gain + C_Y^ gain_C_Y),

and r enters through rho and C_Y^ alone. With v = 1/rho(Y), what the controller takes the loop's
gain to be at Y over what it is, r = scale v^power with a rational scale, C_Y^ is affine in v, and
rho(y) = shape(y)/v: v chi is affine in v with rational coefficients, also where r itself enters by
its square root.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

from maglev_design.choices import Equilibrium, Method
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import stability
from maglev_design.symbolic.laws import ControlLaw
from maglev_design.symbolic.linearisation import (
    believed_beta,
    believed_coefficients,
    linearise,
)

ratio = Symbol("r", positive=True)
"""beta_c/beta [-]."""
quotient = Symbol("v", positive=True)
"""1/rho at Y [-]."""


@dataclass(frozen=True)
class Pencil:
    """The closed loop's polynomial, coefficients highest power first, of one length.

    Attributes
    ----------
    fixed, gain, gain_C_Y : tuple of Expr
        In chi = fixed + rho (gain + C_Y^ gain_C_Y): of C_Y' and the gains; sampled also of T and
        T_1. The first of `fixed` is 1, the first of the others 0.
    """

    fixed: tuple[Expr, ...]
    gain: tuple[Expr, ...]
    gain_C_Y: tuple[Expr, ...]


def continuous_pencil(law: ControlLaw) -> Pencil:
    """Return the continuous loop's polynomial in s as a pencil."""
    return _pencil(stability.closed_loop_polynomial(law))


def sampled_pencil(law: ControlLaw, method: Method, *, split: bool) -> Pencil:
    """Return the sampled loop's polynomial in z as a pencil, less whole periods of delay.

    Parameters
    ----------
    split : bool
        Whether the voltage changes inside a period (T_1 > 0); else T_1 = 0, and the pole at zero
        that stands for the earlier voltage is left out.
    """
    pulse = stability.sampled_law(law, method)
    loop_gain = stability.believed(law.loop_gain)
    numerator: list[Expr] = []
    denominator: list[Expr] = []
    outputs = (("gap", pulse.gap), ("velocity", pulse.velocity))
    for output, through in outputs:
        seen = stability.sampled_plant(output)  # type: ignore[arg-type]  # the two literals above
        above, below = list(seen.numerator), list(seen.denominator)
        if not split:
            above, below = ([c.subs(stability.first_part, 0) for c in x] for x in (above, below))
            if above.pop() != 0 or below.pop() != 0:
                raise ArithmeticError("the loop without delay keeps a pole that it does not have")
        part = _product(above, [loop_gain * c for c in through])
        numerator = [a + b for a, b in zip(numerator, part, strict=True)] if numerator else part
        denominator = _product(below, pulse.denominator)
    short = len(denominator) - len(numerator)
    scaled = [*([sp.Integer(0)] * short), *numerator]
    chi = [a + p.rho * sp.cancel(b) for a, b in zip(denominator, scaled, strict=True)]
    return _pencil(chi)


def _product(a: Sequence[Expr], b: Sequence[Expr]) -> list[Expr]:
    result: list[Expr] = [sp.Integer(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            result[i + j] += x * y
    return result


def _pencil(coefficients: Sequence[Expr]) -> Pencil:
    """Split polynomial coefficients by powers of rho and C_Y^; nothing else may be left."""
    parts: list[tuple[Expr, Expr, Expr]] = []
    for coefficient in coefficients:
        terms = sp.Poly(sp.expand(coefficient), p.rho, p.C_Y_hat).as_dict()
        if set(terms) - {(0, 0), (1, 0), (1, 1)} or coefficient.has(p.C_U_hat):
            raise ArithmeticError(f"not a pencil in rho and C_Y^: {coefficient}")
        zero = sp.Integer(0)
        parts.append((terms.get((0, 0), zero), terms.get((1, 0), zero), terms.get((1, 1), zero)))
    fixed, gain, gain_c_y = zip(*parts, strict=True)
    return Pencil(fixed, gain, gain_c_y)


@dataclass(frozen=True)
class Uncertainty:
    """How beta_c/beta enters a loop under one reading of the equilibrium.

    Attributes
    ----------
    shape : Expr
        rho(y) v, in y, Y and y0; 1 at Y.
    scale : Expr
        In r = scale v^power, in beta_c, g, Y, y0 and U; 1 where U is not measured.
    power : int
        1 or 2; 0 where the ratio does not enter, and then v = 1.
    C_Y_hat : Expr
        Affine in v.
    """

    shape: Expr
    scale: Expr
    power: int
    C_Y_hat: Expr


def uncertainty(law: ControlLaw, reading: Equilibrium, *, measured: bool) -> Uncertainty:
    """Return how beta_c/beta enters the loop of a law.

    Parameters
    ----------
    reading : {"model", "appendix-a", "measured"}
    measured : bool
        Whether the rig's file gives U; else "the true equilibrium voltage" is that of the plant,
        which moves with its beta.
    """
    plant = p.magnetic_levitation()
    lin = linearise(plant)
    own = {p.beta: p.beta_c / ratio}
    held = plant.equilibrium_voltage.subs(own)
    known = {} if measured else {p.U: held}
    _, c_u_hat, c_y_hat = (x.subs(known) for x in believed_coefficients(plant, lin, reading))
    beta_hat = believed_beta(plant, reading).subs(known)
    gap = Symbol("y", positive=True)
    voltage = held.subs(p.Y, gap)
    c_u = lin.C_U_rest.subs(p.U, held).subs(p.Y, gap)
    slope = law.slope.subs({p.u: voltage, p.y_ref: gap, p.beta_c: beta_hat})
    rho = c_u * slope / stability.believed(law.loop_gain).subs(p.C_U_hat, c_u_hat)
    rho = sp.simplify(sp.powdenest(rho, force=True))
    at_y = sp.powdenest(sp.expand_power_base(rho.subs(gap, p.Y), force=True), force=True)
    factor, exponent = sp.simplify(at_y**2).as_coeff_exponent(ratio)
    if exponent not in (0, -1, -2) or factor.has(ratio) or (exponent == 0 and factor != 1):
        raise ArithmeticError(f"rho^2 = {sp.simplify(at_y**2)} is no power of the ratio")
    # r^n = factor v^2 with n = -exponent
    power = {0: 0, -1: 2, -2: 1}[int(exponent)]
    scale = sp.Integer(1) if exponent == 0 else sp.sqrt(factor) if power == 1 else factor
    seen = sp.expand(sp.simplify(c_y_hat).subs(ratio, scale * quotient**power))
    if not sp.Poly(seen, quotient).degree() <= 1:
        raise ArithmeticError(f"C_Y^ = {seen} is not affine in v")
    shape = sp.simplify(rho / rho.subs(gap, p.Y)).subs(gap, p.y)
    return Uncertainty(shape, sp.simplify(scale), power, seen)


def stability_conditions(law: ControlLaw) -> tuple[Expr, ...]:
    """Return what must be positive for the continuous loop to be stable, constants left out.

    The Hurwitz determinants in rho, C_Y', C_Y^ and the gains, each without the factors of the
    ones before it.
    """
    found: list[Expr] = []
    for condition in stability.routh_hurwitz(stability.closed_loop_polynomial(law)):
        for known in found:
            shorter = sp.cancel(condition / known)
            condition = shorter if sp.fraction(shorter)[1] == 1 else condition
        found.append(sp.factor(condition))
    return tuple(found)


def largest_ratio(reading: Equilibrium, *, measured: bool, law: ControlLaw) -> Expr | None:
    """Return in closed form the beta_c/beta below which the TAN-GPI loop with (25) is stable.

    From rho (omega_n^2 + C_Y^) > C_Y' + omega_n^2/(4 zeta^2 + 1) with rho = shape/v: affine in v.
    None where no ratio enters; where the coefficient of v is not negative, every ratio is stable.
    """
    enters = uncertainty(law, reading, measured=measured)
    if enters.power == 0:
        return None
    true = linearise(p.magnetic_levitation()).C_Y_rest.subs(p.Y, p.y)
    condition = stability.stability_condition().subs(
        {p.rho: enters.shape / quotient, p.C_Y_hat: enters.C_Y_hat, p.C_Y_true: true}
    )
    (end,) = sp.solve(sp.expand(condition * quotient), quotient)
    return sp.factor(sp.simplify(enters.scale * end**enters.power))
