"""Appendix A: the gammas, the conditions, the bound and what it means for the error of beta."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sympy as sp
from sympy import Expr

from maglev_design.derivation import terms as d
from maglev_design.derivation.control import FOUR
from maglev_design.options import EQUILIBRIA, Equilibrium
from maglev_design.paper.ledger import Finding, claim, finding
from maglev_design.paper.printed import (
    BELOW_A1,
    BELOW_A6,
    BOUND_TEXT,
    GAMMA,
    GAMMAS,
    PLAIN,
    PRINTED_BOUND,
    designed,
    proved,
    residual_is_zero,
)
from maglev_design.paper.theory_disturbances import WRONG
from maglev_design.paper.theory_linear import (
    AGREES,
    LinearLoop,
    TriedRig,
    linear_loop,
    quantity,
    tally,
)
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.gpi import (
    gpi_transfer,
)
from maglev_design.symbolic.linearisation import believed_coefficients, linearise
from maglev_design.symbolic.stability import believed, routh_hurwitz

PRINTED_RANGE = (-1.0, 1.63)
"""(beta_c - beta)/beta, both ends included, last line of the appendix."""
NEAR = 1e-2
"""Relative distance from a boundary at which the eigenvalues are asked."""
HALF_DIGIT = 0.005
"""Of 2.63."""
POSITIVE_NOT_HURWITZ = (1, 1, 1, 1, 1)
"""s^4 + s^3 + s^2 + s + 1: its roots are the fifth roots of one but for 1 itself."""
DIVIDED = "gamma_1 of the text, all without the second 1/C_U_hat"


def ratios_of(reading: Equilibrium) -> tuple[Expr, Expr]:
    """Return (C_U/C_U^, C_Y/C_Y^) at Y, in beta and beta_c, under a reading of U."""
    plant = p.magnetic_levitation()
    lin = linearise(plant)
    at_rest = {p.U: plant.equilibrium_voltage}
    _, c_u_hat, c_y_hat = (x.subs(at_rest) for x in believed_coefficients(plant, lin, reading))
    true = lin.C_U_rest.subs(at_rest), lin.C_Y_rest
    c_u, c_y = (
        sp.powdenest(sp.cancel(x / y)) for x, y in zip(true, (c_u_hat, c_y_hat), strict=True)
    )
    return c_u, c_y


@claim("A-ratios")
def _ratios(tried: Sequence[TriedRig]) -> Finding:
    ratios = {reading: ratios_of(reading) for reading in EQUILIBRIA}
    wanted = p.beta / p.beta_c
    fits = {
        reading: all(d.simplest(ratio - wanted) == 0 for ratio in pair)
        for reading, pair in ratios.items()
    }

    def agrees(case: TriedRig) -> bool:
        numbers = {p.beta: 1.0, p.beta_c: WRONG}
        return all(
            np.isclose(true / hat, float(ratio.subs(numbers)), rtol=AGREES)
            for reading, pair in ratios.items()
            for loop in (linear_loop(case, ratio=WRONG, reading=reading),)
            for true, hat, ratio in zip(
                (loop.c_u, loop.c_y), (loop.c_u_hat, loop.c_y_hat), pair, strict=True
            )
        )

    found = tally(tried, agrees)
    right = [reading for reading, fit in fits.items() if fit]
    others = "; ".join(
        f"{reading}: C_U/C_U_hat = {pair[0]}, C_Y/C_Y_hat = {pair[1]}"
        for reading, pair in ratios.items()
        if not fits[reading]
    )
    holds = len(right) == len(ratios)
    decided = found.unanimous and right
    return finding(
        holds and found.unanimous,
        "Derivation (10-readings) and (A4): true if U is the voltage measured at the "
        f"equilibrium. Otherwise {others}. By (5) a controller that knows only its own beta_c "
        "computes U from it, the reading model. " + found.says("Ratios in numbers"),
        f"only under the reading {', '.join(right)}" if decided and not holds else "",
        **found.counts,
        **{f"equal, {reading}": fit for reading, fit in fits.items()},
    )


def bound_of(gammas: Sequence[Expr]) -> Expr:
    """Return gamma_3^2 gamma_0/(gamma_1 (gamma_3 gamma_2 - gamma_1)), the right side of (A7)."""
    g0, g1, g2, g3 = gammas
    return g3**2 * g0 / (g1 * (g3 * g2 - g1))


def readings_of_gammas() -> dict[str, Sequence[Expr]]:
    """Return every set of gammas the text can mean, and the right one, by name."""
    g0, g1, g2, g3 = GAMMAS[BELOW_A6]
    cleared = tuple(sp.cancel(x * p.C_U_hat) for x in (g0, g1, g2))
    return dict(GAMMAS) | {DIVIDED: (*cleared, g3)}


def bounds(loop: LinearLoop) -> dict[str, float]:
    """Return the bound on beta/beta_c by reading of the gammas, at exact beta."""
    return {
        name: float(bound_of(gammas).subs(loop.letters))
        for name, gammas in readings_of_gammas().items()
    }


@claim("A-gammas")
def _gammas(case: TriedRig) -> Finding:
    first, second = GAMMAS[BELOW_A1], GAMMAS[BELOW_A6]
    differ = [str(letter) for letter, x, y in zip(GAMMA, first, second, strict=True) if x != y]
    right = {
        name: d.simplest(_solved(gammas) - (believed(gpi_transfer(FOUR)) - p.C_Y_hat)) == 0
        for name, gammas in GAMMAS.items()
    }
    good = [name for name, fit in right.items() if fit]
    loop = linear_loop(case)
    gamma_1 = {name: float(gammas[1].subs(loop.letters)) for name, gammas in GAMMAS.items()}
    return finding(
        not differ and right[BELOW_A1],
        f"The two places differ in {', '.join(differ)}: {first[1]} against {second[1]}, "
        f"{quantity(gamma_1[BELOW_A1], '')} against "
        f"{quantity(gamma_1[BELOW_A6], '')} on the paper's rig, where (A3) needs "
        f"k1 = {quantity(loop.gains[1], '1/s^3')}. Of the operator in (A2) to (A4) they leave "
        f"a remainder; only {' and '.join(good)} {'leaves' if len(good) == 1 else 'leave'} "
        "none, derivation (A2).",
        "in (A3) to (A7) gamma_n = k_n, n = 0 to 3" if PLAIN in good else "",
        **{f"gamma_1, {name}": value for name, value in gamma_1.items()},
    )


def _solved(gammas: Sequence[Expr]) -> Expr:
    g0, g1, g2, g3 = gammas
    return (g2 * p.s**2 + g1 * p.s + g0) / (p.s * (p.s + g3))


@claim("A-routh")
def _routh() -> Finding:
    g0, g1, g2, g3 = GAMMA
    conditions = routh_hurwitz([sp.Integer(1), g3, d.mu * g2, d.mu * g1, d.mu * g0])
    second = d.mu * (g3 * g2 - g1)
    printed = (g3, second, d.mu * (g1 * second - g3**2 * g0))
    left = [d.simplest(x - y) for x, y in zip(conditions, printed, strict=False)]
    return finding(
        all(rest == 0 for rest in left) and residual_is_zero("A7-routh"),
        "The listed expressions are the Hurwitz determinants of order 2 and 3, printed minus "
        f"computed {left[1]} and {left[2]}; the fourth is mu gamma_0 times the third. Right "
        "in the gammas, whatever they stand for; derivation (A7-routh), residual 0.",
        residual_2=str(left[1]),
        residual_3=str(left[2]),
    )


@claim("A-second-condition")
def _second_condition(tried: Sequence[TriedRig]) -> Finding:
    value = sp.factor(designed(p.k3 * p.k2 - p.k1))

    def positive(case: TriedRig) -> bool:
        _, k1, k2, k3 = linear_loop(case).gains
        return k3 * k2 > k1

    found = tally(tried, positive)
    return finding(
        bool(value.is_positive) and found.unanimous,
        f"With gamma_n = k_n and the gains (25) it is {value}, and beta_c is not in it. "
        + found.says("Numbers"),
        expression=str(value),
        **found.counts,
    )


@claim("A-positive-gains")
def _positive_gains() -> Finding:
    largest = float(np.roots(POSITIVE_NOT_HURWITZ).real.max())
    third = routh_hurwitz([sp.Integer(1), p.k3, p.k2, p.k1, p.k0])[2]
    return finding(
        largest < 0,
        "Necessary, not sufficient at order four: s^4 + s^3 + s^2 + s + 1 has a root with the "
        f"real part {quantity(largest, '1/s')}.",
        f"k_n > 0 and {third} > 0; the gains (25) fulfil it",
        largest_real_part=largest,
    )


@claim("A-mu-positive")
def _mu_positive() -> Finding:
    return finding(
        (p.beta / p.beta_c).is_positive,
        "Both are products of squares and positive constants; mu gamma_n > 0 follows. It "
        "excludes beta_c = 0 and everything below, see A-range.",
    )


@claim("A-bound")
def _bound(tried: Sequence[TriedRig]) -> Finding:
    case = tried[0]
    found_bounds = bounds(linear_loop(case))
    printed = 1 / float(PRINTED_BOUND)
    matches = [name for name, x in found_bounds.items() if abs(1 / x - printed) < HALF_DIGIT]
    edge = sp.factor(designed(bound_of(GAMMAS[PLAIN])))
    found = tally(tried, lambda c: _crosses_at(c, "appendix-a", 1 / float(_edge_of(c, edge))))
    right = residual_is_zero("A7", "A7-general") and found.unanimous
    zeta = case.poles.values[0]
    correction = f"mu > {edge} = 1/{1 / float(_edge_of(case, edge)):.4g} at zeta = {zeta:g}"
    listed = ", ".join(f"{x:.4g} with {name}" for name, x in found_bounds.items())
    beyond = [name for name, x in found_bounds.items() if x >= 1]
    return finding(
        PLAIN in matches and right,
        f"At exact beta (A7) asks for mu above {listed}; {BOUND_TEXT} = "
        f"{float(PRINTED_BOUND):.4g} is {' and '.join(matches) or 'none of them'}, and "
        f"{' and '.join(beyond) or 'none'} would rule the exact beta, mu = 1, out. "
        "Under the appendix's own assumption (reading appendix-a, ball at Y): "
        + found.says(f"Eigenvalues {100 * NEAR:g} % on either side of {edge}"),
        correction if right else "",
        **{f"bound, {name}": x for name, x in found_bounds.items()},
        printed=float(PRINTED_BOUND),
        **found.counts,
    )


def _edge_of(case: TriedRig, edge: Expr) -> Expr:
    return edge.subs(p.zeta, case.poles.values[0])


def _crosses_at(case: TriedRig, reading: Equilibrium, upper: float) -> bool:
    """Whether the loop at Y is stable just below the ratio `upper` and not just above."""
    below, above = (
        linear_loop(case, ratio=upper * share, reading=reading).stable
        for share in (1 - NEAR, 1 + NEAR)
    )
    return below and not above


@claim("A-range")
def _range(tried: Sequence[TriedRig]) -> Finding:
    edge = proved()["A7"].lines[1].rhs
    case = tried[0]
    upper = float(1 / _edge_of(case, edge)) - 1
    lowest = 1 + sp.nsimplify(PRINTED_RANGE[0])
    at_zero = sp.limit(1 / _appendix_gain().subs(p.beta_c, d.mu), d.mu, lowest, "+")
    lower_allowed = at_zero.is_finite

    def agrees(other: TriedRig) -> bool:
        end = float(1 / _edge_of(other, edge))
        return _crosses_at(other, "appendix-a", end) and all(
            linear_loop(other, ratio=share * end, reading="appendix-a").stable
            for share in np.linspace(0.02, 0.98, 9)
        )

    found = tally(tried, agrees)
    ends_fit = abs(upper - PRINTED_RANGE[1]) < HALF_DIGIT
    general = sp.simplify(1 / edge - 1)
    correction = (
        f"-beta < e_beta < {general} beta, {upper:.4g} beta at zeta = {case.poles.values[0]:g}"
    )
    return finding(
        bool(ends_fit and lower_allowed and found.unanimous),
        "From the corrected bound, by the appendix's own assumption (U measured, ball at Y, "
        "continuous time). At the upper end the loop is on the edge; at the lower beta_c = 0, "
        f"and 1/C_U_hat tends to {'infinity' if at_zero == sp.oo else at_zero}: there is no "
        "controller. What other readings, the moved ball and sampling make of it: A-interval, "
        "A-sampled. " + found.says("Eigenvalues inside the range and around its upper end"),
        correction if found.unanimous else "",
        upper=upper,
        lower=-1.0,
        printed_upper=PRINTED_RANGE[1],
        **found.counts,
    )


def _appendix_gain() -> Expr:
    """Return C_U_hat of the appendix in beta_c, U and Y."""
    plant = p.magnetic_levitation()
    return believed_coefficients(plant, linearise(plant), "appendix-a")[1]
