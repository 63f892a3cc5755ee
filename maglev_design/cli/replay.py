"""``simulate --replay``: one scenario of a sweep, found again from its ``sweep.json``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maglev_design import sweeping as sweeps
from maglev_design.controller.data import design_from_data
from maglev_design.controller.design import Design
from maglev_design.errors import InputError
from maglev_design.files import read_document
from maglev_design.record import rig_from_data
from maglev_design.rig import Rig
from maglev_design.simulation import Response, Scenario, total_variation

TOLERANCE = 1e-10
"""Relative, between the back ends."""
LARGEST = 50_000_000
"""[bytes]"""
COMPARED = tuple(n for n in sweeps.FIGURES if n not in ("final_error", "crash_time"))
"""Not the final error: a small difference of two gaps, relative to which rounding is large."""


@dataclass(frozen=True)
class Replayed:
    """One scenario, ready to run, and what the sweep recorded of it (None without)."""

    rig: Rig
    design: Design
    scenario: Scenario
    position: int
    drawn: dict[str, float]
    recorded: dict[str, float] | None

    def as_dict(self, off: float | None) -> dict[str, Any]:
        """Return it for JSON; `off` is how far the figures are from the recorded ones."""
        return {
            "scenario": self.scenario.index,
            "design": self.position,
            "drawn": self.drawn,
            "relative_difference": off,
        }


def replayed(text: str) -> Replayed:
    """Return the scenario named by ``FILE:SCENARIO`` or ``FILE:SCENARIO:DESIGN``."""
    path, k, position = _parsed(text)
    document = read_document(path, "the result of a sweep", LARGEST)
    data = document.get("setup", document)
    if not isinstance(data, dict) or data.get("kind") != sweeps.KIND:
        raise InputError(f"{path}: not the result of a sweep (its sweep.json is needed)")
    try:
        setup = _setup(data, path)
        rows = document["designs"][position : position + 1] if "setup" in document else []
        stored = next((x for row in rows for x in row["worst"] if x["scenario"] == k), None)
        drawn = None if stored is None else {n: float(v) for n, v in stored["drawn"].items()}
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(f"{path}: damaged: {type(error).__name__} at {error}") from error
    if setup.key != data.get("key"):
        raise InputError(
            f"{path}: edited, damaged or by another version: its content does not match its key; "
            "run the sweep again"
        )
    if not 0 <= k < setup.samples:
        raise InputError(f"--replay: scenario = {k}: must be from 0 to {setup.samples - 1} [-]")
    if position >= len(setup.designs):
        raise InputError(
            f"--replay: design = {position}: must be from 0 to {len(setup.designs) - 1} [-]"
        )
    plants = _plants(setup, k, drawn, path)
    return Replayed(
        setup.rig,
        setup.designs[position],
        sweeps.scenario(setup, plants, 0),
        position,
        {name: float(column[0]) for name, column in plants.drawn.items()},
        _recorded(setup, path, position, k, document),
    )


def _plants(
    setup: sweeps.Setup, k: int, drawn: dict[str, float] | None, path: Path
) -> sweeps.Plants:
    """Return the scenario as it was drawn: stored among the worst, or drawn again."""
    if drawn is None:
        return sweeps.plants(setup, k, 1)
    if set(drawn) != set(setup.spreads):
        raise InputError(f"{path}: damaged: what was drawn in scenario {k} is not all there")
    columns = {name: np.array([value]) for name, value in drawn.items()}
    return sweeps.plants_of(setup, k, 1, columns)


def difference(found: Replayed, response: Response) -> float | None:
    """Return the largest relative difference from what the sweep recorded; None without it."""
    if found.recorded is None:
        return None
    metrics, worst = response.metrics, 0.0
    for name in COMPARED:
        old = found.recorded[name]
        new = total_variation(response) if name == "total_variation" else getattr(metrics, name)
        if new != old:
            scale = max(abs(old), abs(new))
            off = abs(new - old) / scale if math.isfinite(scale) else math.inf
            worst = max(worst, off)
    crashed = not math.isnan(found.recorded["crash_time"])
    return worst if crashed == metrics.crashed else math.inf


def _recorded(
    setup: sweeps.Setup, path: Path, position: int, k: int, document: dict[str, Any]
) -> dict[str, float] | None:
    """Return what the chunk beside a file holds of a scenario; None where there is none.

    A ``sweep.json`` says which chunks are its own; one of an earlier version does not, and has
    none. A ``setup.json`` is there before they are.
    """
    number = k // setup.chunk
    try:
        found = sweeps.chunk_sha256(path.parent, number)
        figures = sweeps.recorded(setup, path.parent, position, k)
    except InputError:  # moved away, or not computed yet
        return None
    if "setup" not in document:
        return figures
    told = document.get("chunks_sha256")
    if not isinstance(told, list):
        return None
    if len(told) != setup.chunks or found != told[number]:
        raise InputError(
            f"{path}: chunk {number} beside it is not the one that it was made from; run the "
            "sweep again"
        )
    return figures


def _parsed(text: str) -> tuple[Path, int, int]:
    """Return file, scenario and design; a colon may be in the file's name."""
    words = text.rsplit(":", 2)
    numbers = [word for word in words[1:] if word.isascii() and word.isdigit()]
    if len(words) == 3 and len(numbers) == 2 and not Path(text.rsplit(":", 1)[0]).exists():
        return Path(words[0]), int(words[1]), int(words[2])
    head, _, last = text.rpartition(":")
    if not head or not (last.isascii() and last.isdigit()):
        raise InputError(
            f"--replay {text!r}: must be FILE:SCENARIO or FILE:SCENARIO:DESIGN, such as "
            "out/sweep.json:17, with whole numbers from 0 on"
        )
    return Path(head), int(last), 0


def _setup(data: dict[str, Any], path: Path) -> sweeps.Setup:
    """Return the setup of a description."""
    rig = rig_from_data(data["rig"], str(path))
    designs = [design_from_data(one, str(path)) for one in data["designs"]]
    chosen = {name: data[name] for name in sweeps.OF_A_SWEEP}
    return sweeps.Setup(rig, tuple(designs), **chosen, beta_error=data.get("beta_error"))
