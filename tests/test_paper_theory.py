"""The claims that mathematics decides: recomputed another way, and able to come out otherwise."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from inspect import signature
from math import comb

import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import TransferFunction, cont2discrete, lsim, residue

from maglev_design.controller import design
from maglev_design.controller.plant import (
    path_gaps,
)
from maglev_design.derivation import terms as d
from maglev_design.files import finite
from maglev_design.options import EQUILIBRIA, Equilibrium, Method
from maglev_design.paper import (
    theory_appendix,
    theory_disturbances,
    theory_law,
    theory_path,
    theory_stability,
)
from maglev_design.paper.ledger import JUDGES, Claim, Verdict, statements
from maglev_design.paper.printed import residual_is_zero
from maglev_design.paper.rigs import random_rigs
from maglev_design.paper.theory_linear import (
    LinearLoop,
    TriedRig,
    is_stable,
    linear_loop,
    tried_rigs,
)
from maglev_design.paper.theory_path import largest_periods
from maglev_design.paper.theory_stability import boundary, ratio_interval
from maglev_design.rig import Rig, make_rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import stability

Array = NDArray[np.float64]

VERDICTS: dict[str, Verdict] = {
    "abstract-controllable": "verified",
    "2.2-unstable": "verified",
    "2.2-any-equilibrium": "verified",
    "2.3-flat": "verified",
    "2.3-local": "verified",
    "abstract-cascade": "verified",
    "6-flat-by-controllability": "verified",
    "3.1-dynamics": "verified",
    "3.1-velocity": "verified",
    "3.1-filter": "contradicted",
    "1-pid-precluded": "contradicted",
    "1-analogue": "corrected",
    "3.2-initial-velocity": "verified",
    "3.2-origin": "corrected",
    "3.2-reconstruction": "corrected",
    "3.2-constant": "verified",
    "3.2-ramp": "corrected",
    "3-classical-disturbances": "verified",
    "4-voltage": "verified",
    "4-gains": "verified",
    "4-haykin": "not-checkable",
    "5.2-haykin": "not-checkable",
    "4-bezier-order": "verified",
    "4-bezier-smooth": "verified",
    "4-bezier-monotone": "verified",
    "2.4-rest-to-rest": "verified",
    "4.1-initial-error": "not-checkable",
    "A-ratios": "corrected",
    "A-gammas": "corrected",
    "A-routh": "verified",
    "A-second-condition": "verified",
    "A-positive-gains": "corrected",
    "A-mu-positive": "verified",
    "A-bound": "corrected",
    "A-range": "corrected",
    "A-bounded": "verified",
    "A-limit": "verified",
    "A-interval": "corrected",
    "A-sampled": "corrected",
    "6-locally-stable": "verified",
    "6-practical": "not-checkable",
    "abstract-any-point": "verified",
}
SAMPLED_EDGE = 2e-3
"""Relative distance from a boundary found by bisection to 1e-5 at which stability is asked."""
REJECTED = ("3.2-reconstruction", "3.2-constant", "3.2-ramp", "3-classical-disturbances")
"""Claims on what is rejected."""
CACHED = (
    theory_law.pid_of_gpi,
    theory_disturbances.error_of_disturbance,
    theory_stability.error_of_speed,
    theory_stability.exact_beta_margin,
    theory_stability.largest_ratio,
)


@pytest.fixture(scope="module")
def tried(paper_rig: Rig) -> tuple[TriedRig, ...]:
    return tried_rigs(paper_rig, random_rigs(6, 17))


@pytest.fixture(scope="module")
def claims(paper_claims: tuple[Claim, ...]) -> dict[str, Claim]:
    return {claim.id: claim for claim in paper_claims if claim.id in VERDICTS}


@pytest.fixture
def fresh() -> Iterator[None]:
    """Symbolic results computed anew, before and after something was put in their place."""
    for function in CACHED:
        function.cache_clear()
    yield
    for function in CACHED:
        function.cache_clear()


def number(claim: Claim, name: str) -> float:
    value = claim.values[name]
    assert isinstance(value, int | float)
    return float(value)


def test_every_statement_has_one_judge_who_asks_for_known_grounds() -> None:
    assert set(JUDGES) == set(statements())
    for judge in JUDGES.values():
        needs = set(signature(judge.gather).parameters)
        assert needs <= {"tried", "case", "rows", "rig", "seed"}


def test_every_claim_has_the_verdict_found_by_hand(claims: dict[str, Claim]) -> None:
    assert {name: claim.verdict for name, claim in claims.items()} == VERDICTS


def test_a_correction_is_there_exactly_where_one_is_needed(claims: dict[str, Claim]) -> None:
    for claim in claims.values():
        assert bool(claim.correction) == (claim.verdict == "corrected"), claim.id
        assert claim.command.startswith("maglev-design ")
        assert claim.statement.endswith(".")
        assert claim.evidence.endswith(".")
        assert not re.search(r"\bnan\b", claim.evidence)


def test_the_claims_go_into_json(claims: dict[str, Claim]) -> None:
    text = json.dumps(finite(list(claims.values())), allow_nan=False)
    assert "A-sampled" in text


def test_every_rig_agrees_where_rigs_were_tried(claims: dict[str, Claim]) -> None:
    counted = [claim for claim in claims.values() if "rigs" in claim.values]
    assert len(counted) >= 20
    for claim in counted:
        assert claim.values["rigs"] == claim.values["agreed"] == 7, claim.id


def test_it_does_not_need_other_rigs(paper_rig: Rig) -> None:
    (alone,) = tried_rigs(paper_rig, ())
    assert alone.poles == design.PoleSpec.double(1, 70)
    for name in REJECTED:
        assert JUDGES[name]((alone,)).verdict == VERDICTS[name]


def test_a_measured_voltage_is_left_aside(paper_rig: Rig) -> None:
    data = paper_rig.model_dump(exclude_none=True)
    data["operating_point"]["voltage"] = 2.2
    (case,) = tried_rigs(make_rig(data), ())
    assert case.rig == paper_rig
    assert theory_appendix._ratios([case]).values["agreed"] == 1


# the law


def test_the_pid_of_the_law_by_partial_fractions(claims: dict[str, Claim]) -> None:
    k0, k1, k2, k3 = 70.0**4, 4 * 70.0**3, 6 * 70.0**2, 280.0
    c_y = 2 * 9.81 / 0.0246
    c_u = 2 * 9.81 / (math.sqrt(9.81 / 0.0013688398828125) * 0.0246)
    shares, poles, through = residue([k2 + c_y, k1 + k3 * c_y, k0], [1, k3, 0])
    lag, integral = (shares[int(np.argmin(np.abs(poles - at)))].real for at in (-k3, 0.0))
    # K_d s/(1 + s/N) = K_d N - K_d N^2/(s + N)
    claim = claims["3.1-filter"]
    assert number(claim, "Kd") == pytest.approx(-lag / k3**2 / c_u, rel=1e-9)
    assert number(claim, "Ki") == pytest.approx(integral / c_u, rel=1e-9)
    assert number(claim, "Kp") == pytest.approx((through[0] + lag / k3) / c_u, rel=1e-9)
    assert number(claim, "filter_pole") == k3


@pytest.mark.usefixtures("fresh")
def test_a_law_that_is_no_pid_would_keep_its_claim(
    tried: tuple[TriedRig, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A remainder alone or numbers alone decide nothing; both together do."""
    right = theory_law.pid_numbers

    def wrong(loop: LinearLoop) -> tuple[float, float, float, float]:
        kp, ki, kd, pole = right(loop)
        return kp, ki, kd * 1.001, pole

    def verdict() -> Claim:
        return JUDGES["3.1-filter"](tried[:2])

    monkeypatch.setattr(theory_law, "pid_numbers", wrong)
    assert verdict().values["agreed"] == 0
    assert verdict().verdict == "not-checkable"
    monkeypatch.setattr(theory_law, "pid_residual", lambda: 1 / p.s)
    assert verdict().verdict == "verified"


