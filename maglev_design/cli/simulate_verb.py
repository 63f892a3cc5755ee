"""``simulate``."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_design.choices import DEFAULT_PRESET, ControllerName, Equilibrium, Method
from maglev_design.cli.law import chosen_law
from maglev_design.cli.output import number, print_json, say, table, warn
from maglev_design.design import (
    PAPER_POLES,
    Design,
    PoleSpec,
    check_path_voltage,
    make_design,
    plant_beta,
    voltage_on_plant,
)
from maglev_design.errors import InputError
from maglev_design.files import write_bytes
from maglev_design.paper.trials import TRIALS
from maglev_design.parameters import Emulator, Rig, load_rig, make_rig
from maglev_design.simulate import Response, Scenario, emulated, error_bounds, loop_for, respond
from maglev_design.simulate import simulate as run_loop

if TYPE_CHECKING:
    from maglev_design.record import DesignRecord


RATIOS = (0.01, 100.0)
"""beta_c/beta that can be meant."""


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line; None where nothing was said."""

    rig: str | None
    design: Path | None
    test: str
    controller: ControllerName | None
    options: dict[str, Any]
    emulate: bool
    zeta: float | None
    omega_n: float | None
    equilibrium: Equilibrium | None
    method: Method | None
    sample_time: float | None
    beta_ratio: float | None
    noise: bool | None
    initial_error: float | None
    initial_velocity: float | None
    seed: int
    replay: str | None = None


def simulate(request: Request, csv: Path | None, plot: Path | None, *, as_json: bool) -> None:
    """Run the loop, print its figures, write what was asked for."""
    if request.replay is not None:
        _replay(request, csv, plot, as_json=as_json)
        return
    rig, design, scenario, ratio, continuous = _set_up(request)
    response, bounds = error_bounds(
        rig, design, scenario, continuous=continuous, emulate=request.emulate, run=respond
    )
    _write(rig, response, ratio, csv, plot)
    saved = request.design is not None
    ran = what_ran(design, ratio, saved=saved, continuous=continuous)
    other = _other_period(request, rig, continuous)
    if as_json:
        period = 0.0 if continuous else rig.sampling.period
        shown = _document(design, scenario, response, ratio, bounds, period)
        print_json(shown | {"emulated": request.emulate, "ran": ran, "rediscretised": other})
        return
    sys.stdout.write(ran + ("; rediscretised: another controller" if other else "") + "\n\n")
    _print(rig, response, bounds)
    _tell(response, csv, plot)


def _replay(request: Request, csv: Path | None, plot: Path | None, *, as_json: bool) -> None:
    """Run one scenario of a sweep again, on the sweep's own steps, and compare."""
    from maglev_design.cli.replay import TOLERANCE, difference, replayed  # noqa: PLC0415

    _nothing_else(request)
    found = replayed(str(request.replay))
    rig, design, scenario = found.rig, found.design, found.scenario
    response = run_loop(loop_for(rig, design), design, scenario)
    _, bounds = error_bounds(rig, design, scenario)
    ratio = plant_beta(rig) / scenario.beta_plant
    _write(rig, response, ratio, csv, plot)
    off = difference(found, response)
    if as_json:
        shown = _document(design, scenario, response, ratio, bounds, rig.sampling.period)
        print_json(shown | {"emulated": False, "replay": found.as_dict(off)})
    else:
        _print(rig, response, bounds)
        drawn = ", ".join(f"{name} = {value:.6g}" for name, value in found.drawn.items())
        sys.stdout.write(f"Scenario {scenario.index}, seed {scenario.seed}: {drawn or 'as is'}.\n")
        _tell(response, csv, plot)
    if off is None:
        say("the sweep's own figures of this scenario are not there to compare with")
    elif off > TOLERANCE:
        warn(
            f"the sweep recorded figures that differ by {off:.1g} (usually below {TOLERANCE:g}): "
            "another machine, or a loop that amplifies rounding"
        )
    elif not as_json:
        say(f"agrees with the sweep to {off:.1g}")


def _nothing_else(request: Request) -> None:
    """Refuse options that a replay takes from the sweep."""
    given = [
        name
        for name in (
            "design",
            "zeta",
            "omega_n",
            "equilibrium",
            "method",
            "sample_time",
            "beta_ratio",
            "noise",
            "initial_error",
            "initial_velocity",
        )
        if getattr(request, name) is not None
    ]
    given += [name for name, value in request.options.items() if value is not None]
    given += ["emulate"] if request.emulate else []
    if given:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise InputError(f"{names}: a replay takes everything from the sweep; leave it out")


