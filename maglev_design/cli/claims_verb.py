"""``claims``."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maglev_design.cli.output import Progress, print_json, progress_bar, say, table
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


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    rig: str
    rigs: int
    seed: int
    only: str | None


def judge_claims(
    request: Request, output: Path | None, *, force: bool, as_json: bool, command: str
) -> None:
    """Judge every claim, print the ledger, write it."""
    rig = load_rig(request.rig)
    check_path_voltage(rig)
    folder = output_folder(output, force=force) if output else None
    with progress_bar() as progress:
        claims = _judged(rig, request, progress)
    document = _document(rig, chosen(claims, request.only), request)
    if as_json:
        print_json(document)
    elif request.only:
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
        text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        for name, content in (("claims.json", text), ("claims.md", markdown(document, command))):
            write_bytes(folder / name, content.encode())
            say(f"written: {folder / name}")


def _judged(rig: Rig, request: Request, progress: Progress) -> list[Claim]:
    """Return the claims, cheap ones first; no further than to one that was asked for by its id."""
    progress("equations", 0.0)
    claims = [*equation_claims()]
    if request.only not in {claim.id for claim in claims}:
        progress("theory", 0.1)
        claims += theory_claims(rig, random_rigs(request.rigs, request.seed))
    if request.only not in {claim.id for claim in claims}:
        rows = survey(rig, progress)
        claims += simulated_claims(rig, rows, seed=request.seed, progress=progress)
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


def _document(rig: Rig, claims: list[Claim], request: Request) -> dict[str, Any]:
    return dict(
        finite(
            {
                "schema_version": SCHEMA_VERSION,
                "rig": rig_as_data(rig),
                "rigs": request.rigs,
                "seed": request.seed,
                "claims": [claim.as_dict() for claim in claims],
            }
        )
    )