def test_the_integrals_of_the_printed_law_run_away(
    claims: dict[str, Claim], paper_rig: Rig
) -> None:
    """The law (20) line by line in the time domain, on the linear plant, held at 12 mm."""
    loop = linear_loop(tried_rigs(paper_rig, ())[0])
    k0, k1, k2, k3 = loop.gains
    step = 0.0120 - 0.0246

    def rates(_: float, state: Array) -> list[float]:
        y, v, int_u, int_y, int_e, iint_e = state
        e = y - step
        v_hat = -loop.c_u * int_u + loop.c_y * int_y
        star = loop.c_y * step / loop.c_u
        u = star - (-k3 * v_hat - (k2 + loop.c_y) * e - k1 * int_e - k0 * iint_e) / loop.c_u
        return [v, -loop.c_u * u + loop.c_y * y, u, y, e, int_e]

    run = solve_ivp(rates, (0, 1.2), [0.0] * 6, method="LSODA", rtol=1e-9, atol=1e-13)
    after = run.y[:, -1]
    moving = rates(0.0, after)
    assert after[0] == pytest.approx(step, rel=1e-6)
    claim = claims["3.2-origin"]
    assert moving[2] == pytest.approx(number(claim, "voltage_drift"), rel=1e-5)
    assert moving[3] == pytest.approx(number(claim, "gap_drift"), rel=1e-6)
    assert number(claim, "gap_drift") == pytest.approx(step, rel=1e-9)


