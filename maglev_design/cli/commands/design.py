"""``design``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from maglev_design.cli.arguments import (
    AllowSaturation,
    BetaError,
    DesignFolder,
    Force,
    Json,
    Law,
    MaxMs,
    MaxNoiseVoltage,
    MethodIfSaid,
    OmegaN,
    PidDerivative,
    PidFeedforward,
    PidFilter,
    PidStart,
    Reading,
    RigSource,
    Seed,
    Zeta,
)
from maglev_design.options import DEFAULT_MAX_MS, DEFAULT_PRESET, Objective, Scenarios


@dataclass(frozen=True, kw_only=True)
class DesignOptions:
    """Which controller is judged, under which limits; None where nothing was said."""

    rig: RigSource = DEFAULT_PRESET
    controller: Law = "tan-gpi"
    zeta: Zeta = None
    omega_n: OmegaN = None
    poles: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="ZETA OMEGA ZETA OMEGA",
            help="Two different pairs [-, rad/s]; a law of third order has a real pole at the "
            "second frequency.",
        ),
    ] = None
    gains: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=VALUE,...",
            help="Somebody's own. tan-gpi, fee-gpi: k0 [1/s^4], k1 [1/s^3], k2 [1/s^2], k3 [1/s]; "
            "state-feedback: k1 [1/s^3], k2 [1/s^2], k3 [1/s]; lin-pid: the same, or Kp [V/m], "
            "Ki [V/(m s)], Kd [V s/m], positive as gains of y - y*, with omega_f (or N) [rad/s], "
            "the pole of the derivative's filter.",
        ),
    ] = None
    feedforward: PidFeedforward = None
    derivative: PidDerivative = None
    filter: PidFilter = None
    start: PidStart = None
    objective: Annotated[Objective, typer.Option(help="Whose worst case is shown.")] = "itae"
    equilibrium: Reading = "model"
    method: MethodIfSaid = None
    beta_error: BetaError = None
    allow_saturation: AllowSaturation = False
    max_ms: MaxMs = DEFAULT_MAX_MS
    max_noise_voltage: MaxNoiseVoltage = None
    scenarios: Annotated[
        Scenarios, typer.Option(help="robust adds noise and both signs of the initial error.")
    ] = "nominal"
    baseline: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="ZETA OMEGA",
            help="Poles of tan-gpi to compare with; default: the paper's on the paper's rig.",
        ),
    ] = None
    seed: Seed = 0
    output: DesignFolder = None
    force: Force = False
    json: Json = False


def design(options: DesignOptions) -> None:
    """Judge a controller that is given by its poles or its gains; nothing is searched for."""
    from maglev_design.cli import design_verb  # noqa: PLC0415

    design_verb.design(options)
