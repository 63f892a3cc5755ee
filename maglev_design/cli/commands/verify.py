"""``verify``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from maglev_design.cli.arguments import Json


@dataclass(frozen=True, kw_only=True)
class VerifyOptions:
    """Which exported controller is verified."""

    folder: Annotated[Path, typer.Argument(help="A folder that `export` wrote.")]
    run_untrusted: Annotated[
        bool,
        typer.Option(
            "--run-untrusted",
            help="Run the folder's own files although they are not what its design.json prints, "
            "with all that they may do to this machine; the first check stays failed.",
        ),
    ] = False
    json: Json = False


def verify(options: VerifyOptions) -> None:
    """Print an export again from its design.json, compare, build it, run it, try to break it.

    Nothing that lies in the folder is run. The same files are printed anew and must be those of the
    folder byte for byte, else the difference is named and verify ends with 4; another version of
    the program prints other bytes. What is printed anew is built and run in a temporary folder, in
    processes of its own with a limit of time: the C with gcc and clang, the Python with this
    interpreter, MATLAB's files with Octave, a Cortex-M4 with QEMU; cppcheck and frama-c read it.
    """
    from maglev_design.cli import verify_verb  # noqa: PLC0415

    verify_verb.verify(options)
