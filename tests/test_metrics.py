from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad

from maglev_design.lowering import lower
from maglev_design.symbolic import metrics

STEPS = metrics.increments()
RUN = lower(
    (
        metrics.e_start,
        metrics.e_end,
        metrics.slope_start,
        metrics.slope_end,
        metrics.t_start,
        metrics.h,
    ),
    {"ise": STEPS.ise, "iae": STEPS.iae, "itae": STEPS.itae},
    STEPS.definitions,
).scalar()

QUADRATURE = 1e-9
"""Relative; scipy's quad between the sign changes, where the integrand is a polynomial."""
CANCELLING = 1e-13
"""Of the largest error times the length: the primitives are differences."""
NEWTON = 1e-6
"""Relative, for a cubic bent by at most CURVED: two Newton steps leave the root within 1e-4 of h,
and the integral is flat there."""
CURVED = 0.3
"""Bend of a step's cubic as a share of its slope; steps of the loops have some hundredths."""

heights = st.integers(-1000, 1000).map(lambda n: n / 1000)
starts = st.floats(0.0, 10.0)
lengths = st.floats(1e-4, 2.0)


def integrals(
    error: Callable[[float], float], start: float, h: float, breaks: list[float]
) -> tuple[float, float, float]:
    """Return int e^2, int |e| and int t |e| piece by piece."""
    total = np.zeros(3)
    for a, b in zip([0.0, *breaks], [*breaks, h], strict=True):
        for n, f in enumerate(
            (
                lambda t: error(t) ** 2,
                lambda t: abs(error(t)),
                lambda t: (start + t) * abs(error(t)),
            )
        ):
            total[n] += quad(f, a, b, epsabs=0, epsrel=1e-12)[0] if b > a else 0.0
    ise, iae, itae = total
    return float(ise), float(iae), float(itae)


def cubic(coefficients: list[float], h: float) -> tuple[Callable[[float], float], list[float]]:
    """Return e(t) = polynomial in t/h and the roots of it inside the step."""
    roots = np.roots(np.trim_zeros(coefficients, "f")) if any(coefficients[:-1]) else np.array([])
    real = sorted(float(r.real) for r in roots if abs(r.imag) < 1e-9 and 0 < r.real < 1)
    return lambda t: float(np.polyval(coefficients, t / h)), [r * h for r in real]


def ends(coefficients: list[float], h: float) -> tuple[float, float, float, float]:
    slope = np.polyder(np.array(coefficients))
    first, last = (float(x) for x in np.polyval(coefficients, [0.0, 1.0]))
    return first, last, float(np.polyval(slope, 0.0)) / h, float(np.polyval(slope, 1.0)) / h


@given(heights, heights, heights, heights, starts, lengths)
def test_a_cubic_that_keeps_its_sign_is_integrated_exactly(
    a: float, b: float, c: float, d: float, start: float, h: float
) -> None:
    coefficients = [a, b, c, d + math.copysign(abs(a) + abs(b) + abs(c), d)]
    error, roots = cubic(coefficients, h)
    assume(not roots and min(abs(error(0)), abs(error(h))) > 1e-6)
    expected = integrals(error, start, h, [])
    size = max(map(abs, coefficients))
    for value, exact, power in zip(
        RUN(*ends(coefficients, h), start, h), expected, (2, 1, 1), strict=True
    ):
        spread = CANCELLING * size**power * h * (1 + start + h)
        assert value == pytest.approx(exact, rel=QUADRATURE, abs=spread)


@given(
    st.floats(0.02, 0.98),
    st.floats(0.1, 1.0),
    heights.map(lambda x: CURVED * x),
    heights.map(lambda x: CURVED * x),
    starts,
    lengths,
    st.sampled_from([-1.0, 1.0]),
)
def test_a_cubic_that_changes_sign_is_split_where_it_does(
    root: float, slope: float, bend: float, twist: float, start: float, h: float, sign: float
) -> None:
    # (x - root) (slope + bend slope x/2 + twist slope x^2/4): one root, mildly bent
    other = np.array([twist / 4, bend / 2, 1.0]) * slope * sign
    coefficients = [float(x) for x in np.polymul([1.0, -root], other)]
    error, roots = cubic(coefficients, h)
    assert len(roots) == 1
    expected = integrals(error, start, h, roots)
    values = RUN(*ends(coefficients, h), start, h)
    assert values[0] == pytest.approx(expected[0], rel=QUADRATURE)
    assert values[1:] == pytest.approx(expected[1:], rel=NEWTON)


@given(heights, heights, heights, heights, starts, lengths)
def test_the_square_is_exact_whatever_the_signs(
    e0: float, e1: float, v0: float, v1: float, start: float, h: float
) -> None:
    run = RUN(e0, e1, v0 / h, v1 / h, start, h)
    x = np.polynomial.legendre.leggauss(4)  # exact to degree 7
    sigma = (x[0] + 1) / 2
    change = e1 - e0
    values = e0 + sigma * (v0 + sigma * (3 * change - 2 * v0 - v1 + sigma * (v0 + v1 - 2 * change)))
    expected = h * float((x[1] * values**2).sum()) / 2
    assert run[0] == pytest.approx(expected, rel=1e-11, abs=1e-15 * h)
    assert run[1] >= 0
    assert run[2] >= 0


def test_an_error_of_zero_adds_nothing() -> None:
    assert RUN(0.0, 0.0, 0.0, 0.0, 1.0, 0.001) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("first", "last"), [(0.0, 1e-4), (1e-4, 0.0), (0.0, -1e-4), (-1e-4, 0.0)])
def test_an_error_that_starts_or_ends_at_zero_is_whole(first: float, last: float) -> None:
    h = 0.001
    slope = (last - first) / h
    _, iae, itae = RUN(first, last, slope, slope, 0.0, h)
    assert iae == pytest.approx(1e-4 * h / 2, rel=1e-12)
    share = 1 / 3 if last == 0 else 2 / 3
    assert itae == pytest.approx(1e-4 * h / 2 * share * h, rel=1e-12)


def test_the_smallest_errors_that_occur_are_split_too() -> None:
    # a picometre on either side: far below any sensor
    _, iae, _ = RUN(1e-12, -1e-12, -2e-12, -2e-12, 0.0, 1.0)
    assert iae == pytest.approx(5e-13, rel=1e-9)


def test_the_cubic_shares_values_and_slopes_at_both_ends() -> None:
    x = sp.Symbol("x")
    whole = metrics.hermite(x)
    slope = sp.diff(whole, x) / metrics.h
    assert whole.subs(x, 0) == metrics.e_start
    assert sp.expand(whole.subs(x, 1) - metrics.e_end) == 0
    assert sp.expand(slope.subs(x, 0) - metrics.slope_start) == 0
    assert sp.expand(slope.subs(x, 1) - metrics.slope_end) == 0


INTERPOLATION = 720
"""h^5 max|e''''|/INTERPOLATION bounds what a step of IAE misses, as documented."""


@pytest.mark.parametrize("h", [0.3, 0.1, 0.03])
def test_the_interpolation_error_is_within_its_bound(h: float) -> None:
    start, rate = 0.4, 2.0
    first, last = math.exp(rate * start), math.exp(rate * (start + h))
    _, iae, _ = RUN(first, last, rate * first, rate * last, start, h)
    exact = (last - first) / rate
    bound = h**5 / INTERPOLATION * rate**4 * last
    assert abs(iae - exact) <= bound * (1 + 1e-6) + 1e-15
    assert abs(iae - exact) >= bound / 4, "the bound is not idle"
