from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import recorded
from rigs import SHORT, rig_with

from maglev_design.controller.design import PoleSpec
from maglev_design.errors import InputError
from maglev_design.files import digest, finite
from maglev_design.record import (
    LARGEST_RECORD,
    DesignRecord,
    load,
    rig_as_data,
    rig_from_data,
    save,
)
from maglev_design.tuning import TuneResult, build_problem, solve

HOSTILE = "</script><b>\\input{x} \"q\" 's' `t` $\\frac{ %d {0} \n {{ x }} \u2028 🧲"
CHANGES = {
    "name": HOSTILE,
    "notes": HOSTILE,
    "uncertainty.beta": 0.1,
    "limits.voltage": [0.0, math.inf],
    "sampling.period": 0.002,
}


@pytest.fixture(scope="module")
def record() -> DesignRecord:
    problem = build_problem(rig_with(SHORT, CHANGES))
    result = solve(problem, baseline=PoleSpec.double(1, 70))
    assert isinstance(result, TuneResult)
    return recorded(result)


@pytest.fixture
def saved(record: DesignRecord, tmp_path: Path) -> Path:
    return save(record, tmp_path)[0]


def rewritten(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Edit a record as somebody would who knows about the checksum."""
    document = json.loads(path.read_text("utf-8"))
    change(document)
    document.pop("sha256", None)
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    document["sha256"] = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(json.dumps(document), "utf-8")


def refused(path: Path, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load(path)
    assert str(path) in str(caught.value)


# --- there and back ------------------------------------------------------------------------


def test_a_record_reads_back_bit_for_bit(record: DesignRecord, saved: Path) -> None:
    again = load(saved)
    assert again.design == record.design
    assert again.rig == record.rig
    body = {key: value for key, value in again.document.items() if key != "sha256"}
    assert json.dumps(body) == json.dumps(record.document)
    assert set(again.curves) == set(record.curves)
    for name, curve in record.curves.items():
        assert again.curves[name].tobytes() == curve.tobytes()


def test_a_folder_stands_for_the_record_in_it(record: DesignRecord, saved: Path) -> None:
    assert load(saved.parent).design == load(str(saved.parent)).design == record.design


def test_two_saves_give_the_same_bytes(record: DesignRecord, tmp_path: Path) -> None:
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        folder.mkdir()
        save(record, folder)
    for name in ("design.json", "design.npz"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_a_record_names_no_place_and_no_time(saved: Path) -> None:
    text = saved.read_text("utf-8")
    assert str(saved.parent) not in text
    assert str(Path.home()) + "/" not in text
    assert not {"time", "date", "host", "path"} & set(json.loads(text))


def test_infinite_limits_survive_and_are_null_in_the_file(
    record: DesignRecord, saved: Path
) -> None:
    document = json.loads(saved.read_text("utf-8"))
    assert document["rig"]["limits"]["voltage"] == [0.0, None]
    assert load(saved).rig.limits.voltage == (0.0, math.inf)
    assert load(saved).design.coefficients == record.design.coefficients
    for word in ("Infinity", "NaN"):
        assert word not in saved.read_text("utf-8")


def test_a_hostile_name_is_data(saved: Path) -> None:
    again = load(saved)
    assert again.rig.name == HOSTILE
    assert again.rig.notes == HOSTILE
    assert json.loads(saved.read_text("utf-8"))["rig"]["name"] == HOSTILE


def test_the_curves_are_optional(record: DesignRecord, saved: Path) -> None:
    saved.with_suffix(".npz").unlink()
    again = load(saved)
    assert again.curves == {}
    assert again.design == record.design


def test_the_curves_are_those_of_the_document(record: DesignRecord) -> None:
    curves, key = record.curves, record.document["objective"]
    error = np.abs(curves["worst_gap"] - curves["reference"])
    weight = curves["times"] * error
    assert np.trapezoid(weight, curves["times"]) == pytest.approx(
        record.document["worst_case"][key], rel=0.02
    )
    assert curves["baseline_commanded"].shape == (len(curves["times"]) - 1,)


def test_a_rig_survives_as_data(record: DesignRecord) -> None:
    data = json.loads(json.dumps(rig_as_data(record.rig), allow_nan=False))
    assert rig_from_data(data, "x") == record.rig


def test_plain_data_has_no_infinity_no_tuple_and_no_numpy() -> None:
    mixed = {
        "a": (1, math.inf),
        2: np.float64(0.5),
        "c": np.array([1.0, math.nan]),
        "d": np.int64(3),
    }
    assert finite(mixed) == {"a": [1, None], "2": 0.5, "c": [1.0, None], "d": 3}
    assert type(finite(np.int64(3))) is int


# --- damaged, edited, foreign --------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_a_truncated_record_is_refused(saved: Path, share: float) -> None:
    content = saved.read_bytes()
    saved.write_bytes(content[: int(share * len(content))])
    refused(saved, "not valid JSON")


def test_one_changed_digit_is_noticed_anywhere(saved: Path) -> None:
    content = saved.read_bytes()
    places = [n for n, byte in enumerate(content) if byte in b"12345678"]
    for place in places[:: len(places) // 40]:
        damaged = bytearray(content)
        damaged[place] += 1
        try:
            if json.loads(damaged) == json.loads(content):
                continue  # a seventeenth digit that leaves the number what it was
        except ValueError:
            pass
        saved.write_bytes(bytes(damaged))
        refused(saved, "sha256|schema_version|not valid JSON|stands twice")


def test_one_flipped_bit_never_passes_as_something_else(record: DesignRecord, saved: Path) -> None:
    content = saved.read_bytes()
    for place in range(0, len(content), len(content) // 60):
        damaged = bytearray(content)
        damaged[place] ^= 0x04
        saved.write_bytes(bytes(damaged))
        try:
            again = load(saved)
        except InputError as error:
            assert str(saved) in str(error)  # noqa: PT017 - white space may change unnoticed
        else:
            assert again.design == record.design
            assert again.rig == record.rig


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("schema_version", 2, "schema_version, record_version = 2, 2: this program reads 1, 2"),
        ("schema_version", None, "make the record anew: maglev-design tune"),
        ("record_version", 1, "record_version = 1, 1: this program reads 1, 2"),
        ("record_version", None, "make the record anew: maglev-design tune"),
        ("controller_sha256", "0" * 64, "controller_sha256 is not that of the design beside it"),
        ("gains", {"k0": 1.0}, "gains is not that of the design beside it"),
        ("difference_equation", {}, "difference_equation is not that of the design beside it"),
        ("kind", "something", "kind = 'something'"),
        ("rig", None, "rig"),
        ("rig", {}, "required and missing"),
        ("design", None, "damaged"),
        ("design", {}, "damaged"),
        ("design", [], "damaged"),
    ],
)
def test_a_record_of_another_shape_is_refused(
    saved: Path, key: str, value: Any, message: str
) -> None:
    rewritten(saved, lambda document: document.update({key: value}))
    refused(saved, message)


def renamed(document: dict[str, Any]) -> None:
    """Give a controller whose numbers were edited the name that belongs to them."""
    design = document["design"]
    name = digest(design["numbers"])
    design["controller_sha256"] = document["controller_sha256"] = name


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("gains", {"k0": 1.0, "k1": 2.0, "k2": 3.0, "k3": 4.0}),
        ("gains", {"k0": 1.0, "k1": 2.0, "k2": 3.0}),
        ("gains", {"k0": "a", "k1": "b", "k2": "c", "k3": "d"}),
        ("coefficients", {}),
        ("method", "rk4"),
        ("method", "euler"),
        ("period", 0.001),
        ("U", 1.0),
        ("C_U", 1.0),
        ("C_Y", 1.0),
        ("Y", 0.02),
        ("voltage_limits", [0.0, 3.0]),
        ("reference", [0.0242, 0.012, 0.1, 0.4]),
        ("reference", [0.0242]),
        ("law", {"name": "lin-pid"}),
        ("law", {"nom": "tan-gpi"}),
    ],
)
@pytest.mark.parametrize("signed", [False, True])
def test_numbers_that_do_not_belong_together_are_refused(
    saved: Path, key: str, value: Any, signed: bool
) -> None:
    def change(document: dict[str, Any]) -> None:
        document["design"]["numbers"][key] = value
        if signed:
            renamed(document)

    rewritten(saved, change)
    refused(saved, r"do(es)? not belong|damaged|unknown equilibrium|is not that|are not those")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("poles", [[1.0, 71.0], [1.0, 71.0]]),
        ("poles", [[1.0, -71.0], [1.0, 71.0]]),
        ("poles", "1 71"),
        ("equilibrium", ["model"]),
        ("controller_sha256", "0" * 64),
        ("beta_c", "x"),
    ],
)
def test_labels_that_do_not_belong_to_the_numbers_are_refused(
    saved: Path, key: str, value: Any
) -> None:
    rewritten(saved, lambda document: document["design"].update({key: value}))
    refused(saved, r"do(es)? not belong|damaged|unknown equilibrium|greater than 0|are not those")


def test_one_gain_moved_in_its_last_visible_digit_is_refused(saved: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        document["design"]["numbers"]["gains"]["k0"] *= 1 + 1e-9
        renamed(document)

    rewritten(saved, change)
    refused(saved, "the difference equation does not belong to the gains|is not that")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x89PNG\r\n\x1a\n\x00\xff",
        b"[]",
        b"3",
        b"null",
        b'"text"',
        b"{",
        b"[" * 100_000,
        b'{"kind": "maglev-design", "schema_version": 1, "x": NaN}',
        b'{"kind": "maglev-design", "schema_version": 1, "x": -Infinity}',
        b'{"kind": "maglev-design", "schema_version": 1, "x": 1e999}',
        b'{"kind": "maglev-design", "schema_version": 1, "x": ' + b"9" * 5000 + b"}",
        b'{"kind": "maglev-design", "schema_version": 1, "record_version": 2, "x": "\\ud800"}',
    ],
    ids=lambda content: repr(content[:60]),
)
def test_what_is_not_a_record_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "design.json"
    path.write_bytes(content)
    refused(path, r"not a design record|damaged|kind = ")


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    with path.open("wb") as file:
        file.truncate(LARGEST_RECORD + 1)  # a sparse file
    refused(path, "larger than")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    refused(tmp_path / "nothing.json", "cannot be read")


def test_a_folder_without_a_record_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"design\.json: cannot be read"):
        load(tmp_path)


@pytest.mark.parametrize("damage", ["truncated", "text", "empty", "flipped"])
def test_damaged_curves_are_an_input_error_that_names_their_file(saved: Path, damage: str) -> None:
    curves = saved.with_suffix(".npz")
    content = bytearray(curves.read_bytes())
    content[len(content) // 2] ^= 0xFF
    curves.write_bytes(
        {
            "truncated": bytes(content[: len(content) // 2]),
            "text": b"not an archive",
            "empty": b"",
            "flipped": bytes(content),
        }[damage]
    )
    record = load(saved)  # nobody has looked at them
    with pytest.raises(InputError, match=r"design\.npz"):
        dict(record.curves)


def test_the_curves_of_another_design_are_refused(saved: Path, tmp_path: Path) -> None:
    own = load(saved)
    other = tmp_path / "other"
    other.mkdir()
    save(replace(own, curves={**own.curves, "times": 2 * own.curves["times"]}), other)
    shutil.copyfile(other / "design.npz", saved.with_suffix(".npz"))
    record = load(saved)
    for look in (len, list, lambda curves: curves["times"], bool):
        with pytest.raises(InputError, match=r"design\.npz: not the curves of the design\.json"):
            look(record.curves)


def test_curves_that_no_record_names_are_refused_with_the_remedy(saved: Path) -> None:
    rewritten(saved, lambda document: document.pop("curves_sha256"))
    with pytest.raises(InputError, match=r"design\.npz: .* of an earlier version"):
        dict(load(saved).curves)
    saved.with_suffix(".npz").unlink()
    assert dict(load(saved).curves) == {}
