"""The claims that the survey decides: TAN-GPI against the PID and FEE-GPI, and the three alone.

A comparison is judged under what the paper states, its period, its start and its noise, with every
reading of what it leaves open (variant of the PID, equilibrium, sampling). It is ``verified`` when
it holds in all of them, ``contradicted`` when a part of it fails in all, and ``not-checkable`` when
it depends on what the paper does not say; the evidence names on what.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from maglev_design.figures import INDICES
from maglev_design.paper.ledger import Finding, Verdict, claim, finding
from maglev_design.paper.survey import NAMES, OURS, Ordering, Row, ordering
from maglev_design.paper.trials import MISMATCHED, NOISE, NOMINAL, TRIALS, Trial

PID, FEE = "LIN-PID", "FEE-GPI"
OPPONENTS = (PID, FEE)
EVERYONE = (OURS, PID, FEE)
ONE, TWO, THREE = ((trial.name,) for trial in TRIALS)
EVERY = (*ONE, *TWO, *THREE)
SMALL = 1.0e-6
"""[m] A neighbourhood of zero: a twelve-thousandth of the final gap."""
EFFORT, TRANSIENT = ("total_variation", "peak_voltage"), ("settling", "undershoot")


@dataclass(frozen=True)
class Scope:
    """Which figures TAN-GPI is said to have smaller: in which tests, against whom."""

    trials: tuple[str, ...]
    opponents: tuple[str, ...]
    figures: tuple[str, ...]


SMALLER = {
    "4.1-pid-effort": Scope(ONE, (PID,), EFFORT),
    "4.1-pid-centre": Scope(ONE, (PID,), ("largest_error_centre",)),
    "4.1-fee-start": Scope(ONE, (FEE,), ("iae_start",)),
    "4.1-best": Scope(ONE, OPPONENTS, INDICES),
    "4.2-pid": Scope(TWO, (PID,), INDICES),
    "4.2-pid-effort": Scope(TWO, (PID,), EFFORT),
    "4.2-fee-faster": Scope(TWO, (FEE,), ("settling",)),
    "4.2-fee": Scope(TWO, (FEE,), INDICES),
    "4.3-pid": Scope(THREE, (PID,), (*INDICES, *EFFORT, *TRANSIENT)),
    "4.3-fee": Scope(THREE, (FEE,), INDICES),
    "4.4-transient": Scope(EVERY, OPPONENTS, TRANSIENT),
    "4.4-tracking": Scope(EVERY, OPPONENTS, ("iae", "largest_error_moving")),
    "4.4-steady-state": Scope((*TWO, *THREE), OPPONENTS, ("mean_error_holding",)),
    "4.4-effort": Scope(EVERY, OPPONENTS, EFFORT),
    "abstract-indices": Scope(EVERY, OPPONENTS, INDICES),
    **{
        f"4.4-{index}-test{n}": Scope((trial,), OPPONENTS, (index,))
        for n, trial in enumerate(EVERY, start=1)
        for index in INDICES
    },
}
"""The comparative statements of secs. 4.1-4.4, the abstract and the conclusions, by id."""


def smaller_figures(scope: Scope, rows: Sequence[Row]) -> Finding:
    """Judge a comparative statement over the survey."""
    found = [
        ordering(rows, trial, opponent, figure)
        for trial, opponent, figure in itertools.product(
            scope.trials, scope.opponents, scope.figures
        )
    ]
    moot = any(math.isnan(o.ratios[0]) for o in found)  # it never happens, to neither
    outcomes = {"depends"} if moot else {o.stated_outcome for o in found}
    verdict: Verdict = "verified" if outcomes == {"always"} else "not-checkable"
    if "never" in outcomes:  # a part fails whatever one reads into the paper: the whole does
        verdict = "contradicted"
    return finding(
        verdict,
        _evidence(scope, found, verdict),
        **{
            f"{o.trial}: {o.figure} than {o.opponent}": f"{o.stated_held} of {o.stated_readings}"
            for o in found
        },
    )


for _id, _scope in SMALLER.items():
    claim(_id)(partial(smaller_figures, _scope))


def _evidence(scope: Scope, found: Sequence[Ordering], verdict: Verdict) -> str:
    """Return in how many readings each part holds, on what the rest depends, and what is moot."""
    parts = []
    for opponent, figure in itertools.product(scope.opponents, scope.figures):
        group = [o for o in found if (o.opponent, o.figure) == (opponent, figure)]
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
    head = f"Tests {', '.join(scope.trials)}: " if len(scope.trials) > 1 else ""
    flips = sorted(
        {o.decided_by for o in found if o.stated_outcome != "depends" and o.outcome == "depends"}
    )
    tail = f" Beyond what the paper states it also turns on: {', '.join(flips)}." if flips else ""
    if verdict == "not-checkable":
        tail += " The paper does not say which reading is meant, so it cannot be decided."
    names = " and ".join(sorted(scope.opponents))
    guess = f"{names}: our reading, a guess; the paper gives no such law."
    return f"{head}{'; '.join(parts)}.{tail} {guess}"


def _stated(rows: Sequence[Row], trial: Trial, label: str) -> list[Row]:
    return [r for r in rows if r.stated and (r.trial, r.label) == (trial.name, label)]


def _of_all(held: int, readings: int) -> Verdict:
    """Return the verdict of what holds in some of the readings: it depends on the reading."""
    if held == readings:
        return "verified"
    return "not-checkable" if held else "contradicted"


def _range(rows: Sequence[Row], figure: str, scale: float = 1.0) -> tuple[float, float]:
    values = [scale * row.values[figure] for row in rows]
    return min(values), max(values)


def _told(
    rows: Sequence[Row], labels: Sequence[str], trial: Trial, figure: str, scale: float
) -> str:
    """Return "LABEL a to b" for every label."""
    texts = []
    for label in labels:
        low, high = _range(_stated(rows, trial, label), figure, scale)
        texts.append(f"{label} {low:.3g} to {high:.3g}")
    return ", ".join(texts)


@claim("4.1-overshoot")
def overshoot(rows: Sequence[Row]) -> Finding:
    """Judge the overshoot at the start of test 1."""
    smallest = min(_range(_stated(rows, NOMINAL, x), "undershoot")[0] for x in EVERYONE)
    return finding(
        "verified" if smallest > 0.1 else "not-checkable",
        "Past the reference, in per cent of the initial error: "
        f"{_told(rows, EVERYONE, NOMINAL, 'undershoot', 100)}, over all readings; more "
        "than 10 % counts as significant.",
        smallest_overshoot=smallest,
    )


@claim("4-all-converge")
def all_converge(rows: Sequence[Row]) -> Finding:
    """Judge whether all three controllers reach the path in every test."""
    runs = [r for t in TRIALS for x in EVERYONE for r in _stated(rows, t, x)]
    lost = sum(r.values["crashed"] > 0 for r in runs)
    largest = max(r.values["mean_error_holding"] for r in runs)
    return finding(
        lost == 0 and largest < 2 * SMALL,
        f"{len(runs)} runs under every reading: {lost} lost the ball; the mean error after "
        f"the move is at most {1e6 * largest:.3g} µm (less than {2e6 * SMALL:g} µm is asked).",
        runs=len(runs),
        lost=lost,
        largest_mean_error=largest,
    )


@claim("4.1-fee-effort")
def fee_effort(rows: Sequence[Row]) -> Finding:
    """Judge "similar control effort" of FEE-GPI."""
    found = ordering(rows, NOMINAL.name, FEE, "total_variation")
    low, high = found.ratios
    return finding(
        low > 0.75 and high < 1 / 0.75,
        f"Total variation of FEE-GPI's voltage over TAN-GPI's: {low:.3g} to {high:.3g} in "
        f"{found.stated_readings} readings; similar is taken as within a third. FEE-GPI's is "
        "the smaller one."
        if high < 1
        else f"Total variation of FEE-GPI's voltage over TAN-GPI's: {low:.3g} to {high:.3g}.",
        smallest_ratio=low,
        largest_ratio=high,
    )


def _growth(
    rows: Sequence[Row], label: str, before: Trial, after: Trial, figure: str
) -> list[float]:
    """Return the figure in one test minus that in another, reading by reading."""
    first = {tuple(r.levels.values())[:-1]: r for r in _stated(rows, before, label)}
    return [
        r.values[figure] - first[tuple(r.levels.values())[:-1]].values[figure]
        for r in _stated(rows, after, label)
    ]


def _robustness(before: Trial, after: Trial, rows: Sequence[Row]) -> Finding:
    """Judge whether TAN-GPI's ITAE grows least from one test to the next."""
    growth = {x: _growth(rows, x, before, after, "itae") for x in EVERYONE}
    least = all(max(growth[OURS]) < min(growth[x]) for x in OPPONENTS)
    most = any(min(growth[OURS]) > max(growth[x]) for x in OPPONENTS)
    told = "; ".join(f"{x} {min(by):.3g} to {max(by):.3g}" for x, by in growth.items())
    return finding(
        "verified" if least else ("contradicted" if most else "not-checkable"),
        f"ITAE grows from the {before.name} to the {after.name} test by, in m s² and over all "
        f"readings: {told}."
        + ("" if least or most else " The ranges overlap: it depends on the reading."),
        **{
            f"{label}_{end}": pick(by)
            for label, by in growth.items()
            for end, pick in (("least", min), ("most", max))
        },
    )


