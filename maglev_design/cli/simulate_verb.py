"""``simulate``."""

from __future__ import annotations

import sys
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_design.cli.arguments import flag
from maglev_design.cli.law import PID
from maglev_design.cli.output import number, print_json, say, shown, table, warn
from maglev_design.cli.simulate_setup import PLANT_MOVES, SimulationSetup, set_up
from maglev_design.errors import InputError
from maglev_design.figures import DESCRIBED, EXTREMES, INDICES
from maglev_design.files import output_file, write_file
from maglev_design.simulation import Response, StatedErrors, loop_for, respond, stated_errors
from maglev_design.simulation import simulate as run_loop

if TYPE_CHECKING:
    from maglev_design.cli.commands.simulate import SimulateOptions

OF_A_REPLAY = ("seed", "replay", "csv", "plot", "force", "json")
"""What may stand beside --replay."""
CSV = (".csv", ".txt")
"""Endings of comma-separated values."""
PLOTS = (".png", ".svg", ".pdf")
"""Endings of figures."""


def simulate(options: SimulateOptions) -> None:
    """Run the loop, print its figures, write what was asked for."""
    for path, endings in ((options.csv, CSV), (options.plot, PLOTS)):
        if path is not None:
            output_file(path, endings, force=options.force)
    if options.replay is not None:
        _replay(options)
        return
    run = set_up(options)
    response, stated = _stated(run)
    if options.json:
        print_json(_document(run, response, stated))
    else:
        _print(run, response, stated)
    _write(run, response, options)


def _stated(run: SimulationSetup) -> tuple[Response, StatedErrors]:
    return stated_errors(
        run.rig,
        run.design,
        run.scenario,
        continuous=run.continuous,
        emulate=run.emulate,
        run=respond,
    )


def _replay(options: SimulateOptions) -> None:
    """Run one scenario of a sweep again, on the sweep's own steps, and compare."""
    from maglev_design.cli.replay import TOLERANCE, difference, replayed  # noqa: PLC0415

    _nothing_else(options)
    found = replayed(str(options.replay))
    rig, design, scenario = found.rig, found.design, found.scenario
    ratio = design.believed.beta / scenario.beta_plant
    run = SimulationSetup(rig, design, scenario, ratio, PLANT_MOVES)
    response = run_loop(loop_for(rig, design), design, scenario)
    _, stated = _stated(run)
    off = difference(found, response)
    if options.json:
        print_json(_document(run, response, stated) | {"replay": found.as_dict(off)})
    else:
        _print(run, response, stated)
        drawn = ", ".join(f"{name} = {value:.6g}" for name, value in found.drawn.items())
        sys.stdout.write(f"Scenario {scenario.index}, seed {scenario.seed}: {drawn or 'as is'}.\n")
    _write(run, response, options)
    if off is None:
        say("the sweep's own figures of this scenario are not there to compare with")
    elif off > TOLERANCE:
        warn(
            f"the sweep recorded figures that differ by {off:.1g} (usually below {TOLERANCE:g}): "
            "another machine, or a loop that amplifies rounding"
        )
    elif not options.json:
        say(f"agrees with the sweep to {off:.1g}")


def _nothing_else(options: SimulateOptions) -> None:
    """Refuse options that a replay takes from the sweep."""
    given = [
        field.name
        for field in fields(options)
        if field.name not in OF_A_REPLAY and getattr(options, field.name) != field.default
    ]
    given.sort(key=(*PID, "emulate").__contains__)  # these last
    if given:
        names = ", ".join(map(flag, given))
        raise InputError(f"{names}: a replay takes everything from the sweep; leave it out")


def _document(run: SimulationSetup, response: Response, stated: StatedErrors) -> dict[str, Any]:
    return (
        response.metrics.as_dict()
        | run.as_dict()
        | {
            "relative_error_bounds": stated.relative if stated.bound else None,
            "relative_error_estimates": None if stated.bound else stated.relative,
        }
    )


def _write(run: SimulationSetup, response: Response, options: SimulateOptions) -> None:
    """Say what a person must not miss, write what was asked for, and say so."""
    crash = response.metrics.crash
    if crash is not None and not options.json:
        end = "hit the magnet" if crash.where == "magnet" else "dropped"
        warn(f"the ball {end} at t = {crash.time:.4g} s; the metrics count it lying there")
    if options.csv is not None:
        write_file(options.csv, _csv(response).encode(), CSV, force=options.force)
        say(f"written: {options.csv}")
    if options.plot is not None:
        ending = options.plot.suffix.lower()
        drawn = _plot(response, f"{run.rig.name}, ratio {run.ratio:g}", ending)
        write_file(options.plot, drawn, PLOTS, force=options.force)
        say(f"written: {options.plot}")


def _print(run: SimulationSetup, response: Response, stated: StatedErrors) -> None:
    metrics, kind = response.metrics, "a bound" if stated.bound else "an estimate"
    sys.stdout.write(f"{run}\n\n")
    rows: list[tuple[str, str]] = [
        *((DESCRIBED[x].label, shown(x, getattr(metrics, x), 6)) for x in INDICES),
        *((f"  of it {k}", shown("itae", v, 6)) for k, v in metrics.itae_split.items()),
        (f"largest relative error, {kind}", number(max(stated.relative.values()), "", 2)),
        *((DESCRIBED[x].label, shown(x, getattr(metrics, x))) for x in (*EXTREMES, "final_error")),
        ("ball", "levitated" if metrics.crash is None else metrics.crash.where),
    ]
    table(run.rig.name, ("figure", "value"), rows)


def _csv(response: Response) -> str:
    """Return the response as text; the voltages of the last row are not computed any more."""
    lines = ["t [s],y [m],y' [m/s],y* [m],u commanded [V],u applied [V]"]
    count = len(response.commanded)
    for k, row in enumerate(
        zip(response.times, response.gap, response.velocity, response.reference, strict=True)
    ):
        tail = (response.commanded[k], response.applied[k]) if k < count else ()
        cells = [repr(float(value)) for value in (*row, *tail)]
        lines.append(",".join(cells + [""] * (6 - len(cells))))
    return "\n".join(lines) + "\n"


def _plot(response: Response, title: str, ending: str) -> bytes:
    from maglev_design.reporting.plots.response import response_figure  # noqa: PLC0415
    from maglev_design.reporting.plots.style import figure_bytes, house_style  # noqa: PLC0415

    names = ("times", "gap", "reference", "commanded", "applied")
    curves: dict[str, Any] = {name: np.asarray(getattr(response, name)) for name in names}
    with house_style():
        return figure_bytes(response_figure(curves, title), ending)
