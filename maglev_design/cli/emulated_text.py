"""What a person reads about a design on the emulated rig."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from maglev_design.cli.output import number, plain, shown, table
from maglev_design.reporting.chapter_emulated import emulated_rows, is_lost, parts_of
from maglev_design.reporting.content import Quantity, Runs


def emulated_warnings(document: dict[str, Any]) -> list[str]:
    """Return what stands above every other result: balls that are lost on the emulated rig."""
    found = document["emulated"]
    if found is None or not is_lost(found):
        return []
    where = "; ".join(
        f"at beta_c/beta = {part['ratio']:g} in {part['lost']} of {part['seeds']} runs"
        for part in parts_of(found)
        if part["lost"]
    )
    return [
        f"ON THE EMULATED RIG THE BALL IS LOST, {where} ({_effects(found)}): what follows is of a "
        "plant without these effects; do not run this design on the rig that the file describes"
    ]


def emulated_headline(document: dict[str, Any]) -> str | None:
    """Return a sentence where the baseline does better on the emulated rig than the design."""
    found, base = document["emulated"], document["baseline"]
    if found is None or base is None or found["baseline"] is None:
        return None
    other = found["baseline"]
    losing = [
        (label, own, theirs)
        for label, own, theirs in (
            (f"at beta_c/beta = {found['ratio']:g}", found, other),
            ("at its worst ratio", found["worst"], other["worst"]),
        )
        if (own["lost"], own["itae"]["median"]) > (theirs["lost"], theirs["itae"]["median"])
    ]
    if not losing:
        return None
    parts = [
        f"{label} ITAE {own['itae']['median']:.2g} against "
        f"{shown('itae', theirs['itae']['median'], 2)} "
        f"and voltage variation {own['total_variation']['median']:.3g} against "
        f"{theirs['total_variation']['median']:.3g} V (balls lost: {own['lost']} and "
        f"{theirs['lost']} of {own['seeds']})"
        for label, own, theirs in losing
    ]
    return (
        "On the emulated rig, which no ideal figure knows of, the design loses to "
        f"zeta = {base['zeta']:g}, omega_n = {base['omega_n']:g}: {'; '.join(parts)}. "
        + (
            "What a larger --max-ms brings stands below."
            if document["scenarios"] == "emulated" and found["relaxed"] is not None
            else "`tune --scenarios emulated` designs for that rig."
        )
    )


def print_emulated(document: dict[str, Any]) -> None:
    """Print the rows of the emulated rig, and what robustness costs there."""
    found = document["emulated"]
    if found is None:
        return
    pair = document["baseline"]
    name = "" if pair is None else f"zeta={pair['zeta']:g}, omega_n={pair['omega_n']:g}"
    rows = [*_rows("design", found)]
    if found["baseline"] is not None:
        rows += _rows(name, found["baseline"])
    less = found["relaxed"]
    if less is not None:
        rows += _rows(f"Ms {_limit(less)}", less)
    table(
        f"On the emulated rig at T = {1e3 * found['period']:g} ms ({_effects(found)}), "
        f"{found['seeds']} runs with noise",
        ("controller", "beta_c/beta", "ITAE median", "[2.5 %, 97.5 %]", "variation", "balls lost"),
        rows,
    )
    if less is None:
        return
    (zeta, omega_n), own = less["poles"][0], document["worst_case"]
    sys.stdout.write(
        f"What robustness costs: with Ms {_limit(less)} the best poles are zeta = {zeta:.4g}, "
        f"omega_n = {omega_n:.4g} rad/s (Ms {number(less['ms'])}, one more sample "
        f"{number(less['ms_one_more_sample'])}) and the worst median ITAE is "
        f"{less['worst']['itae']['median']:.3g}; the design above has Ms {number(own['ms'])}, one "
        f"more sample {number(own['ms_one_more_sample'])}, and "
        f"{shown('itae', found['worst']['itae']['median'], 3)}. Ms is that of the loop without the "
        "coil.\n\n"
    )


def _effects(found: dict[str, Any]) -> str:
    return ", ".join(found["effects"])


def _limit(less: dict[str, Any]) -> str:
    return "not limited" if less["max_ms"] is None else f"≤ {less['max_ms']:.3g}"


def _rows(name: str, found: dict[str, Any]) -> list[tuple[str, ...]]:
    return [tuple(map(plain, row)) for row in emulated_rows(name, found, _interval, digits=6)]


def _interval(itae: Mapping[str, float]) -> tuple[Runs, ...]:
    low, high = (Quantity(itae[end], digits=3) for end in ("low", "high"))
    return (("[", low, ", ", high, "]"),)
