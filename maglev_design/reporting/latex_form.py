"""A report as LaTeX for plain pdflatex: numbered equations, tables with units, PDF figures."""

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
    Runs,
    Strong,
    Table,
)
from maglev_design.reporting.derivation_text import aligned
from maglev_design.reporting.escape import latex_text, one_line
from maglev_design.reporting.templates import template
from maglev_design.reporting.words import number_latex

_HEADINGS = {1: "section", 2: "subsection"}
_COLUMNS = {"l": "l", "r": "r", "p": r">{\raggedright\arraybackslash}p{0.42\textwidth}"}
_RULE = r"\noalign{\smallskip}\hline\noalign{\smallskip}"
LONGEST_TABLE = 16
"""Rows of a table that is kept on one page."""


def latex(report: Report, figures: str) -> str:
    """Return the report as one LaTeX document.

    Parameters
    ----------
    report : Report
    figures : str
        Folder of the figures, relative to the document.
    """
    body = []
    for section in report.sections:
        body.append(rf"\{_HEADINGS[section.depth]}{{{_text(section.title)}}}")
        for before, block in zip((None, *section.blocks), section.blocks, strict=False):
            text = _block(report, block, figures)
            if isinstance(block, Formula) or isinstance(before, Formula):
                body[-1] += "\n" + text  # one paragraph, which a page break does not part
            else:
                body.append(text)
    return template("report.tex").render(
        title=_text(report.title), subtitle=_text(report.subtitle), body="\n\n".join(body)
    )


def _block(report: Report, block: Block, figures: str) -> str:  # noqa: PLR0911 - one a kind
    match block:
        case Paragraph(runs):
            return _runs(report, runs)
        case Bullets(items):
            told = "\n".join(rf"\item {_runs(report, item)}" for item in items)
            return f"\\begin{{itemize}}\n{told}\n\\end{{itemize}}"
        case Formula(rows, tag):
            tagged = rf" \tag{{{_text(tag)}}}\label{{{tag}}}" if tag else ""
            return f"\\begin{{equation*}}\n{aligned(rows)}{tagged}\n\\end{{equation*}}"
        case Table():
            return _table(report, block)
        case Figure(name, caption, command):
            return "\n".join(
                (
                    r"\begin{placed}{figure}",
                    rf"\includegraphics[width=\textwidth]{{{figures}/{name}.pdf}}",
                    rf"\caption{{{_runs(report, caption)} {_made(command)}}}\label{{{name}}}",
                    r"\end{placed}",
                )
            )
        case Listing(text):
            lines = [rf"\listed{{{_typed(line)}}}" for line in text.splitlines() if line.strip()]
            return "\\begin{listing}\n" + "\n".join(lines) + "\n\\end{listing}"
        case Explorer():
            return (
                r"The page \texttt{report.html} has this loop with sliders: poles and ratio move, "
                "response, poles and sensitivity follow."
            )


def _table(report: Report, table: Table) -> str:
    def row(cells: tuple[Runs, ...]) -> str:
        return " & ".join(_runs(report, cell) for cell in cells) + r" \\[1pt]"

    columns = "".join(_COLUMNS[letter] for letter in table.align)
    caption = rf"\caption{{{_runs(report, table.caption)} {_made(table.command)}}}"
    head = (_RULE, row(table.header), _RULE)
    rows = [row(cells) for cells in table.rows]
    if len(rows) <= LONGEST_TABLE:
        lines = (
            r"\begin{placed}{table}",
            r"\small",
            caption + rf"\label{{{table.id}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            *(*head, *rows, _RULE),
            r"\end{tabular}",
            r"\end{placed}",
        )
    else:
        lines = (
            r"{\small",
            rf"\begin{{longtable}}{{{columns}}}",
            caption + rf"\label{{{table.id}}}\\",
            *(*head, r"\endfirsthead", *head, r"\endhead", _RULE, r"\endlastfoot"),
            *rows,
            r"\end{longtable}}",
        )
    return "\n".join(lines)


def _made(command: str) -> str:
    return rf"Made by {_code(command)}."


def _runs(report: Report, runs: Runs) -> str:
    return "".join(_inline(report, run) for run in runs)


def _inline(report: Report, run: Inline) -> str:
    match run:
        case Maths(source):
            return f"${source}$"
        case Code(text):
            return _code(text)
        case Strong(text):
            return rf"\textbf{{{_text(text).strip()}}}" + (" " if text.endswith(" ") else "")
        case Quantity(value, unit, digits):
            return number_latex(value, unit, digits)
        case Link(target):
            kind, _, number = report.labels[target].partition(" ")
            return rf"{kind}~\ref{{{target}}}" if number else rf"(\ref{{{target}}})"
    before, after = run[:1].isspace(), run[-1:].isspace() and bool(run.strip())
    return " " * before + _text(run) + " " * after


def _code(text: str) -> str:
    return rf"\texttt{{{_typed(one_line(text))}}}"


def _typed(line: str) -> str:
    """Return text for the fixed-width font, which may be broken behind a sign."""
    escaped = [latex_text(c) + (r"\allowbreak{}" if c in "/._-=,[:" else "") for c in line]
    return "".join(escaped)


def _text(text: str) -> str:
    return latex_text(one_line(text))
