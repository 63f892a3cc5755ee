"""``certificate.json``: what is claimed, written for a reader who trusts nobody.

The document holds the numbers of plant and controller, the families, and P. The controller's are
the doubles that run, and their digest its name; every other number is a rational in a string.
:func:`check` believes none of the rest: it computes the vertices of each claimed family anew from
those numbers, compares them with the listed ones and verifies the inequalities of
:mod:`maglev_design.certification.lyapunov.exact`. It needs neither a solver nor CasADi. SymPy it
does need: the state matrices are stated once, there, and a checker with formulas of its own would
only prove something about those.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from maglev_design.certification.lyapunov import fields
from maglev_design.certification.lyapunov.enclosure import Polytope, enclose
from maglev_design.certification.lyapunov.exact import Matrix, failing, is_positive_definite
from maglev_design.certification.lyapunov.family import (
    CertificateClaim,
    ExactSubject,
    state_names,
    subject,
)
from maglev_design.certification.lyapunov.lmi import LOOPS, LmiCertificate, as_strings
from maglev_design.certification.lyapunov.words import claim_in_words, controller_in_words
from maglev_design.controller.design import Design, difference_coefficients
from maglev_design.errors import InputError
from maglev_design.files import digest, json_bytes, read_document, write_bytes
from maglev_design.options import SCHEMA_VERSION, TAN_GPI
from maglev_design.rig import Rig

KIND = "maglev-design-certificate"
CERTIFICATE_VERSION = 2
"""Of this document; 1 named no controller."""
LARGEST_DOCUMENT = 5_000_000
"""[bytes]"""
MOST_CERTIFICATES = 8
ROUNDING = 1e-12
"""Relative difference to which the coefficients must be those of the gains."""
_RIG = ("gravity", "gap_offset", "beta", "delay")
_KEYS = ("schema_version", "certificate_version", "kind", "controller_sha256", "rig")
_DOCUMENT = (*_KEYS, "controller", "certificates", "sha256")
_FAMILY = ("gaps", "ratios", "shifts", "voltage_held")
_PROOF = ("states", "scaling", "vertices", "remainder", "P")
_ENTRY = ("loop", "family", *_PROOF, "decay")


@dataclass(frozen=True)
class CertificateCheck:
    """One thing that was verified: its name, whether it holds, and what was seen."""

    name: str
    passed: bool
    detail: str


@dataclass(frozen=True)
class CheckResult:
    """All that was verified of one document.

    Attributes
    ----------
    checks : tuple of CertificateCheck
    controller_sha256 : str
    controller, claims : str and tuple of str
        Of which controller the document speaks and what it claims, in words; true where every check
        passed.
    """

    checks: tuple[CertificateCheck, ...]
    controller_sha256: str
    controller: str
    claims: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether everything holds."""
        return all(check.passed for check in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "schema_version": SCHEMA_VERSION,
            "passed": self.passed,
            "controller_sha256": self.controller_sha256,
            "controller": self.controller,
            "claims": list(self.claims),
            "checks": [vars(check) for check in self.checks],
        }


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
        "certificate_version": CERTIFICATE_VERSION,
        "kind": KIND,
        "controller_sha256": of.sha256,
        "rig": {"name": of.rig} | {name: str(getattr(of, name)) for name in _RIG},
        "controller": dict(of.numbers),
        "certificates": [_entry(c) for c in proved],
    }
    return body | {"sha256": digest(body)}


def _entry(found: LmiCertificate) -> dict[str, Any]:
    whole = found.as_dict()
    return {
        "loop": whole["loop"],
        "family": {name: whole["family"][name] for name in _FAMILY},
        **{name: whole[name] for name in _PROOF},
        "decay": whole["decay_exact"],
    }


def write(path: Path, certificates: Sequence[LmiCertificate]) -> None:
    """Write :func:`document` to `path`; the same certificates give the same bytes."""
    write_bytes(path, json_bytes(document(certificates), 1, ascii_only=True))


def check(path: Path, against: tuple[Design, Rig] | None = None) -> CheckResult:
    """Verify a document anew, in exact arithmetic.

    Parameters
    ----------
    path : Path
    against : tuple of Design and Rig, optional
        The controller, on its rig, of which the document should speak.

    Raises
    ------
    InputError
        When the file cannot be read, is no certificate, is of another version, or a field of it is
        unknown, missing, impossible or contradicts another.
    """
    data = read_document(path, "a certificate", LARGEST_DOCUMENT)
    if data.get("kind") != KIND:
        raise InputError(f"{path}: kind = {str(data.get('kind'))[:80]!r}: must be {KIND!r}")
    version = (data.get("schema_version"), data.get("certificate_version"))
    if version != (SCHEMA_VERSION, CERTIFICATE_VERSION):
        raise InputError(
            f"{path}: schema_version, certificate_version = {str(version[0])[:40]}, "
            f"{str(version[1])[:40]}: this program reads {SCHEMA_VERSION}, {CERTIFICATE_VERSION}; "
            "make the certificate anew: maglev-design certify design.json -o FOLDER"
        )
    try:
        fields.only(data, _DOCUMENT)
        entries = fields.items(data, "certificates")
        if not 1 <= len(entries) <= MOST_CERTIFICATES:
            raise InputError(f"certificates: must be 1 to {MOST_CERTIFICATES}")
        of = _subject(data)
        checks = [_whole(data), _equation(of)]
        if against is not None:
            checks += _same(of, *against)
        claims = []
        for number, entry in enumerate(entries):
            words, found = _checked(of, entry, f"certificates[{number}]")
            claims.append(words)
            checks += found
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return CheckResult(tuple(checks), of.sha256, controller_in_words(of), tuple(claims))


