"""The linear loop at any gap and ratio: sensitivity, spectral radius, noise, Routh-Hurwitz.

The plant is linearised where the ball is, the controller is the one that runs (its believed
coefficients, its discretisation, the delay). With H the pulse transfer function of the law from e
to u and P that of the plant from u to y,

    S = 1/(1 - P H) = D/(D + C_U' N),

D and N the products of the denominators and numerators of :mod:`maglev_design.symbolic.stability`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from maglev_design import design as designs
from maglev_design.choices import TAN_GPI, Controller, Equilibrium, Method
from maglev_design.lowering import Program, lower
from maglev_design.parameters import Rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import stability

Array = NDArray[np.float64]

SLOWEST = 1e-3
"""Lowest frequency of the search for the peak of |S|, as a share of the Nyquist frequency."""


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
class Family:
    """The gaps [m] and ratios over which a worst case is taken: two intervals."""

    gaps: tuple[float, float]
    ratios: tuple[float, float]

    def corners(self) -> tuple[Family, ...]:
        """Return the ends of both intervals as families of one point each."""
        return tuple(Family((gap, gap), (ratio, ratio)) for gap, ratio in self.grid(2, 2).T)

    def grid(self, gaps: int, ratios: int) -> Array:
        """Return the points of a grid, shape (2, n): gaps in row 0, ratios in row 1."""
        gap = np.unique(np.linspace(*self.gaps, gaps))
        ratio = np.unique(np.linspace(*self.ratios, ratios))
        return np.stack([axis.ravel() for axis in np.meshgrid(gap, ratio, indexing="ij")])


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
        (poles, gap, ratio) -> coefficients of D + C_U' N, highest first, and their Jacobian.
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


def family(rig: Rig, beta_error: float) -> Family:
    """Return the hull of path, initial gap and Y, times the ratios [1 - u, 1 + u]."""
    gaps = designs.path_gaps(rig, 2)
    return Family((float(gaps[0]), float(gaps[-1])), (1 - beta_error, 1 + beta_error))


@cache
def _law_program(method: Method, controller: Controller) -> Program:
    law = designs.law(controller)
    pulse = stability.sampled_law(law, method)
    inputs = (p.C_U_hat, p.C_Y_hat, p.T, *law.gains)
    return lower(inputs, _named(gap=pulse.gap, velocity=pulse.velocity, den=pulse.denominator))


@cache
def _plant_program() -> Program:
    gap, velocity = stability.sampled_plant("gap"), stability.sampled_plant("velocity")
    inputs = (p.C_Y_true, p.T, stability.first_part)
    outputs = _named(gap=gap.numerator, velocity=velocity.numerator, den=gap.denominator)
    return lower(inputs, outputs)


@cache
def _hurwitz_program(controller: Controller) -> Program:
    law = designs.law(controller)
    inputs = (p.rho, p.C_Y_true, p.C_Y_hat, *law.gains)
    return lower(inputs, _named(share=stability.hurwitz_shares(law)))


def _named(**groups: Sequence[Any]) -> dict[str, Any]:
    return {f"{name}{n}": x for name, group in groups.items() for n, x in enumerate(group)}


def build_loop(
    rig: Rig,
    *,
    equilibrium: Equilibrium,
    method: Method,
    controller: Controller = TAN_GPI,
    extra_samples: int = 0,
) -> Loop:
    """Return the loop of `rig`'s controller, with `extra_samples` more whole periods of delay."""
    when = designs.timing(rig.sampling.period, rig.sampling.delay)
    whole = when.whole + extra_samples
    period, plant, point = rig.sampling.period, rig.plant, rig.operating_point
    poles, gap, ratio = ca.SX.sym("poles", 4), ca.SX.sym("gap"), ca.SX.sym("ratio")
    theta = ca.SX.sym("theta")

    beta_c = designs.plant_beta(rig)
    beta = beta_c / ratio
    gains = designs.gains_program(controller).casadi(*ca.vertsplit(poles))
    offset = plant.gap_offset
    at_rest = designs.plant_program().casadi(plant.gravity, beta, offset, point.gap)
    voltage = point.voltage or at_rest[0]
    _, c_u_hat, c_y_hat, beta_hat = designs.believed_program(equilibrium).casadi(
        plant.gravity, beta_c, point.gap, offset, voltage
    )
    held, c_u, c_y = designs.plant_program().casadi(plant.gravity, beta, offset, gap)
    slope, believed_gain = designs.slope_program(controller).casadi(
        held, gap, beta_hat, offset, c_u_hat
    )
    gain = c_u * slope

    law = _split(_law_program(method, controller).casadi(c_u_hat, c_y_hat, period, *gains), 3)
    pulse = _split(_plant_program().casadi(c_y, period, when.part), [3, 3, 4])
    law_gap, law_velocity, law_den = law
    plant_gap, plant_velocity, plant_den = pulse
    through_gap, through_velocity = (
        _product(a, b) for a, b in ((plant_gap, law_gap), (plant_velocity, law_velocity))
    )
    numerator = [gain * (a + b) for a, b in zip(through_gap, through_velocity, strict=True)]
    denominator = _product(plant_den, law_den) + [ca.SX(0)] * whole
    closed = _sum(denominator, numerator)

    base = [poles, gap, ratio]
    peak = _modulus(denominator, theta) / _modulus(closed, theta)
    where = ca.vertcat(gap, ratio, theta)
    coefficients = ca.vertcat(*closed)
    effort = [slope * x for x in _product(plant_den, law_gap)] + [ca.SX(0)] * whole
    noise = ca.sqrt(_mean_square(effort, closed))
    shares = _hurwitz_program(controller).casadi(gain / believed_gain, c_y, c_y_hat, *gains)
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


