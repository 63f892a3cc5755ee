from __future__ import annotations

import errno
import math
import os
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError
from rigs import MINIMAL, SHORT, changed, rig_with

from maglev_design.controller.checks import check_path_voltage
from maglev_design.errors import InputError, MaglevError, nearest
from maglev_design.rig import (
    LARGEST_RIG_FILE,
    Rig,
    Uncertainty,
    fields,
    load_rig,
    make_rig,
    parse_rig,
    preset_names,
    preset_text,
)

LONGEST_MESSAGE = 1000
"""Characters: a message that a person reads, whatever was in the file."""
MOST_LINES = 1000
"""Depth of a table that no recursive printer survives."""

MASS = "plant.mass"
GAP = "operating_point.gap"
PERIOD = "sampling.period"


def refusal(data: dict[str, Any]) -> str:
    """Return the message with which `data` is refused."""
    with pytest.raises(InputError) as caught:
        make_rig(data, "my.toml")
    message = str(caught.value)
    assert all(line.startswith("my.toml: ") for line in message.splitlines())
    return message


def refused_text(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_rig(text, "my.toml")
    assert str(caught.value).startswith("my.toml: ")
    assert len(str(caught.value)) < LONGEST_MESSAGE
    return str(caught.value)


# field, value typed, words that the message must hold: the value, what is allowed, the unit
BAD_VALUES = [
    (MASS, 0.0, ["0.0", "greater than 0", "[kg]"]),
    (MASS, -0.02, ["-0.02", "greater than 0", "[kg]"]),
    (MASS, "0.02", ["'0.02'", "number", "[kg]"]),
    (MASS, True, ["True", "number", "[kg]"]),
    (MASS, math.nan, ["nan", "finite number", "[kg]"]),
    (MASS, math.inf, ["inf", "finite number", "[kg]"]),
    (MASS, -math.inf, ["-inf", "finite number", "[kg]"]),
    (MASS, {"value": 0.02}, ["{'value': 0.02}", "number", "[kg]"]),
    (MASS, [0.02], ["[0.02]", "number", "[kg]"]),
    (MASS, 10**400, ["1329 bits", "number", "[kg]"]),
    (MASS, 1 << 20_000, ["an integer of 20001 bits", "number", "[kg]"]),
    ("plant.gravity", 0, ["0", "greater than 0", "[m/s^2]"]),
    ("plant.current_gain", 0.0, ["0.0", "greater than 0", "[A/V]"]),
    ("plant.force_constant", 0.0, ["0.0", "greater than 0", "[N m^2/A^2]"]),
    ("plant.force_constant", -1e-5, ["-1e-05", "greater than 0", "[N m^2/A^2]"]),
    ("plant.gap_offset", -4.2, ["-4.2", "greater than or equal to -0.5", "[m]"]),
    ("plant.gap_offset", 4.2, ["4.2", "metres", "0.0042 m"]),
    (GAP, 0.0, ["0.0", "greater than 0", "[m]"]),
    (GAP, -0.01, ["-0.01", "greater than 0", "[m]"]),
    (GAP, 24.6, ["24.6", "0.5", "[m]", "gaps are in metres", "0.0246 m"]),
    (GAP, "24.6 mm", ["'24.6 mm'", "number", "[m]"]),
    (GAP, math.nan, ["nan", "finite number", "[m]"]),
    (GAP, 10**400, ["bits", "[m]"]),
    ("operating_point.voltage", 0.0, ["0.0", "greater than 0", "[V]"]),
    ("initial.gap", 24.6, ["24.6", "0.0246 m"]),
    ("initial.velocity", math.inf, ["inf", "finite number", "[m/s]"]),
    ("reference.start_gap", 24.2, ["24.2", "0.0242 m"]),
    ("reference.end_gap", 12.0, ["12.0", "0.012 m"]),
    ("reference.start_time", -1.0, ["-1.0", "greater than or equal to 0", "[s]"]),
    ("reference.end_time", 0.05, ["0.05", "after start_time = 0.1 s"]),
    ("reference.end_time", 0.1, ["0.1", "after start_time = 0.1 s"]),
    ("reference.horizon", 0.2, ["0.2", "end_time = 0.3 s"]),
    ("reference.horizon", 7000.0, ["7000", "3600", "[s]"]),
    (PERIOD, 0.0, ["0.0", "greater than 0", "[s]"]),
    (PERIOD, -0.001, ["-0.001", "greater than 0", "[s]"]),
    (PERIOD, 1.0, ["1.0", "0.1", "[s]", "times are in seconds", "0.001 s"]),
    (PERIOD, 1e-9, ["1e-09", "4e+08 samples", "at most 1000000"]),
    ("sampling.delay", -0.001, ["-0.001", "greater than or equal to 0", "[s]"]),
    ("sampling.method", "tusti", ["'tusti'", "'tustin', 'euler' or 'zoh'"]),
    ("sampling.method", 3, ["3", "'tustin', 'euler' or 'zoh'"]),
    ("limits.voltage", [5.0], ["[5.0]", "two numbers", "[V]"]),
    ("limits.voltage", [0.0, 5.0, 6.0], ["[0.0, 5.0, 6.0]", "two numbers", "[V]"]),
    ("limits.voltage", 5.0, ["5.0", "two numbers", "[V]"]),
    ("limits.voltage", "ab", ["'ab'", "two numbers", "[V]"]),
    ("limits.voltage", [-5.0, 5.0], ["-5.0", "0 V or more", "u^2"]),
    ("limits.voltage", [0.0, math.nan], ["nan", "above the lower", "0.0 V"]),
    ("limits.voltage", [5.0, 5.0], ["5.0", "above the lower", "5.0 V"]),
    ("limits.voltage", [math.nan, 5.0], ["nan", "0 V or more"]),
    ("limits.gap", [-0.001, 0.05], ["-0.001", "0 m or more"]),
    ("limits.gap", [0.05, 0.001], ["0.001", "above the lower", "0.05 m"]),
    ("noise.input", -1e-3, ["-0.001", "greater than or equal to 0", "[V]"]),
    ("noise.position", math.nan, ["nan", "finite number", "[m]"]),
    ("uncertainty.beta", 1.0, ["1.0", "less than 1", "[-]"]),
    ("uncertainty.beta", 15, ["15", "less than 1", "[-]"]),
    ("uncertainty.beta", -0.15, ["-0.15", "greater than or equal to 0", "[-]"]),
    ("uncertainty.mass", 0.02, ["0.02", "[lower, upper] or a table", "[kg]"]),
    ("uncertainty.mass", [0.02], ["[0.02]", "[lower, upper] or a table", "[kg]"]),
    ("uncertainty.gravity", "9.8", ["'9.8'", "[lower, upper] or a table", "[m/s^2]"]),
    ("emulator.inductance", -1.0, ["-1.0", "greater than or equal to 0", "[H]"]),
    ("emulator.resistance", -1.0, ["-1.0", "greater than or equal to 0", "[ohm]"]),
    ("emulator.sensor_step", -1e-5, ["-1e-05", "greater than or equal to 0", "[m]"]),
    ("emulator.actuator_step", math.inf, ["inf", "finite number", "[V]"]),
    ("emulator.period", 0.0, ["0.0", "greater than 0", "[s]"]),
    ("emulator.period", 2.0, ["2.0", "0.1", "[s]"]),
    ("emulator.period", "2 ms", ["'2 ms'", "number", "[s]"]),
    ("emulator.delay", -1e-4, ["-0.0001", "greater than or equal to 0", "[s]"]),
    ("emulator.delay", 200.0, ["200.0", "1", "[s]"]),
    ("emulator.position_noise", -5e-6, ["-5e-06", "greater than or equal to 0", "[m]"]),
    ("emulator.position_noise", math.nan, ["nan", "finite number", "[m]"]),
    ("plant", 3, ["3", "must be a table", "[plant]"]),
    ("reference", [{"horizon": 1.0}], ["must be a table", "[reference]"]),
    ("limits", None, ["None", "must be a table", "[limits]"]),
    ("name", 3, ["3", "string"]),
    ("name", "x" * 300, ["xxx...xxx", "200"]),
]


@pytest.mark.parametrize(
    ("field", "value", "words"),
    BAD_VALUES,
    ids=[f"{n}-{row[0]}" for n, row in enumerate(BAD_VALUES)],
)
def test_a_bad_value_is_named_with_its_field_unit_and_what_is_allowed(
    field: str, value: Any, words: list[str]
) -> None:
    message = refusal(changed(SHORT, {field: value}))
    assert f"{field} = " in message
    assert [word for word in words if word not in message] == []
    assert len(message) < LONGEST_MESSAGE


NORMAL = {"distribution": "normal", "mean": 0.02, "deviation": 0.0005}

# what stands under [uncertainty], the field that the message names, words that it must hold
BAD_SPREADS: list[tuple[str, Any, str, list[str]]] = [
    ("mass", [0.0, 0.021], "mass.lower = 0.0", ["greater than 0", "kg"]),
    ("mass", [-0.019, 0.021], "mass.lower = -0.019", ["greater than 0", "kg"]),
    ("mass", [0.021, 0.019], "mass.upper = 0.019", ["above lower = 0.021"]),
    ("mass", [0.02, 0.02], "mass.upper = 0.02", ["above lower = 0.02"]),
    ("mass", [math.nan, 0.021], "mass.lower = nan", ["finite number", "[kg]"]),
    ("mass", [0.019, math.inf], "mass.upper = inf", ["finite number", "[kg]"]),
    ("mass", ["0.019", 0.021], "mass.lower = '0.019'", ["number", "[kg]"]),
    ("mass", NORMAL | {"deviation": 0.0}, "mass.deviation = 0.0", ["greater than 0", "[kg]"]),
    ("mass", NORMAL | {"deviation": 0.01}, "mass.deviation = 0.01", ["-0.063", "8.3", "lower = "]),
    ("mass", NORMAL | {"lower": -0.01}, "mass.lower = -0.01", ["greater than 0 kg"]),
    ("mass", NORMAL | {"lower": 0.03}, "mass.mean = 0.02", ["from lower = 0.03"]),
    ("mass", NORMAL | {"mode": 0.02}, "mass.mode = 0.02", ["does not belong to a normal"]),
    ("mass", {"distribution": "normal"}, "mass.mean: required", ["required for a normal"]),
    ("mass", {"mean": 0.02}, "mass.distribution", ["required"]),
    ("mass", NORMAL | {"distribution": "gauss"}, "mass.distribution = 'gauss'", ["'triangular'"]),
    ("mass", NORMAL | {"sigma": 1.0}, "'uncertainty.mass.sigma'", ["unknown key", "deviation"]),
    ("masse", [1.0, 2.0], "'uncertainty.masse'", ["unknown key", "did you mean 'mass'"]),
    ("gap_offset", [-0.7, 0.001], "gap_offset.lower = -0.7", ["at least -0.5", "m"]),
    ("gap_offset", [0.0, 4.2], "gap_offset.upper = 4.2", ["at most 0.5 m", "0.0042 m"]),
    ("input_noise", [-1e-3, 1e-3], "input_noise.lower = -0.001", ["at least 0", "V"]),
    ("initial_gap", [0.0005, 0.02], "initial_gap.lower = 0.0005", ["0.001 m to 0.05 m"]),
    ("initial_gap", [0.02, 0.06], "initial_gap.upper = 0.06", ["0.001 m to 0.05 m"]),
    (
        "initial_gap",
        {"distribution": "normal", "mean": 0.02, "deviation": 0.0023},
        "initial_gap.deviation = 0.0023",
        ["0.00091", "0.001 m to 0.05 m", "lower = "],
    ),
    (
        "gravity",
        {"distribution": "triangular", "lower": 9.7, "mode": 9.6, "upper": 9.9},
        "gravity.mode = 9.6",
        ["from lower = 9.7 to upper = 9.9"],
    ),
]


@pytest.mark.parametrize(
    ("name", "value", "field", "words"),
    BAD_SPREADS,
    ids=[f"{n}-{row[0]}" for n, row in enumerate(BAD_SPREADS)],
)
def test_an_impossible_spread_is_refused(
    name: str, value: Any, field: str, words: list[str]
) -> None:
    message = refusal(changed(SHORT, {f"uncertainty.{name}": value}))
    (line,) = message.splitlines()
    assert field in line
    assert [word for word in words if word not in line] == []


def test_an_interval_is_a_uniform_distribution() -> None:
    table = {"distribution": "uniform", "lower": 0.019, "upper": 0.021}
    one, other = (rig_with(SHORT, {"uncertainty.mass": value}) for value in ([0.019, 0.021], table))
    assert one == other
    assert one.uncertainty.spreads["mass"].reach == (0.019, 0.021)
    assert make_rig(one.model_dump(exclude_none=True)) == one


@pytest.mark.parametrize(
    ("cut", "reach"),
    [
        ({}, (0.02 - 8.3 * 0.0005, 0.02 + 8.3 * 0.0005)),
        ({"lower": 0.019}, (0.019, 0.02 + 8.3 * 0.0005)),
        ({"lower": 0.019, "upper": 0.0205}, (0.019, 0.0205)),
    ],
)
def test_a_normal_distribution_reaches_as_far_as_it_is_drawn(
    cut: dict[str, float], reach: tuple[float, float]
) -> None:
    rig = rig_with(SHORT, {"uncertainty.mass": NORMAL | cut})
    assert rig.uncertainty.spreads["mass"].reach == pytest.approx(reach)


def test_every_spread_has_the_unit_of_what_it_spreads() -> None:
    units = {name: unit for name, unit, _ in fields()}
    plant = {"mass", "gravity", "current_gain", "force_constant", "gap_offset", "damping"}
    pairs = {f"plant.{name}": name for name in plant}
    pairs |= {"initial.gap": "initial_gap", "initial.velocity": "initial_velocity"}
    pairs |= {"noise.input": "input_noise", "noise.position": "position_noise"}
    drive = {"lag", "resistance", "inductance", "input_offset"}
    pairs |= {f"drive.{name}": name for name in drive}
    assert set(pairs.values()) | {"beta", "voltage"} == set(Uncertainty.model_fields)
    for name, own in pairs.items():
        assert units[f"uncertainty.{own}"] == units[name]


@pytest.mark.parametrize("element", [True, "5", None, {}])
def test_a_limit_that_is_no_number_is_named_with_its_place(element: Any) -> None:
    message = refusal(changed(SHORT, {"limits.voltage": [0.0, element]}))
    assert "limits.voltage.1 = " in message
    assert "number" in message
    assert "[V]" in message


def test_a_coil_with_an_inductance_needs_a_resistance() -> None:
    message = refusal(changed(SHORT, {"emulator.inductance": 0.022}))
    assert message == (
        "my.toml: emulator.resistance = 0.0: must be above 0 ohm when an inductance is given"
    )
    whole = {"emulator.inductance": 0.022, "emulator.resistance": 22.0}
    assert rig_with(SHORT, whole).emulator.time_constant == pytest.approx(1e-3)
    assert rig_with(SHORT, {"emulator.resistance": 22.0}).emulator.time_constant == 0.0


REQUIRED = [
    *(f"plant.{name}" for name in ("mass", "gravity", "current_gain", "force_constant")),
    GAP,
    PERIOD,
]


@pytest.mark.parametrize("field", REQUIRED)
def test_a_missing_number_is_named_with_its_unit(field: str) -> None:
    message = refusal(changed(MINIMAL, {field: ...}))
    assert message.startswith(f"my.toml: {field}: required and missing (")
    assert "[" in message
    assert len(message.splitlines()) == 1, "one fault, one line"


@pytest.mark.parametrize("section", ["plant", "operating_point", "sampling"])
def test_a_missing_section_is_one_line(section: str) -> None:
    message = refusal(changed(MINIMAL, {section: ...}))
    assert message == f"my.toml: {section}: required and missing"


@pytest.mark.parametrize("field", [GAP, "initial.gap"])
@pytest.mark.parametrize("value", [24.6, math.nan, "x", -1.0, 0.7])
def test_one_wrong_number_makes_one_line(field: str, value: Any) -> None:
    message = refusal(changed(MINIMAL, {field: value}))
    assert len(message.splitlines()) == 1
    assert field in message


@pytest.mark.parametrize(
    ("key", "suggestion"),
    [
        ("plant.gravty", "gravity"),
        ("plant.Mass", "mass"),
        ("operating_point.gap_", "gap"),
        ("sampling.periode", "period"),
        ("limits.volts", "voltage"),
        ("reference.horizont", "horizon"),
        ("emulator.resistence", "resistance"),
        ("plnt", "plant"),
        ("uncertainity", "uncertainty"),
        ("nme", "name"),
    ],
)
def test_an_unknown_key_is_answered_with_the_nearest_one(key: str, suggestion: str) -> None:
    message = refusal(changed(SHORT, {key: 1.0}))
    assert f"unknown key {key!r} (did you mean {suggestion!r}?)" in message
    section = key.rpartition(".")[0]
    assert (f"[{section}] takes: " if section else "the top level takes: ") in message


def test_an_unknown_key_near_nothing_lists_what_is_known() -> None:
    message = refusal(changed(SHORT, {"plant.zzzzqqqq": 1.0}))
    assert "did you mean" not in message
    assert "mass, gravity, current_gain, force_constant, gap_offset" in message


def test_several_faults_are_all_reported() -> None:
    message = refusal(changed(SHORT, {MASS: -1.0, PERIOD: "x", "plant.foo": 1}))
    assert len(message.splitlines()) == 3


@pytest.mark.parametrize("place", ["initial.gap", "reference.start_gap", "reference.end_gap", GAP])
@pytest.mark.parametrize("gap", [0.0005, 0.001, 0.05, 0.06])
def test_a_gap_outside_the_limits_is_refused(place: str, gap: float) -> None:
    message = refusal(changed(SHORT, {place: gap}))
    assert f"{place} = {gap!r}: must be inside limits.gap, 0.001 m to 0.05 m" in message


def test_a_key_that_is_no_text_is_refused() -> None:
    data: dict[Any, Any] = {**MINIMAL, 3: 4}
    assert "key 3: keys must be text" in refusal(data)


@pytest.mark.parametrize("data", [None, 3, [], "text", {"plant"}])
def test_what_is_no_table_at_all_is_refused(data: Any) -> None:
    assert "must be a table" in refusal(data)


# --- files ---------------------------------------------------------------------------------


def file_refusal(path: Path | str) -> str:
    with pytest.raises(InputError) as caught:
        load_rig(path)
    assert len(str(caught.value)) < LONGEST_MESSAGE
    return str(caught.value)


def toml(data: dict[str, Any]) -> str:
    """Return TOML text of a rig of numbers."""
    lines = []
    for section, table in data.items():
        lines.append(f"[{section}]")
        lines += [f"{key} = {value!r}" for key, value in table.items()]
    return "\n".join(lines) + "\n"


def test_a_file_loads_as_its_data_do(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(toml(SHORT), encoding="utf-8")
    assert load_rig(path) == load_rig(str(path)) == make_rig(SHORT)


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    path = tmp_path / "notepad.toml"
    path.write_bytes(b"\xef\xbb\xbf" + toml(SHORT).encode())
    assert load_rig(path) == make_rig(SHORT)


def test_a_file_without_the_usual_ending_loads(tmp_path: Path) -> None:
    path = tmp_path / "rig"
    path.write_text(toml(MINIMAL), encoding="utf-8")
    assert load_rig(str(path)) == make_rig(MINIMAL)


def test_a_fault_in_a_file_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(toml(changed(SHORT, {MASS: -1.0})), encoding="utf-8")
    assert file_refusal(path).startswith(f"{path}: plant.mass = -1.0: ")


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(bytes(range(256)))
    assert file_refusal(path) == f"{path}: not a text file in UTF-8"


def test_text_in_another_encoding_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes('name = "Schwebek\xf6rper"\n'.encode("latin-1"))
    assert file_refusal(path) == f"{path}: not a text file in UTF-8"


def test_zero_bytes_are_no_toml(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(b"\0" * 100)
    assert f"{path}: not valid TOML" in file_refusal(path)


def test_a_folder_is_refused(tmp_path: Path) -> None:
    assert file_refusal(tmp_path) == f"{tmp_path}: cannot be read (Is a directory)"
    assert "Is a directory" in file_refusal(str(tmp_path))


def test_a_file_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.toml"
    assert file_refusal(str(path)) == f"{path}: cannot be read (No such file or directory)"


def test_a_file_without_permission_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def denied(*_: Any, **__: Any) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    path = tmp_path / "rig.toml"
    path.write_text(toml(SHORT), encoding="utf-8")
    monkeypatch.setattr(os, "open", denied)  # chmod would not stop root
    assert file_refusal(path) == f"{path}: cannot be read (Permission denied)"


def test_a_file_behind_a_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("", encoding="utf-8")
    assert "cannot be read (Not a directory)" in file_refusal(path / "rig.toml")


def test_a_huge_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(b"#" * (LARGEST_RIG_FILE + 1))
    assert "larger than 1000000 bytes" in file_refusal(path)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs an endless file")
@pytest.mark.parametrize(
    "key",
    [
        "a." * 15 + "a",
        ".".join(f'"{n}"' for n in range(16)),
        " . ".join(["x"] * 400_000),
        "a." * 499_000 + "a",
    ],
    ids=lambda key: key[:8],
)
@pytest.mark.parametrize("place", ["{} = 1", "[{}]", "plant = {{ {} = 1 }}"])
def test_a_key_of_many_parts_is_refused_at_once(key: str, place: str) -> None:
    begun = time.monotonic()
    with pytest.raises(InputError, match="a key of 16 parts or more"):
        parse_rig(place.format(key), "rig.toml")
    assert time.monotonic() - begun < 5


@pytest.mark.parametrize(
    "text",
    [
        "a" * 1_000_000,
        "'" * 1_000_000,
        '"' * 1_000_000,
        "a " * 500_000,
        "a = [" * 200_000,
        "a = " + "[" * 900_000,
        "a = {b = " * 100_000,
        "[a]\n" * 250_000,
        "a.b = 1\n" * 100_000,
        "[[a]]\n" * 160_000,
        "a = '" + "x." * 400_000 + "'",
        "a = 1" + "_1" * 400_000,
        'a = """' + "\\n" * 400_000 + '"""',
        "".join(f"a{n} = 1\n" for n in range(80_000)),
        "".join(f"[a.b{n}]\n" for n in range(80_000)),
    ],
    ids=lambda text: text[:12],
)
def test_no_file_takes_long_to_refuse(text: str) -> None:
    begun = time.monotonic()
    with pytest.raises(InputError):
        parse_rig(text, "rig.toml")
    assert time.monotonic() - begun < 20


def test_an_endless_file_is_refused() -> None:
    assert "no regular file" in file_refusal(Path("/dev/zero"))


def test_a_name_that_no_file_has_is_refused() -> None:
    assert "cannot be read" in file_refusal("a\0b.toml")
    assert "no preset named" in file_refusal("a\0b")
    assert "no preset named" in file_refusal("x" * 300)


@pytest.mark.parametrize(
    "text",
    [
        "[plant\nmass = 1",
        "mass 0.02",
        "a = 1\na = 2",
        "x = " + "[" * 5000 + "]" * 5000,
        "x = " + "{a=" * 5000 + "1" + "}" * 5000,
        "x = 1" + "0" * 5000,
        "x = 2021-99-99",
    ],
    ids=["table", "key", "twice", "arrays", "inline", "digits", "date"],
)
def test_invalid_toml_is_refused(text: str) -> None:
    assert "not valid TOML" in refused_text(text)


@pytest.mark.parametrize(
    "text",
    ["[plant.mass" + ".a" * MOST_LINES * 5 + "]\nx = 1\n", "x = 0x" + "f" * 6000 + "\n"],
    ids=["tables", "hexadecimal"],
)
def test_valid_toml_that_cannot_be_printed_is_refused(text: str) -> None:
    assert refused_text(text)


def test_an_empty_file_says_what_a_rig_needs() -> None:
    lines = refused_text("").splitlines()
    assert lines == [
        f"my.toml: {section}: required and missing"
        for section in ("plant", "operating_point", "sampling")
    ]


# --- defaults ------------------------------------------------------------------------------


def test_what_is_not_said_is_harmless() -> None:
    rig = make_rig(MINIMAL)
    gap = MINIMAL["operating_point"]["gap"]
    assert (rig.initial.gap, rig.initial.velocity) == (gap, 0.0)
    path = rig.reference
    assert (path.start_gap, path.end_gap, path.horizon) == (gap, gap, 1.0)
    assert rig.limits.voltage == (0.0, math.inf)
    assert rig.limits.gap == (0.0, math.inf)
    assert (rig.noise.input, rig.noise.position) == (0.0, 0.0)
    assert rig.uncertainty.beta == 0.0
    assert (rig.sampling.delay, rig.sampling.method) == (0.0, "tustin")
    assert rig.plant.gap_offset == 0.0
    assert rig.operating_point.voltage is None
    effects = rig.emulator
    assert (effects.inductance, effects.resistance, effects.time_constant) == (0.0, 0.0, 0.0)
    assert (effects.sensor_step, effects.actuator_step) == (0.0, 0.0)
    assert (effects.period, effects.delay, effects.position_noise) == (None, None, None)


def test_no_value_of_the_paper_leaks_into_another_rig() -> None:
    own = changed(
        MINIMAL,
        {
            MASS: 3.3,
            "plant.gravity": 7.7,
            "plant.current_gain": 5.5,
            "plant.force_constant": 4.4e-3,
            GAP: 0.033,
            PERIOD: 0.0022,
        },
    )
    numbers = {v for t in own.values() for v in t.values()} | {0.0, 1.0, math.inf}
    flat = _numbers(make_rig(own).model_dump())
    assert flat - numbers == set()


def _numbers(value: Any) -> set[float]:
    if isinstance(value, dict):
        return set().union(*(_numbers(v) for v in value.values()))
    if isinstance(value, tuple | list):
        return set().union(*(_numbers(v) for v in value))
    return {float(value)} if isinstance(value, int | float) else set()


def test_an_infinite_upper_voltage_is_accepted() -> None:
    assert rig_with(SHORT, {"limits.voltage": [0.0, math.inf]}).limits.voltage[1] == math.inf
    assert parse_rig(toml(MINIMAL) + "[limits]\nvoltage = [0, inf]\n", "x").limits.voltage[0] == 0


def test_a_rig_survives_being_saved_and_read() -> None:
    for data in (MINIMAL, SHORT):
        rig = make_rig(data)
        assert make_rig(rig.model_dump()) == rig


def test_validation_leaves_its_argument_alone() -> None:
    data = changed(MINIMAL, {})
    make_rig(data)
    assert data == MINIMAL


def test_a_rig_cannot_be_changed() -> None:
    rig = make_rig(MINIMAL)
    for section, name in ((rig.plant, "mass"), (rig, "name"), (rig.limits, "voltage")):
        with pytest.raises(ValidationError, match="frozen"):
            setattr(section, name, 1.0)


# --- documentation -------------------------------------------------------------------------

UNITS = {
    "kg",
    "N s/m",
    "ohm",
    "H",
    "m/s^2",
    "A/V",
    "N m^2/A^2",
    "m",
    "V",
    "m/s",
    "s",
    "-",
}


def leaves(model: type[BaseModel], prefix: str = "") -> list[str]:
    """Return the dotted names of all fields, found without :func:`fields`."""
    names = []
    for name, info in model.model_fields.items():
        inner = info.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            names += leaves(inner, f"{prefix}{name}.")
        else:
            names.append(prefix + name)
    return names


def test_every_field_has_a_unit_and_a_meaning() -> None:
    listed = {name: (unit, meaning) for name, unit, meaning in fields()}
    assert sorted(listed) == sorted(leaves(Rig))
    assert {unit for unit, _ in listed.values()} <= UNITS
    assert min(len(meaning) for _, meaning in listed.values()) > 3
    assert listed["plant.mass"] == ("kg", "`m`, mass of the ball")
    assert listed["limits.voltage"] == ("V", "actuator range")


# --- presets -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_says_where_it_is_from_and_can_be_followed(name: str) -> None:
    rig = load_rig(name)
    assert rig.source
    assert rig.notes
    assert rig.name != "unnamed rig"
    check_path_voltage(rig)


@pytest.mark.parametrize("name", preset_names())
def test_the_text_of_a_preset_is_a_rig_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.toml"
    path.write_text(preset_text(name), encoding="utf-8")
    assert load_rig(path) == load_rig(name)


def test_an_unknown_preset_is_answered_with_the_nearest_one() -> None:
    message = file_refusal("belmont2021")
    assert "no preset named 'belmont2021' (did you mean 'belmonte2021'?)" in message
    assert ", ".join(preset_names()) in message
    with pytest.raises(InputError, match="no preset named"):
        preset_text("../belmonte2021")


def test_errors_have_the_exit_code_of_bad_input() -> None:
    assert (MaglevError.exit_code, InputError.exit_code) == (1, 2)


def test_nearest_is_silent_when_nothing_is_near() -> None:
    assert nearest("qqqq", ["mass", "gravity"]) == ""
    assert nearest("", []) == ""


# --- junk ----------------------------------------------------------------------------------

NUMBERS = st.one_of(
    st.floats(),
    st.integers(),
    st.sampled_from([10**400, -(10**400), 0, 1, 1e-300, 1e308, 5e-324]),
)
JUNK = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, st.text(max_size=5), st.binary(max_size=3)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)
NAMES = st.sampled_from(sorted({name for dotted in leaves(Rig) for name in dotted.split(".")}))
SECTIONS = st.sampled_from(sorted(Rig.model_fields))
TABLES = st.dictionaries(st.one_of(NAMES, st.text(max_size=4)), st.one_of(NUMBERS, JUNK))
KEYS = st.one_of(SECTIONS, st.text(max_size=4), st.integers())
FUZZ_EXAMPLES = 400


def loads_or_is_refused(data: Any) -> None:
    try:
        rig = make_rig(data)
    except InputError as error:
        assert str(error)  # noqa: PT017 - the point is that nothing else is raised
    else:
        assert rig.reference.horizon / rig.sampling.period > 0


@settings(max_examples=FUZZ_EXAMPLES)
@given(data=st.dictionaries(KEYS, st.one_of(TABLES, JUNK), max_size=6))
def test_any_junk_loads_or_is_refused(data: dict[Any, Any]) -> None:
    loads_or_is_refused(data)


@settings(max_examples=FUZZ_EXAMPLES)
@given(field=st.sampled_from(leaves(Rig)), value=st.one_of(NUMBERS, JUNK))
def test_a_rig_with_one_field_of_junk_loads_or_is_refused(field: str, value: Any) -> None:
    loads_or_is_refused(changed(SHORT, {field: value}))
    loads_or_is_refused(changed(MINIMAL, {field: value}))


@settings(max_examples=FUZZ_EXAMPLES)
@given(text=st.text(), place=st.integers(0, 400))
def test_any_text_loads_or_is_refused(text: str, place: int) -> None:
    whole = toml(SHORT)
    for candidate in (text, whole[:place] + text + whole[place:]):
        try:
            parse_rig(candidate, "my.toml")
        except InputError as error:
            assert str(error).startswith("my.toml: ")  # noqa: PT017 - nothing else is raised
