"""Every measurement, in one run, as plain data."""

from __future__ import annotations

import os
import platform
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks import jobs, peers, processes
from benchmarks.clock import Job, side_by_side
from benchmarks.loops import DIRECTIONS, Subject, Yardstick, batch, graph, subject
from maglev_design.simulation import compiled, cores, lanes, simulate_batch
from maglev_design.simulation.response import simulate

Tell = Callable[[str], None]
Data = dict[str, Any]


@dataclass(frozen=True)
class Sizes:
    """How much of everything."""

    runs: int
    lanes: int
    scaling: tuple[int, ...]
    tolerances: tuple[float, ...]
    control: tuple[float, ...]
    refined: tuple[int, ...]
    starts: int
    commands: int
    memory: tuple[int, ...]
    tune_runs: int
    peer: int
    sweep: tuple[int, int]
    peers: bool


FULL = Sizes(
    runs=15,
    lanes=256,
    scaling=(1, 2, 4, 8, 16, 64, 256, 1024),
    tolerances=(1e-4, 1e-6, 1e-8),
    control=(1e-4, 1e-6, 1e-8),
    refined=(1, 2, 4),
    starts=2,
    commands=5,
    memory=(0, 2_000, 20_000),
    tune_runs=1,
    peer=5,
    sweep=(8192, 512),
    peers=True,
)
QUICK = Sizes(
    runs=1,
    lanes=8,
    scaling=(1, 8),
    tolerances=(1e-4,),
    control=(),
    refined=(1,),
    starts=1,
    commands=1,
    memory=(8,),
    tune_runs=0,
    peer=0,
    sweep=(16, 8),
    peers=False,
)


