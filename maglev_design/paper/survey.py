"""Which orderings of the controllers survive every reading of the paper, and what flips the rest.

The paper leaves open how U, C_U and C_Y are found, how the laws are sampled, which PID was meant,
and little is said of the start and of the sensor. The survey runs every combination.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from maglev_design.figures import DESCRIBED, INDICES
from maglev_design.files import picked
from maglev_design.options import EQUILIBRIA, Method
from maglev_design.paper.trials import (
    REAL_SENSOR_NOISE,
    SLOW_PERIOD,
    TRIALS,
    Contender,
    Reading,
    Trial,
    contenders,
    figures,
    run_trial,
)
from maglev_design.rig import Rig

Outcome = Literal["always", "depends", "never"]

OURS = "TAN-GPI"
NAMES = {
    **{key: DESCRIBED[key].label for key in (*INDICES, "total_variation")},
    "peak_voltage": "peak voltage",
    "settling": "settling time",
    "undershoot": "undershoot",
    "largest_error_moving": "largest error of the move",
    "largest_error_centre": "largest error between second 3 and 5",
    "iae_start": "IAE before the move",
    "mean_error_holding": "mean error after the move",
}
"""Figures of which the smaller is the better, and what people call them."""
COMPARED = tuple(NAMES)
FACTORS = (
    "variant",
    "equilibrium",
    "discretisation",
    "sample_time",
    "initial_error",
    "position_noise",
)
"""What a reading consists of."""


@dataclass(frozen=True)
class Row:
    """One run of the survey.

    Attributes
    ----------
    trial, label : str
        The test and the controller.
    levels : dict
        The level of each of :data:`FACTORS`.
    stated : bool
        Whether the period, the start and the sensor are those that the paper states for its
        simulations; what is left open then is the variant, the equilibrium and the sampling.
    values : dict
        The run's figures.
    """

    trial: str
    label: str
    levels: dict[str, str]
    stated: bool
    values: dict[str, float]


@dataclass(frozen=True)
class Ordering:
    """Whether TAN-GPI has the smaller figure than an opponent, over all readings.

    Attributes
    ----------
    trial, opponent, figure : str
    readings, held : int
        How many readings were tried, and in how many TAN-GPI is better.
    stated_readings, stated_held : int
        The same under the period, start and sensor that the paper states.
    by_level : dict of str to dict
        For every factor that has more than one level: level -> share of readings in which it is.
    decided_by : str
        The factor that moves the share most; empty when nothing does.
    stated_decided_by : str
        The same under what the paper states.
    ratios : tuple of float
        Smallest and largest figure of the opponent over that of TAN-GPI, under what the paper
        states.
    """

    trial: str
    opponent: str
    figure: str
    readings: int
    held: int
    stated_readings: int
    stated_held: int
    by_level: dict[str, dict[str, float]]
    decided_by: str
    stated_decided_by: str
    ratios: tuple[float, float]

    @property
    def outcome(self) -> Outcome:
        """``always``, ``never`` or ``depends``, over all readings."""
        return _outcome(self.held, self.readings)

    @property
    def stated_outcome(self) -> Outcome:
        """The same under what the paper states."""
        return _outcome(self.stated_held, self.stated_readings)

    def as_dict(self) -> dict[str, Any]:
        """Return the ordering for JSON."""
        return {
            "test": self.trial,
            "better": OURS,
            "than": self.opponent,
            "figure": self.figure,
            "name": NAMES[self.figure],
            **picked(self, "outcome", "readings", "held", "decided_by", "stated_outcome"),
            **picked(self, "stated_readings", "stated_held", "stated_decided_by"),
            "share_by_level": self.by_level,
            "ratio": list(self.ratios),
        }


def readings(rig: Rig) -> Iterator[Reading]:
    """Yield every reading of the loop: equilibrium, sampling, start and sensor."""
    period = rig.sampling.period
    ways: list[tuple[Method | None, float]] = [(None, period)]
    ways += [
        (method, step)
        for step in dict.fromkeys((period, SLOW_PERIOD))
        for method in ("tustin", "euler", "zoh")
    ]
    noises = tuple(dict.fromkeys((rig.noise.position, REAL_SENSOR_NOISE)))
    for reading, (method, step), mirror, noise in itertools.product(
        EQUILIBRIA, ways, (False, True), noises
    ):
        yield Reading(reading, method, step, noise, mirrored=mirror)


def survey(
    rig: Rig, progress: Callable[[str, float], None] = lambda _stage, _done: None
) -> tuple[Row, ...]:
    """Run every controller through every test under every reading, one seed each."""
    laws = contenders()
    work = [
        (trial, reading, contender)
        for trial in TRIALS
        for reading in readings(rig)
        if trial.noise or reading.position_noise == rig.noise.position
        for contender in laws
    ]
    rows = []
    for n, (trial, reading, contender) in enumerate(work):
        if n % 10 == 0:
            progress("every reading", n / len(work))
        own, response = run_trial(rig, contender, trial, reading)
        rows.append(
            Row(
                trial.name,
                contender.label,
                _levels(own, trial, reading, contender),
                _is_stated(rig, reading),
                figures(own, response),
            )
        )
    return tuple(rows)


def _levels(rig: Rig, trial: Trial, reading: Reading, contender: Contender) -> dict[str, str]:
    start = rig.initial.gap - rig.reference.start_gap
    start = -start if reading.mirrored else start
    return {
        "variant": contender.variant,
        "equilibrium": reading.equilibrium,
        "discretisation": reading.method or "continuous",
        "sample_time": f"{1e3 * reading.period:g} ms" if reading.method else "continuous",
        "initial_error": f"{1e3 * start:+.3g} mm",
        "position_noise": f"{1e6 * reading.position_noise:g} µm" if trial.noise else "none",
    }


def orderings(rows: Sequence[Row]) -> tuple[Ordering, ...]:
    """Return every ordering of TAN-GPI against an opponent, test by test and figure by figure."""
    opponents = tuple(dict.fromkeys(row.label for row in rows if row.label != OURS))
    trials = tuple(dict.fromkeys(row.trial for row in rows))
    return tuple(
        ordering(rows, trial, opponent, figure)
        for trial, opponent, figure in itertools.product(trials, opponents, COMPARED)
    )


def ordering(rows: Sequence[Row], trial: str, opponent: str, figure: str) -> Ordering:
    """Return one ordering: each run of the opponent against TAN-GPI's under the same reading."""
    here = [row for row in rows if row.trial == trial]
    ours = {_loop_levels(row): row.values[figure] for row in here if row.label == OURS}
    pairs = [
        _Pair(row.levels, row.stated, ours[_loop_levels(row)], row.values[figure])
        for row in here
        if row.label == opponent
    ]
    stated = [pair for pair in pairs if pair.stated]
    by_level = _shares(pairs)
    ratios = [p.theirs / p.ours for p in stated if p.ours > 0 and math.isfinite(p.theirs / p.ours)]
    return Ordering(
        trial=trial,
        opponent=opponent,
        figure=figure,
        readings=len(pairs),
        held=sum(pair.holds for pair in pairs),
        stated_readings=len(stated),
        stated_held=sum(pair.holds for pair in stated),
        by_level=by_level,
        decided_by=_decisive(by_level),
        stated_decided_by=_decisive(_shares(stated)),
        ratios=(min(ratios, default=math.nan), max(ratios, default=math.nan)),
    )


