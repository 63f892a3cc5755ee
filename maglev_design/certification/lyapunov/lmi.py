"""A common quadratic Lyapunov function by semidefinite programming, then proved without it.

The solver looks for P with 0 < P <= I at which the smallest eigenvalue of the inequalities of
:mod:`maglev_design.certification.lyapunov.exact` is largest; what it returns is rounded to
rationals and counts only if it passes there.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.certification.lyapunov.enclosure import Polytope, enclose
from maglev_design.certification.lyapunov.exact import Matrix, failing, is_positive_definite
from maglev_design.certification.lyapunov.family import (
    CertificateClaim,
    ExactSubject,
    LoopName,
    NotEnclosedError,
    claim,
    scaling,
    state_names,
    subject,
)
from maglev_design.certification.rationals import decimal
from maglev_design.controller.design import Design
from maglev_design.rig import Rig

LOOPS: tuple[LoopName, ...] = ("continuous", "sampled")
SOLVERS = ("CLARABEL", "SCS")
"""In this order; the second where the first has no answer."""
P_GRID = 2**40
"""P is rounded to multiples of 1/P_GRID; its largest eigenvalue is at most 1."""
NO_MARGIN = 1e-7
"""Below this the solver's margin is zero to its tolerance."""
OF_SAMPLING = ("method", "period", "delay")
BETA_STEPS = 1000
"""The largest error of beta is found to one of these parts of 1."""
DECAY_STEPS = 32
"""The largest decay is found to one of these parts of the slowest vertex's."""


class LmiStatus(Enum):
    """Whether there is a certificate, and what to do when there is none."""

    CERTIFIED = "certified: P was verified in exact arithmetic at every vertex"
    UNSTABLE = (
        "not certified: the loop is unstable at a vertex of the family; narrow the gap range or "
        "the error of beta, or change the poles"
    )
    INFEASIBLE = (
        "not certified: every vertex is stable, but the solver finds no single quadratic function "
        "that decreases on the whole family; narrow the gap range or the error of beta (at each "
        "fixed gap the loop may be stable all the same: see the exact interval)"
    )
    ROUNDED_AWAY = (
        "not certified: the solver's P fails the check in exact arithmetic, its margin being too "
        "small; narrow the gap range or the error of beta slightly"
    )
    NOT_ENCLOSED = (
        "not certified: the loop remembers too many delayed voltages, or the ball moves too far "
        "within one period, for the family to be enclosed; sample faster or shorten the delay"
    )
    NO_ANSWER = (
        "not certified: neither Clarabel nor SCS returned a solution; narrow the gap range or the "
        "error of beta, or choose slower poles"
    )


