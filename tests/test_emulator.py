from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from byhand import LAWS
from numpy.typing import NDArray
from rigs import OFFSET, SHORT, rig_with
from scipy.integrate import solve_ivp

from maglev_design.controller.design import (
    Design,
    PoleSpec,
    make_design,
    plant_beta,
    reference_path,
)
from maglev_design.controller.timing import timing
from maglev_design.errors import InputError
from maglev_design.programs import law, step_program
from maglev_design.rig import Rig, load_rig
from maglev_design.simulation import (
    Response,
    Scenario,
    emulated,
    loop_for,
    nominal_scenario,
    simulate,
    stated_errors,
    stepping,
)
from maglev_design.simulation.grid import COIL
from maglev_design.simulation.scenario import parameter_vector, start_state
from maglev_design.symbolic.sampling import signals

Array = NDArray[np.float64]

COIL_1_MS = {"emulator.inductance": 0.022, "emulator.resistance": 22.0}
RUNGE_KUTTA = 1e-6
"""Relative: a tenth of the coil's time constant a step leaves 1e-7 of its own change."""


def design_of(rig: Rig, name: str = "tan-gpi", omega: float = 50.0, **options: Any) -> Design:
    return make_design(rig, PoleSpec.double(1.0, omega), controller=LAWS[name], **options)


def scenario_of(rig: Rig, **options: Any) -> Scenario:
    return replace(nominal_scenario(rig, plant_beta(rig) / 1.05), **options)


def run(rig: Rig, design: Design, *, emulate: bool = True, **options: Any) -> Response:
    loop = loop_for(rig, design, emulate=emulate, continuous=options.pop("continuous", False))
    return simulate(loop, design, scenario_of(rig, **options))


def bits(response: Response) -> tuple[bytes, ...]:
    rows = (response.gap, response.velocity, response.commanded, response.applied)
    return tuple(row.tobytes() for row in rows)


# --- nothing to emulate --------------------------------------------------------------------


@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
@pytest.mark.parametrize("name", LAWS)
def test_without_any_effect_the_emulated_loop_is_the_plain_one(name: str, continuous: bool) -> None:
    # a resistance alone is no coil
    rig = rig_with(SHORT, {"emulator.resistance": 22.0, "sampling.delay": 0.0004})
    design = design_of(rig, name)
    for noise in (False, True):
        options = {"continuous": continuous, "noise": noise}
        plain, same = (run(rig, design, emulate=e, **options) for e in (False, True))
        assert bits(plain) == bits(same)
        assert plain.metrics == same.metrics


def test_without_being_asked_to_nothing_is_emulated() -> None:
    effects = {**COIL_1_MS, "emulator.sensor_step": 1e-4, "emulator.actuator_step": 0.1}
    rig, plain = rig_with(SHORT, effects), rig_with(SHORT)
    design = design_of(plain)
    assert bits(run(rig, design, emulate=False)) == bits(run(plain, design, emulate=False))
    assert bits(run(rig, design)) != bits(run(plain, design))


# --- the rig of an emulation ---------------------------------------------------------------


def test_the_emulated_rig_has_the_emulator_s_period_delay_and_noise() -> None:
    own = {"period": 0.002, "delay": 0.0003, "position_noise": 4e-6}
    rig = rig_with(SHORT, {f"emulator.{name}": value for name, value in own.items()})
    other = emulated(rig)
    assert (other.sampling.period, other.sampling.delay) == (0.002, 0.0003)
    assert (other.noise.position, other.noise.input) == (4e-6, rig.noise.input)
    assert other.model_copy(update={"sampling": rig.sampling, "noise": rig.noise}) == rig


def test_what_the_emulator_does_not_say_is_as_in_the_rest_of_the_file() -> None:
    for data in (SHORT, OFFSET):
        rig = rig_with(data, {"sampling.delay": 0.0001, "operating_point.voltage": 2.1})
        assert emulated(rig) == rig
    rig = rig_with(SHORT, {"emulator.delay": 0.0, "sampling.delay": 0.0004})
    assert emulated(rig).sampling.delay == 0.0, "zero is said"


def test_an_emulated_delay_of_too_many_periods_is_refused() -> None:
    with pytest.raises(InputError, match=r"emulator.delay = 0.2: must be at most 50 of its"):
        rig_with(SHORT, {"emulator.delay": 0.2})
    # fifty of the emulated rig's own periods
    assert emulated(rig_with(SHORT, {"emulator.delay": 0.2, "emulator.period": 0.004}))


