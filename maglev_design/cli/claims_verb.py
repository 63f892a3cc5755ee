"""``claims``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from maglev_design.cli.output import print_json, progress_bar, say, table, typed
from maglev_design.controller.checks import check_path_voltage
from maglev_design.controller.matching import only_papers_plant
from maglev_design.errors import InputError
from maglev_design.files import finite, json_bytes, output_folder, write_bytes
from maglev_design.options import SCHEMA_VERSION
from maglev_design.paper.ledger import Claim, chosen
from maglev_design.record import rig_as_data
from maglev_design.reporting.claims_text import details, markdown, summary_rows, tally
from maglev_design.rig import Rig, load_rig

if TYPE_CHECKING:
    from maglev_design.cli.commands.claims import ClaimsOptions


def list_claims(options: ClaimsOptions) -> None:
    """Print id and statement of every claim that was asked for; judge none."""
    if options.output is not None:
        raise InputError(
            f"output = {str(options.output)!r}: --list judges nothing that could be saved"
        )
    known = chosen(options.only)
    if options.json:
        print_json({"claims": known})
    else:
        sys.stdout.writelines(f"{said.id}\n  {said.statement}\n" for said in known)


def judge_claims(options: ClaimsOptions) -> None:
    """Judge every claim that was asked for, print the ledger, write it."""
    wanted = chosen(options.only)
    from maglev_design.paper.claims import Grounds, judged  # noqa: PLC0415 - takes its time

    rig = load_rig(options.rig)
    only_papers_plant(rig, "claims")
    check_path_voltage(rig)
    folder = output_folder(options.output, force=options.force) if options.output else None
    with progress_bar() as progress:
        claims = judged(wanted, Grounds(rig, options.rigs, options.seed, progress))
    document = _document(rig, claims, options)
    if options.json:
        print_json(document)
    elif options.only:
        for claim in document["claims"]:
            sys.stdout.write("\n".join(details(claim)) + "\n\n")
    else:
        table(
            f"{rig.name}: {tally(document['claims'])}",
            ("claim", "verdict", "what the paper says"),
            [(i, v, s) for v, i, _, s in summary_rows(document["claims"])],
            words=3,
            wraps=2,
        )
        say("evidence and corrections: --json, -o FOLDER, or --only ID")
    if folder is not None:
        page = markdown(document, typed()).encode()
        for name, content in (("claims.json", json_bytes(document, 1)), ("claims.md", page)):
            write_bytes(folder / name, content)
            say(f"written: {folder / name}")


def _document(rig: Rig, claims: Sequence[Claim], options: ClaimsOptions) -> dict[str, Any]:
    return dict(
        finite(
            {
                "schema_version": SCHEMA_VERSION,
                "rig": rig_as_data(rig),
                "rigs": options.rigs,
                "seed": options.seed,
                "claims": claims,
            }
        )
    )
