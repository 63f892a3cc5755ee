"""The other claims that only simulation decides: secs. 4 and 5 and the conclusions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from maglev_design.paper.comparative import (
    EVERYONE,
    FEE,
    OPPONENTS,
    PID,
    SURVEY,
    comparative_claim,
    comparative_statements,
)
from maglev_design.paper.ledger import Claim, Verdict
from maglev_design.paper.single_runs import (
    experiments,
    initial_error_survived,
    noise_role,
    sign_of_the_error,
)
from maglev_design.paper.survey import NAMES, Row, ordering
from maglev_design.paper.trials import (
    INDICES,
    MISMATCHED,
    NOISE,
    NOMINAL,
    TRIALS,
)
from maglev_design.rig import Rig

SMALL = 1.0e-6
"""[m] A neighbourhood of zero: a twelve-thousandth of the final gap."""


def simulated_claims(
    rig: Rig,
    rows: Sequence[Row],
    *,
    seed: int = 0,
    progress: Callable[[str, float], None] = lambda _stage, _done: None,
) -> tuple[Claim, ...]:
    """Return every claim that simulation decides.

    Parameters
    ----------
    rig : Rig
    rows : sequence of Row
        Of :func:`maglev_design.paper.survey.survey` on the same rig.
    seed : int
        Of the noise, where a run of its own is needed.
    """
    single = (
        overshoot,
        all_converge,
        fee_effort,
        noise_robustness,
        mismatch_robustness,
        pid_gap_under_noise,
        fee_end,
        fee_start_in_test_3,
        pid_survives_mismatch,
        indices_as_described,
    )
    claims = [comparative_claim(statement, rows) for statement in comparative_statements()]
    claims += [claim(rows) for claim in single]
    runs = (noise_role, sign_of_the_error, initial_error_survived, experiments)
    for n, judge in enumerate(runs):
        progress("single runs", n / len(runs))
        claims.append(judge(rig, rows, seed))
    return tuple(claims)


def _stated(rows: Sequence[Row], trial: str, label: str) -> list[Row]:
    return [r for r in rows if r.stated and r.trial == trial and r.label == label]


def _range(rows: Sequence[Row], figure: str, scale: float = 1.0) -> tuple[float, float]:
    values = [scale * row.values[figure] for row in rows]
    return min(values), max(values)


def _told(rows: Sequence[Row], labels: Sequence[str], trial: str, figure: str, scale: float) -> str:
    """Return "LABEL a to b" for every label."""
    texts = []
    for label in labels:
        low, high = _range(_stated(rows, trial, label), figure, scale)
        texts.append(f"{label} {low:.3g} to {high:.3g}")
    return ", ".join(texts)


def overshoot(rows: Sequence[Row]) -> Claim:
    """Judge the overshoot at the start of test 1."""
    smallest = min(_range(_stated(rows, NOMINAL.name, x), "undershoot")[0] for x in EVERYONE)
    return Claim(
        id="4.1-overshoot",
        place="sec. 4.1",
        statement="The loops overshoot significantly at the start.",
        verdict="verified" if smallest > 0.1 else "not-checkable",
        correction="",
        evidence=(
            "Past the reference, in per cent of the initial error: "
            f"{_told(rows, EVERYONE, NOMINAL.name, 'undershoot', 100)}, over all readings; more "
            "than 10 % counts as significant."
        ),
        command="maglev-design simulate --controller lin-pid --plot start.png",
        values={"smallest_overshoot": smallest},
    )


def all_converge(rows: Sequence[Row]) -> Claim:
    """Judge whether all three controllers reach the path in every test."""
    runs = [r for t in TRIALS for x in EVERYONE for r in _stated(rows, t.name, x)]
    lost = sum(r.values["crashed"] > 0 for r in runs)
    largest = max(r.values["mean_error_holding"] for r in runs)
    return Claim(
        id="4-all-converge",
        place="secs. 4.1-4.3",
        statement="All three controllers bring the error into a small neighbourhood of zero.",
        verdict="verified" if lost == 0 and largest < 2 * SMALL else "contradicted",
        correction="",
        evidence=(
            f"{len(runs)} runs under every reading: {lost} lost the ball; the mean error after "
            f"the move is at most {1e6 * largest:.3g} µm (less than {2e6 * SMALL:g} µm is asked)."
        ),
        command=SURVEY,
        values={"runs": len(runs), "lost": lost, "largest_mean_error": largest},
    )


def fee_effort(rows: Sequence[Row]) -> Claim:
    """Judge "similar control effort" of FEE-GPI."""
    found = ordering(rows, NOMINAL.name, FEE, "total_variation")
    low, high = found.ratios
    return Claim(
        id="4.1-fee-effort",
        place="sec. 4.1",
        statement="FEE-GPI's control effort is similar to TAN-GPI's.",
        verdict="verified" if low > 0.75 and high < 1 / 0.75 else "contradicted",
        correction="",
        evidence=(
            f"Total variation of FEE-GPI's voltage over TAN-GPI's: {low:.3g} to {high:.3g} in "
            f"{found.stated_readings} readings; similar is taken as within a third. FEE-GPI's is "
            "the smaller one."
            if high < 1
            else f"Total variation of FEE-GPI's voltage over TAN-GPI's: {low:.3g} to {high:.3g}."
        ),
        command=SURVEY,
        values={"smallest_ratio": low, "largest_ratio": high},
    )


def _growth(rows: Sequence[Row], label: str, before: str, after: str, figure: str) -> list[float]:
    """Return the figure in one test minus that in another, reading by reading."""
    first = {tuple(r.levels.values())[:-1]: r for r in _stated(rows, before, label)}
    return [
        r.values[figure] - first[tuple(r.levels.values())[:-1]].values[figure]
        for r in _stated(rows, after, label)
    ]


def _robustness(rows: Sequence[Row], claim: tuple[str, str, str], before: str, after: str) -> Claim:
    """Judge whether TAN-GPI's ITAE grows least from one test to the next."""
    identity, place, text = claim
    ours = _growth(rows, "TAN-GPI", before, after, "itae")
    theirs = {x: _growth(rows, x, before, after, "itae") for x in OPPONENTS}
    least = all(max(ours) < min(theirs[x]) for x in OPPONENTS)
    most = any(min(ours) > max(theirs[x]) for x in OPPONENTS)
    told = "; ".join(
        f"{label} {min(growth):.3g} to {max(growth):.3g}"
        for label, growth in {"TAN-GPI": ours, **theirs}.items()
    )
    return Claim(
        id=identity,
        place=place,
        statement=text,
        verdict="verified" if least else ("contradicted" if most else "not-checkable"),
        correction="",
        evidence=(
            f"ITAE grows from the {before} to the {after} test by, in m s² and over all readings: "
            f"{told}."
            + ("" if least or most else " The ranges overlap: it depends on the reading.")
        ),
        command=SURVEY,
        values={
            f"{label}_{end}": pick(growth)
            for label, growth in {"TAN-GPI": ours, **theirs}.items()
            for end, pick in (("least", min), ("most", max))
        },
    )


