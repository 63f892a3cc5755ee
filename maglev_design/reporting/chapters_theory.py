"""Chapters on why it holds: how to read the figures, the derivation, the Routh array."""

from __future__ import annotations

from itertools import groupby

from maglev_design.controller.design import (
    true_equilibrium,
)
from maglev_design.controller.plant import (
    path_gaps,
)
from maglev_design.programs import routh_program, slope_program
from maglev_design.record import DesignRecord
from maglev_design.reporting import prose
from maglev_design.reporting.commands import DERIVE, REPORT
from maglev_design.reporting.content import (
    Block,
    Bullets,
    Code,
    Formula,
    Link,
    Maths,
    Paragraph,
    Quantity,
    ReportSection,
    Runs,
    Strong,
    Table,
    tabled,
    yes,
)
from maglev_design.reporting.derivation_steps import Derivation
from maglev_design.reporting.words import unit_latex

RATIO = Maths(r"\beta_c/\beta")


def reading_chapter(record: DesignRecord) -> ReportSection:
    """Return what a reader could otherwise take wrongly."""
    document = record.document
    worst, other = document["worst_case"], document["other_sign"]
    low, high = document["rig"]["limits"]["voltage"]
    items: list[Runs] = [
        (
            RATIO,
            " is the controller's over the plant's: the controller stays and the plant moves.",
        ),
        (
            "The ISE weighs the square of the error: it ranks the initial transient and hardly "
            "anything else. The ITAE weighs the error by the time, and with a wrong ",
            Maths(r"\beta_c"),
            " it is nearly all ramp error during the move, about ",
            Maths(r"\frac{k_3}{\rho k_0} (1 - \rho) C_Y \dot{y}^*"),
            ".",
        ),
        (
            "The linear figures hold at every gap of the path, not at ",
            Maths("Y"),
            " alone: the loop's gain changes on the way.",
        ),
        (
            "One more sample is the loop with one period of computation delay that nobody planned "
            "for: its peak of ",
            Maths(r"\lvert S\rvert"),
            " is ",
            Quantity(worst["ms_one_more_sample"]),
            ", its spectral radius ",
            Quantity(worst["spectral_radius_one_more_sample"]),
            ".",
        ),
        ("Limits on the voltage are on what is commanded, before the clamp.",),
    ]
    if other["crashed"]:
        items.append(("With the initial error of the other sign the ball is lost.",))
    else:
        outside = other["min_voltage"] < (low or 0) or (
            high is not None and other["peak_voltage"] > high
        )
        items.append(
            (
                "With the initial error of the other sign the command goes from ",
                Quantity(other["min_voltage"], "V"),
                " to ",
                Quantity(other["peak_voltage"], "V"),
                ", which is clamped on the way." if outside else ".",
            )
        )
    return ReportSection("How to read it", (Bullets(tuple(items)),))


def routh_chapter(record: DesignRecord, derivation: Derivation) -> ReportSection:
    """Return the Routh array in letters, and its first column in numbers."""
    columns = max(len(entries) for _, entries in derivation.routh)
    letters = tabled(
        "routh-letters",
        "The Routh array. Each entry below the first two rows is made of the two rows above it.",
        ("power", *(f"column {n}" for n in range(1, columns + 1))),
        (
            (
                Maths(power),
                *(Maths(rf"\displaystyle {entry}") for entry in entries),
                *[""] * (columns - len(entries)),
            )
            for power, entries in derivation.routh
        ),
        DERIVE,
        "l" * (columns + 1),
    )
    told: Runs = (
        "The continuous loop has the polynomial ",
        Maths("p(s) = s^4 + a_3 s^3 + a_2 s^2 + a_1 s + a_0"),
        ", its coefficients at any gap as in ",
        Link("A7-routh"),
        ". All roots lie left of zero if and only if the first column of its Routh array, ",
        Link("routh-letters"),
        ", is positive; ",
        Link("routh"),
        " has the numbers.",
    )
    return ReportSection("Routh array", (Paragraph(told), letters, _routh_table(record)), 2)


