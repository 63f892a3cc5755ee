"""Chapters on what was given: the rig, the control scheme, the commands."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from maglev_design.options import Equilibrium
from maglev_design.record import DesignRecord
from maglev_design.reporting import prose
from maglev_design.reporting.commands import (
    REPORT,
    RIG_FILE,
    design_command,
    preset_of,
    rig_toml,
    simulate_command,
)
from maglev_design.reporting.content import (
    Bullets,
    Code,
    Figure,
    Link,
    Listing,
    Maths,
    Paragraph,
    Quantity,
    ReportSection,
    Runs,
    tabled,
)
from maglev_design.reporting.words import GAIN_UNITS
from maglev_design.rig import fields

READINGS: dict[Equilibrium, str] = {
    "model": "`U` is computed from the controller's own `beta`",
    "appendix-a": "`U` is measured, and `C_U` and `C_Y` follow from it and from the controller's "
    "`beta`",
    "measured": "`U` is measured, and `C_U` and `C_Y` follow from it without any `beta`",
}
METHODS = {"tustin": "the bilinear transformation", "euler": "the forward Euler rule"}
METHODS |= {"zoh": "the step-invariant transformation"}
EQUATION_UNITS = {"period": "s", "Y": "m", "U": "V", "u_min": "V", "u_max": "V", "a22": "-"}
EQUATION_UNITS |= {"b1": "s", "b2": "s", "c1": "V/(m s)", "c2": "V/(m s)", "d": "V/m"}
EQUATION_UNITS |= {"f_y": "V/m", "f_a": "V s^2/m", "x1_max": "m s"}
"""Of the numbers of the difference equation of the law (20)."""


def rig_chapter(record: DesignRecord) -> ReportSection:
    """Return the rig's numbers with units, and where they are from."""
    rig = record.document["rig"]
    rows = ((c, prose.runs(meaning), value) for c, meaning, value in _rig_rows(rig))
    says = [Paragraph(("The rig is ", rig["name"], ". All quantities are in SI units."))]
    for key, start in (("source", "Source of the values: "), ("notes", "What they do not claim: ")):
        if rig.get(key):
            says.append(Paragraph((start, rig[key])))
    table = tabled(
        "rig",
        "The rig: every number that the design rests on.",
        ("key", "meaning", "value"),
        rows,
        design_command(record),
        "lpr",
    )
    return ReportSection("The rig", (*says, table))


def _rig_rows(rig: dict[str, Any]) -> Iterator[tuple[Runs, str, Runs]]:
    for name, unit, meaning in fields():
        table, _, key = name.partition(".")
        if not key or key not in rig.get(table, {}):
            continue
        value = rig[table][key]
        shown: Runs
        if isinstance(value, list):
            shown = (_bound(value[0], unit), " to ", _bound(value[1], unit))
        elif isinstance(value, dict):
            spread = ((f"{word} ", _cell(item, unit), " ") for word, item in value.items())
            shown = tuple(part for run in spread for part in run)
        else:
            shown = (_cell(value, unit),)
        yield (Code(name),), meaning, shown


def _bound(value: float | None, unit: str) -> str | Quantity:
    return "no limit" if value is None else Quantity(value, unit, 9)


def _cell(value: float | str, unit: str) -> str | Quantity:
    return value if isinstance(value, str) else Quantity(value, unit, 9)


def scheme_chapter(record: DesignRecord) -> ReportSection:
    """Return the block diagram and the law with its numbers."""
    design, document = record.design, record.document
    believed = design.believed
    told = Paragraph(
        (
            "The gap is the only measurement. The voltage is the sum of the equilibrium voltage ",
            Maths("U"),
            ", a feedforward ",
            Maths(r"u^*_\delta"),
            " that moves the linearised plant along the reference, and the GPI correction ",
            Maths("w"),
            " made of the tracking error ",
            Maths("e = y - y^*"),
            ", see ",
            Link("diagram"),
            ". Equation ",
            Link("20"),
            " is the law as the paper has it; as printed it holds integrators that cancel on paper "
            "and grow in a computer. What runs is the equivalent form ",
            Link("20-bounded"),
            f" with two bounded states, sampled by {METHODS[design.method]} (",
            Code(design.method),
            ") every ",
            Quantity(document["rig"]["sampling"]["period"], "s"),
            " and held in between. The command is clamped to the actuator's range before it is "
            "applied, because the plant sees ",
            Maths("u^2"),
            ": a negative voltage would pull, too, and turn the loop's sign.",
        )
    )
    figure = Figure(
        "diagram",
        ("The control scheme: Fig. 2 of the paper, with the sampling and the clamp of a rig.",),
        REPORT,
    )
    gain = "gain, eq. (25)" if _double(record) else "gain"
    rows = [
        (Maths("U"), "voltage of the equilibrium", Quantity(believed.U, "V", 8)),
        (Maths("C_U"), "voltage coefficient", Quantity(believed.C_U, "m/(s^2 V)", 8)),
        (Maths("C_Y"), "gap coefficient", Quantity(believed.C_Y, "1/s^2", 8)),
        *(
            (Maths(f"{name[0]}_{name[1]}"), gain, Quantity(value, GAIN_UNITS[name], 8))
            for name, value in document["gains"].items()
        ),
    ]
    controller = tabled(
        "controller",
        (
            "The controller in continuous time. Reading of the equilibrium: ",
            Code(design.equilibrium),
            ", ",
            *prose.runs(READINGS[design.equilibrium]),
            ".",
        ),
        ("letter", "meaning", "value"),
        rows,
        design_command(record),
        "llr",
    )
    difference = tabled(
        "difference",
        "The controller that runs: coefficients of the difference equation.",
        ("coefficient", "value"),
        (
            (Code(name), Quantity(value, EQUATION_UNITS[name], 17))
            for name, value in document["difference_equation"].items()
        ),
        design_command(record),
        "lr",
    )
    return ReportSection("The control scheme", (told, figure, controller, difference))


def _double(record: DesignRecord) -> bool:
    return record.design.poles.first == record.design.poles.second


def commands_chapter(record: DesignRecord) -> ReportSection:
    """Return what makes all of this again."""
    versions, weakest = record.document["versions"], record.document["family"]["ratios"][0]
    blocks: list[Any] = [
        Paragraph(("The design, this report, and one run of the design on a plant that is off:",)),
        Listing("\n".join((design_command(record), REPORT, simulate_command(weakest)))),
        Paragraph(
            (
                "Made with ",
                ", ".join(f"{name} {version}" for name, version in versions.items()),
                ". The same inputs give the same bytes.",
            )
        ),
    ]
    if preset_of(record) is None:
        blocks += [
            Paragraph(("The rig is none of the presets. ", Code(RIG_FILE), " holds:")),
            Listing(rig_toml(record.document["rig"])),
        ]
    else:
        blocks.append(Bullets((("The rig is the preset ", Code(preset_of(record) or ""), "."),)))
    return ReportSection("The commands", tuple(blocks))
