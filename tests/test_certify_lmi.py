from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rigs import SHORT, rig_with
from scipy.linalg import expm

from maglev_design.certification.lyapunov import lmi
from maglev_design.certification.lyapunov.family import scaling, subject
from maglev_design.certification.lyapunov.lmi import (
    LmiCertificate,
    LmiStatus,
    certify_family,
    certify_sampled,
    widest_sampled,
)
from maglev_design.controller.design import (
    Design,
    PoleSpec,
    make_design,
    plant_beta,
    true_equilibrium,
)
from maglev_design.controller.timing import timing
from maglev_design.errors import InputError
from maglev_design.options import Method
from maglev_design.rig import Rig, load_rig

PAPER = load_rig("belmonte2021")
Array = NDArray[np.float64]


def designed(rig: Rig, zeta: float = 1.0, omega_n: float = 70.0, **options: Any) -> Design:
    return make_design(rig, PoleSpec.double(zeta, omega_n), **options)


@pytest.fixture(scope="module")
def paper() -> tuple[LmiCertificate, ...]:
    return certify_family(designed(PAPER), PAPER)


def loop_matrix(design: Design, rig: Rig, gap: float, ratio: float, *, sampled: bool) -> Array:
    """The loop by hand: the plant's exponential, the exported coefficients, delay below T or 0.

    States (e, e', x1, x2) and, with a delay, what the last voltage gives at the design's gap.
    """
    there = true_equilibrium(rig, plant_beta(rig) / ratio, gap)
    rest = true_equilibrium(rig, plant_beta(rig) / ratio, design.Y)
    F, G = np.array([[0.0, 1.0], [there.C_Y, 0.0]]), np.array([[0.0], [-there.C_U]])
    if not sampled:
        k0, k1, k2, k3 = design.gains
        effort = np.array([k2 + design.believed.C_Y, 0, k0 / k3, k1 - k2 * k3 - k0 / k3])
        plant = np.hstack([F, np.zeros((2, 2))]) + G * effort / design.believed.C_U
        return np.vstack([plant, [1, 0, 0, 0], [1, 0, 0, -k3]])
    c, period = design.coefficients, rig.sampling.period
    part = timing(period, rig.sampling.delay).part
    block = np.vstack([np.hstack([F, G]), np.zeros((1, 3))])
    whole, fresh = expm(block * period), expm(block * (period - part))
    gamma, first = whole[:2, 2:], fresh[:2, 2:]
    volts = np.array([[c["d"], 0.0, c["c1"], c["c2"]]])
    plant = np.hstack([whole[:2, :2], np.zeros((2, 2))]) + first @ volts
    own = [[c["b1"], 0, 1, 0], [c["b2"], 0, 0, c["a22"]]]
    A = np.vstack([plant, own])
    if part == 0:
        return A
    late = np.vstack([(gamma - first) / rest.C_U, np.zeros((2, 1))])
    return np.block([[A, late], [rest.C_U * volts, np.zeros((1, 1))]])


def points(found: LmiCertificate, count: int, seed: int) -> Array:
    """Random gaps and ratios of a certificate's family, its corners first; shape (2, count)."""
    (gap_1, gap_2), (weak, strong) = (
        tuple(map(float, ends)) for ends in (found.claim.gaps, found.claim.ratios)
    )
    share = np.random.default_rng(seed).uniform(size=(2, count))
    share[:, :4] = np.array([[0, 0, 1, 1], [0, 1, 0, 1]])
    return np.stack([gap_1 + share[0] * (gap_2 - gap_1), weak + share[1] * (strong - weak)])


def scaled_members(
    found: LmiCertificate, design: Design, rig: Rig, count: int = 40, seed: int = 1
) -> list[Array]:
    scale = np.array([float(x) for x in found.scale])
    sampled = found.claim.loop == "sampled"
    return [
        loop_matrix(design, rig, gap, ratio, sampled=sampled) * scale[:, None] / scale
        for gap, ratio in points(found, count, seed).T
    ]


def lyapunov_matrix(found: LmiCertificate) -> Array:
    return np.array(found.P, dtype=float)


