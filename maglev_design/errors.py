"""What can go wrong, with the numbers that made it go wrong and what to do about it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class MaglevError(Exception):
    """Base of every error this package raises on purpose.

    ``str(error)`` is one message for the person at the keyboard; ``exit_code`` is what the
    command line ends with.
    """

    exit_code = 1


class InputError(MaglevError):
    """Something handed in is not usable: a rig file, an option, a saved design."""

    exit_code = 2


class InfeasibleError(MaglevError):
    """No design meets the limits.

    Parameters
    ----------
    message : str
        What was tried and the remedy.
    constraint : str
        Name of the tightest violated constraint.
    """

    exit_code = 3

    def __init__(self, message: str, constraint: str) -> None:
        super().__init__(message)
        self.constraint = constraint


class VerificationError(MaglevError):
    """Two computations that must agree do not: something is broken, here or on this machine."""

    exit_code = 4


def nearest(word: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` for the known name nearest to `word`, or ``""``.

    Examples
    --------
    >>> nearest("gravty", ["mass", "gravity"])
    " (did you mean 'gravity'?)"
    """
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f" (did you mean {close[0]!r}?)" if close else ""
