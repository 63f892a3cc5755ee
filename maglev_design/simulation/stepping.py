"""One period of the closed loop as a CasADi function, folded over the horizon.

The nonlinear plant is integrated by Runge-Kutta 4 between the instants at which the voltage
changes; the controller is the lowered difference equation (sampled) or the lowered state
equation (continuous). On request the sensitivities to the poles are integrated along as further
states, or the effects of the rig emulator are added: a coil with inductance, a sensor and an
actuator with steps. ISE, IAE and ITAE are quadratures over the track that the fold returns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from maglev_design.controller import design as designs
from maglev_design.lowering import Program
from maglev_design.programs import (
    acceleration_program,
    continuous_program,
    drive_program,
    metrics_program,
    start_program,
    step_program,
)
from maglev_design.rig import Emulator
from maglev_design.simulation.grid import COIL, LoopGraph, pole_names, rounded

SIXTH = 1 / 6  # a product is faster than a division


@lru_cache(maxsize=64)
def step_function(loop: LoopGraph) -> ca.Function:
    """Return one period, (state, parameters, inputs, noise) -> (state, voltages, track).

    The track holds gap and velocity after every integration step; sensitivities stand behind what
    they are of.
    """
    step = _plain_step(loop)
    if not loop.directions:
        return step
    poles = pole_names(loop.method, loop.controller)
    moved = [name in poles for name in loop.parameter_names]
    return _with_sensitivities(step, loop.directions, moved)


def _plain_step(loop: LoopGraph) -> ca.Function:
    method, controller, total = loop.method, loop.controller, loop.pieces
    own = start_program(controller).outputs
    held = [name for name in loop.state_names if name.startswith("held")]
    x = {name: ca.SX.sym(name) for name in loop.state_names}
    q = {name: ca.SX.sym(name) for name in loop.parameter_names}
    h = ca.SX.sym("h", total)
    signals = len(loop.reference_names)
    reference = ca.SX.sym("reference", signals * (loop.nodes_a_piece * total + 1))
    noise = ca.SX.sym("noise", 2)
    rows = ca.reshape(reference, -1, signals)
    stepper = _Stepper(q, h, rows, noise, loop, own)
    state_in = ca.vertcat(*x.values())
    track: list[Any] = []
    if method is None:
        *_, commanded = stepper.law(x, 0)
        applied = stepper.drive(commanded)
        for n in range(total):
            x = stepper.continuous(x, n)
            track.append((x["y"], x["v"]))
    else:
        *moved, commanded, applied = stepper.read(step_program(method, controller), x, 0)
        applied = stepper.quantised(applied)
        pipeline = [applied, *[x[name] for name in held]]
        for n in range(total):
            early = n < loop.substeps[0]
            voltage = pipeline[loop.timing.whole + 1 if early else loop.timing.whole]
            x = stepper.sampled(x, voltage + noise[0], n)
            track.append((x["y"], x["v"]))
        x |= dict(zip(own, moved, strict=True)) | dict(zip(held, pipeline, strict=False))
    return ca.Function(
        "step",
        [state_in, ca.vertcat(*q.values()), ca.vertcat(h, reference), noise],
        [
            ca.vertcat(*[x[name] for name in loop.state_names]),
            ca.vertcat(commanded, applied),
            ca.vertcat(*[gap for gap, _ in track], *[speed for _, speed in track]),
        ],
        ["state", "parameters", "inputs", "noise"],
        ["state_next", "voltages", "track"],
    )


@dataclass(frozen=True)
class _Stepper:
    """One integration step of the plant, with or without the controller inside."""

    q: dict[str, Any]
    h: Any
    rows: Any
    noise: Any
    loop: LoopGraph
    own: tuple[str, ...]

    @property
    def emulator(self) -> Emulator | None:
        """Effects that act besides the plant."""
        return self.loop.emulator

    def read(self, law: Program, x: dict[str, Any], node: int) -> list[Any]:
        """Run a law's program on what it measures and on the reference at a node."""
        row = self.rows[node, :]
        measured = x["y"] + self.noise[1]
        if self.emulator is not None:
            measured = rounded(measured, self.emulator.sensor_step)
        wanted = zip(self.loop.reference_names, ca.horzsplit(row), strict=True)
        values = {**self.q, **x, "y": measured, **dict(wanted)}
        return law.casadi(*[values[name] for name in law.inputs])

    def law(self, x: dict[str, Any], node: int) -> list[Any]:
        """Return the rates of the continuous law's states and the commanded voltage."""
        return self.read(continuous_program(self.loop.controller), x, node)

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
        """Return y', y'' and, behind a drive with a state, its rate, under an input voltage.

        The gap is kept off the magnet, so that a crash never divides by zero.
        """
        kind, gap = self.loop.kind, ca.fmax(motion["y"], self.q["floor"])
        values = {**self.q, "y": gap, "v": motion["v"], "u": motion.get(COIL, voltage)}
        pull = acceleration_program(kind)
        found = [motion["v"], *pull.casadi(*[values[name] for name in pull.inputs])]
        if COIL in motion:
            drive, given = drive_program(kind), {"u": voltage, COIL: motion[COIL]}
            found += drive.casadi(*[(values | given)[name] for name in drive.inputs])
        return found

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


