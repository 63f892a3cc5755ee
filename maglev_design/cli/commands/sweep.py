"""``sweep``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from maglev_design.cli.arguments import (
    Force,
    Json,
    MethodIfSaid,
    OmegaN,
    ReadingIfSaid,
    Zeta,
    to,
)
from maglev_design.options import LAWS, Backend


@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """What is swept, how it is computed and where it goes; None where nothing was said."""

    samples: Annotated[int, typer.Option(help="Scenarios [-].")]
    output: Annotated[Path, to("Folder for the chunks and sweep.json.")]
    rig: Annotated[
        str | None,
        typer.Option(
            "--rig", help="A rig file or preset; with --design, whose uncertainty is meant."
        ),
    ] = None
    design: Annotated[
        list[Path] | None, typer.Option(help="A saved design.json; may be given several times.")
    ] = None
    controller: Annotated[
        list[str] | None,
        typer.Option(
            metavar=f"[{'|'.join(LAWS)}]",
            help="A law with --zeta and --omega-n; may be given several times.",
        ),
    ] = None
    zeta: Zeta = None
    omega_n: OmegaN = None
    equilibrium: ReadingIfSaid = None
    method: MethodIfSaid = None
    sampling: Annotated[
        Literal["lhs", "sobol", "random"],
        typer.Option(help="Latin hypercube, scrambled Sobol sequence, or independent draws."),
    ] = "lhs"
    noise: Annotated[
        bool | None,
        typer.Option("--noise/--no-noise", help="Whether noise acts; default: if the rig has any."),
    ] = None
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed of the draws and of the noise.")
    ] = 0
    chunk: Annotated[
        int | None, typer.Option(help="Scenarios a file, a multiple of 4; default: about a second.")
    ] = None
    jobs: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Processes; default: all cores, where it is worth it."),
    ] = None
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Compute on this Dask cluster."),
    ] = None
    backend: Annotated[Backend, typer.Option(help="How a loop is computed.")] = "auto"
    force: Force = False
    json: Json = False


def sweep(options: SweepOptions) -> None:
    """Draw plants from the rig's uncertainty and see how many the controller holds, and how well.

    Interrupted or killed, the same command continues where it was.
    """
    from maglev_design.cli import sweep_verb  # noqa: PLC0415

    sweep_verb.sweep(options)