def _document(
    design: Design,
    scenario: Scenario,
    response: Response,
    ratio: float,
    bounds: dict[str, float],
    period: float,
) -> dict[str, Any]:
    return response.metrics.as_dict() | {
        "controller": design.controller.name,
        "variant": design.controller.variant or "default",
        "poles": [list(design.poles.first), list(design.poles.second)],
        "controller_sha256": design.sha256 if period else None,
        "equilibrium": design.equilibrium,
        "method": design.method if period else None,
        "sample_time": period,
        "ratio": ratio,
        "noise": scenario.noise,
        "seed": scenario.seed,
        "relative_error_bounds": bounds,
    }


def _write(rig: Rig, response: Response, ratio: float, csv: Path | None, plot: Path | None) -> None:
    if csv is not None:
        write_bytes(csv, _csv(response).encode())
    if plot is not None:
        _plot(response, f"{rig.name}, ratio {ratio:g}", plot)


def _tell(response: Response, csv: Path | None, plot: Path | None) -> None:
    """Say what a person must not miss, and what was written."""
    crash = response.metrics.crash
    if crash is not None:
        end = "hit the magnet" if crash.where == "magnet" else "dropped"
        warn(f"the ball {end} at t = {crash.time:.4g} s; the metrics count it lying there")
    for path in (csv, plot):
        if path is not None:
            say(f"written: {path}")


def _other_period(request: Request, rig: Rig, continuous: bool) -> bool:
    """Whether a saved design was run at another period than its own."""
    if request.design is None or continuous:
        return False
    return _saved(request.design).design.period != rig.sampling.period


def _saved(path: Path) -> DesignRecord:
    from maglev_design.record import load  # noqa: PLC0415 - only when a design is given

    return load(path)


def _set_up(request: Request) -> tuple[Rig, Design, Scenario, float, bool]:
    record = _saved(request.design) if request.design else None
    if record is not None:
        _nothing_of_the_controller(request)
    rig = record.rig if record else load_rig(request.rig or DEFAULT_PRESET)
    continuous = request.sample_time == 0
    if request.sample_time is not None and not continuous:
        rig = _with_period(rig, request.sample_time)
    if request.emulate:
        rig = _emulated(rig, request, continuous, saved=record is not None)
    check_path_voltage(rig)
    trial = next(trial for trial in TRIALS if trial.name == request.test)
    ratio = trial.ratio if request.beta_ratio is None else request.beta_ratio
    low, high = RATIOS
    if not low <= ratio <= high:
        raise InputError(
            f"beta-ratio = {ratio!r} [-]: must be a number from {low:g} to {high:g}, 1 where the "
            "controller's beta is the plant's; 115 % is 1.15"
        )
    if record is None:
        design, beta_plant = _placed(rig, request, ratio)
    else:
        design = record.design
        if rig.sampling.period != design.period:
            design = _rediscretised(rig, design)
        beta_plant = design.beta_at(ratio)
    scenario = Scenario(
        beta_plant,
        rig.initial.gap,
        rig.initial.velocity,
        noise=trial.noise if request.noise is None else request.noise,
        seed=request.seed,
    )
    return rig, design, _started(rig, scenario, request), ratio, continuous


def _placed(rig: Rig, request: Request, ratio: float) -> tuple[Design, float]:
    """Return the controller of some poles, with beta_c = ratio beta, and the plant's beta."""
    zeta, omega_n = PAPER_POLES
    poles = PoleSpec.double(
        zeta if request.zeta is None else request.zeta,
        omega_n if request.omega_n is None else request.omega_n,
    )
    beta = plant_beta(rig)
    design = make_design(
        rig,
        poles,
        controller=chosen_law(request.controller or "tan-gpi", request.options),
        equilibrium=request.equilibrium or "model",
        method=request.method or rig.sampling.method,
        beta_c=beta * ratio,
        voltage=voltage_on_plant(rig, beta),
    )
    return design, beta


def _rediscretised(rig: Rig, design: Design) -> Design:
    """Return the law of a design with the same gains at another period: another controller."""
    return make_design(
        rig,
        design.poles,
        controller=design.controller,
        equilibrium=design.equilibrium,
        method=design.method,
        voltage=design.believed.U,
        gains=design.gains,
    )


def _nothing_of_the_controller(request: Request) -> None:
    """Refuse options that a saved design decides."""
    names = ("rig", "zeta", "omega_n", "equilibrium", "method", "controller")
    given = [name for name in names if getattr(request, name) is not None]
    given += [name for name, value in request.options.items() if value is not None]
    if given:
        words = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise InputError(
            f"{words}: a saved design is one controller on its rig; leave {words} out, or leave "
            "--design out"
        )


