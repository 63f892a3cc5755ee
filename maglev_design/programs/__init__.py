"""The programs that everything computes with: derived once, then read back from the cache folder.

A program depends on the symbolic statement, on how it is lowered and on SymPy. The hash of all of
these is part of its name in the cache, so that a changed equation is never answered with an old
program; and a process that finds its programs there does not import SymPy.
"""

from __future__ import annotations

from functools import cache
from importlib import metadata
from pathlib import Path

from maglev_design import choices, lowering
from maglev_design.choices import Controller
from maglev_design.lowering import Program
from maglev_design.store import digest, kept, sources

HERE = Path(__file__).parent
SOURCES = (HERE.parent / "symbolic", Path(lowering.__file__).parent, HERE, Path(choices.__file__))
"""Folders and files whose text decides what a program is."""


@cache
def fingerprint() -> str:
    """Return the hash of all that decides what the programs are."""
    return digest(metadata.version("sympy"), *sources(*SOURCES))


@cache
def program(name: str, *arguments: str | bool | Controller) -> Program:
    """Return the program of that name: a function of :mod:`maglev_design.programs.derived`."""

    def derive() -> str:
        from maglev_design.programs import derived  # noqa: PLC0415 - imports SymPy

        made: Program = getattr(derived, name)(*arguments)
        return made.to_json()

    key = f"{name}-{digest(fingerprint(), name, repr(arguments))[:32]}"
    return kept("programs", key, derive, Program.from_json)
