"""The MISRA C:2012 rules that the exported C does not follow, with the reasons."""

from __future__ import annotations

DEVIATIONS: tuple[tuple[str, str], ...] = (
    (
        "2.5",
        "unused macros: the ranges and the bounds of the states are for the caller and the checks",
    ),
    ("8.7", "external linkage of what one file uses: the public functions are for the caller"),
    (
        "20.10",
        "the ## operator: it makes the literals of both precisions from one source, in one macro",
    ),
)
"""(rule, reason), as cppcheck's addon numbers them; a test holds the list to what it finds."""