def _runge_kutta(rates: Any, z: Any, h: Any) -> Any:
    """Return one classical Runge-Kutta step; stage 0, 1, 2 is the start, middle and end."""
    a = rates(z, 0)
    half = h * 0.5
    b = rates(z + half * a, 1)
    c = rates(z + half * b, 1)
    d = rates(z + h * c, 2)
    return z + h * SIXTH * (a + 2 * (b + c) + d)


def _with_sensitivities(step: ca.Function, directions: int, moved: Sequence[bool]) -> ca.Function:
    """Return the step that carries its forward sensitivities along, `directions` columns.

    With s' = F(s, q): S' = dF/ds S + dF/dq Q, Q the sensitivity of the parameters, zero in
    the rows that are not `moved`.
    """
    shapes = [step.size1_in(n) for n in range(4)]
    s, q, inputs, noise = (ca.SX.sym(name, size) for name, size in zip("sqin", shapes, strict=True))
    carried, seed = ca.SX.sym("S", shapes[0], directions), ca.SX.sym("Q", shapes[1], directions)
    outputs = step(s, q, inputs, noise)
    rows = [seed[n, :] if used else ca.SX(1, directions) for n, used in enumerate(moved)]
    seeds = ca.vertcat(carried, *rows)
    slopes = [ca.vec(ca.jtimes(x, ca.vertcat(s, q), seeds)) for x in outputs]
    return ca.Function(
        "step",
        [
            ca.vertcat(s, ca.vec(carried)),
            ca.vertcat(q, ca.vec(seed)),
            inputs,
            noise,
        ],
        [ca.vertcat(x, dx) for x, dx in zip(outputs, slopes, strict=True)],
        step.name_in(),
        step.name_out(),
    )


@lru_cache(maxsize=64)
def folded(loop: LoopGraph) -> ca.Function:
    """Return the step over the horizon: its outputs in columns, one a period.

    One column of parameters serves all periods.
    """
    step, count = step_function(loop), len(loop.times) - 1
    state, parameters = (ca.MX.sym(name, step.size1_in(name)) for name in step.name_in()[:2])
    inputs, noise = (ca.MX.sym(name, step.size1_in(name), count) for name in step.name_in()[2:])
    repeated = ca.repmat(parameters, 1, count)
    outputs = step.mapaccum("fold", count)(state, repeated, inputs, noise)
    return ca.Function("fold", [state, parameters, inputs, noise], list(outputs))


@lru_cache(maxsize=64)
def _inputs(loop: LoopGraph) -> ca.DM:
    return ca.DM(loop.tables[0].T)


def run(loop: LoopGraph, state: Any, parameters: Any, noise: Any) -> tuple[ca.DM, ca.DM, ca.DM]:
    """Return states, voltages and track of a run from its first state, one column a period."""
    found: tuple[ca.DM, ca.DM, ca.DM] = folded(loop)(state, parameters, _inputs(loop), noise)
    return found


@lru_cache(maxsize=64)
def quadrature(loop: LoopGraph) -> ca.Function:
    """Return the metrics of a track as one function of whole vectors.

    (Track of the gap, of the velocity, their values at t = 0) -> (increments of ISE, IAE and ITAE
    of every integration step), and with sensitivities of the tracks: sensitivities of the sums.
    """
    ends, directions = loop.ends, loop.directions
    lengths, size = loop.tables[0][:, : loop.pieces].ravel(), len(ends)
    starts = np.concatenate([[0.0], ends[:-1]])
    instants = np.concatenate([[0.0], ends])
    reference, slope, _ = designs.reference_path(loop.rig, instants)
    gap, velocity = ca.MX.sym("gap", size), ca.MX.sym("velocity", size)
    first, speed = ca.MX.sym("first"), ca.MX.sym("speed")
    error = ca.vertcat(first, gap) - reference
    change = ca.vertcat(speed, velocity) - slope
    increments = metrics_program().casadi(
        error[:-1], error[1:], change[:-1], change[1:], ca.MX(starts), ca.MX(lengths)
    )
    inputs, outputs = [gap, velocity, first, speed], [ca.horzcat(*increments)]
    if directions:
        seeds = [ca.MX.sym("gap_slope", size, directions)]
        seeds.append(ca.MX.sym("velocity_slope", size, directions))
        sums = ca.vertcat(*[ca.sum1(x) for x in increments])
        outputs.append(ca.jtimes(sums, ca.vertcat(gap, velocity), ca.vertcat(*seeds)))
        inputs += seeds
    return ca.Function("quadrature", inputs, outputs)
