"""Times: the least of several, the contenders taken in turn."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

Job = Callable[[], Any]


def seconds(job: Job, *, wall: bool = False) -> float:
    """Return how long one run of `job` takes: processor time, or that of the clock on the wall."""
    clock = time.perf_counter if wall else time.process_time
    start = clock()
    job()
    return clock() - start


def side_by_side(
    jobs: Mapping[str, Job], runs: int, *, wall: bool = False, before: bool = True
) -> dict[str, float]:
    """Return the least time of each job [s].

    They take turns, so that what slows the machine for a while slows all of them. Each is run once
    `before`, without the clock.
    """
    for job in jobs.values() if before else ():
        job()
    found = dict.fromkeys(jobs, float("inf"))
    for _ in range(runs):
        for name, job in jobs.items():
            found[name] = min(found[name], seconds(job, wall=wall))
    return found
