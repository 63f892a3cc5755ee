"""One claim of the paper and what became of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Verdict = Literal["verified", "corrected", "contradicted", "not-checkable"]

Value = float | int | str | bool


@dataclass(frozen=True)
class Claim:
    """A statement of the paper with a verdict that was computed.

    Attributes
    ----------
    id : str
        "eq-10" for a numbered equation, else place and subject: "4.1-pid-centre".
    place : str
        Where the paper says it: "eq. (10)", "sec. 4.1", "abstract", "app. A".
    statement : str
        What it says, in our words.
    verdict : {"verified", "corrected", "contradicted", "not-checkable"}
        ``corrected``: wrong as printed, right with the stated correction. ``contradicted``: the
        evidence says otherwise. ``not-checkable``: nobody can decide it from the paper; the
        evidence says why.
    correction : str
        The form that holds; empty where the statement holds as it is.
    evidence : str
        The proof, or the figures with their units, in a sentence or two.
    command : str
        What shows the evidence again.
    values : mapping
        The figures of the evidence by name, SI units.
    """

    id: str
    place: str
    statement: str
    verdict: Verdict
    correction: str
    evidence: str
    command: str
    values: Mapping[str, Value] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the claim for JSON."""
        return asdict(self) | {"values": dict(self.values)}


def judged(*, holds: bool, correction: str = "") -> Verdict:
    """Return the verdict of a statement that was decided.

    One that does not hold is ``corrected`` where `correction` gives the form that does, else
    ``contradicted``.
    """
    if holds:
        return "verified"
    return "corrected" if correction else "contradicted"
