"""Who computes the chunks: this process, processes of this machine, or a Dask cluster.

Each is a generator of (number, arrays) in the order in which they are done; closing it stops the
work. Only the caller writes files, so that workers need no common disk.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import Connection, wait
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.errors import InputError
from maglev_design.interrupt import deferred
from maglev_design.sweeping.scenarios import run_chunk
from maglev_design.sweeping.setup import Setup

Arrays = dict[str, NDArray[np.float64]]
Done = Generator[tuple[int, Arrays], None, None]
Runner = Callable[[Setup, Sequence[int]], Done]

WORTH_PROCESSES = 20.0
"""[s] Of work left in this process, above which starting others, seconds each, saves time."""
AHEAD = 2
"""Chunks handed out for each worker, so that none waits and few results are held in memory."""
CONNECT, WORKERS, PATIENCE = 10.0, 30.0, 60.0
"""[s] To reach a scheduler; for its first worker; without any worker before giving up."""
_ASK = 5.0
"""[s] How often a cluster is asked whether it is there."""


def in_process(setup: Setup, numbers: Sequence[int], *, threads: int = 1) -> Done:
    """Compute chunk after chunk here, each on `threads` cores."""
    for number in numbers:
        yield number, _here(setup, number, threads)


def _here(setup: Setup, number: int, threads: int) -> Arrays:
    """Compute one chunk; Ctrl-C waits for its end."""
    with deferred() as check:
        arrays = run_chunk(setup, number, threads)
        check()
    return arrays


def locally(setup: Setup, numbers: Sequence[int], *, cores: int) -> Done:
    """Compute here, and in processes for the rest when that is long enough to start them."""
    left = list(numbers)
    took = 0.0
    for _ in range(2):  # the first compiles; the second says how long one takes
        if not left:
            return
        begun = time.perf_counter()
        arrays = _here(setup, left[0], cores)
        took = time.perf_counter() - begun
        yield left[0], arrays
        del left[0]
    many = cores > 1 and len(left) > 1 and took * len(left) > WORTH_PROCESSES
    yield from (
        in_processes(setup, left, jobs=cores) if many else in_process(setup, left, threads=cores)
    )


def in_processes(setup: Setup, numbers: Sequence[int], *, jobs: int) -> Done:
    """Compute in `jobs` processes of this machine.

    They ignore Ctrl-C, which this process answers, and end with it, however it ends.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    pool = futures.ProcessPoolExecutor(
        min(jobs, len(numbers)) or 1, context, _follow, initargs=(ours,)
    )

    def submit(number: int) -> futures.Future[Arrays]:
        with _unheard():
            return pool.submit(run_chunk, setup, number)

    try:
        yield from _in_order_of_completion(submit, numbers, AHEAD * jobs)
    except BrokenProcessPool as error:
        raise InputError(
            "a worker process died (out of memory?); the chunks that are done are kept: the same "
            "command continues, --jobs with a smaller number needs less memory"
        ) from error
    finally:
        theirs.close()  # ends the workers, in the middle of a chunk if need be
        ours.close()
        pool.shutdown(wait=True, cancel_futures=True)


def _follow(stop: Connection) -> None:
    """Make a worker end when its parent has ended, or has closed its end of `stop`."""
    parent = multiprocessing.parent_process()
    watched: list[Any] = [stop] if parent is None else [stop, parent.sentinel]

    def watch() -> None:
        wait(watched)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _unheard() -> Iterator[None]:
    """Start processes that do not hear Ctrl-C; one pressed meanwhile is heard afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _nothing() -> None:
    """Ask nothing."""


def _in_order_of_completion(
    submit: Callable[[int], futures.Future[Arrays]],
    numbers: Iterable[int],
    window: int,
    check: Callable[[], None] = _nothing,
) -> Done:
    """Yield results as they come, with at most `window` handed out at a time."""
    left = iter(numbers)
    running: dict[futures.Future[Arrays], int] = {}
    try:
        while True:
            while len(running) < window and (number := next(left, None)) is not None:
                running[submit(number)] = number
            if not running:
                return
            done, _ = futures.wait(running, _ASK, futures.FIRST_COMPLETED)
            check()
            for future in sorted(done, key=running.__getitem__):
                yield running.pop(future), future.result()
    finally:
        for future in running:
            future.cancel()


def on_cluster(address: str) -> Runner:
    """Return the runner on the Dask cluster whose scheduler is at `address`.

    The scheduler hands the work of a worker that died to another.

    Raises
    ------
    InputError
        When that is no address, or Dask is not installed.
    """
    if not re.fullmatch(r"[a-z]+://\S+:\d+", address):
        raise InputError(
            f"--scheduler {address!r}: must be as `dask scheduler` prints it, tcp://HOST:PORT"
        )
    try:
        import distributed  # noqa: F401, PLC0415 - an extra
    except ImportError as error:
        raise InputError(
            "--scheduler needs Dask, which is not installed: pip install 'maglev-design[sweep]'"
        ) from error
    return partial(_on_cluster, address)


def _on_cluster(address: str, setup: Setup, numbers: Sequence[int]) -> Done:
    import distributed  # noqa: PLC0415 - an extra
    from distributed.scheduler import KilledWorker  # noqa: PLC0415

    try:
        client = distributed.Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no scheduler answers there within {CONNECT:g} s "
            f"({type(error).__name__}); start one with `dask scheduler`, it prints its address"
        ) from error
    try:
        try:
            client.wait_for_workers(1, timeout=WORKERS)
        except TimeoutError as error:
            raise InputError(
                f"--scheduler {address}: no worker within {WORKERS:g} s; start some with `dask "
                f"worker {address} --nthreads 1`"
            ) from error
        pool = client.get_executor(pure=False)
        window = AHEAD * max(1, sum(client.nthreads().values()))
        submit = partial(pool.submit, run_chunk, setup)
        yield from _in_order_of_completion(submit, numbers, window, _watch(client, address))
    except KilledWorker as error:
        raise InputError(
            f"--scheduler {address}: several workers died on the same chunk (out of memory?); the "
            "chunks that are done are kept: the same command continues"
        ) from error
    except (futures.CancelledError, OSError) as error:
        raise _lost(address) from error
    finally:
        client.close(timeout=CONNECT)


def _watch(client: Any, address: str) -> Callable[[], None]:
    """Return the check that there is a scheduler and, now and then, a worker."""
    seen = time.monotonic()

    def check() -> None:
        nonlocal seen
        workers = client.scheduler_info(n_workers=-1).get("workers")
        if client.status == "running" and workers:
            seen = time.monotonic()
        elif time.monotonic() - seen > PATIENCE or client.status == "closed":
            raise _lost(address)

    return check


def _lost(address: str) -> InputError:
    return InputError(
        f"--scheduler {address}: the scheduler or all its workers are gone; the chunks that are "
        "done are kept: the same command continues"
    )
