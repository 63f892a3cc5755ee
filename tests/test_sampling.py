from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import byhand
import numpy as np
import pytest
import reference
import sympy as sp
from byhand import LAWS, Known
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from maglev_design.lowering import lower
from maglev_design.options import METHODS, Method
from maglev_design.symbolic import laws, sampling
from maglev_design.symbolic import plant as p

Array = NDArray[np.float64]

ROUNDING = 1e-12
EXPONENTIAL = 1e-11
"""scipy's cont2discrete takes a numerical matrix exponential."""
SAME_STEP = 1e-10
"""Relative to the parts that are added; the exponential, and sums in another order."""

HIGH = 5.0
"""[V] Upper limit of the voltage in these tests."""
KNOWN = Known(Y=0.0246, U=2.0825, C_U=9.4213685474, C_Y=797.56097561, beta=1.5e-3, g=9.7, y0=2e-3)
"""What the laws of the runs below believe; any numbers would do."""
PERIOD = 1e-3
POLES = (*reference.POLES, *reference.POLES)

law_names = pytest.mark.parametrize("name", LAWS)
methods = pytest.mark.parametrize("method", METHODS)


@cache
def law_of(name: str) -> laws.ControlLaw:
    return laws.control_law(LAWS[name])


# --- discretisation ------------------------------------------------------------------------

SYMBOLS = (p.C_U, p.C_Y, p.T, p.k0, p.k1, p.k2, p.k3, laws.omega_f)
ALL_GAINS = ("k0", "k1", "k2", "k3", "omega_f")


def matrices(core: laws.StateSpace) -> Callable[..., list[Array]]:
    parts = (core.A, core.B, core.C, core.D)
    run = lower(SYMBOLS, {f"m{n}": x for n, x in enumerate(x for m in parts for x in m)}).scalar()

    def evaluate(*values: float) -> list[Array]:
        flat, result = list(run(*values)), []
        for rows, columns in (m.shape for m in parts):
            result.append(np.array(flat[: rows * columns]).reshape(rows, columns))
            flat = flat[rows * columns :]
        return result

    return evaluate


@cache
def core_of(name: str, method: Method | None) -> Callable[..., list[Array]]:
    core = law_of(name).core
    return matrices(core if method is None else sampling.discretise(core, method))


def numbers_of(name: str, poles: tuple[float, ...]) -> list[float]:
    gains = byhand.gains_of(LAWS[name], poles)
    return [gains.get(gain, math.nan) for gain in ALL_GAINS]


dampings = st.floats(0.2, 3.0)
speeds = st.floats(5.0, 300.0)


@methods
@law_names
@given(
    dampings,
    speeds,
    st.tuples(st.floats(0.5, 50.0), st.floats(50.0, 5000.0)),
    st.floats(1e-4, 5e-3),
)
@settings(max_examples=40)
def test_the_discretisation_is_scipy_s(
    name: str, method: Method, zeta: float, omega: float, pair: tuple[float, float], period: float
) -> None:
    poles = (zeta, omega, 0.7 * zeta + 0.1, 1.3 * omega)
    values = (*pair, period, *numbers_of(name, poles))
    a, b, c, d = core_of(name, None)(*values)
    expected = byhand.sampled((a, b, c, d), period, method)
    for ours, theirs in zip(core_of(name, method)(*values), expected, strict=True):
        scale = np.abs(theirs).max()
        assert ours == pytest.approx(theirs, rel=EXPONENTIAL, abs=EXPONENTIAL * scale)


@law_names
def test_a_law_reads_the_velocity_only_where_it_is_measured(name: str) -> None:
    read = [signal.name for signal in sampling.signals(law_of(name))]
    measured = ["y", "v", "y_ref", "v_ref", "acc_ref"]
    expected = measured if name == "state-feedback" else ["y", "y_ref", "acc_ref"]
    assert read == expected


# --- the step that runs --------------------------------------------------------------------

Step = tuple[list[float], float, float]


