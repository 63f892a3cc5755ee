"""Monte Carlo over the rig's uncertainties: one or several designs on the same scenarios.

``make_setup`` says what is to be computed, ``sweep`` computes what is not there yet, chunk by chunk
into a folder, and ``summarise`` reads the folder. What the files hold depends on the setup alone:
not on who computed which chunk, in what order, or how often the work was stopped.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from maglev_design.controller.design import Design
from maglev_design.errors import InputError
from maglev_design.options import Backend
from maglev_design.rig import Rig
from maglev_design.simulation import compiled
from maglev_design.sweeping.chunks import chunk_sha256, is_done, open_folder, write_chunk
from maglev_design.sweeping.draws import SAMPLINGS, Sampling, beta_is_computed, drawn_spreads
from maglev_design.sweeping.executors import Runner, in_process, in_processes, locally, on_cluster
from maglev_design.sweeping.result import DesignResult, SweepResult, recorded, summarise
from maglev_design.sweeping.scenarios import FIGURES, Plants, plants, plants_of, scenario
from maglev_design.sweeping.setup import (
    COMPILED_CHUNK,
    INTERPRETED_CHUNK,
    KIND,
    OF_A_SWEEP,
    Setup,
)

__all__ = [
    "FIGURES",
    "KIND",
    "OF_A_SWEEP",
    "SAMPLINGS",
    "DesignResult",
    "Plants",
    "Runner",
    "Sampling",
    "Setup",
    "SweepResult",
    "beta_is_computed",
    "chunk_sha256",
    "drawn_spreads",
    "in_process",
    "in_processes",
    "locally",
    "make_setup",
    "on_cluster",
    "plants",
    "plants_of",
    "recorded",
    "scenario",
    "summarise",
    "sweep",
]

Counter = Callable[[int, int, int], None]
"""Told chunks done in this run, chunks to do in it, chunks found in the folder."""


def make_setup(
    rig: Rig,
    designs: tuple[Design, ...],
    *,
    samples: int,
    seed: int = 0,
    sampling: Sampling = "lhs",
    chunk: int | None = None,
    noise: bool | None = None,
    backend: Backend = "auto",
    beta_error: float | None = None,
) -> Setup:
    """Return what is to be computed, with everything decided that was left open.

    Parameters
    ----------
    rig : Rig
    designs : tuple of Design
        Made for this rig.
    samples, seed : int
    sampling : {"lhs", "sobol", "random"}
    chunk : int, optional
        Scenarios a file; default: what takes about a second.
    noise : bool, optional
        Default: whether the rig has any.
    backend : {"auto", "compiled", "interpreted"}
        ``auto``: compiled where there is a compiler.
    beta_error : float, optional
        Half the width of the interval of beta_c/beta [-]; default: what the rig says for the
        reading of the designs.
    """
    if not designs:
        raise InputError("no design to sweep")
    if noise is None:
        spreads = rig.uncertainty.spreads
        uncertain = "input_noise" in spreads or "position_noise" in spreads
        noise = uncertain or rig.noise.input > 0 or rig.noise.position > 0
    if backend == "auto":
        backend = "compiled" if compiled.usable() else "interpreted"
    if chunk is None:
        chunk = COMPILED_CHUNK if backend == "compiled" else INTERPRETED_CHUNK
    return Setup(rig, designs, samples, seed, sampling, chunk, noise, backend, beta_error)


def _silent(_done: int, _wanted: int, _found: int) -> None:
    """Tell nobody."""


def sweep(
    setup: Setup,
    folder: Path,
    runner: Runner = in_process,
    *,
    force: bool = False,
    told: Counter = _silent,
) -> SweepResult:
    """Compute the chunks that are missing in `folder`, and return the result of all.

    Interrupted or killed at any moment, the chunks that are done stay and the next call goes on;
    a damaged one is computed anew.

    Raises
    ------
    InputError
        When `folder` or a chunk in it belongs to another sweep, unless `force`.
    """
    open_folder(setup, folder, force=force)
    missing = [n for n in range(setup.chunks) if not is_done(setup, folder, n, force=force)]
    found = setup.chunks - len(missing)
    told(0, len(missing), found)
    if missing:
        work = runner(setup, missing)
        try:
            for done, (number, arrays) in enumerate(work, 1):
                write_chunk(setup, folder, number, arrays)
                told(done, len(missing), found)
        finally:
            work.close()
    return summarise(setup, folder)
