"""``claims``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from maglev_design.cli.arguments import Force, Json, RigSource, Seed, to
from maglev_design.options import DEFAULT_PRESET


@dataclass(frozen=True, kw_only=True)
class ClaimsOptions:
    """Which claims are judged, on which rigs."""

    rig: RigSource = DEFAULT_PRESET
    rigs: Annotated[
        int, typer.Option(min=1, max=1000, help="Random rigs on which general claims are tried.")
    ] = 20
    seed: Seed = 0
    only: Annotated[
        str | None,
        typer.Option(help="Judge only this claim, or those whose id starts so, with evidence."),
    ] = None
    list_them: Annotated[
        bool, typer.Option("--list", help="Only list the claims, at once; judge none.")
    ] = False
    output: Annotated[Path | None, to("Folder for claims.json and claims.md.")] = None
    force: Force = False
    json: Json = False


def claims(options: ClaimsOptions) -> None:
    """Judge every equation and every quantitative claim of the paper, with evidence."""
    from maglev_design.cli import claims_verb  # noqa: PLC0415

    run = claims_verb.list_claims if options.list_them else claims_verb.judge_claims
    run(options)