def test_both_loops_of_the_paper_are_certified_over_path_and_uncertainty(
    paper: tuple[LmiCertificate, ...],
) -> None:
    assert [c.claim.loop for c in paper] == ["continuous", "sampled"]
    for found in paper:
        assert found.certified
        assert found.verified()
        assert found.claim.gaps == (Fraction("0.012"), Fraction("0.0246"))
        assert found.claim.ratios == (Fraction("0.85"), Fraction("1.15"))


def test_the_largest_error_of_beta_is_certified_itself_and_hardly_more_is(
    paper: tuple[LmiCertificate, ...],
) -> None:
    for found, least in zip(paper, (0.70, 0.60), strict=True):
        widest, largest = found.widest, found.largest_beta_error
        assert widest is not None
        assert largest is not None
        assert float(largest) >= least
        assert widest.verified()
        assert widest.claim.ratios == (1 - largest, 1 + largest)
        u = largest + Fraction(1, lmi.BETA_STEPS)
        further = replace(widest.claim, ratios=(1 - u, 1 + u))
        assert not lmi.attempt(found.subject, further).certified


def test_the_largest_decay_is_near_that_of_the_slowest_vertex(
    paper: tuple[LmiCertificate, ...],
) -> None:
    for found in paper:
        bound = lmi.slowest(found)
        assert bound > float(found.decay) > 0.9 * bound
        assert not replace(found, decay=found.decay * 2).verified()


def test_random_members_have_the_decay(paper: tuple[LmiCertificate, ...]) -> None:
    design = designed(PAPER)
    for found in paper:
        P, decay = lyapunov_matrix(found), float(found.decay)
        for A in scaled_members(found, design, PAPER):
            change = (
                A.T @ P + P @ A + 2 * decay * P
                if found.period is None
                else A.T @ P @ A - (1 - 2 * decay * float(found.period)) * P
            )
            assert np.linalg.eigvalsh(change).max() < 0


@pytest.mark.parametrize(
    ("poles", "method", "delay"),
    [
        ((1.0, 70.0), "tustin", 0.0),
        ((1.1371, 107.346), "tustin", 0.0),
        ((1.0, 70.0), "zoh", 0.0005),
        ((1.0, 70.0), "euler", 0.0),
    ],
)
def test_no_start_on_the_boundary_grows_under_any_change_of_gap(
    poles: tuple[float, float], method: Method, delay: float
) -> None:
    """The gap jumps at random at every sample, the ratio is of the family and stays."""
    rig = PAPER.model_copy(update={"sampling": PAPER.sampling.model_copy(update={"delay": delay})})
    design = designed(rig, *poles, method=method)
    found = certify_sampled(design, rig)
    assert found.certified
    P, generator = lyapunov_matrix(found), np.random.default_rng(17)
    gap_1, gap_2 = map(float, found.claim.gaps)
    scale = np.array([float(x) for x in found.scale])
    root = np.linalg.cholesky(np.linalg.inv(P))
    for ratio in (*map(float, found.claim.ratios), 1.03):
        gaps = [gap_1, gap_2, *generator.uniform(gap_1, gap_2, 10)]
        members = [
            loop_matrix(design, rig, gap, ratio, sampled=True) * scale[:, None] / scale
            for gap in gaps
        ]
        directions = generator.normal(size=(len(P), 50))
        x = root @ (directions / np.linalg.norm(directions, axis=0))
        before = np.einsum("ik,ij,jk->k", x, P, x)
        assert before == pytest.approx(1.0)
        for _ in range(150):
            x = members[generator.integers(len(members))] @ x
            now = np.einsum("ik,ij,jk->k", x, P, x)
            assert (now < before).all()
            before = now


def test_the_continuous_loop_survives_any_change_of_gap_and_ratio(
    paper: tuple[LmiCertificate, ...],
) -> None:
    """From the boundary of the widest certificate, members of its family taking turns."""
    found = paper[0].widest
    assert found is not None
    P, generator = lyapunov_matrix(found), np.random.default_rng(19)
    members = scaled_members(found, designed(PAPER), PAPER, count=16)
    steps = [expm(A * span) for A in members for span in (1e-4, 3e-3, 0.05)]
    directions = generator.normal(size=(4, 50))
    x = np.linalg.cholesky(np.linalg.inv(P)) @ (directions / np.linalg.norm(directions, axis=0))
    before = np.ones(50)
    for _ in range(200):
        x = steps[generator.integers(len(steps))] @ x
        now = np.einsum("ik,ij,jk->k", x, P, x)
        assert (now < before).all()
        before = now


