from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_series
from rigs import OFFSET, SHORT, rig_with

from maglev_design import linear_loop as loops
from maglev_design.certification.intervals import sampled_limits
from maglev_design.certification.intervals.arithmetic import OPERATORS, between, number, working
from maglev_design.certification.intervals.jets import coefficients, variable, widened
from maglev_design.certification.intervals.positivity import positive
from maglev_design.certification.intervals.sampled import Setting, enclose, setting
from maglev_design.certification.intervals.sampled_interval import sampled_ratios_at
from maglev_design.certification.intervals.sampled_limits import (
    LimitStatus,
    largest_delay,
    largest_period,
)
from maglev_design.certification.intervals.sampled_path import (
    nominal_quotients,
    proved_over,
    proved_piece,
    sampled_ratios_over,
)
from maglev_design.certification.rationals import decimal
from maglev_design.controller.design import Design, PoleSpec, believed_equilibrium, make_design
from maglev_design.controller.family import Family, family_of
from maglev_design.controller.timing import exact_timing
from maglev_design.options import CONTROLLERS, EQUILIBRIA, METHODS, Controller, Equilibrium, Method
from maglev_design.rig import MOST_DELAYED_PERIODS, Rig, load_rig

PAPER, POLES = load_rig("belmonte2021"), PoleSpec.double(1, 70)
PATH = (0.012, 0.0246)
NEAR = 1e-6
"""Relative distance from an end at which eigenvalues, which lose digits near one, are asked."""
OTHER = rig_with(OFFSET, {"operating_point.voltage": 7.5})
KNOWN = (0.00444, 9.937)
"""Ends at Y of the paper's rig, Tustin, 1 ms; found beforehand by eigenvalues."""


def radius(loop: loops.Loop, gap: float, ratio: float) -> float:
    over = Family((gap, gap), (ratio, ratio))
    return loops.spectral_radius(loop, POLES.values, over).value


def with_delay(delay: float) -> Rig:
    return rig_with(SHORT, {"sampling.delay": delay})


def designed(rig: Rig, reading: Equilibrium = "model", **options: Any) -> Design:
    """The design of a rig that has its voltage measured, by default 3 % off the model's."""
    held = rig.operating_point.voltage or 1.03 * believed_equilibrium(rig, "model").U
    return make_design(rig, POLES, equilibrium=reading, voltage=held, **options)


def model(method: Method = "tustin") -> Setting:
    return setting(PAPER, make_design(PAPER, POLES, method=method))


ONE_MS = exact_timing(Fraction(1, 1000), Fraction(0))


# --- tools ----------------------------------------------------------------------------------


def test_jets_hold_the_taylor_coefficients() -> None:
    at = 2
    x = variable(arb(at), 5)
    root = math.sqrt(at)
    by_hand = {  # derivatives over factorials, from the binomial and exponential series
        "sqrt": [
            root * c / at**n for n, c in enumerate((1, 1 / 2, -1 / 8, 1 / 16, -5 / 128, 7 / 256))
        ],
        "exp": [math.exp(at) / math.factorial(n) for n in range(6)],
        "inverse": [(-1) ** n / at ** (n + 1) for n in range(6)],
        "sinh": [(math.sinh(at), math.cosh(at))[n % 2] / math.factorial(n) for n in range(6)],
    }
    found = {
        "sqrt": OPERATORS["sqrt"](x),
        "exp": OPERATORS["exp"](x / 2 + x / 2),
        "inverse": 1 / x,
        "sinh": OPERATORS["sinh"](x),
    }
    for name, jet in found.items():
        assert [float(t) for t in coefficients(jet)] == pytest.approx(by_hand[name], rel=1e-14), (
            name
        )


@working()
def test_widened_coefficients_hold_those_at_every_point_of_the_range() -> None:
    def series(at: arb, order: int) -> arb_series:
        return variable(at, order).exp()

    whole = between(Fraction(9, 10), Fraction(11, 10))
    wide = widened(series(arb(1), 3), series(whole, 4)[4], whole - 1)
    for point in (Fraction(9, 10), Fraction(97, 100), Fraction(11, 10)):
        exact = series(number(point), 4)
        for inner, outer in zip(coefficients(exact), coefficients(wide), strict=True):
            assert inner in outer


def test_positivity_on_a_square_is_never_claimed_wrongly() -> None:
    random = np.random.default_rng(5)
    side = np.linspace(-1, 1, 41)
    claimed = 0
    for _ in range(300):
        table = random.standard_normal((3, 4))
        table[0, 0] += 4
        values = np.polynomial.polynomial.polygrid2d(side, side, table)
        answer = positive([[(float(c), 0.0) for c in row] for row in table])
        claimed += answer
        assert answer == (values.min() > 0) or abs(values.min()) < 0.05
        assert not (answer and values.min() <= 0)
    assert 50 < claimed < 280
    assert not positive([[(1.0, 1.5)]])
    assert not positive([[(math.nan, 0.0)]])


