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

from maglev_design.certification.lyapunov.certificate import check, document, write
from maglev_design.certification.lyapunov.enclosure import enclose
from maglev_design.certification.lyapunov.fields import LONGEST_NUMBER
from maglev_design.certification.lyapunov.lmi import LmiCertificate, certify_family
from maglev_design.controller.design import PoleSpec, make_design
from maglev_design.errors import InputError
from maglev_design.files import digest
from maglev_design.rig import load_rig

PAPER = load_rig("belmonte2021")
DESIGN = make_design(PAPER, PoleSpec.double(1.1371, 107.346))
Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def certificates() -> tuple[LmiCertificate, ...]:
    return certify_family(DESIGN, PAPER, bisect=False)


@pytest.fixture(scope="module")
def written(certificates: tuple[LmiCertificate, ...]) -> dict[str, Any]:
    return document(certificates)


def saved(path: Path, data: Any, *, sealed: bool = True) -> Path:
    """Write a document, by default with the sha256 that belongs to what it now says."""
    if sealed:
        data["sha256"] = digest(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def renamed(data: dict[str, Any]) -> dict[str, Any]:
    """Give a document the name of the controller that it now holds."""
    return data | {"controller_sha256": digest(data["controller"])}


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
    assert len(result.checks) == 2 + 4 * 2
    assert result.as_dict()["passed"] is True
    for word in (DESIGN.sha256, "k0 = ", "tustin at 1 ms", "Belmonte"):
        assert word in result.controller
    continuous, sampled = result.claims
    for word in ("12 mm to 24.6 mm", "0.85 to 1.15", "may move", "y0 = 0 mm taken as known"):
        assert word in continuous
        assert word in sampled
    assert "continuous law" in continuous
    assert "difference equation" in sampled


def test_the_certificate_of_one_design_is_not_that_of_another(
    tmp_path: Path, written: dict[str, Any]
) -> None:
    path = saved(tmp_path / "certificate.json", written)
    assert check(path, (DESIGN, PAPER)).passed
    other = make_design(PAPER, PoleSpec.double(1, 70))
    (bad,) = (c for c in check(path, (other, PAPER)).checks if not c.passed)
    assert bad.name == "controller"
    assert DESIGN.sha256 in bad.detail
    assert other.sha256 in bad.detail
    heavier = PAPER.model_copy(update={"plant": PAPER.plant.model_copy(update={"gravity": 9.8})})
    (bad,) = (c for c in check(path, (DESIGN, heavier)).checks if not c.passed)
    assert (bad.name, bad.detail) == ("rig", "differs in gravity")


def test_coefficients_of_other_gains_are_not_believed(
    tmp_path: Path, written: dict[str, Any]
) -> None:
    data = changed(written, lambda d: d["controller"]["gains"].__setitem__("k1", 1e6))
    assert failed(saved(tmp_path / "certificate.json", renamed(data)))[0] == "equation"


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
        "import sys, pathlib; from maglev_design.certification.lyapunov.certificate import check;"
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


def plus_double(name: str) -> Change:
    def change(data: dict[str, Any]) -> None:
        data["controller"]["coefficients"][name] *= 1 + 1e-9

    return change


def number(*keys: Any, value: Any) -> Change:
    """Change a number of the controller, and with it its name."""

    def change(data: dict[str, Any]) -> None:
        place: Any = data["controller"]
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value
        data["controller_sha256"] = digest(data["controller"])

    return change


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
        ("rig", "beta", "1/700"),
        ("rig", "gap_offset", "1/1000"),
        ("rig", "delay", "1/100000"),
        ("controller", "Y", 0.02),
        ("controller", "period", 0.002),
        ("controller", "C_U", 9.0),
        ("controller", "C_Y", 700.0),
    ):
        data = copy.deepcopy(written)
        data[table][name] = wrong
        path = tmp_path / "certificate.json"
        if name == "delay":  # one more state than P has rows
            with pytest.raises(InputError, match="scaling"):
                check(saved(path, data))
            continue
        if table == "controller":
            with pytest.raises(InputError, match="contradicts the numbers"):
                check(saved(path, data))
        assert "vertices" in failed(saved(path, renamed(data))), name
    for name in ("d", "c1", "c2", "b1", "b2", "a22"):
        double = plus_double(name)
        data = renamed(changed(written, double))
        assert {"equation", "vertices"} <= set(failed(saved(tmp_path / "certificate.json", data)))


