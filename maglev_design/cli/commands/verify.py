"""``verify``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from maglev_design.cli.arguments import Json


@dataclass(frozen=True, kw_only=True)
class VerifyOptions:
    """Which exported controller is verified."""

    folder: Annotated[Path, typer.Argument(help="A folder that `export` wrote.")]
    json: Json = False


def verify(options: VerifyOptions) -> None:
    """Build an exported controller, run it, and compare it with the design it came from."""
    from maglev_design.cli import verify_verb  # noqa: PLC0415

    verify_verb.verify(options)
