"""``claims``."""

from __future__ import annotations

import sys
from typing import Any

from maglev_design.cli.commands.claims import ClaimsOptions
from maglev_design.cli.output import (
    Progress,
    json_bytes,
    print_json,
    progress_bar,
    say,
    table,
    typed,
)
from maglev_design.design import check_path_voltage
from maglev_design.errors import InputError, nearest
from maglev_design.files import finite, output_folder, write_bytes
from maglev_design.options import SCHEMA_VERSION
from maglev_design.paper.equations import equation_claims
from maglev_design.paper.ledger import Claim
from maglev_design.paper.rigs import random_rigs
from maglev_design.paper.simulated import simulated_claims
from maglev_design.paper.survey import survey
from maglev_design.paper.theory import theory_claims
from maglev_design.record import rig_as_data
from maglev_design.report.claims_text import details, markdown, summary_rows, tally
from maglev_design.rig import Rig, load_rig


def judge_claims(options: ClaimsOptions) -> None:
    """Judge every claim, print the ledger, write it."""
    rig = load_rig(options.rig)
    check_path_voltage(rig)
    folder = output_folder(options.output, force=options.force) if options.output else None
    with progress_bar() as progress:
        claims = _judged(rig, options, progress)
    document = _document(rig, chosen(claims, options.only), options)
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


def _judged(rig: Rig, options: ClaimsOptions, progress: Progress) -> list[Claim]:
    """Return the claims, cheap ones first; no further than to one that was asked for by its id."""
    progress("equations", 0.0)
    claims = [*equation_claims()]
    if options.only not in {claim.id for claim in claims}:
        progress("theory", 0.1)
        claims += theory_claims(rig, random_rigs(options.rigs, options.seed))
    if options.only not in {claim.id for claim in claims}:
        rows = survey(rig, progress)
        claims += simulated_claims(rig, rows, seed=options.seed, progress=progress)
    return claims


def chosen(claims: list[Claim], only: str | None) -> list[Claim]:
    """Return the claims whose id starts with what was asked for."""
    if only is None:
        return claims
    found = [claim for claim in claims if claim.id.startswith(only)]
    if not found:
        known = [claim.id for claim in claims]
        raise InputError(
            f"only = {only!r}: no claim starts with it{nearest(only, known)}; "
            f"they are: {', '.join(known)}"
        )
    return found


def _document(rig: Rig, claims: list[Claim], options: ClaimsOptions) -> dict[str, Any]:
    return dict(
        finite(
            {
                "schema_version": SCHEMA_VERSION,
                "rig": rig_as_data(rig),
                "rigs": options.rigs,
                "seed": options.seed,
                "claims": [claim.as_dict() for claim in claims],
            }
        )
    )
