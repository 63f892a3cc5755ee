"""The command line: parse, call, print, exit code; no mathematics.

Only typer is imported here; what a command needs is imported when it runs, so that asking for help
costs nothing.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from maglev_design import __version__
from maglev_design.cli.commands import spread
from maglev_design.cli.commands.certify import certify
from maglev_design.cli.commands.claims import claims
from maglev_design.cli.commands.compare import compare
from maglev_design.cli.commands.derive import derive
from maglev_design.cli.commands.design import design
from maglev_design.cli.commands.export import export
from maglev_design.cli.commands.presets import presets_app
from maglev_design.cli.commands.report import report
from maglev_design.cli.commands.simulate import simulate
from maglev_design.cli.commands.sweep import sweep
from maglev_design.cli.commands.tune import tune
from maglev_design.cli.commands.verify import verify
from maglev_design.cli.output import INTERRUPTED
from maglev_design.errors import MaglevError

app = typer.Typer(
    name="maglev-design",
    help="From a magnetic-levitation rig's equations to a controller that runs on it.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(presets_app, name="presets")
COMMANDS: tuple[Callable[[Any], None], ...] = (
    *(derive, simulate, sweep, tune, design, certify, report, compare, claims, export, verify),
)
"""In the order of the help."""
for _command in COMMANDS:
    app.command()(spread(_command))


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"maglev-design {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line; end with the exit code of the contract, never with a traceback."""
    try:
        app()
    except MaglevError as error:
        _complain(str(error))
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, SystemExit) as stop:
        if not _interrupted(stop):
            raise
        _complain("interrupted, nothing was found yet")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # Whoever read our output has gone; leave nothing for the interpreter to flush.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except Exception as error:  # noqa: BLE001 - the last line of defence: one sentence, exit 1
        place = error.__traceback__
        while place is not None and place.tb_next is not None:
            place = place.tb_next
        where = place.tb_frame.f_code.co_qualname if place is not None else "?"
        _complain(f"internal error in {where}: {type(error).__name__}: {error}")
        sys.exit(1)


def _interrupted(stop: BaseException | None) -> bool:
    """Whether Ctrl-C is behind `stop`: typer turns it into an exit code of 1."""
    while stop is not None and not isinstance(stop, KeyboardInterrupt):
        stop = stop.__cause__ or stop.__context__
    return stop is not None


def _complain(text: str) -> None:
    for line in text.splitlines() or [""]:
        typer.echo(f"maglev-design: {line}", err=True)
