"""The design on the emulated rig: what the rig file says and the design does not model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from maglev_design.figures import DESCRIBED
from maglev_design.record import DesignRecord
from maglev_design.reporting.chapters_theory import RATIO
from maglev_design.reporting.commands import design_command
from maglev_design.reporting.content import (
    Paragraph,
    Quantity,
    ReportSection,
    Runs,
    Strong,
    tabled,
)


def emulated_chapter(record: DesignRecord) -> ReportSection | None:
    """Return what the design does on the emulated rig; None where the rig emulates nothing."""
    found, pair = record.document.get("emulated"), record.document["baseline"]
    if found is None:
        return None
    rows = [*emulated_rows("design", found)]
    if found["baseline"] is not None and pair is not None:
        rows += emulated_rows("yardstick", found["baseline"])
    table = tabled(
        "emulated",
        "The sampled loop with every effect of the rig's own table: medians and 95 % intervals "
        "over runs with other noise.",
        ("controller", RATIO, "ITAE", "from", "to", "voltage variation", "balls lost"),
        rows,
        design_command(record),
        "lrrrrrr",
    )
    told: Runs = (
        f"The rig file says what the design does not model: {', '.join(found['effects'])}. ",
        "With it, at the period ",
        Quantity(1e3 * found["period"], "ms"),
        f", the controller was run {found['seeds']} times with noise. ",
        Strong(_verdict(found)),
    )
    return ReportSection("On the emulated rig", (Paragraph(told), table))


LOST = "On the rig that the file describes the ball is lost: no other figure of this report holds."


def is_lost(found: Mapping[str, Any] | None) -> bool:
    """Whether any run on the emulated rig loses the ball."""
    return found is not None and bool(found["lost"] or found["worst"]["lost"])


def _verdict(found: Mapping[str, Any]) -> str:
    """Return what the table says, in a sentence."""
    if is_lost(found):
        return LOST
    other = found["baseline"]
    if other is None:
        return "Every ball levitates."
    worst, theirs = (x["worst"]["itae"]["median"] for x in (found, other))
    return (
        "The yardstick has the smaller error there; the ideal figures of the other chapters do not "
        "know of it."
        if theirs < worst
        else "The design has the smaller error there, too."
    )


def _from_to(itae: Mapping[str, float]) -> tuple[Runs, ...]:
    """Return the ends of an interval as two cells."""
    return (
        (Quantity(itae["low"], DESCRIBED["itae"].unit),),
        (Quantity(itae["high"], DESCRIBED["itae"].unit),),
    )


def parts_of(found: Mapping[str, Any]) -> tuple[Mapping[str, Any], ...]:
    """Return what came out at the exact ratio and, where that is another, at the worst one."""
    return tuple({part["ratio"]: part for part in (found, found["worst"])}.values())


def emulated_rows(
    name: str,
    found: Mapping[str, Any],
    interval: Callable[[Mapping[str, float]], tuple[Runs, ...]] = _from_to,
    digits: int = 4,
) -> Iterator[tuple[Runs, ...]]:
    """Yield what became of one controller: a row for each ratio, `digits` of which are shown."""
    for part in parts_of(found):
        yield (
            (name,),
            (Quantity(part["ratio"], digits=digits),),
            (Quantity(part["itae"]["median"], DESCRIBED["itae"].unit),),
            *interval(part["itae"]),
            (Quantity(part["total_variation"]["median"], "V"),),
            (f"{part['lost']} of {part['seeds']}",),
        )
