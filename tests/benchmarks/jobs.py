"""Whole jobs: a robust tuning here and with python-control and scipy.optimize; a sweep."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import approx_fprime

from benchmarks.loops import FIELDS, Subject, numbers
from benchmarks.peers import Problem, control_loop
from maglev_design import sweeping as sweeps
from maglev_design.controller.design import PoleSpec, make_design
from maglev_design.tuning import (
    TuneResult,
    build_problem,
    evaluation,
    figures,
    result,
    search,
    solve,
)

TOLERANCE = 1e-6


@contextmanager
def counted(name: str, modules: Sequence[Any], tell: Callable[..., None]) -> Iterator[None]:
    """Time every call of a function of the package, wherever its name is known, and tell."""
    before = [(module, getattr(module, name)) for module in modules if hasattr(module, name)]

    def timed(original: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        start = time.process_time()
        found = original(*arguments, **options)
        tell(time.process_time() - start, *arguments)
        return found

    for module, original in before:
        setattr(module, name, partial(timed, original))
    try:
        yield
    finally:
        for module, original in before:
            setattr(module, name, original)


@contextmanager
def apart(
    name: str, module: Any, loops: dict[str, list[tuple[float, int]]], seconds: list[float]
) -> Iterator[None]:
    """Time a function of the package and forget the loops that it runs."""
    original = getattr(module, name)

    def timed(*arguments: Any, **options: Any) -> Any:
        before = {kind: len(calls) for kind, calls in loops.items()}
        start = time.process_time()
        found = original(*arguments, **options)
        seconds.append(time.process_time() - start)
        for kind, calls in loops.items():
            del calls[before[kind] :]
        return found

    setattr(module, name, timed)
    try:
        yield
    finally:
        setattr(module, name, original)


def tuning(of: Subject, runs: int) -> dict[str, Any]:
    """Return the least processor time [s] of a robust tuning, warm, in parts, and its loops.

    What a measurement of U would bring and the rows of the emulated rig are counted apart.
    """
    stated = build_problem(of.rig, scenarios="robust")
    best: dict[str, Any] = {"solve": float("inf")}
    for _ in range(runs + 1):
        verifying: list[float] = []
        rows: list[float] = []
        loops: dict[str, list[tuple[float, int]]] = {"plain": [], "carrying": []}

        def told(took: float, graph: Any, designs: Any, *_: Any, into: Any = loops) -> None:
            into["carrying" if graph.directions else "plain"].append((took, len(designs)))

        modules = (evaluation, search, figures, result)
        with (
            counted("resimulate", [figures], lambda took, *_, into=verifying: into.append(took)),
            counted("simulate_batch", modules, told),
            apart("_planned", result, loops, rows),
            apart("emulated_row", result, loops, rows),
        ):
            start = time.process_time()
            found = solve(stated)
            total = time.process_time() - start
        if not isinstance(found, TuneResult):
            raise TypeError("the paper's rig can be tuned")
        row = {
            "solve": total - sum(verifying) - sum(rows),
            "verification": sum(verifying),
            "rows": sum(rows),
            "evaluations": found.evaluations,
            "poles": list(found.poles.first),
        }
        for kind, calls in loops.items():
            row[f"{kind}_loops"] = sum(count for _, count in calls)
            row[f"{kind}_seconds"] = sum(took for took, _ in calls)
        if row["solve"] < best["solve"]:
            best = row
    return best


def peer_tuning(of: Subject, ratios: int) -> dict[str, Any]:
    """Time a labelled part of the tuning as python-control and scipy.optimize would do it.

    What SLSQP asks for at its first point, the paper's poles: the worst ITAE of the continuous
    loop over `ratios` values of beta, and its gradient by scipy.optimize's own differences.
    """
    stated = Problem(of)
    run = control_loop(stated)
    beta, error = of.scenario.beta_plant, of.rig.uncertainty.beta
    count = itertools.count()

    def worst(x: Any) -> float:
        poles = PoleSpec.double(float(x[0]), 100 * float(x[1]))
        moved = numbers(replace(of, design=make_design(of.rig, poles)))
        for name in FIELDS:  # the loop keeps its own
            setattr(stated.law, name, getattr(moved, name))
        values = []
        for ratio in np.linspace(1 - error, 1 + error, ratios):
            next(count)
            values.append(run(TOLERANCE, beta / float(ratio)))
        return 1e5 * max(values)

    start, first = time.process_time(), [1.0, 0.7]
    worst(first)
    approx_fprime(first, worst)
    took = time.process_time() - start
    return {"seconds": took, "loops": next(count), "ratios": ratios}


def sweeping(of: Subject, folder: Path, samples: int, chunk: int, *, apart: bool) -> dict[str, Any]:
    """Return the scenarios a second of a sweep, start included: here and, `apart`, in processes."""
    setup = sweeps.make_setup(of.rig, (of.design,), samples=samples, chunk=chunk)
    runners: dict[str, Any] = {
        "warming": sweeps.in_process,
        "here": sweeps.in_process,
    }
    if apart:
        runners["one process"] = partial(sweeps.in_processes, jobs=1)
        runners["two processes"] = partial(sweeps.in_processes, jobs=2)
    found: dict[str, Any] = {"samples": samples, "chunk": chunk}
    for name, runner in runners.items():
        (folder / name).mkdir(parents=True)
        start = time.perf_counter()
        sweeps.sweep(setup, folder / name, runner)
        found[name] = samples / (time.perf_counter() - start)
    del found["warming"]
    return found


def steady(of: Subject, samples: int, chunk: int) -> dict[str, float]:
    """Return the chunks' rate [scenarios/s] once the processes are up, on one and on two."""
    setup = sweeps.make_setup(of.rig, (of.design,), samples=samples, chunk=chunk)
    found = {}
    for jobs in (1, 2):
        work = sweeps.in_processes(setup, range(setup.chunks), jobs=jobs)
        for _ in range(2 * jobs):  # importing, compiling, and what was begun meanwhile
            next(work)
        start, done = time.perf_counter(), 0
        for _ in work:
            done += 1
        found[f"{jobs} processes"] = done * chunk / (time.perf_counter() - start)
    return found
