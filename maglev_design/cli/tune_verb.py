"""``tune``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_design.cli.design_tables import figure, print_design
from maglev_design.cli.emulated_text import emulated_warnings
from maglev_design.cli.output import INTERRUPTED, number, print_json, progress_bar, say, warn
from maglev_design.controller.matching import law_named, only_papers_plant
from maglev_design.errors import InfeasibleError, VerificationError
from maglev_design.files import output_folder
from maglev_design.rig import Rig, load_rig

if TYPE_CHECKING:
    from maglev_design.cli.commands.design import DesignOptions
    from maglev_design.cli.commands.tune import TuneOptions
    from maglev_design.record import DesignRecord

LIMITS = (
    *("objective", "equilibrium", "beta_error", "max_ms", "max_noise_voltage"),
    *("allow_saturation", "scenarios", "seed"),
)
"""What ``tune`` and ``design`` both say of the problem, by its own names."""


def tune(options: TuneOptions) -> None:
    """Solve, print, save; the exit code says how it ended."""
    from maglev_design.chain import recorded, solved  # noqa: PLC0415
    from maglev_design.tuning import Status, Unstabilisable  # noqa: PLC0415

    rig = rig_of(options)
    law = law_named(options.controller, rig)
    if options.pareto:
        only_papers_plant(rig, "--pareto", law)
    folder = output_folder(options.output, force=options.force) if options.output else None
    with progress_bar() as progress:
        result = solved(
            rig,
            controller=law,
            method=options.method,
            baseline=options.baseline,
            certified=options.certify,
            progress=progress,
            distinct=options.poles == "distinct",
            zeta_bounds=options.zeta_bounds,
            omega_bounds=options.omega_bounds,
            **limits_of(options),
        )
        if isinstance(result, Unstabilisable):
            error = InfeasibleError(str(result), "spectral radius")
            if options.json:
                largest = ("largest_period", "largest_delay")
                own = {name: getattr(result, name) for name in largest}
                print_json(without_a_design(error, limit=1.0) | own)
            raise error
        record = recorded(result, progress, pareto=options.pareto)
        written = saved(record, folder, progress)
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
    from maglev_design.simulation import designed_for  # noqa: PLC0415

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


def saved(
    record: DesignRecord, folder: Path | None, progress: Callable[[str, float], None]
) -> tuple[Path, ...]:
    """Write the record and its figures; return the files."""
    if folder is None:
        return ()
    from maglev_design.record import save  # noqa: PLC0415
    from maglev_design.reporting.plots.design import design_figures  # noqa: PLC0415

    progress("figures", 0.5)
    figures = design_figures(record.curves, record.document, folder)
    return save(record, folder) + figures


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


def limits_of(options: TuneOptions | DesignOptions) -> dict[str, Any]:
    """Return what both verbs say of the problem."""
    return {name: getattr(options, name) for name in LIMITS}


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
