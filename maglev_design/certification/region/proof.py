"""The exact check that V = z'P z falls along every motion of the loop inside {V <= level}.

With z' = A z + b phi, phi = phi(e, q), the derivative of V is, for given e and q, a quadratic in
the remaining states f of z. Inside the set, for any lambda >= 0,

    V' <= V' + lambda (level - V) <= max over f of the same = s'S s + lambda level,

s = (e, q, phi), S the Schur complement that eliminates f (the maximum exists because the block of
f is negative definite, which is checked). What is left is a scalar inequality over the plane of
(e, q), G(e, q) < 0: it is bounded above on cells of that plane, each of which is bisected until the
bound is negative or the whole cell is seen to lie outside the set. On the cells that contain the
origin, where G vanishes, phi = a e + b q with slopes a, b in intervals (mean value theorem) makes
s'S s a form in (e, q), convex in (a, b): it is negative if it is at the four corners.

Every number is a fraction and every rounding is outward. Where anti-windup may freeze the
integrator, A may be either of two matrices; a cell that touches the switching line is proved for
both, and so for every mixture of them (Filippov).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from flint import fmpq, fmpq_mat
from numpy.typing import NDArray

from maglev_design.certification.region.cells import (
    FROZEN,
    RUNNING,
    Cell,
    Extents,
    Force,
    enclose,
    modes,
    rounded_up,
)
from maglev_design.certification.region.model import E_ROW, Q_ROW, V_ROW, Deviation, root_above

SMALLEST_CELL = fmpq(1, 2**12)
"""Side at which a cell is given up, as a share of the set's extent."""
MOST_CELLS = 60_000
"""Cells after which a proof is given up."""
MULTIPLIERS = (fmpq(0), *(fmpq(k * 2**n, 16) for n in range(12) for k in (2, 3)))
"""Values of lambda tried, in units of the pace handed in."""
EXTENT_GRAIN = fmpq(1, 2**16)
"""What the extents of the set are rounded up to, so that the cells' numbers are short."""
DIGITS = 36
"""Binary digits kept of the entries of S, relative to the largest, rounded upward as a form."""


class RegionVerdict(enum.Enum):
    """What the check found; the value is a sentence with the remedy."""

    PROVED = "V falls along every motion inside the set; the ball stays within the rig's limits."
    NOT_POSITIVE = "V is no positive definite form: hand in another P."
    LIMIT = "The set reaches beyond a limit of the rig: lower the level."
    NOT_FALLING = "V' < 0 could not be proved in the whole set: lower the level."


@dataclass(frozen=True)
class RegionCheck:
    """What :func:`check` found.

    Attributes
    ----------
    verdict : RegionVerdict
    cells : int
        Cells whose inequality was shown.
    limit : str
        Name of the limit that is passed, or "".
    place : tuple of float or None
        (e [m], q [V]) where the inequality could not be shown.
    """

    verdict: RegionVerdict
    cells: int = 0
    limit: str = ""
    place: tuple[float, float] | None = None

    @property
    def proved(self) -> bool:
        """Whether the set is guaranteed."""
        return self.verdict is RegionVerdict.PROVED


Array = NDArray[np.float64]
Form = tuple[tuple[fmpq, ...], ...]


def check(model: Deviation, P: fmpq_mat, level: fmpq, pace: fmpq) -> RegionCheck:
    """Prove that {z'P z <= level} is invariant and that V falls to zero in it, or say why not.

    Parameters
    ----------
    model : Deviation
    P : fmpq_mat, shape (n, n)
        Symmetric.
    level : fmpq
    pace : fmpq
        [1/s] Unit of the multipliers lambda; the decay rate of the linear loop is a good one. No
        choice of it can make a wrong claim pass.
    """
    P = P / level
    if P.transpose() != P or not positive_definite(P):
        return RegionCheck(RegionVerdict.NOT_POSITIVE)
    inverse = P.inv()
    for limit in model.limits:
        row = fmpq_mat([limit.row])
        if (row * inverse * row.transpose())[0, 0] >= limit.margin**2:
            return RegionCheck(RegionVerdict.LIMIT, limit=limit.name)
    E, Q = (root_above(inverse[n, n]) for n in (E_ROW, Q_ROW))
    extents = rounded_up(E / model.distance, EXTENT_GRAIN), rounded_up(Q, EXTENT_GRAIN)
    if extents[0] >= 1:
        return RegionCheck(RegionVerdict.LIMIT, limit="gap")
    plane = Plane(model, P, extents, pace)
    (p, o), (_, r) = plane.shadow
    if p <= 0 or p * r <= o**2:
        return RegionCheck(RegionVerdict.NOT_POSITIVE)
    if not plane.falls_at_centre():
        return RegionCheck(RegionVerdict.NOT_FALLING, place=(0.0, 0.0))
    return _cover(plane)


