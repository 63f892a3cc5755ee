"""The comparative claims: TAN-GPI against the PID and FEE-GPI, judged over the survey.

A statement is judged under what the paper states, its period, its start and its noise, with every
reading of what it leaves open (variant of the PID, equilibrium, sampling). It is ``verified`` when
it holds in all of them, ``contradicted`` when a part of it fails in all, and ``not-checkable`` when
it depends on what the paper does not say; the evidence names on what.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from maglev_design.paper.ledger import Claim, Verdict
from maglev_design.paper.survey import NAMES, OURS, Ordering, Row, ordering
from maglev_design.paper.trials import INDICES, TRIALS

PID, FEE = "LIN-PID", "FEE-GPI"
OPPONENTS = (PID, FEE)
EVERYONE = (OURS, PID, FEE)
SURVEY = "maglev-design compare --json"


@dataclass(frozen=True)
class Statement:
    """What the paper says about TAN-GPI against the others: smaller figures in some tests."""

    id: str
    place: str
    text: str
    trials: tuple[str, ...]
    opponents: tuple[str, ...]
    figures: tuple[str, ...]


def comparative_statements() -> tuple[Statement, ...]:
    """Return the comparative statements of secs. 4.1-4.4, the abstract and the conclusions."""
    one, two, three = (trial.name for trial in TRIALS)
    every = (one, two, three)
    listed = [
        Statement(
            "4.1-pid-effort",
            "sec. 4.1",
            "In the nominal test the proposed controller needs less control effort than the PID.",
            (one,),
            (PID,),
            ("total_variation", "peak_voltage"),
        ),
        Statement(
            "4.1-pid-centre",
            "sec. 4.1",
            "The PID tracks worse, with a significant error between second 3 and second 5.",
            (one,),
            (PID,),
            ("largest_error_centre",),
        ),
        Statement(
            "4.1-fee-start",
            "sec. 4.1",
            "FEE-GPI starts with the larger error, which weighs its performance down.",
            (one,),
            (FEE,),
            ("iae_start",),
        ),
        Statement(
            "4.1-best",
            "sec. 4.1",
            "TAN-GPI gives the best results of the three in the nominal test.",
            (one,),
            OPPONENTS,
            INDICES,
        ),
        Statement(
            "4.2-pid",
            "sec. 4.2",
            "With noise TAN-GPI tracks more accurately than the PID.",
            (two,),
            (PID,),
            INDICES,
        ),
        Statement(
            "4.2-pid-effort",
            "sec. 4.2",
            "With noise TAN-GPI needs much less control effort than the PID.",
            (two,),
            (PID,),
            ("total_variation", "peak_voltage"),
        ),
        Statement(
            "4.2-fee-faster",
            "sec. 4.2",
            "With noise TAN-GPI reduces the error faster than FEE-GPI.",
            (two,),
            (FEE,),
            ("settling",),
        ),
        Statement(
            "4.2-fee",
            "sec. 4.2",
            "With noise TAN-GPI is superior to FEE-GPI on the whole.",
            (two,),
            (FEE,),
            INDICES,
        ),
        Statement(
            "4.3-pid",
            "sec. 4.3",
            "With beta_c = 1.15 beta TAN-GPI is better than the PID in all respects.",
            (three,),
            (PID,),
            (*INDICES, "total_variation", "peak_voltage", "settling", "undershoot"),
        ),
        Statement(
            "4.3-fee",
            "sec. 4.3",
            "With beta_c = 1.15 beta TAN-GPI is better than FEE-GPI on the whole.",
            (three,),
            (FEE,),
            INDICES,
        ),
        Statement(
            "4.4-transient",
            "sec. 4.4 (1)",
            "TAN-GPI has the better transient.",
            every,
            OPPONENTS,
            ("settling", "undershoot"),
        ),
        Statement(
            "4.4-tracking",
            "sec. 4.4 (2)",
            "TAN-GPI stabilises with the smaller tracking errors.",
            every,
            OPPONENTS,
            ("iae", "largest_error_moving"),
        ),
        Statement(
            "4.4-steady-state",
            "sec. 4.4 (5)",
            "TAN-GPI has the smaller steady-state error.",
            (two, three),
            OPPONENTS,
            ("mean_error_holding",),
        ),
        Statement(
            "4.4-effort",
            "sec. 4.4 (6)",
            "TAN-GPI asks less of the controller.",
            every,
            OPPONENTS,
            ("total_variation", "peak_voltage"),
        ),
        Statement(
            "abstract-indices",
            "abstract, sec. 6",
            "TAN-GPI beats PID and FEE-GPI in ISE, IAE and ITAE in simulation.",
            every,
            OPPONENTS,
            INDICES,
        ),
    ]
    indices = [
        Statement(
            f"4.4-{index}-test{number}",
            "sec. 4.4, Fig. 12",
            f"In test {number} TAN-GPI has the smallest {NAMES[index]} of the three.",
            (trial,),
            OPPONENTS,
            (index,),
        )
        for number, trial in enumerate(every, start=1)
        for index in INDICES
    ]
    return (*listed, *indices)


def comparative_claim(statement: Statement, rows: Sequence[Row]) -> Claim:
    """Return a comparative statement judged over the survey."""
    found = [
        ordering(rows, trial, opponent, figure)
        for trial, opponent, figure in itertools.product(
            statement.trials, statement.opponents, statement.figures
        )
    ]
    moot = any(math.isnan(o.ratios[0]) for o in found)  # it never happens, to neither
    outcomes = {"depends"} if moot else {o.stated_outcome for o in found}
    if outcomes == {"always"}:
        verdict: Verdict = "verified"
    elif outcomes == {"never"}:
        verdict = "contradicted"
    else:
        # some part fails whatever one reads into the paper: the statement as a whole does
        verdict = "contradicted" if "never" in outcomes else "not-checkable"
    return Claim(
        id=statement.id,
        place=statement.place,
        statement=statement.text,
        verdict=verdict,
        correction="",
        evidence=_evidence(found, verdict),
        command=SURVEY,
        values={
            f"{o.trial}: {o.figure} than {o.opponent}": f"{o.stated_held} of {o.stated_readings}"
            for o in found
        },
    )


def _evidence(found: Sequence[Ordering], verdict: Verdict) -> str:
    """Return in how many readings each part holds, on what the rest depends, and what is moot."""
    parts = []
    for (figure, opponent), group in _grouped(found):
        counts = " / ".join(str(o.stated_held) for o in group)
        low, high = min(o.ratios[0] for o in group), max(o.ratios[1] for o in group)
        deciding = sorted({o.stated_decided_by for o in group if o.stated_outcome == "depends"})
        parts.append(
            f"{NAMES[figure]} smaller than {opponent}'s in {counts} of "
            f"{group[0].stated_readings} readings"
            + (f" ({', '.join(deciding)} decides)" if deciding else "")
            + (
                ", never seen in either"
                if math.isnan(low)
                else f", theirs over ours {low:.3g} to {high:.3g}"
            )
        )
    trials = tuple(dict.fromkeys(o.trial for o in found))
    head = f"Tests {', '.join(trials)}: " if len(trials) > 1 else ""
    flips = sorted(
        {o.decided_by for o in found if o.stated_outcome != "depends" and o.outcome == "depends"}
    )
    tail = f" Beyond what the paper states it also turns on: {', '.join(flips)}." if flips else ""
    if verdict == "not-checkable":
        tail += " The paper does not say which reading is meant, so it cannot be decided."
    opponents = sorted({o.opponent for o in found})
    guess = f" {' and '.join(opponents)}: our reading, a guess; the paper gives no such law."
    return head + "; ".join(parts) + "." + tail + guess


def _grouped(
    found: Sequence[Ordering],
) -> list[tuple[tuple[str, str], list[Ordering]]]:
    """Return the orderings by figure and opponent, tests side by side."""
    groups: dict[tuple[str, str], list[Ordering]] = {}
    for o in found:
        groups.setdefault((o.figure, o.opponent), []).append(o)
    return list(groups.items())
