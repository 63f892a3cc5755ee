"""The search for a quadratic form whose guaranteed set is large; nothing here is trusted.

A semidefinite programme in P, solved again and again while the set grows. For a point (e, q) of an
ellipse the condition of :mod:`maglev_design.certification.region.proof`, V' + lambda (1 - V) <= 0
for all the other states f, is a linear matrix inequality in P once lambda is fixed; {V <= 1}
projects into the ellipse if P is at least the ellipse's matrix. The objective is V at a start from
rest. Each solution's own projection, enlarged, is the ellipse of the next programme. States are
scaled, so that all are of one size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from maglev_design.certification.region.model import V_ROW, Deviation, force_program

Array = NDArray[np.float64]

ROUNDS, PATIENCE = 40, 5
"""Programmes solved at most, and without a better set before the search ends."""
GROWTH = 1.3
"""Factor between a solution's projection and the next ellipse."""
FIRST = 0.01
"""Half axis of the first ellipse along e, as a share of the gap; halved until there is a P."""
DECAY = 0.02
"""Decay rate demanded of V near the rest, over that of the linear loop."""
STEEPNESS, POWER = 3.0, 1.5
"""lambda = STEEPNESS times the loop's decay rate times the squared radius in the ellipse to POWER.

Zero at the rest, where V' vanishes, and large at the ellipse's edge, beyond which nothing is asked.
"""
CENTRE = 0.02
"""Radius in the ellipse below which lambda is zero."""
DIRECTIONS, RINGS = 20, (CENTRE, 0.25, 0.5, 0.75, 1.0)
"""Points of a programme."""
JUDGED, JUDGED_RINGS = 72, (CENTRE, *np.linspace(0.1, 1.0, 15))
"""Points at which a solution is judged."""
FINE, FINE_RINGS = 360, (CENTRE, *np.linspace(0.1, 1.0, 60))
"""Points at which the last one is judged."""
MULTIPLIERS = np.concatenate([[0.0], np.geomspace(0.1, 200.0, 24)])
"""Values of lambda with which a solution is judged, over the loop's decay rate."""
SOLVED = ("Solved", "AlmostSolved")


@dataclass(frozen=True)
class FoundForm:
    """A form, the level that it seems to allow and its reach from rest.

    Attributes
    ----------
    P : array, shape (n, n)
        In SI units of z.
    level : float
    reach : float
        Smaller half width in e of the starts at rest, over the ends of the ratios [m].
    pace : float
        Decay rate of the linear loop [1/s].
    """

    P: Array
    level: float
    reach: float
    pace: float


def find_form(model: Deviation) -> FoundForm | None:
    """Return the form with the largest reach from rest that was found; None if there is none."""
    loop = _scaled(model)
    if loop.pace <= 0:
        return None
    best: FoundForm | None = None
    projection, growth, idle = np.eye(2), 1.0, 0
    for _ in range(ROUNDS):
        form = _programme(loop, projection / growth**2)
        if form is None:  # too large an ellipse
            growth = growth / 2 if best is None else 1 + (growth - 1) / 2
            continue
        level = _level(loop, form)
        reach = _reach(loop, form, level)
        if best is None:
            growth = GROWTH
        idle = 0 if best is None or best.reach == 0 or reach > 1.01 * best.reach else idle + 1
        if best is None or reach >= best.reach:
            scale = np.diag(1 / loop.sizes)
            best = FoundForm(scale @ form @ scale, level, reach, loop.pace)
        if idle > PATIENCE:
            break
        projection = _projection(form)
    if best is None or best.level == 0:
        return None
    scale = np.diag(loop.sizes)
    return replace(best, level=_level(loop, scale @ best.P @ scale, FINE, FINE_RINGS))


@dataclass(frozen=True)
class _Scaled:
    """A :class:`Deviation` in floats, z over `sizes`."""

    model: Deviation
    sizes: Array
    running: Array
    frozen: Array
    push: Array
    pace: float
    limits: Array
    starts: Array
    lift: Array

    @property
    def order(self) -> int:
        return len(self.sizes)

    def ends(self, points: Array) -> list[tuple[Array, NDArray[np.bool_]]]:
        """Return phi and whether the integrator is frozen at (e, q), for the ends of u_eq."""
        e, q = (points * self.sizes[:2]).T
        low, high = (np.inf if x is None else float(x) for x in self.model.actuator)
        found = []
        for rest in dict.fromkeys(float(x) for x in self.model.rest):
            share = np.clip(1 + q / rest, low / rest, high / rest)
            frozen = ((rest + q > high) & (e > 0)) | ((rest + q < low) & (e < 0))
            phi, *_ = force_program().numpy()(e / float(self.model.distance), share)
            found.append((float(self.model.gravity) * phi, frozen))
        return found


