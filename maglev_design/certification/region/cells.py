"""Cells of the plane of (e, q), and sound bounds of the force on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

from flint import fmpq

from maglev_design.certification.intervals.arithmetic import OPERATORS, exact
from maglev_design.certification.region.model import Deviation, force_program

GRAIN = fmpq(1, 2**40)
"""What bounds of shares, and of phi/g and its slopes, are rounded to, outward."""
FROZEN, RUNNING = 0, 1
"""Modes of the integrator: held by anti-windup, and following its rate."""

Extents = tuple[fmpq, fmpq]
"""Largest e/(r + y0) and largest q [V] of a set: the units of its cells."""


@dataclass(frozen=True)
class Cell:
    """A rectangle of the plane of (e, q), in units of the set's extents."""

    left: fmpq
    right: fmpq
    low: fmpq
    high: fmpq

    @property
    def centre(self) -> tuple[fmpq, fmpq]:
        """Its centre."""
        return (self.left + self.right) / 2, (self.low + self.high) / 2

    @property
    def radii(self) -> tuple[fmpq, fmpq]:
        """Half its sides."""
        return (self.right - self.left) / 2, (self.high - self.low) / 2

    def holds_origin(self) -> bool:
        """Return whether (0, 0) is in it."""
        return self.left <= 0 <= self.right and self.low <= 0 <= self.high

    def halves(self) -> tuple[Cell, Cell]:
        """Return the two halves across the longer side."""
        a, b = self.centre
        if self.right - self.left >= self.high - self.low:
            return replace(self, right=a), replace(self, left=a)
        return replace(self, high=b), replace(self, low=b)


@dataclass(frozen=True)
class Force:
    """phi/g on a cell: bounds at its centre, and of its slopes in units of the extents.

    phi/g = middle + a (e - e_c) + b (q - q_c) + r with a, b the mids of the slopes and |r| <= rest.
    """

    centre: tuple[fmpq, fmpq]
    by_e: tuple[fmpq, fmpq]
    by_q: tuple[fmpq, fmpq]
    rest: fmpq

    @property
    def middle(self) -> fmpq:
        """Mid value at the centre."""
        return (self.centre[0] + self.centre[1]) / 2


def modes(model: Deviation, extents: Extents, cell: Cell) -> tuple[int, ...]:
    """Return the modes of the integrator on a cell, both where it touches a line of switching.

    Frozen while the command is beyond the clamp and e pushes it further out.
    """
    (low, high), (u_low, u_high) = model.rest, model.actuator
    bottom, top = (b * extents[1] for b in (cell.low, cell.high))
    never = low + bottom > u_low or cell.left > 0
    always = high + top < u_low and cell.right < 0
    if u_high is not None:
        never = never and (high + top < u_high or cell.right < 0)
        always = always or (low + bottom > u_high and cell.left > 0)
    if never:
        return (RUNNING,)
    return (FROZEN,) if always else (FROZEN, RUNNING)


def _shares(model: Deviation, low: fmpq, high: fmpq) -> tuple[fmpq, fmpq]:
    """Return bounds of clamp(u_eq + q)/u_eq for q between two values, for every u_eq."""
    least, most = model.rest
    u_low, u_high = model.actuator
    lower = max(1 + min(low / least, low / most), u_low / most)
    upper = max(1 + max(high / least, high / most), u_low / least)
    if u_high is not None:
        lower, upper = min(lower, u_high / most), min(upper, u_high / least)
    return rounded_down(lower), rounded_up(upper)


def enclose(model: Deviation, extents: Extents, cell: Cell) -> Force:
    """Return phi/g on a cell.

    phi rises with e and falls with the share, dphi/de falls with e and rises with the share,
    dphi/dshare falls with the share and rises with e: bounds are values at corners.
    """
    X, Q = extents
    a, b = cell.centre
    half_a, half_b = cell.radii
    least, most = model.rest
    force = partial(force_program().evaluate, OPERATORS, constant=exact)
    small, large = _shares(model, b * Q, b * Q)
    first = force(a * X, large)[0]
    last = force(a * X, small)[0]
    small, large = _shares(model, cell.low * Q, cell.high * Q)
    _, steep, strong = force(cell.left * X, large)
    _, flat, weak = force(cell.right * X, small)
    u_low, u_high = model.actuator
    free = least + cell.low * Q >= u_low and (u_high is None or most + cell.high * Q <= u_high)
    held = most + cell.high * Q <= u_low or (u_high is not None and least + cell.low * Q >= u_high)
    by_e = rounded_down(flat * X), rounded_up(steep * X)
    by_q = (
        rounded_down(fmpq(0) if held else strong * Q / least),
        rounded_up(weak * Q / most if free else fmpq(0)),
    )
    low, high = rounded_down(first), rounded_up(last)
    spread = (by_e[1] - by_e[0]) * half_a + (by_q[1] - by_q[0]) * half_b
    return Force((low, high), by_e, by_q, (high - low + spread) / 2)


def rounded_down(x: fmpq, grain: fmpq = GRAIN) -> fmpq:
    """Return the largest multiple of `grain` that is not above x."""
    return (x / grain).floor() * grain


def rounded_up(x: fmpq, grain: fmpq = GRAIN) -> fmpq:
    """Return the least multiple of `grain` that is not below x."""
    return (x / grain).ceil() * grain
