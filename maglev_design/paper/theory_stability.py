"""How far the loop is stable: readings of U, the moved ball, sampling; and the conclusions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp
from sympy import Expr, Symbol

from maglev_design.design import path_gaps
from maglev_design.options import EQUILIBRIA, Equilibrium
from maglev_design.paper.equations import proved
from maglev_design.paper.ledger import Claim, Value, judged
from maglev_design.paper.theory_appendix import NEAR, PRINTED_RANGE
from maglev_design.paper.theory_linear import (
    Case,
    bounded_matrix,
    is_stable,
    linear_loop,
    quantity,
    tally,
)
from maglev_design.paper.theory_plant import residual_is_zero
from maglev_design.paper.theory_sampled import ratio_interval
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.linearisation import believed_coefficients, linearise
from maglev_design.symbolic.stability import routh_hurwitz, stability_condition

SPAN = Symbol("x", positive=True)
"""(y + y0)/(Y + y0): where the ball is."""
ROOT = Symbol("q", positive=True)
"""Square root of beta_c/beta."""


def stability_claims(tried: Sequence[Case]) -> tuple[Claim, ...]:
    """Return the claims on intervals and on the stability that the conclusions state."""
    return (
        _intervals(tried),
        _sampled(tried[0]),
        _locally_stable(tried),
        _practical(),
        _any_point(tried),
    )


@dataclass(frozen=True)
class Edge:
    """Where the continuous loop is stable under a reading of U.

    Attributes
    ----------
    margin : Expr
        Positive where it is, in ROOT, SPAN, C_Y, zeta and omega_n.
    upper : Expr
        beta_c/beta below which it is; infinite where the ratio does not enter.
    falling : bool
        Whether the margin falls as the ratio rises, so that no other end exists above zero.
    """

    margin: Expr
    upper: Expr
    falling: bool


@cache
def edge(reading: Equilibrium) -> Edge:
    """Return the stable range of beta_c/beta in closed form, from the general condition."""
    plant = p.magnetic_levitation()
    lin = linearise(plant)
    weight = {p.g: p.C_Y * (p.Y + p.y0) / 2}
    voltage = plant.equilibrium_voltage
    own = {p.beta_c: ROOT**2 * p.beta, p.U: voltage}
    _, c_u_hat, c_y_hat = (x.subs(own) for x in believed_coefficients(plant, lin, reading))
    moved = SPAN * (p.Y + p.y0) - p.y0
    c_u = lin.C_U_rest.subs(p.U, voltage).subs(p.Y, moved)
    c_y = lin.C_Y_rest.subs(p.Y, moved)
    condition = stability_condition().subs(
        {
            p.rho: sp.simplify(c_u / c_u_hat),
            p.C_Y_true: sp.simplify(c_y.subs(weight)),
            p.C_Y_hat: sp.simplify(c_y_hat.subs(weight)),
        }
    )
    margin = sp.expand(sp.powdenest(condition.subs(weight), force=True))
    if not margin.has(ROOT):
        return Edge(margin, sp.oo, True)
    (end,) = sp.solve(margin, ROOT)
    falling = sp.simplify(sp.diff(margin, ROOT)).is_negative
    return Edge(margin, sp.factor(sp.simplify(end**2)), bool(falling))


def upper_ratio(case: Case, reading: Equilibrium, gap: float) -> float:
    """Return the upper end of beta_c/beta of a case at a gap [m]; 0 where no ratio is stable."""
    numbers = _numbers(case, gap)
    own = edge(reading)
    if own.upper == sp.oo:
        return math.inf if float(own.margin.subs(numbers)) > 0 else 0.0
    return float(own.upper.subs(numbers))


def _numbers(case: Case, gap: float) -> dict[Symbol, float]:
    offset, own = case.rig.plant.gap_offset, case.rig.operating_point.gap
    zeta, speed = case.poles.first
    return {
        SPAN: (gap + offset) / (own + offset),
        p.C_Y: linear_loop(case).c_y,
        p.zeta: zeta,
        p.omega_n: speed,
    }


def _roots_agree(case: Case) -> bool:
    """Whether the eigenvalues change sides where the closed forms say, all readings, three gaps."""
    for reading in EQUILIBRIA:
        for gap in case.gaps:
            end = upper_ratio(case, reading, gap)
            trials = {0.1: True, 10.0: True} if math.isinf(end) else {0.02 * end: True}
            if not math.isinf(end):
                trials |= {(1 - NEAR) * end: True, (1 + NEAR) * end: False, 3 * end: False}
            for ratio, expected in trials.items():
                loop = linear_loop(case, gap=gap, ratio=ratio, reading=reading)
                if is_stable(bounded_matrix(loop)) != expected:
                    return False
    return True


def _shown(end: float) -> str:
    return "without end" if math.isinf(end) else f"{end:.4g}"


def _value(end: float) -> Value:
    return "infinite" if math.isinf(end) else end


def _intervals(tried: Sequence[Case]) -> Claim:
    case = tried[0]
    own, _, end = case.gaps
    ends = {r: (upper_ratio(case, r, own), upper_ratio(case, r, end)) for r in EQUILIBRIA}
    found = tally(tried, _roots_agree)
    proof = residual_is_zero("A7-general") and all(edge(r).falling for r in EQUILIBRIA)
    printed = 1 + PRINTED_RANGE[1]
    same = all(abs(x - printed) < 1e-2 for pair in ends.values() for x in pair)
    listed = "; ".join(
        f"{reading}: {_shown(at_y)} at Y, {_shown(moved)} at {quantity(1e3 * end, 'mm')}"
        for reading, (at_y, moved) in ends.items()
    )
    forms = "; ".join(f"{r}: {edge(r).upper}" for r in EQUILIBRIA if edge(r).upper != sp.oo)
    correction = f"0 < beta_c/beta < r, r by reading of U and gap: {listed}"
    correction = correction if proof and found.unanimous and not same else ""
    return Claim(
        id="A-interval",
        place="app. A, last paragraph",
        statement=(
            "One interval of the error of beta, found at Y, is where the closed loop is stable."
        ),
        verdict=judged(holds=same and found.unanimous, correction=correction),
        correction=correction,
        evidence=(
            "From rho (omega_n^2 + C_Y_hat) > C_Y_true + omega_n^2/(4 zeta^2 + 1), derivation "
            f"(A7-general), in closed form with x = y/Y: {forms}; with U and C_Y measured no ratio "
            "enters. The margin falls with the ratio, so that zero, itself excluded, is the lower "
            "end in every case. " + found.says("Eigenvalues on either side of every end")
        ),
        command="maglev-design claims --only A-interval",
        values={
            **{f"upper_at_Y, {r}": _value(pair[0]) for r, pair in ends.items()},
            **{f"upper_at_end, {r}": _value(pair[1]) for r, pair in ends.items()},
            "rigs": found.tried,
            "agreed": found.agreed,
        },
    )


def _sampled(case: Case) -> Claim:
    own = case.rig.operating_point.gap
    hull = path_gaps(case.rig, 2)
    path = (float(hull[0]), float(hull[-1]))
    at_y = {r: ratio_interval(case, r, (own, own)) for r in EQUILIBRIA}
    on_path = {r: ratio_interval(case, r, path) for r in EQUILIBRIA}
    low, high = at_y["appendix-a"]
    exact = upper_ratio(case, "appendix-a", own)
    holds = low == 0.0 and high >= exact
    sampling = case.rig.sampling

    def listed(ends: dict[Equilibrium, tuple[float, float]]) -> str:
        return "; ".join(
            f"{r}: no end found"
            if pair == (0.0, math.inf)
            else f"{r}: {pair[0]:.3g} to {pair[1]:.4g}"
            for r, pair in ends.items()
        )

    correction = "" if holds else f"beta_c/beta at Y, by reading of U: {listed(at_y)}"
    return Claim(
        id="A-sampled",
        place="app. A with sec. 4",
        statement=(
            "The range of the error of beta holds for the controller that is run, which is sampled."
        ),
        verdict=judged(holds=holds, correction=correction),
        correction=correction,
        evidence=(
            f"Sampled every {quantity(1e3 * sampling.period, 'ms')} ({sampling.method}), spectral "
            f"radius below one: at Y {listed(at_y)}; at every gap of the path {listed(on_path)}. "
            "A small beta_c means a large loop gain, which a sampled loop does not stand: under "
            f"appendix-a the ends are {low:.3g}, not 0, and {high:.4g}, not {exact:.4g}."
        ),
        command="maglev-design claims --only A-sampled",
        values={
            f"{name}_{where}, {r}": _value(pair[n])
            for where, ends in (("at_Y", at_y), ("on_path", on_path))
            for r, pair in ends.items()
            for n, name in enumerate(("lower", "upper"))
        },
    )


def _locally_stable(tried: Sequence[Case]) -> Claim:
    designed = {line.lhs: line.rhs for line in proved()["25"].lines}
    polynomial = [sp.Integer(1), *(k.subs(designed) for k in (p.k3, p.k2, p.k1, p.k0))]
    signs = [bool(x.is_positive) for x in routh_hurwitz(polynomial)]

    def everywhere(case: Case) -> bool:
        stable = [
            is_stable(bounded_matrix(linear_loop(case, gap=float(gap))))
            for gap in path_gaps(case.rig, 9)
        ]
        said = [upper_ratio(case, "model", float(gap)) > 1 for gap in path_gaps(case.rig, 9)]
        return all(stable) and all(said)

    found = tally(tried, everywhere)
    case = tried[0]
    own, _, end = case.gaps
    roots = np.linalg.eigvals(bounded_matrix(linear_loop(case, gap=end)))
    slowest = float(roots.real.max())
    listed = ", ".join(
        f"{root.real:.4g}{f' +- {root.imag:.4g} j' if root.imag > 0 else ''}"
        for root in sorted(roots, key=lambda z: -z.real)
        if root.imag >= 0
    )
    _, speed = case.poles.first
    farthest = edge("measured").margin
    (reach,) = sp.solve(farthest, SPAN)
    return Claim(
        id="6-locally-stable",
        place="sec. 6",
        statement="The controller makes the equilibrium locally exponentially stable.",
        verdict=judged(holds=all(signs) and found.unanimous and slowest < 0),
        correction="",
        evidence=(
            "At Y and exact beta the polynomial is (24), whose Hurwitz determinants with (25) are "
            f"positive for every zeta and omega_n: four poles of modulus {quantity(speed, '1/s')}. "
            f"At the end of the path, {quantity(1e3 * end, 'mm')}, with the gains placed at "
            f"{quantity(1e3 * own, 'mm')}, the poles are {listed} 1/s; stable at rest at any gap "
            f"below ({sp.simplify(reach)}) Y. The linear loop decides for the plant (4) near the "
            "equilibrium, with the bounded law (see 3.2-origin). "
            + found.says("Eigenvalues at nine gaps of the path")
        ),
        command="maglev-design claims --only 6-locally-stable",
        values={
            "slowest_at_end": slowest,
            "stable_below_gap": float(reach.subs(p.zeta, case.poles.values[0])) * own,
            "rigs": found.tried,
            "agreed": found.agreed,
        },
    )


def _practical() -> Claim:
    return Claim(
        id="6-practical",
        place="sec. 6",
        statement="Tracking is practically and locally stable.",
        verdict="not-checkable",
        correction="",
        evidence=(
            "Practical stability is a bound on the error for given disturbances and starts; the "
            "paper gives neither the bound nor the region, and no proof. For the linear loop "
            "A-bounded and A-limit say what can be said."
        ),
        command="maglev-design claims --json",
    )


def _any_point(tried: Sequence[Case]) -> Claim:
    condition = sp.expand(edge("model").margin.subs({ROOT: 1, SPAN: 1}))
    found = tally(tried, lambda case: is_stable(bounded_matrix(linear_loop(case))))
    return Claim(
        id="abstract-any-point",
        place="abstract, sec. 1",
        statement="The design stabilises an arbitrary equilibrium.",
        verdict=judged(holds=bool(sp.simplify(condition).is_positive) and found.unanimous),
        correction="",
        evidence=(
            f"Linearised there, at exact beta, the margin is {sp.simplify(condition)}, "
            "positive for every gap, damping and frequency. "
            + found.says("Eigenvalues with random poles at each rig's own Y")
        ),
        command="maglev-design claims --only abstract-any-point",
        values={"margin": str(sp.simplify(condition)), "rigs": found.tried, "agreed": found.agreed},
    )
