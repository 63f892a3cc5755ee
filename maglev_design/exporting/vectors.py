"""Test vectors: the design's own simulation, sample by sample, and what unusable samples do."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from maglev_design.controller import design as designs
from maglev_design.errors import VerificationError
from maglev_design.exporting.controller import LARGEST_ACCELERATION, ExportedController
from maglev_design.rig import Rig, make_rig
from maglev_design.simulation import Response, Scenario, loop_for, nominal_scenario, simulate
from maglev_design.simulation.grid import reference_names, reference_rows
from maglev_design.simulation.scenario import noise_samples

MOST_ROWS = 8000
"""Samples of the path that are recorded: all of the paper's 7 s."""
SHORT = 200
"""Samples of each of the other parts."""
BEYOND = 2.0
"""Initial error of the saturated runs, in errors that take the command across the range."""
OK, HELD, TRIPPED = 0, 1, 2
Sample = tuple[float, ...]
"""Measured gap, y*, y*'' and, where the law reads them, y*' and y*'''."""


@dataclass
class Recorder:
    """A controller that writes down what it is asked and what it answers.

    It runs the lowered step as plain Python floats, with the rule for unusable samples stated
    once more, apart from the templates.
    """

    controller: ExportedController
    lines: list[str] = field(default_factory=list)
    rows: int = 0
    states: tuple[float, ...] = ()
    commanded: float = 0.0
    voltage: float = 0.0
    unusable: int = 0

    def __post_init__(self) -> None:
        self.numbers = self.controller.numbers
        step = self.controller.step
        self._names = [n for n in step.inputs if n in self.numbers]
        self._step = step.scalar()
        self.start()

    def start(self) -> None:
        """Be a new controller."""
        self.commanded = self.voltage = self.numbers["u_min"]
        self.forget()

    def forget(self) -> None:
        """Reset, without a line."""
        self.states, self.unusable = self.controller.start, 0

    def event(self, word: str, *values: float) -> None:
        """Write one line."""
        self.lines.append(",".join([word, *[repr(float(value)) for value in values]]))

    def step(
        self, gap: float, reference: float, acceleration: float, *more: float
    ) -> tuple[float, float]:
        """Take one sample, write it down and return the commanded and the applied voltage."""
        n, status = self.numbers, OK
        sample = (gap, reference, acceleration, *(more or (0.0,) * len(self.controller.more)))
        usable = all(
            low <= value <= high
            for value, (low, high) in zip(sample, limits(self.controller), strict=True)
        )
        if self.unusable > self.controller.hold_samples:
            status = TRIPPED
        elif usable:
            constants = [n[name] for name in self._names]
            *states, self.commanded, self.voltage = self._step(
                *self.states, *in_order(self.controller, sample), *constants
            )
            self.states, self.unusable = tuple(states), 0
        else:
            self.unusable += 1
            status = HELD if self.unusable <= self.controller.hold_samples else TRIPPED
        if status == TRIPPED:
            self.commanded = self.voltage = n["u_min"]
        self.event("step", *sample, self.commanded, self.voltage)
        self.lines[-1] += f",{status}"
        self.rows += 1
        return self.commanded, self.voltage


def limits(controller: ExportedController) -> list[tuple[float, float]]:
    """Return the range of every signal in which a sample can be used, in the order of a sample."""
    n = controller.numbers
    gaps = (n["gap_low"], n["gap_high"])
    largest = {"acc_ref": "acc_max", "v_ref": "vel_max", "jerk_ref": "jerk_max"}
    return [
        (-n[largest[name]], n[largest[name]]) if name in largest else gaps
        for name in controller.signals
    ]


def in_order(controller: ExportedController, sample: Sequence[float]) -> list[float]:
    """Return a sample, as it is written down, in the order in which the law reads it."""
    known = dict(zip(controller.signals, sample, strict=True))
    return [known[name] for name in controller.step.inputs if name in known]


def record_vectors(controller: ExportedController) -> tuple[str, int]:
    """Return the text of ``vectors.csv`` and its number of steps.

    Raises
    ------
    VerificationError
        When a voltage of the simulation is not, bit for bit, that of the law as it is exported.
    """
    rig = short_path(controller.record.rig)
    beta = designs.plant_beta(rig)
    recorder = Recorder(controller)
    nominal = nominal_scenario(rig, beta)
    path = rig.reference
    recorder.event("path", path.start_gap, path.end_gap, path.start_time, path.end_time)
    recorder.start()
    usual = _replay(recorder, rig, nominal, MOST_ROWS)
    for sign in (1.0, -1.0):
        _reset(recorder)
        _replay(recorder, rig, _saturating(controller, rig, beta, sign), SHORT)
    _reset(recorder)
    ratio = 1 + (rig.uncertainty.beta or 0.1)
    wrong = Scenario(beta / ratio, rig.initial.gap, rig.initial.velocity, noise=True, seed=1)
    _replay(recorder, rig, wrong, SHORT)
    samples = _inputs(controller, rig, usual, np.zeros(len(usual.commanded)), MOST_ROWS)
    # a short run is gone through again until there is something to take samples from
    early = list(itertools.islice(itertools.cycle(samples), SHORT))
    _bumpless(recorder, samples[-SHORT:])
    _reset(recorder)
    _faults(recorder, early, path.start_gap)
    _lost_sensor(recorder, early)
    header = "# SI units; see README.md for the meaning of the lines\n"
    return header + "\n".join(recorder.lines) + "\n", recorder.rows


