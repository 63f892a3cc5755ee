"""One period of the closed loop as a CasADi function, folded over the horizon.

The nonlinear plant is integrated by Runge-Kutta 4 between the instants at which the voltage
changes; the controller is the lowered difference equation (sampled) or the lowered state
equation (continuous). On request the sensitivities to the poles are integrated along as further
states, or the effects of the rig emulator are added: a coil with inductance, a sensor and an
actuator with steps. ISE, IAE and ITAE are quadratures over the track that the fold returns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from sympy import Symbol

from maglev_design import design as designs
from maglev_design.choices import TAN_GPI, Controller, Method
from maglev_design.lowering import Program, lower
from maglev_design.parameters import Emulator, Rig
from maglev_design.symbolic import laws, metrics, running, stability
from maglev_design.symbolic import plant as p

Array = NDArray[np.float64]

STEP_PER_TIME_CONSTANT = 0.1
"""Integration step as a fraction of the fastest time constant: RK4's error a step is below 1e-7."""
CONTACT = 1e-3
"""Share of Y at which a ball counts as touching the magnet when the rig gives no lower limit."""

SIXTH = 1 / 6  # a product is faster than a division

PLANT_NAMES = ("beta", "g", "y0", "gap_low", "gap_high")
METRICS = ("ise", "iae", "itae")
COIL = "u_coil"
"""Row of the emulated coil: its current over C [V]."""


@dataclass(frozen=True, eq=False)
class LoopGraph:
    """A closed loop ready to run, for one rig, one method and one grid.

    Two are equal only when they are one.

    Attributes
    ----------
    rig : Rig
    method : str or None
        None for the continuous controller.
    state_names, parameter_names : tuple of str
        Rows of the folded state and of the parameter vector.
    times : array, shape (N + 1,)
        Sampling instants and the horizon [s].
    inputs : casadi.DM, shape (n_inputs, N)
        Per period: durations of the integration steps, reference at the nodes.
    fold : casadi.Function
        (state, parameters, inputs, noise) -> (states, voltages, track) over the horizon; the
        track holds gap and velocity after every integration step.
    quadrature : casadi.Function
        (track of the gap, of the velocity, their values at t = 0) -> (increments of ISE, IAE and
        ITAE of every integration step), and with tangents of the tracks: tangents of the sums.
    ends : array
        The end of every integration step [s].
    directions : int
        How many sensitivities are carried along.
    controller : Controller
    emulator : Emulator or None
        Effects that act besides the plant.
    step : casadi.Function
        One period, tangents included; what `fold` repeats.
    pieces, nodes_a_piece : int
        Integration steps a period, and reference nodes an integration step.
    tables : tuple of array
        For every period its inputs, shape (N, n_inputs), and for every integration step its
        start [s] and its part of the run (0 before the move, 1 the move, 2 after it).
    start : tuple of float
        y*, y*' and y*'' at t = 0 [SI].
    """

    rig: Rig
    method: Method | None
    state_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    times: Array
    inputs: ca.DM
    fold: ca.Function
    quadrature: ca.Function
    ends: Array
    directions: int
    controller: Controller
    emulator: Emulator | None
    step: ca.Function
    pieces: int
    nodes_a_piece: int
    tables: tuple[Array, Array, NDArray[np.uint8]]
    start: tuple[float, float, float]


@cache
def acceleration_program() -> Program:
    """Return the program (g, beta, gap + y0 as y, u) -> acceleration of the plant (4)."""
    plant = p.magnetic_levitation()
    return lower((p.g, p.beta, p.y0, p.y, p.u), {"acc": plant.acceleration})


@cache
def metrics_program(crossing: bool = True) -> Program:
    """Return the program of one step's increments of ISE, IAE and ITAE.

    Without `crossing` for steps at whose ends the error has one sign.
    """
    steps = metrics.increments(crossing=crossing)
    inputs = (
        metrics.e_start,
        metrics.e_end,
        metrics.slope_start,
        metrics.slope_end,
        metrics.t_start,
        metrics.h,
    )
    outputs = {"ise": steps.ise, "iae": steps.iae, "itae": steps.itae}
    return lower(inputs, outputs, steps.definitions)


@cache
def coil_program() -> Program:
    """Return the program (u_coil, u, L, R) -> rate of u_coil, the coil current over C."""
    return lower((p.u_coil, p.u, p.L, p.R), {"rate": p.magnetic_levitation().coil_rate})


