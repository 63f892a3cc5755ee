"""``export``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from maglev_design.cli.output import print_json, say, table, warn
from maglev_design.exporting import export_folder
from maglev_design.record import load

if TYPE_CHECKING:
    from maglev_design.cli.commands.export import ExportOptions


def export(options: ExportOptions) -> None:
    """Write the folder and print what is in it."""
    record, target, output = load(options.design), options.target, options.output
    done = export_folder(
        record,
        target,
        output,
        prefix=options.prefix,
        allow_unverified=options.allow_unverified,
        force=options.force,
    )
    if options.json:
        print_json(
            {
                "target": target,
                "prefix": options.prefix,
                "controller_sha256": record.design.sha256,
                "verified": not done.doubts,
                "doubts": list(done.doubts),
                "files": list(done.sha256),
                "sha256": dict(done.sha256),
            }
        )
    else:
        rows = [(name, digest) for name, digest in done.sha256.items()]
        table(f"{target}: {output}", ("file", "sha256"), rows, words=2)
    for doubt in done.doubts:
        warn(doubt)
    say(f"written: {output}; how to call it: {output / 'README.md'}")
