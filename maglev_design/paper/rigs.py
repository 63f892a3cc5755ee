"""Random rigs on which the claims that are general have to hold as well."""

from __future__ import annotations

from typing import Any

import numpy as np

from maglev_design.controller import design
from maglev_design.rig import Rig, make_rig

HEADROOM = (1.5, 3.0)
"""The actuator's range over the largest voltage at rest on the way."""
TRAVEL = (0.1, 0.6)
"""The end of the move lies between Y/(1 + x) and Y (1 + x), x in this range."""


def random_rigs(count: int, seed: int) -> tuple[Rig, ...]:
    """Return `count` plausible rigs, the same for the same `seed`.

    Balls of 5 to 200 g, gaps of 5 to 40 mm, magnets with and without an offset of the gap, moves
    up and down. The actuator reaches what the path needs at rest and half as much again; no rig
    brings a measured voltage, so that the equilibrium is that of its own plant.

    Examples
    --------
    >>> [rig.name for rig in random_rigs(2, seed=5)]
    ['random rig 0 of seed 5', 'random rig 1 of seed 5']
    """
    rng = np.random.default_rng(seed)
    return tuple(_rig(rng, f"random rig {n} of seed {seed}") for n in range(count))


def random_poles(count: int, seed: int) -> tuple[tuple[float, float], ...]:
    """Return `count` pairs of a damping ratio and of omega_n in units of sqrt(C_Y).

    From a badly damped pair to an overdamped one, from barely faster than the plant falls to
    five times as fast.
    """
    rng = np.random.default_rng(seed)
    return tuple((float(rng.uniform(0.5, 1.6)), float(rng.uniform(1.2, 5.0))) for _ in range(count))


def _rig(rng: np.random.Generator, name: str) -> Rig:
    gap = _between(rng, 0.005, 0.04)
    offset = _between(rng, 0.0005, 0.006) if rng.random() < 0.5 else 0.0
    start = gap * float(rng.uniform(0.9, 1.1))
    end = gap * (1 + float(rng.uniform(*TRAVEL))) ** float(rng.choice([-1.0, 1.0]))
    wait, move = float(rng.uniform(0.2, 1.0)), float(rng.uniform(1.0, 6.0))
    data: dict[str, Any] = {
        "name": name,
        "plant": {
            "mass": _between(rng, 0.005, 0.2),
            "gravity": float(rng.uniform(9.78, 9.84)),
            "current_gain": _between(rng, 0.1, 3.0),
            "force_constant": _between(rng, 2e-6, 2e-4),
            "gap_offset": offset,
        },
        "operating_point": {"gap": gap},
        "initial": {"gap": gap * float(rng.uniform(0.97, 1.03))},
        "reference": {
            "start_gap": start,
            "end_gap": end,
            "start_time": wait,
            "end_time": wait + move,
            "horizon": wait + move + 1.0,
        },
        "sampling": {
            "period": _between(rng, 2e-4, 1e-3),
            "method": str(rng.choice(["tustin", "euler", "zoh"])),
        },
        "uncertainty": {"beta": float(rng.uniform(0.05, 0.3))},
    }
    largest = max(gap, start, end, data["initial"]["gap"])
    unlimited = make_rig(data, name)
    need = design.true_equilibrium(unlimited, design.plant_beta(unlimited), largest).U
    data["limits"] = {
        "voltage": [0.0, need * float(rng.uniform(*HEADROOM))],
        "gap": [gap / 5, 3 * gap],
    }
    return make_rig(data, name)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is equally likely anywhere in the range."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