@cache
def step_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the sampled law's step: states, signals, Y, U, limits, coefficients -> next states.

    The signals are y, y*, y*'' (and y', y*' where the law reads them). Outputs: the next states,
    the commanded and the applied voltage. This program, printed, is the exported controller.
    """
    equation = designs.equation(method, controller)
    states = equation.law.states
    inputs = [*states, *equation.signals, *_FIXED, *equation.coefficients]
    outputs = {
        f"{state.name}_next": x for state, x in zip(states, equation.next_states, strict=True)
    }
    outputs |= {"commanded": running.commanded, "applied": equation.applied}
    return lower(inputs, outputs, {running.commanded: equation.commanded})


@cache
def feedforward_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the program y*, y*'', Y, U, limits, coefficients -> clamped voltage at w = 0."""
    equation = designs.equation(method, controller)
    inputs = [p.y_ref, p.acc_ref, *_FIXED, *equation.coefficients]
    return lower(inputs, {"applied": running.clamp(equation.feedforward)})


@cache
def start_program(controller: Controller = TAN_GPI) -> Program:
    """Return the program signals, Y, gains -> the law's states before the first sample."""
    law = designs.law(controller)
    inputs = [*running.signals(law), p.Y, *law.gains]
    return lower(inputs, {x.name: s for x, s in zip(law.states, law.start, strict=True)})


@cache
def bumpless_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the program signals, u, Y, U, limits, coefficients -> states that command u."""
    equation = designs.equation(method, controller)
    inputs = [*equation.signals, p.u, *_FIXED, *equation.coefficients]
    start = running.bumpless_start(equation)
    return lower(inputs, {x.name: s for x, s in zip(equation.law.states, start, strict=True)})


@cache
def continuous_program(controller: Controller = TAN_GPI) -> Program:
    """Return the continuous law: states, signals, Y, U, limits, believed, gains -> rates."""
    law = designs.law(controller)
    rates, command = running.continuous_equation(law)
    own = [x for x in (p.beta_c, p.g, p.y0) if x in (command.free_symbols | rates[0].free_symbols)]
    inputs: list[Symbol] = [
        *law.states,
        *running.signals(law),
        *_FIXED,
        p.C_U_hat,
        p.C_Y_hat,
        *own,
        *law.gains,
    ]
    outputs = {
        f"{state.name}_rate": stability.believed(rate)
        for state, rate in zip(law.states, rates, strict=True)
    }
    outputs["commanded"] = running.commanded
    return lower(inputs, outputs, {running.commanded: stability.believed(command)})


_FIXED = (p.Y, p.U, laws.u_min, laws.u_max)


def controller_names(method: Method | None, controller: Controller = TAN_GPI) -> tuple[str, ...]:
    """Return the controller's part of the parameter vector, in order."""
    law = designs.law(controller)
    program = continuous_program(controller) if method is None else step_program(method, controller)
    moving = {x.name for x in (*law.states, *running.signals(law))}
    return tuple(name for name in program.inputs if name not in moving)


def contact_gap(rig: Rig) -> float:
    """Return the gap at which the ball counts as touching the magnet [m]."""
    return max(rig.limits.gap[0], CONTACT * rig.operating_point.gap)


