"""``verify``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from maglev_design.cli.output import number, print_json, progress_bar, say, table, warn
from maglev_design.errors import VerificationError
from maglev_design.exporting import Check, verify_folder

if TYPE_CHECKING:
    from maglev_design.cli.commands.verify import VerifyOptions


def verify(options: VerifyOptions) -> None:
    """Check the folder, print one table; exit 4 when a check fails."""
    with progress_bar() as progress:
        verdict = verify_folder(options.folder, progress, run_untrusted=options.run_untrusted)
    if options.json:
        print_json(
            {
                "passed": verdict.passed,
                "controller_sha256": verdict.controller_sha256 or None,
                "doubts": verdict.doubts,
                "closed_loops_ran": verdict.ran or None,
                "checks": verdict.checks,
                "skipped": [{"name": name, "reason": why} for name, why in verdict.skipped],
            }
        )
    else:
        table(
            f"controller {verdict.controller_sha256 or 'not read'}\n"
            f"{options.folder} (closed loops: {verdict.ran or 'none'})",
            ("check", "passed", "value", "limit", "note"),
            [_row(check) for check in verdict.checks],
            words=2,
            wraps=4,
        )
    for doubt in verdict.doubts:
        warn(doubt)
    for name, why in verdict.skipped:
        say(f"not checked: {name}: {why}")
    failed = [check for check in verdict.checks if not check.passed]
    for check in failed:
        say(f"failed: {check.name}: {_found(check)}{f' ({check.note})' if check.note else ''}")
    if failed and not verdict.ran:
        say("nothing of it was run; export it again, or run it as it is with --run-untrusted")
    if failed:
        sys.exit(VerificationError.exit_code)
    say(f"all {len(verdict.checks)} checks passed")


def _found(check: Check) -> str:
    allowed = "" if check.limit is None else f", allowed {number(check.limit, check.unit)}"
    return f"{number(check.value, check.unit)}{allowed}"


def _row(check: Check) -> tuple[str, ...]:
    return (
        check.name,
        "yes" if check.passed else "NO",
        number(check.value, check.unit),
        "-" if check.limit is None else number(check.limit, check.unit),
        check.note,
    )