@cache
def stepper(name: str, method: Method) -> Callable[..., Step]:
    """Return the step as (states, signals, upper limit) -> (next states, commanded, applied)."""
    law = law_of(name)
    equation = sampling.difference_equation(law, method)
    names = list(equation.coefficients)
    signals = sampling.signals(law)
    inputs = (*law.states, *signals, p.Y, p.U, laws.u_min, laws.u_max, *names)
    outputs = {f"next{n}": x for n, x in enumerate(equation.next_states)}
    outputs |= {"commanded": sampling.commanded, "applied": equation.applied}
    run_step = lower(inputs, outputs, {sampling.commanded: equation.commanded}).scalar()
    known = (*SYMBOLS, p.beta_c, p.g, p.Y, p.y0, laws.u_min, laws.u_max)
    entries = {s.name: x for s, x in equation.coefficients.items()}
    coefficients = lower(known, entries).scalar()
    own = numbers_of(name, POLES)

    def step(states: Sequence[float], sample: dict[str, float], high: float = HIGH) -> Step:
        values = coefficients(
            *(KNOWN.C_U, KNOWN.C_Y, PERIOD, *own),
            *(KNOWN.beta, KNOWN.g, KNOWN.Y, KNOWN.y0, 0.0, high),
        )
        read = [sample[signal.name] for signal in signals]
        *moved, commanded, applied = run_step(*states, *read, KNOWN.Y, KNOWN.U, 0.0, high, *values)
        return moved, commanded, applied

    return step


@cache
def hand(name: str, method: Method | None) -> byhand.Matrices:
    law = LAWS[name]
    core = byhand.core(law, byhand.gains_of(law, POLES), KNOWN.C_U, KNOWN.C_Y)
    return core if method is None else byhand.sampled(core, PERIOD, method)


def sample_of(error: float, y_ref: float = 0.0246, acc: float = 0.0, v: float = 0.0) -> Any:
    return {"y": y_ref + error, "y_ref": y_ref, "acc_ref": acc, "v": v, "v_ref": 0.3 * v}


def heard(sample: dict[str, float]) -> Array:
    """Return (e, e', d) of a sample."""
    speed = sample["v"] - sample["v_ref"]
    return np.array([sample["y"] - sample["y_ref"], speed, sample["y"] - KNOWN.Y])


def states_of(name: str, shares: tuple[float, float]) -> list[float]:
    """Return states whose shares of the correction are `shares` of the span."""
    own = span_of(name, HIGH)
    gains = hand(name, None)[2].ravel()
    return [share * own / gain for share, gain in zip(shares, gains, strict=False)]


def span_of(name: str, high: float) -> float:
    return byhand.span(LAWS[name], 0.0, high, KNOWN)


def size_of(name: str, method: Method | None, states: list[float], read: Array) -> float:
    """Return the size of what is added up to the commanded voltage."""
    _, _, c, d = hand(name, method)
    parts = float((np.abs(c) @ np.abs(states) + np.abs(d) @ np.abs(read)).item())
    if name == "fee-gpi":
        return 1 + math.sqrt(parts)
    return 1 + parts


shares = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
samples = st.builds(
    sample_of,
    st.floats(-5e-3, 5e-3),
    st.floats(0.012, 0.025),
    st.floats(-0.3, 0.3),
    st.floats(-0.2, 0.2),
)


def expected_step(
    name: str, method: Method, states: list[float], sample: dict[str, float]
) -> tuple[list[float], float, bool]:
    """Return (next states, commanded, whether the integrator waits), written out by hand."""
    a, b, c, d = hand(name, method)
    read = heard(sample)
    w = (c @ states + d @ read).item()
    commanded = byhand.command(LAWS[name], w, sample["y_ref"], sample["acc_ref"], KNOWN)
    moved = a @ states + b @ read
    push = c[0, 0] * (moved[0] - states[0])
    waits = (commanded > HIGH and push > 0) or (commanded < 0.0 and push < 0)
    bound = span_of(name, HIGH) / abs(c[0, 0])
    first = states[0] if waits else min(max(float(moved[0]), -bound), bound)
    return [first, *moved[1:].tolist()], commanded, bool(waits)


