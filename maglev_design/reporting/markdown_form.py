"""A report as markdown for a code host: its maths, its pipe tables, figures beside it."""

from __future__ import annotations

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
from maglev_design.reporting.derivation_text import aligned
from maglev_design.reporting.escape import markdown_code, markdown_line, markdown_maths
from maglev_design.reporting.words import number_text

PAGE = "report.html"
_RULES = {"l": "---", "r": "---:", "p": "---"}


HOST_TAG = r" \tag{%s}"
"""How a formula is numbered where MathJax reads it."""
PLAIN_TAG = r" \qquad \text{(%s)}"
"""The same for pandoc, which knows no tags."""


def markdown(report: Report, figures: str, tag: str = HOST_TAG) -> str:
    """Return the report as one markdown document.

    Parameters
    ----------
    report : Report
    figures : str
        Folder of the figures, relative to the document.
    tag : str
        LaTeX behind a numbered formula, ``%s`` its number.
    """
    lines = [f"# {markdown_line(report.title)}", "", markdown_line(report.subtitle), ""]
    for section in report.sections:
        lines += [f"{'#' * (section.depth + 1)} {markdown_line(section.title)}", ""]
        lines += _blocks(report, section, figures, tag)
    return "\n".join(lines).rstrip() + "\n"


def _blocks(report: Report, section: ReportSection, figures: str, tag: str) -> list[str]:
    return [line for block in section.blocks for line in (*_block(report, block, figures, tag), "")]


def _block(report: Report, block: Block, figures: str, tag: str) -> list[str]:  # noqa: PLR0911 - one a kind
    match block:
        case Paragraph(runs):
            return [_runs(report, runs)]
        case Bullets(items):
            return [f"- {_runs(report, item)}" for item in items]
        case Formula(rows, number):
            tagged = tag % number if number else ""
            return ["$$", markdown_maths(aligned(rows)) + tagged, "$$"]
        case Table():
            return _table(report, block)
        case Figure(name, caption, command):
            label = report.labels[name]
            told = f"**{label}.** {_runs(report, caption)} Made by {markdown_code(command)}."
            return [f"![{label}]({figures}/{name}.svg)", "", told]
        case Listing(text):
            fence = "```"
            while fence in text:
                fence += "`"
            return [f"{fence}text", *text.splitlines(), fence]
        case Explorer():
            return [
                f"The page [{PAGE}]({PAGE}) has this loop with sliders: poles and ratio move, "
                "response, poles and sensitivity follow."
            ]


def _table(report: Report, table: Table) -> list[str]:
    def row(cells: tuple[Runs, ...]) -> str:
        return "| " + " | ".join(_runs(report, cell) for cell in cells) + " |"

    told = f"**{report.labels[table.id]}.** {_runs(report, table.caption)} "
    return [
        told + f"Made by {markdown_code(table.command)}.",
        "",
        row(table.header),
        "| " + " | ".join(_RULES[letter] for letter in table.align) + " |",
        *map(row, table.rows),
    ]


def _runs(report: Report, runs: Runs) -> str:
    return "".join(_inline(report, run, begins=n == 0) for n, run in enumerate(runs))


def _inline(report: Report, run: Inline, *, begins: bool) -> str:
    match run:
        case Maths(latex):
            return f"${markdown_maths(latex)}$"
        case Code(text):
            return markdown_code(text)
        case Strong(text):
            return f"**{markdown_line(text).strip()}**" + (" " if text.endswith(" ") else "")
        case Quantity(value, unit, digits):
            return number_text(value, unit, digits)
        case Link(target):
            return report.labels[target]
    return _spaced(run, begins=begins)


def _spaced(text: str, *, begins: bool) -> str:
    """Return text in one line, with a space at its ends where it had one."""
    before, after = text[:1].isspace(), text[-1:].isspace() and bool(text.strip())
    return " " * before + markdown_line(text, begins=begins) + " " * after
