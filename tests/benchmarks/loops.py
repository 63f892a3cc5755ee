"""The closed loop that is measured: by hand in C, and by this package."""

from __future__ import annotations

import ctypes
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rigs import SHORT, rig_with

from maglev_design.controller.design import (
    Design,
    PoleSpec,
    make_design,
    plant_beta,
    reference_path,
)
from maglev_design.rig import Rig, load_rig
from maglev_design.simulation import (
    LoopGraph,
    Scenario,
    build,
    compiled,
    nominal_scenario,
    pole_sensitivities,
    simulate_batch,
)
from maglev_design.simulation.batch import first_noise, summaries
from maglev_design.simulation.scenario import parameter_vector, start_state
from maglev_design.simulation.sensitivities import start_sensitivities

Array = NDArray[np.float64]

HERE = Path(__file__).parent
YARDSTICK_FLAGS = ("-O3", "-march=native", "-ffast-math")
DIRECTIONS = {2: np.array([[1.0, 0], [0, 1], [1, 0], [0, 1]]), 4: np.eye(4)}


@dataclass(frozen=True)
class Subject:
    """What every contender simulates: the paper's rig, nominal, with the paper's poles."""

    rig: Rig
    design: Design
    scenario: Scenario

    @property
    def steps(self) -> int:
        """Periods of one run."""
        return round(self.rig.reference.horizon / self.rig.sampling.period)


def subject(*, short: bool = False) -> Subject:
    """Return the TAN-GPI loop of the paper over its seven seconds, or over a 0.4 s path."""
    rig = rig_with(SHORT) if short else load_rig("belmonte2021")
    return Subject(
        rig, make_design(rig, PoleSpec.double(1.0, 70.0)), nominal_scenario(rig, plant_beta(rig))
    )


FIELDS: tuple[str, ...] = (
    "gap",
    "voltage",
    "static_gain",
    "acceleration",
    "error",
    "slow",
    "fast",
    "pole",
)
FIELDS += ("beta", "gravity", "low", "high")


class Numbers(ctypes.Structure):
    """The yardstick's ``numbers``."""

    _fields_ = [(name, ctypes.c_double) for name in FIELDS]


def numbers(of: Subject) -> Numbers:
    """Return the law in the yardstick's form."""
    k0, k1, k2, k3 = of.design.gains
    known, limits = of.design.believed, of.rig.limits.voltage
    c_u, c_y = known.C_U, known.C_Y
    law = ((k2 + c_y) / c_u, k0 / k3 / c_u, (k1 - k2 * k3 - k0 / k3) / c_u, k3)
    return Numbers(
        *(of.design.Y, known.U, c_y / c_u, -1 / c_u),
        *law,
        *(of.scenario.beta_plant, of.rig.plant.gravity),
        *limits,
    )


class Yardstick:
    """The hand-written loop, compiled."""

    def __init__(self, of: Subject, folder: Path) -> None:
        path = compiled.compiler()
        if path is None:
            raise RuntimeError("the yardstick needs a C compiler")
        made = folder / "yardstick.so"
        source = str(HERE / "yardstick.c")
        command = [path, *YARDSTICK_FLAGS, "-shared", "-fPIC", "-o", str(made), source, "-lm"]
        subprocess.run(command, check=True)  # noqa: S603 - the system's compiler on our own text
        self._run = ctypes.CDLL(str(made)).yardstick
        self._numbers, self._of = numbers(of), of
        self._tables: dict[int, Array] = {}

    def itae(self, refine: int = 1) -> float:
        """Run one loop, `refine` steps a millisecond, and return its ITAE."""
        rig, steps = self._of.rig, self._of.steps * refine
        if refine not in self._tables:
            instants = np.linspace(0.0, rig.reference.horizon, 2 * steps + 1)
            path = reference_path(rig, instants)
            self._tables[refine] = np.ascontiguousarray(path[[0, 2]].T)
        state = np.array([self._of.scenario.initial_gap, *[0.0] * 6])
        self._run(
            ctypes.c_long(steps),
            ctypes.c_double(rig.reference.horizon / steps),
            ctypes.c_void_p(self._tables[refine].ctypes.data),
            ctypes.byref(self._numbers),
            ctypes.c_void_p(state.ctypes.data),
        )
        return float(state[6])


@dataclass(frozen=True)
class Batch:
    """`count` loops of one kind, laid out for the kernel."""

    of: Subject
    loop: LoopGraph
    kernel: compiled.Kernel
    scenarios: list[Scenario]
    first: Array
    parameters: Array
    stream: NDArray[np.uint32]
    deviation: Array
    sensitivities: list[Any] | None

    @property
    def count(self) -> int:
        """How many loops."""
        return len(self.scenarios)

    def run(self, threads: int = 1) -> Array:
        """Run them all: arrays in, figures out."""
        figures, _ = compiled.run(
            self.loop,
            self.kernel,
            self.first,
            self.parameters,
            self.stream,
            self.deviation,
            noisy=self.scenarios[0].noise,
            threads=threads,
        )
        return figures

    def itae(self) -> float:
        """Return the ITAE of the first loop."""
        return float(summaries(self.loop, self.run())[0].metrics.itae)

    def called(self, backend: Any = "compiled", threads: int = 1) -> None:
        """Run them through the public function: scenarios in, summaries out."""
        designs = [self.of.design] * self.count
        simulate_batch(
            self.loop, designs, self.scenarios, self.sensitivities, threads=threads, backend=backend
        )


def graph(of: Subject, *, continuous: bool, refine: int = 1, directions: int = 0) -> LoopGraph:
    """Return the loop with one Runge-Kutta step a millisecond, or `refine` of them."""
    method = None if continuous else of.design.method
    return build(of.rig, method, refine=refine, directions=directions)


def batch(
    of: Subject,
    loop: LoopGraph,
    count: int,
    *,
    noise: bool = False,
) -> Batch:
    """Return `count` loops on plants that differ a little."""
    kernel = compiled.kernel(loop)
    if kernel is None:
        raise RuntimeError("the benchmarks need a C compiler that works")
    beta = of.scenario.beta_plant
    scenarios = [
        replace(of.scenario, beta_plant=beta * (1 + 1e-3 * n / count), noise=noise, index=n)
        for n in range(count)
    ]
    firsts = [first_noise(loop, s) for s in scenarios]
    states = [start_state(loop, of.design, s, f) for s, f in zip(scenarios, firsts, strict=True)]
    vectors = [parameter_vector(loop, of.design, s) for s in scenarios]
    sensitivities = None
    if loop.directions:
        own = pole_sensitivities(loop, of.design, DIRECTIONS[loop.directions])
        sensitivities = [own] * count
        vectors = [np.concatenate([v, own.parameters.ravel(order="F")]) for v in vectors]
        states = [
            np.concatenate(
                [x, start_sensitivities(loop, of.design, s, f, own.gains).ravel(order="F")]
            )
            for x, s, f in zip(states, scenarios, firsts, strict=True)
        ]
    stream = np.array([(s.seed, s.index) for s in scenarios], dtype=np.uint32)
    deviation = np.array([s.deviations(of.rig) for s in scenarios])
    first, parameters = np.array(states), np.array(vectors)
    return Batch(of, loop, kernel, scenarios, first, parameters, stream, deviation, sensitivities)