def _split(values: Sequence[Any], sizes: int | Sequence[int]) -> list[list[Any]]:
    """Return `values` in groups: a number of equal ones, or of the given sizes."""
    if isinstance(sizes, int):
        sizes = [len(values) // sizes] * sizes
    ends = np.cumsum(sizes)
    return [list(values[end - size : end]) for end, size in zip(ends, sizes, strict=True)]


def _product(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Return the coefficients of the product of two polynomials."""
    result: list[Any] = [ca.SX(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            result[i + j] = result[i + j] + x * y
    return result


def _sum(longer: Sequence[Any], shorter: Sequence[Any]) -> list[Any]:
    pad = len(longer) - len(shorter)
    return [x + (shorter[n - pad] if n >= pad else 0) for n, x in enumerate(longer)]


def _modulus(coefficients: Sequence[Any], theta: Any) -> Any:
    """Return |polynomial| at exp(j theta)."""
    powers = range(len(coefficients) - 1, -1, -1)
    real = sum(c * ca.cos(n * theta) for c, n in zip(coefficients, powers, strict=True))
    imaginary = sum(c * ca.sin(n * theta) for c, n in zip(coefficients, powers, strict=True))
    return ca.sqrt(real**2 + imaginary**2)


def _mean_square(numerator: Sequence[Any], denominator: Sequence[Any]) -> Any:
    """Return the variance of numerator/denominator driven by white noise of variance one.

    Recursion of Astrom, Jury and Agniel (IEEE Trans. Automatic Control 15, 1970): exact for a
    stable denominator, both highest power first; it reduces the degree by one a turn.
    """
    a = list(denominator)
    b = [ca.SX(0)] * (len(a) - len(numerator)) + list(numerator)
    lead, total = a[0], ca.SX(0)
    while True:
        total += b[-1] ** 2 / a[0]
        if len(a) == 1:
            return total / lead
        last = len(a) - 1
        alpha, weight = a[-1] / a[0], b[-1] / a[0]
        b = [b[i] - weight * a[last - i] for i in range(last)]
        a = [a[i] - alpha * a[last - i] for i in range(last)]


def peak_sensitivity(
    loop: Loop, poles: Sequence[float], over: Family, *, refine: bool = True
) -> Extreme:
    """Return Ms, the largest |S| over `over` and all frequencies, with its gradient.

    A grid finds the neighbourhood; unless `refine` is False a bounded quasi-Newton search with
    exact gradients finishes. At an unstable loop |S| is still what it is, but no margin.
    """
    points = over.grid(5, 3) if refine else over.grid(3, 2)
    thetas = np.geomspace(SLOWEST * math.pi, math.pi, 160 if refine else 60)
    grid = np.concatenate(
        [np.repeat(points, len(thetas), axis=1), np.tile(thetas, points.shape[1])[None]]
    )
    values, _, _ = loop.sensitivity(poles, *(row[None, :] for row in grid))
    best = grid[:, int(np.argmax(values.full()))]
    if refine:
        best = _climb(loop, poles, over, best)
    value, slope, _ = loop.sensitivity(poles, *best)
    gap, ratio, theta = (float(x) for x in best)
    return Extreme(float(value), gap, ratio, theta / loop.period, slope.full().ravel())


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
    points = over.grid(5, 3)
    coefficients, jacobian = loop.characteristic(poles, *(row[None, :] for row in points))
    rows = coefficients.full().T
    companions = np.zeros((len(rows), rows.shape[1] - 1, rows.shape[1] - 1))
    companions[:, 0, :] = -rows[:, 1:] / rows[:, :1]
    companions[:, np.arange(1, rows.shape[1] - 1), np.arange(rows.shape[1] - 2)] = 1.0
    roots = np.linalg.eigvals(companions)
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
    return _scaled(_largest(loop.noise_gain, poles, over.grid(5, 3)), deviation)


def hurwitz_margin(loop: Loop, poles: Sequence[float], over: Family) -> Extreme:
    """Return the smallest normalised Routh-Hurwitz condition over a grid of `over`.

    Positive where the continuous loop is stable, 1 as designed.
    """
    return _largest(loop.hurwitz, poles, over.grid(9, 5), sign=-1.0)


def _largest(
    function: ca.Function, poles: Sequence[float], points: Array, sign: float = 1.0
) -> Extreme:
    values, slopes = function(poles, *(row[None, :] for row in points))
    numbers = sign * values.full().ravel()
    which = int(np.argmax(np.where(np.isnan(numbers), np.inf, numbers)))
    gap, ratio = points[:, which]
    gradient = slopes.full().reshape(4, -1, order="F")[:, which]
    return Extreme(
        float(values.full().ravel()[which]), float(gap), float(ratio), math.nan, gradient
    )


def _scaled(extreme: Extreme, factor: float) -> Extreme:
    return Extreme(
        extreme.value * factor, extreme.gap, extreme.ratio, math.nan, extreme.gradient * factor
    )
