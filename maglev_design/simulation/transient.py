"""What one reads off a response by eye: settling, undershoot, effort."""

from __future__ import annotations

import math

import numpy as np

from maglev_design.rig import Rig
from maglev_design.simulation.response import Response

SETTLED = 0.02
"""Share of the initial error within which the ball counts as settled."""


def total_variation(response: Response) -> float:
    """Return the total variation of the applied voltage, sum |u_{k+1} - u_k| [V].

    The step from rest to the first voltage is not counted: nobody knows what acted before.
    """
    return float(np.abs(np.diff(response.applied)).sum())


def settling_time(rig: Rig, response: Response) -> float:
    """Return when |e| falls below 2 % of |e(0)| for the rest of the time before the move [s].

    nan when it has not by the start of the move; 0 for a ball that starts on the reference.
    """
    error, times = _start(rig, response)
    outside = np.abs(error) > SETTLED * abs(error[0])
    if not error[0] or not outside.any():
        return 0.0
    last = int(np.flatnonzero(outside)[-1])
    return float(times[last + 1]) if last + 1 < len(times) else math.nan


def undershoot(rig: Rig, response: Response) -> float:
    """Return how far the ball passes the reference before the move, as a share of |e(0)| [-].

    nan for a ball that starts on the reference.
    """
    error, _ = _start(rig, response)
    if not error[0]:
        return math.nan
    return max(0.0, float((-np.sign(error[0]) * error).max()) / abs(float(error[0])))


def _start(rig: Rig, response: Response) -> tuple[np.ndarray, np.ndarray]:
    """Return error and time up to the start of the move (to the end where there is none)."""
    path = rig.reference
    moves = path.end_gap != path.start_gap and path.start_time > 0
    chosen = response.times <= (path.start_time if moves else path.horizon)
    return (response.gap - response.reference)[chosen], response.times[chosen]
