"""What can go wrong, with the numbers that made it go wrong and what to do about it."""

from __future__ import annotations

import difflib
import math
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


def check_word(name: str, word: str, known: Iterable[str]) -> None:
    """Raise `InputError` when `word`, the value of `name`, is none of the known ones."""
    choices = tuple(known)
    if word not in choices:
        near = nearest(str(word), choices)
        raise InputError(f"{name} = {word!r}: unknown{near}; known: {', '.join(choices)}")


def check_numbers(positive: bool = False, **numbers: float | None) -> None:
    """Raise `InputError` for the first of the named numbers that is not finite; None is none.

    Examples
    --------
    >>> check_numbers(positive=True, beta_c=0.0013, voltage=None)
    """
    for name, value in numbers.items():
        if value is not None and not (math.isfinite(value) and (value > 0 or not positive)):
            allowed = "a finite number greater than 0" if positive else "a finite number"
            raise InputError(f"{name} = {value!r}: must be {allowed}")


def nearest(word: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` for the known name nearest to `word`, or ``""``.

    Examples
    --------
    >>> nearest("gravty", ["mass", "gravity"])
    " (did you mean 'gravity'?)"
    """
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f" (did you mean {close[0]!r}?)" if close else ""