@working()
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("delay", [0.0, 0.0003, 0.0023])
def test_the_enclosed_polynomial_is_that_of_the_loop(
    method: Method, name: str, delay: float
) -> None:
    rig, controller = with_delay(delay), Controller(name)  # type: ignore[arg-type]
    design = designed(rig, "appendix-a", method=method, controller=controller)
    own = setting(rig, design)
    at = exact_timing(decimal(0.001), decimal(delay))
    affine = enclose(own, at, decimal(0.021))
    v = Fraction((1.25 / float(own.scale)) ** (1 / own.power))
    mine = np.array([float(c) for c in affine.at(number(v))])
    loop = loops.loop_of(rig, design)
    theirs = loop.characteristic(POLES.values, 0.021, 1.25)[0].full().ravel()
    w = 0.3 + 0.4j
    z = (1 + w) / (1 - w)
    degree = len(mine) - 1
    given = np.polyval(theirs, z) * (1 - w) ** (len(theirs) - 1)
    # a pole at zero that cancels is left out of one of the two
    given *= (1 - w) ** (degree - len(theirs) + 1) * z ** (degree - len(theirs) + 1)
    assert np.polyval(mine, w) == pytest.approx(float(v) * given, rel=1e-9)


# --- ends at one gap ------------------------------------------------------------------------


@pytest.mark.parametrize("reading", EQUILIBRIA)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rig", [PAPER, with_delay(0.0013), OTHER], ids=["now", "late", "other"])
def test_eigenvalues_change_sides_at_every_sampled_end(
    rig: Rig, method: Method, reading: Equilibrium
) -> None:
    design, gap = designed(rig, reading, method=method), rig.operating_point.gap
    own = setting(rig, design)
    at = exact_timing(decimal(rig.sampling.period), decimal(rig.sampling.delay))
    found = sampled_ratios_at(own, at, gap)
    loop = loops.loop_of(rig, design)
    for span in found.spans:
        for end, inwards in ((span.lower, 1), (span.upper, -1)):
            if end.low is None or end.high is None or end.value == 0:
                continue
            assert 0 <= end.high - end.low <= end.high / 10**12
            assert radius(loop, gap, end.value * (1 + inwards * NEAR)) < 1
            assert radius(loop, gap, end.value * (1 - inwards * NEAR)) > 1
    for ratio in np.geomspace(1e-3, 1e3, 49):
        inside = any(s.lower.value < ratio < s.upper.value for s in found.spans)
        assert (radius(loop, gap, float(ratio)) < 1) == inside


def test_the_paper_s_rig_has_the_sampled_ends_that_were_found_by_eigenvalues() -> None:
    (span,) = sampled_ratios_at(model(), ONE_MS, 0.0246).spans
    assert (span.lower.value, span.upper.value) == pytest.approx(KNOWN, rel=1e-3)


def test_a_loop_that_is_too_late_has_an_empty_set() -> None:
    late = exact_timing(Fraction(1, 1000), Fraction(1, 100))
    found = sampled_ratios_at(model(), late, 0.0246)
    assert found.spans == ()
    assert found.as_dict(Fraction(1), "model")["lower"] is None


# --- over a range of gaps -------------------------------------------------------------------


def test_a_family_inside_is_proved_and_one_across_an_end_is_not() -> None:
    gaps = (decimal(PATH[0]), decimal(PATH[1]))
    assert proved_over(model(), ONE_MS, gaps, (Fraction(1, 2), Fraction(2)))
    # v = sqrt(ratio); the ends over the path are sqrt(0.0186) and sqrt(9.94)
    assert not proved_over(model(), ONE_MS, gaps, (Fraction(13, 100), Fraction(2)))
    assert not proved_over(model(), ONE_MS, gaps, (Fraction(1, 2), Fraction(316, 100)))
    # exact beta, and gaps beyond the largest
    assert not proved_over(model(), ONE_MS, (decimal(0.012), decimal(0.2)), (Fraction(1),) * 2)


@working()
def test_a_piece_too_wide_to_tell_c_y_from_zero_stays_open() -> None:
    loop = model()
    high = loop.coefficient(decimal(0.0246))
    for low, answer in ((high * Fraction(9, 10), True), (high / 10**12, None)):
        assert proved_piece(loop, ONE_MS, (low, high), nominal_quotients(loop)) is answer


