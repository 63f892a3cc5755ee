"""The complete set of beta_c/beta, or of gaps, for which the continuous loop is stable; exact.

With v of :mod:`maglev_design.symbolic.robustness` and the gap y, the loop's polynomial times
v (y + y0) > 0 has coefficients c_n, ..., c_0 in Q[v, y]. Along any path in (v, y) a root can enter
the right half-plane only through 0, where c_0 = 0, or as a pair, where the Hurwitz determinant
D_{n-1} = 0 (Orlando); c_n > 0 throughout. Between consecutive zeros of the two, one rational point
decides for all. Over a range of gaps, the number of zeros of a factor f(v, y) in y between two gaps
can change only where f vanishes at one of them, at zeros of its leading coefficient and at zeros of
its discriminant (cylindrical decomposition of the plane): again one rational v decides for a cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import sympy as sp
from flint import arb
from sympy import Expr, Poly

from maglev_design import programs
from maglev_design.certification.intervals import algebraic
from maglev_design.certification.intervals.algebraic import Root
from maglev_design.certification.intervals.arithmetic import (
    at,
    between,
    keeps_sign,
    number,
    working,
)
from maglev_design.certification.intervals.routh import is_hurwitz
from maglev_design.certification.intervals.spans import End, Span, StableSet, unite
from maglev_design.certification.numbers import as_designed
from maglev_design.certification.rationals import decimal, root
from maglev_design.controller.design import Design
from maglev_design.options import Equilibrium
from maglev_design.rig import Rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import robustness, stability
from maglev_design.symbolic.linearisation import linearise

GAP = sp.Symbol("y", positive=True)
V = robustness.quotient
NOMINAL = Fraction(1)


@dataclass(frozen=True)
class ExactLoop:
    """The continuous loop of one controller on one rig, in exact rationals.

    Attributes
    ----------
    coefficients : tuple of Poly
        c_n, ..., c_0 in (v, y).
    scale, power
        Of beta_c/beta = scale v^power; power 0 where the ratio does not enter, and v = 1.
    recomputed : str or None
        The reading by which the controller is computed anew on each plant; None: it stays.
    """

    coefficients: tuple[Poly, ...]
    scale: Fraction
    power: int
    recomputed: Equilibrium | None = None

    @property
    def boundary(self) -> tuple[Poly, Poly]:
        """c_0 and D_{n-1}."""
        symbols = sp.symbols(f"c0:{len(self.coefficients)}")
        pairs = dict(zip(symbols, (c.as_expr() for c in self.coefficients), strict=True))
        determinant = _determinant(len(self.coefficients)).subs(pairs, simultaneous=True)
        return self.coefficients[-1], Poly(sp.expand(determinant), V, GAP)

    def stable_at(self, v: Fraction, gap: Fraction) -> bool:
        """Whether the loop is asymptotically stable at a rational point."""
        values = (c.eval((sp.Rational(v), sp.Rational(gap))) for c in self.coefficients)
        return bool(is_hurwitz([Fraction(value) for value in values]))


@cache
def _determinant(count: int) -> Expr:
    """Return D_{n-1} of a polynomial with `count` coefficients c0, c1, ..., highest first."""
    return sp.expand(stability.routh_hurwitz(sp.symbols(f"c0:{count}"))[count - 3])


def exact_loop(rig: Rig, design: Design, recomputed: Equilibrium | None = None) -> ExactLoop:
    """Return the continuous loop with every number exact, as the controller was designed.

    Parameters
    ----------
    recomputed : {"model", "appendix-a", "measured"}, optional
        The reading by which a controller with the same gains is computed anew on each plant; by
        default the controller stays.
    """
    law = programs.law(design.controller)
    pencil = robustness.continuous_pencil(law)
    enters = robustness.uncertainty(law, recomputed)
    numbers = as_designed(rig, design)
    true = linearise(p.magnetic_levitation()).C_Y_rest.subs(p.Y, p.y)
    weight = V * (p.y + p.y0)
    coefficients = []
    for fixed, gain, gain_c_y in zip(pencil.fixed, pencil.gain, pencil.gain_c_y, strict=True):
        rho = enters.shape / V
        whole = weight * (fixed.subs(p.C_Y_true, true) + rho * (gain + enters.C_Y_hat * gain_c_y))
        exact = sp.expand(sp.cancel(whole.subs(numbers)).subs(p.y, GAP))
        coefficients.append(Poly(exact, V, GAP, domain=sp.QQ))
    scale = Fraction(sp.nsimplify(enters.scale.subs(numbers)))
    return ExactLoop(tuple(coefficients), scale, enters.power, recomputed)


def ratios_at(loop: ExactLoop, gap: float) -> StableSet:
    """Return every beta_c/beta for which the loop is stable at one gap [m]."""
    exact = decimal(gap)
    boundary = [f.eval(GAP, sp.Rational(exact)) for f in loop.boundary]
    if loop.power == 0:
        spans = _whole(loop.stable_at(NOMINAL, exact))
        return StableSet((gap, gap), spans, loop.recomputed)
    roots = algebraic.positive_roots([Poly(f, V) for f in boundary])
    stable = [loop.stable_at(v, exact) for v in algebraic.between(roots)]
    stable = stable if not any(f.is_zero for f in boundary) else [False] * len(stable)
    here = [Poly(c.eval(GAP, sp.Rational(exact)), V) for c in loop.coefficients]
    spans = unite(_ratio_ends(loop, roots), stable, lambda n: _passes(here, roots[n]))
    return StableSet((gap, gap), spans, loop.recomputed)


def ratios_over(loop: ExactLoop, gaps: tuple[float, float]) -> StableSet:
    """Return every beta_c/beta for which the loop is stable at every gap [m] of a range."""
    low, high = (decimal(gap) for gap in gaps)
    factors = sorted(
        {f for b in loop.boundary for f, _ in b.factor_list()[1]}, key=lambda f: str(f.as_expr())
    )
    vanishes = any(b.is_zero for b in loop.boundary)

    def holds(v: Fraction) -> bool:
        if vanishes or not loop.stable_at(v, low):
            return False
        cuts = [Poly(f.eval(V, sp.Rational(v)), GAP) for f in factors]
        return all(c.count_roots(sp.Rational(low), sp.Rational(high)) == 0 for c in cuts)

    if loop.power == 0:
        return StableSet(gaps, _whole(holds(NOMINAL)), loop.recomputed)
    roots = algebraic.positive_roots([c for f in factors for c in _critical(f, low, high)])
    stable = [holds(v) for v in algebraic.between(roots)]

    @working()
    def passes(n: int) -> bool:
        v = between(roots[n].low, roots[n].high)
        return all(keeps_sign(_in_gap(f, v), low, high) for f in factors)

    return StableSet(gaps, unite(_ratio_ends(loop, roots), stable, passes), loop.recomputed)


def _critical(factor: Poly, low: Fraction, high: Fraction) -> list[Poly]:
    """Return the polynomials in v at whose zeros `factor` may gain or lose a zero in y."""
    ends = [Poly(factor.eval(GAP, sp.Rational(gap)), V) for gap in (low, high)]
    in_gap = Poly(factor.as_expr(), GAP)
    found = [*ends, Poly(in_gap.LC(), V)]
    if in_gap.degree() > 1:
        found.append(Poly(in_gap.discriminant(), V))
    return [f for f in found if not f.is_zero and f.degree() > 0]


@working()
def gaps_at(loop: ExactLoop) -> StableSet:
    """Return every gap [m] at which the loop with exact beta is stable.

    Where v = (1/scale)^(1/power) is irrational, the product of the boundary over both signs of the
    root is rational and holds every end; which of its zeros are ends, enclosures decide.
    """
    square = (1 / loop.scale) ** (2 // loop.power) if loop.power else NOMINAL
    boundary = [_norm(f, square) for f in loop.boundary]
    roots = algebraic.positive_roots(boundary)
    v = number(square).sqrt()

    def stable(low: Fraction, high: Fraction) -> bool | None:
        y = between(low, high)
        return is_hurwitz([at(c, v, y) for c in loop.coefficients])

    cells = [bool(stable(gap, gap)) for gap in algebraic.between(roots)]
    cells = cells if not any(f.is_zero for f in boundary) else [False] * len(cells)
    ends = [_end(root) for root in roots]
    spans = unite(ends, cells, lambda n: bool(stable(roots[n].low, roots[n].high)))
    return StableSet(None, spans, loop.recomputed)


def _norm(f: Poly, square: Fraction) -> Poly:
    """Return f(sqrt(square), y) where that is rational, else times f(-sqrt(square), y)."""
    v, above = root(square, NOMINAL)
    if v == above:
        return Poly(f.eval(V, sp.Rational(v)), GAP)
    product = algebraic.conjugated(Poly(f.as_expr(), V), sp.Rational(square))
    return Poly(sp.expand(product), GAP)


@working()
def _passes(coefficients: Sequence[Poly], root: Root) -> bool:
    """Whether the loop is known to be stable at a root of the boundary, too."""
    v = between(root.low, root.high)
    return bool(is_hurwitz([at(c, v) for c in coefficients]))


def _in_gap(factor: Poly, v: arb) -> list[arb]:
    """Return the coefficients in y, lowest first, of a factor at an enclosed v."""
    in_gap = Poly(factor.as_expr(), GAP)
    return [at(Poly(c, V), v) for c in in_gap.all_coeffs()[::-1]]


def _whole(stable: bool) -> tuple[Span, ...]:
    return unite((), (stable,), lambda _: False)


def _ratio_ends(loop: ExactLoop, roots: Sequence[Root]) -> list[End]:
    return [_end(algebraic.squared(root, loop.scale, loop.power)) for root in roots]


def _end(root: Root) -> End:
    return End(root.value, root.text, root.low, root.high)
