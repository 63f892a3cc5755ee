"""The derivation as text, markdown and LaTeX."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from maglev_design.derivation import NOTATION, Equation, derivation
from maglev_design.errors import InputError
from maglev_design.reporting.derivation_text import TEXT_WIDTH, equation_latex, records, render

FORMATS = ("text", "markdown", "latex")
OVERFULL = 1.0
"""Points; what sticks out less is not seen."""
HOSTILE = r"50% & more: \input{x} $y_1$ #1 ~ ^ | <b> `c` *d*"
"""A name that would break every format if it were not escaped."""


@pytest.fixture(scope="module")
def equations(derived: tuple[Equation, ...]) -> tuple[Equation, ...]:
    return derived


def test_rendering_is_deterministic(equations: tuple[Equation, ...]) -> None:
    again = derivation()
    for form in FORMATS:
        assert render(equations, NOTATION, form) == render(again, NOTATION, form)  # type: ignore[arg-type]


@pytest.mark.parametrize("form", FORMATS)
def test_every_equation_is_printed(equations: tuple[Equation, ...], form: str) -> None:
    document = render(equations, NOTATION, form)  # type: ignore[arg-type]
    for equation in equations:
        assert f"({equation.id}) " in document
    assert document.count("0 (proved)") == sum(e.residual is not None for e in equations)
    assert document.endswith("\n")


def test_text_fits_the_terminal(equations: tuple[Equation, ...]) -> None:
    document = render(equations, NOTATION, "text")
    assert max(map(len, document.splitlines())) <= TEXT_WIDTH
    assert document.isascii()


def test_markdown_maths_is_balanced_and_tagged(equations: tuple[Equation, ...]) -> None:
    document = render(equations, NOTATION, "markdown")
    blocks = document.split("$$")
    assert len(blocks) == 2 * len(equations) + 1
    for equation, block in zip(equations, blocks[1::2], strict=True):
        assert block.rstrip().endswith(rf"\tag{{{equation.id}}}")
        assert block.count("{") == block.count("}")
        assert block.count(r"\left") == block.count(r"\right")
        assert "*" not in block
    assert all(len(re.findall(r"(?<!\\)\$", outside)) % 2 == 0 for outside in blocks[0::2])


def test_symbol_table_has_what_occurs_with_its_unit(equations: tuple[Equation, ...]) -> None:
    only_two = render([e for e in equations if e.id == "2"], NOTATION, "markdown")
    table = only_two.split("## Symbols")[1]
    assert table.count("\n| $") == 3
    assert r"| $C$ | $\mathrm{A/V}$ |" in table


def test_records_hold_what_json_needs(equations: tuple[Equation, ...]) -> None:
    rows = records(equations, NOTATION)
    assert {row["residual"] for row in rows} == {"0", None}
    assert all(row["latex"] and row["title"] and row["id"] for row in rows)
    (second,) = [row for row in rows if row["id"] == "2"]
    assert second["latex"] == "i = C u"
    assert second["text"] == "i = C*u"


def test_unproved_is_said_so(equations: tuple[Equation, ...]) -> None:
    (second,) = [e for e in equations if e.id == "2"]
    unproved = replace(second, checks=(second.lines[0].rhs,))
    assert "Residual: C*u (not proved)" in render([unproved], NOTATION, "text")


def test_unknown_format_is_refused_with_the_known_ones(equations: tuple[Equation, ...]) -> None:
    with pytest.raises(InputError, match="text, markdown, latex"):
        render(equations, NOTATION, "html")  # type: ignore[arg-type]


def test_titles_are_data(equations: tuple[Equation, ...]) -> None:
    hostile = replace(equations[1], title=HOSTILE, reason=HOSTILE, section=HOSTILE)
    latex = render([hostile], NOTATION, "latex")
    assert r"\input{x}" not in latex
    assert r"50\% \& more" in latex
    markdown = render([hostile], NOTATION, "markdown")
    assert r"\<b\> \`c\` \*d\*" in markdown


def test_formula_of_several_lines_is_aligned(equations: tuple[Equation, ...]) -> None:
    (tenth,) = [e for e in equations if e.id == "10"]
    latex = equation_latex(tenth, NOTATION)
    assert latex.startswith(r"\begin{aligned}")
    assert latex.count("&=") == 3


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="pdflatex is not installed")
def test_latex_compiles_and_nothing_runs_off_the_page(
    equations: tuple[Equation, ...], tmp_path: Path
) -> None:
    hostile = replace(equations[1], id="0", title=HOSTILE, reason=HOSTILE)
    source = tmp_path / "derivation.tex"
    source.write_text(render([*equations, hostile], NOTATION, "latex"), encoding="utf-8")
    run = subprocess.run(  # noqa: S603
        [str(shutil.which("pdflatex")), "-interaction=nonstopmode", "-halt-on-error", source.name],
        cwd=tmp_path,
        capture_output=True,
        timeout=120,
        check=False,
    )
    log = (tmp_path / "derivation.log").read_text(encoding="latin-1")
    assert run.returncode == 0, log[-2000:]
    too_wide = [float(width) for width in re.findall(r"Overfull \\hbox \(([\d.]+)pt", log)]
    assert all(width <= OVERFULL for width in too_wide), too_wide
    assert (tmp_path / "derivation.pdf").stat().st_size > 0
