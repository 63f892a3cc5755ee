"""``derive``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from maglev_design.cli.output import print_json, say
from maglev_design.derivation import NOTATION, derivation
from maglev_design.files import write_bytes
from maglev_design.reporting.derivation_text import records, render

if TYPE_CHECKING:
    from maglev_design.cli.commands.derive import DeriveOptions


def derive(options: DeriveOptions) -> None:
    """Print or write the derivation."""
    equations = derivation()
    if options.json:
        print_json({"equations": records(equations, NOTATION)})
        return
    text = render(equations, NOTATION, options.form)
    if options.output is None:
        sys.stdout.write(text)
    else:
        write_bytes(options.output, text.encode())
        say(f"written: {options.output}")