def noise_robustness(rows: Sequence[Row]) -> Claim:
    """Judge robustness against noise."""
    text = "TAN-GPI is the most robust of the three against noise."
    return _robustness(rows, ("4.4-noise", "sec. 4.4 (3)", text), NOMINAL.name, NOISE.name)


def mismatch_robustness(rows: Sequence[Row]) -> Claim:
    """Judge robustness against a wrong beta."""
    text = "TAN-GPI handles a wrong parameter best of the three."
    return _robustness(rows, ("4.4-mismatch", "sec. 4.4 (4)", text), NOISE.name, MISMATCHED.name)


def pid_gap_under_noise(rows: Sequence[Row]) -> Claim:
    """Judge whether the PID falls further behind once there is noise."""
    before, after = (_ratios(rows, trial, PID, "itae") for trial in (NOMINAL.name, NOISE.name))
    grew = sum(after[key] > before[key] for key in before)
    verdict: Verdict = "not-checkable"
    if grew in (0, len(before)):
        verdict = "verified" if grew else "contradicted"
    return Claim(
        id="4.2-pid-gap",
        place="sec. 4.2",
        statement="With noise TAN-GPI's advantage over the PID is still more evident.",
        verdict=verdict,
        correction="",
        evidence=(
            f"The PID's ITAE over TAN-GPI's grows with the noise in {grew} of {len(before)} "
            f"readings; without noise it is {min(before.values()):.3g} to "
            f"{max(before.values()):.3g}, with it {min(after.values()):.3g} to "
            f"{max(after.values()):.3g}. Noise adds to both, and brings them together."
        ),
        command=SURVEY,
        values={"grew": grew, "readings": len(before)},
    )


