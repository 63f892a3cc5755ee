"""The linear loop in numbers, apart from the symbols: what the proofs are checked against.

The law (20) is run line by line as the paper prints it, the bounded law from its state space; the
disturbances are states of their own, so that one matrix exponential gives the exact answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.linalg import expm

from maglev_design.controller import design
from maglev_design.controller.believed import Believed
from maglev_design.controller.design import PAPER_POLES, PoleSpec
from maglev_design.lowering import lower
from maglev_design.options import Equilibrium
from maglev_design.paper.ledger import Verdict
from maglev_design.paper.rigs import random_poles
from maglev_design.programs import gains_program
from maglev_design.rig import Rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import stability
from maglev_design.symbolic.laws import tan_gpi

Array = NDArray[np.float64]
Numbers = Callable[..., tuple[float, ...]]

AGREES = 1e-8
"""Relative; the exponential of matrices with entries from 1 to 1e8 keeps more."""
SETTLED = 60.0
"""Time constants of the slowest pole after which a transient is below the rounding."""
POLES_SEED = 21
"""Of the pole pairs that the random rigs are given."""


@dataclass(frozen=True)
class TriedRig:
    """A rig with the poles of its controller."""

    rig: Rig
    poles: PoleSpec

    @property
    def gaps(self) -> tuple[float, float, float]:
        """Y and both ends of the path [m]."""
        path = self.rig.reference
        return self.rig.operating_point.gap, path.start_gap, path.end_gap

    @property
    def step(self) -> float:
        """End of the path minus Y [m]; a tenth of Y where the path ends at Y."""
        own, _, end = self.gaps
        return end - own or own / 10


@dataclass(frozen=True)
class Tally:
    """On how many rigs a statement was tried and on how many it was found true."""

    tried: int
    agreed: int

    @property
    def unanimous(self) -> bool:
        """Whether no rig disagrees."""
        return self.agreed == self.tried

    @property
    def counts(self) -> dict[str, int]:
        """Both numbers by their names in the values of a claim."""
        return {"rigs": self.tried, "agreed": self.agreed}

    def says(self, method: str) -> str:
        """Return the sentence of the evidence."""
        return f"{method}: {self.agreed} of {self.tried} rigs agree."


def refuted(*, proof: bool, numbers: Tally) -> Verdict | bool:
    """Return whether a statement holds that a proof and the rigs speak against, or both do not.

    Where they disagree with each other nothing is decided.
    """
    return not proof if proof == numbers.unanimous else "not-checkable"


def tried_rigs(rig: Rig, rigs: Sequence[Rig]) -> tuple[TriedRig, ...]:
    """Return `rig` with the paper's poles, the others with random ones.

    A measured voltage is left aside: where a claim speaks of one, it means the plant's own.
    """
    pairs = random_poles(len(rigs), POLES_SEED)
    others = (
        TriedRig(_unmeasured(x), PoleSpec.double(zeta, speed * math.sqrt(_true(x, None).C_Y)))
        for x, (zeta, speed) in zip(rigs, pairs, strict=True)
    )
    return TriedRig(_unmeasured(rig), PoleSpec.double(*PAPER_POLES)), *others


def _unmeasured(rig: Rig) -> Rig:
    point = rig.operating_point.model_copy(update={"voltage": None})
    return rig.model_copy(update={"operating_point": point})


def tally(tried: Sequence[TriedRig], check: Callable[[TriedRig], bool]) -> Tally:
    """Return on how many of the cases `check` holds."""
    return Tally(len(tried), sum(bool(check(case)) for case in tried))


PRINTED_STATES = ("y_d", "v_d", "int(u_d)", "int(y_d)", "int(e)", "int(int(e))")
"""Of the loop with (20) as printed."""


@dataclass(frozen=True)
class LinearLoop:
    """Plant at one gap and controller, in numbers.

    Attributes
    ----------
    c_u, c_y : float
        The plant's coefficients at the gap [m/(s^2 V)], [1/s^2].
    c_u_hat, c_y_hat : float
        What the controller believes.
    gains : tuple of float
        (k0, k1, k2, k3).
    """

    c_u: float
    c_y: float
    c_u_hat: float
    c_y_hat: float
    gains: tuple[float, float, float, float]

    @property
    def rho(self) -> float:
        """C_U'/C_U^."""
        return self.c_u / self.c_u_hat

    @property
    def letters(self) -> dict[sp.Symbol, float]:
        """Every number by its letter in the derivation."""
        letters = (p.C_U, p.C_Y, p.C_U_hat, p.C_Y_hat, p.k0, p.k1, p.k2, p.k3, p.rho)
        numbers = (self.c_u, self.c_y, self.c_u_hat, self.c_y_hat, *self.gains, self.rho)
        return dict(zip(letters, numbers, strict=True))

    @property
    def stable(self) -> bool:
        """Whether the loop with the two-state law is."""
        return is_stable(self.bounded)

    @property
    def bounded(self) -> Array:
        """Return the loop with the two-state law, in (e, e', x1, x2)."""
        numbers = _core()(self.c_u_hat, self.c_y_hat, *self.gains)
        a, b, c, through = (
            np.array(numbers[:4]).reshape(2, 2),
            numbers[4:6],
            numbers[6:8],
            numbers[8],
        )
        matrix = np.zeros((4, 4))
        matrix[0, 1] = 1.0
        matrix[1] = [self.c_y - self.c_u * through, 0.0, -self.c_u * c[0], -self.c_u * c[1]]
        matrix[2:, 0], matrix[2:, 2:] = b, a
        return matrix

    @property
    def printed(self) -> tuple[Array, Array]:
        """Return the loop with (20) as printed in :data:`PRINTED_STATES`, and its reference column.

        The column is what a constant incremental reference gap adds to the rates.
        """
        k0, k1, k2, k3 = self.gains
        voltage = np.array(
            [k2 + self.c_y_hat, 0.0, -k3 * self.c_u_hat, k3 * self.c_y_hat, k1, k0], dtype=float
        )
        voltage /= self.c_u_hat
        from_reference = (self.c_y_hat - (k2 + self.c_y_hat)) / self.c_u_hat
        matrix, column = np.zeros((6, 6)), np.zeros(6)
        matrix[0, 1] = matrix[3, 0] = matrix[4, 0] = matrix[5, 4] = 1.0
        matrix[1] = -self.c_u * voltage
        matrix[1, 0] += self.c_y
        matrix[2] = voltage
        column[[1, 2, 4]] = -self.c_u * from_reference, from_reference, -1.0
        return matrix, column