def test_a_printed_law_without_hidden_integrators_would_be_verified(
    tried: tuple[TriedRig, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(theory_law, "hold_drift", lambda *_: (0.0, 0.0, 0.0))
    assert theory_law._origin(tried[:1]).verdict == "not-checkable"
    right = residual_is_zero
    monkeypatch.setattr(
        theory_law, "residual_is_zero", lambda *ids: "20-hidden" not in ids and right(*ids)
    )
    assert theory_law._origin(tried[:1]).verdict == "verified"
    assert theory_law._analogue(tried[:1]).verdict == "verified"


# disturbances


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_disturbances_by_another_simulator(claims: dict[str, Claim], degree: int) -> None:
    """SciPy's lsim on the transfer function of the error, poles scaled to one."""
    gains = [1.0, 4.0, 6.0, 4.0, 1.0]  # (s + 1)^4: time in 1/70 s
    system = TransferFunction([1.0, 4.0, 0.0], gains)
    times = np.linspace(0, 60, 6001)
    push = times**degree / math.factorial(degree)
    _, error, _ = lsim(system, push, times)
    rate = (error[-1] - error[-101]) / (times[-1] - times[-101])
    scale = 70.0**3  # k3/k0 is 4 in these units
    if degree == 0:
        assert abs(error[-1]) < 1e-9
        assert claims["3.2-constant"].values["lasting_error"] == "0"
    elif degree == 1:
        assert error[-1] / scale == pytest.approx(
            number(claims["3.2-ramp"], "error_per_slope"), rel=1e-6
        )
    else:
        assert rate / scale == pytest.approx(
            number(claims["3-classical-disturbances"], "growth_per_m_s4"), rel=1e-6
        )


def test_only_a_measured_ramp_is_rejected() -> None:
    measured = theory_disturbances.error_when_measured()
    unseen = -p.C_U * theory_disturbances.error_of_disturbance()
    assert theory_disturbances.lasting(measured, 1) == 0
    assert theory_disturbances.lasting(measured, 2) == -p.C_U / p.k0
    assert sp.simplify(theory_disturbances.lasting(unseen, 1) + p.C_U * p.k3 / p.k0) == 0


def test_a_simulation_that_disagrees_changes_the_verdict(
    tried: tuple[TriedRig, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    right = theory_disturbances.simulated

    def off(case: TriedRig, degree: int) -> tuple[float, float]:
        error, rate = right(case, degree)
        return 1.01 * error + 1e-6, 1.01 * rate

    monkeypatch.setattr(theory_disturbances, "simulated", off)
    for name in REJECTED[1:]:
        found = JUDGES[name](tried[:2])
        assert found.verdict == "contradicted", name
        assert found.values["agreed"] == 0


@pytest.mark.usefixtures("fresh")
def test_a_law_with_a_third_integral_would_reject_the_ramp(
    monkeypatch: pytest.MonkeyPatch, tried: tuple[TriedRig, ...]
) -> None:
    fifth = theory_disturbances.error_of_disturbance(5)
    monkeypatch.setattr(theory_disturbances, "error_of_disturbance", lambda *_: fifth)
    monkeypatch.setattr(theory_disturbances, "simulated", lambda *_: (0.0, 0.0))
    assert JUDGES["3.2-ramp"](tried[:1]).verdict == "verified"


def test_reconstruction_by_integration_in_time(claims: dict[str, Claim], paper_rig: Rig) -> None:
    """The error of (18) along any voltage, the plant pushed by 1 % of g and its beta wrong."""
    case = tried_rigs(paper_rig, ())[0]
    loop = linear_loop(case, ratio=theory_disturbances.WRONG)
    push, v_0 = 0.01 * 9.81, 0.03

    def rates(t: float, state: Array) -> list[float]:
        y, v, *_ = state
        u = 0.2 * math.sin(9 * t) + 0.1
        known = -loop.c_u_hat * u + loop.c_y_hat * y
        return [v, -loop.c_u * u + loop.c_y * y + push, known, u, y]

    run = solve_ivp(rates, (0, 0.1), [0.001, v_0, 0, 0, 0], rtol=1e-11, atol=1e-14)
    _, v, v_hat, int_u, int_y = run.y[:, -1]
    rest = theory_disturbances.reconstruction_error()
    letters = {
        d.v_0: v_0,
        theory_disturbances.PUSHED: 0.1 * push,
        d.int_u: int_u,
        d.int_y: int_y,
        p.C_U: loop.c_u,
        p.C_Y: loop.c_y,
        p.C_U_hat: loop.c_u_hat,
        p.C_Y_hat: loop.c_y_hat,
    }
    assert v - v_hat == pytest.approx(float(rest.subs(letters)), rel=1e-7)
    assert number(claims["3.2-reconstruction"], "drift_disturbed") == pytest.approx(push, rel=1e-6)
    expected = loop.c_y * (math.sqrt(theory_disturbances.WRONG) - 1) * (0.0120 - 0.0246)
    assert number(claims["3.2-reconstruction"], "drift_wrong_beta") == pytest.approx(expected)


def test_the_bound_on_the_error_holds_in_time(claims: dict[str, Claim], paper_rig: Rig) -> None:
    claim = claims["A-bounded"]
    case = tried_rigs(paper_rig, ())[0]
    loop = linear_loop(case, ratio=theory_disturbances.WRONG, reading="appendix-a")
    matrix = loop.bounded
    times = np.linspace(1.0, 6.0, 2001)
    _, _, acceleration = design.reference_path(paper_rig, times)
    push = (1 / theory_disturbances.WRONG - 1) * acceleration
    advance = expm(np.block([[matrix, np.array([[0], [1], [0], [0]])], [np.zeros((1, 5))]]) / 400)
    state, largest = np.zeros(4), 0.0
    for value in push:
        state = advance[:4, :4] @ state + advance[:4, 4] * value
        largest = max(largest, abs(float(state[0])))
    assert 0 < largest < number(claim, "error_bound")
    assert number(claim, "disturbance") == pytest.approx(np.abs(push).max(), rel=1e-3)


# numbers and path


@pytest.mark.parametrize(
    ("name", "value", "claim", "verdict"),
    [
        ("PRINTED_VOLTAGE", "2.0835", "4-voltage", "corrected"),
        ("PRINTED_POLE", -71, "4-gains", "contradicted"),
        ("PRINTED_ORDER", 15, "4-bezier-order", "contradicted"),
    ],
)
def test_another_printed_number_has_another_verdict(
    name: str,
    value: object,
    claim: str,
    verdict: str,
    tried: tuple[TriedRig, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(theory_path, name, value)
    grounds = () if claim == "4-bezier-order" else (tried[0],)
    assert JUDGES[claim](*grounds).verdict == verdict


def test_the_printed_numbers_of_the_path_stand_in_its_statements() -> None:
    said = {name: own.statement for name, own in statements().items()}
    assert f"U = {theory_path.PRINTED_VOLTAGE} V." in said["4-voltage"]
    assert f"at {theory_path.PRINTED_POLE} 1/s." in said["4-gains"]
    assert "zeta_d = {:g} and omega_nd = {:g} rad/s".format(*design.PAPER_POLES) in said["4-gains"]
    assert f"of order {theory_path.PRINTED_ORDER}." in said["4-bezier-order"]
    for section, period in theory_path.PRINTED_PERIODS.items():
        assert f"period of {1e3 * period:g} ms" in said[f"{section}-haykin"]
    assert f"<= {theory_appendix.PRINTED_RANGE[1]:g} beta" in said["A-range"]


def test_the_fastest_and_the_hardest_moment(claims: dict[str, Claim]) -> None:
    claim, tau = claims["2.4-rest-to-rest"], np.linspace(0, 1, 200001)
    slope = 16 * comb(15, 7) * tau**7 * (1 - tau) ** 8
    curvature = np.gradient(slope, tau)
    travel = 0.0120 - 0.0242
    fast, hard = int(np.argmax(slope)), int(np.argmax(np.abs(curvature)))
    assert number(claim, "peak_velocity") == pytest.approx(travel / 5 * slope[fast], rel=1e-8)
    assert number(claim, "peak_velocity_time") == pytest.approx(1 + 5 * tau[fast], abs=1e-4)
    assert number(claim, "peak_acceleration") == pytest.approx(
        travel / 25 * curvature[hard], rel=1e-6
    )
    assert number(claim, "peak_acceleration_time") == pytest.approx(1 + 5 * tau[hard], abs=1e-4)


def test_the_ends_of_the_step_are_counted(claims: dict[str, Claim]) -> None:
    claim = claims["4-bezier-smooth"]
    assert (claim.values["at_start"], claim.values["at_end"]) == (7, 8)
    assert claims["4-bezier-monotone"].values["slope_factor"] == str(16 * comb(15, 7))


def test_the_first_kick_of_the_initial_error(claims: dict[str, Claim]) -> None:
    c_y, u = 2 * 9.81 / 0.0246, math.sqrt(9.81 / 0.0013688398828125)
    kick = (6 * 70**2 + c_y) / (2 * 9.81 / (u * 0.0246)) * 0.0004
    assert number(claims["4.1-initial-error"], "first_voltage") == pytest.approx(u * 0.0242 + kick)


# sampling


def sampled_radius(loop: LinearLoop, period: float, method: Method) -> float:
    """Return the spectral radius with the law discretised by SciPy from its transfer function."""
    k0, k1, k2, k3 = loop.gains
    numerator = np.array([k2 + loop.c_y_hat, k1 + k3 * loop.c_y_hat, k0]) / loop.c_u_hat
    law, under, _ = cont2discrete(
        (numerator, [1.0, k3, 0.0]), period, {"tustin": "bilinear"}.get(method, method)
    )
    held = expm(np.array([[0, 1, 0], [loop.c_y, 0, -loop.c_u], [0, 0, 0]]) * period)
    whole, push = held[:2, :2], held[:2, 2]
    # adj(z I - A) B, first row, highest power first
    plant = np.array([push[0], whole[0, 1] * push[1] - whole[1, 1] * push[0]])
    poles = np.convolve(np.poly(whole), np.ravel(under))
    poles[1:] -= np.convolve(plant, np.ravel(law))  # u = law times e, y = plant times u
    return float(np.abs(np.roots(poles)).max())


@pytest.mark.parametrize("method", ["tustin", "euler", "zoh"])
def test_the_largest_period_by_another_discretisation(
    claims: dict[str, Claim], tried: tuple[TriedRig, ...], method: Method
) -> None:
    case = tried[0]
    limit = number(claims["4-haykin"], f"largest_period_{method}")

    def worst(period: float) -> float:
        loops = [linear_loop(case, gap=float(gap)) for gap in path_gaps(case.rig, 5)]
        return max(sampled_radius(loop, period, method) for loop in loops)

    assert worst((1 - SAMPLED_EDGE) * limit) < 1 < worst((1 + SAMPLED_EDGE) * limit)
    assert claims["5.2-haykin"].values["period"] == 0.002


def test_forward_euler_ends_where_the_filter_does(tried: tuple[TriedRig, ...]) -> None:
    assert largest_periods(tried[0])["euler"] == pytest.approx(2 / 280, rel=1e-5)


@pytest.mark.parametrize("reading", ["model", "appendix-a"])
def test_the_sampled_interval_by_another_discretisation(
    claims: dict[str, Claim], tried: tuple[TriedRig, ...], reading: Equilibrium
) -> None:
    case = tried[0]
    for end, outwards in (("lower", -1), ("upper", 1)):
        ratio = number(claims["A-sampled"], f"{end}_at_Y, {reading}")
        radii = [
            sampled_radius(
                linear_loop(case, ratio=ratio * (1 + side * SAMPLED_EDGE), reading=reading),
                case.rig.sampling.period,
                case.rig.sampling.method,
            )
            for side in (-outwards, outwards)
        ]
        assert radii[0] < 1 < radii[1]


def test_a_faster_sampled_loop_comes_close_to_the_continuous_one(
    tried: tuple[TriedRig, ...],
) -> None:
    rig = tried[0].rig
    data = rig.model_dump(exclude_none=True)
    data["sampling"]["period"] = 2e-5
    quick = TriedRig(rig.model_validate(data), tried[0].poles)
    gap = rig.operating_point.gap
    low, high = ratio_interval(quick, "appendix-a", (gap, gap))
    slow, _ = ratio_interval(tried[0], "appendix-a", (gap, gap))
    assert high == pytest.approx(5, rel=2e-2)
    assert low < slow / 10


def test_a_boundary_is_found_from_inside() -> None:
    assert boundary(lambda x: x < 7.0, 1.0, 100.0) == pytest.approx(7.0, rel=1e-4)
    assert boundary(lambda x: x > 0.3, 1.0, 0.01) == pytest.approx(0.3, rel=1e-4)
    assert boundary(lambda x: x > 0, 1.0, 50.0) == 50.0
    assert math.isnan(boundary(lambda x: x < 0, 1.0, 50.0))


# Appendix A


def hand_made_loop(
    rig: Rig, poles: design.PoleSpec, reading: Equilibrium, gap: float, ratio: float
) -> Array:
    """Return the loop's polynomial from the definitions, nothing of the package but the rig."""
    plant, own = rig.plant, rig.operating_point.gap + rig.plant.gap_offset
    beta = plant.force_constant * rig.current_gain**2 / plant.mass
    beta_c, g = ratio * beta, plant.gravity
    zeta, speed = poles.first
    pair = [1, 2 * zeta * speed, speed**2]
    _, k3, k2, k1, k0 = np.convolve(pair, pair)
    true_u, own_u = math.sqrt(g / beta) * own, math.sqrt(g / beta_c) * own
    hats = {
        "model": (2 * g / own_u, 2 * g / own),
        "appendix-a": (2 * beta_c * true_u / own**2, 2 * beta_c * true_u**2 / own**3),
        "measured": (2 * g / true_u, 2 * g / own),
    }
    c_u_hat, c_y_hat = hats[reading]
    z = gap + plant.gap_offset
    c_u, c_y = 2 * g / (math.sqrt(g / beta) * z), 2 * g / z
    polynomial = np.convolve([1.0, k3, 0.0], [1.0, 0.0, -c_y])
    polynomial[2:] += c_u / c_u_hat * np.array([k2 + c_y_hat, k1 + k3 * c_y_hat, k0])
    return np.asarray(polynomial)


@pytest.mark.parametrize("reading", EQUILIBRIA)
def test_the_upper_ends_by_hand_made_polynomials(
    tried: tuple[TriedRig, ...], reading: Equilibrium
) -> None:
    for case in tried:
        for gap in case.gaps:
            end = theory_stability.upper_ratio(case, reading, gap)
            inside, outside = (0.1, None) if math.isinf(end) else (0.999 * end, 1.001 * end)
            roots = np.roots(hand_made_loop(case.rig, case.poles, reading, gap, inside))
            assert roots.real.max() < 0
            if outside is not None:
                roots = np.roots(hand_made_loop(case.rig, case.poles, reading, gap, outside))
                assert roots.real.max() > 0


def test_the_upper_ends_on_the_papers_rig(claims: dict[str, Claim]) -> None:
    claim, c_y = claims["A-interval"], 2 * 9.81 / 0.0246
    at_y = ((4900 + c_y) / (c_y + 4900 / 5)) ** 2
    moved = (0.0246 / 0.0120 * (4900 + c_y) / (2 * 9.81 / 0.0120 + 4900 / 5)) ** 2
    assert number(claim, "upper_at_Y, model") == pytest.approx(at_y)
    assert number(claim, "upper_at_end, model") == pytest.approx(moved)
    assert number(claim, "upper_at_Y, appendix-a") == pytest.approx(5)
    assert number(claim, "upper_at_end, appendix-a") == pytest.approx(5 * 246 / 120)
    assert claim.values["upper_at_Y, measured"] == "infinite"


@pytest.mark.usefixtures("fresh")
def test_another_condition_would_not_agree_with_the_eigenvalues(
    tried: tuple[TriedRig, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = stability.stability_condition() - p.omega_n**2 / 20
    monkeypatch.setattr(stability, "stability_condition", lambda: wrong)
    claim = theory_stability._intervals(tried[:3])  # the rest takes longer
    assert claim.verdict == "contradicted"
    assert claim.values["agreed"] == 0


def test_no_reading_of_the_gammas_gives_the_printed_bound(claims: dict[str, Claim]) -> None:
    claim, c_y = claims["A-bound"], 2 * 9.81 / 0.0246
    c_u = 2 * 9.81 / (math.sqrt(9.81 / 0.0013688398828125) * 0.0246)
    k0, k1, k2, k3 = 70.0**4, 4 * 70.0**3, 6 * 70.0**2, 280.0

    def bound(g0: float, g1: float, g2: float, g3: float) -> float:
        return g3**2 * g0 / (g1 * (g3 * g2 - g1))

    by_hand = {
        "the text below (A1)": bound(k0 / c_u, (k3 + c_y) / c_u, (k2 + c_y) / c_u, k3),
        "the text below (A6)": bound(k0 / c_u, (k3 * c_y + k1) / c_u, (k2 + c_y) / c_u, k3),
        "gamma_n = k_n": bound(k0, k1, k2, k3),
        "gamma_2 = k2 + C_Y_hat, else k_n": bound(k0, k1, k2 + c_y, k3),
        theory_appendix.DIVIDED: bound(k0, k1 + k3 * c_y, k2 + c_y, k3),
    }
    for name, value in by_hand.items():
        assert number(claim, f"bound, {name}") == pytest.approx(value)
        assert abs(1 / value - 2.63) > 0.01
    assert by_hand["gamma_n = k_n"] == pytest.approx(0.2)


def test_the_corrected_bound_and_range_would_be_verified(
    tried: tuple[TriedRig, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(theory_appendix, "PRINTED_BOUND", sp.Rational(1, 5))
    monkeypatch.setattr(theory_appendix, "PRINTED_RANGE", (-0.5, 4.0))
    for name in ("A-bound", "A-range"):
        assert JUDGES[name](tried[:2]).verdict == "verified"


def test_the_right_upper_end_alone_is_not_enough(
    tried: tuple[TriedRig, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(theory_appendix, "PRINTED_RANGE", (-1.0, 4.0))
    claim = theory_appendix._range(tried[:1])
    assert claim.verdict == "corrected"  # beta_c = 0 is no controller


def test_a_hurwitz_example_would_not_refute(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(theory_appendix, "POSITIVE_NOT_HURWITZ", (1, 4, 6, 4, 1))
    assert theory_appendix._positive_gains().verdict == "verified"


def test_ratios_of_the_readings() -> None:
    plain = sp.sqrt(p.beta / p.beta_c)
    c_u, c_y = theory_appendix.ratios_of("model")
    assert sp.simplify(c_u - plain) == 0
    assert c_y == 1
    assert theory_appendix.ratios_of("measured") == (1, 1)
    assert all(sp.simplify(x - plain**2) == 0 for x in theory_appendix.ratios_of("appendix-a"))


def test_the_error_of_a_moving_ball(tried: tuple[TriedRig, ...]) -> None:
    """Against the printed law with its reference on a ramp, velocity feedforward and all."""
    case = tried[0]
    loop = linear_loop(case, ratio=theory_disturbances.WRONG)
    k0, k1, k2, k3 = loop.gains
    speed = 0.005

    def rates(t: float, state: Array) -> list[float]:
        y, v, int_u, int_y, int_e, iint_e = state
        star = speed * t
        e, v_hat = y - star, -loop.c_u_hat * int_u + loop.c_y_hat * int_y
        u = loop.c_y_hat * star / loop.c_u_hat
        pull = k3 * (v_hat - speed) + (k2 + loop.c_y_hat) * e + k1 * int_e + k0 * iint_e
        u += pull / loop.c_u_hat
        return [v, -loop.c_u * u + loop.c_y * y, u, y, e, int_e]

    run = solve_ivp(rates, (0, 1.2), [0.0] * 6, method="LSODA", rtol=1e-9, atol=1e-13)
    numbers = {p.rho: loop.rho, p.C_Y: loop.c_y, p.k0: k0, p.k3: k3}
    expected = speed * float(theory_stability.error_of_speed().subs(numbers))
    assert run.y[0, -1] - speed * 1.2 == pytest.approx(expected, rel=1e-4)


# the linear loop the claims stand on


@pytest.mark.parametrize("reading", EQUILIBRIA)
def test_both_realisations_have_the_hand_made_poles(
    tried: tuple[TriedRig, ...], reading: Equilibrium
) -> None:
    for case in tried:
        gap = case.rig.reference.end_gap
        loop = linear_loop(case, gap=gap, ratio=1.3, reading=reading)
        expected = hand_made_loop(case.rig, case.poles, reading, gap, 1.3)
        assert np.poly(loop.bounded) == pytest.approx(expected, rel=1e-6)
        printed = np.poly(loop.printed[0])
        assert printed[:5] == pytest.approx(expected, rel=1e-5)
        assert np.abs(printed[5:] / expected[-1]).max() < 1e-3  # the two poles at zero


def test_unstable_loops_are_seen(
    tried: tuple[TriedRig, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LinearLoop, "stable", False)
    assert theory_stability._locally_stable(tried[:2]).verdict == "contradicted"
    assert theory_stability._any_point(tried[:2]).verdict == "contradicted"
    assert not is_stable(np.diag([-1.0, 1e-9]))
    assert is_stable(np.diag([-1.0, -2.0]))