def _ratios(rows: Sequence[Row], trial: str, opponent: str, figure: str) -> dict[str, float]:
    """Return the opponent's figure over TAN-GPI's, reading by reading."""

    def loop(row: Row) -> str:
        return f"{row.levels['equilibrium']}, {row.levels['discretisation']}"

    ours = {loop(r): r.values[figure] for r in _stated(rows, trial, "TAN-GPI")}
    return {
        f"{loop(r)}, {r.levels['variant']}": r.values[figure] / ours[loop(r)]
        for r in _stated(rows, trial, opponent)
    }


def fee_end(rows: Sequence[Row]) -> Claim:
    """Judge "errors of a similar order" at the end of test 2."""
    found = ordering(rows, NOISE.name, FEE, "mean_error_holding")
    low, high = found.ratios
    return Claim(
        id="4.2-fee-end",
        place="sec. 4.2",
        statement="After the move of test 2 TAN-GPI's and FEE-GPI's errors are of one order.",
        verdict="verified" if low > 0.1 and high < 10 else "contradicted",
        correction="",
        evidence=(
            f"Mean error after the move, FEE-GPI's over TAN-GPI's: {low:.3g} to {high:.3g} in "
            f"{found.stated_readings} readings."
        ),
        command=SURVEY,
        values={"smallest_ratio": low, "largest_ratio": high},
    )


def fee_start_in_test_3(rows: Sequence[Row]) -> Claim:
    """Judge whether FEE-GPI's initial error is more pronounced with a wrong beta."""
    growth = _growth(rows, FEE, NOISE.name, MISMATCHED.name, "iae_start")
    grew = sum(x > 0 for x in growth)
    verdict: Verdict = "not-checkable"
    if grew in (0, len(growth)):
        verdict = "verified" if grew else "contradicted"
    return Claim(
        id="4.3-fee-start",
        place="sec. 4.3",
        statement="FEE-GPI's error at the start is more pronounced in test 3 than before.",
        verdict=verdict,
        correction="",
        evidence=(
            f"Its IAE before the move grows in {grew} of {len(growth)} readings, by "
            f"{min(growth):.3g} to {max(growth):.3g} m s. Under the reading measured the law knows "
            "no beta, and nothing changes."
        ),
        command=SURVEY,
        values={"grew": grew, "readings": len(growth)},
    )


def pid_survives_mismatch(rows: Sequence[Row]) -> Claim:
    """Judge whether the PID tracks in test 3."""
    runs = _stated(rows, MISMATCHED.name, PID)
    lost = sum(r.values["crashed"] > 0 for r in runs)
    return Claim(
        id="4.3-pid-tracks",
        place="sec. 4.3",
        statement="The PID, too, stabilises and tracks with the wrong beta.",
        verdict="contradicted" if lost else "verified",
        correction="",
        evidence=(
            f"{len(runs)} readings, {lost} balls lost; largest error of the move, in µm: "
            f"{_told(rows, (PID,), MISMATCHED.name, 'largest_error_moving', 1e6)}."
        ),
        command="maglev-design simulate --controller lin-pid --test mismatch",
        values={"lost": lost, "readings": len(runs)},
    )


def indices_as_described(rows: Sequence[Row]) -> Claim:
    """Judge what the three indices are said to weigh, by the part of the run that decides them."""
    shares = {}
    for index in INDICES:
        parts = [
            r.values[f"{index}_start"] / r.values[index]
            for r in _stated(rows, NOMINAL.name, "TAN-GPI")
        ]
        shares[index] = (min(parts), max(parts))
    early = shares["itae"][0] > 0.1
    told = "; ".join(
        f"{NAMES[i]} {100 * low:.6g} to {100 * high:.6g} %" for i, (low, high) in shares.items()
    )
    return Claim(
        id="4.4-indices",
        place="sec. 4.4",
        statement=(
            "ISE and IAE treat all tracking errors alike; ITAE ignores the early ones and weighs "
            "the late ones."
        ),
        verdict="contradicted" if early else "verified",
        correction="",
        evidence=(
            f"Share of TAN-GPI's index that accrues before the move in test 1: {told}. ISE ranks "
            "the transient of the initial error and nothing else. ITAE does not ignore it, either: "
            "more than a tenth would be enough to say so."
        ),
        command="maglev-design compare -o FOLDER",
        values={
            f"{i}_{e}": v
            for i, g in shares.items()
            for e, v in zip(("low", "high"), g, strict=True)
        },
    )
