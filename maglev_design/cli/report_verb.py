"""``report``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from maglev_design.cli.output import print_json, progress_bar, say, warn
from maglev_design.controller.matching import only_papers_plant
from maglev_design.errors import InputError
from maglev_design.files import output_folder
from maglev_design.options import TAN_GPI
from maglev_design.record import load
from maglev_design.reporting import pdf_form
from maglev_design.reporting.write import FORMS, Form, write_report

if TYPE_CHECKING:
    from maglev_design.cli.commands.report import ReportOptions


def report(options: ReportOptions) -> None:
    """Read a design record, write its report, name the files."""
    record = load(options.design)
    law = record.design.controller.name
    if law != TAN_GPI.name:
        raise InputError(
            f"{options.design}: its law is {law}: a report is written of {TAN_GPI.name} only, "
            "whose derivation it shows; simulate, sweep and certify take this design"
        )
    only_papers_plant(record.rig, "report", record.design.controller)
    forms: tuple[Form, ...] = FORMS if options.form == "all" else (options.form,)
    if options.form == "all" and pdf_form.tool() is None:
        forms = tuple(f for f in forms if f != "pdf")
        warn("no PDF: neither pdflatex nor the extra [pdf] is installed")
    folder = output_folder(options.output, force=options.force)
    with progress_bar() as progress:
        progress("report", 0.0)
        written = write_report(record, folder, forms)
    if not record.curves:
        warn(f"{options.design.with_suffix('.npz')}: not there, the report has no curves")
    if options.json:
        print_json({"files": [path.as_posix() for path in written]})
    else:
        for path in written:
            sys.stdout.write(f"{path}\n")
    say(f"written: {folder}")
