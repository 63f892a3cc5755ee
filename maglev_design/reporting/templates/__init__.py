"""The frames that a report is set in, beside this file."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Template

HERE = Path(__file__).parent


@cache
def template(name: str) -> Template:
    """Return a template; the HTML ones escape what they are given, and none lets a tag survive."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape  # noqa: PLC0415

    marks = {"variable_start_string": "<<<", "variable_end_string": ">>>"}
    marks |= {"block_start_string": "<%", "block_end_string": "%>"}
    marks |= {"comment_start_string": "<#", "comment_end_string": "#>"}
    environment = Environment(
        loader=FileSystemLoader(HERE),
        undefined=StrictUndefined,
        autoescape=select_autoescape(("html",)),
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        **marks,  # type: ignore[arg-type] # neither LaTeX nor JavaScript has these
    )
    return environment.get_template(name)


def text_of(name: str) -> str:
    """Return a file beside this one as it is."""
    return (HERE / name).read_text(encoding="utf-8")
