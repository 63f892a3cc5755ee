"""``export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from maglev_design.cli.arguments import Force, Json, to
from maglev_design.options import Target


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Which design is exported, as what and where to."""

    design: Annotated[Path, typer.Argument(help="A saved design.json, or its folder.")]
    target: Annotated[Target, typer.Option(help="The language of the controller.")]
    output: Annotated[Path, to("Folder for the controller and its README.")]
    prefix: Annotated[str, typer.Option(help="What every public name and file begins with.")] = (
        "maglev"
    )
    allow_unverified: Annotated[
        bool,
        typer.Option(
            "--allow-unverified",
            help="Export a design whose re-simulation failed or that has no certificate.",
        ),
    ] = False
    force: Force = False
    json: Json = False


def export(options: ExportOptions) -> None:
    """Print a saved design as a controller that stands alone, with tests, example and README."""
    from maglev_design.cli import export_verb  # noqa: PLC0415

    export_verb.export(options)