def linear_loop(
    case: TriedRig, *, gap: float | None = None, ratio: float = 1.0, reading: Equilibrium = "model"
) -> LinearLoop:
    """Return the loop at `gap` (default Y) with beta_c = `ratio` beta."""
    rig, beta = case.rig, design.plant_beta(case.rig)
    true = _true(rig, gap)
    believed = design.believed_equilibrium(
        rig, reading, beta_c=ratio * beta, voltage=design.voltage_on_plant(rig, beta)
    )
    k0, k1, k2, k3 = gains_program().scalar()(*case.poles.values)
    return LinearLoop(true.C_U, true.C_Y, believed.C_U, believed.C_Y, (k0, k1, k2, k3))


def _true(rig: Rig, gap: float | None) -> Believed:
    where = rig.operating_point.gap if gap is None else gap
    return design.true_equilibrium(rig, design.plant_beta(rig), where)


@cache
def _core() -> Numbers:
    core = tan_gpi().core
    entries = [stability.believed(x) for x in (*core.A, *core.B, *core.C, *core.D)]
    inputs = (p.C_U_hat, p.C_Y_hat, p.k0, p.k1, p.k2, p.k3)
    return lower(inputs, {f"entry{n}": x for n, x in enumerate(entries)}).scalar()


def answer(matrix: Array, column: Array, start: Array, degree: int, time: float) -> Array:
    """Return the state at `time` when `column` is driven by t^degree/degree! from `start`."""
    size = len(matrix)
    whole = np.zeros((size + degree + 1,) * 2)
    whole[:size, :size] = matrix
    whole[:size, size] = column
    whole[np.arange(size, size + degree), np.arange(size + 1, size + degree + 1)] = 1.0
    state = np.concatenate([start, np.zeros(degree), [1.0]])
    return np.asarray((expm(whole * time) @ state)[:size])


def settling_time(matrix: Array) -> float:
    """Return a time after which the transients of a stable loop are gone [s].

    Poles at zero, the hidden integrators, are left aside.
    """
    rates = np.abs(np.linalg.eigvals(matrix).real)
    return SETTLED / float(rates[rates > rates.max() / 1e3].min())


def settled(matrix: Array, column: Array, degree: int = 0, start: Array | float = 0.0) -> Array:
    """Return :func:`answer` once the transients are gone."""
    begin = np.zeros(len(matrix)) + start
    return answer(matrix, column, begin, degree, settling_time(matrix))


def is_stable(matrix: Array) -> bool:
    """Whether all eigenvalues lie left of zero."""
    return bool(np.linalg.eigvals(matrix).real.max() < 0)


def close(value: float, expected: float, scale: float = 0.0) -> bool:
    """Whether two numbers agree to :data:`AGREES`, of the larger of `expected` and `scale`."""
    return abs(value - expected) <= AGREES * max(abs(expected), scale)


def quantity(value: float, unit: str) -> str:
    """Return a figure of the evidence with its unit."""
    return f"{value:.4g} {unit}".strip()
