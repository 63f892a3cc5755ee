"""What a verification found, as plain records."""

from __future__ import annotations

from dataclasses import dataclass

from maglev_design.exporting.running import Runnable


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes
    ----------
    name : str
    passed : bool
    value : float
        What was found, in `unit`.
    limit : float or None
        What is allowed at most; None where nothing was promised and the value is for the reader.
    unit : str
    note : str
        What a person needs to know about it; empty for nothing.
    """

    name: str
    passed: bool
    value: float
    limit: float | None
    unit: str = "-"
    note: str = ""

    @classmethod
    def below(cls, name: str, value: float, limit: float, unit: str = "-", note: str = "") -> Check:
        """Return a check that passes up to `limit`; a nan does not."""
        return cls(name, value <= limit, value, limit, unit, note)


@dataclass(frozen=True)
class Verdict:
    """What became of a folder.

    Attributes
    ----------
    checks : tuple of Check
    skipped : tuple of (str, str)
        Name of a check that this machine cannot make, and the reason.
    ran : str
        Which printing of the law ran in the closed loops: the folder's own, or for MATLAB (and
        where no compiler is) Python's; empty when none did.
    controller_sha256 : str
        Name of the controller that the folder holds; empty where the folder was not read.
    doubts : tuple of str
        Why the design itself should not be switched on, whole sentences; empty when it may be.
    """

    checks: tuple[Check, ...]
    skipped: tuple[tuple[str, str], ...]
    ran: str
    controller_sha256: str = ""
    doubts: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.passed for check in self.checks)


@dataclass(frozen=True)
class Part:
    """What one part of the verification found, and what it built."""

    checks: tuple[Check, ...] = ()
    skipped: tuple[tuple[str, str], ...] = ()
    built: Runnable | None = None
