"""``compare``."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_design.cli.output import print_json, progress_bar, say, table, typed, warn
from maglev_design.controller.checks import check_path_voltage
from maglev_design.controller.design import (
    PoleSpec,
)
from maglev_design.controller.matching import only_papers_plant
from maglev_design.errors import InputError
from maglev_design.files import finite, json_bytes, output_folder, write_bytes
from maglev_design.options import METHODS, SCHEMA_VERSION, Equilibrium
from maglev_design.paper.comparison import Comparison, Progress, compare
from maglev_design.paper.survey import orderings, survey
from maglev_design.paper.trials import Reading, contenders
from maglev_design.record import load, rig_as_data
from maglev_design.reporting.comparison_text import (
    guesses,
    headline,
    margin_table,
    markdown,
    ordering_table,
    result_tables,
)
from maglev_design.rig import Emulator, Rig, load_rig
from maglev_design.tuning import TuneResult, build_problem, solve

if TYPE_CHECKING:
    from maglev_design.cli.commands.compare import CompareOptions


def compare_controllers(options: CompareOptions) -> None:
    """Run the tests, print the tables, write page, data and figures."""
    record = load(options.design) if options.design else None
    rig = record.rig if record else load_rig(options.rig)
    only_papers_plant(rig, "compare")
    check_path_voltage(rig)
    readings = _readings(
        rig, options, moves=record is None, equilibrium=_equilibrium(options, record)
    )
    folder = output_folder(options.output, force=options.force) if options.output else None
    with progress_bar() as progress:
        poles = record.design.poles if record else _tuned(rig, options, readings[0], progress)
        found = compare(
            rig,
            contenders(poles, variants=options.variants),
            readings,
            seeds=options.seeds,
            seed=options.seed,
            emulate=options.emulate and rig.emulator != Emulator(),
            progress=progress,
        )
        rows = survey(rig, progress) if options.survey else ()
    document = _document(rig, found, options.seed)
    document["orderings"] = finite(orderings(rows) if rows else [])
    written = _write(folder, document, found, typed()) if folder else ()
    if options.json:
        print_json(document)
    else:
        _print(document)
    for path in written:
        say(f"written: {path}")
    if folder is None and not options.json:
        say("nothing was saved; -o FOLDER keeps the page, the data and the figures")


def _equilibrium(options: CompareOptions, record: Any) -> Equilibrium:
    own: Equilibrium = record.design.equilibrium if record else "model"
    return options.equilibrium or own


def _readings(
    rig: Rig, options: CompareOptions, *, moves: bool, equilibrium: Equilibrium
) -> tuple[Reading, ...]:
    """Return the readings that were asked for, the first for the figures."""
    noise = rig.noise.position if options.position_noise is None else options.position_noise
    if not (math.isfinite(noise) and noise >= 0):
        raise InputError(f"position-noise = {noise!r} m: must be a finite number, 0 or more")
    period = rig.sampling.period
    wanted = options.method or rig.sampling.method
    methods = [m for m in METHODS if wanted in (m, "all")]
    if options.sample_time == 0:
        first = Reading(equilibrium, None, period, noise)
        return (replace(first, mirrored=options.opposite_error, controller_moves=moves),)
    return tuple(
        Reading(
            equilibrium,
            method,
            period if options.sample_time is None else options.sample_time,
            noise,
            mirrored=options.opposite_error,
            controller_moves=moves,
        )
        for method in methods
    )


def _tuned(
    rig: Rig, options: CompareOptions, reading: Reading, progress: Progress
) -> PoleSpec | None:
    """Return the poles of the tuned TAN-GPI, or nothing where there is none to show."""
    if not options.tuned:
        return None
    problem = build_problem(rig, equilibrium=reading.equilibrium, method=reading.method)
    result = solve(problem, progress)
    if not isinstance(result, TuneResult):
        warn("no poles stabilise this rig's sampled loop: the tuned design is left out")
        return None
    return result.poles


def _document(rig: Rig, found: Comparison, seed: int) -> dict[str, Any]:
    tests = {r.trial.name: r.trial for r in found.results}
    return dict(
        finite(
            {
                "schema_version": SCHEMA_VERSION,
                "rig": rig_as_data(rig),
                "seed": seed,
                "tests": [
                    {"name": t.name, "title": t.title, "ratio": t.ratio, "noise": t.noise}
                    for t in tests.values()
                ],
                "results": found.results,
                "margins": found.margins,
            }
        )
    )


def _write(
    folder: Path, document: dict[str, Any], found: Comparison, command: str
) -> tuple[Path, ...]:
    from maglev_design.reporting.plots.comparison import comparison_figures  # noqa: PLC0415

    curves = {test: [vars(curve) for curve in shown] for test, shown in found.curves.items()}
    figures = comparison_figures(document, curves, folder)
    page = markdown(document, command, [f.name for f in figures])
    paths = (folder / "comparison.json", folder / "comparison.md")
    for path, content in zip(paths, (json_bytes(document, 1), page.encode()), strict=True):
        write_bytes(path, content)
    return (*paths, *figures)


def _print(document: dict[str, Any]) -> None:
    told = headline(document)
    if told is not None:
        sys.stdout.write(f"{told}\n\n")
    for drawn in result_tables(document):
        table(drawn.title, drawn.header, drawn.rows, words=drawn.words)
    drawn = margin_table(document)
    if drawn.rows:
        table(drawn.title, drawn.header, drawn.rows)
    for text in guesses(document):
        sys.stdout.write(text + "\n")
    if not document["orderings"]:
        return
    sys.stdout.write(
        "\nIn how many readings TAN-GPI has the smaller figure; as stated: with the paper's own "
        "period, start and noise\n\n"
    )
    for trial in document["tests"]:
        drawn = ordering_table(document, trial)
        if drawn.rows:
            table(drawn.title, drawn.header, drawn.rows, words=drawn.words)
