"""``design``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from maglev_design.cli import tune_verb
from maglev_design.cli.law import chosen_law
from maglev_design.cli.output import number, print_json, progress_bar, say
from maglev_design.controller.checks import check_path_voltage
from maglev_design.controller.design import (
    PoleSpec,
    believed_equilibrium,
)
from maglev_design.errors import InfeasibleError, InputError
from maglev_design.files import output_folder
from maglev_design.options import Controller
from maglev_design.rig import Rig

if TYPE_CHECKING:
    from maglev_design.cli.commands.design import DesignOptions


def design(options: DesignOptions) -> None:
    """Judge, print, save; the exit code says how it ended."""
    from maglev_design.chain import baseline_of, recorded  # noqa: PLC0415
    from maglev_design.tuning import build_problem  # noqa: PLC0415
    from maglev_design.tuning.placed import judged  # noqa: PLC0415

    rig = tune_verb.rig_of(options)
    check_path_voltage(rig)
    try:
        controller, gains, poles = _controller(rig, options)
    except InfeasibleError as error:
        if options.json:
            print_json(tune_verb.without_a_design(error))
        raise
    problem = build_problem(
        rig,
        method=options.method,
        **tune_verb.limits_of(options),
        distinct=poles.first != poles.second,
        controller=controller,
        gains=gains,
    )
    folder = output_folder(options.output, force=options.force) if options.output else None
    with progress_bar() as progress:
        baseline = baseline_of(rig, options.baseline)
        result = judged(problem, poles, baseline, progress)
        record = recorded(result, progress)
        written = tune_verb.saved(record, folder, progress)
    tune_verb.show(result, record.document, written, options)
    figures = result.figures
    if not figures.feasible:
        worst = figures.tightest
        say(
            f"infeasible: {worst.name} is {number(worst.value, worst.unit)} where "
            f"{number(worst.limit, worst.unit)} is allowed"
            + (": the loop is unstable" if figures.spectral_radius >= 1 else "")
        )
        sys.exit(InfeasibleError.exit_code)
    tune_verb.end_by_verification(result)


def _controller(
    rig: Rig, options: DesignOptions
) -> tuple[Controller, tuple[float, ...] | None, Any]:
    """Return the law, its gains where they are given, and the poles."""
    from maglev_design.tuning.placed import (  # noqa: PLC0415
        FILTER,
        FILTER_OTHERWISE,
        gains_of,
        parse_gains,
    )

    ways = {
        "--zeta with --omega-n": options.zeta is not None or options.omega_n is not None,
        "--poles": options.poles is not None,
        "--gains": options.gains is not None,
    }
    if sum(ways.values()) != 1:
        given = " and ".join(name for name, said in ways.items() if said) or "nothing"
        raise InputError(f"which controller? Give one of {', '.join(ways)}; given: {given}")
    controller = chosen_law(options.controller, rig, options)
    if options.gains is not None:
        named = parse_gains(options.gains)
        if options.filter is not None and {FILTER, FILTER_OTHERWISE} & named.keys():
            raise InputError(f"--filter: the filter's pole is given as {FILTER} already")
        believed = believed_equilibrium(rig, options.equilibrium)
        return gains_of(named, controller, believed)
    if options.poles is not None:
        first, second = options.poles[:2], options.poles[2:]
        return controller, None, PoleSpec(first, second)
    if options.zeta is None or options.omega_n is None:
        raise InputError("--zeta and --omega-n: a pair of poles needs both [-, rad/s]")
    return controller, None, PoleSpec.double(options.zeta, options.omega_n)
