"""``tune``."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_design.cli.emulated_text import emulated_headline, emulated_warnings, print_emulated
from maglev_design.cli.output import number, print_json, progress_bar, say, table, warn
from maglev_design.errors import InfeasibleError
from maglev_design.files import output_folder
from maglev_design.options import METHODS, TAN_GPI, Equilibrium, Method, Scenarios
from maglev_design.rig import Rig, is_papers, load_rig

if TYPE_CHECKING:
    from maglev_design.record import DesignRecord

INTERRUPTED, VERIFICATION_FAILED, INFEASIBLE = 130, 4, 3


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line; None where nothing was said."""

    rig: str
    objective: str
    equilibrium: Equilibrium
    method: str | None
    beta_error: float | None
    allow_saturation: bool
    max_ms: float
    max_noise_voltage: float | None
    scenarios: Scenarios
    distinct: bool
    zeta_bounds: tuple[float, float] | None
    omega_bounds: tuple[float, float] | None
    seed: int
    certify: bool
    pareto: bool
    baseline: tuple[float, float] | None


def tune(request: Request, output: Path | None, *, force: bool, as_json: bool) -> None:
    """Solve, print, save; the exit code says how it ended."""
    from maglev_design.simulate import designed_for  # noqa: PLC0415
    from maglev_design.tune import Status, Unstabilisable  # noqa: PLC0415

    rig = load_rig(request.rig)
    if request.scenarios == "emulated":
        rig = designed_for(rig)
    folder = output_folder(output, force=force) if output else None
    with progress_bar() as progress:
        result = _solve(rig, request, progress)
        if isinstance(result, Unstabilisable):
            if as_json:
                print_json(
                    {
                        "status": Status.INFEASIBLE.name.lower(),
                        "message": _hopeless(result),
                        "tightest": {
                            "name": "spectral radius",
                            "limit": 1.0,
                            "value": None,
                            "poles": None,
                            "hint": None,
                        },
                        "largest_period": result.largest_period,
                        "largest_delay": result.largest_delay,
                    }
                )
            raise InfeasibleError(_hopeless(result), "spectral radius")
        record, written = recorded(result, folder, progress, pareto=request.pareto)
    rig = result.problem.rig  # with the standard excitation where nothing moved
    for text in emulated_warnings(record.document):
        warn(text)
    if as_json:
        print_json(record.document)
        for text in record.document["warnings"]:
            warn(text)
    else:
        show(record.document)
    tell(rig, record.document, written, as_json=as_json)
    if result.status is Status.INTERRUPTED:
        sys.exit(INTERRUPTED)
    if result.status is Status.INFEASIBLE:
        say(_infeasible(record.document))
        sys.exit(INFEASIBLE)
    end_by_verification(result)


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


def tell(rig: Rig, document: dict[str, Any], written: tuple[Path, ...], *, as_json: bool) -> None:
    """Say what was written and what a person must not miss."""
    for path in written:
        say(f"written: {path}")
    for text in _warnings(rig, document):
        warn(text)
    if not as_json and not written:
        say("nothing was saved; -o FOLDER keeps the design and its plots")


def end_by_verification(result: Any) -> None:
    """End with the exit code of a failed verification where one failed."""
    compared = result.baseline
    if not (result.verification.passed and (compared is None or compared.verification.passed)):
        say("verification failed: the two integrators differ by more than the tolerance")
        sys.exit(VERIFICATION_FAILED)


def _solve(rig: Rig, request: Request, progress: Any) -> Any:
    from maglev_design.design import check_path_voltage  # noqa: PLC0415
    from maglev_design.tune import build_problem, solve, solve_every_method  # noqa: PLC0415

    check_path_voltage(rig)

    def problem(method: Method | None) -> Any:
        return build_problem(
            rig,
            objective=request.objective,
            equilibrium=request.equilibrium,
            method=method,
            beta_error=request.beta_error,
            max_ms=request.max_ms,
            max_noise_voltage=request.max_noise_voltage,
            allow_saturation=request.allow_saturation,
            scenarios=request.scenarios,
            distinct=request.distinct,
            zeta_bounds=request.zeta_bounds,
            omega_bounds=request.omega_bounds,
            seed=request.seed,
            certifies=_certifies(rig, request.beta_error) if request.certify else None,
        )

    baseline = baseline_of(rig, request.baseline)
    if request.method == "auto":
        return solve_every_method({name: problem(name) for name in METHODS}, progress, baseline)
    method: Method | None = next((m for m in METHODS if m == request.method), None)
    return solve(problem(method), progress, baseline)


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
        f"{_figure(tightest['value'], tightest['unit'])} where "
        f"{number(tightest['limit'], tightest['unit'])} is allowed, at the poles that come closest "
        f"(zeta = {document['zeta']:.4g}, omega_n = {document['omega_n']:.4g} rad/s); {hint}"
    )


def _figure(value: float | None, unit: str = "") -> str:
    """Return a figure of the linear loop, which an unstable loop does not have."""
    return "unstable" if value is None else number(value, unit)


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