def build(
    rig: Rig,
    method: Method | None,
    *,
    controller: Controller = TAN_GPI,
    directions: int = 0,
    refine: int = 1,
    fastest: float = 0.0,
    emulate: bool = False,
) -> LoopGraph:
    """Return the folded closed loop of `rig`.

    Parameters
    ----------
    rig : Rig
    method : str or None
        Discretisation of the controller, or None for a continuous one (no delay then).
    controller : Controller
    directions : int
        Sensitivities carried along, each a column of the tangent of the parameters.
    refine : int
        Integration steps per default step; 2 halves them.
    fastest : float
        [1/s] Fastest rate of the continuous controller; the plant's own is always respected.
    emulate : bool
        Whether the coil and the steps of ``[emulator]`` act.
    """
    period = rig.sampling.period
    when = designs.timing(period, rig.sampling.delay) if method else designs.Timing(0, 0.0, 0)
    smallest = float(designs.path_gaps(rig, 2)[0])
    unstable = designs.true_equilibrium(rig, designs.plant_beta(rig), smallest).C_Y
    emulator = rig.emulator if emulate else None
    coil = emulator.time_constant if emulator else 0.0
    rate = max(math.sqrt(2 * unstable), fastest, 1 / coil if coil else 0.0)

    def substeps(duration: float) -> int:
        return refine * math.ceil(duration * rate / STEP_PER_TIME_CONSTANT) if duration else 0

    pieces = (substeps(when.part), substeps(period - when.part))
    times = _instants(rig.reference.horizon, period)
    durations = _durations(np.diff(times), when.part, pieces)
    halves = method is None
    nodes = _nodes(times[:-1], durations, halves)
    reference = designs.reference_path(rig, nodes.ravel()).reshape(3, *nodes.shape)
    stacked = np.concatenate([durations, reference.transpose(0, 2, 1).reshape(-1, len(times) - 1)])
    step, states, parameters = _step(method, controller, when, pieces, emulator)
    if directions:
        step = _with_tangents(step, directions)
    fold = _fold(step, len(times) - 1)
    ends = (times[:-1] + np.cumsum(durations, axis=0)).ravel(order="F")
    quadrature = _quadrature(rig, ends, durations.ravel(order="F"), directions)
    return LoopGraph(
        rig,
        method,
        states,
        parameters,
        times,
        ca.DM(stacked),
        fold,
        quadrature,
        ends,
        directions,
        controller,
        emulator,
        step,
        sum(pieces),
        2 if halves else 1,
        _tables(rig, stacked, ends, durations.ravel(order="F")),
        tuple(reference[:, 0, 0].tolist()),
    )


def _tables(
    rig: Rig, stacked: Array, ends: Array, lengths: Array
) -> tuple[Array, Array, NDArray[np.uint8]]:
    """Return inputs, starts and parts of the run as :class:`LoopGraph` describes them."""
    path = rig.reference
    parts = (ends > path.start_time).astype(np.uint8) + (ends > path.end_time).astype(np.uint8)
    return np.ascontiguousarray(stacked.T), ends - lengths, parts


def _fold(step: ca.Function, count: int) -> ca.Function:
    """Return the step folded `count` times, one column of parameters serving all of them."""
    state, parameters = (ca.MX.sym(name, step.size1_in(name)) for name in step.name_in()[:2])
    inputs, noise = (ca.MX.sym(name, step.size1_in(name), count) for name in step.name_in()[2:])
    repeated = ca.repmat(parameters, 1, count)
    outputs = step.mapaccum("fold", count)(state, repeated, inputs, noise)
    return ca.Function("fold", [state, parameters, inputs, noise], list(outputs))


def _quadrature(rig: Rig, ends: Array, lengths: Array, directions: int) -> ca.Function:
    """Return the metrics of a track as one function of whole vectors."""
    size = len(ends)
    starts = np.concatenate([[0.0], ends[:-1]])
    instants = np.concatenate([[0.0], ends])
    reference, slope, _ = designs.reference_path(rig, instants)
    gap, velocity = ca.MX.sym("gap", size), ca.MX.sym("velocity", size)
    first, speed = ca.MX.sym("first"), ca.MX.sym("speed")
    error = ca.vertcat(first, gap) - reference
    change = ca.vertcat(speed, velocity) - slope
    increments = metrics_program().casadi(
        error[:-1], error[1:], change[:-1], change[1:], ca.MX(starts), ca.MX(lengths)
    )
    inputs, outputs = [gap, velocity, first, speed], [ca.horzcat(*increments)]
    if directions:
        seeds = [ca.MX.sym("gap_tangent", size, directions)]
        seeds.append(ca.MX.sym("velocity_tangent", size, directions))
        sums = ca.vertcat(*[ca.sum1(x) for x in increments])
        outputs.append(ca.jtimes(sums, ca.vertcat(gap, velocity), ca.vertcat(*seeds)))
        inputs += seeds
    return ca.Function("quadrature", inputs, outputs)


def _instants(horizon: float, period: float) -> Array:
    """Return 0, T, 2 T, ... and the horizon; each instant is k T rounded once."""
    count = math.ceil(Fraction(repr(horizon)) / Fraction(repr(period)))
    times: Array = np.arange(count + 1, dtype=float) * period
    times[-1] = horizon
    return times


def _durations(lengths: Array, part: float, pieces: tuple[int, int]) -> Array:
    """Return the substeps' durations, shape (sum(pieces), N); a short last period is shared."""
    early = np.minimum(part, lengths)
    late = lengths - early
    rows = [
        length / count
        for length, count in zip((early, late), pieces, strict=True)
        for _ in range(count)
    ]
    return np.asarray(np.stack(rows), dtype=float)


