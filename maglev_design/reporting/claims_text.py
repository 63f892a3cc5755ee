"""The ledger of claims as tables and as markdown, from its saved document."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from maglev_design.reporting.escape import markdown_code, markdown_line

VERDICTS = ("verified", "corrected", "contradicted", "not-checkable")
SIGNS = {"verified": "✓", "corrected": "✎", "contradicted": "✗", "not-checkable": "?"}
"""One sign each, so that a page is read without colour."""


def tally(claims: Sequence[Mapping[str, Any]]) -> str:
    """Return "40 verified, 9 corrected, ..." in a fixed order."""
    counts = Counter(claim["verdict"] for claim in claims)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS)


def summary_rows(claims: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, ...], ...]:
    """Return one row for each claim: sign and verdict, id, place, statement."""
    return tuple(
        (
            f"{SIGNS[claim['verdict']]} {claim['verdict']}",
            claim["id"],
            claim["place"],
            claim["statement"],
        )
        for claim in claims
    )


def details(claim: Mapping[str, Any]) -> list[str]:
    """Return a claim in plain lines: statement, verdict, correction, evidence, command."""
    lines = [
        f"{claim['id']}  ({claim['place']})",
        f"  says:     {claim['statement']}",
        f"  verdict:  {SIGNS[claim['verdict']]} {claim['verdict']}",
    ]
    if claim["correction"]:
        lines.append(f"  correct:  {claim['correction']}")
    return [*lines, f"  evidence: {claim['evidence']}", f"  command:  {claim['command']}"]


def markdown(document: Mapping[str, Any], command: str) -> str:
    """Return the ledger as a markdown page, what is wrong before what is right.

    Parameters
    ----------
    document : mapping
        As ``claims.json`` holds it.
    command : str
        What makes the page again.
    """
    claims = document["claims"]
    lines = [
        "# What the paper says, and what became of it",
        "",
        f"Rig: {markdown_line(document['rig']['name'])}; general claims also on {document['rigs']} "
        f"random rigs. Made by {markdown_code(command)}; no verdict is written down, each is "
        "computed by that run.",
        "",
        f"{len(claims)} claims: {tally(claims)}.",
        "",
        "- ✓ *verified*: proved, or true under every reading of what the paper leaves open;",
        "- ✎ *corrected*: wrong as printed, right in the form given;",
        "- ✗ *contradicted*: the evidence says otherwise;",
        "- ? *not-checkable*: a postulate, a judgement, or it depends on what the paper does not "
        "say.",
        "",
        "| claim | place | verdict |",
        "| --- | --- | --- |",
    ]
    lines += [
        f"| [{markdown_line(c['id'])}](#{anchor(c['id'])}) {markdown_line(c['statement'])} "
        f"| {markdown_line(c['place'])} | {SIGNS[c['verdict']]} {c['verdict']} |"
        for c in claims
    ]
    for verdict in ("contradicted", "corrected", "not-checkable", "verified"):
        chosen = [c for c in claims if c["verdict"] == verdict]
        if chosen:
            lines += ["", f"## {SIGNS[verdict]} {verdict.capitalize()}"]
        for claim in chosen:
            lines += ["", *_section(claim)]
    return "\n".join(lines) + "\n"


def anchor(identity: str) -> str:
    """Return the fragment of a claim's section."""
    return "claim-" + "".join(c if c.isalnum() or c == "-" else "-" for c in identity.lower())


def _section(claim: Mapping[str, Any]) -> list[str]:
    lines = [
        f'<a id="{anchor(claim["id"])}"></a>',
        "",
        f"### {markdown_line(claim['id'])}, {markdown_line(claim['place'])}",
        "",
        f"{markdown_line(claim['statement'])}",
        "",
    ]
    if claim["correction"]:
        lines += ["**Correct:**", "", "```text", *claim["correction"].splitlines(), "```", ""]
    return [*lines, f"{markdown_line(claim['evidence'])}", "", markdown_code(claim["command"])]
