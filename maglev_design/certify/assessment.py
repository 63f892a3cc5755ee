"""Everything that is said about one controller's robustness without an optimiser."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from maglev_design import design as designs
from maglev_design import loop as loops
from maglev_design.certify import margins
from maglev_design.certify.intervals import interval
from maglev_design.certify.intervals.sampled import setting, timing
from maglev_design.certify.intervals.sampled_interval import sampled_ratios_at
from maglev_design.certify.intervals.sampled_limits import Limit, largest_delay, largest_period
from maglev_design.certify.intervals.sampled_path import sampled_ratios_over
from maglev_design.certify.intervals.spans import StableSet
from maglev_design.certify.margins import Margins, PointMargins
from maglev_design.certify.rationals import decimal
from maglev_design.choices import EQUILIBRIA, TAN_GPI, Controller, Equilibrium, Method
from maglev_design.design import PoleSpec
from maglev_design.errors import InputError
from maglev_design.loop import Extreme, Family
from maglev_design.parameters import Rig
from maglev_design.symbolic import robustness, stability

ONE = Fraction(1)
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Subject:
    """Which loop is judged, and over which family.

    Attributes
    ----------
    family : Family
        Gaps [m] and ratios beta_c/beta.
    """

    rig: Rig
    poles: PoleSpec
    equilibrium: Equilibrium
    method: Method
    family: Family
    controller: Controller = TAN_GPI


def subject(
    rig: Rig,
    poles: PoleSpec,
    *,
    equilibrium: Equilibrium = "model",
    method: Method | None = None,
    controller: Controller = TAN_GPI,
    beta_error: float | None = None,
    gap_range: tuple[float, float] | None = None,
) -> Subject:
    """Return what is to be judged; the rig's uncertainty and path where nothing else is said.

    Raises
    ------
    InputError
        For an uncertainty outside [0, 1) or a range of gaps that is none.
    """
    error = rig.uncertainty.beta if beta_error is None else beta_error
    if not 0 <= error < 1:
        raise InputError(f"beta-error = {error!r} [-]: must be at least 0 and less than 1")
    over = loops.family(rig, error)
    if gap_range is not None:
        low, high = gap_range
        if not (0 < low <= high < math.inf):
            raise InputError(
                f"gap-range = {low!r} {high!r} [m]: must be two gaps, the first above 0 and not "
                "above the second"
            )
        over = Family((low, high), over.ratios)
    return Subject(rig, poles, equilibrium, method or rig.sampling.method, over, controller)


@dataclass(frozen=True)
class Assessment:
    """What holds of one loop.

    Attributes
    ----------
    conditions : tuple of str
        What must be positive for the continuous loop, in symbols.
    closed_form : mapping of str to str
        By reading, the ratio below which it is stable; empty but for TAN-GPI with a double pair.
    at_y, over_gaps, gaps : tuple of StableSet
        Continuous loop, one a reading: ratios at Y and over the family's gaps; gaps at exact beta.
    sampled_at_y : tuple of StableSet
        One a reading.
    sampled_over_gaps : StableSet
        The subject's reading, around exact beta.
    period, delay : Limit or None
        Exact beta, every gap of the family.
    spectral_radius : Extreme
        Largest over a grid of the family.
    continuous, sampled : tuple of PointMargins
        At the corners of the family and the middle of its gaps.
    """

    subject: Subject
    conditions: tuple[str, ...]
    closed_form: dict[str, str]
    at_y: tuple[StableSet, ...]
    over_gaps: tuple[StableSet, ...]
    gaps: tuple[StableSet, ...]
    sampled_at_y: tuple[StableSet, ...]
    sampled_over_gaps: StableSet
    period: Limit | None
    delay: Limit | None
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
        own = self.subject
        sampling = own.rig.sampling
        nominal = decimal(own.rig.operating_point.gap)
        return {
            "controller": own.controller.name,
            "poles": [list(own.poles.first), list(own.poles.second)],
            "equilibrium": own.equilibrium,
            "method": own.method,
            "family": {"gaps": list(own.family.gaps), "ratios": list(own.family.ratios)},
            "conditions": list(self.conditions),
            "closed_form": self.closed_form,
            "exact_interval": [found.as_dict(ONE) for found in (*self.at_y, *self.over_gaps)],
            "exact_gaps": [found.as_dict(nominal) for found in self.gaps],
            "sampled_interval": [
                found.as_dict(ONE) for found in (*self.sampled_at_y, self.sampled_over_gaps)
            ],
            "margins": self.margins.as_dict(),
            "margins_continuous": self.continuous_margins.as_dict(),
            "margins_at": {
                "continuous": [point.as_dict() for point in self.continuous],
                "sampled": [point.as_dict() for point in self.sampled],
            },
            "sampled": {
                "period_s": sampling.period,
                "delay_s": sampling.delay,
                "max_period_s": self.period.stable if self.period else None,
                "max_delay_s": self.delay.stable if self.delay else None,
                "max_period": self.period.as_dict() if self.period else None,
                "max_delay": self.delay.as_dict() if self.delay else None,
                "spectral_radius": self.spectral_radius.value,
                "spectral_radius_at": {
                    "gap": self.spectral_radius.gap,
                    "ratio": self.spectral_radius.ratio,
                },
            },
        }


def assess(own: Subject, progress: Progress = lambda _stage, _done: None) -> Assessment:
    """Return what holds of a loop: exact intervals, enclosed ends, margins."""
    rig, poles, controller = own.rig, own.poles, own.controller
    at_y, gaps = rig.operating_point.gap, own.family.gaps
    progress("exact intervals", 0.0)
    exact = {r: interval.exact_loop(rig, poles, r, controller) for r in EQUILIBRIA}
    progress("sampled intervals", 0.1)
    settings = {r: setting(rig, poles, r, own.method, controller) for r in EQUILIBRIA}
    when = timing(decimal(rig.sampling.period), decimal(rig.sampling.delay))
    mine = settings[own.equilibrium]
    sampled_at_y = tuple(sampled_ratios_at(s, when, r, at_y) for r, s in settings.items())
    progress("sampled interval over the gaps", 0.3)
    over = sampled_ratios_over(mine, when, own.equilibrium, gaps)
    progress("largest period", 0.5)
    period = largest_period(mine, rig.sampling.period, rig.sampling.delay, gaps)
    progress("largest delay", 0.6)
    delay = largest_delay(mine, rig.sampling.period, rig.sampling.delay, gaps)
    progress("margins", 0.8)
    loop = loops.build_loop(
        rig, equilibrium=own.equilibrium, method=own.method, controller=controller
    )
    law = designs.law(controller)
    return Assessment(
        subject=own,
        conditions=tuple(str(c) for c in robustness.stability_conditions(law)),
        closed_form=_closed_form(own),
        at_y=tuple(interval.ratios_at(x, r, at_y) for r, x in exact.items()),
        over_gaps=tuple(interval.ratios_over(x, r, gaps) for r, x in exact.items()),
        gaps=tuple(interval.gaps_at(x, r) for r, x in exact.items()),
        sampled_at_y=sampled_at_y,
        sampled_over_gaps=over,
        period=period,
        delay=delay,
        spectral_radius=loops.spectral_radius(loop, poles.values, own.family),
        continuous=margins.point_margins(
            margins.continuous_open_loop(rig, poles, own.equilibrium, controller), own.family, None
        ),
        sampled=margins.point_margins(
            margins.sampled_open_loop(loop, poles.values), own.family, loop.period
        ),
    )


def _closed_form(own: Subject) -> dict[str, str]:
    """Return the general condition and what it says of the ratio, for the gains (25)."""
    if own.controller != TAN_GPI or own.poles.first != own.poles.second:
        return {}
    law, measured = designs.law(own.controller), own.rig.operating_point.voltage is not None
    forms = {"condition": f"{stability.stability_condition()} > 0"}
    for reading in EQUILIBRIA:
        end = robustness.largest_ratio(reading, measured=measured, law=law)
        forms[reading] = "no ratio enters" if end is None else f"r < {end}"
    return forms
