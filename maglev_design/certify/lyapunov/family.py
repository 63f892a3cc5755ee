"""What a certificate speaks of: a controller on a rig, and a family of gaps and ratios.

The gap may change from one instant, or one period, to the next. So may the ratio, but for a delayed
loop, whose remembered efforts contain m: there it is constant, as beta is. Where a reading needs
the true equilibrium voltage and the rig gives none, the controller of each member has measured
that of its own plant. The gains are the doubles that run; the coefficients made of them and the
steps are in exact arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from maglev_design.certify.rationals import decimal
from maglev_design.choices import Equilibrium, Method
from maglev_design.design import Design, believed_equilibrium, law, path_gaps
from maglev_design.errors import InputError
from maglev_design.parameters import Rig

LoopName = Literal["continuous", "sampled"]
Vector = tuple[Fraction, ...]

MOST_STATES = 16
"""Of the loop with its remembered voltages; a larger LMI takes minutes."""
SAME = 1e-9
"""Relative difference to which a design must believe what its rig says."""


class NotEnclosedError(InputError):
    """The sampled loop has more states, or changes more in one period, than is enclosed."""


@dataclass(frozen=True)
class Subject:
    """Rig and controller, every number exact.

    The rig's decimals are taken as typed; the gains are the doubles that run. SI units.

    Attributes
    ----------
    mass, gravity, current_gain, force_constant, gap_offset, gap : Fraction
        m, g, C, K, y0 and Y.
    voltage : Fraction or None
        U as measured.
    equilibrium, method : str
    gains : tuple of Fraction
        (k0, k1, k2, k3).
    period, delay : Fraction
        T and the time from a sample to its voltage.
    """

    mass: Fraction
    gravity: Fraction
    current_gain: Fraction
    force_constant: Fraction
    gap_offset: Fraction
    gap: Fraction
    voltage: Fraction | None
    equilibrium: Equilibrium
    method: Method
    gains: Vector
    period: Fraction
    delay: Fraction

    @property
    def whole(self) -> int:
        """Whole periods of delay, n."""
        return int(self.delay // self.period)

    @property
    def part(self) -> Fraction:
        """What is left of the delay, T_1 in [0, T) [s]."""
        return self.delay - self.whole * self.period


@dataclass(frozen=True)
class Claim:
    """Which loop, over which gaps [m] and which ratios beta_c/beta."""

    loop: LoopName
    gaps: tuple[Fraction, Fraction]
    ratios: tuple[Fraction, Fraction]


def subject(design: Design, rig: Rig) -> Subject:
    """Return the exact numbers of `design` on `rig`.

    Raises
    ------
    InputError
        For a controller other than TAN-GPI, and for a design that was made for another beta.
    """
    if design.controller.name != "tan-gpi":
        raise InputError(
            f"controller = {design.controller.name!r}: a certificate needs 'tan-gpi', whose "
            "loop's dependence on the gap is known in closed form"
        )
    believed = believed_equilibrium(rig, design.equilibrium)
    if not math.isclose(believed.C_U, design.believed.C_U, rel_tol=SAME):
        raise InputError(
            f"design: C_U = {design.believed.C_U:g} m/(s^2 V), but with the rig's beta it is "
            f"{believed.C_U:g}; ratios count from the rig's beta: certify with the design's rig"
        )
    plant, point, sampling = rig.plant, rig.operating_point, rig.sampling
    return Subject(
        mass=decimal(plant.mass),
        gravity=decimal(plant.gravity),
        current_gain=decimal(plant.current_gain),
        force_constant=decimal(plant.force_constant),
        gap_offset=decimal(plant.gap_offset),
        gap=decimal(point.gap),
        voltage=None if point.voltage is None else decimal(point.voltage),
        equilibrium=design.equilibrium,
        method=design.method,
        gains=tuple(Fraction(k) for k in design.gains),
        period=decimal(sampling.period),
        delay=decimal(sampling.delay),
    )


def claim(
    rig: Rig,
    loop: LoopName,
    beta_error: Fraction,
    gap_range: tuple[float, float] | None = None,
) -> Claim:
    """Return the claim over `gap_range`, by default the hull of path, initial gap and Y."""
    ends = path_gaps(rig, 2) if gap_range is None else gap_range
    if not all(math.isfinite(end) for end in ends):
        raise InputError(f"gap range = [{ends[0]:g}, {ends[-1]:g}] m: both ends must be finite")
    gaps = decimal(min(ends)), decimal(max(ends))
    return Claim(loop, gaps, (1 - beta_error, 1 + beta_error))


def state_names(of: Subject, loop: LoopName) -> tuple[str, ...]:
    """Return the states in order: error, its rate, the controller's two, remembered efforts.

    Raises
    ------
    NotEnclosedError
        When there would be more than MOST_STATES.
    """
    own = ("e", "v", *(state.name for state in law().states))
    if loop == "continuous":
        return own
    held = of.whole + (of.part > 0)
    if len(own) + held > MOST_STATES:
        raise NotEnclosedError(
            f"delay = {float(of.delay):g} s: certificates are made for at most "
            f"{MOST_STATES - len(own)} periods of delay"
        )
    return (*own, *(f"b{n + 1}" for n in range(held)))


def scaling(of: Subject, loop: LoopName) -> Vector:
    """Return S, which brings every state to metres: powers of a whole omega near k0^(1/4)."""
    omega = Fraction(max(1, round(float(of.gains[0]) ** 0.25)))
    held = len(state_names(of, loop)) - 4
    return (Fraction(1), 1 / omega, omega, omega, *([omega**-2] * held))


def check_family(of: Subject, over: Claim, scale: Sequence[Fraction]) -> None:
    """Raise `InputError` for numbers with which the family makes no sense."""
    rig = (of.mass, of.gravity, of.current_gain, of.force_constant, of.gap, of.period)
    if min(rig) <= 0 or of.gap_offset < 0 or of.delay < 0 or (of.voltage or 1) <= 0:
        raise InputError("the numbers of the rig must be positive")
    if len(of.gains) != 4 or min(of.gains) <= 0:
        raise InputError("gains: must be four positive numbers, k0 to k3")
    if len(scale) != len(state_names(of, over.loop)) or min(scale) <= 0:
        raise InputError("scaling: must be one positive number for each state")
    (low, high), (weak, strong) = over.gaps, over.ratios
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
