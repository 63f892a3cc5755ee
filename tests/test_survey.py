"""Orderings over readings: counted by hand on made-up rows, and run on a short rig."""

from __future__ import annotations

import math

import pytest

from maglev_design.paper.survey import (
    COMPARED,
    FACTORS,
    Row,
    ordering,
    orderings,
    readings,
)
from maglev_design.paper.trials import MISMATCHED, Reading, contenders, figures, run_trial
from maglev_design.rig import Rig


def row(label: str, value: float, *, stated: bool = True, **levels: str) -> Row:
    complete = dict.fromkeys(FACTORS, "-") | levels
    return Row("nominal", label, complete, stated, {"itae": value})


def test_an_ordering_that_holds_everywhere() -> None:
    rows = [row("TAN-GPI", 1.0), row("LIN-PID", 2.0, variant="a"), row("LIN-PID", 3.0, variant="b")]
    found = ordering(rows, "nominal", "LIN-PID", "itae")
    assert (found.outcome, found.held, found.readings) == ("always", 2, 2)
    assert found.decided_by == ""
    assert found.ratios == (2.0, 3.0)


def test_an_ordering_that_turns_on_one_factor() -> None:
    rows = []
    for equilibrium, own in (("model", 5.0), ("measured", 1.0)):
        for method in ("euler", "tustin"):
            for label, value in (("TAN-GPI", own), ("FEE-GPI", 2.0)):
                rows.append(row(label, value, equilibrium=equilibrium, discretisation=method))
    found = ordering(rows, "nominal", "FEE-GPI", "itae")
    assert (found.outcome, found.held, found.readings) == ("depends", 2, 4)
    assert found.decided_by == "equilibrium"
    assert found.by_level["equilibrium"] == {"model": 0.0, "measured": 1.0}
    assert found.by_level["discretisation"] == {"euler": 0.5, "tustin": 0.5}


def test_what_the_paper_states_is_counted_apart() -> None:
    rows = [
        row("TAN-GPI", 1.0, initial_error="+"),
        row("FEE-GPI", 0.5, initial_error="+"),
        row("TAN-GPI", 1.0, stated=False, initial_error="-"),
        row("FEE-GPI", 2.0, stated=False, initial_error="-"),
    ]
    found = ordering(rows, "nominal", "FEE-GPI", "itae")
    assert found.outcome == "depends"
    assert found.stated_outcome == "never"
    assert found.decided_by == "initial_error"
    assert found.stated_decided_by == ""
    assert found.ratios == (0.5, 0.5)


@pytest.mark.parametrize(("own", "other", "held"), [(1.0, math.nan, 1), (math.nan, 1.0, 0)])
def test_what_never_happens_is_the_worst(own: float, other: float, held: int) -> None:
    rows = [row("TAN-GPI", own), row("FEE-GPI", other)]
    assert ordering(rows, "nominal", "FEE-GPI", "itae").held == held


def test_equal_figures_are_not_better() -> None:
    rows = [row("TAN-GPI", 1.0), row("FEE-GPI", 1.0)]
    assert ordering(rows, "nominal", "FEE-GPI", "itae").outcome == "never"


def test_the_readings_are_every_combination_once(short_rig: Rig) -> None:
    every = list(readings(short_rig))
    assert len(set(every)) == len(every) == 3 * (1 + 2 * 3) * 2 * 2


def test_a_survey_row_is_the_run_that_it_names(
    short_rig: Rig, short_survey: tuple[Row, ...]
) -> None:
    rows = short_survey
    ours = next(
        r
        for r in rows
        if r.trial == "mismatch"
        and r.label == "TAN-GPI"
        and r.stated
        and r.levels["equilibrium"] == "appendix-a"
        and r.levels["discretisation"] == "euler"
    )

    sampling, noise = short_rig.sampling, short_rig.noise
    reading = Reading("appendix-a", "euler", sampling.period, noise.position)
    own, response = run_trial(short_rig, contenders()[0], MISMATCHED, reading)
    assert ours.values == pytest.approx(figures(own, response), rel=0, abs=0, nan_ok=True)
    found = orderings(rows)
    assert len(found) == 3 * 3 * len(COMPARED)
    assert {o.opponent for o in found} == {"LIN-PID", "FEE-GPI", "STATE (14)"}
    for o in found:
        assert o.stated_readings < o.readings
        assert 0 <= o.held <= o.readings