def test_an_edited_document_without_its_seal_fails(tmp_path: Path, written: dict[str, Any]) -> None:
    data = changed(written, lambda d: d["rig"].__setitem__("name", "mine"))
    assert failed(saved(tmp_path / "certificate.json", data, sealed=False)) == ["sha256"]


def test_minus_P_is_refused_twice(tmp_path: Path, written: dict[str, Any]) -> None:
    data = changed(written, _all_of_P)
    assert failed(saved(tmp_path / "certificate.json", data)) == ["0", "decrease"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.__setitem__("kind", "something else"), "kind"),
        (lambda d: d.__setitem__("schema_version", 2), "schema_version"),
        (lambda d: d.pop("certificate_version"), "anew: maglev-design certify design.json"),
        (lambda d: d.__setitem__("note", "mine"), "note: unknown key"),
        (lambda d: d["rig"].__setitem__("gravty", "1"), "did you mean 'gravity'"),
        (lambda d: d["controller"].__setitem__("C_X", 1.0), "controller.C_X: unknown key"),
        (lambda d: d.__setitem__("controller_sha256", "0" * 64), "contradicts the numbers"),
        (lambda d: d.pop("certificates"), "certificates: missing"),
        (lambda d: d.__setitem__("certificates", {}), "certificates: must be a list"),
        (lambda d: d.__setitem__("certificates", []), "must be 1 to"),
        (lambda d: d.__setitem__("certificates", [7]), r"certificates\[0\]: must be a table"),
        (_entry(0, "family", value=lambda _: 7), "family: must be a table"),
        (_entry(0, "family", "voltage_held", value=lambda _: 1), "must be true or false"),
        (lambda d: d.pop("rig"), "rig: missing"),
        (lambda d: d["rig"].pop("beta"), "rig.beta: missing"),
        (lambda d: d["rig"].__setitem__("beta", 0.02), "must be a rational in a string"),
        (lambda d: d["rig"].__setitem__("beta", "0"), r"rig.beta = 0 \[m\^3.*greater than 0"),
        (lambda d: d["rig"].__setitem__("gravity", "-1"), r"gravity = -1 \[m/s\^2\].*greater"),
        (lambda d: d["rig"].__setitem__("delay", "-1"), r"delay = -1 \[s\]: must be 0 or more"),
        (lambda d: d["rig"].__setitem__("gap_offset", "-1"), r"Y \+ y0 must be above 0"),
        (lambda d: d["rig"].__setitem__("name", 7), "rig.name"),
        (lambda d: d["rig"].__setitem__("beta", "1e999999999"), "must be a rational"),
        (lambda d: d["rig"].__setitem__("beta", "__import__('os')"), "must be a rational"),
        (lambda d: d["rig"].__setitem__("beta", "1/0"), "divides by zero"),
        (lambda d: d["rig"].__setitem__("beta", "\u0661"), "must be a rational"),
        (lambda d: d["rig"].__setitem__("beta", "9" * 100), "larger or smaller"),
        (lambda d: d["rig"].__setitem__("beta", "9" * (LONGEST_NUMBER + 1)), "must be a rational"),
        *(
            (number(name, value=wrong), rf"controller.{name} = {float(wrong)} \[.*greater than 0")
            for name in ("U", "C_U", "C_Y", "Y", "period")
            for wrong in (0, -1.5)
        ),
        (number("U", value="2"), "controller.U = '2'.*must be a number"),
        (number("U", value=True), "must be a number"),
        (number("U", value=1e300), "larger or smaller"),
        (number("gains", value=[1, 2, 3, 4]), "gains: must be a table"),
        (number("gains", "k2", value=0), "gains.k2 = 0"),
        (number("coefficients", "a22", value=None), "a22 = 'None'"),
        (number("method", value="magic"), "must be one of tustin"),
        (number("law", "name", value="lin-pid"), "controller.law"),
        (number("voltage_limits", 0, value=-1), "voltage_limits"),
        (number("voltage_limits", 1, value=0), "must be greater than"),
        (number("reference", 2, value=-1), "reference"),
        (number("period", value=1000.0), "faster"),
        (lambda d: d["rig"].__setitem__("delay", "99999999"), "12 periods"),
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
        '{"kind": "maglev-design-certificate", "kind": "maglev-design-certificate"}',
    ],
    ids=["empty", "list", "cut", "nan", "binary", "design", "deep", "infinity", "twice"],
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
