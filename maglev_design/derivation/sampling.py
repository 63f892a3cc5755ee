"""Steps S1-S5: the law and the plant between two samples."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp
from sympy import Expr, Matrix

from maglev_design.derivation import terms as d
from maglev_design.derivation.control import FOUR
from maglev_design.options import Method
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.gpi import (
    gpi_transfer,
)
from maglev_design.symbolic.laws import (
    tan_gpi,
)
from maglev_design.symbolic.sampling import discretise
from maglev_design.symbolic.stability import first_part, sampled_plant

SAMPLED = "Sampling"
_RATE, _EXP_WHOLE, _EXP_PART = sp.symbols("rate exp_whole exp_part", positive=True)
"""sqrt(C_Y') and the exponentials of half of it times T and T_1, in the proofs of S4 and S5."""


def sampling() -> list[d.Equation]:
    """Return the sampled law under three methods and the sampled plant."""
    core = tan_gpi().core
    continuous = core.transfer(p.s)
    images = {
        "tustin": 2 * (p.z - 1) / (p.T * (p.z + 1)),
        "euler": (p.z - 1) / p.T,
    }

    def sampled(method: Method) -> Expr:
        return discretise(core, method).transfer(p.z)

    return [
        d.proved(
            "S1",
            SAMPLED,
            "Sampled law, bilinear",
            [(d.tustin_w, d.G), (p.s, images["tustin"])],
            "The trapezoidal rule for both states: `G(s)` with this image of `s`, which maps the "
            "left half plane into the unit disk.",
            checks=[sampled("tustin") - continuous.subs(p.s, images["tustin"])],
        ),
        d.proved(
            "S2",
            SAMPLED,
            "Sampled law, forward Euler",
            [(d.euler_w, d.G), (p.s, images["euler"])],
            "Each state moves along its rate for one period: `G(s)` with this image of `s`.",
            checks=[sampled("euler") - continuous.subs(p.s, images["euler"])],
        ),
        _step_invariant(sampled("zoh")),
        _plant_without_delay(),
        _plant_with_delay(),
    ]


def _step_invariant(sampled: Expr) -> d.Equation:
    transfer = gpi_transfer(FOUR)
    through = sp.limit(transfer, p.s, sp.oo)
    integral, lag = (sp.factor(sp.residue(transfer, p.s, at)) for at in (0, -p.k3))
    decay = sp.exp(-p.k3 * p.T)
    # z-transforms of the samples of 1, t and (1 - exp(-k3 t))/k3: the step response of G
    step = p.z / (p.z - 1)
    response = (
        through * step
        + integral * p.T * p.z / (p.z - 1) ** 2
        + lag / p.k3 * (step - p.z / (p.z - decay))
    )
    stated = through + integral * p.T / (p.z - 1) + lag / p.k3 * (1 - decay) / (p.z - decay)
    return d.proved(
        "S3",
        SAMPLED,
        "Sampled law, step-invariant",
        [(d.zoh_w, stated)],
        "Exact for an error held over the period: the samples of the step response of `G(s)`, "
        "divided by the transform of the step.",
        checks=[response / step - stated, p.C_U * sampled - stated],
    )


def _plant_without_delay() -> d.Equation:
    a = sp.sqrt(p.C_Y_true)
    transfer = sampled_plant()
    now = _ratio(transfer.numerator, transfer.denominator).subs(first_part, 0)
    cosh = sp.cosh(a * p.T)
    stated = (cosh - 1) * (p.z + 1) / (p.C_Y_true * (p.z**2 - 2 * cosh * p.z + 1))
    return d.proved(
        "S4",
        SAMPLED,
        "Sampled plant",
        [(d.pulse, -p.C_U_true * stated)],
        "The linear plant at the actual gap behind a zero-order hold, from the matrix "
        "exponential over one period. Its poles are those of the plant, `exp(+-sqrt(C_Y') T)`.",
        checks=[
            _rational(stated - now),
            _rational(stated) - _held_plant().subs(_EXP_PART, 1),
            *(
                _rational(_ratio(transfer.denominator, (sp.Integer(1),)).subs(p.z, root))
                for root in (sp.exp(a * p.T), sp.exp(-a * p.T))
            ),
        ],
    )


def _plant_with_delay() -> d.Equation:
    numerator, denominator = sampled_plant().numerator, sampled_plant().denominator
    return d.proved(
        "S5",
        SAMPLED,
        "Sampled plant with a delay within the period",
        [
            (
                d.pulse,
                -p.C_U_true * _ratio(d.b, (1, -2 * sp.cosh(sp.sqrt(p.C_Y_true) * p.T), 1, 0)),
            ),
            *zip(d.b, numerator, strict=True),
        ],
        "For a time `T_1` the voltage of the sample before still acts: two inputs, the fresh one "
        "and the one kept for a step, both from the matrix exponential.",
        checks=[_held_plant() - _rational(_ratio(numerator, denominator))],
    )


def _ratio(numerator: Sequence[Expr], denominator: Sequence[Expr]) -> Expr:
    over, under = (
        sum(c * p.z ** (len(part) - 1 - n) for n, c in enumerate(part))
        for part in (numerator, denominator)
    )
    return over / under


def _held_plant() -> Expr:
    """Return the sampled plant over -C_U' by matrix exponentials, delay included, in letters."""
    block = Matrix([[0, 1, 0], [p.C_Y_true, 0, 1], [0, 0, 0]])
    motion = (block * p.t).exp()

    def held(duration: Expr) -> Matrix:
        return motion.subs(p.t, duration).applyfunc(_rational)

    fresh, stale, whole = held(p.T - first_part), held(first_part), held(p.T)
    inputs = fresh[:2, 2] + fresh[:2, :2] * stale[:2, 2] / p.z
    pencil = p.z * sp.eye(2) - whole[:2, :2]
    return (pencil.adjugate() * inputs)[0] / pencil.det()


def _rational(expression: Expr) -> Expr:
    """Return `expression` with its exponentials as letters, where cancelling decides."""
    letters = expression.subs(p.C_Y_true, _RATE**2).rewrite(sp.exp)
    halves = {p.T: 2 * sp.log(_EXP_WHOLE) / _RATE, first_part: 2 * sp.log(_EXP_PART) / _RATE}
    return sp.cancel(sp.together(sp.powsimp(sp.expand(letters.subs(halves)))))
