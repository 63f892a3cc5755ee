"""Everything that is said about one controller's robustness without an optimiser."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from maglev_design import linear_loop as loops
from maglev_design import programs
from maglev_design.certification import margins
from maglev_design.certification.intervals import interval
from maglev_design.certification.intervals.sampled import setting
from maglev_design.certification.intervals.sampled_interval import sampled_ratios_at
from maglev_design.certification.intervals.sampled_limits import (
    TimeLimit,
    largest_delay,
    largest_period,
)
from maglev_design.certification.intervals.sampled_path import sampled_ratios_over
from maglev_design.certification.intervals.spans import StableSet
from maglev_design.certification.margins import Margins, PointMargins
from maglev_design.certification.numbers import check_same_rig
from maglev_design.certification.rationals import decimal
from maglev_design.controller.design import Design
from maglev_design.controller.family import Family, family_of
from maglev_design.controller.timing import exact_timing
from maglev_design.errors import InputError
from maglev_design.files import finite, picked
from maglev_design.linear_loop import Extreme
from maglev_design.options import EQUILIBRIA, TAN_GPI, Equilibrium
from maglev_design.programs import gains_program
from maglev_design.rig import Rig
from maglev_design.symbolic import robustness, stability

ONE = Fraction(1)
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class AssessmentSubject:
    """Which controller is judged, on which rig, and over which family of plants.

    Attributes
    ----------
    rig : Rig
    design : Design
        One controller; its numbers stay whatever the plant.
    family : Family
        Gaps [m], ratios beta_c/beta and errors of y0 [m].
    beta_error : float or None
        Half the width of the ratios where it was said, as it was typed; else None.
    """

    rig: Rig
    design: Design
    family: Family
    beta_error: float | None


def subject(
    rig: Rig,
    design: Design,
    *,
    beta_error: float | None = None,
    gap_range: tuple[float, float] | None = None,
) -> AssessmentSubject:
    """Return what is to be judged; the rig's uncertainty and path where nothing else is said.

    Raises
    ------
    InputError
        For a design of another rig, an uncertainty outside [0, 1), or a range of gaps that is none.
    """
    check_same_rig(rig, design)
    over = family_of(rig, design.equilibrium, beta_error)
    if gap_range is not None:
        low, high = gap_range
        if not (0 < low <= high < math.inf):
            raise InputError(
                f"gap-range = {low!r} {high!r} [m]: must be two gaps, the first above 0 and not "
                "above the second"
            )
        over = replace(over, gaps=(low, high))
    return AssessmentSubject(rig, design, over, beta_error)


@dataclass(frozen=True)
class Assessment:
    """What holds of one loop.

    Attributes
    ----------
    conditions : tuple of str
        What must be positive for the continuous loop, in symbols.
    closed_form : mapping of str to str
        The ratio below which it is stable: ``fixed`` of this controller, by reading of one that is
        computed anew on each plant; empty but for TAN-GPI with a double pair.
    exact : tuple of StableSet
        Continuous loop: ratios at Y and over the family's gaps, first of this controller, then by
        reading of one that is computed anew on each plant.
    gaps : StableSet
        Continuous loop: gaps at exact beta.
    sampled_at_y, sampled_over_gaps : StableSet
        Sampled loop: ratios; over the family's gaps those around exact beta.
    period, delay : TimeLimit
        Exact beta, every gap of the family.
    spectral_radius : Extreme
        Largest over a grid of the family.
    continuous, sampled : tuple of PointMargins
        At the corners of the family and the middle of its gaps.
    """

    subject: AssessmentSubject
    conditions: tuple[str, ...]
    closed_form: dict[str, str]
    exact: tuple[StableSet, ...]
    gaps: StableSet
    sampled_at_y: StableSet
    sampled_over_gaps: StableSet
    period: TimeLimit
    delay: TimeLimit
    spectral_radius: Extreme
    continuous: tuple[PointMargins, ...]
    sampled: tuple[PointMargins, ...]

    @property
    def margins(self) -> Margins:
        """Worst margins of the sampled loop."""
        return margins.worst(self.sampled)

    @property
    def continuous_margins(self) -> Margins:
        """Worst margins of the continuous loop."""
        return margins.worst(self.continuous)

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON."""
        own, design = self.subject, self.subject.design
        sampling, reading = own.rig.sampling, design.equilibrium
        return {
            "controller": design.controller.name,
            "controller_sha256": design.sha256,
            "numbers": finite(design.numbers),
            "poles": design.poles.pairs,
            "equilibrium": reading,
            "method": design.method,
            "family": own.family.as_data(own.rig.plant.gap_offset),
            "conditions": list(self.conditions),
            "closed_form": self.closed_form,
            "exact_interval": [found.as_dict(ONE, reading) for found in self.exact],
            "exact_gaps": [self.gaps.as_dict(decimal(design.Y), reading)],
            "sampled_interval": [
                found.as_dict(ONE, reading) for found in (self.sampled_at_y, self.sampled_over_gaps)
            ],
            "margins": self.margins.as_dict(),
            "margins_continuous": self.continuous_margins.as_dict(),
            "margins_at": {"continuous": self.continuous, "sampled": self.sampled},
            "sampled": {
                "period_s": sampling.period,
                "delay_s": sampling.delay,
                "max_period_s": self.period.value,
                "max_delay_s": self.delay.value,
                "max_period": self.period.as_dict(),
                "max_delay": self.delay.as_dict(),
                "spectral_radius": self.spectral_radius.value,
                "spectral_radius_at": picked(self.spectral_radius, "gap", "ratio"),
            },
        }


