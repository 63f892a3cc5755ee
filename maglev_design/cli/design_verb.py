"""``design``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maglev_design.cli import tune_verb
from maglev_design.cli.emulated_text import emulated_warnings
from maglev_design.cli.law import chosen_law
from maglev_design.cli.output import number, print_json, progress_bar, say, warn
from maglev_design.design import PoleSpec, believed_equilibrium, check_path_voltage
from maglev_design.errors import InfeasibleError, InputError
from maglev_design.files import output_folder
from maglev_design.options import Controller, ControllerName, Equilibrium, Method, Scenarios
from maglev_design.rig import Rig, load_rig


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line; None where nothing was said."""

    rig: str
    controller: ControllerName
    options: Mapping[str, Any]
    zeta: float | None
    omega_n: float | None
    poles: tuple[float, float, float, float] | None
    gains: str | None
    objective: str
    equilibrium: Equilibrium
    method: Method | None
    beta_error: float | None
    allow_saturation: bool
    max_ms: float
    max_noise_voltage: float | None
    scenarios: Scenarios
    seed: int
    baseline: tuple[float, float] | None


def design(request: Request, output: Path | None, *, force: bool, as_json: bool) -> None:
    """Judge, print, save; the exit code says how it ended."""
    from maglev_design.simulate import designed_for  # noqa: PLC0415
    from maglev_design.tune.placed import judged  # noqa: PLC0415

    rig = load_rig(request.rig)
    if request.scenarios == "emulated":
        rig = designed_for(rig)
    check_path_voltage(rig)
    try:
        controller, gains, poles = _controller(rig, request)
    except InfeasibleError as error:
        if as_json:
            print_json(
                {
                    "status": "infeasible",
                    "message": str(error),
                    "tightest": {"name": error.constraint}
                    | dict.fromkeys(("limit", "value", "poles", "hint")),
                }
            )
        raise
    problem = _problem(rig, request, controller, gains, distinct=poles.first != poles.second)
    folder = output_folder(output, force=force) if output else None
    with progress_bar() as progress:
        baseline = tune_verb.baseline_of(rig, request.baseline)
        result = judged(problem, poles, baseline, progress)
        record, written = tune_verb.recorded(result, folder, progress)
    for text in emulated_warnings(record.document):
        warn(text)
    if as_json:
        print_json(record.document)
    else:
        tune_verb.show(record.document)
    tune_verb.tell(problem.rig, record.document, written, as_json=as_json)
    figures = result.figures
    if not figures.feasible:
        worst = figures.tightest
        say(
            f"infeasible: {worst.name} is {number(worst.value, worst.unit)} where "
            f"{number(worst.limit, worst.unit)} is allowed"
            + (": the loop is unstable" if figures.radius >= 1 else "")
        )
        sys.exit(tune_verb.INFEASIBLE)
    tune_verb.end_by_verification(result)


def _controller(rig: Rig, request: Request) -> tuple[Controller, tuple[float, ...] | None, Any]:
    """Return the law, its gains where they are given, and the poles."""
    from maglev_design.tune.placed import (  # noqa: PLC0415
        FILTER,
        FILTER_OTHERWISE,
        gains_of,
        parse_gains,
    )

    ways = {
        "--zeta with --omega-n": request.zeta is not None or request.omega_n is not None,
        "--poles": request.poles is not None,
        "--gains": request.gains is not None,
    }
    if sum(ways.values()) != 1:
        given = " and ".join(name for name, said in ways.items() if said) or "nothing"
        raise InputError(f"which controller? Give one of {', '.join(ways)}; given: {given}")
    controller = chosen_law(request.controller, request.options)
    if request.gains is not None:
        named = parse_gains(request.gains)
        if request.options["filter"] is not None and {FILTER, FILTER_OTHERWISE} & named.keys():
            raise InputError(f"--filter: the filter's pole is given as {FILTER} already")
        believed = believed_equilibrium(rig, request.equilibrium)
        return gains_of(named, controller, believed)
    if request.poles is not None:
        first, second = request.poles[:2], request.poles[2:]
        return controller, None, PoleSpec(first, second)
    if request.zeta is None or request.omega_n is None:
        raise InputError("--zeta and --omega-n: a pair of poles needs both [-, rad/s]")
    return controller, None, PoleSpec.double(request.zeta, request.omega_n)


def _problem(
    rig: Rig,
    request: Request,
    controller: Controller,
    gains: tuple[float, ...] | None,
    *,
    distinct: bool,
) -> Any:
    from maglev_design.tune import build_problem  # noqa: PLC0415

    return build_problem(
        rig,
        objective=request.objective,
        equilibrium=request.equilibrium,
        method=request.method,
        beta_error=request.beta_error,
        max_ms=request.max_ms,
        max_noise_voltage=request.max_noise_voltage,
        allow_saturation=request.allow_saturation,
        scenarios=request.scenarios,
        distinct=distinct,
        seed=request.seed,
        controller=controller,
        gains=gains,
    )
