"""One claim of the paper and what became of it; the table of all; who judges which.

What the paper says stands in ``statements.toml``, so that the claims are known before anything is
computed. A claim is judged by the function that gathers its evidence; what that needs it says by
the names of its parameters, see :class:`maglev_design.paper.claims.Grounds`.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib import resources
from typing import Generic, Literal, ParamSpec

from maglev_design.errors import InputError

Verdict = Literal["verified", "corrected", "contradicted", "not-checkable"]

Value = float | int | str | bool
P = ParamSpec("P")


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


@dataclass(frozen=True)
class Finding:
    """What became of a claim: the attributes of :class:`Claim` that have to be computed."""

    verdict: Verdict
    evidence: str
    correction: str
    values: Mapping[str, Value]


def finding(
    holds: Verdict | bool | None, evidence: str, correction: str = "", /, **values: Value
) -> Finding:
    """Return a verdict with its evidence.

    Parameters
    ----------
    holds : bool or Verdict
        Whether the statement holds as it is, None like False; or the verdict itself.
    evidence : str
    correction : str
        The form that holds if the statement does not: with one it is ``corrected``, else
        ``contradicted``. Left aside under any other verdict.

    Examples
    --------
    >>> finding(False, "It is 3.", "n = 3", n=3).verdict
    'corrected'
    """
    if isinstance(holds, str):
        verdict: Verdict = holds
    elif holds:
        verdict = "verified"
    else:
        verdict = "corrected" if correction else "contradicted"
    return Finding(verdict, evidence, correction if verdict == "corrected" else "", values)


@dataclass(frozen=True)
class Statement:
    """What the paper says, before anybody judges it: the attributes of :class:`Claim` for it."""

    id: str
    place: str
    command: str
    statement: str


@cache
def statements() -> Mapping[str, Statement]:
    """Return every statement by its id, in the order of the ledger; nothing is computed.

    Examples
    --------
    >>> statements()["3.1-velocity"].statement
    "The state feedback (14) needs the ball's velocity."
    """
    text = resources.files(__package__).joinpath("statements.toml").read_text("utf-8")
    return {name: Statement(name, *said) for name, said in tomllib.loads(text).items()}


def chosen(only: str | None) -> tuple[Statement, ...]:
    """Return the statement with the id `only`, else those whose id starts with it; all for None.

    Raises
    ------
    InputError
        Where there is none; the message names the nearest ids.
    """
    every = statements()
    if only is None or only in every:
        return tuple(every.values()) if only is None else (every[only],)
    found = tuple(said for name, said in every.items() if name.startswith(only))
    if found:
        return found
    ends = [name for name in every if name.partition("-")[2] == only]
    near = ends or difflib.get_close_matches(only, every, n=3, cutoff=0.5)
    hint = f" (did you mean {' or '.join(map(repr, near))}?)" if near else ""
    raise InputError(f"only = {only!r}: no claim starts with it{hint}; --list shows them all")


@dataclass(frozen=True)
class Judge(Generic[P]):
    """The function that gathers a claim's evidence; called with its grounds, it gives the claim."""

    said: Statement
    gather: Callable[P, Finding]

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Claim:
        """Return the claim with its verdict."""
        return Claim(**asdict(self.said), **vars(self.gather(*args, **kwargs)))


JUDGES: dict[str, Judge[...]] = {}
"""Who judges which claim."""


def claim(identity: str) -> Callable[[Callable[P, Finding]], Judge[P]]:
    """Make the decorated function the judge of a claim of the table."""

    def register(gather: Callable[P, Finding]) -> Judge[P]:
        if identity in JUDGES:
            raise ValueError(f"two judges of {identity!r}")
        own = Judge(statements()[identity], gather)
        JUDGES[identity] = own
        return own

    return register
