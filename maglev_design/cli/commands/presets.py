"""``presets``."""

from __future__ import annotations

from typing import Annotated

import typer

from maglev_design.cli.arguments import Json

presets_app = typer.Typer(
    help="List the rigs that come with the program, or print one to start from.",
    invoke_without_command=True,
    rich_markup_mode=None,
)


@presets_app.callback()
def presets(context: typer.Context, json: Json = False) -> None:
    """List the rigs that come with the program."""
    if context.invoked_subcommand is None:
        from maglev_design.cli.presets_verb import list_presets  # noqa: PLC0415

        list_presets(as_json=json)


@presets_app.command("show")
def presets_show(name: Annotated[str, typer.Argument(help="Name of a preset.")]) -> None:
    """Print the TOML of a preset, with its sources, to start a rig file of your own."""
    from maglev_design.rig import preset_text  # noqa: PLC0415

    typer.echo(preset_text(name), nl=False)
