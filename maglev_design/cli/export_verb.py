"""``export``."""

from __future__ import annotations

from pathlib import Path

from maglev_design.cli.output import print_json, say, table, warn
from maglev_design.export import export_folder
from maglev_design.options import Target
from maglev_design.record import load


def export(
    design: Path,
    target: Target,
    output: Path,
    *,
    prefix: str,
    allow_unverified: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Write the folder and print what is in it."""
    record = load(design)
    done = export_folder(
        record,
        target,
        output,
        prefix=prefix,
        allow_unverified=allow_unverified,
        force=force,
    )
    if as_json:
        print_json(
            {
                "target": target,
                "prefix": prefix,
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