def assess(own: AssessmentSubject, progress: Progress = lambda _stage, _done: None) -> Assessment:
    """Return what holds of a loop: exact intervals, enclosed ends, margins."""
    rig, design, gaps = own.rig, own.design, own.family.gaps
    progress("exact intervals", 0.0)
    readings: tuple[Equilibrium | None, ...] = (None, *EQUILIBRIA)
    every = [interval.exact_loop(rig, design, reading) for reading in readings]
    exact = [(interval.ratios_at(x, design.Y), interval.ratios_over(x, gaps)) for x in every]
    progress("sampled intervals", 0.1)
    sampled, (period, delay) = setting(rig, design), (rig.sampling.period, rig.sampling.delay)
    when = exact_timing(decimal(period), decimal(delay))
    at_y = sampled_ratios_at(sampled, when, design.Y)
    progress("sampled interval over the gaps", 0.3)
    over = sampled_ratios_over(sampled, when, gaps)
    progress("largest period", 0.5)
    longest = largest_period(sampled, period, delay, gaps)
    progress("largest delay", 0.6)
    latest = largest_delay(sampled, period, delay, gaps)
    progress("margins", 0.8)
    loop, law = loops.loop_of(rig, design), programs.law(design.controller)
    poles, continuous = design.poles.values, margins.continuous_open_loop(rig, design)
    return Assessment(
        subject=own,
        conditions=tuple(str(c) for c in robustness.stability_conditions(law)),
        closed_form=_closed_form(design),
        exact=tuple(found for pair in exact for found in pair),
        gaps=interval.gaps_at(every[0]),
        sampled_at_y=at_y,
        sampled_over_gaps=over,
        period=longest,
        delay=latest,
        spectral_radius=loops.spectral_radius(loop, poles, own.family),
        continuous=margins.point_margins(continuous, own.family, None),
        sampled=margins.point_margins(
            margins.sampled_open_loop(loop, poles), own.family, loop.period
        ),
    )


def _closed_form(design: Design) -> dict[str, str]:
    """Return the general condition and what it says of the ratio, for the gains (25)."""
    made = gains_program(design.controller).scalar()(*design.poles.values)
    if design.controller != TAN_GPI or design.poles.first != design.poles.second:
        return {}
    if not all(map(math.isclose, made, design.gains)):
        return {}
    law = programs.law(design.controller)
    forms = {"condition": f"{stability.stability_condition()} > 0"}
    for reading in (None, *EQUILIBRIA):
        end = robustness.largest_ratio(law, reading)
        forms[reading or "fixed"] = "no ratio enters" if end is None else f"r < {end}"
    return forms
