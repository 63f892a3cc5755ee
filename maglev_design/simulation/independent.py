"""The closed loop once more with SciPy, as a check on the first integrator.

Only the lowered plant, the lowered law of the controller and the reference are shared: the
integrator (DOP853, adaptive), the handling of the delay and the quadratures of the metrics are
not. The right side is restarted wherever the voltage jumps.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller import design as designs
from maglev_design.controller.plant import (
    plant_numbers,
)
from maglev_design.controller.timing import timing
from maglev_design.options import Controller
from maglev_design.programs import (
    acceleration_program,
    continuous_program,
    drive_program,
    reference_program,
    start_program,
    step_program,
)
from maglev_design.rig import Rig
from maglev_design.simulation.grid import (
    COIL,
    LoopGraph,
    contact_gap,
    floor_gap,
    reference_names,
    reference_rows,
    signal_names,
)
from maglev_design.simulation.scenario import (
    Scenario,
    at_rest,
    held_voltage,
    noise_samples,
    parameter_vector,
)

Array = NDArray[np.float64]
SampledController = Callable[[Mapping[str, float]], tuple[float, float]]
"""From a sample (y, v, y_ref, v_ref, acc_ref) to the commanded and the applied voltage."""
Drive = Callable[[Any, Sequence[float], Any], tuple[float, Sequence[float]]]
"""From state, reference and what is held to the input voltage and the rates of the law's states."""

RELATIVE_TOLERANCE = 1e-9
ABSOLUTE_TOLERANCE = 1e-13
"""One for all states: for y in metres a ten-thousandth of a nanometre."""
SCALES = (1e6, 1e2, 1e2)
"""ISE, IAE and ITAE are integrated times these, so that the tolerance is small for them, too."""
INTEGRATOR = "SciPy DOP853, restarted at every jump of the voltage"


@dataclass(frozen=True)
class IndependentMetrics:
    """Metrics of the independent run [SI]; ``crashed`` when the ball left the allowed gaps."""

    ise: float
    iae: float
    itae: float
    peak_voltage: float
    crashed: bool


def resimulate(
    rig: Rig,
    design: designs.Design,
    scenario: Scenario,
    controller: SampledController | None = None,
) -> IndependentMetrics:
    """Return the metrics of one sampled closed loop, integrated independently.

    Parameters
    ----------
    rig : Rig
    design : Design
    scenario : Scenario
    controller : callable, optional
        Runs instead of the design's own step, which then gives only the voltage that acts before
        the first sample.
    """
    when = timing(rig.sampling.period, rig.sampling.delay)
    period, horizon = rig.sampling.period, rig.reference.horizon
    count = math.ceil(round(horizon / period, 9))
    times: Array = np.arange(count, dtype=float) * period
    samples = reference_rows(rig, times, design.controller)
    names = reference_names(design.controller)
    noise = noise_samples(rig, scenario, count)
    integrator = _integrator(
        rig, scenario, design.controller, lambda _x, _reference, voltage: (voltage, ())
    )
    state = [scenario.initial_gap, scenario.initial_velocity, 0.0, 0.0, 0.0]
    memory, first, current = _start(rig, design, scenario, float(noise[1, 0]))
    state += current
    pending = deque([first] * when.held)
    run_step = controller or own_step(rig, design, memory)
    peak, inside = -math.inf, (contact_gap(rig), rig.limits.gap[1])
    for k in range(count):
        start, end = times[k], min(times[k] + period, horizon)
        sample = dict(zip(names, samples[:, k], strict=True))
        sample |= {"y": state[0] + noise[1, k], "v": state[1]}
        commanded, applied = run_step(sample)
        peak = max(peak, commanded)
        pending.append(applied)
        change = min(start + when.part, end)
        if when.part > 0:
            state = _advance(integrator, state, start, change, pending.popleft() + noise[0, k])
            voltage = pending[0]
        else:
            voltage = pending.popleft()
        state = _advance(integrator, state, change, end, voltage + noise[0, k])
        if not inside[0] < state[0] < inside[1]:
            return IndependentMetrics(math.inf, math.inf, math.inf, float(peak), True)
    return _check(state, peak)


def resimulate_continuous(
    loop: LoopGraph, design: designs.Design, scenario: Scenario
) -> IndependentMetrics:
    """Return the metrics of a loop with the continuous law, integrated independently.

    The step adapts to the kinks of clamp and anti-windup. The peak is that of the sampling
    instants, at which the noise changes.
    """
    rig, times = loop.rig, loop.times.tolist()
    noise = noise_samples(rig, scenario, len(times) - 1)
    law = continuous_program(design.controller)
    run_law = law.scalar()
    numbers = parameter_vector(loop, design, scenario).tolist()
    fixed = dict(zip(loop.parameter_names, numbers, strict=True))
    low, high = fixed["u_min"], fixed["u_max"]
    own, names = start_program(design.controller).outputs, reference_names(design.controller)
    behind = 5 + (rig.kind.order - 2)  # the law's states stand behind the plant's

    def command(x: Any, reference: Sequence[float], noisy: float) -> tuple[Sequence[float], float]:
        known = fixed | dict(zip(names, reference, strict=True))
        known |= {"y": x[0] + noisy, "v": x[1], **dict(zip(own, x[behind:], strict=True))}
        *moved, commanded = run_law(*[known[name] for name in law.inputs])
        return moved, commanded

    def drive(x: Any, reference: Sequence[float], held: Any) -> tuple[float, Sequence[float]]:
        moved, commanded = command(x, reference, held[1])
        return min(max(commanded, low), high) + held[0], moved

    integrator = _integrator(rig, scenario, design.controller, drive)
    memory, _, current = _start(rig, design, scenario, float(noise[1, 0]))
    state: Any = [scenario.initial_gap, scenario.initial_velocity, 0.0, 0.0, 0.0]
    state += [*current, *memory]
    samples = reference_rows(rig, loop.times, design.controller)
    peak = -math.inf
    for k, (start, end) in enumerate(pairwise(times)):
        peak = max(peak, command(state, samples[:, k].tolist(), float(noise[1, k]))[1])
        state = _advance(integrator, state, start, end, noise[:, k].tolist())
        if not fixed["gap_low"] < state[0] < fixed["gap_high"]:
            return IndependentMetrics(math.inf, math.inf, math.inf, float(peak), True)
    return _check(state, peak)


