"""The linearised sampled loop, put together from exported coefficients and nothing else.

The exported step is x' = A x + B e, u = C x + D e with e = y - y*; the plant is its tangent at rest
at a gap, for the paper's kind y'' = C_Y y - C_U u, held exactly between the instants at which the
voltage changes. With H the pulse transfer function of the step and P that of the plant, delay
included, S = 1/(1 - P H).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

from maglev_design.controller.plant import (
    on_plant,
)
from maglev_design.controller.timing import timing
from maglev_design.lowering import Program
from maglev_design.programs import tangent_program
from maglev_design.rig import Rig

Array = NDArray[np.float64]

FREQUENCIES = 400
"""First look for the peak of |S|, up to the Nyquist frequency."""
SLOWEST = 1e-3
"""Lowest frequency of it, as a share of the Nyquist frequency."""


@dataclass(frozen=True)
class PlantAtRest:
    """A rig's plant at rest at a gap [m], with another beta and y0 [m]."""

    rig: Rig
    beta: float
    gap_offset: float
    gap: float

    @cached_property
    def tangent(self) -> tuple[Array, Array]:
        """A and B of the plant; gap first, then velocity and what the drive has as a state."""
        program, order = tangent_program(self.rig.kind), self.rig.kind.order
        fixed = (self.rig.plant.gravity, self.beta, self.gap_offset, self.gap)
        entries = np.array(program.scalar()(*on_plant(program, self.rig, *fixed)))
        return entries[: order**2].reshape(order, order), entries[order**2 :, None]

    def held(self, duration: float) -> tuple[Array, Array]:
        """Return the transition over a `duration` [s] and the effect of a constant voltage."""
        (a, b), order = self.tangent, self.rig.kind.order
        block = np.zeros((order + 1, order + 1))
        block[:order, :order], block[:order, order:] = a, b
        whole = expm(block * duration)
        return whole[:order, :order], whole[:order, order]


@dataclass(frozen=True)
class ExportedLoop:
    """A step with its coefficients around one plant, at a period and a delay [s].

    `core` is the program that puts the coefficients into matrices.
    """

    core: Program
    coefficients: Mapping[str, float]
    plant: PlantAtRest
    period: float
    delay: float

    @cached_property
    def _step(self) -> tuple[Array, Array, Array, float]:
        """A, B, C and D of the step, from the error to the voltage."""
        values = self.core.scalar()(*[self.coefficients[n] for n in self.core.inputs])
        named = dict(zip(self.core.outputs, values, strict=True))
        order = round(math.sqrt(sum(name.startswith("A") for name in named)))
        entries = {
            letter: np.array([named[f"{letter}{n}"] for n in range(size)])
            for letter, size in (("A", order**2), ("B", order), ("C", order))
        }
        return entries["A"].reshape(order, order), entries["B"], entries["C"], named["D0"]

    @cached_property
    def _effects(self) -> tuple[Array, Array, Array, int]:
        """Transition of the plant, effects of u(k - n) and of u(k - n - 1), and n."""
        when = timing(self.period, self.delay)
        transition, _ = self.plant.held(self.period)
        late, new = self.plant.held(self.period - when.part)
        _, early = self.plant.held(when.part)
        return transition, new, late @ early, when.whole

    def sensitivity(self, theta: Array) -> Array:
        """Return |S(exp(j theta))|."""
        z = np.exp(1j * np.asarray(theta))[..., None, None]
        (a, b, c, d), (transition, new, old, whole) = self._step, self._effects
        h = d + c @ np.linalg.solve(z * np.eye(len(b)) - a, b[:, None])
        pushed = new[:, None] * z**-whole + old[:, None] * z ** -(whole + 1)
        p = np.linalg.solve(z * np.eye(len(new)) - transition, pushed)[..., 0, :]
        return np.asarray(1 / np.abs(1 - p * h)[..., 0])

    def peak(self) -> float:
        """Return max |S| over all frequencies; infinite where the loop is unstable."""
        if self.radius() >= 1:
            return math.inf
        thetas = np.geomspace(SLOWEST, 1.0, FREQUENCIES) * math.pi
        sizes = self.sensitivity(thetas)
        top = int(np.argmax(sizes))
        ends = thetas[max(top - 1, 0)], thetas[min(top + 1, FREQUENCIES - 1)]
        finer = minimize_scalar(
            lambda x: -float(self.sensitivity(np.array([x]))[0]),
            bounds=ends,
            method="bounded",
            options={"xatol": 1e-6 * ends[1]},
        )
        return max(float(sizes[top]), -float(finer.fun))

    def radius(self) -> float:
        """Return the largest modulus of a pole of the closed loop."""
        (a, b, c, d), (transition, new, old, whole) = self._step, self._effects
        remembered, plant, own = whole + 1, len(new), len(new) + len(b)
        matrix = np.zeros((own + remembered,) * 2)
        command = np.concatenate([[d], np.zeros(plant - 1), c, np.zeros(remembered)])
        matrix[:plant, :plant], matrix[plant:own, plant:own] = transition, a
        matrix[plant:own, 0] = b
        matrix[own] = command
        for n in range(1, remembered):
            matrix[own + n, own + n - 1] = 1.0
        recent = command if whole == 0 else np.eye(len(matrix))[own + whole - 1]
        matrix[:plant] += np.outer(new, recent)
        matrix[:plant, own + whole] += old
        return float(np.abs(np.linalg.eigvals(matrix)).max())
