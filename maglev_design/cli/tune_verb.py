"""``tune``."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_design.cli.commands.design import DesignOptions
from maglev_design.cli.commands.tune import TuneOptions
from maglev_design.cli.design_tables import figure, print_design
from maglev_design.cli.emulated_text import emulated_warnings
from maglev_design.cli.output import INTERRUPTED, number, print_json, progress_bar, say, warn
from maglev_design.errors import InfeasibleError, VerificationError
from maglev_design.files import output_folder
from maglev_design.options import METHODS, TAN_GPI, Method
from maglev_design.rig import Rig, is_papers, load_rig

if TYPE_CHECKING:
    from maglev_design.record import DesignRecord


def tune(options: TuneOptions) -> None:
    """Solve, print, save; the exit code says how it ended."""
    from maglev_design.tune import Status, Unstabilisable  # noqa: PLC0415

    rig = rig_of(options)
    folder = output_folder(options.output, force=options.force) if options.output else None
    with progress_bar() as progress:
        result = _solve(rig, options, progress)
        if isinstance(result, Unstabilisable):
            error = InfeasibleError(_hopeless(result), "spectral radius")
            if options.json:
                largest = ("largest_period", "largest_delay")
                own = {name: getattr(result, name) for name in largest}
                print_json(without_a_design(error, limit=1.0) | own)
            raise error
        record, written = recorded(result, folder, progress, pareto=options.pareto)
    document = record.document
    show(result, document, written, options, document["warnings"])
    if result.status is Status.INTERRUPTED:
        sys.exit(INTERRUPTED)
    if result.status is Status.INFEASIBLE:
        say(_infeasible(document))
        sys.exit(InfeasibleError.exit_code)
    end_by_verification(result)


def rig_of(options: TuneOptions | DesignOptions) -> Rig:
    """Return the rig, as the scenarios have it."""
    from maglev_design.simulate import designed_for  # noqa: PLC0415

    rig = load_rig(options.rig)
    return designed_for(rig) if options.scenarios == "emulated" else rig


def without_a_design(error: InfeasibleError, limit: float | None = None) -> dict[str, Any]:
    """Return the document of a command that ends before there is a design to judge."""
    tightest = {"name": error.constraint, "limit": limit}
    return {
        "status": "infeasible",
        "message": str(error),
        "tightest": tightest | dict.fromkeys(("value", "poles", "hint")),
    }


def recorded(
    result: Any, folder: Path | None, progress: Any, *, pareto: bool = False
) -> tuple[DesignRecord, tuple[Path, ...]]:
    """Return the record of a result with margins and certificate, and the files written of it."""
    from maglev_design.certify.lyapunov.lmi import certify_family  # noqa: PLC0415
    from maglev_design.certify.margins import sampled_margins  # noqa: PLC0415
    from maglev_design.record import make_record, save  # noqa: PLC0415

    problem, certificate = result.problem, None
    progress("margins", 0.0)
    margins = sampled_margins(problem.loop, result.poles.values, problem.family)
    progress("certificate", 0.3)
    if problem.controller.name == TAN_GPI.name:
        (certificate,) = certify_family(
            result.design, problem.rig, beta_error=problem.given_beta_error, loops=("sampled",)
        )
    trade = _trade_off(result, progress) if pareto else None
    record = make_record(result, margins, certificate, trade)
    if folder is None:
        return record, ()
    progress("figures", 0.5)
    from maglev_design.report.plots.design import design_figures  # noqa: PLC0415

    figures = design_figures(record.curves, record.document, folder)
    return record, save(record, folder) + figures


def show(
    result: Any,
    document: dict[str, Any],
    written: tuple[Path, ...],
    options: TuneOptions | DesignOptions,
    beside_json: Sequence[str] = (),
) -> None:
    """Print the document, say what was written and what a person must not miss."""
    for text in emulated_warnings(document):
        warn(text)
    if options.json:
        print_json(document)
        for text in beside_json:
            warn(text)
    else:
        print_design(document)
    for path in written:
        say(f"written: {path}")
    rig = result.problem.rig  # with the standard excitation where nothing moved
    for text in _warnings(rig, document):
        warn(text)
    if not options.json and not written:
        say("nothing was saved; -o FOLDER keeps the design and its plots")


def end_by_verification(result: Any) -> None:
    """End with the exit code of a failed verification where one failed."""
    compared = result.baseline
    if not (result.verification.passed and (compared is None or compared.verification.passed)):
        say("verification failed: the two integrators differ by more than the tolerance")
        sys.exit(VerificationError.exit_code)


def _solve(rig: Rig, options: TuneOptions, progress: Any) -> Any:
    from maglev_design.design import check_path_voltage  # noqa: PLC0415
    from maglev_design.tune import solve, solve_every_method  # noqa: PLC0415

    check_path_voltage(rig)

    def problem(method: Method | None) -> Any:
        return problem_of(
            rig,
            options,
            method,
            distinct=options.poles == "distinct",
            zeta_bounds=options.zeta_bounds,
            omega_bounds=options.omega_bounds,
            certifies=_certifies(rig, options.beta_error) if options.certify else None,
        )

    baseline = baseline_of(rig, options.baseline)
    if options.method == "auto":
        return solve_every_method({name: problem(name) for name in METHODS}, progress, baseline)
    method: Method | None = next((m for m in METHODS if m == options.method), None)
    return solve(problem(method), progress, baseline)


def problem_of(
    rig: Rig, options: TuneOptions | DesignOptions, method: Method | None, **own: Any
) -> Any:
    """Return the problem that the options state, with what is a verb's own."""
    from maglev_design.tune import build_problem  # noqa: PLC0415

    return build_problem(
        rig,
        objective=options.objective,
        equilibrium=options.equilibrium,
        method=method,
        beta_error=options.beta_error,
        max_ms=options.max_ms,
        max_noise_voltage=options.max_noise_voltage,
        allow_saturation=options.allow_saturation,
        scenarios=options.scenarios,
        seed=options.seed,
        **own,
    )