def _nodes(starts: Array, durations: Array, halves: bool) -> Array:
    """Return the instants at which the reference is needed, shape (N, n_nodes)."""
    ends = starts + np.cumsum(durations, axis=0)
    rows = [starts]
    for end, duration in zip(ends, durations, strict=True):
        rows += [end - duration / 2, end] if halves else [end]
    return np.stack(rows, axis=1)


def _step(
    method: Method | None,
    controller: Controller,
    when: designs.Timing,
    pieces: tuple[int, int],
    emulator: Emulator | None,
) -> tuple[ca.Function, tuple[str, ...], tuple[str, ...]]:
    """Return one period (state, parameters, inputs, noise) -> (state, voltages)."""
    own = tuple(state.name for state in designs.law(controller).states)
    held = tuple(f"held_{n}" for n in range(when.held))
    coil = (COIL,) if emulator is not None and emulator.time_constant else ()
    states = ("y", "v", *own, *coil, *held, "alive")
    parameters = tuple(dict.fromkeys((*controller_names(method, controller), *PLANT_NAMES)))
    x = {name: ca.SX.sym(name) for name in states}
    q = {name: ca.SX.sym(name) for name in parameters}
    total = sum(pieces)
    per_step = 2 if method is None else 1
    h = ca.SX.sym("h", total)
    reference = ca.SX.sym("reference", 3 * (per_step * total + 1))
    noise = ca.SX.sym("noise", 2)
    rows = ca.reshape(reference, -1, 3)
    stepper = _Stepper(q, h, rows, noise, controller, own, emulator)
    state_in = ca.vertcat(*x.values())
    track: list[Any] = []
    if method is None:
        *_, commanded = stepper.law(x, 0)
        applied = stepper.drive(commanded)
        for n in range(total):
            x = stepper.continuous(x, n)
            track.append((x["y"], x["v"]))
    else:
        program = step_program(method, controller)
        *moved, commanded, applied = stepper.read(program, x, 0)
        applied = stepper.quantised(applied)
        pipeline = [applied, *[x[name] for name in held]]
        for n in range(total):
            voltage = pipeline[when.whole + 1 if n < pieces[0] else when.whole]
            x = stepper.sampled(x, voltage + noise[0], n)
            track.append((x["y"], x["v"]))
        x |= dict(zip(own, moved, strict=True)) | dict(zip(held, pipeline, strict=False))
    function = ca.Function(
        "step",
        [state_in, ca.vertcat(*q.values()), ca.vertcat(h, reference), noise],
        [
            ca.vertcat(*[x[name] for name in states]),
            ca.vertcat(commanded, applied),
            ca.vertcat(*[gap for gap, _ in track], *[speed for _, speed in track]),
        ],
        ["state", "parameters", "inputs", "noise"],
        ["state_next", "voltages", "track"],
    )
    return function, states, parameters


