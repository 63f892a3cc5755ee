"""The sampled loop enclosed in intervals, for every period, delay, gap and ratio.

z = (1 + w)/(1 - w) takes the unit disc to the left half-plane. The coefficients of v chi in w are
alpha_i + beta_i v; alpha and beta are transcendental in T and C_Y' and enclosed: for one gap to
many digits, for a range of gaps as Taylor series in C_Y'
(:mod:`maglev_design.certification.intervals.jets`), term by term, which keeps what the bilinear map
cancels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import comb
from operator import mul
from typing import Any

import sympy as sp
from flint import arb, arb_series
from sympy import Symbol

from maglev_design import programs
from maglev_design.certification.intervals.arithmetic import OPERATORS, number
from maglev_design.certification.intervals.jets import variable
from maglev_design.certification.numbers import as_run
from maglev_design.controller.design import Design
from maglev_design.controller.timing import ExactTiming
from maglev_design.lowering import Program, lower
from maglev_design.options import Controller, Method
from maglev_design.programs import derived
from maglev_design.rig import Rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import robustness, stability
from maglev_design.symbolic.linearisation import linearise


@dataclass(frozen=True)
class Setting:
    """What a sampled loop is made of, but for its period and delay; exact.

    Attributes
    ----------
    method, controller
        As run.
    gains : tuple of Fraction
    shape : tuple of Fraction
        rho v = shape[0] + shape[1] C_Y'.
    C_Y_hat : Fraction
    scale, power
        Of beta_c/beta = scale v^power.
    weight, offset : Fraction
        C_Y' = weight/(y + offset), y the gap.
    """

    method: Method
    controller: Controller
    gains: tuple[Fraction, ...]
    shape: tuple[Fraction, Fraction]
    C_Y_hat: Fraction
    scale: Fraction
    power: int
    weight: Fraction
    offset: Fraction

    def coefficient(self, gap: Any, to: Callable[[Fraction], Any] = Fraction) -> Any:
        """Return C_Y' [1/s^2] at a gap [m], in numbers that `to` makes of exact ones."""
        return to(self.weight) / (gap + to(self.offset))

    def shape_at(self, true: Any, to: Callable[[Fraction], Any]) -> Any:
        """Return rho v at C_Y' = `true`."""
        level, steepness = map(to, self.shape)
        return level + steepness * true


def setting(rig: Rig, design: Design) -> Setting:
    """Return the exact numbers of a controller's sampled loop: the doubles that run."""
    law = programs.law(design.controller)
    enters = robustness.uncertainty(law)
    numbers = as_run(rig, design)
    true = linearise(p.magnetic_levitation()).C_Y_rest
    weight = sp.simplify(true * (p.Y + p.y0)).subs(numbers)
    gap = weight / p.C_Y_true - numbers[p.y0]
    return Setting(
        design.method,
        design.controller,
        tuple(Fraction(numbers[gain]) for gain in law.gains),
        _affine(sp.simplify(enters.shape.subs(p.y, gap).subs(numbers)), p.C_Y_true),
        Fraction(numbers[p.C_Y_hat]),
        Fraction(enters.scale.subs(numbers)),
        enters.power,
        Fraction(weight),
        Fraction(numbers[p.y0]),
    )


def _affine(expression: sp.Expr, variable: Symbol) -> tuple[Fraction, Fraction]:
    """Return (a, b) of a + b x."""
    polynomial = sp.Poly(expression, variable)
    if polynomial.degree() > 1:
        raise ArithmeticError(f"{expression} is not affine in {variable}")
    constant, slope = (polynomial.coeff_monomial(variable**n) for n in (0, 1))
    return Fraction(constant), Fraction(slope)


