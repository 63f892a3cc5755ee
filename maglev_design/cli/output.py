"""How results reach a person or a program: tables, JSON, a progress bar."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from maglev_design.figures import DESCRIBED
from maglev_design.files import json_bytes
from maglev_design.options import SCHEMA_VERSION
from maglev_design.reporting.content import Code, Inline, Quantity, Runs, Strong
from maglev_design.reporting.words import unit_text

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""
Progress = Callable[[str, float], None]


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document, the schema version first, infinities as null."""
    whole = {"schema_version": SCHEMA_VERSION} | document
    sys.stdout.write(json_bytes(whole, ascii_only=True).decode())


def typed() -> str:
    """Return what was typed, without the output folder and without the places of files."""
    words, skip = ["maglev-design"], False
    for word in sys.argv[1:]:
        if skip or word in ("-o", "--output", "--force"):
            skip = word in ("-o", "--output") and not skip
            continue
        words.append(Path(word).name if os.sep in word else word)
    return " ".join(words)


def say(text: str) -> None:
    """Print prose for a person, to stderr, so that stdout stays what was asked for."""
    sys.stderr.write(text + "\n")


def warn(text: str) -> None:
    """Print one warning to stderr."""
    say(f"warning: {text}")


def table(
    title: str,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    words: int = 1,
    wraps: int = 0,
) -> None:
    """Print an aligned table to stdout; after the first `words` columns, numbers stand right.

    The column `wraps` takes more lines where the screen is narrow; a number is never cut.
    """
    from rich.console import Console  # noqa: PLC0415 - only when a table is drawn
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    drawn = Table(box=None, pad_edge=False)
    for position, name in enumerate(header):
        left = position < words
        drawn.add_column(Text(name), justify="left" if left else "right", no_wrap=position != wraps)
    for row in rows:
        drawn.add_row(*[Text(cell) for cell in row])
    sys.stdout.write(f"{title}\n")
    Console(highlight=False, soft_wrap=False, width=_width()).print(drawn)
    sys.stdout.write("\n")


NARROWEST = 100
"""[characters] A narrower terminal breaks the lines of a table, which cuts no number."""


def _width() -> int:
    """Return the width of the terminal, or a fixed one for output that does not go to one."""
    if not sys.stdout.isatty():
        return NARROWEST
    return max(NARROWEST, os.get_terminal_size(sys.stdout.fileno()).columns)


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Show a progress bar on stderr when that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _stage, _done: None
        return
    from rich.console import Console  # noqa: PLC0415 - only when a bar is drawn
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description:<24}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda stage, done: bar.update(task, description=stage, completed=done)


def number(value: float | None, unit: str = "", digits: int = 4) -> str:
    """Return a number as people write it: ``9.934e-06 m s²``, ``5 V``, ``none``."""
    if value is None:
        return "none"
    return f"{value:.{digits}g} {'' if unit == '-' else unit_text(unit)}".rstrip()


def shown(key: str, value: float | None, digits: int = 4) -> str:
    """Return a figure in the unit of the terminal's tables, from SI."""
    told = DESCRIBED[key]
    scaled = None if value is None else told.scale * value
    return number(scaled, told.shown or told.unit, digits)


def plain(runs: Runs) -> str:
    """Return a report's line of words and numbers as the terminal prints it."""
    return "".join(map(_plain, runs))


def _plain(run: Inline) -> str:
    match run:
        case Quantity(value, unit, digits):
            return number(value, unit, digits)
        case Code(text) | Strong(text):
            return text
        case str():
            return run
    raise TypeError(f"{run!r} has no form on the terminal")