def _cover(plane: Plane) -> RegionCheck:
    """Bisect the plane until every cell is shown; give up at the first that cannot be."""
    one = fmpq(1)
    waiting, shown = [Cell(-one, one, -one, one)], 0
    while waiting:
        cell = waiting.pop()
        if plane.outside(cell):
            shown += 1
            continue
        force = enclose(plane.model, plane.extents, cell)
        if plane.falls(cell, force):
            shown += 1
        elif min(cell.radii) < SMALLEST_CELL or shown > MOST_CELLS or plane.hopeless(cell, force):
            a, b = cell.centre
            X, Q = plane.extents
            place = float(a * X * plane.model.distance), float(b * Q)
            return RegionCheck(RegionVerdict.NOT_FALLING, shown, place=place)
        else:
            waiting.extend(cell.halves())
    return RegionCheck(RegionVerdict.PROVED, shown)


@dataclass(frozen=True)
class Plane:
    """The scalar inequality G(e, q) < 0 on {V <= 1}.

    `extents` are those of e/(r + y0) and of q [V], short numbers; cells are in their units.
    """

    model: Deviation
    P: fmpq_mat
    extents: Extents
    pace: fmpq

    @cached_property
    def forms(self) -> tuple[tuple[Form, ...], tuple[Form, ...]]:
        """Upper bounds of S for every multiplier, while the integrator is frozen and runs."""
        found = {
            mode: tuple(upper_form(self._eliminated(A, x * self.pace)) for x in MULTIPLIERS)
            for mode, A in ((FROZEN, self.model.frozen), (RUNNING, self.model.running))
        }
        return found[FROZEN], found[RUNNING]

    @cached_property
    def floats(self) -> Array:
        """The forms for the choice of a multiplier, shape (2, multipliers, 3, 3)."""
        return np.array(self.forms, dtype=float)

    @cached_property
    def lambdas(self) -> Array:
        """The multipliers as floats."""
        return np.array([float(m * self.pace) for m in MULTIPLIERS])

    @cached_property
    def shadow(self) -> Form:
        """A lower bound of the form whose unit disc is the projection of the set."""
        return tuple(tuple(-x for x in row) for row in upper_form(-_schur(self.P, 2, self._units)))

    @property
    def _units(self) -> tuple[fmpq, fmpq]:
        X, Q = self.extents
        return X * self.model.distance, Q

    def _quadratic(self, A: fmpq_mat, multiplier: fmpq) -> fmpq_mat:
        """Return V' - lambda V as a form in (e, q, phi, f)."""
        n = self.model.order
        rate = self.P * A + A.transpose() * self.P - multiplier * self.P
        whole = fmpq_mat(n + 1, n + 1)
        places = [0, 1, *range(3, n + 1)]
        for i, j in product(range(n), repeat=2):
            whole[places[i], places[j]] = rate[i, j]
        for i in range(n):
            whole[2, places[i]] = whole[places[i], 2] = self.P[V_ROW, i]
        return whole

    def _eliminated(self, A: fmpq_mat, multiplier: fmpq) -> fmpq_mat:
        units = (*self._units, self.model.gravity)
        return _schur(self._quadratic(A, multiplier), 3, units)

    def falls_at_centre(self) -> bool:
        """Return whether V' < 0 where e = q = 0: what makes the maximum over f exist."""
        others = range(3, self.model.order + 1)
        forms = (self._quadratic(A, fmpq(0)) for A in (self.model.running, self.model.frozen))
        return all(positive_definite(-_block(form, others, others)) for form in forms)

    def outside(self, cell: Cell) -> bool:
        """Return whether no point of the set projects into the cell."""
        (p, o), (_, r) = self.shadow
        a, b = cell.centre
        by_a, by_b = p * a + o * b, o * a + r * b
        half_a, half_b = cell.radii
        # convex: at least the tangent at the centre
        return a * by_a + b * by_b - 2 * (abs(by_a) * half_a + abs(by_b) * half_b) > 1

    def falls(self, cell: Cell, force: Force) -> bool:
        """Return whether G < 0 is shown on the whole cell."""
        acting = modes(self.model, self.extents, cell)
        if cell.holds_origin():
            return all(_negative(self.forms[mode][0], force) for mode in acting)
        picks = self._values(cell, force).argmin(axis=1)
        return all(self.bound(cell, force, mode, int(picks[mode])) < 0 for mode in acting)

    def _values(self, cell: Cell, force: Force) -> Array:
        """Return the largest G at the centre for both modes and every multiplier, in floats."""
        ends = [np.array([*cell.centre, phi], dtype=float) for phi in force.centre]
        values: Array = np.maximum(*[self.floats @ s @ s for s in ends]) + self.lambdas
        return values

    def bound(self, cell: Cell, force: Force, mode: int, pick: int) -> fmpq:
        """Return an upper bound of G on the cell, for one of the multipliers."""
        S, multiplier = self.forms[mode][pick], MULTIPLIERS[pick] * self.pace
        s: list[fmpq] = [*cell.centre, force.middle]
        half_a, half_b = cell.radii
        rest = force.rest
        Ss = [sum((x * y for x, y in zip(row, s, strict=True)), fmpq(0)) for row in S]
        a, b = (sum(slopes, fmpq(0)) / 2 for slopes in (force.by_e, force.by_q))
        along_a, along_b = S[0][2] + a * S[2][2], S[1][2] + b * S[2][2]
        first = abs(Ss[0] + a * Ss[2]) * half_a + abs(Ss[1] + b * Ss[2]) * half_b
        mixed = S[0][1] + b * S[0][2] + a * along_b
        second = (
            max(S[0][0] + a * (S[0][2] + along_a), fmpq(0)) * half_a**2
            + max(S[1][1] + b * (S[1][2] + along_b), fmpq(0)) * half_b**2
            + 2 * abs(mixed) * half_a * half_b
        )
        left_over = rest * (
            2 * (abs(Ss[2]) + abs(along_a) * half_a + abs(along_b) * half_b) + S[2][2] * rest
        )
        at_centre = sum((x * y for x, y in zip(s, Ss, strict=True)), multiplier)
        return at_centre + 2 * first + second + left_over

    def hopeless(self, cell: Cell, force: Force) -> bool:
        """Return whether G is positive at the centre, inside the set, whatever the multiplier."""
        a, b = cell.centre
        point = Cell(a, a, b, b)
        s = np.array(cell.centre, dtype=float)
        inside = 0 < s @ np.array(self.shadow, dtype=float) @ s < 1
        values = self._values(cell, force)
        return bool(
            inside
            and any(values[mode].min() > 0 for mode in modes(self.model, self.extents, point))
        )