def show(document: dict[str, Any]) -> None:
    """Print a design as tables that a person reads."""
    _print_head(document)
    _print_design(document)
    _print_figures(document)
    headline = emulated_headline(document)
    if headline is not None:
        sys.stdout.write(f"{headline}\n\n")
    print_emulated(document)
    _print_limits(document)
    _print_certificate(document["certificate"])
    if document["alternatives"]:
        _print_alternatives(document)
    if "pareto" in document:
        _print_pareto(document)
    check = document["verification"]
    sys.stdout.write(
        f"Verified with {check['integrator']}: the worst case agrees to "
        f"{check['relative_difference']:.1g} (allowed {check['tolerance']:g}).\n"
        f"{document['message']}\n"
    )


def _print_head(document: dict[str, Any]) -> None:
    """Print what has to be known first: the excitation, the warnings, the headline."""
    lines, excitation = [], document["excitation"]
    if excitation is not None:
        lines.append(
            "Nothing moves on this rig as it is described: "
            f"{'judged' if document['status'] == 'judged' else 'tuned'} for a standard excitation, "
            f"the ball starts at rest {1e3 * excitation['offset']:+.3g} mm from its path "
            f"({100 * excitation['share_of_Z']:g} % of Y + y0), at "
            f"{1e3 * excitation['initial_gap']:.5g} mm."
        )
    if document["status"] == "infeasible":
        lines.append("INFEASIBLE: no design; what follows is of the poles that come closest.")
    lines += [f"Warning: {text}." for text in document["warnings"]]
    if document["baseline"] is None and document["status"] != "infeasible":
        worst, start = document["worst_case"], document["initial_error"]
        binding = ", ".join(c["name"] for c in document["constraints"] if c["binding"])
        lines.append(
            f"Worst error {1e6 * worst['max_error']:.4g} um over the family"
            + (f" (the start is {1e6 * start:.4g} um off)" if start else "")
            + (
                f", {1e6 * worst['max_error_from_move']:.4g} um from the start of the move on"
                if worst["max_error_from_move"] is not None
                else ""
            )
            + f"; limits that bind: {binding or 'none'}."
        )
    if lines:
        sys.stdout.write("\n".join(lines) + "\n\n")


def _print_design(document: dict[str, Any]) -> None:
    pairs = document["poles"]
    double = pairs[0] == pairs[1]
    rows = [
        (f"zeta{'' if double else f'_{n + 1}'}, omega_n", f"{zeta:.6g}, {omega_n:.6g} rad/s")
        for n, (zeta, omega_n) in enumerate(pairs[:1] if double else pairs)
    ]
    units = {"k0": "1/s⁴", "k1": "1/s³", "k2": "1/s²", "k3": "1/s", "omega_f": "rad/s"}
    rows += [(name, number(value, units[name], 8)) for name, value in document["gains"].items()]
    rows += [
        ("discretisation", document["method"]),
        ("equilibrium reading", document["equilibrium"]),
    ]
    table(document["rig"]["name"], ("design", "value"), rows)


def _print_figures(document: dict[str, Any]) -> None:
    base, units = document["baseline"], {"itae": "m s²", "iae": "m s", "ise": "m² s"}
    others = [] if base is None else [base["worst_case"]]
    columns = [document["worst_case"], *others, document["nominal"]]

    def row(label: str, key: str, unit: str) -> tuple[str, ...]:
        cells = ["-" if key not in column else _figure(column[key], unit) for column in columns]
        return (label, *cells)

    rows = [row(key.upper(), key, unit) for key, unit in units.items()]
    rows += [
        (f"  ITAE, {part}", *[number(c["itae_split"][part], units["itae"]) for c in columns])
        for part in ("start", "move", "hold")
    ]
    rows += [
        row("largest commanded voltage", "peak_voltage", "V"),
        row("smallest commanded voltage", "min_voltage", "V"),
        row("Ms", "ms", ""),
        row("Ms, one more sample", "ms_one_more_sample", ""),
        row("voltage from sensor noise", "noise_voltage", "V"),
        row("at beta_c/beta", "ratio", ""),
    ]
    poles = [] if base is None else [f"zeta={base['zeta']:g}, omega_n={base['omega_n']:g}"]
    low, high = document["family"]["ratios"]
    from maglev_design.record import called  # noqa: PLC0415 - loads the simulator

    name = called(document)
    header = ("worst case", name, *poles, f"{name}, nominal")
    table(f"Worst case over beta_c/beta in [{low:g}, {high:g}]", header, rows)
    margins, unstable = document["margins"], document["worst_case"]["spectral_radius"] >= 1
    shown = (
        ("gain may rise by", "gain_up", "x", 1.0),
        ("gain may fall to", "gain_down", "x", 1.0),
        ("phase", "phase_deg", "deg", 1.0),
        ("further delay", "delay_s", "ms", 1e3),
    )
    table(
        "Margins of the sampled loop, each where it is smallest",
        ("margin", "value", "gap", "beta_c/beta"),
        [
            (
                label,
                "unstable"
                if unstable
                else number(
                    None if margins[key]["value"] is None else scale * margins[key]["value"], unit
                ),
                number(1e3 * margins[key]["gap"], "mm"),
                number(margins[key]["ratio"]),
            )
            for label, key, unit, scale in shown
        ],
    )
    noisy = document["with_noise"]
    if noisy is not None:
        key = document["objective"]
        lost = f"; the ball is lost in {noisy['lost']}" if noisy["lost"] else ""
        sys.stdout.write(
            f"With the rig's noise the worst case has {key.upper()} {number(noisy[key])}, the "
            f"median of {noisy['seeds']} runs{lost}.\n\n"
        )
    if base is None:
        return
    verdict = "" if base["feasible"] else f" (which breaks: {', '.join(base['violated'])})"
    sys.stdout.write(
        f"Worst-case {document['objective'].upper()} is {_compared(base['improvement'])} "
        f"than with zeta = {base['zeta']:g}, omega_n = {base['omega_n']:g}{verdict}, "
        "under the same limits.\n\n"
    )


