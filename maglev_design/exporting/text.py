"""User text and numbers as they may stand in source code, whatever they contain."""

from __future__ import annotations

import keyword
import re
import sys

from maglev_design.errors import InputError

LONGEST_NAME = 120
"""Characters of a name that are shown; the whole of it is in design.json."""
LONGEST_PREFIX = 24

_SAFE = re.compile(r"[A-Za-z0-9 .,:;()+=_-]")
_PREFIX = re.compile(r"[a-z][a-z0-9_]*")
_RESERVED = """
    auto break case char const continue default do double else enum extern float for goto if inline
    int long register restrict return short signed sizeof static struct switch typedef union
    unsigned void volatile while bool true false main class new delete this template namespace
    operator private public protected virtual end function elseif otherwise parfor spmd persistent
    global check example control
"""


def plain(text: str) -> str:
    """Return user text as one line of harmless ASCII; any other character as its code.

    What remains ends no comment and no string of any target language, and continues no line.

    Examples
    --------
    >>> plain('rig */ "A"')
    'rig {U+002A}{U+002F} {U+0022}A{U+0022}'
    """
    words = " ".join(text.split())
    shown = words[:LONGEST_NAME] + ("..." if len(words) > LONGEST_NAME else "")
    return "".join(c if _SAFE.fullmatch(c) else f"{{U+{ord(c):04X}}}" for c in shown)


def checked_prefix(prefix: str) -> str:
    """Return the prefix of all names and files of an export.

    Raises
    ------
    InputError
        Unless it is a short lower-case ASCII identifier that no target language reserves.
    """
    usable = _PREFIX.fullmatch(prefix) and len(prefix) <= LONGEST_PREFIX
    taken = {*_RESERVED.split(), *keyword.kwlist, *sys.stdlib_module_names}
    if not usable or prefix in taken:
        raise InputError(
            f"--prefix {prefix!r}: must be a lower-case ASCII letter and up to "
            f"{LONGEST_PREFIX - 1} more letters, digits or underscores, and no reserved word "
            "or name of a standard module"
        )
    return prefix


def wrapped(text: str, first: str, other: str, width: int = 96) -> str:
    """Return a text as comment lines, `first` before the first and `other` before the rest."""
    lines: list[str] = []
    line = first
    for word in text.split():
        if len(line) + 1 + len(word) > width:
            lines.append(line.rstrip())
            line = other
        line += word + " "
    return "\n".join([*lines, line.rstrip()])