def _negative(S: Form, force: Force) -> bool:
    """Return whether s'S s < 0 for s = (e, q, a e + b q) but at 0, for all slopes in their box."""
    return all(
        aa < 0 and aa * bb > ab**2
        for aa, ab, bb in (_restricted(S, a, b) for a, b in product(force.by_e, force.by_q))
    )


def _restricted(S: Form, a: fmpq, b: fmpq) -> tuple[fmpq, fmpq, fmpq]:
    """Return the entries of the form in (e, q)."""
    return (
        S[0][0] + a * (2 * S[0][2] + a * S[2][2]),
        S[0][1] + b * S[0][2] + a * (S[1][2] + b * S[2][2]),
        S[1][1] + b * (2 * S[1][2] + b * S[2][2]),
    )


def _block(form: fmpq_mat, rows: range, columns: range) -> fmpq_mat:
    return fmpq_mat([[form[i, j] for j in columns] for i in rows])


def _schur(whole: fmpq_mat, kept: int, units: Sequence[fmpq]) -> fmpq_mat:
    """Return the form left of `whole` when all but the first `kept` variables are extremal."""
    first, others = range(kept), range(kept, whole.nrows())
    cross, rest = _block(whole, first, others), _block(whole, others, others)
    left = _block(whole, first, first) - cross * rest.inv() * cross.transpose()
    return fmpq_mat([[units[i] * left[i, j] * units[j] for j in first] for i in first])


def upper_form(S: fmpq_mat) -> Form:
    """Return a form at least `S` with short entries."""
    largest = max(abs(x) for x in S.entries())
    grain = fmpq(2) ** (math.ceil(math.log2(float(largest))) - DIGITS)
    # entries move by half a grain, so eigenvalues by less than two for up to four variables
    return tuple(
        tuple(round(x / grain) * grain + 2 * grain * (i == j) for j, x in enumerate(row))
        for i, row in enumerate(S.tolist())
    )


def positive_definite(form: fmpq_mat) -> bool:
    """Return whether all leading principal minors of a symmetric matrix are positive."""
    minors = (range(k) for k in range(1, form.nrows() + 1))
    return all(_block(form, minor, minor).det() > 0 for minor in minors)