def _scaled(model: Deviation) -> _Scaled:
    running, frozen = (np.array(A.tolist(), dtype=float) for A in (model.running, model.frozen))
    rests = [float(x) for x in model.rest]
    gravity, distance = float(model.gravity), float(model.distance)
    _, by_x, by_share = force_program().numpy()(0.0, 1.0)
    linear = running.copy()
    linear[V_ROW, :2] += gravity * by_x / distance, gravity * by_share / rests[0]
    poles = np.linalg.eigvals(linear)
    e = FIRST * distance
    speed, slope = float(np.abs(poles).max()), float(model.slope)
    lags = [e / abs(running[n, n]) for n in range(V_ROW + 1, model.order)]
    sizes = np.array([e, abs(slope) * e, speed * e, *lags])
    limits = [np.array(x.row, dtype=float) * sizes / float(x.margin) for x in model.limits]
    lift = np.zeros(model.order)
    lift[:2] = e, slope * e
    starts = np.zeros((len(rests), model.order))
    starts[:, 1] = [float(model.feedforward) - rest for rest in rests]
    return _Scaled(
        model=model,
        sizes=sizes,
        running=running * sizes / sizes[:, None],
        frozen=frozen * sizes / sizes[:, None],
        push=np.eye(model.order)[V_ROW] / sizes[V_ROW],
        pace=-float(poles.real.max()),
        limits=np.array(limits),
        starts=starts / sizes,
        lift=lift / sizes,
    )


def _polar(ellipse: Array, directions: int, radii: tuple[float, ...]) -> Array:
    """Return points of {s'W s <= 1}, shape (n, 2)."""
    angles = np.linspace(0, 2 * np.pi, directions, endpoint=False)
    radius, angle = (x.ravel() for x in np.meshgrid(radii, angles, indexing="ij"))
    circle = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    points: Array = circle @ np.linalg.cholesky(np.linalg.inv(ellipse)).T
    return points


def _vectors(matrices: Array) -> Array:
    """Return symmetric matrices as the vectors whose scalar product is the trace product."""
    size = matrices.shape[-1]
    entries = [(i, j) for j in range(size) for i in range(j + 1)]
    return np.stack([matrices[..., i, j] * (1 if i == j else 2**0.5) for i, j in entries], axis=-1)


def _basis(order: int) -> Array:
    """Return the symmetric matrices with one entry (and its mirror image) equal to 1."""
    found = []
    for i in range(order):
        for j in range(i, order):
            unit = np.zeros((order, order))
            unit[i, j] = unit[j, i] = 1
            found.append(unit)
    return np.array(found)


def _programme(loop: _Scaled, ellipse: Array) -> Array | None:
    """Return the P with the least V at a start from rest whose set lies in the ellipse."""
    import clarabel  # noqa: PLC0415 - needed only here

    order, basis = loop.order, _basis(loop.order)
    points = _polar(ellipse, DIRECTIONS, RINGS)
    radius = np.einsum("ni,ij,nj->n", points, ellipse, points)
    multiplier = STEEPNESS * loop.pace * radius**POWER
    multiplier[radius < 2 * CENTRE**2] = 0.0
    length = np.linalg.norm(points, axis=1)
    # z = (point/length) t + f, and the inequality as a form in (t, f)
    span = np.zeros((len(points), order, order - 1))
    span[:, :2, 0] = points / length[:, None]
    span[:, 2:, 1:] = np.eye(order - 2)
    level = np.zeros((len(points), order - 1, order - 1))
    level[:, 0, 0] = multiplier / length**2
    size = 1 / np.maximum(multiplier, loop.pace)[:, None]
    own = np.einsum("pia,kij,pjb->kpab", span, basis, span)
    rows, right, cones = [], [], []
    for phi, frozen in loop.ends(points):
        moved = np.where(frozen[:, None, None], loop.frozen, loop.running) @ span
        moved[:, :, 0] += (phi / length)[:, None] * loop.push
        rate = np.einsum("pia,kij,pjb->kpab", span, basis, moved)
        rate = rate + np.swapaxes(rate, -1, -2)
        whole = rate + (DECAY * loop.pace - multiplier)[:, None, None] * own
        rows.append((_vectors(whole) * size).reshape(len(basis), -1).T)
        right.append(-(_vectors(level) * size).ravel())
        cones += [clarabel.PSDTriangleConeT(order - 1)] * len(points)
    inside = np.zeros((order, order))
    inside[:2, :2] = ellipse
    for bound in (inside, *[np.outer(row, row) for row in loop.limits]):
        rows.append(-_vectors(basis).T)
        right.append(-_vectors(bound))
        cones.append(clarabel.PSDTriangleConeT(order))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((len(basis), len(basis))),
        np.einsum("i,kij,j->k", loop.lift, basis, loop.lift),
        sparse.csc_matrix(np.vstack(rows)),
        np.concatenate(right),
        cones,
        settings,
    )
    solution = solver.solve()
    if str(solution.status) not in SOLVED:
        return None
    found: Array = np.einsum("k,kij->ij", np.array(solution.x), basis)
    return found


