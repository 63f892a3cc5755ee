"""The linearised sampled loop, put together from exported coefficients and nothing else.

The exported step is x' = A x + B e, u = C x + D e with e = y - y*; the plant is y'' = C_Y y - C_U u
at rest at a gap, held exactly between the instants at which the voltage changes. With H the pulse
transfer function of the step and P that of the plant, delay included, S = 1/(1 - P H).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from maglev_design.controller.timing import timing

Array = NDArray[np.float64]

FREQUENCIES = 400
"""First look for the peak of |S|, up to the Nyquist frequency."""
SLOWEST = 1e-3
"""Lowest frequency of it, as a share of the Nyquist frequency."""


@dataclass(frozen=True)
class PlantAtRest:
    """A plant at rest at a gap: g [m/s^2], beta [m^3/(s^2 V^2)], y0 [m] and the gap [m]."""

    gravity: float
    beta: float
    gap_offset: float
    gap: float

    @property
    def tangent(self) -> tuple[float, float]:
        """C_Y [1/s^2] and C_U [m/(s^2 V)] of y'' = g - beta u^2/(y + y0)^2."""
        z = self.gap + self.gap_offset
        return 2 * self.gravity / z, 2 * math.sqrt(self.gravity * self.beta) / z

    def held(self, duration: float) -> tuple[Array, Array]:
        """Return the transition over a `duration` [s] and the effect of a constant voltage."""
        c_y, c_u = self.tangent
        rate = math.sqrt(c_y)
        c, s = math.cosh(rate * duration), math.sinh(rate * duration)
        return np.array([[c, s / rate], [rate * s, c]]), -c_u * np.array([(c - 1) / c_y, s / rate])


@dataclass(frozen=True)
class ExportedLoop:
    """The coefficients of a step around one plant, at a period and a delay [s]."""

    coefficients: Mapping[str, float]
    plant: PlantAtRest
    period: float
    delay: float

    @property
    def _step(self) -> tuple[Array, Array, Array, float]:
        """A, B, C and D of the step: an integrator and a lag."""
        k = self.coefficients
        a = np.diag([1.0, k["a22"]])
        return a, np.array([k["b1"], k["b2"]]), np.array([k["c1"], k["c2"]]), k["d"]

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
        (a, b, c, d), (transition, new, old, whole) = self._step, self._effects()
        unit = np.eye(2)
        h = d + c @ np.linalg.solve(z * unit - a, b[:, None])
        pushed = new[:, None] * z**-whole + old[:, None] * z ** -(whole + 1)
        p = np.linalg.solve(z * unit - transition, pushed)[..., 0, :]
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
        (a, b, c, d), (transition, new, old, whole) = self._step, self._effects()
        remembered = whole + 1
        matrix = np.zeros((4 + remembered,) * 2)
        command = np.concatenate([[d, 0.0], c, np.zeros(remembered)])
        matrix[:2, :2], matrix[2:4, 2:4], matrix[2:4, 0] = transition, a, b
        matrix[4] = command
        for n in range(1, remembered):
            matrix[4 + n, 3 + n] = 1.0
        recent = command if whole == 0 else np.eye(len(matrix))[3 + whole]
        matrix[:2] += np.outer(new, recent)
        matrix[:2, 4 + whole] += old
        return float(np.abs(np.linalg.eigvals(matrix)).max())
