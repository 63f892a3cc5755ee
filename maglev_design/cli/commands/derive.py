"""``derive``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from maglev_design.cli.arguments import Json, Overwrite, to


@dataclass(frozen=True, kw_only=True)
class DeriveOptions:
    """How to print the derivation."""

    form: Annotated[
        Literal["text", "markdown", "latex"] | None,
        typer.Option("--format", help="How to write it; the ending of --output says it, too."),
    ] = None
    output: Annotated[Path | None, to("Write to this .txt, .md or .tex, not to stdout.")] = None
    force: Overwrite = False
    json: Json = False


def derive(options: DeriveOptions) -> None:
    """Print the whole derivation, every equation with its machine-checked residual."""
    from maglev_design.cli import derive_verb  # noqa: PLC0415

    derive_verb.derive(options)
