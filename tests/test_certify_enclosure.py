from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from mpmath import mp
from rigs import OFFSET, SHORT, rig_with

from maglev_design.certification.lyapunov import enclosure
from maglev_design.certification.lyapunov.enclosure import UNIT, Series, control_points, enclose
from maglev_design.certification.lyapunov.family import (
    CertificateClaim,
    ExactSubject,
    LoopName,
    NotEnclosedError,
    claim,
    scaling,
    subject,
)
from maglev_design.certification.rationals import root
from maglev_design.controller.design import PoleSpec, make_design
from maglev_design.errors import InputError
from maglev_design.options import TAN_GPI, Method
from maglev_design.programs import derived
from maglev_design.rig import Rig, load_rig
from maglev_design.symbolic import closed_loop as cl
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.stability import first_part

DIGITS = 60
"""Of mpmath: far finer than the remainders, which are between 2^-63 and 2^-50."""
PAPER = load_rig("belmonte2021")
GAINS = (p.k0, p.k1, p.k2, p.k3)


def subject_of(rig: Rig, poles: tuple[float, float] = (1.0, 70.0), **options: Any) -> ExactSubject:
    return subject(make_design(rig, PoleSpec.double(*poles), **options), rig)


def at_period(of: ExactSubject, period: Fraction, delay: Fraction) -> ExactSubject:
    return replace(of, numbers={**of.numbers, "period": float(period)}, delay=delay)


def wide(x: Fraction) -> Any:
    return mp.mpf(x.numerator) / x.denominator


def value(expression: Any, numbers: dict[Any, Any]) -> Any:
    return sp.lambdify(list(numbers), expression, "mpmath")(*numbers.values())


@cache
def symbolic(loop: LoopName, method: Method, whole: int, partial: bool) -> Any:
    if loop == "continuous":
        return cl.continuous_matrix()
    return cl.sampled_matrix(method, whole, partial=partial)


def member(
    of: ExactSubject, over: CertificateClaim, gap: Fraction, ratio: Fraction
) -> tuple[Any, Any, Any]:
    """Return one member's scaled matrix, from the closed forms to DIGITS digits, its m and q."""
    at = cl.at_design_gap()
    _, coefficients = derived.core(of.method, TAN_GPI)
    known = {
        p.g: of.gravity,
        p.beta_c: of.beta,
        p.y0: of.gap_offset,
        p.Y: of.gap,
        p.C_U_hat: of.C_U_hat,
        p.C_Y_hat: of.C_Y_hat,
        p.y: gap,
        cl.ratio: ratio,
        p.T: of.period,
        first_part: of.when.part,
        **dict(zip(GAINS, of.gains, strict=True)),
        **dict(zip(coefficients, of.coefficients, strict=True)),
    }
    numbers = {symbol: wide(x) for symbol, x in known.items()}
    numbers[cl.m_gain] = mp.sqrt(value(at.gain_squared, numbers))
    numbers[cl.C_Y_rest] = value(at.C_Y, numbers)
    numbers[cl.q] = value(at.fall, numbers)
    numbers[p.rho] = numbers[cl.m_gain] * numbers[cl.q]
    numbers[p.C_Y_true] = numbers[cl.C_Y_rest] * numbers[cl.q]
    numbers |= {symbol: value(x, numbers) for symbol, x in cl.HOLD.items()}
    matrix = symbolic(over.loop, of.method, of.when.whole, of.when.part > 0)
    scale = mp.diag([wide(x) for x in scaling(of, over.loop)])
    return scale * value(matrix, numbers) * scale**-1, numbers[cl.m_gain], numbers[cl.q]


@pytest.mark.parametrize(
    ("loop", "rig", "options"),
    [
        ("continuous", PAPER, {}),
        ("continuous", rig_with(SHORT, {"operating_point.voltage": 2.2}), {}),
        ("sampled", PAPER, {}),
        ("sampled", load_rig("quanser-maglev"), {"method": "euler"}),
        ("sampled", rig_with(SHORT, {"sampling.delay": 0.0007}), {"method": "zoh"}),
        (
            "sampled",
            rig_with(OFFSET, {"sampling.delay": 0.0005}),
            {"equilibrium": "appendix-a", "voltage": 7.5},
        ),
        ("sampled", PAPER, {"equilibrium": "measured", "voltage": 2.1}),
    ],
    ids=["c", "c-volts", "tustin", "euler", "zoh-late", "appendix-late", "measured"],
)
def test_every_member_is_in_the_polytope_up_to_the_remainder(
    loop: LoopName, rig: Rig, options: Any
) -> None:
    of, over = subject_of(rig, **options), claim(rig, loop, Fraction(1, 5))
    around = enclose(of, over, scaling(of, loop))
    generator = np.random.default_rng(7)
    with mp.workdps(DIGITS):
        weak, strong = (wide(m) for m in enclosure._gain_ends(of, over.ratios))
        q_2, q_1 = (wide(enclosure._point(of, gap).fall) for gap in over.gaps)
        columns = 2
        vertices = [
            mp.matrix([[wide(x) for x in row] for row in vertex]) for vertex in around.vertices
        ]
        degree = len(vertices) // columns - 1
        shares = [(0, 0), (1000, 1000), *generator.integers(0, 1001, (2, 2)).tolist()]
        for t, s in ((Fraction(a, 1000), Fraction(b, 1000)) for a, b in shares):
            gap = over.gaps[0] + t * (over.gaps[1] - over.gaps[0])
            ratio = over.ratios[0] + s * (over.ratios[1] - over.ratios[0])
            true, m, q = member(of, over, gap, ratio)
            x, y = (q - q_1) / (q_2 - q_1), (m - weak) / (strong - weak)
            assert max(-x, x - 1, -y, y - 1) < mp.mpf(10) ** (5 - DIGITS)
            hull = mp.zeros(len(true))
            for i in range(degree + 1):
                share = math.comb(degree, i) * x**i * (1 - x) ** (degree - i)
                for j in range(columns):
                    hull += share * ((1 - y), y)[j] * vertices[columns * i + j]
            assert mp.mnorm(true - hull, "f") <= wide(around.remainder)
            assert wide(around.remainder) < mp.mpf(2) ** -45