def _check(state: Any, peak: float) -> IndependentMetrics:
    """Return the metrics that were integrated with the state."""
    ise, iae, itae = (float(x) / scale for x, scale in zip(state[2:5], SCALES, strict=True))
    return IndependentMetrics(ise, iae, itae, float(peak), False)


def own_step(rig: Rig, design: designs.Design, start: Sequence[float]) -> SampledController:
    """Return the design's lowered step with its memory inside, from the states `start`."""
    step = step_program(design.method, design.controller)
    run_step = step.scalar()
    low, high = rig.limits.voltage
    fixed = {"Y": design.Y, "U": design.believed.U, "u_min": low, "u_max": high}
    fixed |= dict(design.coefficients)
    constants = [fixed[n] for n in step.inputs if n in fixed]
    signals = signal_names(design.controller)
    memory = list(start)

    def run(sample: Mapping[str, float]) -> tuple[float, float]:
        values = run_step(*memory, *[sample[s] for s in signals], *constants)
        memory[:] = values[:-2]
        return values[-2], values[-1]

    return run


def _start(
    rig: Rig, design: designs.Design, scenario: Scenario, first_noise: float
) -> tuple[list[float], float, list[float]]:
    """Return the controller's states before the first sample, the voltage until it, the current.

    The current, over C [V], where the plant has it as a state.
    """
    rows = reference_rows(rig, np.zeros(1), design.controller)[:, 0]
    known = dict(zip(reference_names(design.controller), rows.tolist(), strict=True))
    known["Y"] = design.Y
    held, current = held_voltage(rig, design, known), []
    if rig.kind.order > 2:
        held, through = at_rest(rig, scenario)
        current = [through]
    known |= {"y": scenario.initial_gap + first_noise, "v": scenario.initial_velocity}
    program = start_program(design.controller)
    numbers = known | design.named_gains
    return list(program.scalar()(*[numbers[name] for name in program.inputs])), held, current


def _integrator(rig: Rig, scenario: Scenario, controller: Controller, drive: Drive) -> Any:
    from scipy.integrate import ode  # noqa: PLC0415 - heavy, and only this check needs it

    plant, kind = rig.plant, rig.kind
    known = plant_numbers(rig) | dict(scenario.numbers) | {"beta": scenario.beta_plant}
    known["g"] = plant.gravity if scenario.gravity is None else scenario.gravity
    known["y0"] = plant.gap_offset if scenario.gap_offset is None else scenario.gap_offset
    acceleration, current = acceleration_program(kind), None
    of_pull = _filled(acceleration.inputs, known)
    pull_of = acceleration.scalar()
    if kind.order > 2:
        current = drive_program(kind)
        of_current, rate_of = _filled(current.inputs, known), current.scalar()
    path, floor = rig.reference, floor_gap(rig)  # a ball that has crashed meets no pole
    reference = reference_program(len(reference_names(controller)) - 1).scalar()
    ends = (path.start_gap, path.end_gap, path.start_time, path.end_time)

    def rates(t: float, x: Any, held: Any) -> list[float]:
        wanted = reference(t, *ends)
        voltage, moved = drive(x, wanted, held)
        now = {"y": max(x[0], floor), "v": x[1], "u": voltage}
        behind = []
        if current is not None:
            behind = [*rate_of(*of_current(now | {COIL: x[5]}))]
            now["u"] = x[5]
        (pull,) = pull_of(*of_pull(now))
        error = abs(x[0] - wanted[0])
        ise, iae, itae = SCALES
        quadratures = [ise * error * error, iae * error, itae * t * error]
        return [x[1], pull, *quadratures, *behind, *moved]

    return ode(rates).set_integrator(
        "dop853", rtol=RELATIVE_TOLERANCE, atol=ABSOLUTE_TOLERANCE, nsteps=10_000
    )


def _filled(
    names: Sequence[str], known: Mapping[str, float]
) -> Callable[[Mapping[str, float]], list[float]]:
    """Return the function that puts what moves among the fixed numbers, in the order of `names`."""
    return lambda now: [now[name] if name in now else known[name] for name in names]


def _advance(integrator: Any, state: Any, start: float, end: float, held: Any) -> Any:
    """Return the state at `end` while what is held, voltage or noise, stays."""
    if end <= start:
        return state
    integrator.set_initial_value(state, start).set_f_params(held)
    return integrator.integrate(end)