@dataclass(frozen=True)
class LmiCertificate:
    """What is claimed of one loop, and P when it was proved.

    Attributes
    ----------
    subject : ExactSubject
        Exact numbers of rig and controller.
    claim : CertificateClaim
    status : LmiStatus
    scale : tuple of Fraction
        S; P belongs to the states S x, all in metres. Empty when the family was not enclosed.
    polytope : Polytope
        Its vertices belong to the states S x, too.
    P : matrix of Fraction or None
    decay : Fraction
        a [1/s]: sqrt(x' S P S x) falls at least as exp(-a t).
    solver : str or None
        That found P.
    largest_beta_error : Fraction or None
        Largest u whose ratios [1 - u, 1 + u] were certified over the same gaps; None where it was
        not looked for.
    widest : LmiCertificate or None
        The certificate of that u.
    """

    subject: ExactSubject
    claim: CertificateClaim
    status: LmiStatus
    scale: tuple[Fraction, ...]
    polytope: Polytope
    P: Matrix | None = None
    decay: Fraction = Fraction(0)
    solver: str | None = None
    largest_beta_error: Fraction | None = None
    widest: LmiCertificate | None = None

    @property
    def certified(self) -> bool:
        """Whether P exists and was verified exactly."""
        return self.status is LmiStatus.CERTIFIED

    @property
    def period(self) -> Fraction | None:
        """T [s] of the sampled loop, None for the continuous one."""
        return self.subject.period if self.claim.loop == "sampled" else None

    def verified(self) -> bool:
        """Check the inequalities again, exactly and without the solver."""
        return (
            self.P is not None
            and self.decay >= 0
            and is_positive_definite(self.P)
            and not failing(
                self.polytope.vertices,
                self.P,
                decay=self.decay,
                remainder=self.polytope.remainder,
                period=self.period,
            )
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate for JSON: exact rationals as strings."""
        of, over = self.subject, self.claim
        sampled = over.loop == "sampled"
        return {
            "loop": over.loop,
            "certified": self.certified,
            "exact": self.certified,
            "status": self.status.value,
            "controller_sha256": of.sha256,
            "family": {
                **{x: list(map(str, getattr(over, x))) for x in ("gaps", "ratios", "shifts")},
                "voltage_held": over.held,
                **{x: str(getattr(of, x)) if sampled else None for x in OF_SAMPLING},
            },
            "states": list(state_names(of, over.loop)) if self.scale else [],
            "scaling": [str(x) for x in self.scale],
            "vertices": [as_strings(vertex) for vertex in self.polytope.vertices],
            "remainder": str(self.polytope.remainder),
            "P": None if self.P is None else as_strings(self.P),
            "decay": float(self.decay),
            "decay_exact": str(self.decay),
            "solver": self.solver,
            "largest_beta_error": (
                None if self.largest_beta_error is None else float(self.largest_beta_error)
            ),
        }


def as_strings(matrix: Matrix) -> list[list[str]]:
    """Return the entries as "p/q"."""
    return [[str(x) for x in row] for row in matrix]


def certify_family(
    design: Design,
    rig: Rig,
    *,
    beta_error: Fraction | float | None = None,
    gap_range: tuple[float, float] | None = None,
    bisect: bool = True,
    loops: Sequence[LoopName] = LOOPS,
) -> tuple[LmiCertificate, ...]:
    """Return one certificate for each of `loops`, found or refused.

    Parameters
    ----------
    design : Design
        Of TAN-GPI, with any gains.
    rig : Rig
        The design's.
    beta_error : number, optional
        u, ratios in [1 - u, 1 + u]; default: what the rig's file says for the design's reading.
    gap_range : tuple of float, optional
        [m]; default: the hull of path, initial gap and Y.
    bisect : bool
        Whether the largest decay and the largest u are looked for.

    Raises
    ------
    InputError
        For a family that is impossible or a design that does not belong to the rig.
    """
    exact = decimal(beta_error) if isinstance(beta_error, float | int) else beta_error
    of = subject(design, rig)
    return tuple(
        _certify(of, claim(rig, loop, exact, gap_range, design.equilibrium), bisect=bisect)
        for loop in loops
    )


def certify_sampled(
    design: Design, rig: Rig, *, beta_error: Fraction | float | None = None
) -> LmiCertificate:
    """Return the sampled loop's certificate by one solution of the LMI, nothing bisected.

    What `tune --certify` asks of a candidate; ``certified`` is the answer.
    """
    (found,) = certify_family(design, rig, beta_error=beta_error, bisect=False, loops=("sampled",))
    return found


def widest_sampled(
    design: Design, rig: Rig, *, gap_range: tuple[float, float] | None = None
) -> LmiCertificate | None:
    """Return the sampled loop's certificate of the largest error of beta; None where none is.

    The abscissa of `tune --pareto`.
    """
    of = subject(design, rig)
    over = claim(rig, "sampled", Fraction(0), gap_range, design.equilibrium)
    return _widest(of, over, attempt(of, over))


def _certify(of: ExactSubject, over: CertificateClaim, *, bisect: bool) -> LmiCertificate:
    plain = attempt(of, over)
    if not bisect or plain.status is LmiStatus.NOT_ENCLOSED:
        return plain
    widest = _widest(of, over, plain)
    best = _fastest(plain) if plain.certified else plain
    if widest is None:
        return best
    return replace(best, largest_beta_error=_error(widest.claim), widest=widest)


def attempt(
    of: ExactSubject, over: CertificateClaim, decay: Fraction = Fraction(0)
) -> LmiCertificate:
    """Return the certificate of a claim with at least the given decay, found or refused."""
    try:
        scale = scaling(of, over.loop)
        around = enclose(of, over, scale)
    except NotEnclosedError:
        return LmiCertificate(of, over, LmiStatus.NOT_ENCLOSED, (), Polytope((), Fraction(0)))
    start = LmiCertificate(of, over, LmiStatus.NO_ANSWER, scale, around)
    return _solved(start, decay)


def _solved(start: LmiCertificate, decay: Fraction) -> LmiCertificate:
    """Return `start` with its P for a decay: solve, round, verify."""
    start = replace(start, decay=decay, status=LmiStatus.NO_ANSWER, P=None, solver=None)
    if slowest(start) <= float(decay):
        return replace(start, status=LmiStatus.UNSTABLE)
    status = LmiStatus.NO_ANSWER
    for solver in SOLVERS:
        answer = _solve(start, solver)
        if answer is None:
            continue
        found, margin = answer
        trial = replace(start, P=_rational(found), status=LmiStatus.CERTIFIED, solver=solver)
        if trial.verified():
            return trial
        if margin < NO_MARGIN:
            return replace(start, status=LmiStatus.INFEASIBLE)
        status = LmiStatus.ROUNDED_AWAY
    return replace(start, status=status)


def slowest(certificate: LmiCertificate) -> float:
    """Return the smallest decay [1/s] of a vertex by itself, in floating point; 0 or less: none.

    No common P can give more: -max Re lambda, or for the sampled loop (1 - |lambda|^2)/(2T).
    """
    values = np.linalg.eigvals(_floats(certificate.polytope.vertices))
    if certificate.period is None:
        return float(-values.real.max())
    return float((1 - np.abs(values).max() ** 2) / (2 * float(certificate.period)))


def _solve(start: LmiCertificate, solver: str) -> tuple[NDArray[np.float64], float] | None:
    """Return (P, its margin), or None when the solver gives up.

    The inequalities are divided by omega, or by 2 omega T, so that their margin is comparable
    with P's.
    """
    import cvxpy as cp  # noqa: PLC0415 - heavy, and needed only here

    vertices = _floats(start.polytope.vertices)
    size, decay, omega = vertices.shape[1], float(start.decay), 1 / float(start.scale[1])
    unit = np.eye(size)
    P, margin = cp.Variable((size, size), symmetric=True), cp.Variable()
    constraints = [P << unit, P >> margin * unit]
    for A in vertices:
        if start.period is None:
            slack = -(A.T @ P + P @ A + 2 * decay * P) / omega
        else:
            period = float(start.period)
            slack = ((1 - 2 * decay * period) * P - A.T @ P @ A) / (2 * omega * period)
        constraints.append((slack + slack.T) / 2 >> margin * unit)
    problem = cp.Problem(cp.Maximize(margin), constraints)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # inaccurate solutions: the exact check decides
            problem.solve(solver=solver)
    except cp.error.SolverError:
        return None
    if P.value is None or not np.isfinite(P.value).all():
        return None
    return P.value, float(margin.value)


def _floats(matrices: Sequence[Matrix]) -> NDArray[np.float64]:
    return np.array([[[float(x) for x in row] for row in m] for m in matrices])


def _rational(P: NDArray[np.float64]) -> Matrix:
    """Return P symmetric, rounded to multiples of 1/P_GRID."""
    half = (P + P.T) / 2
    return tuple(tuple(Fraction(round(float(x) * P_GRID), P_GRID) for x in row) for row in half)


def _fastest(known: LmiCertificate) -> LmiCertificate:
    """Return the certificate of the largest decay, by bisection from one without."""
    top = Fraction(slowest(known)).limit_denominator(100)
    return _bisected(known, DECAY_STEPS, lambda k: _solved(known, top * k / DECAY_STEPS))


def _widest(
    of: ExactSubject, over: CertificateClaim, known: LmiCertificate
) -> LmiCertificate | None:
    """Return the certificate of the largest error of beta, by bisection; None where none is."""

    def at(k: int) -> LmiCertificate:
        u = Fraction(k, BETA_STEPS)
        return attempt(of, replace(over, ratios=(1 - u, 1 + u)))

    u = _error(over)
    if known.certified:
        return _bisected(known, BETA_STEPS, at, int(u * BETA_STEPS))
    if u == 0:
        return None
    centre = at(0)
    return _bisected(centre, int(u * BETA_STEPS) + 1, at) if centre.certified else None


def _error(over: CertificateClaim) -> Fraction:
    """Return the largest u whose ratios [1 - u, 1 + u] lie in a claim's."""
    return min(1 - over.ratios[0], over.ratios[1] - 1)


def _bisected(
    known: LmiCertificate, top: int, at: Callable[[int], LmiCertificate], bottom: int = 0
) -> LmiCertificate:
    """Return the certificate of the largest k in [bottom, top) that was found; `known` is first."""
    while top - bottom > 1:
        middle = (bottom + top) // 2
        trial = at(middle)
        if trial.certified:
            known, bottom = trial, middle
        else:
            top = middle
    return known
