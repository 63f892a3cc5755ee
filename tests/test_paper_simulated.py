"""Claims that simulation decides: the verdict follows the runs, whichever way they turn out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from maglev_design.paper import single_runs, surveyed
from maglev_design.paper.ledger import Claim
from maglev_design.paper.survey import Row
from maglev_design.paper.surveyed import EVERYONE, SMALLER, Scope, smaller_figures
from maglev_design.paper.trials import contenders
from maglev_design.rig import Rig


@pytest.fixture(scope="module")
def rows(short_survey: tuple[Row, ...]) -> tuple[Row, ...]:
    return short_survey


def scaled(rows: tuple[Row, ...], label: str, figure: str, factor: float) -> tuple[Row, ...]:
    """Return the rows with one figure of one controller changed."""
    return tuple(
        replace(r, values=r.values | {figure: factor * r.values[figure]}) if r.label == label else r
        for r in rows
    )


def test_every_index_of_every_test_has_its_claim() -> None:
    for number in (1, 2, 3):
        for index in ("ise", "iae", "itae"):
            assert f"4.4-{index}-test{number}" in SMALLER


@pytest.mark.parametrize("identity", sorted(SMALLER))
def test_a_comparison_is_verified_when_all_opponents_are_far_behind(
    rows: tuple[Row, ...], identity: str
) -> None:
    scope = SMALLER[identity]
    assert verdict_with(rows, scope, 1e9) == "verified"
    assert verdict_with(rows, scope, -1e9) == "contradicted"


def verdict_with(rows: tuple[Row, ...], scope: Scope, value: float) -> str:
    """Return the verdict when TAN-GPI has 1 and every opponent `value` in every figure."""
    fixed = tuple(
        replace(r, values=dict.fromkeys(r.values, 1.0 if r.label == "TAN-GPI" else value))
        for r in rows
    )
    return smaller_figures(scope, fixed).verdict


def test_what_happens_to_nobody_is_not_decided(rows: tuple[Row, ...]) -> None:
    never = tuple(replace(r, values=dict.fromkeys(r.values, math.nan)) for r in rows)
    claim = smaller_figures(SMALLER["4.2-fee-faster"], never)
    assert claim.verdict == "not-checkable"
    assert "never seen" in claim.evidence


def test_a_comparison_that_turns_on_a_reading_cannot_be_checked(rows: tuple[Row, ...]) -> None:
    moved = tuple(
        r
        if r.label == "TAN-GPI"
        else replace(
            r,
            values=dict.fromkeys(r.values, 1e9 if r.levels["equilibrium"] == "measured" else -1e9),
        )
        for r in rows
    )
    claim = smaller_figures(SMALLER["4.1-best"], moved)
    assert claim.verdict == "not-checkable"
    assert "equilibrium decides" in claim.evidence


def test_only_the_start_and_noise_that_the_paper_states_decide(rows: tuple[Row, ...]) -> None:
    far = {"itae": 1e9, "iae": 1e9, "ise": 1e9}
    moved = tuple(
        replace(r, values=r.values | (far if r.stated else dict.fromkeys(far, -1e9)))
        if r.label != "TAN-GPI"
        else r
        for r in rows
    )
    assert smaller_figures(SMALLER["abstract-indices"], moved).verdict == "verified"


def test_guesses_are_named_with_the_numbers(rows: tuple[Row, ...]) -> None:
    for scope in SMALLER.values():
        claim = smaller_figures(scope, rows)
        for opponent in scope.opponents:
            assert opponent in claim.evidence
        assert "guess" in claim.evidence


Judge = Callable[[tuple[Row, ...]], Claim]


@pytest.mark.parametrize(
    ("judge", "label", "figure", "factor", "verdict"),
    [
        (surveyed.overshoot, "FEE-GPI", "undershoot", 0.0, "not-checkable"),
        (surveyed.all_converge, "LIN-PID", "mean_error_holding", 1e9, "contradicted"),
        (surveyed.fee_effort, "FEE-GPI", "total_variation", 3.0, "contradicted"),
        (surveyed.fee_end, "FEE-GPI", "mean_error_holding", 100.0, "contradicted"),
    ],
)
def test_a_changed_figure_changes_the_verdict(
    rows: tuple[Row, ...], judge: Judge, label: str, figure: str, factor: float, verdict: str
) -> None:
    assert judge(scaled(rows, label, figure, factor)).verdict == verdict


def test_a_lost_ball_is_counted(rows: tuple[Row, ...]) -> None:
    assert surveyed.pid_survives_mismatch(rows).verdict == "verified"
    lost = tuple(replace(r, values=r.values | {"crashed": 1.0}) for r in rows)
    assert surveyed.pid_survives_mismatch(lost).verdict == "contradicted"
    assert surveyed.all_converge(lost).verdict == "contradicted"


def test_itae_that_ignored_the_start_would_be_as_described(rows: tuple[Row, ...]) -> None:
    late = tuple(replace(r, values=r.values | {"itae_start": 0.0}) for r in rows)
    assert surveyed.indices_as_described(late).verdict == "verified"


def test_noise_of_a_millimetre_would_matter(short_rig: Rig) -> None:
    def with_sensor(deviation: float) -> Rig:
        noise = short_rig.noise.model_copy(update={"position": deviation})
        return short_rig.model_copy(update={"noise": noise})

    assert single_runs.noise_role(with_sensor(1.4e-9), 0).verdict == "corrected"
    assert single_runs.noise_role(with_sensor(1e-4), 0).verdict == "verified"


def test_the_largest_error_survived_is_an_edge(short_rig: Rig) -> None:
    tan = contenders()[0]
    free = single_runs.largest_error(short_rig, tan, 1, clamped=False)
    held = single_runs.largest_error(short_rig, tan, 1)
    # without the clamp a negative command attracts, and the edge is inside the allowed gaps
    assert 0 < free < held
    assert held <= short_rig.limits.gap[1] - short_rig.reference.start_gap


def test_without_an_emulator_the_experiments_have_no_stand_in(short_rig: Rig) -> None:
    claim = single_runs.experiments(short_rig, 0)
    assert claim.verdict == "not-checkable"
    assert claim.values == {}


def test_everyone_is_in_the_paper() -> None:
    assert {c.label for c in contenders()[:3]} == set(EVERYONE)
