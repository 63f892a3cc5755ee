"""From a design record to the files of its report."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Literal, get_args

from maglev_design.files import finite, write_bytes
from maglev_design.record import DesignRecord
from maglev_design.reporting import chapters_result as results
from maglev_design.reporting import chapters_rig as givens
from maglev_design.reporting import chapters_theory as theory
from maglev_design.reporting import pdf_form
from maglev_design.reporting.chapter_emulated import emulated_chapter
from maglev_design.reporting.content import Explorer, Paragraph, Report, ReportSection
from maglev_design.reporting.derivation_steps import derivation_steps
from maglev_design.reporting.escape import one_line
from maglev_design.reporting.explorer import explorer_data, javascript, programs_of
from maglev_design.reporting.html_form import html
from maglev_design.reporting.latex_form import latex
from maglev_design.reporting.markdown_form import PLAIN_TAG, markdown
from maglev_design.reporting.plots.design import DRAWINGS
from maglev_design.reporting.plots.diagram import block_diagram
from maglev_design.reporting.plots.style import figure_bytes, house_style

Form = Literal["markdown", "latex", "html", "pdf"]
FORMS: tuple[Form, ...] = get_args(Form)
FOLDER = "figures"
PICTURES: Mapping[Form, str] = {"markdown": ".svg", "latex": ".pdf", "html": ".svg"}
"""Ending of the figures that a form shows."""
TOOL_PICTURES: Mapping[pdf_form.Tool, str] = {"tex": ".pdf", "typst": ".svg"}
"""The same for the tools that make PDF."""


def report_of(record: DesignRecord) -> Report:
    """Return the report of a design: one content for every form."""
    derivation = derivation_steps()
    data = finite(explorer_data(record))
    told = Paragraph(
        (
            "Move the poles and the ratio: the loop runs again, on the nonlinear plant and "
            "with the sampled law, from the same lowered programs that the tuning ran. The "
            "controller stays while the ratio moves the plant.",
        )
    )
    moving = ReportSection(
        "The loop, moving", (told, Explorer(data, javascript(programs_of(record))))
    )
    chapters = (
        results.summary_chapter(record),
        givens.rig_chapter(record),
        givens.scheme_chapter(record),
        results.worst_chapter(record),
        emulated_chapter(record),
        results.limits_chapter(record),
        results.certificate_chapter(record),
        results.figures_chapter(record),
        moving,
        results.alternatives_chapter(record),
        results.verification_chapter(record),
        theory.reading_chapter(record),
        givens.commands_chapter(record),
        *theory.derivation_chapters(record, derivation),
    )
    name = one_line(record.rig.name)
    return Report(
        "A controller for a levitated ball",
        name,
        tuple(chapter for chapter in chapters if chapter is not None),
    )


def pictures(record: DesignRecord, report: Report, endings: Iterable[str]) -> dict[str, bytes]:
    """Return every figure of the report in every format, by file name."""
    drawn: dict[str, bytes] = {}
    with house_style():
        for figure in report.figures():
            draw = DRAWINGS.get(figure.id)
            picture = block_diagram() if draw is None else draw(record.curves, record.document)
            for ending in endings:
                drawn[figure.id + ending] = figure_bytes(picture, ending)
    return drawn


def write_report(record: DesignRecord, folder: Path, forms: Iterable[Form]) -> tuple[Path, ...]:
    """Write the report into `folder` in the given forms; return the files, sorted by kind.

    Parameters
    ----------
    record : DesignRecord
    folder : Path
        Exists and may be written into, see :func:`maglev_design.files.output_folder`.
    forms : iterable of {"markdown", "latex", "html", "pdf"}

    Raises
    ------
    InputError
        For ``pdf`` where no tool for it is present.
    """
    wanted = set(forms)
    tool = pdf_form.required_tool() if "pdf" in wanted else None
    report = report_of(record)
    endings = {PICTURES[form] for form in wanted if form in PICTURES}
    endings |= {TOOL_PICTURES[tool]} if tool else set()
    drawn = pictures(record, report, sorted(endings))
    beside = {PICTURES[form] for form in wanted if form in ("markdown", "latex")}

    def placed(kinds: Collection[str]) -> dict[str, bytes]:
        chosen = {name: content for name, content in drawn.items() if name.endswith(tuple(kinds))}
        return {f"{FOLDER}/{name}": content for name, content in chosen.items()}

    files = placed(beside) if beside else {}
    if "markdown" in wanted:
        files["report.md"] = markdown(report, FOLDER).encode()
    if "latex" in wanted:
        files["report.tex"] = latex(report, FOLDER).encode()
    if "html" in wanted:
        svg = {f.id: drawn[f"{f.id}.svg"] for f in report.figures()}
        files["report.html"] = html(report, svg).encode()
    if tool == "tex":
        files["report.pdf"] = pdf_form.from_latex(latex(report, FOLDER), placed([".pdf"]))
    elif tool == "typst":
        text = markdown(report, FOLDER, PLAIN_TAG)
        files["report.pdf"] = pdf_form.from_markdown(text, placed([".svg"]))
    written = []
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        write_bytes(path, content)
        written.append(path)
    return tuple(written)