claim("4.4-noise")(partial(_robustness, NOMINAL, NOISE))
claim("4.4-mismatch")(partial(_robustness, NOISE, MISMATCHED))


@claim("4.2-pid-gap")
def pid_gap_under_noise(rows: Sequence[Row]) -> Finding:
    """Judge whether the PID falls further behind once there is noise."""
    before, after = (_ratios(rows, trial, PID, "itae") for trial in (NOMINAL, NOISE))
    grew = sum(after[key] > before[key] for key in before)
    return finding(
        _of_all(grew, len(before)),
        f"The PID's ITAE over TAN-GPI's grows with the noise in {grew} of {len(before)} "
        f"readings; without noise it is {min(before.values()):.3g} to "
        f"{max(before.values()):.3g}, with it {min(after.values()):.3g} to "
        f"{max(after.values()):.3g}. Noise adds to both, and brings them together.",
        grew=grew,
        readings=len(before),
    )


def _ratios(rows: Sequence[Row], trial: Trial, opponent: str, figure: str) -> dict[str, float]:
    """Return the opponent's figure over TAN-GPI's, reading by reading."""

    def loop(row: Row) -> str:
        return f"{row.levels['equilibrium']}, {row.levels['discretisation']}"

    ours = {loop(r): r.values[figure] for r in _stated(rows, trial, OURS)}
    return {
        f"{loop(r)}, {r.levels['variant']}": r.values[figure] / ours[loop(r)]
        for r in _stated(rows, trial, opponent)
    }


