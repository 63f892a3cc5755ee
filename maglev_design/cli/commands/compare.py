"""``compare``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from maglev_design.cli.arguments import Force, Json, RigSource, Seed, to
from maglev_design.options import DEFAULT_PRESET, Equilibrium, Method


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """Which controllers are compared, under which readings; None where nothing was said."""

    rig: RigSource = DEFAULT_PRESET
    design: Annotated[
        Path | None,
        typer.Option(help="A saved design.json as the tuned one; then the plant's beta moves."),
    ] = None
    equilibrium: Annotated[
        Equilibrium | None, typer.Option(help="How the controllers learn U, C_U and C_Y.")
    ] = None
    method: Annotated[
        Literal[Method, "all"] | None, typer.Option(help="Discretisation of the laws, or all.")
    ] = None
    sample_time: Annotated[
        float | None, typer.Option(help="Sampling period [s]; 0 is continuous controllers.")
    ] = None
    opposite_error: Annotated[
        bool, typer.Option("--opposite-error", help="Start on the other side of the reference.")
    ] = False
    position_noise: Annotated[
        float | None, typer.Option(help="Standard deviation of the sensor's noise [m].")
    ] = None
    seeds: Annotated[int, typer.Option(min=1, max=10_000, help="Runs where noise enters.")] = 20
    seed: Seed = 0
    tuned: Annotated[
        bool, typer.Option("--tuned/--no-tuned", help="Tune the TAN-GPI and show it, too.")
    ] = True
    variants: Annotated[
        bool, typer.Option("--variants/--no-variants", help="Show other readings of the PID.")
    ] = True
    emulate: Annotated[
        bool, typer.Option("--emulate/--no-emulate", help="Add the emulated rig as a fourth test.")
    ] = True
    survey: Annotated[
        bool, typer.Option("--survey/--no-survey", help="Try every reading of the paper.")
    ] = True
    output: Annotated[Path | None, to("Folder for the page and the figures.")] = None
    force: Force = False
    json: Json = False


def compare(options: CompareOptions) -> None:
    """Run the paper's tests 1 to 3 with every controller, and see which orderings survive."""
    from maglev_design.cli import compare_verb  # noqa: PLC0415

    compare_verb.compare_controllers(options)
