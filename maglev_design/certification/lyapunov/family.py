"""What a certificate speaks of: one controller, and a family of plants and gaps.

The controller is its numbers, fixed: the doubles that run, each a fraction. The plants are those
with beta = beta_c/r for r in an interval, and with any y0 of another. The gap may change from one
instant, or one period, to the next. So may the ratio, but for a delayed loop, whose remembered
efforts contain m: there it is constant, as beta is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal

from maglev_design.certification.numbers import check_same_rig
from maglev_design.certification.rationals import decimal, short
from maglev_design.controller.design import Design
from maglev_design.controller.family import family_of, rectangle
from maglev_design.controller.matching import only_papers_plant
from maglev_design.controller.timing import ExactTiming, exact_timing
from maglev_design.errors import InputError
from maglev_design.files import digest, finite
from maglev_design.options import TAN_GPI, Equilibrium, Method
from maglev_design.programs import derived, law
from maglev_design.rig import Rig

LoopName = Literal["continuous", "sampled"]
Vector = tuple[Fraction, ...]
Pair = tuple[Fraction, Fraction]

NOTHING: Pair = (Fraction(0), Fraction(0))
MOST_STATES = 16
"""Of the loop with its remembered voltages; a larger LMI takes minutes."""
HELD_PIECES = 4
"""Pieces of the interval of y0 where the ratio depends on y0."""


class NotEnclosedError(InputError):
    """The sampled loop has more states, or changes more in one period, than is enclosed."""


@dataclass(frozen=True)
class ExactSubject:
    """Controller and plant, every number exact; SI units.

    Attributes
    ----------
    numbers : mapping
        Of the controller, :attr:`maglev_design.controller.design.Design.numbers`: doubles, taken as
        exact but for Y and the period, which are the decimals that were typed.
    rig : str
        The rig's name.
    gravity, gap_offset, beta : Fraction
        g, y0 and beta_c, the plant's beta at the ratio 1; decimals.
    delay : Fraction
        From a sample to its voltage.
    """

    numbers: Mapping[str, Any] = field(hash=False)
    rig: str
    gravity: Fraction
    gap_offset: Fraction
    beta: Fraction
    delay: Fraction

    @property
    def sha256(self) -> str:
        """The controller's name."""
        return digest(self.numbers)

    @property
    def method(self) -> Method:
        """Discretisation by which the difference equation came about."""
        method: Method = self.numbers["method"]
        return method

    @property
    def gap(self) -> Fraction:
        """Y [m]."""
        return decimal(self.numbers["Y"])

    @property
    def period(self) -> Fraction:
        """T [s]."""
        return decimal(self.numbers["period"])

    @property
    def C_U_hat(self) -> Fraction:
        """C_U^ [m/(s^2 V)]."""
        return Fraction(self.numbers["C_U"])

    @property
    def C_Y_hat(self) -> Fraction:
        """C_Y^ [1/s^2]."""
        return Fraction(self.numbers["C_Y"])

    @property
    def gains(self) -> Vector:
        """(k0, k1, k2, k3)."""
        return tuple(Fraction(self.numbers["gains"][k.name]) for k in law().gains)

    @property
    def coefficients(self) -> Vector:
        """Those of the difference equation that the linear loop is made of."""
        _, named = derived.core(self.method, TAN_GPI)
        return tuple(Fraction(self.numbers["coefficients"][x.name]) for x in named)

    @property
    def when(self) -> ExactTiming:
        """Period and delay."""
        return exact_timing(self.period, self.delay)


@dataclass(frozen=True)
class CertificateClaim:
    """Which loop, over which gaps and plants.

    Attributes
    ----------
    loop : {"continuous", "sampled"}
    gaps : tuple of Fraction
        [m]
    ratios : tuple of Fraction
        beta_c/beta, at the rig's y0.
    shifts : tuple of Fraction
        True y0 less the rig's [m].
    held : bool
        Whether every plant holds the ball at Y with its own voltage: with another y0 it then has
        another beta, beta = g Z^2/U^2, and r = ratio (Z/(Z + shift))^2.
    """

    loop: LoopName
    gaps: Pair
    ratios: Pair
    shifts: Pair = NOTHING
    held: bool = False

    def boxes(self, Z: Fraction) -> Iterator[tuple[Pair, Pair]]:
        """Yield gaps [m], counted from the rig's y0, and ratios that together cover the family.

        A plant whose y0 is larger by a shift is that of the rig at a gap larger by as much. Where
        the ratio depends on the shift, the shifts are cut into pieces and on each the extremes of
        both are taken: more than the family, never less.
        """
        first, last = self.shifts
        pieces = HELD_PIECES if self.held and last > first else 1
        step = (last - first) / pieces
        for n in range(pieces):
            piece = first + n * step, first + (n + 1) * step
            yield rectangle(self.gaps, self.ratios, piece, Z if self.held else None)