@methods
@law_names
@given(shares, samples)
def test_the_step_is_the_one_written_by_hand(
    name: str, method: Method, share: tuple[float, float], sample: dict[str, float]
) -> None:
    states = states_of(name, share)
    following, commanded, _ = expected_step(name, method, states, sample)
    size = SAME_STEP * size_of(name, method, states, heard(sample))
    pull = (commanded / (sample["y_ref"] + KNOWN.y0)) ** 2 * KNOWN.beta
    assume(name != "fee-gpi" or pull > 1e-3)  # where the root is steep, rounding is not small
    assume(min(abs(commanded), abs(commanded - HIGH)) > 10 * size)  # who waits is not by rounding
    moved, ours, applied = stepper(name, method)(states, sample)
    assert ours == pytest.approx(commanded, abs=10 * size)
    assert applied == min(max(ours, 0.0), HIGH)
    assert moved == pytest.approx(following, rel=1e-9, abs=SAME_STEP * 1e-3)


@methods
@law_names
@given(
    st.floats(-1e4, 1e4),
    st.floats(-1e4, 1e4),
    st.floats(-10.0, 10.0),
    st.floats(-20.0, 20.0),
    st.floats(-10.0, 10.0),
    st.one_of(st.floats(0.5, 20.0), st.just(math.inf)),
)
@settings(max_examples=60)
def test_the_applied_voltage_never_leaves_its_range(
    name: str,
    method: Method,
    one: float,
    other: float,
    error: float,
    acc: float,
    v: float,
    high: float,
) -> None:
    states = states_of(name, (one, other))
    *_, commanded, applied = stepper(name, method)(states, sample_of(error, 0.02, acc, v), high)
    assert math.isfinite(commanded)
    assert applied == min(max(commanded, 0.0), high)


@methods
@law_names
@pytest.mark.parametrize(("error", "sign"), [(4e-3, 1), (-4e-3, -1)])
def test_an_integrator_waits_while_it_would_push_into_the_clamp(
    name: str, method: Method, error: float, sign: int
) -> None:
    states = [0.0] * len(law_of(name).states)
    (x1, *rest), commanded, applied = stepper(name, method)(states, sample_of(error))
    assert sign * (commanded - applied) > 0, "the clamp is active"
    assert x1 == 0.0
    assert all(sign * x > 0 for x in rest), "the lag goes on"


@methods
@law_names
@pytest.mark.parametrize("sign", [1, -1])
def test_an_integrator_that_pulls_away_from_the_clamp_moves(
    name: str, method: Method, sign: int
) -> None:
    # its own share holds the voltage beyond one end, and the error is to the other side
    states = [0.0] * len(law_of(name).states)
    states[0] = states_of(name, (sign * 0.99, 0.0))[0]
    error = -sign * 1e-6
    (x1, *_), commanded, applied = stepper(name, method)(states, sample_of(error, KNOWN.Y))
    assert sign * (commanded - applied) > 0, "the clamp is active"
    read = sample_of(error, KNOWN.Y)
    assert x1 - states[0] == pytest.approx((read["y"] - KNOWN.Y) * PERIOD, rel=1e-6)


@methods
@law_names
@given(st.floats(-100.0, 100.0), st.floats(-0.05, 0.05))
@settings(max_examples=60)
def test_an_integrator_s_share_of_the_correction_stays_within_the_span(
    name: str, method: Method, share: float, error: float
) -> None:
    states = [0.0] * len(law_of(name).states)
    states[0] = states_of(name, (share, 0.0))[0]
    (following, *_), *_ = stepper(name, method)(states, sample_of(error, 0.02))
    if following != states[0]:  # frozen ones stay where they are
        gain = hand(name, method)[2][0, 0]
        assert abs(gain * following) <= span_of(name, HIGH) * (1 + ROUNDING)