@pytest.mark.parametrize("delay", [0.0, 0.0005])
def test_the_interval_over_the_path_is_that_of_its_worst_gaps(delay: float) -> None:
    rig = rig_with(SHORT, {"reference.end_gap": PATH[0], "sampling.delay": delay})
    design = make_design(rig, POLES, method="tustin")
    at = exact_timing(decimal(0.001), decimal(delay))
    (span,) = sampled_ratios_over(setting(rig, design), at, PATH).spans
    loop = loops.loop_of(rig, design)
    gaps = np.linspace(*PATH, 13)
    for end, inwards in ((span.lower, 1), (span.upper, -1)):
        assert max(radius(loop, float(gap), end.value) for gap in gaps) < 1
        beyond = end.value * (1 - inwards * 1e-4)
        assert max(radius(loop, float(gap), beyond) for gap in gaps) > 1


@pytest.mark.parametrize("method", METHODS[:2])
def test_the_largest_period_and_delay_are_where_eigenvalues_leave_the_circle(
    method: Method,
) -> None:
    period = largest_period(model(method), 0.001, 0.0, PATH)
    delay = largest_delay(model(method), 0.001, 0.0, PATH)
    assert period.status is delay.status is LimitStatus.PROVED
    assert period.unstable is not None
    assert delay.unstable is not None

    def worst(period_s: float, delay_s: float) -> float:
        sampling = {"sampling.period": period_s, "sampling.delay": delay_s}
        rig = rig_with(SHORT, {"reference.end_gap": PATH[0], **sampling})
        loop = loops.loop_of(rig, make_design(rig, POLES, method=method))
        return max(radius(loop, float(gap), 1.0) for gap in np.linspace(*PATH, 7))

    assert worst(period.stable, 0.0) < 1 < worst(period.unstable, 0.0)
    assert worst(0.001, delay.stable) < 1 < worst(0.001, delay.unstable)
    assert period.unstable < 1.0001 * period.stable
    assert delay.unstable < 1.0001 * delay.stable


def test_a_loop_unstable_as_it_stands_has_its_largest_period_below_it() -> None:
    slow = largest_period(model(), 0.02, 0.0, PATH)
    fast = largest_period(model(), 0.001, 0.0, PATH)
    assert slow.status is fast.status is LimitStatus.PROVED
    assert slow.stable == pytest.approx(fast.stable, rel=1e-5)
    late = largest_delay(model(), 0.02, 0.0, PATH)
    assert late.status is LimitStatus.UNSTABLE
    assert late.value is None


def test_no_period_is_looked_at_that_no_rig_with_the_delay_may_have(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The case of a rig at 10 ms with one period of delay; the search took more than minutes."""
    seen: list[int] = []
    asked = sampled_limits.radii

    def radii(loop: Setting, when: Any, gaps: Any) -> Any:
        seen.append(when.whole)
        return asked(loop, when, gaps)

    monkeypatch.setattr(sampled_limits, "radii", radii)
    found = largest_period(model(), 0.01, 0.02, PATH)
    assert MOST_DELAYED_PERIODS - 1 <= max(seen) <= MOST_DELAYED_PERIODS  # to rounding
    assert found.status is LimitStatus.UNSTABLE
    assert found.value is None
    assert found.unstable == 0.02 / MOST_DELAYED_PERIODS


def test_a_search_that_gives_up_says_so_and_keeps_what_it_proved() -> None:
    """Many remembered voltages: eigenvalues find the crossing, a proof would take minutes."""
    rig = rig_with(SHORT, {"plant.gravity": 1.62, "sampling.delay": 0.0005})
    design = make_design(rig, PoleSpec.double(1.0, 20.0), method="zoh")
    gaps = family_of(rig).gaps
    found = largest_delay(setting(rig, design), 0.001, 0.0005, gaps)
    assert found.status is LimitStatus.GAVE_UP
    assert found.unstable is not None

    def worst(delay: float) -> float:
        late = rig_with(SHORT, {"plant.gravity": 1.62, "sampling.delay": delay})
        loop = loops.loop_of(late, design)
        return max(radius(loop, float(gap), 1.0) for gap in np.linspace(*gaps, 7))

    assert found.stable > 0.002
    assert worst(found.stable) < 1
    assert worst(found.unstable * (1 - 1e-4)) < 1 < worst(found.unstable)


def test_no_end_within_the_longest_delay_looked_at_is_no_end_at_infinity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sampled_limits, "MOST_DELAYED_PERIODS", 3)
    found = largest_delay(model(), 0.001, 0.0, PATH)
    assert found.status is LimitStatus.BEYOND
    assert found.value == pytest.approx(0.0029)  # the last of the grid
    assert found.unstable is None
