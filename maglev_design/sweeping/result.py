"""What a sweep found: who survives, quantiles, and the worst, each to be replayed alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.design import Design
from maglev_design.options import SCHEMA_VERSION
from maglev_design.sweeping.chunks import chunk_sha256, column, read
from maglev_design.sweeping.scenarios import FIGURES
from maglev_design.sweeping.setup import Setup

Array = NDArray[np.float64]
Quantiles = Mapping[str, Mapping[str, float]]

PROBABILITIES = (0.0, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 1.0)
WORST = 10
CONFIDENCE = 0.95


@dataclass(frozen=True)
class DesignResult:
    """What one design did.

    Attributes
    ----------
    design : Design
    stable_fraction : float
        Share of the scenarios in which the ball levitates to the end.
    interval : tuple of float
        Of the probability behind it, 95 %, Clopper and Pearson: exact for independent draws.
    quantiles, quantiles_of_stable : mapping
        figure -> probability (as text) -> value, of all scenarios and of those that levitate to
        the end (empty when none does). Each is the value of one scenario.
    worst : tuple of mapping
        The scenarios with the largest ITAE, the worst first: scenario, seed, what was drawn, and
        every figure.
    """

    design: Design
    stable_fraction: float
    interval: tuple[float, float]
    quantiles: Quantiles
    quantiles_of_stable: Quantiles
    worst: tuple[Mapping[str, Any], ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        design = self.design
        return {
            "controller": design.controller.name,
            "variant": design.controller.variant or "default",
            "poles": design.poles.pairs,
            "equilibrium": design.equilibrium,
            "method": design.method,
            "controller_sha256": design.sha256,
            "stable_fraction": self.stable_fraction,
            "stable_fraction_interval": list(self.interval),
            "quantiles": self.quantiles,
            "quantiles_of_stable": self.quantiles_of_stable,
            "worst": [dict(one) for one in self.worst],
        }


@dataclass(frozen=True)
class SweepResult:
    """What a sweep found.

    Attributes
    ----------
    setup : Setup
    designs : tuple of DesignResult
        In the order of the setup.
    chunks_sha256 : tuple of str
        Hash of every chunk's file.
    """

    setup: Setup
    designs: tuple[DesignResult, ...]
    chunks_sha256: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON; what stands at the top is of the first design."""
        rows = [found.as_dict() for found in self.designs]
        first = rows[0]
        tops = ("stable_fraction", "stable_fraction_interval", "quantiles")
        return {
            "schema_version": SCHEMA_VERSION,
            "samples": self.setup.samples,
            **{name: first[name] for name in (*tops, "quantiles_of_stable", "worst")},
            "designs": rows,
            "drawn": {
                name: spread.model_dump(exclude_none=True)
                for name, spread in self.setup.spreads.items()
            },
            "beta_from": self.setup.beta_from,
            "setup": self.setup.description,
            "chunks_sha256": self.chunks_sha256,
        }


def summarise(setup: Setup, folder: Path) -> SweepResult:
    """Return the result of a folder in which every chunk is done; one column at a time."""
    rows = (_of_design(setup, folder, n, design) for n, design in enumerate(setup.designs))
    hashes = tuple(chunk_sha256(folder, number) for number in range(setup.chunks))
    return SweepResult(setup, tuple(rows), hashes)


def _of_design(setup: Setup, folder: Path, position: int, design: Design) -> DesignResult:
    stable = np.isnan(column(setup, folder, f"{position}_crash_time"))
    survivors = int(stable.sum())
    everywhere: dict[str, Mapping[str, float]] = {}
    surviving: dict[str, Mapping[str, float]] = {}
    worst: tuple[Mapping[str, Any], ...] = ()
    for name in FIGURES:
        if name == "crash_time":
            continue
        values = column(setup, folder, f"{position}_{name}")
        if name == "itae":
            worst = tuple(_record(setup, folder, position, k) for k in largest(values))
        everywhere[name] = quantiles(values)
        if survivors:
            surviving[name] = quantiles(values[stable])
    return DesignResult(
        design,
        survivors / setup.samples,
        proportion_interval(survivors, setup.samples),
        everywhere,
        surviving,
        worst,
    )


def quantiles(values: Array) -> dict[str, float]:
    """Return the smallest values that a share p of them does not exceed.

    Examples
    --------
    >>> quantiles(np.array([3.0, 1.0, 2.0]))["0.5"]
    2.0
    """
    ordered = np.sort(values)
    count = len(ordered)
    return {
        f"{p:g}": float(ordered[min(max(math.ceil(p * count) - 1, 0), count - 1)])
        for p in PROBABILITIES
    }


def largest(values: Array) -> list[int]:
    """Return where the largest values are, what is not finite before all, then by number.

    Examples
    --------
    >>> largest(np.array([1.0, 5.0, np.nan, 5.0]))
    [2, 1, 3, 0]
    """
    ranked = np.where(np.isfinite(values), values, np.inf)
    return [int(k) for k in np.argsort(-ranked, kind="stable")[:WORST]]


def proportion_interval(hits: int, count: int) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of a probability of which `hits` in `count` were seen.

    Examples
    --------
    >>> [round(end, 4) for end in proportion_interval(1000, 1000)]
    [0.9963, 1.0]
    """
    from scipy.special import betaincinv  # noqa: PLC0415 - slow to import

    tail = (1 - CONFIDENCE) / 2
    low = betaincinv(hits, count - hits + 1, tail) if hits else 0.0
    high = betaincinv(hits + 1, count - hits, 1 - tail) if hits < count else 1.0
    return float(low), float(high)


def _record(setup: Setup, folder: Path, position: int, k: int) -> dict[str, Any]:
    """Return one scenario: how to find it, what was drawn, what happened."""
    number, n = divmod(k, setup.chunk)
    figures = recorded(setup, folder, position, k)
    crash_time = figures.pop("crash_time")
    crash = None
    if not math.isnan(crash_time):
        dropped = figures["max_gap"] >= setup.rig.limits.gap[1]
        crash = {"where": "dropped" if dropped else "magnet", "time": crash_time}
    drawn = {name: float(read(setup, folder, number, f"drawn_{name}")[n]) for name in setup.spreads}
    return {
        "seed": setup.seed,
        "scenario": k,
        "design": position,
        **{name: value if math.isfinite(value) else None for name, value in figures.items()},
        "crashed": crash is not None,
        "crash": crash,
        "drawn": drawn,
    }


def recorded(setup: Setup, folder: Path, position: int, k: int) -> dict[str, float]:
    """Return the figures of one scenario by name, as its chunk holds them."""
    number, n = divmod(k, setup.chunk)
    return {name: float(read(setup, folder, number, f"{position}_{name}")[n]) for name in FIGURES}