def test_the_paper_s_rig_brings_an_emulation() -> None:
    rig = load_rig("belmonte2021")
    other = emulated(rig)
    assert rig.emulator.time_constant > 0
    assert (other.sampling.period, rig.sampling.period) == (0.002, 0.001)


# --- the coil ------------------------------------------------------------------------------


def coil_loop(rig: Rig, design: Design) -> tuple[Array, Array, Array]:
    """Return the coil's voltage at the instants, the applied voltages, and the first held one."""
    loop, scenario = loop_for(rig, design, emulate=True), scenario_of(rig)
    start = start_state(loop, design, scenario)
    numbers = parameter_vector(loop, design, scenario)
    states, voltages, _ = stepping.run(loop, start, numbers, np.zeros((2, len(loop.times) - 1)))
    row = loop.state_names.index(COIL)
    coil = np.concatenate([[start[row]], states.full()[row]])
    return coil, voltages.full()[1], start[[n.startswith("held") for n in loop.state_names]]


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0, 1.7])
def test_the_coil_s_current_lags_by_its_time_constant(share: float) -> None:
    period = 1e-3
    rig = rig_with(SHORT, {**COIL_1_MS, "sampling.delay": share * period})
    coil, applied, held = coil_loop(rig, design_of(rig))
    when = timing(period, rig.sampling.delay)
    acting = np.concatenate([held, applied])  # the voltage of sample k is acting[k + held]
    expected = [coil[0]]
    for k in range(len(applied)):
        late = acting[k + when.held - when.whole]
        early = acting[k + when.held - when.whole - 1] if when.part else late
        now = early + (expected[-1] - early) * math.exp(-when.part / 1e-3)
        expected.append(late + (now - late) * math.exp(-(period - when.part) / 1e-3))
    assert coil == pytest.approx(expected, abs=RUNGE_KUTTA * np.ptp(applied))
    assert np.ptp(coil) > 0.1


@pytest.mark.parametrize("name", ["tan-gpi", "fee-gpi", "state-feedback", "lin-pid"])
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_the_ball_on_a_coil_is_the_one_integrated_by_another_program(
    name: str, share: float
) -> None:
    period, tau = 1e-3, 1e-3
    rig = rig_with(SHORT, {**COIL_1_MS, "sampling.delay": share * period})
    design = design_of(rig, name, 40.0)
    response, beta = run(rig, design), plant_beta(rig) / 1.05
    step = step_program(design.method, design.controller)
    run_step = step.scalar()
    low, high = rig.limits.voltage
    known = {"Y": design.Y, "U": design.believed.U, "u_min": low, "u_max": high}
    known |= dict(design.coefficients)
    constants = [known[n] for n in step.inputs if n in known]
    read = [s.name for s in signals(law(design.controller))]
    names = ("y_ref", "v_ref", "acc_ref")
    samples = reference_path(rig, response.times)
    own = [0.0] * (1 if name == "state-feedback" else 2)
    loop = loop_for(rig, design, emulate=True)
    first = start_state(loop, design, scenario_of(rig))[loop.state_names.index(COIL)]
    x, before = np.array([rig.initial.gap, rig.initial.velocity, first]), float(first)

    def moved(start: Array, length: float, u: float) -> Array:
        def rates(t: float, z: Array) -> list[float]:
            return [z[1], rig.plant.gravity - beta * (z[2] / z[0]) ** 2, (u - z[2]) / tau]

        if not length:
            return start
        return np.asarray(
            solve_ivp(rates, (0, length), start, method="DOP853", rtol=1e-10, atol=1e-14).y[:, -1]
        )

    gaps = [x[0]]
    for k in range(150):
        sample = dict(zip(names, samples[:, k], strict=True)) | {"y": x[0], "v": x[1]}
        *own, _, applied = run_step(*own, *[sample[n] for n in read], *constants)
        x = moved(moved(x, share * period, before), (1 - share) * period, applied)
        before = applied
        gaps.append(x[0])
    assert response.gap[:151] == pytest.approx(gaps, abs=1e-6 * np.ptp(gaps))


