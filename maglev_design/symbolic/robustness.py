"""The loop as a function of beta_c/beta and of the gap: what enters, and how.

The controller stays, the plant's beta is beta_c/r. Every polynomial of the loop is a *pencil*

    chi = fixed + rho (gain + C_Y^ gain_c_y),

and r enters through rho alone. With v = 1/rho(Y), what the controller takes the loop's gain to be
at Y over what it is, r = scale v^power and rho(y) = shape(y)/v: v chi is affine in v with rational
coefficients, also where r itself enters by its square root.

Appendix A of the paper asks something else: there the controller is computed anew on each plant,
whose voltage at rest it measures. C_U^ and C_Y^ then move with the plant; C_Y^ is affine in v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

from maglev_design.options import Equilibrium, Method
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
GAP = Symbol("y", positive=True)
"""[m] The gap y, known to be positive."""


Groups = tuple[tuple[Expr, ...], ...]


@dataclass(frozen=True)
class Pencil:
    """The closed loop's polynomial, coefficients highest power first, of one length.

    Attributes
    ----------
    fixed, gain, gain_c_y : tuple of Expr
        In chi = fixed + rho (gain + C_Y^ gain_c_y): of C_Y' and the gains.
    """

    fixed: tuple[Expr, ...]
    gain: tuple[Expr, ...]
    gain_c_y: tuple[Expr, ...]


def continuous_pencil(law: ControlLaw) -> Pencil:
    """Return the continuous loop's polynomial in s as a pencil."""
    return _pencil(stability.closed_loop_polynomial(law))


def sampled_parts(law: ControlLaw, method: Method, *, split: bool) -> tuple[Groups, Groups]:
    """Return the factors of the sampled loop's pencil in z, coefficients highest power first.

        fixed = plant_den law_den,  gain = plant_gap law_gap + plant_velocity law_velocity,

    and gain_c_y likewise with the last two, less whole periods of delay (a power of z in `fixed`).

    Parameters
    ----------
    split : bool
        Whether the voltage changes inside a period (T_1 > 0); else T_1 = 0, and the pole at zero
        that stands for the earlier voltage is left out.

    Returns
    -------
    plant : tuple
        plant_den, plant_gap and plant_velocity, of C_Y', T and T_1.
    law : tuple
        law_den, law_gap, law_velocity, law_gap_c_y and law_velocity_c_y, of T and the gains, all of
        one length.
    """
    pulse = stability.sampled_law(law, method)
    gap, velocity = stability.sampled_plant("gap"), stability.sampled_plant("velocity")
    through = [list(gap.denominator), list(gap.numerator), list(velocity.numerator)]
    if not split:
        through = [[c.subs(stability.first_part, 0) for c in part] for part in through]
        if any(part.pop() != 0 for part in through):
            raise ArithmeticError("the loop without delay keeps a pole that it does not have")
    loop_gain = stability.believed(law.loop_gain)
    by_gap, by_velocity = (
        _pencil([p.rho * loop_gain * c for c in part]) for part in (pulse.gap, pulse.velocity)
    )
    own = (by_gap.gain, by_velocity.gain, by_gap.gain_c_y, by_velocity.gain_c_y)
    return tuple(map(tuple, through)), (pulse.denominator, *own)


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
class RatioDependence:
    """How beta_c/beta enters a loop.

    Attributes
    ----------
    shape : Expr
        rho(y) v, in y, Y and y0; 1 at Y.
    scale : Expr
        In r = scale v^power; of a controller that stays in beta_c, g, Y, y0 and C_U^, else 1.
    power : int
        1 or 2; 0 where the ratio does not enter, and then v = 1.
    C_Y_hat : Expr
        Affine in v; the symbol C_Y^ itself of a controller that stays.
    """

    shape: Expr
    scale: Expr
    power: int
    C_Y_hat: Expr


