"""The derivation as a text for the terminal, as markdown or as a LaTeX document.

Names, titles and reasons are data: they are escaped for the format, never interpreted by it; in
reasons and meanings formulas stand between backticks (:mod:`maglev_design.reporting.prose`).
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from typing import Literal, get_args

import sympy as sp
from sympy import Expr, Symbol

from maglev_design.derivation.terms import Equation, Line
from maglev_design.errors import InputError
from maglev_design.reporting import formulas, prose
from maglev_design.reporting.escape import latex_text, markdown_maths, markdown_text
from maglev_design.reporting.words import unit_latex
from maglev_design.symbolic.plant import Entry

Format = Literal["text", "markdown", "latex"]
Row = tuple[str, str]

TEXT_WIDTH = 100
"""Columns of the terminal text."""
LINE_WIDTH = 62
"""Characters of a formula, fractions stacked, that fit a line of the LaTeX page with its number."""
_SIGNS = {"=": "=", ">": ">", "~": r"\approx"}
_TITLE = "Generalised proportional integral control of a magnetic levitation system"
_INTRODUCTION = (
    "Every equation carries its proof: the paper's form, corrected where the print is wrong, minus "
    "the form derived from the model, simplified. A residual of 0 means proved; postulates and "
    "definitions have none. Numbers are those of Belmonte et al., Mathematics 9 (2021) 1424."
)
_PREAMBLE = r"""\documentclass[a4paper]{article}
\usepackage[margin=25mm]{geometry}
\usepackage{amsmath}
\usepackage{longtable}
\setlength{\parindent}{0pt}
\setlength{\parskip}{4pt}
\setlength{\emergencystretch}{3em}
\allowdisplaybreaks
\title{%s}
\author{}
\date{}
"""


def render(equations: Sequence[Equation], symbols: Sequence[Entry], format: Format) -> str:  # noqa: A002
    """Return the derivation as one document.

    Parameters
    ----------
    equations : sequence of Equation
        As :func:`maglev_design.derivation.derivation` returns them.
    symbols : sequence of Entry
        The symbol table; the entries that occur in the equations are printed.
    format : {"text", "markdown", "latex"}
        ``text`` for a terminal, ``markdown`` with GitHub's maths, ``latex`` a whole document for
        plain pdflatex.

    Returns
    -------
    str
        Ends with a newline; the same bytes for the same equations.

    Raises
    ------
    InputError
        For a format that is none of the three.

    Examples
    --------
    >>> from maglev_design.derivation.terms import NOTATION, defined
    >>> from maglev_design.symbolic.plant import C, i, u
    >>> two = defined("2", "The model", "Coil current", [(i, C * u)], "Postulate.")
    >>> print(render([two], NOTATION, "text").split("Coil current")[1].splitlines()[1].strip())
    i = C*u
    """
    writers: dict[str, Callable[[Sequence[Equation], Sequence[Entry]], str]] = {
        "text": _text,
        "markdown": _markdown,
        "latex": _latex,
    }
    if format not in writers:
        raise InputError(f"format {format!r}: allowed are {', '.join(get_args(Format))}")
    return writers[format](equations, occurring(equations, symbols))


def equation_latex(equation: Equation, symbols: Sequence[Entry]) -> str:
    r"""Return the lines of one equation as LaTeX without delimiters, joined by row ends."""
    return aligned(equation_rows(equation, symbols))


def equation_rows(equation: Equation, symbols: Sequence[Entry]) -> list[Row]:
    """Return the rows of one equation as LaTeX left and right of where they are aligned."""
    names = _names(symbols)
    return [row for line in equation.lines for row in _line_rows(line, names)]


def aligned(rows: Sequence[Row]) -> str:
    """Return rows as LaTeX without delimiters, several in an ``aligned``."""
    if len(rows) == 1:
        return " ".join(rows[0]).strip()
    body = " \\\\[3pt]\n".join(f"{left} &{right}" for left, right in rows)
    return "\\begin{aligned}\n" + body + "\n\\end{aligned}"


def records(equations: Sequence[Equation], symbols: Sequence[Entry]) -> list[dict[str, str | None]]:
    """Return id, section, title, latex, text, reason and residual of each equation, for JSON.

    The residual is "0" where the equation was proved and None for postulates and definitions.
    """
    return [
        {
            "id": equation.id,
            "section": equation.section,
            "title": equation.title,
            "latex": equation_latex(equation, symbols),
            "text": "; ".join(_plain(line) for line in equation.lines),
            "reason": prose.plain(equation.reason),
            "residual": None if equation.residual is None else str(equation.residual),
        }
        for equation in equations
    ]


def _names(symbols: Sequence[Entry]) -> dict[Symbol, str]:
    return {entry.symbol: entry.latex for entry in symbols}


def occurring(equations: Sequence[Equation], symbols: Sequence[Entry]) -> list[Entry]:
    """Return the entries of the symbol table that occur in the equations."""
    letters = {
        letter
        for equation in equations
        for line in equation.lines
        for side in (line.lhs, line.rhs)
        for letter in side.atoms(Symbol)
    }
    return [entry for entry in symbols if entry.symbol in letters]


def _verdict(equation: Equation) -> str:
    residual = equation.residual
    if residual is None:
        return "none (postulate or definition)"
    return f"{residual} (proved)" if residual == 0 else f"{residual} (not proved)"


# Text


def _text(equations: Sequence[Equation], symbols: Sequence[Entry]) -> str:
    out = [_TITLE, "=" * len(_TITLE), "", textwrap.fill(_INTRODUCTION, TEXT_WIDTH), ""]
    for section, members in groupby(equations, key=lambda equation: equation.section):
        out += [section, "-" * len(section), ""]
        for equation in members:
            out += [f"({equation.id}) {equation.title}"]
            for line in equation.lines:
                out += _wrapped(_plain(line), "    ", "        ")
            out += _wrapped(prose.plain(equation.reason), "  Why: ", "  ")
            out += _wrapped(_verdict(equation), "  Residual: ", "  ")
            out += [""]
    out += ["Symbols", "-------", ""]
    names = [str(entry.symbol) for entry in symbols]
    wide = max((len(name) for name in names), default=0)
    units = max((len(entry.unit) for entry in symbols), default=0)
    out += [
        f"{name:<{wide}}  {entry.unit:<{units}}  {prose.plain(entry.meaning)}"
        for name, entry in zip(names, symbols, strict=True)
    ]
    return "\n".join(out) + "\n"


def _plain(line: Line) -> str:
    return f"{line.lhs} {line.relation} {line.rhs}"


def _wrapped(text: str, first: str, following: str) -> list[str]:
    return textwrap.wrap(
        text,
        TEXT_WIDTH,
        initial_indent=first,
        subsequent_indent=following,
        break_long_words=False,
        break_on_hyphens=False,
    )


# Formulas


def _line_rows(line: Line, names: Mapping[Symbol, str]) -> list[Row]:
    """Return one line as rows of an aligned block; a long sum takes several."""
    left, sign = formulas.latex(line.lhs, names), _SIGNS[line.relation]
    used = _width(line.lhs)
    if used + _width(line.rhs) + 3 <= LINE_WIDTH or not line.rhs.is_Add:
        return [(left, f"{sign} {formulas.latex(line.rhs, names)}")]
    chunks = _chunks(line.rhs, LINE_WIDTH - used - 3)
    rows = [(left, f"{sign} {_sum_latex(chunks[0], names)}")]
    for chunk in chunks[1:]:
        more = _sum_latex(chunk, names)
        rows.append(("", r"\quad " + (more if more.startswith("-") else "+ " + more)))
    return rows


def _chunks(total: Expr, room: int) -> list[list[Expr]]:
    """Split a sum in the order of its printing into parts no wider than `room`, where possible."""
    parts: list[list[Expr]] = []
    for term in formulas.ordered_terms(total):
        if parts and _width(sp.Add(*parts[-1], term)) <= room:
            parts[-1].append(term)
        else:
            parts.append([term])
    return parts


def _sum_latex(terms: Sequence[Expr], names: Mapping[Symbol, str]) -> str:
    return formulas.latex(sp.Add(*terms), names)


def _width(expression: Expr) -> int:
    """Return the columns an expression takes when fractions and powers are stacked."""
    picture = sp.pretty(expression, use_unicode=False, wrap_line=False)
    return max(len(row) for row in picture.splitlines())


# Markdown


def _markdown(equations: Sequence[Equation], symbols: Sequence[Entry]) -> str:
    out = [f"# {markdown_text(_TITLE)}", "", markdown_text(_INTRODUCTION), ""]
    for section, members in groupby(equations, key=lambda equation: equation.section):
        out += [f"## {markdown_text(section)}", ""]
        for equation in members:
            formula = markdown_maths(equation_latex(equation, symbols))
            out += [
                f"### ({markdown_text(equation.id)}) {markdown_text(equation.title)}",
                "",
                "$$",
                f"{formula} \\tag{{{equation.id}}}",
                "$$",
                "",
                prose.markdown(equation.reason),
                "",
                f"Residual: {markdown_text(_verdict(equation))}",
                "",
            ]
    out += ["## Symbols", "", "| symbol | unit | meaning |", "| --- | --- | --- |"]
    out += [
        f"| ${markdown_maths(entry.latex)}$ | {_markdown_unit(entry.unit)} "
        f"| {prose.markdown(entry.meaning)} |"
        for entry in symbols
    ]
    return "\n".join(out) + "\n"


def _markdown_unit(unit: str) -> str:
    return "–" if unit == "-" else f"${unit_latex(unit)}$"  # noqa: RUF001


# LaTeX


def _latex(equations: Sequence[Equation], symbols: Sequence[Entry]) -> str:
    out = [_PREAMBLE % latex_text(_TITLE) + r"\begin{document}", r"\maketitle", ""]
    out += [latex_text(_INTRODUCTION), ""]
    for section, members in groupby(equations, key=lambda equation: equation.section):
        out += [rf"\section*{{{latex_text(section)}}}", ""]
        for equation in members:
            out += [
                rf"\subsection*{{({latex_text(equation.id)}) {latex_text(equation.title)}}}",
                r"\begin{equation*}",
                f"{equation_latex(equation, symbols)} \\tag{{{latex_text(equation.id)}}}",
                r"\end{equation*}",
                prose.latex(equation.reason),
                "",
                rf"\emph{{Residual: {latex_text(_verdict(equation))}}}",
                "",
            ]
    out += [
        r"\section*{Symbols}",
        r"\begin{longtable}{lll}",
        r"symbol & unit & meaning \\",
        r"\hline\noalign{\smallskip}",
        r"\endhead",
    ]
    out += [
        f"${entry.latex}$ & {_latex_unit(entry.unit)} & {prose.latex(entry.meaning)} \\\\[2pt]"
        for entry in symbols
    ]
    out += [r"\end{longtable}", r"\end{document}"]
    return "\n".join(out) + "\n"


def _latex_unit(unit: str) -> str:
    return "--" if unit == "-" else f"${unit_latex(unit)}$"
