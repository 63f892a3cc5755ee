"""``derive``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

from maglev_design.cli.output import print_json, say
from maglev_design.derivation import NOTATION, derivation
from maglev_design.errors import InputError
from maglev_design.files import output_file, write_file
from maglev_design.reporting.derivation_text import records, render

Form = Literal["text", "markdown", "latex"]
FORMS: Mapping[str, Form] = {".txt": "text", ".md": "markdown", ".tex": "latex"}
"""By the ending of a file."""

if TYPE_CHECKING:
    from maglev_design.cli.commands.derive import DeriveOptions


def derive(options: DeriveOptions) -> None:
    """Print or write the derivation."""
    form = _form(options)
    equations = derivation()
    if options.json:
        print_json({"equations": records(equations, NOTATION)})
        return
    text = render(equations, NOTATION, form)
    if options.output is None:
        sys.stdout.write(text)
    else:
        write_file(options.output, text.encode(), FORMS, force=options.force)
        say(f"written: {options.output}")


def _form(options: DeriveOptions) -> Form:
    """Return the form that was asked for, by name or by the ending of the file."""
    if options.output is None:
        return options.form or "text"
    ending = output_file(options.output, FORMS, force=options.force)
    form = FORMS.get(ending, options.form or "text")
    if options.form not in (None, form):
        raise InputError(f"--format {options.form}: {options.output} ends as {form} does")
    return form
