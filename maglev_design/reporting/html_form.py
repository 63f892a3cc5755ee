"""A report as one HTML file without network access: MathML, figures inside, sliders that work."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from typing import Any

from markupsafe import Markup, escape

from maglev_design.figures import DESCRIBED, OBJECTIVES
from maglev_design.reporting import mathml
from maglev_design.reporting.content import (
    Block,
    Bullets,
    Code,
    Explorer,
    Figure,
    Formula,
    Inline,
    Link,
    Listing,
    Maths,
    Paragraph,
    Quantity,
    Report,
    ReportSection,
    Runs,
    Strong,
    Table,
)
from maglev_design.reporting.escape import one_line
from maglev_design.reporting.templates import template, text_of
from maglev_design.reporting.words import GAIN_UNITS, number_text, unit_text

READOUTS = (
    *((key, DESCRIBED[key].label, unit_text(DESCRIBED[key].unit)) for key in OBJECTIVES),
    ("peak", "largest command", "V"),
    ("least", "smallest command", "V"),
    ("ms", "peak of |S|", ""),
    ("radius", "spectral radius", ""),
    ("fate", "the loop", ""),
)
"""What the page's script fills in: id, name and unit."""
PLOTS = ("gap", "start", "rest", "voltage", "poles", "sensitivity")


def html(report: Report, pictures: Mapping[str, bytes]) -> str:
    """Return the report as one page.

    Parameters
    ----------
    report : Report
    pictures : mapping of str to bytes
        The SVG of every figure, by its id.
    """
    explorers = [block for block in report.blocks() if isinstance(block, Explorer)]
    sections = [
        {
            "id": f"section-{n}",
            "title": one_line(section.title),
            "depth": section.depth,
            "body": _body(report, section, pictures),
        }
        for n, section in enumerate(report.sections, 1)
    ]
    return template("report.html").render(
        title=one_line(report.title),
        subtitle=one_line(report.subtitle),
        sections=sections,
        style=Markup(text_of("report.css")),  # noqa: S704 - our own file
        script=Markup(_script(explorers[0])) if explorers else "",  # noqa: S704 - made below
    )


def _script(explorer: Explorer) -> str:
    """Return the page's script; user text cannot end it, because no "<" is left in the data."""
    data = json.dumps(explorer.data, ensure_ascii=True, allow_nan=False).replace("<", "\\u003c")
    return f"const D = {data};\nconst P = {explorer.script};\n{text_of('explorer.js')}\nbegin();\n"


def _body(report: Report, section: ReportSection, pictures: Mapping[str, bytes]) -> Markup:
    return Markup("\n").join(_block(report, block, pictures) for block in section.blocks)


def _block(  # noqa: PLR0911 - one a kind
    report: Report, block: Block, pictures: Mapping[str, bytes]
) -> Markup:
    match block:
        case Paragraph(runs):
            return Markup("<p>{}</p>").format(_runs(report, runs))
        case Bullets(items):
            told = (Markup("<li>{}</li>").format(_runs(report, item)) for item in items)
            return Markup("<ul>\n{}\n</ul>").format(Markup("\n").join(told))
        case Formula(rows, tag):
            maths = Markup(mathml.displayed(rows))  # noqa: S704 - LaTeX of this program
            number = Markup("<span>({})</span>").format(tag) if tag else Markup("<span></span>")
            return Markup('<div class="formula" id="{}"><div>{}</div>{}</div>').format(
                _anchor(tag), maths, number
            )
        case Table():
            return _table(report, block)
        case Figure(name, caption, command):
            picture = base64.b64encode(pictures[name]).decode("ascii")
            return Markup(
                '<figure id="{}"><img src="data:image/svg+xml;base64,{}" alt="{}">'
                "<figcaption>{}</figcaption></figure>"
            ).format(
                _anchor(name),
                picture,
                report.labels[name],
                _caption(report, name, caption, command),
            )
        case Listing(text):
            return Markup("<pre>{}</pre>").format(text)
        case Explorer(data, _):
            return _explorer(data)


def _caption(report: Report, name: str, caption: Runs, command: str) -> Markup:
    return Markup("<b>{}.</b> {} Made by <code>{}</code>.").format(
        report.labels[name], _runs(report, caption), command
    )


def _table(report: Report, table: Table) -> Markup:
    def row(cells: tuple[Runs, ...], tag: str) -> Markup:
        shown = (
            Markup('<{0} class="{1}">{2}</{0}>').format(Markup(tag), letter, _runs(report, cell))  # noqa: S704
            for cell, letter in zip(cells, table.align, strict=True)
        )
        return Markup("<tr>{}</tr>").format(Markup("").join(shown))

    return Markup(
        '<figure class="table" id="{}"><figcaption>{}</figcaption>\n<table><thead>{}</thead>\n'
        "<tbody>{}</tbody></table></figure>"
    ).format(
        _anchor(table.id),
        _caption(report, table.id, table.caption, table.command),
        row(table.header, "th"),
        Markup("\n").join(row(cells, "td") for cells in table.rows),
    )


def _runs(report: Report, runs: Runs) -> Markup:
    return Markup("").join(_inline(report, run) for run in runs)


def _inline(report: Report, run: Inline) -> Markup:
    match run:
        case Maths(latex):
            return Markup(mathml.inline(latex))  # noqa: S704 - LaTeX of this program
        case Code(text):
            return Markup("<code>{}</code>").format(one_line(text))
        case Strong(text):
            return Markup("<b>{}</b>").format(text)
        case Quantity(value, unit, digits):
            return Markup('<span class="q">{}</span>').format(number_text(value, unit, digits))
        case Link(target):
            return Markup('<a href="#{}">{}</a>').format(_anchor(target), report.labels[target])
    return escape(run)


def _anchor(name: str) -> str:
    return f"at-{name}" if name else ""


def _explorer(data: dict[str, Any]) -> Markup:
    """Return the sliders, the charts and the numbers that the script fills."""
    gains = tuple((name, unit_text(unit)) for name, unit in GAIN_UNITS.items())
    return Markup(  # noqa: S704 - the template escapes
        template("explorer.html").render(
            sliders=data["sliders"], readouts=READOUTS, plots=PLOTS, gains=gains, gaps=data["gaps"]
        )
    )