def measured(sizes: Sizes, tell: Tell) -> Data:
    """Return everything that was measured; times in seconds."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["MAGLEV_DESIGN_CACHE"] = str(folder / "own")
        of = subject(short=sizes is QUICK)
        yard = Yardstick(of, folder)
        found: Data = {"schema_version": 1, "quick": sizes is QUICK, "machine": machine()}
        parts: dict[str, Callable[[], Any]] = {
            "loops": lambda: loops(of, yard, sizes),
            "precision": lambda: precision(of, yard, sizes),
            "scaling": lambda: scaling(of, yard, sizes),
            "start": lambda: processes.cold_and_warm(folder, sizes.starts, sizes.memory),
            "commands": lambda: processes.start_up(folder, sizes.commands),
            "tune": lambda: tune(of, yard, sizes),
            "sweep": lambda: sweep(of, folder, sizes),
        }
        for part, work in parts.items():
            tell(part)
            found[part] = work()
    return found


def machine() -> Data:
    """Return what the ratios depend on, and nothing that names the machine or its user."""
    path = compiled.compiler() or ""
    text = subprocess.run(  # noqa: S603 - the system's compiler
        [path, "-dumpfullversion"], capture_output=True, text=True, check=False
    )
    return {
        "cores": cores(),
        "lanes": lanes.LANES,
        "architecture": platform.machine(),
        "compiler": f"{Path(path).name} {text.stdout.strip()}",
        "flags": list(compiled.FLAGS),
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "scipy", "casadi", "control")},
    }


def _again(job: Callable[[], Any], times: int = 5) -> tuple[Job, int]:
    """Return a job that repeats a short one, so that none pays for the caches of the one before."""

    def repeated() -> None:
        for _ in range(times):
            job()

    return repeated, times


def loops(of: Subject, yard: Yardstick, sizes: Sizes) -> Data:
    """Return the processor time of one loop by every road of our own, with its error."""
    continuous, sampled = (graph(of, continuous=c) for c in (True, False))
    count = sizes.lanes
    one, held = batch(of, continuous, 1), batch(of, sampled, 1)
    many = batch(of, sampled, count)
    noisy = batch(of, sampled, count, noise=True)
    together = batch(of, continuous, count)
    carrying = {d: batch(of, graph(of, continuous=False, directions=d), count) for d in DIRECTIONS}
    alone = batch(of, graph(of, continuous=False, directions=2), 1)
    work: dict[str, tuple[Job, int]] = {
        "yardstick": _again(yard.itae),
        "single, continuous": _again(one.run),
        "single, continuous, simulate_batch": _again(one.called),
        "single, sampled": _again(held.run),
        "single, sampled, simulate_batch": _again(held.called),
        "single, sampled, 2 sensitivities": _again(alone.run),
        "lanes, continuous": (together.run, count),
        "lanes, sampled": (many.run, count),
        "lanes, sampled, noise": (noisy.run, count),
        "lanes, sampled, simulate_batch": (many.called, count),
        "lanes, sampled, noise, simulate_batch": (noisy.called, count),
        "lanes, sampled, 2 sensitivities": (carrying[2].run, count),
        "lanes, sampled, 4 sensitivities": (carrying[4].run, count),
        "interpreted, continuous": (lambda: one.called("interpreted"), 1),
        "interpreted, sampled": (lambda: held.called("interpreted"), 1),
        "interpreted, sampled, 2 sensitivities": (lambda: alone.called("interpreted"), 1),
    }
    times = side_by_side({name: job for name, (job, _) in work.items()}, sizes.runs)
    tight = graph(of, continuous=False, refine=16 if sizes.peers else 2)
    exact = simulate(tight, of.design, of.scenario).metrics.itae
    reference = peers.tight_reference(peers.Problem(of))
    errors = {
        "yardstick": abs(yard.itae() / reference - 1),
        "continuous": abs(one.itae() / reference - 1),
        "sampled": abs(held.itae() / exact - 1),
    }
    back_ends = abs(held.itae() / simulate(sampled, of.design, of.scenario).metrics.itae - 1)
    return {
        "seconds": {name: times[name] / n for name, (_, n) in work.items()},
        "errors": errors,
        "back_ends": back_ends,
        "batch": count,
    }


def precision(of: Subject, yard: Yardstick, sizes: Sizes) -> list[Data]:
    """Return error and processor time of the continuous loop's ITAE, contender by contender."""
    problem = peers.Problem(of)
    reference = peers.tight_reference(problem)
    rows: list[Data] = []

    def add(name: str, setting: str, value: Callable[[], float], job: Job, each: int = 1) -> None:
        runs = max(1, sizes.runs // 5)
        took = side_by_side({name: job}, runs)[name] / each
        rows.append(
            {
                "contender": name,
                "setting": setting,
                "seconds": took,
                "error": abs(value() / reference - 1),
            }
        )

    for refine in (*sizes.refined, 8) if sizes.peers else sizes.refined:
        step = f"h = {1 / refine:g} ms"
        add("C by hand", step, lambda r=refine: yard.itae(r), lambda r=refine: yard.itae(r))  # type: ignore[misc]
    for refine in sizes.refined:
        step = f"h = {1 / refine:g} ms"
        loop = graph(of, continuous=True, refine=refine)
        one, many = batch(of, loop, 1), batch(of, loop, 64)
        add("compiled, one loop", step, one.itae, one.run)
        add(f"compiled, {lanes.LANES} lanes", step, one.itae, many.run, 64)
        add(
            "interpreted",
            step,
            lambda x=loop: (  # type: ignore[misc]
                simulate_batch(x, [of.design], [of.scenario], backend="interpreted")[0].metrics.itae
            ),
            lambda x=one: x.called("interpreted"),  # type: ignore[misc]
        )
    contenders: dict[str, tuple[Callable[..., float], tuple[float, ...]]] = {
        "SciPy LSODA": (peers.scipy_loop(problem, "LSODA"), sizes.tolerances),
        "SciPy DOP853": (peers.scipy_loop(problem, "DOP853"), sizes.tolerances),
        "CasADi cvodes": (peers.cvodes_loop(problem), sizes.tolerances),
        "python-control": (peers.control_loop(problem), sizes.control),
    }
    for name, (run, tolerances) in contenders.items():
        for tolerance in tolerances:
            job = lambda r=run, t=tolerance: r(t)  # noqa: E731
            add(name, f"rtol = {tolerance:g}", job, job)
    return rows


def scaling(of: Subject, yard: Yardstick, sizes: Sizes) -> list[Data]:
    """Return wall time a loop for one core and for two, by the number of loops in a call."""
    loop, rows = graph(of, continuous=False), []
    for count in sizes.scaling:
        many = batch(of, loop, count)
        work: dict[str, Job] = {"yardstick": lambda: [yard.itae() for _ in range(5)]}
        for threads in (1, 2):
            work[str(threads)] = lambda m=many, t=threads: m.run(t)  # type: ignore[misc]
        times = side_by_side(work, max(2, sizes.runs // 3), wall=True)
        rows.append(
            {
                "loops": count,
                "yardstick": times["yardstick"] / 5,
                "threads": {t: times[t] / count for t in ("1", "2")},
            }
        )
    return rows


def tune(of: Subject, yard: Yardstick, sizes: Sizes) -> Data:
    """Return the robust tuning in parts beside the peer's labelled part; processor time."""
    before = side_by_side({"y": lambda: [yard.itae() for _ in range(20)]}, 3)["y"] / 20
    own = jobs.tuning(of, sizes.tune_runs)
    after = side_by_side({"y": lambda: [yard.itae() for _ in range(20)]}, 3)["y"] / 20
    peer = jobs.peer_tuning(of, sizes.peer) if sizes.peer else None
    found: Data = {"own": own, "yardstick": min(before, after), "peer": peer}
    if peer:
        # forward differences by two variables: a loop with its gradient is three loops
        needed = own["plain_loops"] + 3 * own["carrying_loops"]
        found["peer_loops_needed"] = needed
        found["peer_extrapolated"] = needed * peer["seconds"] / peer["loops"]
    return found


def sweep(of: Subject, folder: Path, sizes: Sizes) -> Data:
    """Return scenarios a second in this process, on one other and on two."""
    samples, chunk = sizes.sweep
    return {
        "whole": jobs.sweeping(of, folder / "sweep", samples, chunk, apart=sizes.peers),
        # a rate of seconds: half a second is ten chunks, and one more or less is ten per cent
        "steady": jobs.steady(of, 4 * samples, chunk) if sizes.peers else None,
    }