@pytest.mark.parametrize(
    ("name", "continuous"),
    [("tan-gpi", False), ("fee-gpi", False), ("state-feedback", False), ("tan-gpi", True)],
)
def test_a_faster_coil_comes_nearer_to_none(name: str, continuous: bool) -> None:
    plain = rig_with(SHORT)
    design = design_of(plain, name, 40.0)
    gap = run(plain, design, emulate=False, continuous=continuous).gap
    distances = []
    for inductance in (4e-3, 2e-3):
        changes = {"emulator.inductance": inductance, "emulator.resistance": 20.0}
        rig = rig_with(SHORT, changes)
        distances.append(np.abs(run(rig, design, continuous=continuous).gap - gap).max())
    assert np.log2(distances[0] / distances[1]) == pytest.approx(1.0, abs=0.25)
    assert distances[-1] < 0.1 * np.abs(gap - gap[-1]).max()


def test_a_ball_at_rest_on_a_coil_stays_there() -> None:
    hold = {"initial.gap": 0.0242, "reference.end_gap": 0.0242}
    rig = rig_with(SHORT, {**hold, **COIL_1_MS, "sampling.delay": 0.0003})
    response = simulate(
        loop_for(rig, design_of(rig), emulate=True),
        design_of(rig),
        nominal_scenario(rig, plant_beta(rig)),
    )
    assert response.gap == pytest.approx(0.0242, abs=1e-14)


def test_the_stated_stated_errors_the_error_of_an_emulation() -> None:
    rig = rig_with(SHORT, {**COIL_1_MS, "sampling.delay": 0.0003})
    design = design_of(rig, omega=40.0)
    response, stated = stated_errors(rig, design, scenario_of(rig), emulate=True)
    best = simulate(loop_for(rig, design, refine=8, emulate=True), design, scenario_of(rig))
    for figure in ("ise", "iae", "itae"):
        exact = getattr(best.metrics, figure)
        error = abs(getattr(response.metrics, figure) - exact) / exact
        assert error <= stated.relative[figure] < 1e-5


# --- steps of sensor and actuator ----------------------------------------------------------


@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
@pytest.mark.parametrize("name", LAWS)
def test_the_applied_voltages_are_multiples_of_the_actuator_s_step(
    name: str, continuous: bool
) -> None:
    step = 0.05
    rig = rig_with(SHORT, {"emulator.actuator_step": step})
    response = run(rig, design_of(rig, name), continuous=continuous)
    whole = response.applied / step
    assert whole == pytest.approx(np.round(whole), abs=1e-9)
    assert len(set(np.round(whole))) > 4
    clipped = np.clip(response.commanded, *rig.limits.voltage)
    assert np.abs(response.applied - clipped).max() <= step / 2 * (1 + 1e-9)
    assert (response.applied != clipped).any()


def test_a_step_of_the_actuator_takes_no_voltage_out_of_the_range() -> None:
    # 3.0 V is no multiple of 0.35 V: 9 steps would be 3.15 V
    changes = {"limits.voltage": [1.0, 3.0], "initial.gap": 0.026, "emulator.actuator_step": 0.35}
    response = run(rig_with(SHORT, changes), design_of(rig_with(SHORT, changes)))
    assert response.metrics.peak_voltage > 3.0
    assert response.applied.min() >= 1.0
    assert response.applied.max() <= 3.0


@pytest.mark.parametrize("name", LAWS)
def test_the_measured_gap_is_rounded_to_the_sensor_s_step(name: str) -> None:
    # the first command is that of a ball at the nearest step; the ball itself is where it is
    step, true, nearest = 1e-4, 0.02443, 0.0244
    rig = rig_with(SHORT, {"emulator.sensor_step": step, "initial.gap": true})
    other = rig_with(SHORT, {"initial.gap": nearest})
    design = design_of(rig, name)
    coarse, fine, seen = run(rig, design), run(rig, design, emulate=False), run(other, design)
    assert coarse.gap[0] == fine.gap[0] == true
    assert coarse.commanded[0] == pytest.approx(seen.commanded[0], rel=1e-9)
    assert abs(coarse.commanded[0] - fine.commanded[0]) > 1e-3


def test_noise_is_added_before_the_sensor_rounds() -> None:
    step = 1e-4
    changes = {"noise.position": 3e-5, "noise.input": 0.0, "emulator.sensor_step": step}
    rig = rig_with(SHORT, {**changes, "initial.gap": 0.02424})
    design = design_of(rig)
    quiet = float(run(rig, design).commanded[0])
    per_step = design.coefficients["d"] * step
    moves = {
        round((float(run(rig, design, noise=True, seed=n).commanded[0]) - quiet) / per_step, 6)
        for n in range(12)
    }
    assert moves <= {-1.0, 0.0, 1.0, 2.0}, "whole steps only"
    assert len(moves) > 1