def subject(design: Design, rig: Rig) -> ExactSubject:
    """Return the exact numbers of `design` on `rig`.

    Raises
    ------
    InputError
        For a controller other than TAN-GPI, and for a design of another rig.
    """
    if design.controller.name != "tan-gpi":
        raise InputError(
            f"controller = {design.controller.name!r}: a certificate needs 'tan-gpi', whose "
            "loop's dependence on the gap is known in closed form"
        )
    only_papers_plant(rig, "a Lyapunov certificate", design.controller)
    check_same_rig(rig, design)
    return ExactSubject(
        numbers=finite(design.numbers),
        rig=rig.name,
        gravity=decimal(rig.plant.gravity),
        gap_offset=decimal(rig.plant.gap_offset),
        beta=decimal(design.believed.beta),
        delay=decimal(rig.sampling.delay),
    )


def claim(
    rig: Rig,
    loop: LoopName,
    beta_error: Fraction | None = None,
    gap_range: tuple[float, float] | None = None,
    equilibrium: Equilibrium = "model",
) -> CertificateClaim:
    """Return the claim over the family of :func:`maglev_design.controller.family.family_of`.

    Parameters
    ----------
    beta_error : Fraction, optional
        u, ratios in [1 - u, 1 + u]; default: what the rig's file says for the reading.
    gap_range : tuple of float, optional
        [m]; default: the hull of path, initial gap and Y.
    """
    over = family_of(rig, equilibrium, None if beta_error is None else float(beta_error))
    ends = over.gaps if gap_range is None else gap_range
    if not all(math.isfinite(end) for end in ends):
        raise InputError(f"gap range = [{ends[0]:g}, {ends[-1]:g}] m: both ends must be finite")
    weak, strong = map(short, over.ratios)
    ratios = (weak, strong) if beta_error is None else (1 - beta_error, 1 + beta_error)
    gaps, (first, last) = (decimal(min(ends)), decimal(max(ends))), map(short, over.shifts)
    return CertificateClaim(loop, gaps, ratios, (first, last), over.held is not None)


def state_names(of: ExactSubject, loop: LoopName) -> tuple[str, ...]:
    """Return the states in order: error, its rate, the controller's two, remembered efforts.

    Raises
    ------
    NotEnclosedError
        When there would be more than MOST_STATES.
    """
    own = ("e", "v", *(state.name for state in law().states))
    if loop == "continuous":
        return own
    held = of.when.whole + (of.when.part > 0)
    if len(own) + held > MOST_STATES:
        raise NotEnclosedError(
            f"delay = {float(of.delay):g} s: certificates are made for at most "
            f"{MOST_STATES - len(own)} periods of delay"
        )
    return (*own, *(f"b{n + 1}" for n in range(held)))


def scaling(of: ExactSubject, loop: LoopName) -> Vector:
    """Return S, which brings every state to metres: powers of a whole omega near k0^(1/4)."""
    omega = Fraction(max(1, round(float(of.gains[0]) ** 0.25)))
    held = len(state_names(of, loop)) - 4
    return (Fraction(1), 1 / omega, omega, omega, *([omega**-2] * held))


def check_family(of: ExactSubject, over: CertificateClaim, scale: Sequence[Fraction]) -> None:
    """Raise `InputError` for numbers with which the family makes no sense."""
    if len(scale) != len(state_names(of, over.loop)) or min(scale) <= 0:
        raise InputError("scaling: must be one positive number for each state")
    (low, high), (weak, strong), (first, last) = over.gaps, over.ratios, over.shifts
    if not 0 < low <= high:
        raise InputError(
            f"gap range = [{float(low):g}, {float(high):g}] m: must be two gaps above 0 m, the "
            "smaller first"
        )
    if not 0 < weak <= strong:
        raise InputError(
            f"ratios = [{float(weak):g}, {float(strong):g}]: beta_c/beta must be above 0, the "
            "smaller first; allow an error of beta below 1"
        )
    if not first <= last or min(low, of.gap) + of.gap_offset + first <= 0:
        raise InputError(
            f"shifts = [{float(first):g}, {float(last):g}] m: must be two errors of y0, the "
            "smaller first, with every gap plus y0 above 0 m"
        )