def test_the_tuned_design_is_certified_for_both_loops() -> None:
    found = certify_family(designed(PAPER, 1.1371, 107.346), PAPER, bisect=False)
    assert [c.status for c in found] == [LmiStatus.CERTIFIED] * 2
    assert all(c.verified() and c.widest is None for c in found)


def test_over_all_gaps_of_the_rig_there_is_no_certificate_and_it_says_so() -> None:
    found = certify_family(designed(PAPER), PAPER, gap_range=PAPER.limits.gap)
    continuous, sampled = found
    assert continuous.status is LmiStatus.INFEASIBLE  # although every vertex is stable:
    assert lmi.slowest(continuous) > 0
    assert sampled.status is LmiStatus.UNSTABLE
    for refused in found:
        assert refused.P is None
        assert refused.widest is None
        assert not refused.verified()
        assert refused.as_dict()["certified"] is refused.as_dict()["exact"] is False


def test_the_second_solver_serves_where_the_first_has_no_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    solve = lmi._solve
    asked = []

    def clarabel_fails(start: LmiCertificate, solver: str) -> Any:
        asked.append(solver)
        return None if solver == "CLARABEL" else solve(start, solver)

    monkeypatch.setattr(lmi, "_solve", clarabel_fails)
    found = certify_sampled(designed(PAPER), PAPER)
    assert found.certified
    assert asked == ["CLARABEL", "SCS"]
    assert found.solver == "SCS"


def test_no_answer_of_any_solver_is_no_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lmi, "_solve", lambda *_: None)
    assert certify_sampled(designed(PAPER), PAPER).status is LmiStatus.NO_ANSWER


def test_what_rounding_destroys_is_not_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lmi, "P_GRID", 16)
    found = certify_sampled(designed(PAPER), PAPER)
    assert found.status is LmiStatus.ROUNDED_AWAY
    assert found.P is None


def test_a_delay_beyond_what_is_enclosed_is_a_status_of_the_sampled_loop_alone() -> None:
    rig = rig_with(SHORT, {"sampling.delay": 0.02})
    continuous, sampled = certify_family(designed(rig), rig, bisect=False)
    assert continuous.certified
    assert sampled.status is LmiStatus.NOT_ENCLOSED
    assert sampled.as_dict()["vertices"] == []


def test_the_uncertainty_is_the_rigs_unless_given() -> None:
    assert certify_sampled(designed(PAPER), PAPER, beta_error=0.1).claim.ratios == (
        Fraction(9, 10),
        Fraction(11, 10),
    )


@pytest.mark.parametrize("error", [-0.1, 1.0])
def test_an_impossible_uncertainty_is_refused(error: float) -> None:
    with pytest.raises(InputError, match="beta error"):
        certify_sampled(designed(PAPER), PAPER, beta_error=error)


def test_the_widest_sampled_family_is_that_of_the_whole_certificate(
    paper: tuple[LmiCertificate, ...],
) -> None:
    found = widest_sampled(designed(PAPER), PAPER)
    assert found is not None
    assert found.claim == (paper[1].widest or found).claim
    assert found.claim.ratios[1] - 1 == paper[1].largest_beta_error


def test_an_unstable_design_has_no_widest_family() -> None:
    late = rig_with(SHORT, {"sampling.delay": 0.01})
    assert widest_sampled(designed(late), late) is None


def test_the_document_is_plain_data_with_exact_numbers(paper: tuple[LmiCertificate, ...]) -> None:
    for found in paper:
        data = json.loads(json.dumps(found.as_dict(), allow_nan=False))
        assert tuple(tuple(map(Fraction, row)) for row in data["P"]) == found.P
        assert len(data["vertices"]) == len(found.polytope.vertices)
        assert len(data["states"]) == len(data["scaling"]) == len(data["P"])
        assert Fraction(data["decay_exact"]) == found.decay
    assert paper[0].as_dict()["family"]["period"] is None
    assert paper[1].as_dict()["family"]["period"] == "1/1000"


def test_states_are_scaled_to_metres() -> None:
    of = subject(designed(PAPER), PAPER)
    assert [str(x) for x in scaling(of, "continuous")] == ["1", "1/70", "70", "70"]
