"""Section 4 again: every controller through every test, and which orderings survive.

Where noise enters, a figure is the median over seeds, with the interval that holds 95 % of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.certification.margins import Margins, sampled_margins
from maglev_design.controller.design import believed_equilibrium, plant_beta, voltage_on_plant
from maglev_design.controller.family import family_of
from maglev_design.figures import INDICES, PARTS
from maglev_design.linear_loop import build_loop, peak_sensitivity, spectral_radius
from maglev_design.paper.trials import (
    EMULATION,
    TRIALS,
    Contender,
    Reading,
    Trial,
    figures,
    rig_for,
    run_trial,
)
from maglev_design.rig import Rig
from maglev_design.tuning.emulated import NoiseBand

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

SPLITS = tuple(f"{index}_{part}" for index in INDICES for part in PARTS)
INTERVAL = (0.025, 0.975)
"""Quantiles of the 95 % interval over seeds."""


@dataclass(frozen=True)
class Result:
    """One controller in one test under one reading.

    Attributes
    ----------
    trial : Trial
    contender : Contender
    reading : Reading
    period : float
        Sampling period as run [s].
    values : dict
        :func:`maglev_design.paper.trials.figures`; medians where noise enters.
    spread : dict of str to NoiseBand
        Empty without noise.
    seeds : int
        How many runs.
    """

    trial: Trial
    contender: Contender
    reading: Reading
    period: float
    values: dict[str, float]
    spread: dict[str, NoiseBand]
    seeds: int

    def as_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        flat = {name: value for name, value in self.values.items() if name not in SPLITS}
        split = {
            f"{index}_split": {part: self.values[f"{index}_{part}"] for part in PARTS}
            for index in INDICES
        }
        return {
            "test": self.trial.name,
            **self.contender.as_dict(),
            "poles": self.contender.poles.pairs,
            "equilibrium": self.reading.equilibrium,
            "method": self.reading.method,
            "sample_time": self.period if self.reading.method else 0.0,
            **flat,
            "crashed": flat["crashed"] > 0,
            "crashed_share": flat["crashed"],
            **split,
            "seeds": self.seeds,
            "spread": {name: x for name, x in self.spread.items() if name not in SPLITS},
        }


@dataclass(frozen=True)
class Curve:
    """What a figure shows of one run: times, gap, reference and commanded voltage."""

    label: str
    times: Array
    gap: Array
    reference: Array
    commanded: Array


@dataclass(frozen=True)
class LoopMargins:
    """Margins of one controller's sampled linear loop, each worst over path and ratios.

    Attributes
    ----------
    contender : Contender
    reading : Reading
    margins : Margins
        By python-control; nan where the loop is unstable somewhere.
    ms_one_more_sample : float
        Ms with one more sample of delay; nan where that is unstable.
    """

    contender: Contender
    reading: Reading
    margins: Margins
    ms_one_more_sample: float

    def as_dict(self) -> dict[str, Any]:
        """Return the margins for JSON."""
        return {
            **self.contender.as_dict(),
            "equilibrium": self.reading.equilibrium,
            "method": self.reading.method,
            **self.margins.as_dict(),
            "ms_one_more_sample": self.ms_one_more_sample,
        }


def loop_margins(rig: Rig, contender: Contender, reading: Reading) -> LoopMargins:
    """Return the margins of a sampled loop over the rig's path and uncertainty of beta."""
    own, method = rig_for(rig, reading), reading.method
    if method is None:
        raise ValueError("a continuous controller has no sampled loop")
    over = family_of(own)
    poles = contender.poles.values
    believed = believed_equilibrium(
        own, reading.equilibrium, voltage=voltage_on_plant(own, plant_beta(own))
    )
    law = contender.controller
    now, later = (
        build_loop(own, believed, method=method, controller=law, extra_samples=extra)
        for extra in (0, 1)
    )
    stable = spectral_radius(later, poles, over).value < 1
    return LoopMargins(
        contender,
        reading,
        sampled_margins(now, poles, over),
        peak_sensitivity(later, poles, over).value if stable else math.nan,
    )


@dataclass(frozen=True)
class Comparison:
    """All results, and the curves of the default variants (first seed) for the figures."""

    rig: Rig
    results: tuple[Result, ...]
    curves: dict[str, tuple[Curve, ...]]
    margins: tuple[LoopMargins, ...]


def compare(
    rig: Rig,
    chosen: Sequence[Contender],
    readings: Sequence[Reading],
    *,
    seeds: int,
    seed: int = 0,
    emulate: bool = True,
    progress: Progress = lambda _stage, _done: None,
) -> Comparison:
    """Run every controller through every test under every reading.

    Parameters
    ----------
    chosen : sequence of Contender
        Those with the variant "default" are drawn.
    readings : sequence of Reading
        The first is the one whose curves are kept.
    seeds : int
        Runs where noise enters, with seeds `seed`, `seed` + 1, ...
    emulate : bool
        Whether the rig emulator follows the three tests.
    """
    trials = (*TRIALS, EMULATION) if emulate else TRIALS
    rounds = [(t, r, c) for t in trials for r in readings for c in chosen if _possible(t, r)]
    results: list[Result] = []
    curves: dict[str, list[Curve]] = {trial.name: [] for trial in trials}
    for n, (trial, reading, contender) in enumerate(rounds):
        progress(trial.title, n / len(rounds))
        count = seeds if trial.noise else 1
        runs = []
        for k in range(count):
            own, response = run_trial(rig, contender, trial, reading, seed=seed + k)
            runs.append(figures(own, response))
            if k == 0 and reading == readings[0] and contender.variant == "default":
                drawn = (response.times, response.gap, response.reference, response.commanded)
                curves[trial.name].append(Curve(contender.label, *drawn))
        values, spread = summarise(runs)
        period = own.sampling.period
        results.append(Result(trial, contender, reading, period, values, spread, count))
    shown = {name: tuple(c) for name, c in curves.items() if c}
    progress("margins", 1.0)
    margins = [loop_margins(rig, c, r) for r in readings if r.method for c in chosen]
    return Comparison(rig, tuple(results), shown, tuple(margins))


def _possible(trial: Trial, reading: Reading) -> bool:
    """Whether a test makes sense under a reading: the emulated rig runs a sampled controller."""
    return not (trial.emulate and reading.method is None)


def summarise(runs: Sequence[dict[str, float]]) -> tuple[dict[str, float], dict[str, NoiseBand]]:
    """Return the medians of the runs and, of more than one, their 95 % intervals.

    A run in which something never happens (nan) counts as the worst; ``crashed`` is a share.
    """
    if len(runs) == 1:
        return dict(runs[0]), {}
    values: dict[str, float] = {}
    spread: dict[str, NoiseBand] = {}
    for name in runs[0]:
        column = np.array([math.inf if math.isnan(run[name]) else run[name] for run in runs])
        if name == "crashed":
            values[name] = float(column.mean())
            continue
        # order statistics: between a number and infinity nothing can be interpolated
        low, high = (float(np.quantile(column, q, method="nearest")) for q in INTERVAL)
        spread[name] = NoiseBand(float(np.median(column)), low, high)
        values[name] = spread[name].median if math.isfinite(spread[name].median) else math.nan
    return values, spread