def baseline_of(rig: Rig, asked: tuple[float, float] | None) -> Any:
    """Return the poles to compare with: those asked for, on the paper's rig the paper's."""
    from maglev_design.design import PAPER_POLES, PoleSpec  # noqa: PLC0415

    if asked is not None:
        return PoleSpec.double(*asked)
    return PoleSpec.double(*PAPER_POLES) if is_papers(rig) else None


def _certifies(rig: Rig, beta_error: float | None) -> Any:
    """Return the question whether a controller's sampled loop is proved stable."""
    from maglev_design.certify.lyapunov.lmi import certify_sampled  # noqa: PLC0415

    return lambda design: certify_sampled(design, rig, beta_error=beta_error).certified


def _trade_off(result: Any, progress: Any) -> Any:
    from maglev_design.certify.lyapunov.lmi import widest_sampled  # noqa: PLC0415
    from maglev_design.tune import trade_off  # noqa: PLC0415

    def widest(design: Any) -> float:
        found = widest_sampled(design, result.problem.rig)
        return math.nan if found is None else float(found.claim.ratios[1] - 1)

    return trade_off(result, widest, progress)


def _hopeless(found: Any) -> str:
    from maglev_design.tune.cautions import sampling_product  # noqa: PLC0415

    sampling = found.problem.rig.sampling
    remedies = [
        f"the largest {name} that some poles stabilise is about {1e3 * value:.3g} ms"
        for name, value in (("period", found.largest_period), ("delay", found.largest_delay))
        if not math.isnan(value)
    ]
    return (
        f"no poles in the search box stabilise the sampled loop with sampling.period = "
        f"{1e3 * sampling.period:g} ms and sampling.delay = {1e3 * sampling.delay:g} ms "
        f"(limit: spectral radius below 1 over the gaps and ratios): "
        f"{sampling_product(found.problem)}; "
        + ("; ".join(remedies) if remedies else "no shorter period alone would do")
        + " (the other as it is)"
    )


def _infeasible(document: dict[str, Any]) -> str:
    tightest = document["tightest"]
    hint = tightest["hint"] or "no option of tune would do: the rig's own limits stand against it"
    return (
        f"infeasible: the tightest limit is {tightest['name']}, "
        f"{figure(tightest['value'], tightest['unit'])} where "
        f"{number(tightest['limit'], tightest['unit'])} is allowed, at the poles that come closest "
        f"(zeta = {document['zeta']:.4g}, omega_n = {document['omega_n']:.4g} rad/s); {hint}"
    )


def _warnings(rig: Rig, document: dict[str, Any]) -> list[str]:
    """Return what a person who reads the result must not miss."""
    worst, found = document["worst_case"], []
    if document["status"] in ("on_bound", "interrupted"):
        found.append(document["message"])
    if worst["spectral_radius_one_more_sample"] >= 1:
        found.append("with one more sample of delay the loop is unstable")
    other = document["other_sign"]
    low, high = rig.limits.voltage
    if other["crashed"]:
        found.append("with the initial error of the other sign the ball is lost")
    elif other["min_voltage"] < low or other["peak_voltage"] > high:
        found.append(
            "with the initial error of the other sign the command leaves the range "
            f"({other['min_voltage']:.3g} V to {other['peak_voltage']:.3g} V) and is clamped"
        )
    return found