def _projection(P: Array) -> Array:
    """Return the matrix of the ellipse into which {z'P z <= 1} projects in (e, q)."""
    whole: Array = P[:2, :2] - P[:2, 2:] @ np.linalg.solve(P[2:, 2:], P[2:, :2])
    return whole


def _level(
    loop: _Scaled,
    P: Array,
    directions: int = JUDGED,
    radii: tuple[float, ...] = JUDGED_RINGS,
) -> float:
    """Return the largest level at which the judged points satisfy the inequality."""
    rates = [P @ A + A.T @ P for A in (loop.frozen, loop.running)]
    if np.linalg.eigvalsh(P).min() <= 0 or np.linalg.eigvalsh(rates[1][2:, 2:]).max() >= 0:
        return 0.0
    multipliers = MULTIPLIERS * loop.pace
    forms = np.array([_eliminated(loop, P, rate, multipliers) for rate in rates])
    unit = _polar(_projection(P), directions, radii)

    def allowed(level: float) -> bool:
        points = unit * level**0.5
        worst = np.full((len(points), len(multipliers)), -np.inf)
        for phi, frozen in loop.ends(points):  # one multiplier for both ends, as in the proof
            s = np.column_stack([points, phi])
            products = (s[:, :, None] * s[:, None, :]).reshape(-1, 9)
            values = products @ forms.reshape(2, -1, 9).swapaxes(1, 2) + multipliers * level
            worst = np.maximum(worst, np.where(frozen[:, None], *values))
        return bool((worst.min(axis=1) < 0).all())

    inverse = np.linalg.inv(P)
    high = min([4.0, *[1 / float(row @ inverse @ row) for row in loop.limits]])
    return _bisect(allowed, 1e-6, high)


def _bisect(allowed: Callable[[float], bool], low: float, high: float) -> float:
    """Return about the largest allowed value, on a logarithmic scale; 0 if `low` is not."""
    if not allowed(low):
        return 0.0
    for _ in range(14):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low


def _eliminated(loop: _Scaled, P: Array, rate: Array, multipliers: Array) -> Array:
    """Return the forms in (e, q, phi) of the proof, in floats, shape (multipliers, 3, 3)."""
    order = loop.order
    places = [0, 1, *range(3, order + 1)]
    whole = np.zeros((len(multipliers), order + 1, order + 1))
    every = range(len(multipliers))
    whole[np.ix_(every, places, places)] = rate - multipliers[:, None, None] * P
    whole[:, 2, places] = whole[:, places, 2] = P @ loop.push
    cross = whole[:, :3, 3:]
    rest = np.linalg.solve(whole[:, 3:, 3:], np.swapaxes(cross, 1, 2))
    found: Array = whole[:, :3, :3] - cross @ rest
    return found


def _reach(loop: _Scaled, P: Array, level: float) -> float:
    """Return the smaller half width in e [m] of the starts at rest, over the ends of u_eq."""
    own = float(loop.lift @ P @ loop.lift)
    found = []
    for start in loop.starts:
        along = float(loop.lift @ P @ start)
        square = along**2 - own * (float(start @ P @ start) - level)
        found.append((max(square, 0.0) ** 0.5 - abs(along)) / own)
    return float(loop.sizes[0] * max(min(found), 0.0))
