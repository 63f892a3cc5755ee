"""``certificate.json``: what is claimed, written for a reader who trusts nobody.

The document holds the numbers of rig and controller, the families, and P; every number is a
rational in a string. :func:`check` believes none of the rest: it computes the vertices of each
claimed family anew from those numbers, compares them with the listed ones and verifies the
inequalities of :mod:`maglev_design.certify.lyapunov.exact`. It needs neither a solver nor CasADi.
SymPy it does need: the state matrices are stated once, there, and a checker with formulas of its
own would only prove something about those.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

from maglev_design.certify.lyapunov.enclosure import Polytope, enclose
from maglev_design.certify.lyapunov.exact import Matrix, failing, is_positive_definite
from maglev_design.certify.lyapunov.family import Claim, Subject, state_names
from maglev_design.certify.lyapunov.lmi import LOOPS, LmiCertificate, as_strings
from maglev_design.choices import EQUILIBRIA, METHODS, SCHEMA_VERSION
from maglev_design.errors import InputError
from maglev_design.files import digest, read_document, write_bytes

KIND = "maglev-design-certificate"
LARGEST_DOCUMENT = 5_000_000
"""[bytes]"""
MOST_CERTIFICATES = 8
LONGEST_NUMBER = 200
"""Characters of one rational."""
SIZES = (Fraction(1, 10**40), Fraction(10**30))
"""Magnitudes that a number other than 0 may have, in SI units."""
_RATIONAL = re.compile(r"-?[0-9]+(/[0-9]+)?", re.ASCII)
_RIG = ("mass", "gravity", "current_gain", "force_constant", "gap_offset", "gap")


T = TypeVar("T", bound=str)


@dataclass(frozen=True)
class Check:
    """One thing that was verified: its name, whether it holds, and what was seen."""

    name: str
    passed: bool
    detail: str


@dataclass(frozen=True)
class CheckResult:
    """All that was verified of one document."""

    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether everything holds."""
        return all(check.passed for check in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {"passed": self.passed, "checks": [vars(check) for check in self.checks]}


def document(certificates: Sequence[LmiCertificate]) -> dict[str, Any]:
    """Return the document of the certified ones among `certificates`, and of their widest.

    Raises
    ------
    ValueError
        When none is certified, or they are not of one design.
    """
    every = [c for found in certificates for c in (found, found.widest) if c is not None]
    proved = list(dict.fromkeys(c for c in every if c.certified))
    if not proved or any(c.subject != proved[0].subject for c in proved):
        raise ValueError("a document needs certificates, all of one design")
    of = proved[0].subject
    body = {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "rig": {name: str(getattr(of, name)) for name in _RIG}
        | {"voltage": None if of.voltage is None else str(of.voltage)},
        "controller": {
            "equilibrium": of.equilibrium,
            "gains": [str(k) for k in of.gains],
            "method": of.method,
            "period": str(of.period),
            "delay": str(of.delay),
        },
        "certificates": [_entry(c) for c in proved],
    }
    return body | {"sha256": digest(body)}


def _entry(found: LmiCertificate) -> dict[str, Any]:
    whole = found.as_dict()
    family = {name: whole["family"][name] for name in ("gaps", "ratios")}
    kept = {name: whole[name] for name in ("states", "scaling", "vertices", "remainder", "P")}
    return {"loop": whole["loop"], "family": family, **kept, "decay": whole["decay_exact"]}


def write(path: Path, certificates: Sequence[LmiCertificate]) -> None:
    """Write :func:`document` to `path`; the same certificates give the same bytes."""
    text = json.dumps(document(certificates), indent=1, allow_nan=False) + "\n"
    write_bytes(path, text.encode())


def check(path: Path) -> CheckResult:
    """Verify a document anew, in exact arithmetic.

    Raises
    ------
    InputError
        When the file cannot be read, is no certificate, or a number in it is none.
    """
    data = read_document(path, "a certificate", LARGEST_DOCUMENT)
    if data.get("kind") != KIND:
        raise InputError(f"{path}: kind = {str(data.get('kind'))[:80]!r}: must be {KIND!r}")
    if data.get("schema_version") != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema_version: this program reads {SCHEMA_VERSION}; certify again to write "
            "a new document"
        )
    try:
        entries = _list(data, "certificates")
        if not 1 <= len(entries) <= MOST_CERTIFICATES:
            raise InputError(f"certificates: must be 1 to {MOST_CERTIFICATES}")
        of = _subject(data)
        checks = [_whole(data)]
        for number, entry in enumerate(entries):
            checks += _checked(of, entry, f"certificates[{number}]")
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return CheckResult(tuple(checks))


def _whole(data: dict[str, Any]) -> Check:
    try:
        same = data.get("sha256") == digest(data)
    except ValueError as error:
        raise InputError("a number that is not finite") from error
    return Check(
        "sha256", same, "as written" if same else "the document was changed after it was written"
    )