@dataclass(frozen=True)
class _Pair:
    """TAN-GPI's figure and an opponent's under one reading."""

    levels: dict[str, str]
    stated: bool
    ours: float
    theirs: float

    @property
    def holds(self) -> bool:
        """Whether TAN-GPI is better; what never happens (nan) counts as infinitely bad."""
        return _known(self.ours) < _known(self.theirs)


def _shares(pairs: Sequence[_Pair]) -> dict[str, dict[str, float]]:
    """Return for every factor with several levels the share of pairs that hold, level by level."""
    shares: dict[str, dict[str, float]] = {}
    for factor in FACTORS:
        groups: dict[str, list[bool]] = {}
        for pair in pairs:
            groups.setdefault(pair.levels[factor], []).append(pair.holds)
        if len(groups) > 1:
            shares[factor] = {level: sum(x) / len(x) for level, x in groups.items()}
    return shares


def _decisive(shares: dict[str, dict[str, float]]) -> str:
    """Return the factor whose levels differ most, nothing when none does."""
    ranges = {factor: max(s.values()) - min(s.values()) for factor, s in shares.items()}
    largest = max(ranges, key=ranges.__getitem__, default="")
    return largest if largest and ranges[largest] > 0 else ""


def _outcome(held: int, readings: int) -> Outcome:
    if held == readings:
        return "always"
    return "depends" if held else "never"


def _is_stated(rig: Rig, reading: Reading) -> bool:
    return (
        not reading.mirrored
        and reading.period == rig.sampling.period
        and reading.position_noise == rig.noise.position
    )


def _loop_levels(row: Row) -> tuple[str, ...]:
    """Return the levels that two runs of different controllers must share."""
    return tuple(row.levels[factor] for factor in FACTORS if factor != "variant")


def _known(value: float) -> float:
    return math.inf if math.isnan(value) else value
