"""When the voltage of which sample acts: a delay in whole periods and what is left."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction


@dataclass(frozen=True)
class Timing:
    """When the voltage of which sample acts.

    Attributes
    ----------
    whole : int
        Whole periods of delay n.
    part : float
        What is left of the delay, T_1 in [0, T) [s].
    held : int
        How many earlier voltages the loop has to remember.
    """

    whole: int
    part: float
    held: int


@dataclass(frozen=True)
class ExactTiming:
    """Period T and delay n T + T_1 [s], exact."""

    period: Fraction
    whole: int
    part: Fraction


def exact_timing(period: Fraction, delay: Fraction) -> ExactTiming:
    """Return the delay in whole periods and what is left."""
    return ExactTiming(period, *divmod(delay, period))


def timing(period: float, delay: float) -> Timing:
    """Return delay = n T + T_1, with the decimals of both taken as exact.

    Examples
    --------
    >>> timing(0.001, 0.003)
    Timing(whole=3, part=0.0, held=3)
    """
    exact = exact_timing(*[Fraction(repr(float(time))) for time in (period, delay)])
    return Timing(exact.whole, float(exact.part), exact.whole + (exact.part > 0))
