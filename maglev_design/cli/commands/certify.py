"""``certify``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from maglev_design.cli.arguments import (
    Force,
    Json,
    LawIfSaid,
    MethodIfSaid,
    OmegaN,
    ReadingIfSaid,
    RigIfSaid,
    Zeta,
    to,
)


@dataclass(frozen=True, kw_only=True)
class CertifyOptions:
    """What is proved of which controller; None where nothing was said."""

    design: Annotated[
        Path | None, typer.Argument(help="A saved design.json; its rig and controller are used.")
    ] = None
    rig: RigIfSaid = None
    controller: LawIfSaid = None
    zeta: Zeta = None
    omega_n: OmegaN = None
    equilibrium: ReadingIfSaid = None
    method: MethodIfSaid = None
    gap_range: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Gaps [m] instead of the hull of the path, the initial gap and Y."),
    ] = None
    beta_error: Annotated[
        float | None, typer.Option(help="u: the family is beta_c/beta in [1-u, 1+u].")
    ] = None
    check: Annotated[
        Path | None,
        typer.Option(
            "--check",
            help="Only verify a written certificate.json, without a solver; with a design: its.",
        ),
    ] = None
    output: Annotated[Path | None, to("Folder for the result, certificate and figure.")] = None
    force: Force = False
    json: Json = False


def certify(options: CertifyOptions) -> None:
    """Prove for which beta, gaps, periods, delays and errors a controller is stable."""
    from maglev_design.cli import certify_verb  # noqa: PLC0415

    certify_verb.certify(options)