def test_the_box_of_both_coefficients_is_not_the_family() -> None:
    """Its corner of smallest gain and largest C_Y' is unstable where every member is stable."""
    of = subject_of(PAPER, (1.0, 30.0))
    over = claim(PAPER, "continuous", Fraction(15, 100))
    around = enclose(of, over, scaling(of, "continuous"))

    def slowest(matrix: Any) -> float:
        return float(np.linalg.eigvals(np.array(matrix, dtype=float)).real.max())

    assert max(slowest(vertex) for vertex in around.vertices) < 0
    program = enclosure._continuous_program()
    rest, q = enclosure._point(of).C_Y, enclosure._point(of, over.gaps[0]).fall
    corner = program.exact(1 / root(over.ratios[1], UNIT)[1], rest * q, rest, *of.gains)
    assert slowest(np.array(corner, dtype=float).reshape(4, 4)) > 0


@pytest.mark.parametrize("time", [Fraction(1, 1000), Fraction(1, 25)])
@pytest.mark.parametrize("part", [Fraction(0), Fraction(2, 5)])
def test_what_the_series_lack_is_within_their_error(time: Fraction, part: Fraction) -> None:
    of = at_period(subject_of(PAPER), time, part * time)
    q_max = Fraction(21, 10)
    found = enclosure.hold_series(of, q_max)
    with mp.workdps(DIGITS):
        for q in (Fraction(1, 3), Fraction(1), q_max):
            numbers = {
                cl.q: wide(q),
                cl.C_Y_rest: wide(enclosure._point(of).C_Y),
                p.T: wide(of.period),
                first_part: wide(of.when.part),
            }
            for series, exact in zip(found, cl.HOLD.values(), strict=True):
                cut = sum((c * q**k for k, c in enumerate(series.coefficients)), Fraction(0))
                assert abs(wide(cut) - value(exact, numbers)) <= wide(series.error)
                assert series.error <= time / 2**40


def test_control_points_are_of_the_same_polynomial() -> None:
    series = Series((Fraction(3), Fraction(-2), Fraction(5), Fraction(7)), Fraction(0))
    low, high = Fraction(1, 3), Fraction(5, 4)
    for degree in (3, 5):
        points = control_points(series, (low, high), degree)
        for t in (Fraction(0), Fraction(2, 7), Fraction(1)):
            q = low + (high - low) * t
            bernstein = [
                math.comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)
            ]
            average = sum((b * f for b, f in zip(bernstein, points, strict=True)), Fraction(0))
            assert average == sum(
                (c * q**k for k, c in enumerate(series.coefficients)), Fraction(0)
            )


def test_a_single_member_has_a_single_vertex() -> None:
    of, gap = subject_of(PAPER), 0.02
    for loop in ("continuous", "sampled"):
        over = claim(PAPER, loop, Fraction(0), (gap, gap))
        assert len(enclose(of, over, scaling(of, loop)).vertices) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gaps": (Fraction(0), Fraction(1))}, "gap range"),
        ({"gaps": (Fraction(2, 100), Fraction(1, 100))}, "gap range"),
        ({"ratios": (Fraction(0), Fraction(2))}, "ratios"),
        ({"ratios": (Fraction(2), Fraction(1))}, "ratios"),
    ],
)
def test_an_impossible_family_is_refused(changes: Any, message: str) -> None:
    of = subject_of(PAPER)
    over = replace(claim(PAPER, "continuous", Fraction(1, 10)), **changes)
    with pytest.raises(InputError, match=message):
        enclose(of, over, scaling(of, "continuous"))


def test_what_cannot_be_enclosed_says_so() -> None:
    slow = at_period(subject_of(PAPER), Fraction(5), Fraction(0))
    over = claim(PAPER, "sampled", Fraction(0))
    with pytest.raises(NotEnclosedError, match="period"):
        enclose(slow, over, scaling(slow, "sampled"))
    late = replace(subject_of(PAPER), delay=Fraction(1))
    with pytest.raises(NotEnclosedError, match="12 periods"):
        scaling(late, "sampled")
