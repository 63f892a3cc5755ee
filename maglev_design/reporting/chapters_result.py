"""Chapters on what came out: the tuning, the worst case, limits, margins, checks, alternatives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from maglev_design.figures import DESCRIBED, MARGINS, OBJECTIVES, OF_A_FAMILY, PARTS
from maglev_design.record import DesignRecord, called
from maglev_design.reporting import prose
from maglev_design.reporting.chapter_emulated import LOST, is_lost
from maglev_design.reporting.commands import REPORT, design_command
from maglev_design.reporting.content import (
    Block,
    Cell,
    Code,
    Figure,
    Inline,
    Link,
    Maths,
    Paragraph,
    Quantity,
    ReportSection,
    Runs,
    Strong,
    tabled,
    yes,
)
from maglev_design.reporting.plots.design import drawable

RATIO = Maths(r"\beta_c/\beta")
LABELS: Mapping[str, Cell] = {
    "ms": ("peak of ", Maths(r"\lvert S\rvert")),
    "ms_one_more_sample": ("the same, one more sample",),
    "ratio": ("at ", RATIO),
}
"""Of figures that a report writes in letters."""
ZETA, OMEGA = Maths(r"\zeta"), Maths(r"\omega_n")


def poles_runs(poles: Any) -> Runs:
    """Return pole pairs in words: one for a double pair, two otherwise."""
    pairs = [tuple(pair) for pair in poles]
    shown: list[Inline] = []
    for n, (zeta, omega_n) in enumerate(pairs[:1] if len(set(pairs)) == 1 else pairs):
        shown += [" and "] if n else []
        shown += [ZETA, " = ", Quantity(zeta), ", ", OMEGA, " = ", Quantity(omega_n, "rad/s")]
    return tuple(shown)


def times_runs(factor: float | None) -> Inline:
    """Return a factor; None is infinity, the worst case of the other being zero."""
    return "infinitely many" if factor is None else Quantity(factor, "-", 3)


def summary_chapter(record: DesignRecord) -> ReportSection:
    """Return the answer in a few sentences."""
    document = record.document
    key, worst, base = document["objective"], document["worst_case"], document["baseline"]
    low, high = document["family"]["ratios"]
    unit = DESCRIBED[key].unit
    first: Runs = (
        "The desired poles are ",
        *poles_runs(document["poles"]),
        ", the same pair twice, eq. " if _double(document) else ". ",
        *((Link("24"), ".") if _double(document) else ()),
        f" They have {_rank(document['status'])} {key.upper()} of the tracking error at its worst "
        "over ",
        RATIO,
        " from ",
        Quantity(low),
        " to ",
        Quantity(high),
        ": ",
        Quantity(worst[key], unit),
        *(() if base is None else _compared(base)),
        ".",
    )
    status: Runs = (Strong("Status: "), document["message"])
    lost = is_lost(document["emulated"])
    warning = (Paragraph((Strong(LOST),)),) if lost else ()
    return ReportSection("The result", (*warning, Paragraph(first), Paragraph(status)))


def _rank(status: str) -> str:
    """Return what is said of the objective: only the end of a search says that it is smallest."""
    return "the smallest" if status in ("optimal", "on_bound") else "this"


def _is_better(other: Mapping[str, Any]) -> bool:
    """Whether an alternative keeps the limits and has the smaller worst case."""
    return bool(other["feasible"] and (other["improvement"] is None or other["improvement"] > 1))


def _compared(base: Mapping[str, Any]) -> Runs:
    """Return by how much the design is better than the yardstick, or worse."""
    broken = f" (a choice that breaks these: {', '.join(base['violated'])})"
    factor = base["improvement"]
    smaller = factor is None or factor >= 1
    return (
        ", ",
        times_runs(factor if smaller else 1 / factor),
        f" times {'smaller' if smaller else 'larger'} than with ",
        *poles_runs([(base["zeta"], base["omega_n"])]),
        " under the same limits",
        *(() if base["feasible"] else (broken,)),
    )


def _double(document: Mapping[str, Any]) -> bool:
    first, second = document["poles"]
    return bool(first == second)


def worst_chapter(record: DesignRecord) -> ReportSection:
    """Return the figures of the loop at their worst, of the yardstick, and without any error."""
    document = record.document
    base, (low, high) = document["baseline"], document["family"]["ratios"]
    others = [] if base is None else [base["worst_case"]]
    columns = [document["worst_case"], *others, document["nominal"]]

    def row(key: str) -> tuple[Cell, ...]:
        told = DESCRIBED[key]
        cells = (Quantity(c[key], told.unit) if key in c else "–" for c in columns)  # noqa: RUF001
        return (LABELS.get(key, told.label), *cells)

    unit = DESCRIBED["itae"].unit
    rows = [*map(row, OBJECTIVES)]
    rows += [
        (f"ITAE, {part}", *(Quantity(c["itae_split"][part], unit) for c in columns))
        for part in PARTS
    ]
    rows += map(row, OF_A_FAMILY)
    name = called(document)
    table = tabled(
        "worst",
        (
            "Figures of the loop at their worst over ",
            RATIO,
            " from ",
            Quantity(low),
            " to ",
            Quantity(high),
            ", and on the plant that the controller believes in.",
        ),
        ("figure", name, *(["yardstick"] if others else []), f"{name}, nominal"),
        rows,
        design_command(record),
        "l" + "r" * len(columns),
    )
    share = _share(document["worst_case"]["itae_split"])
    told: list[Block] = [
        Paragraph(
            (
                *(() if base is None else _yardstick(base)),
                Link("worst"),
                " has the true error ",
                Maths("e = y - y^*"),
                " over the whole run; start is what happens before the move, hold what follows it.",
            )
        ),
        table,
    ]
    if share is not None:
        part, value = share
        told.append(
            Paragraph(
                (
                    "Of the worst-case ITAE, ",
                    Quantity(100 * value, "-", 3),
                    f" % falls in the {part}.",
                )
            )
        )
    return ReportSection("The worst case", tuple(told))


def _share(split: Mapping[str, float | None]) -> tuple[str, float] | None:
    """Return the part of the run with the most of an index, and its share."""
    known = {part: value for part, value in split.items() if value is not None}
    total = sum(known.values())
    if len(known) < len(split) or total <= 0:
        return None
    part = max(known, key=lambda name: known[name])
    return part, known[part] / total


def limits_chapter(record: DesignRecord) -> ReportSection:
    """Return the limits and the margins."""
    document = record.document
    signs = {"upper": Maths(r"\le"), "lower": Maths(r"\ge")}
    limits = tabled(
        "limits",
        "The limits, each at its worst.",
        ("limit", "value", "allowed", "kept"),
        (
            (
                c["name"],
                Quantity(c["value"], c["unit"]),
                "no limit"
                if c["limit"] is None
                else (signs[c["side"]], " ", Quantity(c["limit"], c["unit"])),
                yes(c["satisfied"]),
            )
            for c in document["constraints"]
        ),
        design_command(record),
        "lrrl",
    )
    names = {"gain_up": "gain may rise by the factor", "gain_down": "gain may fall by the factor"}
    names["ms"] = "peak of |S|"
    margins = document["margins"]
    table = tabled(
        "margins",
        "Margins of the sampled loop, each at the gap and the ratio where it is smallest.",
        ("margin", "value", "gap", RATIO),
        (
            (
                names.get(key, DESCRIBED[key].label),
                Quantity(margins[key]["value"], DESCRIBED[key].unit),
                Quantity(margins[key]["gap"], "m"),
                Quantity(margins[key]["ratio"]),
            )
            for key in (*MARGINS, "ms")
        ),
        design_command(record),
        "lrrr",
    )
    told = Paragraph(
        (
            "The plant is unstable, so its gain may neither rise nor fall too far. ",
            Maths(r"M_s = \max\lvert S\rvert"),
            " is one over the smallest distance of the Nyquist curve from ",
            Maths("-1"),
            ", of the sampled loop with its delay, over all gaps of the path.",
        )
    )
    return ReportSection("Limits and margins", (told, limits, table))


def _yardstick(base: Mapping[str, Any]) -> Runs:
    """Return which poles the design is compared with."""
    poles = poles_runs([(base["zeta"], base["omega_n"])])
    return ("The yardstick is ", *poles, ", with the same method and reading. ")


def verification_chapter(record: DesignRecord) -> ReportSection:
    """Return how the optimum was checked."""
    document = record.document
    key, check = document["objective"], document["verification"]
    rows = [(called(document), document["worst_case"], check)]
    base = document["baseline"]
    if base is not None:
        rows.append(("yardstick", base["worst_case"], base["verification"]))
    table = tabled(
        "verification",
        f"The worst-case {key.upper()}, computed twice.",
        ("design", "first integrator", "second integrator", "relative difference", "passed"),
        (
            (
                name,
                Quantity(found[key], DESCRIBED[key].unit, 7),
                Quantity(again[key], DESCRIBED[key].unit, 7),
                Quantity(again["relative_difference"], "-", 2),
                yes(again["passed"]),
            )
            for name, found, again in rows
        ),
        design_command(record),
        "lrrrl",
    )
    told = Paragraph(
        (
            "The worst case was run again by an integrator that shares nothing with the first: ",
            check["integrator"],
            ". Allowed is a relative difference of ",
            Quantity(check["tolerance"]),
            ".",
        )
    )
    return ReportSection("Verification", (told, table))


def alternatives_chapter(record: DesignRecord) -> ReportSection | None:
    """Return what another choice would give; None where none was tried."""
    document = record.document
    key = document["objective"]
    if not document["alternatives"]:
        return None
    rows = []
    for other in document["alternatives"]:
        worst = other["worst_case"]
        anew = "tuned anew" if other["tuned"] else "same poles"
        if other.get("supply_voltage"):
            anew += f", {other['supply_voltage']:.3g} V supply"
        kind = "U measured:" if other["kind"] == "planning" else other["kind"]
        rows.append(
            (
                (f"{kind} ", Code(other["name"]), f", {anew}"),
                Quantity(worst[key], DESCRIBED[key].unit),
                times_runs(other["improvement"]),
                Quantity(worst["peak_voltage"], "V"),
                Quantity(worst["ms"]),
                yes(other["feasible"]),
            )
        )
    worst_key, ms = f"worst {key.upper()}", Maths("M_s")
    table = tabled(
        "alternatives",
        "What another choice would give, all else as it is.",
        ("choice", worst_key, "better by", "largest command", ms, "limits kept"),
        rows,
        design_command(record),
        "lrrrrl",
    )
    blocks: list[Block] = [table]
    planned = next((a for a in document["alternatives"] if a["kind"] == "planning"), None)
    if planned is not None and _is_better(planned):
        blocks.append(
            Paragraph(
                (
                    "Measuring the voltage ",
                    Maths("U"),
                    " that holds the ball to ",
                    Quantity(100 * record.rig.uncertainty.voltage_error, "%"),
                    ", instead of computing it from ",
                    Maths(r"\beta_c"),
                    ", would make the worst case ",
                    times_runs(planned["improvement"]),
                    " times smaller, tuned anew. It rests on ",
                    Maths("y_0"),
                    " instead: where that is wrong, the error of the move comes back.",
                )
            )
        )
    return ReportSection("What another choice would give", tuple(blocks))


def certificate_chapter(record: DesignRecord) -> ReportSection | None:
    """Return what is proved of the sampled loop; None where the record says nothing of it."""
    found = record.document.get("certificate")
    if not found:
        return None
    if not found["certified"]:
        return ReportSection(
            "Certificate", (Paragraph((f"The sampled loop is {found['status']}.",)),)
        )
    (near, far), (low, high) = found["gaps"], found["ratios"]
    told = Paragraph(
        (
            "One quadratic Lyapunov function ",
            Maths("V = x^T P x"),
            " falls at every step of the sampled loop, at every gap and ratio of the table. ",
            Maths("P"),
            " was found by a solver, rounded to fractions and verified in exact arithmetic.",
        )
    )
    rows: list[tuple[Cell, Cell]] = [
        ("gaps from", Quantity(near, "m")),
        ("gaps to", Quantity(far, "m")),
        ((RATIO, " from"), Quantity(low)),
        ((RATIO, " to"), Quantity(high)),
        (
            (Maths(r"\sqrt{V}"), " falls at least as ", Maths("e^{-at}"), ", ", Maths("a"), " ="),
            Quantity(found["decay"], "1/s"),
        ),
    ]
    if found["largest_beta_error"] is not None:
        widest = Quantity(100 * found["largest_beta_error"], "%")
        rows.append((("largest error of ", Maths(r"\beta"), " with such a proof"), widest))
    table = tabled(
        "certificate",
        "What is proved of the sampled loop.",
        ("quantity", "value"),
        rows,
        "maglev-design certify design/design.json",
        "lr",
    )
    return ReportSection("Certificate", (told, table))


CAPTIONS: Mapping[str, Runs] = {
    "tracking": ("Gap and reference, each loop at its own worst ratio.",),
    "error": prose.runs(
        "Tracking error: the start on the left, where the initial error dies out, and the rest on "
        "the right, in another scale, where what is left is the ramp error of a wrong `beta`."
    ),
    "voltage": ("Commanded voltage; dotted is the actuator's range.",),
    "landscape": (
        "The worst case over the whole search box: darker is better. Lines are the limits, the "
        "star is the design, a disc the yardstick.",
    ),
    "trade_off": prose.runs(
        "What robustness costs: each point is a placement that keeps every limit, with the error "
        "of `beta` up to which the sampled loop is proved stable."
    ),
}
"""The figures of a design by their names in :mod:`maglev_design.reporting.plots.design`."""


def figures_chapter(record: DesignRecord) -> ReportSection:
    """Return the figures; a sentence where the record came without its curves."""
    names = drawable(record.curves)
    if not names:
        missing = ("The record came without ", Code("design.npz"), ", which holds the curves.")
        return ReportSection("Figures", (Paragraph(missing),))
    figures = tuple(Figure(name, CAPTIONS[name], REPORT) for name in names)
    return ReportSection("Figures", figures)
