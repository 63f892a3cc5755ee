"""Margins by python-control: continuous and sampled, point by point and at their worst."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design import programs
from maglev_design.certification.intervals.sampled import setting
from maglev_design.controller.design import Design
from maglev_design.controller.family import Family
from maglev_design.figures import DESCRIBED, MARGINS
from maglev_design.linear_loop import Loop
from maglev_design.lowering import Program, lower
from maglev_design.options import Controller
from maglev_design.programs import derived
from maglev_design.rig import Rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import robustness

Array = NDArray[np.float64]
OpenLoop = Callable[[float, float], tuple[Array, Array]]
"""(gap, ratio) -> numerator and denominator of the open loop, highest power first."""
FREQUENCIES = 1000
"""Points of the frequency response that python-control interpolates."""
DECADES = 2
"""How far a continuous response reaches beyond the slowest and the fastest pole."""


@dataclass(frozen=True)
class Margin:
    """One margin and the point of the family where it is smallest.

    Attributes
    ----------
    value : float
        nan where the loop has none or is unstable.
    gap : float
        [m]
    ratio : float
        beta_c/beta.
    """

    value: float
    gap: float
    ratio: float


@dataclass(frozen=True)
class Margins:
    """Margins of a loop, each at its worst gap and ratio.

    Attributes
    ----------
    ms, mt : Margin
        max |S|, one over the distance of the Nyquist curve from -1, and max |T|.
    gain_up, gain_down : Margin
        Factors by which the loop gain may rise and fall; the plant is unstable, so both exist.
    phase_deg : Margin
        Phase margin [deg].
    delay_s : Margin
        Further delay until instability [s].
    disk : Margin
        Radius alpha of the balanced disk margin: simultaneous changes of gain within
        (2 - alpha)/(2 + alpha) to its inverse and of phase within 2 atan(alpha/2) are survived
        (Seiler, Packard and Gahinet, IEEE Control Systems 40(5), 2020).
    """

    ms: Margin
    mt: Margin
    gain_up: Margin
    gain_down: Margin
    phase_deg: Margin
    delay_s: Margin
    disk: Margin

    def as_dict(self) -> dict[str, Any]:
        """Return the margins for JSON; ``gain`` holds both sides, down and up."""
        return asdict(self) | {"gain": [self.gain_down.value, self.gain_up.value]}


NAMES = ("ms", "mt", *MARGINS, "disk")


@dataclass(frozen=True)
class PointMargins:
    """The margins at one gap [m] and ratio, by the names of :class:`Margins`."""

    gap: float
    ratio: float
    values: tuple[float, ...]

    def as_dict(self) -> dict[str, float]:
        """Return the margins for JSON."""
        return {"gap": self.gap, "ratio": self.ratio} | dict(zip(NAMES, self.values, strict=True))


def sampled_margins(loop: Loop, poles: Sequence[float], over: Family) -> Margins:
    """Return the classical margins of `loop`, each at its worst over a grid of `over`.

    Parameters
    ----------
    poles : sequence of float
        (zeta_1, omega_1, zeta_2, omega_2).
    """
    return worst(point_margins(sampled_open_loop(loop, poles), over, loop.period))


def sampled_open_loop(loop: Loop, poles: Sequence[float]) -> OpenLoop:
    """Return the open loop of the sampled controller, -P H in z."""

    def at(gap: float, ratio: float) -> tuple[Array, Array]:
        numerator, denominator = loop.open_loop(poles, gap, ratio)
        return numerator.full().ravel(), denominator.full().ravel()

    return at


def continuous_open_loop(rig: Rig, design: Design) -> OpenLoop:
    """Return the open loop of the continuous controller, rho (gain + C_Y^ gain_c_y)/fixed in s."""
    own, program = setting(rig, design), _pencil_program(design.controller)

    def at(gap: float, ratio: float) -> tuple[Array, Array]:
        true = own.coefficient(gap, float)
        rho = own.shape_at(true, float) / (ratio / float(own.scale)) ** (1 / own.power)
        values = np.array(program.scalar()(true, *map(float, own.gains)))
        fixed, gain, gain_c_y = np.split(values, 3)
        return rho * (gain + float(own.C_Y_hat) * gain_c_y), fixed

    return at


@cache
def _pencil_program(controller: Controller) -> Program:
    law = programs.law(controller)
    pencil = robustness.continuous_pencil(law)
    parts = derived.named(f=pencil.fixed, g=pencil.gain, h=pencil.gain_c_y)
    return lower((p.C_Y_true, *law.gains), parts)


def point_margins(
    open_loop: OpenLoop, over: Family, period: float | None
) -> tuple[PointMargins, ...]:
    """Return the margins at the ends and the middle of the gaps, times the ends of the ratios.

    Parameters
    ----------
    period : float or None
        T [s]; None for a continuous loop.
    """
    return tuple(
        PointMargins(float(gap), float(ratio), _at(*open_loop(float(gap), float(ratio)), period))
        for gap, ratio in over.grid(3, 2).T
    )


def worst(points: Sequence[PointMargins]) -> Margins:
    """Return each margin at its worst point; an unstable point is worse than any."""

    def pick(column: int) -> Margin:
        values = np.array([point.values[column] for point in points])
        sign = 1.0 if DESCRIBED[NAMES[column]].worse == "high" else -1.0
        at = int(np.argmax(np.where(np.isnan(values), math.inf, sign * values)))
        return Margin(float(values[at]), points[at].gap, points[at].ratio)

    return Margins(*(pick(column) for column in range(len(NAMES))))


def _at(numerator: Array, denominator: Array, period: float | None) -> tuple[float, ...]:
    """Return the margins of one loop, in the order of NAMES."""
    import control  # noqa: PLC0415 - heavy, and needed only here

    closed = np.asarray(np.roots(np.polyadd(denominator, numerator)), dtype=complex)
    if (closed.real.max() >= 0) if period is None else (np.abs(closed).max() >= 1):
        return (math.nan,) * len(NAMES)
    system = control.tf(numerator, denominator, 0 if period is None else period)
    omega = _frequencies(closed, period)
    response = control.frd(system, omega, smooth=True)
    gains, phases, distances, _, crossings, _ = control.stability_margins(response, returnall=True)
    up, down = gains[gains > 1], gains[gains < 1]
    values = response.eval(omega).ravel()
    # a distance without a local minimum is smallest at an end of the frequencies
    nearest = float(np.abs(1 + values).min()) if not distances.size else math.inf
    delays = np.deg2rad(np.abs(phases)) / crossings
    disk, _, _ = control.disk_margins(system, omega)
    return (
        1 / min(float(distances.min(initial=math.inf)), nearest),
        float(np.abs(values / (1 + values)).max()),
        float(up.min()) if up.size else math.inf,
        float(down.max()) if down.size else 0.0,
        float(np.abs(phases).min()) if phases.size else math.inf,
        float(delays.min()) if delays.size else math.inf,
        float(disk),
    )


def _frequencies(closed: NDArray[np.complex128], period: float | None) -> Array:
    """Return the frequencies [rad/s] of a response: up to Nyquist's, or around the poles."""
    if period is not None:
        return np.asarray(np.geomspace(1e-3, 1.0, FREQUENCIES) * math.pi / period)
    speeds, beyond = np.abs(closed), 10.0**DECADES
    return np.asarray(np.geomspace(speeds.min() / beyond, speeds.max() * beyond, FREQUENCIES))