def _whole(data: dict[str, Any]) -> CertificateCheck:
    same = data["sha256"] == digest(data)
    return CertificateCheck(
        "sha256", same, "as written" if same else "the document was changed after it was written"
    )


def _equation(of: ExactSubject) -> CertificateCheck:
    """Return the check that the difference equation is the one that the gains make."""
    numbers = of.numbers
    low, high = numbers["voltage_limits"]
    known = {"C_U_hat": numbers["C_U"], "C_Y_hat": numbers["C_Y"], "T": numbers["period"]}
    known |= {"u_min": low, "u_max": math.inf if high is None else high, **numbers["gains"]}
    made, listed = difference_coefficients(known, of.method, TAN_GPI), numbers["coefficients"]
    same = all(
        math.isclose(x, math.inf if listed[name] is None else listed[name], rel_tol=ROUNDING)
        for name, x in made.items()
    )
    return CertificateCheck(
        "difference equation",
        same,
        f"{'that' if same else 'not that'} of the gains, by {of.method}, to {ROUNDING:g}",
    )


def _same(of: ExactSubject, design: Design, rig: Rig) -> list[CertificateCheck]:
    """Return the checks that the document speaks of this controller on this rig."""
    mine, theirs = subject(design, rig), of.sha256
    same = mine.sha256 == theirs
    differing = [name for name in _RIG if getattr(of, name) != getattr(mine, name)]
    return [
        CertificateCheck(
            "controller",
            same,
            f"{theirs}, the design's"
            if same
            else f"the certificate is of {theirs}, the design is {mine.sha256}",
        ),
        CertificateCheck(
            "rig", not differing, f"differs in {', '.join(differing)}" if differing else of.rig
        ),
    ]


def _checked(of: ExactSubject, entry: Any, where: str) -> tuple[str, list[CertificateCheck]]:
    """Return what one certificate claims, and its checks."""
    if not isinstance(entry, dict):
        raise InputError(f"{where}: must be a table")
    fields.only(entry, _ENTRY, where)
    family = fields.table(entry, "family", _FAMILY, where)
    loop = fields.choice(entry, "loop", LOOPS, where)
    gaps, ratios, shifts = (
        fields.pair(family, name, f"{where}.family") for name in ("gaps", "ratios", "shifts")
    )
    held = _flag(family["voltage_held"], f"{where}.family.voltage_held")
    over = CertificateClaim(loop, gaps, ratios, shifts, held)
    names = list(state_names(of, loop))
    scale = fields.rationals(entry["scaling"], len(names), f"{where}.scaling")
    P = tuple(
        fields.rationals(row, len(names), f"{where}.P[{n}]")
        for n, row in enumerate(fields.items(entry, "P", len(names), where))
    )
    decay = fields.rational(entry["decay"], f"{where}.decay")
    polytope = enclose(of, over, scale)
    listed = [as_strings(vertex) for vertex in polytope.vertices]
    label = f"{where} {loop}"
    period = of.period if loop == "sampled" else None
    same = entry["vertices"] == listed and entry["remainder"] == str(polytope.remainder)
    return claim_in_words(of, over, decay), [
        CertificateCheck(f"{label}: states", entry["states"] == names, ", ".join(names)),
        CertificateCheck(
            f"{label}: vertices",
            same,
            f"{len(listed)} computed anew, {'the' if same else 'not the'} listed ones",
        ),
        CertificateCheck(
            f"{label}: P > 0",
            is_positive_definite(P),
            "every pivot of L D L' must be positive",
        ),
        _decrease(f"{label}: decrease", same, polytope, P, decay, period),
    ]


def _flag(value: Any, where: str) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{where} = {str(value)[:40]!r}: must be true or false")
    return value


def _decrease(
    name: str,
    looked_at: bool,
    polytope: Polytope,
    P: Matrix,
    decay: Fraction,
    period: Fraction | None,
) -> CertificateCheck:
    """Return the check of the inequality; not worth its time for vertices of another family."""
    if not looked_at:
        return CertificateCheck(
            name, False, "not looked at: the listed vertices are not the family's"
        )
    if decay < 0:
        return CertificateCheck(name, False, "the claimed decay is negative")
    bad = failing(polytope.vertices, P, decay=decay, remainder=polytope.remainder, period=period)
    if bad:
        return CertificateCheck(
            name, False, f"V does not fall at vertex {', '.join(map(str, bad))}"
        )
    return CertificateCheck(
        name, True, f"V falls at every vertex, with a decay of {float(decay):.6g} 1/s"
    )


def _subject(data: dict[str, Any]) -> ExactSubject:
    """Return the exact numbers of a document; none of them impossible, none contradicting."""
    rig, numbers = fields.table(data, "rig", ("name", *_RIG)), fields.controller(data)
    if not isinstance(rig["name"], str):
        raise InputError(f"rig.name = {str(rig['name'])[:40]!r}: must be a string")
    plant = {name: fields.rational(rig[name], f"rig.{name}") for name in _RIG}
    for name, unit in (("gravity", "m/s^2"), ("beta", "m^3/(s^2 V^2)")):
        fields.positive(plant[name], f"rig.{name}", unit)
    of = ExactSubject(numbers, rig["name"], **plant)
    if of.delay < 0:
        raise InputError(f"rig.delay = {rig['delay']} [s]: must be 0 or more")
    if of.gap + of.gap_offset <= 0:
        raise InputError(f"rig.gap_offset = {rig['gap_offset']} [m]: Y + y0 must be above 0")
    if data["controller_sha256"] != of.sha256:
        raise InputError(
            f"controller_sha256 = {str(data['controller_sha256'])[:64]!r}: contradicts the numbers "
            f"of `controller`, whose name is {of.sha256}"
        )
    return of