def uncertainty(law: ControlLaw, recomputed: Equilibrium | None = None) -> RatioDependence:
    """Return how beta_c/beta enters the loop of a law.

    Parameters
    ----------
    recomputed : {"model", "appendix-a", "measured"}, optional
        The reading by which the controller is computed anew on each plant, the voltage at rest
        being that plant's own; by default the controller stays: C_U^, C_Y^ and its beta, beta_c.
    """
    plant = p.magnetic_levitation()
    lin = linearise(plant)
    held = plant.equilibrium_voltage.subs({p.beta: p.beta_c / ratio})
    c_u_hat, c_y_hat, beta_hat = p.C_U_hat, p.C_Y_hat, p.beta_c
    if recomputed is not None:
        anew = (*believed_coefficients(plant, lin, recomputed), believed_beta(plant, recomputed))
        _, c_u_hat, c_y_hat, beta_hat = (x.subs(p.U, held) for x in anew)
    voltage = held.subs(p.Y, GAP)
    c_u = lin.C_U_rest.subs(p.U, held).subs(p.Y, GAP)
    slope = law.slope.subs({p.u: voltage, p.y_ref: GAP, p.beta_c: beta_hat})
    rho = c_u * slope / stability.believed(law.loop_gain).subs(p.C_U_hat, c_u_hat)
    rho = sp.simplify(sp.powdenest(rho, force=True))
    at_y = sp.powdenest(sp.expand_power_base(rho.subs(GAP, p.Y), force=True), force=True)
    factor, exponent = sp.simplify(at_y**2).as_coeff_exponent(ratio)
    if exponent not in (0, -1, -2) or factor.has(ratio) or (exponent == 0 and factor != 1):
        raise ArithmeticError(f"rho^2 = {sp.simplify(at_y**2)} is no power of the ratio")
    # r^n = factor v^2 with n = -exponent
    power = {0: 0, -1: 2, -2: 1}[int(exponent)]
    scale = sp.Integer(1) if exponent == 0 else sp.sqrt(factor) if power == 1 else factor
    seen = sp.expand(sp.simplify(c_y_hat).subs(ratio, scale * quotient**power))
    if not sp.Poly(seen, quotient).degree() <= 1:
        raise ArithmeticError(f"C_Y^ = {seen} is not affine in v")
    shape = sp.simplify(rho / rho.subs(GAP, p.Y)).subs(GAP, p.y)
    return RatioDependence(shape, sp.simplify(scale), power, seen)


def stability_conditions(law: ControlLaw) -> tuple[Expr, ...]:
    """Return what must be positive for the continuous loop to be stable, constants left out.

    The Hurwitz determinants in rho, C_Y', C_Y^ and the gains, each without the factors of the
    ones before it.
    """
    found: list[Expr] = []
    for condition in stability.routh_hurwitz(stability.closed_loop_polynomial(law)):
        rest = condition
        for known in found:
            shorter = sp.cancel(rest / known)
            rest = shorter if sp.fraction(shorter)[1] == 1 else rest
        found.append(sp.factor(rest))
    return tuple(found)


def largest_ratio(law: ControlLaw, recomputed: Equilibrium | None = None) -> Expr | None:
    """Return in closed form the beta_c/beta below which the TAN-GPI loop with (25) is stable.

    From rho (omega_n^2 + C_Y^) > C_Y' + omega_n^2/(4 zeta^2 + 1) with rho = shape/v: the difference
    times v falls along a line in v. None where no ratio enters. `recomputed` as in
    :func:`uncertainty`.
    """
    enters = uncertainty(law, recomputed)
    if enters.power == 0:
        return None
    true = linearise(p.magnetic_levitation()).C_Y_rest.subs(p.Y, GAP)
    condition = stability.stability_condition().subs(
        {p.rho: enters.shape / quotient, p.C_Y_hat: enters.C_Y_hat, p.C_Y_true: true, p.y: GAP}
    )
    above, below = sp.fraction(sp.cancel(condition.subs(p.y, GAP) * quotient))
    line = sp.Poly(above, quotient)
    slope, level = (sp.factor(line.coeff_monomial(quotient**n) / below) for n in (1, 0))
    if not slope.is_negative:
        raise ArithmeticError(f"the margin ({recomputed}) does not fall with the ratio")
    return sp.factor(enters.scale * (-level / slope) ** enters.power)
