"""The linear loop at any gap and ratio: sensitivity, spectral radius, noise, Routh-Hurwitz.

The plant is linearised where the ball is, the controller is the one that runs (its believed
coefficients, its discretisation, the delay). With H the pulse transfer function of the law from e
to u and P that of the plant from u to y,

    S = 1/(1 - P H) = D/(D + N),

D and N those of :func:`maglev_design.symbolic.stability.sampled_loop` for the plant s^2 - C_Y, and
of :mod:`maglev_design.linear_loop.general` for one of another order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from maglev_design import programs
from maglev_design.controller.believed import (
    Believed,
)
from maglev_design.controller.design import (
    Design,
    coefficient_inputs,
)
from maglev_design.controller.family import Family
from maglev_design.controller.plant import (
    on_plant,
)
from maglev_design.controller.timing import timing
from maglev_design.linear_loop.general import PlacedLaw, any_order
from maglev_design.linear_loop.polynomials import mean_square, modulus, polynomial_roots, sum_of
from maglev_design.options import TAN_GPI, Controller, Method
from maglev_design.rig import Rig

Array = NDArray[np.float64]

SLOWEST = 1e-3
"""Lowest frequency of the search for the peak of |S|, as a share of the Nyquist frequency."""
FINE, COARSE = (5, 3), (3, 2)
"""Gaps and ratios of the grids: for one design, and for each point of a box of designs."""
FINE_FREQUENCIES, COARSE_FREQUENCIES = 160, 60
"""Frequencies of the first look for the peak of |S|."""
ZOOMS = 9
"""Divisions of a neighbourhood by four: the angle is good to 1e-7, the peak to its square."""


@dataclass(frozen=True)
class Extreme:
    """A worst value over the family and where it is reached.

    Attributes
    ----------
    value : float
    gap : float
        [m]
    ratio : float
        beta_c/beta.
    omega : float
        [rad/s] for a peak of |S|, else nan.
    gradient : array, shape (4,)
        With respect to (zeta_1, omega_1, zeta_2, omega_2).
    """

    value: float
    gap: float
    ratio: float
    omega: float
    gradient: Array


@dataclass(frozen=True)
class Loop:
    """One controller structure on one rig; functions of (poles, gap, ratio), vectorised.

    Attributes
    ----------
    period : float
        T [s].
    open_loop : casadi.Function
        (poles, gap, ratio) -> numerator and denominator of -P H, highest power first.
    sensitivity : casadi.Function
        (poles, gap, ratio, theta) -> |S(exp(j theta))| and its gradients by poles and by
        (gap, ratio, theta).
    characteristic : casadi.Function
        (poles, gap, ratio) -> coefficients of D + N, highest first, and their Jacobian.
    noise_gain : casadi.Function
        (poles, gap, ratio) -> standard deviation of the commanded voltage per metre of white
        sensor noise [V/m], and its gradient.
    hurwitz : casadi.Function
        (poles, gap, ratio) -> smallest Routh-Hurwitz condition of the continuous loop, each
        divided by its value as designed (rho = 1, C_Y' = C_Y^), and its gradient.
    """

    period: float
    open_loop: ca.Function
    sensitivity: ca.Function
    characteristic: ca.Function
    noise_gain: ca.Function
    hurwitz: ca.Function


def loop_of(rig: Rig, design: Design, *, extra_samples: int = 0) -> Loop:
    """Return the loop of a design: its functions have no poles to depend on, and take none."""
    return build_loop(
        rig,
        design.believed,
        method=design.method,
        controller=design.controller,
        gains=design.gains,
        extra_samples=extra_samples,
    )


@lru_cache(maxsize=64)
def build_loop(
    rig: Rig,
    believed: Believed,
    *,
    method: Method,
    controller: Controller = TAN_GPI,
    gains: tuple[float, ...] | None = None,
    extra_samples: int = 0,
) -> Loop:
    """Return the loop of a controller with fixed numbers around the plants of `rig`.

    Parameters
    ----------
    believed : Believed
        The controller's; a ratio beta_c/beta moves the plant's beta = believed.beta/ratio.
    gains : tuple of float, optional
        The law's; without them the poles place them.
    extra_samples : int
        More whole periods of delay.
    """
    when = timing(rig.sampling.period, rig.sampling.delay)
    whole = when.whole + extra_samples
    period, plant = rig.sampling.period, rig.plant
    poles, gap, ratio = ca.SX.sym("poles", 4), ca.SX.sym("gap"), ca.SX.sym("ratio")
    theta = ca.SX.sym("theta")

    beta = believed.beta / ratio
    placed = (
        programs.gains_program(controller).casadi(*ca.vertsplit(poles))
        if gains is None
        else [ca.SX(k) for k in gains]
    )
    offset = plant.gap_offset
    equilibrium = programs.plant_program(rig.kind)
    held, c_u, c_y = equilibrium.casadi(
        *on_plant(equilibrium, rig, plant.gravity, beta, offset, gap)
    )
    slope, believed_gain = programs.slope_program(controller).casadi(
        held, gap, believed.beta, offset, believed.C_U
    )
    gain = c_u * slope

    if rig.kind.order == 2 and not rig.kind.damped and controller.design_model == "undamped":
        known = (believed.C_U, believed.C_Y, c_y, period, when.part)
        parts = _sampled(method, controller, gain, *known, *placed)
        parts["effort"] = [slope * x for x in parts["effort"]]
        shares = programs.hurwitz_program(controller).casadi(
            gain / believed_gain, c_y, believed.C_Y, *placed
        )
    else:
        names = programs.gains_program(controller).outputs
        numbers = coefficient_inputs(rig, believed) | dict(zip(names, placed, strict=True))
        law = PlacedLaw(controller, method, numbers, slope)
        parts, shares = any_order(rig, law, believed.beta, (gap, beta), when.part)
    late = [ca.SX(0)] * whole
    numerator, denominator = parts["num"], parts["den"] + late
    closed = sum_of(denominator, numerator)

    base = [poles, gap, ratio]
    peak = modulus(denominator, theta) / modulus(closed, theta)
    where = ca.vertcat(gap, ratio, theta)
    coefficients = ca.vertcat(*closed)
    effort = parts["effort"] + late
    noise = ca.sqrt(mean_square(effort, closed))
    margin = ca.mmin(ca.vertcat(*shares))
    return Loop(
        period=period,
        open_loop=ca.Function(
            "open_loop", base, [ca.vertcat(*numerator), ca.vertcat(*denominator)]
        ),
        sensitivity=ca.Function(
            "sensitivity",
            [*base, theta],
            [peak, ca.gradient(peak, poles), ca.gradient(peak, where)],
        ),
        characteristic=ca.Function(
            "characteristic", base, [coefficients, ca.jacobian(coefficients, poles)]
        ),
        noise_gain=ca.Function("noise_gain", base, [noise, ca.gradient(noise, poles)]),
        hurwitz=ca.Function("hurwitz", base, [margin, ca.gradient(margin, poles)]),
    )


def _sampled(method: Method, controller: Controller, *known: Any) -> dict[str, list[Any]]:
    """Return the polynomials of :func:`maglev_design.symbolic.stability.sampled_loop` by name."""
    lowered = programs.sampled_loop_program(method, controller)
    parts: dict[str, list[Any]] = {}
    for name, value in zip(lowered.outputs, lowered.casadi(*known), strict=True):
        parts.setdefault(name.rstrip("0123456789"), []).append(value)
    return parts


def peak_sensitivity(loop: Loop, poles: Sequence[float], over: Family) -> Extreme:
    """Return Ms, the largest |S| over `over` and all frequencies, with its gradient.

    At an unstable loop |S| is still what it is, but no margin.
    """
    return peak_sensitivities(loop, poles, over)[0]


def peak_sensitivities(loop: Loop, poles: Sequence[float], over: Family) -> tuple[Extreme, ...]:
    """Return the largest |S| over `over`, then that at each of its corners, with gradients.

    At every point of a grid the frequency of the peak is found first; from the best point a
    bounded quasi-Newton search over gap, ratio and frequency finishes, unless the point is a
    local maximum already, as a corner mostly is.
    """
    points = over.grid(*FINE)
    column = np.asarray(poles, dtype=float)[:, None]
    peaks, thetas = _frequency_peaks(loop, column, points, FINE_FREQUENCIES, ZOOMS)
    picks = [int(np.argmax(peaks)), *over.corner_columns(*FINE)]
    where = np.vstack([points, thetas])[:, picks]
    values, by_poles, moves = loop.sensitivity(poles, *(row[None, :] for row in where))
    slopes = by_poles.full().reshape(4, -1, order="F")
    found = [
        _extreme(value, slope, at, loop.period)
        for value, slope, at in zip(values.full().ravel(), slopes.T, where.T, strict=True)
    ]
    around = next(part for part in over.rectangles if _inside(part, where[:2, 0]))
    if not _is_local_maximum(around, where[:2, 0], moves.full().ravel()[:2]):
        best = _climb(loop, poles, around, where[:, 0])
        value, slope, _ = loop.sensitivity(poles, *best)
        found[0] = _extreme(float(value), slope.full().ravel(), best, loop.period)
    return tuple(found)


def _extreme(value: float, slope: Array, where: Array, period: float) -> Extreme:
    gap, ratio, theta = (float(x) for x in where)
    return Extreme(float(value), gap, ratio, theta / period, np.asarray(slope))


def _inside(part: Family, where: Array) -> bool:
    ends = zip(where, (part.gaps, part.ratios), strict=True)
    return all(low <= x <= high for x, (low, high) in ends)


def _is_local_maximum(over: Family, where: Array, slopes: Array) -> bool:
    """Return whether neither gap nor ratio can move uphill inside `over`."""
    return all(
        low == high or (x == low and slope <= 0) or (x == high and slope >= 0)
        for x, slope, (low, high) in zip(where, slopes, (over.gaps, over.ratios), strict=True)
    )


@cache
def _powers(frequencies: int, degree: int) -> tuple[Array, NDArray[np.complex128]]:
    """Return k angles theta and, one a row, the powers degree..0 of exp(j theta)."""
    thetas = np.geomspace(SLOWEST * math.pi, math.pi, frequencies)
    return thetas, np.exp(1j * np.arange(degree, -1, -1)[:, None] * thetas)


def _frequency_peaks(
    loop: Loop, poles: Array, points: Array, frequencies: int, zooms: int
) -> tuple[Array, Array]:
    """Return max |S| over the frequencies and the angle where it is, each of shape (n,).

    Parameters
    ----------
    poles : array, shape (4, n) or (4, 1)
    points : array, shape (2, n)
        Gaps and ratios.
    frequencies : int
        Of the first grid, which must part the peaks.
    zooms : int
        Times that the neighbourhood of the best frequency is divided by four.
    """
    poles = np.broadcast_to(poles, (4, points.shape[1]))
    numerator, denominator = (x.full().T for x in loop.open_loop(poles, *points[:, None, :]))
    closed = denominator.copy()
    closed[:, denominator.shape[1] - numerator.shape[1] :] += numerator
    grid, powers = _powers(frequencies, denominator.shape[1] - 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        sizes = np.abs(denominator @ powers) / np.abs(closed @ powers)
    best = np.argmax(sizes, axis=1)
    rows = np.arange(len(best))
    peaks, thetas = sizes[rows, best], grid[best]
    width = math.log(grid[1] / grid[0])
    exponents = np.arange(denominator.shape[1] - 1, -1, -1)
    for _ in range(zooms):
        near = np.minimum(thetas[:, None] * np.exp(width * np.linspace(-1, 1, 9)), math.pi)
        turned = np.exp(1j * near[:, None, :] * exponents[:, None])
        with np.errstate(divide="ignore", invalid="ignore"):
            sizes = np.abs((denominator[:, None, :] @ turned)[:, 0]) / np.abs(
                (closed[:, None, :] @ turned)[:, 0]
            )
        best = np.argmax(sizes, axis=1)
        peaks, thetas = sizes[rows, best], near[rows, best]
        width /= 4
    return peaks, thetas


def _climb(loop: Loop, poles: Sequence[float], over: Family, start: Array) -> Array:
    """Return the nearest local maximum of |S| over gap, ratio and frequency."""
    low = np.array([over.gaps[0], over.ratios[0], SLOWEST * math.pi])
    high = np.array([over.gaps[1], over.ratios[1], math.pi])
    span = np.where(high > low, high - low, 1.0)

    def negative(x: Array) -> tuple[float, Array]:
        value, _, slope = loop.sensitivity(poles, *(low + x * span))
        return -float(value), -slope.full().ravel() * span

    ends = [(0.0, float(h > lo)) for lo, h in zip(low, high, strict=True)]
    found = minimize(negative, (start - low) / span, jac=True, method="L-BFGS-B", bounds=ends)
    return np.asarray(low + found.x * span)


def spectral_radius(loop: Loop, poles: Sequence[float], over: Family) -> Extreme:
    """Return the largest modulus of a closed-loop pole over a grid of `over`.

    The gradient is that of the root itself, -(d chi/d p)/(d chi/d z).
    """
    points = over.grid(*FINE)
    coefficients, jacobian = loop.characteristic(poles, *points[:, None, :])
    rows = coefficients.full().T
    roots = polynomial_roots(rows)
    which = int(np.argmax(np.abs(roots).max(axis=1)))
    root = roots[which][int(np.argmax(np.abs(roots[which])))]
    slopes = jacobian.full()[:, 4 * which : 4 * which + 4]
    powers = root ** np.arange(rows.shape[1] - 1, -1, -1)
    steepness = np.polyval(np.polyder(rows[which]), root)
    moved = -(powers @ slopes) / steepness if steepness else np.zeros(4)
    gradient = np.real(np.conj(root) * moved) / abs(root)
    gap, ratio = points[:, which]
    return Extreme(float(abs(root)), float(gap), float(ratio), math.nan, gradient)


def noise_voltage(loop: Loop, poles: Sequence[float], over: Family, deviation: float) -> Extreme:
    """Return the largest standard deviation of the voltage that sensor noise makes [V].

    White position noise of standard `deviation` [m] at every sample, over a grid of `over`.
    """
    return noise_voltages(loop, poles, over, deviation)[0]


def noise_voltages(
    loop: Loop, poles: Sequence[float], over: Family, deviation: float
) -> tuple[Extreme, ...]:
    """Return :func:`noise_voltage`, then the same at each corner of `over`."""
    found = _evaluated(loop.noise_gain, poles, over.grid(*FINE))
    worst = max(found, key=lambda x: math.inf if math.isnan(x.value) else x.value)
    corners = [found[n] for n in over.corner_columns(*FINE)]
    return tuple(
        replace(x, value=deviation * x.value, gradient=deviation * x.gradient)
        for x in (worst, *corners)
    )


def hurwitz_margin(loop: Loop, poles: Sequence[float], over: Family) -> Extreme:
    """Return the smallest normalised Routh-Hurwitz condition over a grid of `over`.

    Positive where the continuous loop is stable, 1 as designed.
    """
    found = _evaluated(loop.hurwitz, poles, over.grid(9, 5))
    return min(found, key=lambda x: -math.inf if math.isnan(x.value) else x.value)


def _evaluated(function: ca.Function, poles: Sequence[float], points: Array) -> list[Extreme]:
    """Return a function's value and gradient at every point."""
    values, slopes = function(poles, *points[:, None, :])
    columns = slopes.full().reshape(4, -1, order="F").T
    return [
        Extreme(float(value), float(gap), float(ratio), math.nan, slope)
        for value, slope, (gap, ratio) in zip(values.full().ravel(), columns, points.T, strict=True)
    ]


@dataclass(frozen=True)
class Coarse:
    """Figures of many pole placements, each at its worst over the family; shape (n,) each.

    Attributes
    ----------
    radius, hurwitz, peak, noise : array
        As :func:`spectral_radius`, :func:`hurwitz_margin`, :func:`peak_sensitivity` and
        :func:`noise_voltage` per metre [V/m], on a coarser grid and without refinement.
    """

    radius: Array
    hurwitz: Array
    peak: Array
    noise: Array


def coarse_figures(loop: Loop, poles: Array, over: Family) -> Coarse:
    """Return the figures of n pole placements, the columns of `poles`, for a picture of a box."""
    points = over.grid(*COARSE)
    count = points.shape[1]
    every = np.repeat(poles, count, axis=1)
    where = np.tile(points, poles.shape[1])
    row = where[:, None, :]
    coefficients, _ = loop.characteristic(every, *row)
    hurwitz, _ = loop.hurwitz(every, *row)
    noise, _ = loop.noise_gain(every, *row)
    peaks, _ = _frequency_peaks(loop, every, where, COARSE_FREQUENCIES, 0)

    def worst(values: Array, sign: float = 1.0) -> Array:
        known = np.where(np.isnan(values), np.inf, sign * values).reshape(-1, count)
        return np.asarray(sign * known.max(axis=1))

    return Coarse(
        radius=worst(np.abs(polynomial_roots(coefficients.full().T)).max(axis=1)),
        hurwitz=worst(hurwitz.full().ravel(), -1.0),
        peak=worst(peaks),
        noise=worst(noise.full().ravel()),
    )