def what_ran(design: Design, ratio: float, *, saved: bool, continuous: bool) -> str:
    """Return in one line which loop was run."""
    (zeta_1, omega_1), (zeta_2, omega_2) = design.poles.first, design.poles.second
    poles = f"zeta = {zeta_1:g}, omega_n = {omega_1:g} rad/s"
    if design.poles.first != design.poles.second:
        poles += f" and {zeta_2:g}, {omega_2:g} rad/s"
    law = design.controller.name.upper()
    variant = f" ({design.controller.variant})" if design.controller.variant else ""
    when = "continuous" if continuous else f"{design.method} at {1e3 * design.period:g} ms"
    moved = (
        "the plant moves, the controller stays"
        if saved
        else "the controller's beta_c moves, the plant stays, as in the paper's test 3"
    )
    return (
        f"{law}{variant}, {poles}, {when}, reading {design.equilibrium}, beta_c/beta = {ratio:g}"
        + (f" ({moved})" if ratio != 1 else "")
    )


def _emulated(rig: Rig, request: Request, continuous: bool, *, saved: bool) -> Rig:
    """Return the rig with the period, delay and noise of its emulator, unless they were given.

    A saved design runs at its own period.
    """
    if rig.emulator == Emulator():
        raise InputError(
            f"--emulate: the rig {rig.name!r} has no [emulator] table; give it inductance [H] and "
            "resistance [ohm], sensor_step [m], actuator_step [V], period [s] or delay [s]"
        )
    if continuous:
        raise InputError("--emulate: the emulated rig runs a sampled controller, not sample-time 0")
    period = rig.sampling.period if saved else request.sample_time
    found = emulated(rig)
    return found if period is None else _with_period(found, period)


def _with_period(rig: Rig, period: float) -> Rig:
    data = rig.model_dump(exclude_none=True)
    data["sampling"]["period"] = period
    return make_rig(data, "--sample-time")


def _started(rig: Rig, scenario: Scenario, request: Request) -> Scenario:
    """Return the scenario with the start that was asked for, checked against the gap limits."""
    if request.initial_error is not None:
        gap = rig.reference.start_gap + request.initial_error
        low, high = rig.limits.gap
        if not low < gap < high:
            raise InputError(
                f"initial-error = {request.initial_error!r} m: the ball would start at {gap:.4g} m;"
                f" allowed is a start inside limits.gap, {low:g} m to {high:g} m"
            )
        scenario = replace(scenario, initial_gap=gap)
    if request.initial_velocity is not None:
        if not math.isfinite(request.initial_velocity):
            raise InputError(f"initial-velocity = {request.initial_velocity!r}: must be finite")
        scenario = replace(scenario, initial_velocity=request.initial_velocity)
    return scenario


def _print(rig: Rig, response: Response, bounds: dict[str, float]) -> None:
    metrics = response.metrics
    rows: list[tuple[str, str]] = [
        ("ISE", number(metrics.ise, "m² s", 6)),
        ("IAE", number(metrics.iae, "m s", 6)),
        ("ITAE", number(metrics.itae, "m s²", 6)),
        *[(f"  of it {k}", number(v, "m s²", 6)) for k, v in metrics.itae_split.items()],
        ("largest relative error of these", number(max(bounds.values()), "", 2)),
        ("largest commanded voltage", number(metrics.peak_voltage, "V")),
        ("smallest commanded voltage", number(metrics.min_voltage, "V")),
        ("largest applied voltage", number(metrics.peak_applied, "V")),
        ("smallest gap", number(1e3 * metrics.min_gap, "mm")),
        ("largest gap", number(1e3 * metrics.max_gap, "mm")),
        ("error at the end", number(1e6 * metrics.final_error, "µm")),
        ("ball", "levitated" if metrics.crash is None else metrics.crash.where),
    ]
    table(rig.name, ("figure", "value"), rows)


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


def _plot(response: Response, title: str, path: Path) -> None:
    from maglev_design.report.plots.response import response_figure  # noqa: PLC0415
    from maglev_design.report.plots.style import house_style, save_figure  # noqa: PLC0415

    names = ("times", "gap", "reference", "commanded", "applied")
    curves: dict[str, Any] = {name: np.asarray(getattr(response, name)) for name in names}
    with house_style():
        save_figure(response_figure(curves, title), path)