@methods
@law_names
def test_a_run_from_zero_never_leaves_the_span(name: str, method: Method) -> None:
    step, gain = stepper(name, method), hand(name, method)[2][0, 0]
    random = np.random.default_rng(1)
    states, largest, waited = [0.0] * len(law_of(name).states), 0.0, 0
    for k in range(3000):
        error = 2e-3 * math.sin(k / 300) + random.normal(0.0, 1e-4)
        before = states[0]
        states, commanded, _ = step(states, sample_of(error))
        largest = max(largest, abs(gain * states[0]))
        waited += states[0] == before and not 0 <= commanded <= HIGH
    assert largest <= span_of(name, HIGH) * (1 + ROUNDING)
    assert waited > 100, "the clamp was active"


@methods
@law_names
def test_without_an_upper_limit_nothing_is_held_back(name: str, method: Method) -> None:
    states = [0.0] * len(law_of(name).states)
    (x1, *_), commanded, applied = stepper(name, method)(states, sample_of(1e-2), math.inf)
    assert commanded == applied > HIGH
    assert x1 > 0.0


# --- the continuous law --------------------------------------------------------------------


@cache
def flow(name: str) -> Callable[..., tuple[list[float], float]]:
    """Return the continuous law as (states, sample) -> (rates, commanded)."""
    law = law_of(name)
    rates, command = sampling.continuous_equation(law)
    signals = sampling.signals(law)
    inputs = (*law.states, *signals, p.Y, p.U, laws.u_min, laws.u_max, *SYMBOLS[:2])
    outputs = {f"rate{n}": rate for n, rate in enumerate(rates)}
    run_rates = lower(
        (*inputs, *SYMBOLS[3:], p.beta_c, p.g, p.y0),
        outputs | {"commanded": sampling.commanded},
        {sampling.commanded: command},
    ).scalar()
    own = numbers_of(name, POLES)

    def run(
        states: Sequence[float], sample: dict[str, float], high: float = HIGH
    ) -> tuple[list[float], float]:
        read = [sample[signal.name] for signal in signals]
        believed = (KNOWN.Y, KNOWN.U, 0.0, high, KNOWN.C_U, KNOWN.C_Y)
        *moved, commanded = run_rates(
            *states, *read, *believed, *own, KNOWN.beta, KNOWN.g, KNOWN.y0
        )
        return moved, commanded

    return run


@law_names
@given(shares, samples)
def test_the_continuous_law_is_the_one_written_by_hand(
    name: str, share: tuple[float, float], sample: dict[str, float]
) -> None:
    states, read = states_of(name, share), heard(sample)
    a, b, c, d = hand(name, None)
    w = (c @ states + d @ read).item()
    commanded = byhand.command(LAWS[name], w, sample["y_ref"], sample["acc_ref"], KNOWN)
    size = SAME_STEP * size_of(name, None, states, read)
    pull = (commanded / (sample["y_ref"] + KNOWN.y0)) ** 2 * KNOWN.beta
    assume(name != "fee-gpi" or pull > 1e-3)
    assume(min(abs(commanded), abs(commanded - HIGH)) > 10 * size)
    expected = a @ states + b @ read
    push, bound = c[0, 0] * expected[0], span_of(name, HIGH) / c[0, 0]
    if (
        (commanded > HIGH and push > 0)
        or (commanded < 0 and push < 0)
        or (abs(states[0]) > bound and states[0] * expected[0] > 0)
    ):
        expected[0] = 0.0
    rates, ours = flow(name)(states, sample)
    assert ours == pytest.approx(commanded, abs=10 * size)
    assert rates == pytest.approx(expected, rel=1e-9, abs=1e-15)