def short_path(rig: Rig) -> Rig:
    """Return the rig with a late start of the move brought forward, so that it is recorded."""
    path, period = rig.reference, rig.sampling.period
    latest = MOST_ROWS // 4 * period
    if path.start_time <= latest:
        return rig
    early = path.start_time - latest
    data: dict[str, Any] = rig.model_dump(exclude_none=True)
    for name in ("start_time", "end_time", "horizon"):
        data["reference"][name] -= early
    return make_rig(data, "vectors")


def _reset(recorder: Recorder) -> None:
    recorder.event("reset", 0.0)
    recorder.forget()


def _replay(recorder: Recorder, rig: Rig, scenario: Scenario, most: int) -> Response:
    """Record the inputs of a simulated run, and check the answers against the simulation."""
    design = recorder.controller.record.design
    loop = loop_for(rig, design)
    response = simulate(loop, design, scenario)
    noise = np.asarray(noise_samples(rig, scenario, len(response.commanded)), dtype=float)[1]
    for k, sample in enumerate(_inputs(recorder.controller, rig, response, noise, most)):
        found = recorder.step(*sample)
        told = (float(response.commanded[k]), float(response.applied[k]))
        if found != told and recorder.unusable == 0:
            raise VerificationError(
                f"sample {k}: the exported law gives {found} V and the simulation "
                f"{told} V; they must agree to the last bit; report this with the rig file"
            )
    return response


def _inputs(
    controller: ExportedController, rig: Rig, response: Response, noise: Any, most: int
) -> list[Sample]:
    """Return (measured gap, y*, y*'', ...) of the samples up to a crash, at most `most`."""
    crash = response.metrics.crash
    alive = response.times[:-1] < (crash.time if crash else math.inf)
    count = min(int(alive.sum()), most)
    law = controller.record.design.controller
    rows = reference_rows(rig, response.times[:count], law)
    known = dict(zip(reference_names(law), rows, strict=True))
    known["y"] = response.gap[:count] + noise[:count]
    return list(zip(*(known[name].tolist() for name in controller.signals), strict=True))


def _saturating(controller: ExportedController, rig: Rig, beta: float, sign: float) -> Scenario:
    """Return a start from which the command goes beyond one end of the voltage range."""
    n = controller.numbers
    error = sign * BEYOND * (n["u_max"] - n["u_min"]) / abs(n["d"])
    start = rig.reference.start_gap + error
    low, high = n["gap_low"], n["gap_high"]
    inside = min(max(start, low + 0.05 * (high - low)), high - 0.05 * (high - low))
    return Scenario(beta, inside)


def _bumpless(recorder: Recorder, samples: Sequence[Sample]) -> None:
    """Take over near rest at a voltage in the middle of the range."""
    n, controller = recorder.numbers, recorder.controller
    u = (n["u_min"] + n["u_max"]) / 2
    # at rest: what a bumpless start is told besides is zero
    taken = (*samples[0][:3], *(0.0 for _ in controller.more))
    recorder.event("bumpless", u, *taken[:3])
    recorder.start()
    known = n | dict(zip(controller.signals, taken, strict=True)) | {"u": u}
    program = controller.bumpless
    recorder.states = program.scalar()(*[known[name] for name in program.inputs])
    recorder.commanded = recorder.voltage = u
    for sample in samples:
        recorder.step(*sample)


def _faults(recorder: Recorder, samples: Sequence[Sample], rest: float) -> None:
    """Mix unusable samples in, one class after another, then trip and reset."""
    n = recorder.numbers
    nan, inf = math.nan, math.inf
    more = recorder.controller.more
    bad: list[Sample] = [
        *[(gap, rest, 0.0) for gap in (nan, inf, -inf, -1.0, n["gap_high"] * 2, 1e300, -1e300)],
        *[(rest, reference, 0.0) for reference in (nan, inf, -inf, -1.0, n["gap_high"] * 2)],
        *[(rest, rest, a) for a in (nan, inf, -inf, 2 * LARGEST_ACCELERATION, -1e300)],
        (nan, nan, nan),
        (-0.0 if n["gap_low"] > 0 else -1e-300, rest, 0.0),
    ]
    for k in range(len(more)):
        bad += [(rest, rest, 0.0, *_one_of(len(more), k, x)) for x in (nan, inf, -inf, 1e30)]
    for k, sample in enumerate(samples):
        recorder.step(*sample)
        if k % 5 == 2:
            recorder.step(*bad[k // 5 % len(bad)])
    for edge in (n["gap_low"], n["gap_high"]):
        recorder.step(edge, rest, n["acc_max"])
        recorder.step(rest, edge, -n["acc_max"])


def _one_of(count: int, place: int, value: float) -> list[float]:
    """Return zeros, but for one place."""
    return [value if k == place else 0.0 for k in range(count)]


def _lost_sensor(recorder: Recorder, samples: Sequence[Sample]) -> None:
    """Lose the sensor until the controller trips, let it come back, and reset."""
    count = recorder.controller.hold_samples
    _reset(recorder)
    for sample in samples[:20]:
        recorder.step(*sample)
    for _ in range(count):
        recorder.step(math.nan, *samples[20][1:])
    for sample in samples[20:25]:
        recorder.step(*sample)
    for _ in range(count + 2):
        recorder.step(math.nan, *samples[25][1:])
    for sample in samples[25:30]:
        recorder.step(*sample)
    _reset(recorder)
    recorder.step(math.nan, *samples[30][1:])
    for sample in samples[30:40]:
        recorder.step(*sample)