def _checked(of: Subject, entry: Any, where: str) -> list[Check]:
    """Return the checks of one certificate."""
    family, loop = _table(entry, "family", where), _choice(entry, "loop", LOOPS, where)
    over = Claim(
        loop,
        _pair(family, "gaps", f"{where}.family"),
        _pair(family, "ratios", f"{where}.family"),
    )
    names = list(state_names(of, loop))
    scale = _vector(entry, "scaling", len(names), where)
    P = tuple(
        _numbers(row, len(names), f"{where}.P[{n}]")
        for n, row in enumerate(_list(entry, "P", len(names), where))
    )
    decay = _number(entry.get("decay"), f"{where}.decay")
    polytope = enclose(of, over, scale)
    listed = [as_strings(vertex) for vertex in polytope.vertices]
    label = f"{where} {loop}"
    period = of.period if loop == "sampled" else None
    same = entry.get("vertices") == listed and entry.get("remainder") == str(polytope.remainder)
    return [
        Check(f"{label}: states", entry.get("states") == names, ", ".join(names)),
        Check(
            f"{label}: vertices",
            same,
            f"{len(listed)} computed anew, {'the' if same else 'not the'} listed ones",
        ),
        Check(
            f"{label}: P > 0",
            is_positive_definite(P),
            "every pivot of L D L' must be positive",
        ),
        _decrease(f"{label}: decrease", same, polytope, P, decay, period),
    ]


def _decrease(
    name: str,
    looked_at: bool,
    polytope: Polytope,
    P: Matrix,
    decay: Fraction,
    period: Fraction | None,
) -> Check:
    """Return the check of the inequality; not worth its time for vertices of another family."""
    if not looked_at:
        return Check(name, False, "not looked at: the listed vertices are not the family's")
    if decay < 0:
        return Check(name, False, "the claimed decay is negative")
    bad = failing(polytope.vertices, P, decay=decay, remainder=polytope.remainder, period=period)
    if bad:
        return Check(name, False, f"V does not fall at vertex {', '.join(map(str, bad))}")
    return Check(name, True, f"V falls at every vertex, with a decay of {float(decay):.6g} 1/s")


def _subject(data: dict[str, Any]) -> Subject:
    rig, own = _table(data, "rig"), _table(data, "controller")
    numbers = {name: _number(rig.get(name), f"rig.{name}") for name in _RIG}
    voltage = rig.get("voltage")
    return Subject(
        **numbers,
        voltage=None if voltage is None else _number(voltage, "rig.voltage"),
        equilibrium=_choice(own, "equilibrium", EQUILIBRIA, "controller"),
        method=_choice(own, "method", METHODS, "controller"),
        gains=_vector(own, "gains", 4, "controller"),
        period=_positive(own, "period"),
        delay=_number(own.get("delay"), "controller.delay"),
    )


def _positive(table: dict[str, Any], name: str) -> Fraction:
    value = _number(table.get(name), f"controller.{name}")
    if value <= 0:
        raise InputError(f"controller.{name}: must be greater than 0")
    return value


def _number(value: Any, where: str) -> Fraction:
    """Return a rational written as "p" or "p/q"."""
    if not isinstance(value, str) or len(value) > LONGEST_NUMBER or not _RATIONAL.fullmatch(value):
        raise InputError(
            f"{where} = {str(value)[:40]!r}: must be a rational in a string, such as '981/100'"
        )
    over, _, under = value.partition("/")
    if under and int(under) == 0:
        raise InputError(f"{where} = {value[:40]!r}: divides by zero")
    number = Fraction(int(over), int(under or 1))
    if number and not SIZES[0] <= abs(number) <= SIZES[1]:
        raise InputError(f"{where} = {value[:40]!r}: larger or smaller than any rig's")
    return number


def _numbers(row: Any, size: int, where: str) -> tuple[Fraction, ...]:
    if not isinstance(row, list) or len(row) != size:
        raise InputError(f"{where}: must be a list of {size} rationals")
    return tuple(_number(value, f"{where}[{n}]") for n, value in enumerate(row))


def _vector(table: dict[str, Any], name: str, size: int, where: str) -> tuple[Fraction, ...]:
    return _numbers(table.get(name), size, f"{where}.{name}")


def _pair(table: dict[str, Any], name: str, where: str) -> tuple[Fraction, Fraction]:
    low, high = _vector(table, name, 2, where)
    return low, high


def _list(table: dict[str, Any], name: str, size: int | None = None, where: str = "") -> list[Any]:
    found = table.get(name)
    if not isinstance(found, list) or (size is not None and len(found) != size):
        rows = "" if size is None else f" of {size} rows"
        raise InputError(f"{where}{'.' if where else ''}{name}: must be a list{rows}")
    return found


def _table(data: Any, name: str, where: str = "") -> dict[str, Any]:
    found = data.get(name) if isinstance(data, dict) else None
    if not isinstance(found, dict):
        raise InputError(f"{where}{'.' if where else ''}{name}: must be a table")
    return found


def _choice(table: dict[str, Any], name: str, allowed: Sequence[T], where: str) -> T:
    for word in allowed:
        if table.get(name) == word:
            return word
    raise InputError(
        f"{where}.{name} = {str(table.get(name))[:40]!r}: must be one of {', '.join(allowed)}"
    )
