"""The options that several verbs have, each stated once.

Only typer and the lists of words are imported here, so that asking for help costs nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from maglev_design.options import (
    Derivative,
    Equilibrium,
    Feedforward,
    LawName,
    Method,
    Start,
)

_RIG = typer.Option("--rig", help="A rig file (FILE.toml) or the name of a preset.")
_LAW = typer.Option(help="Which law.")
_READING = typer.Option(help="How the controller learns U, C_U and C_Y.")

RigSource = Annotated[str, _RIG]
RigIfSaid = Annotated[str | None, _RIG]
Law = Annotated[LawName, _LAW]
LawIfSaid = Annotated[LawName | None, _LAW]
Reading = Annotated[Equilibrium, _READING]
ReadingIfSaid = Annotated[Equilibrium | None, _READING]
MethodIfSaid = Annotated[Method | None, typer.Option(help="Discretisation of the law.")]

Zeta = Annotated[float | None, typer.Option(help="Damping of the poles [-].")]
OmegaN = Annotated[float | None, typer.Option(help="Frequency of the poles [rad/s].")]

PidFeedforward = Annotated[
    Feedforward | None, typer.Option(help="lin-pid: the voltage that holds the ball at y*.")
]
PidDerivative = Annotated[Derivative | None, typer.Option(help="lin-pid: what is differentiated.")]
PidFilter = Annotated[
    float | None, typer.Option(help="lin-pid: filter's pole over the real closed-loop pole.")
]
PidStart = Annotated[
    Start | None, typer.Option(help="lin-pid: whether the first error kicks the derivative.")
]

BetaError = Annotated[
    float | None, typer.Option(help="u: worst case over beta_c/beta in [1-u, 1+u].")
]
AllowSaturation = Annotated[
    bool, typer.Option("--allow-saturation", help="Let the command leave the voltage range.")
]
MaxMs = Annotated[float, typer.Option(help="Largest |S| of the sampled loop [-].")]
MaxNoiseVoltage = Annotated[
    float | None,
    typer.Option(help="Voltage made by sensor noise [V]; default 5 % of the range."),
]

Seed = Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Seed of the noise stream.")]
Force = Annotated[
    bool, typer.Option("--force", help="Write into a folder that this program did not make.")
]
Overwrite = Annotated[bool, typer.Option("--force", help="Write over a file that exists.")]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document and nothing else on stdout.")
]


def flag(name: str) -> str:
    """Return an option as it is typed."""
    return f"--{name.replace('_', '-')}"


def to(what: str) -> Any:
    """Return the option that says where `what` is written."""
    return typer.Option("--output", "-o", help=what)


DesignFolder = Annotated[Path | None, to("Folder for design.json and the plots.")]
