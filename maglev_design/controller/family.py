"""The plants over which a worst case is taken, and the gaps at which the ball may be.

Linearised, a plant is known by its beta and by y + y0; a plant whose y0 is larger by a shift is
that of the rig at a gap larger by as much.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.plant import (
    path_gaps,
)
from maglev_design.errors import InputError
from maglev_design.options import Equilibrium
from maglev_design.rig import Rig

Array = NDArray[np.float64]
Number = TypeVar("Number", float, Fraction)


def rectangle(
    gaps: tuple[Number, Number],
    ratios: tuple[Number, Number],
    shifts: tuple[Number, Number],
    held: Number | None,
    fall: Any = 2,
) -> tuple[tuple[Number, Number], tuple[Number, Number]]:
    """Return gaps, counted from the rig's y0, and ratios of the plants with another y0.

    They hold whatever y0 is off by between the ends of `shifts`; the smallest such rectangle.

    Parameters
    ----------
    gaps, ratios, shifts, held, fall
        As in :class:`Family`, floats or fractions.
    """
    (low, high), (weak, strong), (first, last) = gaps, ratios, shifts
    if held is not None:
        weak = weak * (held / (held + last)) ** fall
        strong = strong * (held / (held + first)) ** fall
    return (low + first, high + last), (weak, strong)


@dataclass(frozen=True)
class Family:
    """Plants and gaps: a union of rectangles.

    Attributes
    ----------
    gaps : tuple of float
        [m]
    ratios : tuple of float
        beta_c/beta at the rig's y0.
    shifts : tuple of float
        True y0 less the rig's [m].
    held : float or None
        Z = Y + y0 [m] of the rig where the plants are known by the voltage that holds the ball at
        Y: another y0 then comes with another beta, beta = g Z^q/U^p. None where the two are
        independent.
    """

    gaps: tuple[float, float]
    ratios: tuple[float, float]
    shifts: tuple[float, float] = (0.0, 0.0)
    held: float | None = None
    fall: float = 2

    def as_data(self, gap_offset: float) -> dict[str, Any]:
        """Return the plants for JSON: gaps [m], ratios, and y0 where the rig's is `gap_offset`."""
        return {
            "gaps": list(self.gaps),
            "ratios": list(self.ratios),
            "gap_offsets": [gap_offset + shift for shift in self.shifts],
            "voltage_held": self.held is not None,
        }

    def ratio_at(self, ratio: float, shift: float) -> float:
        """Return beta_c/beta of the plant that has `ratio` at the rig's y0, at another y0."""
        return (
            ratio if self.held is None else ratio * (self.held / (self.held + shift)) ** self.fall
        )

    @property
    def shift_values(self) -> tuple[float, ...]:
        """The shifts that are looked at: none, and both ends [m]."""
        return tuple(dict.fromkeys((0.0, *self.shifts)))

    @property
    def rectangles(self) -> tuple[Family, ...]:
        """Gaps of the rig's y0 and ratios whose union stands for the family."""
        if self.shifts == (0.0, 0.0):
            return (self,)
        looked_at = [self.shifts] if self.held is None else [(s, s) for s in self.shift_values]
        return tuple(
            Family(*rectangle(self.gaps, self.ratios, shifts, self.held, self.fall))
            for shifts in looked_at
        )

    def corner_columns(self, gaps: int, ratios: int) -> list[int]:
        """Return the columns of :meth:`grid` that are corners, each once."""
        found: list[int] = []
        count = 0
        for part in self.rectangles:
            points = part.grid(gaps, ratios)
            ends = np.isin(points[0], part.gaps) & np.isin(points[1], part.ratios)
            found += [count + int(n) for n in np.flatnonzero(ends)]
            count += points.shape[1]
        return found

    def grid(self, gaps: int, ratios: int) -> Array:
        """Return the points of a grid, shape (2, n): gaps in row 0, ratios in row 1."""
        if len(self.rectangles) > 1 or self.shifts != (0.0, 0.0):
            return np.hstack([part.grid(gaps, ratios) for part in self.rectangles])
        gap = np.unique(np.linspace(*self.gaps, gaps))
        ratio = np.unique(np.linspace(*self.ratios, ratios))
        return np.stack([axis.ravel() for axis in np.meshgrid(gap, ratio, indexing="ij")])


def family_of(
    rig: Rig, equilibrium: Equilibrium = "model", beta_error: float | None = None
) -> Family:
    """Return the plants of `rig` under a reading, at the hull of path, initial gap and Y.

    Ratios: 1 +- `beta_error`, by default the rig's ``uncertainty.beta``; under ``measured``, where
    no error of beta is given, (1 +- d)^p with d the relative error of the measured voltage, of what
    is left of it beyond an input offset.

    Raises
    ------
    InputError
        For an error outside [0, 1).
    """
    low, high = path_gaps(rig, 2)[[0, -1]]
    plant, stated = rig.plant, rig.uncertainty
    offsets = (plant.gap_offset,) if stated.gap_offset is None else stated.gap_offset.reach
    shifts = (offsets[0] - plant.gap_offset, offsets[-1] - plant.gap_offset)
    held = None
    if equilibrium == "measured":
        held = rig.operating_point.gap + plant.gap_offset
    if equilibrium == "measured" and beta_error is None:
        d, power = stated.voltage_error, rig.kind.exponent
        voltage, beyond = rig.operating_point.voltage, rig.drive.input_offset
        if voltage is not None and beyond:
            d *= voltage / (voltage - beyond)
        ratios = ((1 - d) ** power, (1 + d) ** power)
    else:
        error = stated.beta if beta_error is None else beta_error
        if not 0 <= error < 1:
            raise InputError(f"beta error = {error!r} [-]: must be at least 0 and less than 1")
        ratios = (1 - error, 1 + error)
    return Family((float(low), float(high)), ratios, shifts, held, plant.gap_exponent or 2)