@claim("4.2-fee-end")
def fee_end(rows: Sequence[Row]) -> Finding:
    """Judge "errors of a similar order" at the end of test 2."""
    found = ordering(rows, NOISE.name, FEE, "mean_error_holding")
    low, high = found.ratios
    return finding(
        low > 0.1 and high < 10,
        f"Mean error after the move, FEE-GPI's over TAN-GPI's: {low:.3g} to {high:.3g} in "
        f"{found.stated_readings} readings.",
        smallest_ratio=low,
        largest_ratio=high,
    )


@claim("4.3-fee-start")
def fee_start_in_test_3(rows: Sequence[Row]) -> Finding:
    """Judge whether FEE-GPI's initial error is more pronounced with a wrong beta."""
    growth = _growth(rows, FEE, NOISE, MISMATCHED, "iae_start")
    grew = sum(x > 0 for x in growth)
    return finding(
        _of_all(grew, len(growth)),
        f"Its IAE before the move grows in {grew} of {len(growth)} readings, by "
        f"{min(growth):.3g} to {max(growth):.3g} m s. Under the reading measured the law knows "
        "no beta, and nothing changes.",
        grew=grew,
        readings=len(growth),
    )


@claim("4.3-pid-tracks")
def pid_survives_mismatch(rows: Sequence[Row]) -> Finding:
    """Judge whether the PID tracks in test 3."""
    runs = _stated(rows, MISMATCHED, PID)
    lost = sum(r.values["crashed"] > 0 for r in runs)
    return finding(
        lost == 0,
        f"{len(runs)} readings, {lost} balls lost; largest error of the move, in µm: "
        f"{_told(rows, (PID,), MISMATCHED, 'largest_error_moving', 1e6)}.",
        lost=lost,
        readings=len(runs),
    )


@claim("4.4-indices")
def indices_as_described(rows: Sequence[Row]) -> Finding:
    """Judge what the three indices are said to weigh, by the part of the run that decides them."""
    shares = {}
    for index in INDICES:
        parts = [r.values[f"{index}_start"] / r.values[index] for r in _stated(rows, NOMINAL, OURS)]
        shares[index] = (min(parts), max(parts))
    told = "; ".join(
        f"{NAMES[i]} {100 * low:.6g} to {100 * high:.6g} %" for i, (low, high) in shares.items()
    )
    return finding(
        shares["itae"][0] <= 0.1,
        f"Share of TAN-GPI's index that accrues before the move in test 1: {told}. ISE ranks "
        "the transient of the initial error and nothing else. ITAE does not ignore it, either: "
        "more than a tenth would be enough to say so.",
        **{
            f"{i}_{e}": v
            for i, g in shares.items()
            for e, v in zip(("low", "high"), g, strict=True)
        },
    )
