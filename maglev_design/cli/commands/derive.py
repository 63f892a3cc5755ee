"""``derive``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from maglev_design.cli.arguments import Json, to


@dataclass(frozen=True, kw_only=True)
class DeriveOptions:
    """How to print the derivation."""

    form: Annotated[
        Literal["text", "markdown", "latex"], typer.Option("--format", help="How to write it.")
    ] = "text"
    output: Annotated[Path | None, to("Write to this file, not to stdout.")] = None
    json: Json = False


def derive(options: DeriveOptions) -> None:
    """Print the whole derivation, every equation with its machine-checked residual."""
    from maglev_design.cli import derive_verb  # noqa: PLC0415

    derive_verb.derive(options)
