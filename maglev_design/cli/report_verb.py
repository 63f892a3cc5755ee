"""``report``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from maglev_design.cli.output import print_json, progress_bar, say, warn
from maglev_design.errors import InputError
from maglev_design.files import output_folder
from maglev_design.options import TAN_GPI
from maglev_design.record import load
from maglev_design.report import pdf_form
from maglev_design.report.write import FORMS, Form, write_report


def report(
    design: Path,
    form: Literal["all"] | Form,
    output: Path,
    *,
    force: bool,
    as_json: bool,
) -> None:
    """Read a design record, write its report, name the files."""
    record = load(design)
    law = record.design.controller.name
    if law != TAN_GPI.name:
        raise InputError(
            f"{design}: its law is {law}: a report is written of {TAN_GPI.name} only, whose "
            "derivation it shows; simulate, sweep and certify take this design"
        )
    forms: tuple[Form, ...] = FORMS if form == "all" else (form,)
    if form == "all" and pdf_form.tool() is None:
        forms = tuple(f for f in forms if f != "pdf")
        warn("no PDF: neither pdflatex nor the extra [pdf] is installed")
    folder = output_folder(output, force=force)
    with progress_bar() as progress:
        progress("report", 0.0)
        written = write_report(record, folder, forms)
    if not record.curves:
        warn(f"{design.with_suffix('.npz')}: not there, the report has no curves")
    if as_json:
        print_json({"files": [path.as_posix() for path in written]})
    else:
        for path in written:
            sys.stdout.write(f"{path}\n")
    say(f"written: {folder}")
