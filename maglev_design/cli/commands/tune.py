"""``tune``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import typer

from maglev_design.cli.arguments import (
    AllowSaturation,
    BetaError,
    DesignFolder,
    Force,
    Json,
    MaxMs,
    MaxNoiseVoltage,
    Reading,
    RigSource,
    Seed,
)
from maglev_design.options import DEFAULT_MAX_MS, DEFAULT_PRESET, Method, Objective, Scenarios


@dataclass(frozen=True, kw_only=True)
class TuneOptions:
    """What is searched for, under which limits; None where nothing was said."""

    rig: RigSource = DEFAULT_PRESET
    objective: Annotated[Objective, typer.Option(help="What to minimise.")] = "itae"
    controller: Annotated[
        Literal["tan-gpi", "tan-gpi-2"],
        typer.Option(
            help="tan-gpi: of the order of the rig's plant; tan-gpi-2: the second-order law on a "
            "rig with a coil or a lag."
        ),
    ] = "tan-gpi"
    equilibrium: Reading = "model"
    method: Annotated[
        Literal[Method, "auto"] | None,
        typer.Option(help="Discretisation; auto tunes all and keeps the best."),
    ] = None
    beta_error: BetaError = None
    allow_saturation: AllowSaturation = False
    max_ms: MaxMs = DEFAULT_MAX_MS
    max_noise_voltage: MaxNoiseVoltage = None
    scenarios: Annotated[
        Scenarios,
        typer.Option(
            help="robust adds noise and both signs of the initial error; emulated tunes on the rig "
            "of [emulator], at its period."
        ),
    ] = "nominal"
    poles: Annotated[
        Literal["double", "distinct"],
        typer.Option(help="One double pair as in the paper, or two different pairs."),
    ] = "double"
    zeta_bounds: Annotated[
        tuple[float, float] | None, typer.Option(help="Search bounds of zeta [-].")
    ] = None
    omega_bounds: Annotated[
        tuple[float, float] | None, typer.Option(help="Search bounds of omega_n [rad/s].")
    ] = None
    certify: Annotated[
        bool,
        typer.Option("--certify", help="Require a proof that the sampled loop is stable."),
    ] = False
    pareto: Annotated[
        bool,
        typer.Option(
            "--pareto", help="Show what robustness costs: error against certified range; a minute."
        ),
    ] = False
    baseline: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="ZETA OMEGA",
            help="Poles to compare with; default: the paper's on the paper's rig, else none.",
        ),
    ] = None
    seed: Seed = 0
    output: DesignFolder = None
    force: Force = False
    json: Json = False


def tune(options: TuneOptions) -> None:
    """Find the pole placement with the smallest worst-case error that the limits allow."""
    from maglev_design.cli import tune_verb  # noqa: PLC0415

    tune_verb.tune(options)
