"""Rigs for the tests: plain data to change, and the loops that take milliseconds to run."""

from __future__ import annotations

import copy
from typing import Any

from maglev_design.rig import Rig, make_rig

MINIMAL: dict[str, Any] = {
    "plant": {
        "mass": 0.02,
        "gravity": 9.81,
        "current_gain": 1.05,
        "force_constant": 2.48315625e-5,
    },
    "operating_point": {"gap": 0.0246},
    "sampling": {"period": 0.001},
}
"""What a rig file has to say, and nothing else."""

SHORT: dict[str, Any] = {
    **MINIMAL,
    "initial": {"gap": 0.0244},
    "reference": {
        "start_gap": 0.0242,
        "end_gap": 0.0200,
        "start_time": 0.1,
        "end_time": 0.3,
        "horizon": 0.4,
    },
    "limits": {"voltage": [0.0, 5.0], "gap": [0.001, 0.05]},
    "noise": {"input": 1e-3, "position": 1e-6},
}
"""A quick move of the ball of the paper: 400 samples."""

QUICK: dict[str, Any] = {
    **MINIMAL,
    "sampling": {"period": 0.002},
    "initial": {"gap": 0.0246},
    "reference": {
        "start_gap": 0.0242,
        "end_gap": 0.0180,
        "start_time": 0.05,
        "end_time": 0.35,
        "horizon": 0.4,
    },
    "limits": {"voltage": [0.0, 5.0], "gap": [0.001, 0.05]},
    "noise": {"input": 1e-3, "position": 1e-6},
    "uncertainty": {"beta": 0.1},
}
"""The ball of the paper moved in 0.3 s: 200 samples."""

STUBBORN: dict[str, Any] = {
    "plant": {
        "mass": 0.0157,
        "gravity": 3.71,
        "current_gain": 1.81,
        "force_constant": 3.239e-07,
    },
    "operating_point": {"gap": 0.00467},
    "initial": {"gap": 0.00486},
    "reference": {
        "start_gap": 0.00479,
        "end_gap": 0.0028,
        "start_time": 0.3,
        "end_time": 1.66,
        "horizon": 2.06,
    },
    "sampling": {"period": 0.002, "delay": 0.0034, "method": "zoh"},
    "limits": {"voltage": [0.0, 3.2], "gap": [0.00056, 0.00958]},
    "noise": {"input": 0.001, "position": 2.79e-06},
    "uncertainty": {"beta": 0.05},
}
"""Feasible but for Ms: of all double pole pairs in the box that `tune` searches, its smallest is
3.2287, at zeta = 1.898, omega_n = 24.50 rad/s, where every other limit is kept.
"""

OFFSET: dict[str, Any] = {
    "plant": {
        "mass": 0.057,
        "gravity": 9.80665,
        "current_gain": 0.4,
        "force_constant": 6.5e-5,
        "gap_offset": 0.0042,
    },
    "operating_point": {"gap": 0.010},
    "sampling": {"period": 0.0005},
    "initial": {"gap": 0.0105, "velocity": -0.01},
    "reference": {
        "start_gap": 0.010,
        "end_gap": 0.013,
        "start_time": 0.05,
        "end_time": 0.2,
        "horizon": 0.25,
    },
    "limits": {"voltage": [0.0, 24.0], "gap": [0.0005, 0.03]},
    "noise": {"input": 2e-3, "position": 5e-7},
}
"""A heavier ball on a magnet with a gap offset, another gravity, moving downwards at the start."""


def changed(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return a deep copy of `base` with dotted keys set; the value `...` deletes the key."""
    data = copy.deepcopy(base)
    for dotted, value in changes.items():
        *path, last = dotted.split(".")
        table = data
        for part in path:
            table = table.setdefault(part, {})
        if value is ...:
            del table[last]
        else:
            table[last] = copy.deepcopy(value)
    return data


def rig_with(base: dict[str, Any], changes: dict[str, Any] | None = None) -> Rig:
    """Return the validated rig of :func:`changed` data."""
    return make_rig(changed(base, changes or {}))