def _routh_table(record: DesignRecord) -> Table:
    """Return the array's first column as designed and at the corners of gaps and ratios."""
    ratios = record.document["family"]["ratios"]
    gaps = sorted({float(gap) for gap in path_gaps(record.rig, 2)})
    corners = [(gap, ratio) for gap in gaps for ratio in sorted(set(ratios))]
    points = [(record.design.Y, 1.0), *corners]
    found = [_first_column(record, *point) for point in points]
    rows = (
        (
            Quantity(gap, "m"),
            Quantity(ratio),
            *map(Quantity, column),
            yes(all(x > 0 for x in column)),
        )
        for (gap, ratio), column in zip(points, found, strict=True)
    )
    units = (("s^4",), *((f"s^{4 - n}", f"1/s^{n}".removesuffix("^1")) for n in range(1, 5)))
    powers: tuple[Runs, ...] = tuple(
        (Maths(power), *((" [", Maths(unit_latex(unit[0])), "]") if unit else ()))
        for power, *unit in units
    )
    return tabled(
        "routh",
        "First column of the Routh array: as designed, and at the ends of the gaps travelled with "
        "the ends of the ratio.",
        ("gap", RATIO, *powers, "stable"),
        rows,
        REPORT,
        "rr" + "r" * 5 + "l",
    )


def _first_column(record: DesignRecord, gap: float, ratio: float) -> tuple[float, ...]:
    rig, design = record.rig, record.design
    believed = design.believed
    rest = true_equilibrium(rig, design.beta_at(ratio), gap)
    slope, believed_gain = slope_program(design.controller).scalar()(
        rest.U, gap, believed.beta, rig.plant.gap_offset, believed.C_U
    )
    known = {
        "rho": rest.C_U * slope / believed_gain,
        "C_Y_true": rest.C_Y,
        "C_Y_hat": believed.C_Y,
        **design.named_gains,
    }
    array = routh_program(design.controller)
    values = dict(
        zip(array.outputs, array.scalar()(*[known[x] for x in array.inputs]), strict=True)
    )
    return tuple(values[f"row{power}_0"] for power in range(4, -1, -1))


def derivation_chapters(record: DesignRecord, derivation: Derivation) -> tuple[ReportSection, ...]:
    """Return the whole derivation, the Routh array in its place, and the letters."""
    opening = Paragraph(
        (
            "From Newton's law to the loop that runs, in the letters and with the numbers of "
            "Belmonte et al., Mathematics 9 (2021) 1424; equations that the paper does not have "
            "carry the number of the one they follow, and a word. Every equation was proved by the "
            "program: the form shown here minus the form derived from the model is zero. "
            "Postulates and definitions have nothing to prove and say so. Printed again by ",
            Code(DERIVE),
            ".",
        )
    )
    chapters = [ReportSection("The derivation", (opening,))]
    for title, members in groupby(derivation.steps, key=lambda step: step.section):
        blocks: list[Block] = []
        for step in members:
            proved = {None: "", "0": " Proved."}.get(step.residual, " Not proved.")
            blocks += [
                Paragraph((Strong(f"{step.title}."),)),
                Formula(step.rows, step.id),
                Paragraph((*prose.runs(step.reason), proved)),
            ]
        chapters.append(ReportSection(title, tuple(blocks), 2))
        if any(block.tag == "A7-routh" for block in blocks if isinstance(block, Formula)):
            chapters.append(routh_chapter(record, derivation))
    letters = tabled(
        "letters",
        "The letters.",
        ("letter", "unit", "meaning"),
        (
            (
                Maths(latex),
                "–" if unit == "-" else Maths(unit_latex(unit)),  # noqa: RUF001 - a dash
                prose.runs(meaning),
            )
            for latex, unit, meaning in derivation.symbols
        ),
        DERIVE,
        "llp",
    )
    return (*chapters, ReportSection("Letters", (letters,), 2))