@law_names
@pytest.mark.parametrize("sign", [1, -1])
def test_the_continuous_integrator_stops_at_the_clamp_and_at_its_bound(
    name: str, sign: int
) -> None:
    run, still = flow(name), [0.0] * len(law_of(name).states)
    (rate, *_), commanded = run(still, sample_of(sign * 4e-3))
    assert sign * commanded > sign * HIGH / 2 + HIGH / 2, "the clamp is active"
    assert rate == 0.0
    # a sample beyond its bound, the voltage held inside the range by the proportional part
    beyond = [states_of(name, (sign * 1.01, 0.0))[0], *still[1:]]
    _, _, c, d = hand(name, None)
    wanted = -c[0, 0] * beyond[0]
    inside = [beyond[0], *[x / c[0, 1] for x in [wanted] if len(still) > 1]]
    outward = sample_of(sign * 1e-7, KNOWN.Y, 0.0, wanted / d[0, 1] / 0.7 if d[0, 1] else 0.0)
    for error, stops in ((outward["y"] - KNOWN.Y, True), (KNOWN.Y - outward["y"], False)):
        sample = outward | {"y": KNOWN.Y + error}
        (rate, *_), commanded = run(inside, sample)
        assert 0 < commanded < HIGH, "the clamp is not active"
        expected = 0.0 if stops else sample["y"] - sample["y_ref"]
        assert rate == pytest.approx(expected, rel=1e-9)


# --- coefficients --------------------------------------------------------------------------


@methods
@law_names
def test_what_does_not_depend_on_the_gains_stays_a_number(name: str, method: Method) -> None:
    equation = sampling.difference_equation(law_of(name), method)
    assert not [x for x in equation.coefficients.values() if sp.sympify(x).is_Integer]
    assert "a11" not in {s.name for s in equation.coefficients}, "an integrator keeps its state"
    assert "x1_max" in {s.name for s in equation.coefficients}


# --- a start without a jump ----------------------------------------------------------------


@cache
def bumpless(method: Method) -> Callable[..., tuple[float, ...]]:
    """Return (error, y_ref, acc, u, coefficients by name) -> the TAN-GPI's states."""
    equation = sampling.difference_equation(law_of("tan-gpi"), method)
    inputs = (*equation.signals, p.u, p.Y, p.U, laws.u_min, laws.u_max, *equation.coefficients)
    start = sampling.bumpless_start(equation)
    known = (*SYMBOLS, p.beta_c, p.g, p.Y, p.y0, laws.u_min, laws.u_max)
    entries = {s.name: x for s, x in equation.coefficients.items()}
    values = lower(known, entries).scalar()(
        *(KNOWN.C_U, KNOWN.C_Y, PERIOD, *numbers_of("tan-gpi", POLES)),
        *(KNOWN.beta, KNOWN.g, KNOWN.Y, KNOWN.y0, 0.0, HIGH),
    )
    run = lower(inputs, {f"start{n}": x for n, x in enumerate(start)}).scalar()
    return lambda y, y_ref, acc, u: run(y, y_ref, acc, u, KNOWN.Y, KNOWN.U, 0.0, HIGH, *values)


@methods
@given(st.floats(-1e-4, 1e-4), st.floats(0.02, 0.026), st.floats(-1.0, 1.0), st.floats(0.5, 4.0))
@settings(max_examples=25)
def test_a_bumpless_start_commands_the_voltage_and_rests(
    method: Method, error: float, y_ref: float, acc: float, u: float
) -> None:
    sample = sample_of(error, y_ref, acc)
    start = bumpless(method)(sample["y"], y_ref, acc, u)
    moved, commanded, _ = stepper("tan-gpi", method)(start, sample)
    assert commanded == pytest.approx(u, rel=SAME_STEP)
    assert moved[1] == pytest.approx(start[1], rel=SAME_STEP, abs=1e-18)


@methods
def test_a_bumpless_start_keeps_the_integrator_s_bound(method: Method) -> None:
    sample = sample_of(0.01)
    start = bumpless(method)(sample["y"], sample["y_ref"], 0.0, 0.0)
    (share, *_) = states_of("tan-gpi", (1.0, 0.0))
    assert abs(start[0]) == pytest.approx(abs(share), rel=SAME_STEP)


def test_a_law_that_is_not_linear_in_its_integrator_has_no_bumpless_start() -> None:
    with pytest.raises(ValueError, match="not linear"):
        sampling.bumpless_start(sampling.difference_equation(law_of("fee-gpi"), "tustin"))
