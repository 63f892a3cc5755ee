"""``simulate``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from maglev_design.cli.arguments import (
    Json,
    MethodIfSaid,
    OmegaN,
    Overwrite,
    PidDerivative,
    PidFeedforward,
    PidFilter,
    PidStart,
    ReadingIfSaid,
    Seed,
    Zeta,
)
from maglev_design.options import LawName, TestName


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """What is simulated, and what is written of it; None where nothing was said."""

    rig: Annotated[
        str | None,
        typer.Option("--rig", help="A rig file or preset; default: the paper's, belmonte2021."),
    ] = None
    design: Annotated[
        Path | None,
        typer.Option(help="A saved design.json: exactly its controller runs, on its rig."),
    ] = None
    plant: Annotated[
        str | None,
        typer.Option(help="With --design: a rig file or preset whose plant the controller meets."),
    ] = None
    test: Annotated[
        TestName | None,
        typer.Option(help="nominal (default); noise; or noise with beta_c = 1.15 beta."),
    ] = None
    controller: Annotated[LawName | None, typer.Option(help="Which law; default: tan-gpi.")] = None
    feedforward: PidFeedforward = None
    derivative: PidDerivative = None
    filter: PidFilter = None
    start: PidStart = None
    emulate: Annotated[
        bool, typer.Option("--emulate", help="Add the effects of the rig's [emulator] table.")
    ] = False
    zeta: Zeta = None
    omega_n: OmegaN = None
    equilibrium: ReadingIfSaid = None
    method: MethodIfSaid = None
    sample_time: Annotated[
        float | None,
        typer.Option(
            help="Sampling period [s]; 0 is a continuous controller. Another one than a design's "
            "own makes another controller, and is labelled so."
        ),
    ] = None
    beta_ratio: Annotated[
        float | None,
        typer.Option(
            help="beta_c/beta [-], 0.1 to 10: with --design the plant moves, else beta_c."
        ),
    ] = None
    noise: Annotated[
        bool | None, typer.Option("--noise/--no-noise", help="Whether the rig's noise acts.")
    ] = None
    initial_error: Annotated[
        float | None, typer.Option(help="y(0) - y*(0) [m] instead of the rig's.")
    ] = None
    initial_velocity: Annotated[
        float | None, typer.Option(help="y'(0) [m/s] instead of the rig's.")
    ] = None
    seed: Seed = 0
    replay: Annotated[
        str | None,
        typer.Option(
            metavar="FILE:SCENARIO[:DESIGN]",
            help="Run one scenario of a sweep (its sweep.json) again, with nothing else given.",
        ),
    ] = None
    csv: Annotated[Path | None, typer.Option(help="Write the response into this .csv.")] = None
    plot: Annotated[
        Path | None, typer.Option(help="Draw the response into this .png, .svg or .pdf.")
    ] = None
    force: Overwrite = False
    json: Json = False


def simulate(options: SimulateOptions) -> None:
    """Simulate one closed loop on the nonlinear plant and print its figures."""
    from maglev_design.cli import simulate_verb  # noqa: PLC0415

    simulate_verb.simulate(options)
