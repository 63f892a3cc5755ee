from __future__ import annotations

import copy
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from maglev_design.certify.lyapunov.certificate import LONGEST_NUMBER, check, document, write
from maglev_design.certify.lyapunov.enclosure import enclose
from maglev_design.certify.lyapunov.lmi import LmiCertificate, certify_family
from maglev_design.design import PoleSpec, make_design
from maglev_design.errors import InputError
from maglev_design.files import digest
from maglev_design.parameters import load_rig

PAPER = load_rig("belmonte2021")
Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def certificates() -> tuple[LmiCertificate, ...]:
    design = make_design(PAPER, PoleSpec.double(1.1371, 107.346))
    return certify_family(design, PAPER, bisect=False)


@pytest.fixture(scope="module")
def written(certificates: tuple[LmiCertificate, ...]) -> dict[str, Any]:
    return document(certificates)


def saved(path: Path, data: Any, *, sealed: bool = True) -> Path:
    """Write a document, by default with the sha256 that belongs to what it now says."""
    if sealed:
        data["sha256"] = digest(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def changed(written: dict[str, Any], change: Change) -> dict[str, Any]:
    data = copy.deepcopy(written)
    change(data)
    return data


def failed(path: Path) -> list[str]:
    """Return the last words of the names of the checks that fail."""
    result = check(path)
    assert result.passed == all(c.passed for c in result.checks)
    return [c.name.rpartition(" ")[2] for c in result.checks if not c.passed]


def test_what_was_written_is_verified(
    tmp_path: Path, certificates: tuple[LmiCertificate, ...]
) -> None:
    write(tmp_path / "certificate.json", certificates)
    result = check(tmp_path / "certificate.json")
    assert result.passed
    assert len(result.checks) == 1 + 4 * 2
    assert result.as_dict()["passed"] is True


def test_the_same_certificates_give_the_same_bytes(
    tmp_path: Path, certificates: tuple[LmiCertificate, ...]
) -> None:
    for name in ("a.json", "b.json"):
        write(tmp_path / name, certificates)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_the_checker_needs_neither_solver_nor_casadi(
    tmp_path: Path, written: dict[str, Any]
) -> None:
    path = saved(tmp_path / "certificate.json", written)
    code = (
        "import sys, pathlib; from maglev_design.certify.lyapunov.certificate import check;"
        "result = check(pathlib.Path(sys.argv[1]));"
        "print(result.passed, {'cvxpy', 'casadi', 'scipy', 'clarabel', 'scs'} & set(sys.modules))"
    )
    done = subprocess.run(  # noqa: S603 - our own interpreter and text
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "True set()"


def _entry(number: int, *keys: Any, value: Callable[[Any], Any]) -> Change:
    def change(data: dict[str, Any]) -> None:
        place: Any = data["certificates"][number]
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value(place[keys[-1]])

    return change


def plus(step: str) -> Callable[[str], str]:
    return lambda text: str(Fraction(text) + Fraction(step))


def negative(text: str) -> str:
    return str(-Fraction(text))


def _all_of_P(data: dict[str, Any]) -> None:
    entry = data["certificates"][1]
    entry["P"] = [[negative(x) for x in row] for row in entry["P"]]


@pytest.mark.parametrize("number", [0, 1], ids=["continuous", "sampled"])
@pytest.mark.parametrize(
    ("keys", "value", "caught"),
    [
        (("P", 0, 1), plus("1/1000"), "0"),
        (("P", 0, 0), negative, "0"),
        (("vertices", 0, 1, 0), negative, "vertices"),
        (("vertices", 2, 1, 0), plus("1/18446744073709551616"), "vertices"),
        (("vertices",), lambda v: v[:-1], "vertices"),
        (("vertices",), lambda v: [*v, v[0]], "vertices"),
        (("vertices",), lambda _: "none", "vertices"),
        (("remainder",), lambda _: "0", "vertices"),
        (("family", "gaps", 0), plus("1/1000"), "vertices"),
        (("family", "gaps", 0), plus("-1/1000"), "vertices"),
        (("family", "ratios", 1), plus("1/20"), "vertices"),
        (("family", "ratios", 1), plus("-1/20"), "vertices"),
        (("decay",), plus("1000"), "decrease"),
        (("decay",), lambda _: "-1", "decrease"),
        (("scaling", 1), plus("1"), "vertices"),
        (("states",), lambda s: [*s[1:], s[0]], "states"),
    ],
)
def test_a_tampered_certificate_fails_though_its_seal_is_right(
    tmp_path: Path, written: dict[str, Any], number: int, keys: Any, value: Any, caught: str
) -> None:
    data = changed(written, _entry(number, *keys, value=value))
    assert caught in failed(saved(tmp_path / "certificate.json", data))


def test_a_larger_family_fails_even_with_its_own_vertices(
    tmp_path: Path, certificates: tuple[LmiCertificate, ...]
) -> None:
    """All the rig's gaps, the vertices listed faithfully, with the P and without the decay."""
    found = certificates[0]
    over = replace(found.claim, gaps=(Fraction(1, 1000), Fraction(1, 20)))
    wide = replace(found, claim=over, polytope=enclose(found.subject, over, found.scale))
    assert failed(saved(tmp_path / "certificate.json", document([wide]))) == ["decrease"]


def test_the_gains_and_the_rig_are_part_of_the_claim(
    tmp_path: Path, written: dict[str, Any]
) -> None:
    for table, name, wrong in (
        ("rig", "gravity", "10"),
        ("rig", "gap", "1/50"),
        ("controller", "period", "1/500"),
        ("controller", "delay", "1/100000"),
        ("controller", "method", "euler"),
        ("controller", "equilibrium", "appendix-a"),
    ):
        data = copy.deepcopy(written)
        data[table][name] = wrong
        path = tmp_path / "certificate.json"
        if name == "delay":  # one more state than P has rows
            with pytest.raises(InputError, match="scaling"):
                check(saved(path, data))
        else:
            assert "vertices" in failed(saved(path, data)), name
    data = changed(written, lambda d: d["controller"]["gains"].__setitem__(0, "1000"))
    assert "vertices" in failed(saved(tmp_path / "certificate.json", data))


def test_an_edited_document_without_its_seal_fails(tmp_path: Path, written: dict[str, Any]) -> None:
    data = changed(written, lambda d: d.__setitem__("note", "mine"))
    assert failed(saved(tmp_path / "certificate.json", data, sealed=False)) == ["sha256"]


def test_minus_P_is_refused_twice(tmp_path: Path, written: dict[str, Any]) -> None:
    data = changed(written, _all_of_P)
    assert failed(saved(tmp_path / "certificate.json", data)) == ["0", "decrease"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.__setitem__("kind", "something else"), "kind"),
        (lambda d: d.__setitem__("schema_version", 2), "schema_version"),
        (lambda d: d.pop("certificates"), "certificates: must be a list"),
        (lambda d: d.__setitem__("certificates", []), "must be 1 to"),
        (lambda d: d.__setitem__("certificates", [7]), "family: must be a table"),
        (lambda d: d.pop("rig"), "rig: must be a table"),
        (lambda d: d["rig"].pop("mass"), "rig.mass = 'None'"),
        (lambda d: d["rig"].__setitem__("mass", 0.02), "must be a rational in a string"),
        (lambda d: d["rig"].__setitem__("mass", "0"), "rig must be positive"),
        (lambda d: d["rig"].__setitem__("mass", "1e999999999"), "must be a rational"),
        (lambda d: d["rig"].__setitem__("mass", "__import__('os')"), "must be a rational"),
        (lambda d: d["rig"].__setitem__("mass", "1/0"), "divides by zero"),
        (lambda d: d["rig"].__setitem__("mass", "\u0661"), "must be a rational"),
        (lambda d: d["rig"].__setitem__("mass", "9" * 100), "larger or smaller"),
        (lambda d: d["rig"].__setitem__("mass", "9" * (LONGEST_NUMBER + 1)), "must be a rational"),
        (lambda d: d["controller"].__setitem__("gains", ["1"] * 3), "list of 4"),
        (lambda d: d["controller"].__setitem__("gains", ["-1"] * 4), "four positive numbers"),
        (lambda d: d["controller"].__setitem__("method", "magic"), "must be one of tustin"),
        (lambda d: d["controller"].__setitem__("period", "0"), "greater than 0"),
        (lambda d: d["controller"].__setitem__("period", "1000"), "faster"),
        (lambda d: d["controller"].__setitem__("delay", "99999999"), "12 periods"),
        (_entry(0, "loop", value=lambda _: "open"), "must be one of continuous, sampled"),
        (_entry(0, "P", value=lambda P: P[:-1]), "P: must be a list of 4 rows"),
        (_entry(0, "P", 0, value=lambda row: row[:-1]), r"P\[0\]: must be a list of 4"),
        (_entry(0, "P", 0, 0, value=lambda _: "nan"), r"P\[0\]\[0\] = 'nan'"),
        (_entry(0, "scaling", 0, value=lambda _: "-1"), "scaling"),
        (_entry(0, "family", "gaps", 0, value=negative), "gap range"),
        (_entry(0, "family", "ratios", 0, value=lambda _: "0"), "ratios"),
    ],
)
def test_garbled_input_is_named(
    tmp_path: Path, written: dict[str, Any], change: Change, message: str
) -> None:
    path = saved(tmp_path / "certificate.json", changed(written, change))
    with pytest.raises(InputError, match=message) as caught:
        check(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{",
        "NaN",
        "\x00",
        '{"kind": "maglev-design"}',
        "[" * 100_000,
        '{"kind": "maglev-design-certificate", "schema_version": 1, "certificates": [Infinity]}',
    ],
    ids=["empty", "list", "cut", "nan", "binary", "design", "deep", "infinity"],
)
def test_what_is_no_certificate_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "certificate.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"certificate\.json"):
        check(path)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        check(tmp_path / "certificate.json")


def test_nothing_is_written_when_nothing_is_certified(tmp_path: Path) -> None:
    design = make_design(PAPER, PoleSpec.double(1, 70))
    refused = certify_family(design, PAPER, gap_range=PAPER.limits.gap, bisect=False)
    with pytest.raises(ValueError, match="needs certificates"):
        write(tmp_path / "certificate.json", refused)
    assert list(tmp_path.iterdir()) == []