@dataclass(frozen=True)
class Parts:
    """Programs for the factors of the pencil, and how many coefficients each factor has.

    Attributes
    ----------
    law : Program
        (T, gains) -> law_den, law_gap, law_velocity, law_gap_c_y, law_velocity_c_y.
    plant : Program
        (C_Y', T, T_1) -> plant_den, plant_gap, plant_velocity.
    sizes : tuple of int
        Of the plant's three.
    """

    law: Program
    plant: Program
    sizes: tuple[int, int, int]

    def pencil(
        self, law: Sequence[Any], plant: Sequence[Any], zero: Any, whole: int
    ) -> list[list[Any]]:
        """Return fixed, gain and gain_c_y in z, of one length, from what the programs return."""
        width = len(law) // 5
        den, gap, velocity, gap_c_y, velocity_c_y = (
            law[n * width : (n + 1) * width] for n in range(5)
        )
        first, second, _ = self.sizes
        plant_den, plant_gap = plant[:first], plant[first : first + second]
        plant_velocity = plant[first + second :]
        late = [zero] * whole  # z^n on the denominator alone
        rows = [[*stability.product(plant_den, den), *late]]
        for by_gap, by_velocity in ((gap, velocity), (gap_c_y, velocity_c_y)):
            seen = stability.product(plant_gap, by_gap)
            moved = stability.product(plant_velocity, by_velocity)
            both = [a + b for a, b in zip(seen, moved, strict=True)]
            rows.append([zero] * (len(rows[0]) - len(both)) + both)
        return rows


@cache
def parts(method: Method, controller: Controller, split: bool) -> Parts:
    """Return the programs of a sampled loop."""
    law = programs.law(controller)
    plant, own = robustness.sampled_parts(law, method, split=split)
    return Parts(
        _lowered((p.T, *law.gains), own),
        _lowered((p.C_Y_true, p.T, stability.first_part), plant),
        (len(plant[0]), len(plant[1]), len(plant[2])),
    )


def _lowered(inputs: Sequence[Symbol], groups: Sequence[Sequence[sp.Expr]]) -> Program:
    """Lower expressions all of whose constants are doubles: none may be rounded on the way."""
    outputs = derived.named(**dict(zip("abcde", groups, strict=False)))
    constants = {q for x in outputs.values() for q in sp.sympify(x).atoms(sp.Rational)}
    if any(Fraction(float(q)) != Fraction(q) for q in constants):
        raise ArithmeticError("a constant of the pencil is no double; it would be rounded")
    return lower(inputs, outputs)


@dataclass(frozen=True)
class Affine:
    """Coefficients alpha_i + beta_i v of a polynomial in w, highest power first, enclosed.

    Numbers where the gap is one; series in C_Y' over a range of gaps.
    """

    alpha: tuple[Any, ...]
    beta: tuple[Any, ...]

    def at(self, v: Any) -> list[Any]:
        """Return the coefficients at a number v."""
        return [a + b * v for a, b in zip(self.alpha, self.beta, strict=True)]


def enclose(loop: Setting, when: ExactTiming, gap: Fraction) -> Affine:
    """Return the polynomial in w of v chi at one gap [m]."""
    series = expand(loop, when, number(loop.coefficient(gap)), 0)
    return Affine(tuple(x[0] for x in series.alpha), tuple(x[0] for x in series.beta))


def expand(loop: Setting, when: ExactTiming, at: arb, order: int) -> Affine:
    """Return the polynomial in w of v chi as series in C_Y' at an enclosed C_Y'."""
    true = variable(at, order)
    made = parts(loop.method, loop.controller, when.part > 0)
    period, part, *gains = map(number, (when.period, when.part, *loop.gains))
    law = made.law.evaluate(OPERATORS, period, *gains, constant=arb)
    plant = made.plant.evaluate(OPERATORS, true, period, part, constant=arb)
    rows = made.pencil(law, plant, 0 * true, when.whole)
    fixed, gain, gain_c_y = ([x + 0 * true for x in row] for row in rows)
    shape, seen = loop.shape_at(true, number), number(loop.C_Y_hat)
    alpha = [shape * (a + seen * b) for a, b in zip(gain, gain_c_y, strict=True)]
    return Affine(_in_w(alpha), _in_w(fixed))


def _in_w(coefficients: Sequence[arb_series]) -> tuple[arb_series, ...]:
    """Return (1 - w)^n p((1 + w)/(1 - w)) of p(z), highest power first."""
    rows = _bilinear(len(coefficients) - 1)
    zero = 0 * coefficients[0]
    return tuple(sum(map(mul, coefficients, row), start=zero) for row in rows)


@cache
def _bilinear(degree: int) -> tuple[tuple[int, ...], ...]:
    """Return what z^n, n falling, gives to w^k, k falling: coefficients of (1+w)^n (1-w)^(N-n)."""
    return tuple(
        tuple(
            sum(
                comb(n, j) * comb(degree - n, k - j) * (-1) ** (k - j)
                for j in range(max(0, k - degree + n), min(n, k) + 1)
            )
            for n in range(degree, -1, -1)
        )
        for k in range(degree, -1, -1)
    )