def _compared(factor: float | None) -> str:
    """Return how many times smaller, or larger, a worst case is than another."""
    if factor is not None and 0 < factor < 1:
        return f"{1 / factor:.3g} times larger"
    return f"{_times(factor)} times smaller"


def _times(factor: float | None) -> str:
    """Return a factor as text; None is infinity, the worst case of the other being zero."""
    return "infinitely many" if factor is None else f"{factor:.3g}"


def _print_limits(document: dict[str, Any]) -> None:
    signs = {"upper": "≤", "lower": "≥"}
    table(
        "Limits",
        ("limit", "value", "allowed", "kept"),
        [
            (
                c["name"],
                _figure(c["value"], c["unit"]),
                f"{signs[c['side']]} {number(c['limit'], c['unit'])}",
                "yes" if c["satisfied"] else "NO",
            )
            for c in document["constraints"]
        ],
    )


def _print_certificate(found: dict[str, Any]) -> None:
    if not found["certified"]:
        sys.stdout.write(f"{found['status'][:1].upper()}{found['status'][1:]}.\n\n")
        return
    (low, high), (near, far) = found["gaps"], found["ratios"]
    sys.stdout.write(
        "Certified: one quadratic Lyapunov function, verified in exact arithmetic, proves the "
        f"sampled loop stable at every gap from {number(1e3 * low, 'mm')} to "
        f"{number(1e3 * high, 'mm')} and every beta_c/beta from {near:g} to {far:g}; the widest "
        f"error of beta with such a proof is {100 * found['largest_beta_error']:.3g} %.\n\n"
    )


def _print_pareto(document: dict[str, Any]) -> None:
    front = sorted(
        (row for row in document["pareto"] if row["on_front"]), key=lambda row: row["objective"]
    )
    table(
        "What robustness costs: no placement of the grid is better in both",
        (f"worst {document['objective'].upper()}", "certified error of beta", "zeta", "omega_n"),
        [
            (
                number(row["objective"]),
                f"{100 * row['certified_beta_error']:.3g} %",
                number(row["zeta"]),
                number(row["omega_n"], "rad/s"),
            )
            for row in front
        ],
    )


def _print_planning(document: dict[str, Any], other: dict[str, Any]) -> None:
    """Print what measuring U would bring; nothing where it would bring nothing."""
    key, factor = document["objective"], other["improvement"]
    if not other["feasible"] or (factor is not None and factor <= 1):
        return
    known = document["rig"]["operating_point"].get("voltage") is not None
    how = (
        f"Taking U as measured, to {100 * other['voltage_error']:g} % (--equilibrium measured),"
        if known
        else f"Measuring U to {100 * other['voltage_error']:g} % (write operating_point.voltage, "
        "--equilibrium measured)"
    )
    sys.stdout.write(
        f"{how} would bring worst {key.upper()} "
        f"{other['worst_case'][key]:.3g} instead of {document['worst_case'][key]:.3g}, tuned "
        f"anew: {_times(factor)} times.\n\n"
    )


def _print_alternatives(document: dict[str, Any]) -> None:
    key = document["objective"]
    rows = []
    for other in document["alternatives"]:
        worst = other["worst_case"]
        if other["kind"] == "planning":
            _print_planning(document, other)
            continue
        poles = "tuned anew" if other["tuned"] else "same poles"
        rows.append(
            (
                f"{other['kind']}: {other['name']} ({poles})",
                number(worst[key]),
                _times(other["improvement"]) + " x",
                number(worst["peak_voltage"], "V"),
                _figure(worst["ms"]),
                "yes" if other["feasible"] else "NO",
            )
        )
    header = ("otherwise", f"worst {key.upper()}", "better by", "command", "Ms", "limits kept")
    table("What another choice would give", header, rows)
