"""``[drive]``, force laws and what is uncertain about them: read, refused, drawn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from rigs import MINIMAL, SHORT, changed, rig_with
from test_plants import COIL, placed, plant_named

from maglev_design.controller.checks import check_path_voltage
from maglev_design.controller.design import (
    PoleSpec,
    believed_equilibrium,
    make_design,
    plant_beta,
    true_equilibrium,
)
from maglev_design.controller.plant import (
    fastest_unstable_pole,
    plant_numbers,
)
from maglev_design.errors import InputError
from maglev_design.options import PAPER_PLANT, PlantKind
from maglev_design.rig import Rig, load_rig, make_rig, preset_names
from maglev_design.simulation import build, nominal_scenario, simulate, simulate_batch
from maglev_design.simulation.grid import contact_gap, floor_gap
from maglev_design.sweeping import make_setup
from maglev_design.sweeping.scenarios import plants, run_loops, scenario
from maglev_design.tuning.cautions import coil

VOLTAGE = {"drive": COIL, "plant.current_gain": ...}
POWER = {"plant.force_law": "power", "plant.gap_exponent": 3.0}


def refusal(changes: dict[str, Any], base: dict[str, Any] = MINIMAL) -> str:
    """Return the message with which the changed rig is refused."""
    with pytest.raises(InputError) as caught:
        make_rig(changed(base, changes), "my.toml")
    return str(caught.value)


BAD = [
    ({**VOLTAGE, "drive.resistance": 0.0}, ["drive.resistance", "greater than 0", "ohm"]),
    ({**VOLTAGE, "drive.resistance": -2.4}, ["drive.resistance", "-2.4", "greater than 0"]),
    ({**VOLTAGE, "drive.inductance": 0.0}, ["drive.inductance", "greater than 0", "H"]),
    ({**VOLTAGE, "drive.inductance": 15.0}, ["drive.inductance", "15.0", "less than or equal"]),
    ({**VOLTAGE, "drive.inductance": ...}, ["drive.inductance", "required", "H"]),
    ({**VOLTAGE, "drive.resistance": ...}, ["drive.resistance", "required"]),
    ({"drive": COIL}, ["drive.resistance", "plant.current_gain", "1/R"]),
    ({**VOLTAGE, "drive.current_gain": 1.0}, ["drive.current_gain", "kind = 'current'", "1/R"]),
    ({**VOLTAGE, "drive.lag": 0.002}, ["drive.lag", "kind = 'current'"]),
    ({"drive.resistance": 2.4}, ["drive.resistance", "kind = 'voltage'"]),
    ({"drive.current_gain": 1.0}, ["drive.current_gain", "stands twice"]),
    ({"plant.current_gain": ...}, ["plant.current_gain", "required", "A/V"]),
    ({"drive.lag": 2.0}, ["drive.lag", "2.0", "less than or equal to 1"]),
    ({"drive.lag": -0.1}, ["drive.lag", "greater than or equal to 0"]),
    ({"drive.kind": "volts"}, ["drive.kind", "volts", "'current' or 'voltage'"]),
    ({"plant.force_law": "inverse"}, ["plant.force_law", "inverse-square", "exponential"]),
    ({"plant.force_law": "power"}, ["plant.gap_exponent", "required"]),
    ({"plant.force_law": "exponential"}, ["plant.decay_length", "required"]),
    ({"plant.gap_exponent": 3.0}, ["plant.gap_exponent", "'power'"]),
    ({"plant.decay_length": 0.01}, ["plant.decay_length", "'exponential'"]),
    ({**POWER, "plant.gap_exponent": 0.0}, ["plant.gap_exponent", "greater than 0"]),
    ({**POWER, "plant.gap_exponent": 20.0}, ["plant.gap_exponent", "less than or equal to 8"]),
    ({**POWER, "plant.current_exponent": 3}, ["plant.current_exponent", "1 or 2"]),
    ({"plant.current_exponent": 1}, ["plant.current_exponent", "power law"]),
    (
        {
            "plant.force_law": "exponential",
            "plant.decay_length": 0.01,
            "plant.gap_offset": 0.001,
        },
        ["plant.gap_offset", "factor exp(-y0/a)"],
    ),
    ({"plant.damping": -1.0}, ["plant.damping", "greater than or equal to 0"]),
    ({"plant.gap_offset": -0.03}, ["operating_point.gap", "0.03 m", "positive"]),
    ({"limits.voltage": [-5.0, 5.0]}, ["limits.voltage", "-5.0", "attracts too"]),
    (
        {"drive.input_offset": 0.4, "limits.voltage": [0.0, 5.0]},
        ["limits.voltage", "0.4 V or more"],
    ),
    ({"uncertainty.lag": [-0.001, 0.002]}, ["uncertainty.lag", "at least 0"]),
    ({"uncertainty.resistance": 2.0}, ["uncertainty.resistance", "ohm"]),
    ({"uncertainty.lag": [0.001, 0.002]}, ["uncertainty.lag", "drive.lag", "above 0"]),
    (
        {"drive.lag": 0.001, "uncertainty.lag": [0.0, 0.002]},
        ["uncertainty.lag = [0.0, 0.002]", "above 0"],
    ),
    ({"uncertainty.resistance": [1.0, 2.0]}, ["uncertainty.resistance", "kind = 'voltage'"]),
    ({**VOLTAGE, "uncertainty.lag": [0.001, 0.002]}, ["uncertainty.lag", "kind = 'current'"]),
]


@pytest.mark.parametrize(("changes", "words"), BAD, ids=str)
def test_what_cannot_be_is_refused_with_field_value_and_remedy(
    changes: dict[str, Any], words: list[str]
) -> None:
    if changes.get("drive.input_offset") and changes.get("limits.voltage") == [0.0, 5.0]:
        changes = {**changes, "limits.voltage": [-0.1, 5.0]}
        assert "0.4 V or more" in refusal(changes)
        return
    message = refusal(changes)
    assert message.startswith("my.toml: ")
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({}, PAPER_PLANT),
        ({"drive.lag": 0.002}, PlantKind(actuation="lag")),
        (VOLTAGE, PlantKind(actuation="coil")),
        ({**VOLTAGE, "drive.inductance_law": "constant"}, PlantKind(actuation="lag")),
        ({"plant.damping": 0.1}, PlantKind(damped=True)),
        ({"uncertainty.damping": [0.0, 0.1]}, PlantKind(damped=True)),
        ({"drive.input_offset": -0.1}, PlantKind(offset=True)),
        (POWER, PlantKind("power")),
        ({**POWER, "plant.current_exponent": 1}, PlantKind("power", 1)),
    ],
    ids=str,
)
def test_a_rig_says_its_kind_of_plant(changes: dict[str, Any], kind: PlantKind) -> None:
    assert rig_with(MINIMAL, changes).kind == kind


def test_plain_data_has_no_word_that_is_as_by_default() -> None:
    for name in preset_names():
        data = load_rig(name).model_dump(exclude_none=True)
        if "drive" not in data:
            assert {
                *("mass", "gravity", "current_gain", "force_constant", "gap_offset"),
                *("force_law", "gap_exponent", "current_exponent", "decay_length", "damping"),
            }
    plain = rig_with(MINIMAL).model_dump(exclude_none=True)
    assert "drive" not in plain
    assert set(plain["plant"]) == {*MINIMAL["plant"], "gap_offset"}
    for changes in ({**VOLTAGE}, {**POWER}, {"drive": {"lag": 0.002, "input_offset": 0.1}}):
        rig = rig_with(MINIMAL, changes)
        assert make_rig(rig.model_dump(exclude_none=True)) == rig


def test_the_current_gain_may_stand_in_the_drive() -> None:
    own = rig_with(MINIMAL)
    moved = rig_with(MINIMAL, {"plant.current_gain": ..., "drive.current_gain": 1.05})
    assert plant_beta(moved) == plant_beta(own)
    assert moved.kind == PAPER_PLANT


def test_numbers_of_a_lag_and_of_a_coil() -> None:
    lag = plant_numbers(rig_with(MINIMAL, {"drive.lag": 0.002}))
    assert (lag["L"], lag["R"]) == (0.002, 1.0)
    own = plant_numbers(rig_with(MINIMAL, VOLTAGE))
    assert (own["L"], own["R"]) == (0.0048, 1 / 1.05)


@pytest.mark.parametrize("name", ["lag", "coil", "dipole", "exponential", "damped", "offset"])
def test_what_is_believed_is_what_is_true_of_the_nominal_plant(name: str) -> None:
    rig = plant_named(name)
    own = believed_equilibrium(rig, "model")
    true = true_equilibrium(rig, plant_beta(rig), rig.operating_point.gap)
    found = [getattr(own, name) for name in ("U", "C_U", "C_Y")]
    known = [getattr(true, name) for name in ("U", "C_U", "C_Y")]
    assert found == pytest.approx(known, rel=1e-12)
    measured = believed_equilibrium(rig, "measured", voltage=true.U)
    assert measured.beta == pytest.approx(plant_beta(rig), rel=1e-9)
    again = [getattr(measured, name) for name in ("U", "C_U", "C_Y")]
    assert again == pytest.approx(known, rel=1e-9)


def test_an_inductance_that_is_not_positive_names_the_constant_law() -> None:
    """L(y) = L + 2K(1/y - 1/Y): far away less than nothing is left of 1 mH."""
    rig = rig_with(SHORT, {**VOLTAGE, "drive.inductance": 0.001, "limits.gap": [0.001, 0.05]})
    with pytest.raises(InputError) as caught:
        check_path_voltage(rig)
    message = str(caught.value)
    assert all(word in message for word in ("drive.inductance", "0.05 m", '"constant"', " H"))
    check_path_voltage(
        rig_with(
            SHORT, {**VOLTAGE, "drive": {**COIL, "inductance": 0.001, "inductance_law": "constant"}}
        )
    )


def test_a_supply_that_cannot_hold_the_ball_is_refused() -> None:
    rig = rig_with(SHORT, {**VOLTAGE, "limits.voltage": [0.0, 1.5]})
    with pytest.raises(InputError, match=r"limits.voltage = \[0, 1.5\] V: the path needs 2\."):
        check_path_voltage(rig)


def test_a_coil_asks_more_voltage_of_a_quick_path() -> None:
    """What holds the ball is not enough to move it: the current has to be changed."""
    tight = {"limits.voltage": [0.0, 2.65], "reference.start_time": 0.1, "reference.end_time": 0.2}
    ideal = rig_with(SHORT, tight)
    slow = rig_with(SHORT, tight | VOLTAGE)
    for rig, wanted in ((ideal, False), (slow, True)):
        try:
            check_path_voltage(rig)
            refused = False
        except InputError:
            refused = True
        assert refused == wanted


def test_a_negative_offset_keeps_the_ball_off_the_pole() -> None:
    rig = rig_with(SHORT, {"plant.gap_offset": -0.004, "limits.gap": [0.0, 0.05]})
    assert contact_gap(rig) > 0.004
    assert 0.004 < floor_gap(rig) < contact_gap(rig)
    design = placed(rig)
    run = simulate(build(rig, "tustin"), design, nominal_scenario(rig, plant_beta(rig)))
    assert not run.metrics.crashed
    assert fastest_unstable_pole(rig) > fastest_unstable_pole(rig_with(SHORT))


@pytest.mark.parametrize("name", ["coil", "offset", "damped"])
def test_what_is_drawn_of_the_drive_runs_alike_in_both_back_ends(name: str) -> None:
    spreads: dict[str, dict[str, Any]] = {
        "coil": {"uncertainty.resistance": [0.9, 1.0], "uncertainty.inductance": [0.0045, 0.005]},
        "offset": {"uncertainty.input_offset": [0.25, 0.35], "uncertainty.lag": [0.002, 0.004]},
        "damped": {"uncertainty.damping": [0.3, 0.7], "uncertainty.mass": [0.019, 0.021]},
    }
    data = plant_named(name).model_dump(exclude_none=True)
    rig = rig_with(data, {**spreads[name], "uncertainty.beta": 0.05})
    design = placed(rig)
    setups = [
        make_setup(rig, (design,), samples=8, seed=3, noise=False, backend=backend)
        for backend in ("compiled", "interpreted")
    ]
    drawn = plants(setups[0], 0, 8)
    loop = build(rig, design.method, controller=design.controller)
    first, second = (run_loops(setup, loop, design, drawn, 1) for setup in setups)
    assert np.ptp(first["itae"]) > 0.01 * first["itae"].mean()
    assert first["itae"] == pytest.approx(second["itae"], rel=1e-8)
    one = simulate(loop, design, scenario(setups[0], drawn, 5)).metrics
    assert one.itae == pytest.approx(float(first["itae"][5]), rel=1e-8)


def test_a_drawn_resistance_is_a_drawn_current_gain() -> None:
    rig = rig_with(SHORT, {**VOLTAGE, "uncertainty.resistance": [0.9, 1.0]})
    setup = make_setup(rig, (placed(rig),), samples=8, seed=1)
    drawn = plants(setup, 0, 8)
    known = plant_beta(rig) * ((1 / 1.05) / drawn.drawn["resistance"]) ** 2
    assert drawn.values["beta_plant"] == pytest.approx(known, rel=1e-12)


def emulated(product: float, **changes: Any) -> Rig:
    """Return the quick rig with an emulated coil of p L/R = `product`."""
    pole = fastest_unstable_pole(rig_with(SHORT))
    own = {"emulator": {"resistance": 2.0, "inductance": 2.0 * product / pole}}
    return rig_with(SHORT, own | changes)


def test_an_emulated_coil_is_told_with_the_lines_that_design_for_it() -> None:
    pole = fastest_unstable_pole(rig_with(SHORT))
    assert coil(emulated(0.019), pole) is None
    told = coil(emulated(0.3), pole)
    assert told is not None
    for words in ("p L/R = 0.3", '[drive] with kind = "voltage"', "resistance = 0.952381"):
        assert words in told
    superseded = coil(emulated(0.3, **{"drive.lag": 0.002}), pole)
    assert superseded is not None
    assert "play no part" in superseded
    assert "2 ms of its [drive]" in superseded


def test_the_lines_of_the_warning_make_the_plant_of_the_emulator() -> None:
    rig = emulated(0.3)
    told = coil(rig, fastest_unstable_pole(rig)) or ""
    values = {
        name: float(told.split(f"{name} = ")[1].split(",")[0])
        for name in ("resistance", "inductance")
    }
    moved = rig_with(SHORT, {"plant.current_gain": ..., "drive": {"kind": "voltage", **values}})
    assert plant_beta(moved) == pytest.approx(plant_beta(rig), rel=1e-5)
    assert moved.drive.time_constant == pytest.approx(rig.emulator.time_constant, rel=1e-3)


# --- presets -------------------------------------------------------------------------------

TUNED = {
    "zeltom-eml": (1.697, 137.9),
    "inteco-mls2em": (1.257, 160.2),
    "hafner-riedmiller2011": (1.632, 38.38),
    "levitador-benchmark": (1.262, 105.1),
}
"""Poles near those that `tune` finds."""


@pytest.mark.parametrize("name", TUNED)
def test_a_preset_of_another_plant_levitates_at_the_ends_of_its_uncertainty(name: str) -> None:
    rig = load_rig(name)
    assert rig.kind != PAPER_PLANT
    check_path_voltage(rig)
    design = make_design(rig, PoleSpec.double(*TUNED[name]))
    loop = build(rig, design.method, controller=design.controller)
    error = rig.uncertainty.beta
    for ratio in (1 - error, 1.0, 1 + error):
        start = nominal_scenario(rig, design.beta_at(ratio))
        (run,) = simulate_batch(loop, [design], [start])
        assert not run.metrics.crashed
        assert abs(run.metrics.final_error) < 1e-6


def test_the_numbers_of_the_presets_follow_from_what_is_published() -> None:
    zeltom, inteco, benchmark, levitador = (load_rig(name) for name in TUNED)
    k = 17.31e-9 * (1 - (10 / 20) ** 4)
    assert zeltom.plant.force_constant == pytest.approx(k, rel=1e-9)
    pull = zeltom.plant.mass * zeltom.plant.gravity / k * 0.01**4
    assert zeltom.drive.input_offset == pytest.approx(-2.41 * pull, rel=1e-4)
    assert inteco.plant.force_constant == pytest.approx(1.7521e-2 / 5.8231e-3, rel=1e-7)
    assert inteco.drive.input_offset == pytest.approx(-0.0243 / 2.5165, rel=1e-5)
    lag = 1.4142e-4 / 4.5626e-3 * math.exp(-0.009 / 4.5626e-3)
    assert inteco.drive.lag == pytest.approx(lag, rel=1e-3)
    assert benchmark.plant.force_constant == 1.599e-3 / 2
    assert benchmark.drive.inductance == pytest.approx(0.80502 + 1.599e-3 / 0.020, rel=1e-6)
    assert levitador.plant.force_constant == pytest.approx(0.0035 * 0.0052 / 2, rel=1e-9)
    assert levitador.drive.inductance == pytest.approx(0.0363 + 0.0035 / (1 + 5 / 5.2), rel=1e-5)