@dataclass(frozen=True)
class _Stepper:
    """One integration step of the plant, with or without the controller inside."""

    q: dict[str, Any]
    h: Any
    rows: Any
    noise: Any
    controller: Controller
    own: tuple[str, ...]
    emulator: Emulator | None

    def read(self, program: Program, x: dict[str, Any], node: int) -> list[Any]:
        """Run a law's program on what it measures and on the reference at a node."""
        row = self.rows[node, :]
        measured = x["y"] + self.noise[1]
        if self.emulator is not None:
            measured = rounded(measured, self.emulator.sensor_step)
        signals = {"y": measured, "y_ref": row[0], "v_ref": row[1], "acc_ref": row[2]}
        values = {**self.q, **x, **signals}
        return program.casadi(*[values[name] for name in program.inputs])

    def law(self, x: dict[str, Any], node: int) -> list[Any]:
        """Return the rates of the continuous law's states and the commanded voltage."""
        return self.read(continuous_program(self.controller), x, node)

    def drive(self, commanded: Any) -> Any:
        """Return what the actuator makes of a commanded voltage."""
        return self.quantised(self._clamped(commanded))

    def quantised(self, voltage: Any) -> Any:
        """Return the step of the actuator nearest to `voltage`, and never one out of its range."""
        if self.emulator is None:
            return voltage
        return self._clamped(rounded(voltage, self.emulator.actuator_step))

    def _clamped(self, voltage: Any) -> Any:
        return ca.fmin(ca.fmax(voltage, self.q["u_min"]), self.q["u_max"])

    def rates(self, motion: dict[str, Any], voltage: Any) -> list[Any]:
        """Return y', y'' and, with a coil, the rate of its current, under an input voltage.

        The gap is kept off the magnet, so that a crash never divides by zero.
        """
        q, gap = self.q, ca.fmax(motion["y"], self.q["gap_low"] / 2)
        acting = motion.get(COIL, voltage)
        (pull,) = acceleration_program().casadi(q["g"], q["beta"], q["y0"], gap, acting)
        if COIL not in motion or self.emulator is None:
            return [motion["v"], pull]
        size = (self.emulator.inductance, self.emulator.resistance)
        return [motion["v"], pull, *coil_program().casadi(acting, voltage, *map(ca.SX, size))]

    def _moving(self, x: dict[str, Any]) -> list[str]:
        return ["y", "v", *([COIL] if COIL in x else [])]

    def sampled(self, x: dict[str, Any], voltage: Any, n: int) -> dict[str, Any]:
        names = self._moving(x)

        def rates(z: Any, _stage: int) -> Any:
            return ca.vertcat(*self.rates(_named(names, z), voltage))

        return self._advance(rates, names, x, n)

    def continuous(self, x: dict[str, Any], n: int) -> dict[str, Any]:
        plant = self._moving(x)
        names = [*plant, *self.own]

        def rates(z: Any, stage: int) -> Any:
            now = _named(names, z)
            *moved, commanded = self.law(now, 2 * n + stage)
            motion = {name: now[name] for name in plant}
            pushed = self.rates(motion, self.drive(commanded) + self.noise[0])
            return ca.vertcat(*pushed, *moved)

        return self._advance(rates, names, x, n)

    def _advance(self, rates: Any, names: list[str], x: dict[str, Any], n: int) -> dict[str, Any]:
        z = _runge_kutta(rates, ca.vertcat(*[x[name] for name in names]), self.h[n])
        return self._finish(x, _named(names, z))

    def _finish(self, x: dict[str, Any], moved: dict[str, Any]) -> dict[str, Any]:
        """Stop a ball that has hit the magnet or dropped."""
        low, high = self.q["gap_low"], self.q["gap_high"]
        alive = x["alive"] * (moved["y"] > low) * (moved["y"] < high)
        y = ca.if_else(x["alive"], ca.fmin(ca.fmax(moved["y"], low), high), x["y"])
        kept = {name: ca.if_else(alive, value, x[name]) for name, value in moved.items()}
        return {**x, **kept, "y": y, "v": ca.if_else(alive, moved["v"], 0), "alive": alive}


def _named(names: Sequence[str], z: Any) -> dict[str, Any]:
    return {name: z[k] for k, name in enumerate(names)}


def rounded(value: Any, step: float) -> Any:
    """Return `value` at the nearest multiple of `step`; as it is when the step is 0."""
    return step * ca.floor(value / step + 0.5) if step else value


def _runge_kutta(rates: Any, z: Any, h: Any) -> Any:
    """Return one classical Runge-Kutta step; stage 0, 1, 2 is the start, middle and end."""
    a = rates(z, 0)
    half = h * 0.5
    b = rates(z + half * a, 1)
    c = rates(z + half * b, 1)
    d = rates(z + h * c, 2)
    return z + h * SIXTH * (a + 2 * (b + c) + d)


def _with_tangents(step: ca.Function, directions: int) -> ca.Function:
    """Return the step that carries its forward sensitivities along, `directions` columns.

    With s' = F(s, q): S' = dF/ds S + dF/dq Q, Q the tangent of the parameters.
    """
    shapes = [step.size1_in(n) for n in range(4)]
    s, q, inputs, noise = (ca.SX.sym(name, size) for name, size in zip("sqin", shapes, strict=True))
    tangent, seed = ca.SX.sym("S", shapes[0], directions), ca.SX.sym("Q", shapes[1], directions)
    outputs = step(s, q, inputs, noise)
    seeds = ca.vertcat(tangent, seed)
    moved = [ca.vec(ca.jtimes(x, ca.vertcat(s, q), seeds)) for x in outputs]
    return ca.Function(
        "step",
        [
            ca.vertcat(s, ca.vec(tangent)),
            ca.vertcat(q, ca.vec(seed)),
            inputs,
            noise,
        ],
        [ca.vertcat(x, dx) for x, dx in zip(outputs, moved, strict=True)],
        step.name_in(),
        step.name_out(),
    )
