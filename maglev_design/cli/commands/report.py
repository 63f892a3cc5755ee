"""``report``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from maglev_design.cli.arguments import Force, Json, to


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """Which design is written up, and how."""

    design: Annotated[Path, typer.Argument(help="A saved design.json.")]
    form: Annotated[
        Literal["markdown", "latex", "html", "pdf", "all"],
        typer.Option("--format", help="How to write it; all is each that this machine can make."),
    ] = "all"
    output: Annotated[Path, to("Folder for the report and its figures.")] = Path("report")
    force: Force = False
    json: Json = False


def report(options: ReportOptions) -> None:
    """Write a design up for people: markdown, LaTeX, a page with sliders, PDF."""
    from maglev_design.cli import report_verb  # noqa: PLC0415

    report_verb.report(options)
