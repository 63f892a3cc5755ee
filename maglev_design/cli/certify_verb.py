"""``certify``."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from maglev_design.choices import (
    SCHEMA_VERSION,
    TAN_GPI,
    Controller,
    ControllerName,
    Equilibrium,
    Method,
)
from maglev_design.cli.output import number, print_json, progress_bar, say, table, warn
from maglev_design.errors import InputError
from maglev_design.files import output_folder, write_bytes

RESULT, CERTIFICATE = "robustness.json", "certificate.json"
VERIFICATION_FAILED = 4


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line; None where nothing was said."""

    design: Path | None
    rig: str | None
    controller: ControllerName | None
    zeta: float | None
    omega_n: float | None
    equilibrium: Equilibrium | None
    method: Method | None
    gap_range: tuple[float, float] | None
    beta_error: float | None


def certify(request: Request, output: Path | None, *, force: bool, as_json: bool) -> None:
    """Assess, print, save."""
    from maglev_design.certify.assessment import assess  # noqa: PLC0415
    from maglev_design.plain import finite  # noqa: PLC0415

    own, design = _subject(request)
    folder = output_folder(output, force=force) if output else None
    certificates: tuple[Any, ...] = ()
    region = None
    with progress_bar() as progress:
        found = assess(own, lambda stage, done: progress(stage, 0.6 * done))
        if own.controller == TAN_GPI:
            progress("Lyapunov functions", 0.6)
            certificates = _certificates(own, design, request)
            progress("region of initial errors", 0.7)
            region = _region(own, design, progress)
    document = {"rig": own.rig.name, **found.as_dict()}
    document["lmi"] = [certificate.as_dict() for certificate in certificates]
    document["region"] = region.as_dict() if region else None
    if as_json:
        print_json(document)
    else:
        _print(document)
    for text in _warnings(document):
        warn(text)
    if folder is not None:
        saved = finite({"schema_version": SCHEMA_VERSION} | document)
        text = json.dumps(saved, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        write_bytes(folder / RESULT, text.encode())
        for path in (folder / RESULT, *_proofs(certificates, folder), *_figures(region, folder)):
            say(f"written: {path}")
    if region is not None and region.contradictions:
        say("verification failed: a guaranteed start did not survive the simulation")
        sys.exit(VERIFICATION_FAILED)


def check(path: Path, *, as_json: bool) -> None:
    """Verify a written certificate anew; exit code 4 when something in it does not hold."""
    from maglev_design.certify.lyapunov import certificate  # noqa: PLC0415

    found = certificate.check(path)
    if as_json:
        print_json(found.as_dict())
    else:
        rows = [(c.name, "yes" if c.passed else "NO", c.detail) for c in found.checks]
        title = f"{path.name}: checked in exact arithmetic"
        table(title, ("check", "holds", "what"), rows, words=3)
    if not found.passed:
        say("verification failed: the certificate does not prove what it claims")
        sys.exit(VERIFICATION_FAILED)


def _certificates(own: Any, design: Any, request: Request) -> tuple[Any, ...]:
    from maglev_design.certify.lyapunov.lmi import certify_family  # noqa: PLC0415

    u = own.family.ratios[1] - 1 if request.beta_error is None else request.beta_error
    return certify_family(design, own.rig, beta_error=_decimal(u), gap_range=request.gap_range)


def _decimal(value: float) -> Fraction:
    """Return the short decimal that a sum of floats stands for."""
    return Fraction(f"{value:.12g}")


@dataclass(frozen=True)
class _Region:
    """The guaranteed region beside the simulated one, and where they contradict each other."""

    guaranteed: Any
    whole: Any
    near: Any
    contradictions: tuple[tuple[float, float], ...]

    def as_dict(self) -> dict[str, Any]:
        area = self.whole.area
        return {
            **self.guaranteed.as_dict(),
            "simulated": self.whole.as_dict(),
            "share_of_simulated": self.guaranteed.area / area if area else None,
            "contradictions": [list(point) for point in self.contradictions],
        }


def _region(own: Any, design: Any, progress: Any) -> _Region:
    from maglev_design.certify.region import guaranteed, simulated  # noqa: PLC0415
    from maglev_design.simulate import cores  # noqa: PLC0415

    low, high = (_decimal(ratio) for ratio in own.family.ratios)
    found = guaranteed.guaranteed_region(own.rig, design, (low, high))
    progress("simulated map", 0.9)
    whole = simulated.simulated_map(own.rig, design, threads=cores())
    around = simulated.region_extent(found)
    maps = []
    if around is not None:
        maps = [
            simulated.simulated_map(own.rig, design, around, ratio=float(ratio), threads=cores())
            for ratio in dict.fromkeys((Fraction(1), low, high))
        ]
    against = [point for one in (whole, *maps) for point in simulated.contradictions(found, one)]
    return _Region(found, whole, maps[0] if maps else None, tuple(dict.fromkeys(against)))


def _proofs(certificates: tuple[Any, ...], folder: Path) -> tuple[Path, ...]:
    """Write the certificate; without one, take away what an earlier run left there."""
    from maglev_design.certify.lyapunov.certificate import write  # noqa: PLC0415

    path = folder / CERTIFICATE
    if not any(c.certified or c.widest is not None for c in certificates):
        path.unlink(missing_ok=True)
        return ()
    write(path, certificates)
    return (path,)


def _figures(region: _Region | None, folder: Path) -> tuple[Path, ...]:
    from maglev_design.certify.region.simulated import region_curves  # noqa: PLC0415
    from maglev_design.report.plots.region import region_figure  # noqa: PLC0415
    from maglev_design.report.plots.style import house_style, save_figure  # noqa: PLC0415

    if region is None:
        return ()
    curves = region_curves(region.guaranteed, region.whole, region.near)
    title = f"Initial errors that the loop survives, regulating at {1e3 * region.whole.gap:.4g} mm"
    with house_style():
        figure = region_figure(curves, title)
        return tuple(save_figure(figure, folder / f"region{end}") for end in (".png", ".svg"))


def _subject(request: Request) -> tuple[Any, Any]:
    """Return what is assessed, and the controller as it runs on the rig."""
    from maglev_design.certify.assessment import subject  # noqa: PLC0415
    from maglev_design.choices import DEFAULT_PRESET  # noqa: PLC0415
    from maglev_design.design import (  # noqa: PLC0415
        PAPER_POLES,
        PoleSpec,
        check_path_voltage,
        make_design,
    )
    from maglev_design.parameters import load_rig  # noqa: PLC0415
    from maglev_design.record import load  # noqa: PLC0415

    if request.design is not None and request.rig is not None:
        raise InputError("--rig: the saved design brings its own rig; leave one of the two out")
    record = load(request.design) if request.design else None
    rig = record.rig if record else load_rig(request.rig or DEFAULT_PRESET)
    check_path_voltage(rig)
    poles = record.design.poles if record else PoleSpec.double(*PAPER_POLES)
    if request.zeta is not None or request.omega_n is not None:
        zeta, omega_n = poles.first
        poles = PoleSpec.double(
            zeta if request.zeta is None else request.zeta,
            omega_n if request.omega_n is None else request.omega_n,
        )
    saved = record.design if record else None
    own = subject(
        rig,
        poles,
        equilibrium=request.equilibrium or (saved.equilibrium if saved else "model"),
        method=request.method or (saved.method if saved else None),
        controller=Controller(request.controller or "tan-gpi"),
        beta_error=request.beta_error
        if request.beta_error is not None
        else (record.document["beta_error"] if record else None),
        gap_range=request.gap_range,
    )
    design = make_design(
        rig,
        poles,
        controller=own.controller,
        equilibrium=own.equilibrium,
        method=own.method,
    )
    return own, design


def _warnings(document: dict[str, Any]) -> list[str]:
    """Return what a person who reads the result must not miss."""
    found = []
    low, high = document["family"]["ratios"]
    if low == high:
        found.append("the uncertainty of beta is 0: the family holds exact beta alone")
    if document["sampled"]["spectral_radius"] >= 1:
        found.append("the sampled loop is unstable in the family: it has no margins there")
    if not document["sampled_interval"][-1]["stable"]:
        found.append("over the gaps no interval of beta_c/beta was proved for the sampled loop")
    refused = [row for row in document["lmi"] if not row["certified"]]
    found += [f"{row['loop']} loop {row['status']}" for row in refused]
    region = document["region"]
    if region is None:
        found.append("Lyapunov functions and the region are there for tan-gpi alone")
    elif region["status"] != "guaranteed":
        found.append(region["message"])
    return found


def _print(document: dict[str, Any]) -> None:
    family = document["family"]
    (zeta, omega_n), second = document["poles"]
    poles = f"zeta = {zeta:g}, omega_n = {omega_n:g} rad/s"
    if [zeta, omega_n] != second:
        poles += f" and {second[0]:g}, {second[1]:g} rad/s"
    sys.stdout.write(
        f"{document['rig']}: {document['controller']}, {poles}, {document['method']}, "
        f"{document['equilibrium']} reading\n\n"
    )
    _print_condition(document)
    _print_intervals("Continuous loop: beta_c/beta for which it is stable, exact", document)
    _print_gaps(document)
    _print_sampled(document)
    _print_margins(document)
    _print_certificates(document)
    if document["region"] is not None:
        _print_region(document["region"])
    low, high = family["ratios"]
    near, far = family["gaps"]
    sys.stdout.write(
        f"Family: beta_c/beta in [{low:g}, {high:g}], gaps {1e3 * near:g} mm to {1e3 * far:g} mm.\n"
    )


def _print_certificates(document: dict[str, Any]) -> None:
    rows = [
        (
            row["loop"],
            "yes" if row["certified"] else "NO",
            number(row["decay"], "1/s") if row["certified"] else "-",
            "-"
            if row["largest_beta_error"] is None
            else f"{100 * row['largest_beta_error']:.4g} %",
            str(len(row["vertices"])),
            row["solver"] or "-",
        )
        for row in document["lmi"]
    ]
    if rows:
        header = ("loop", "certified", "decay", "largest error of beta", "vertices", "solver")
        table("One quadratic Lyapunov function for the family, verified exactly", header, rows)


def _print_region(region: dict[str, Any]) -> None:
    if region["status"] != "guaranteed":
        return
    low, high = (1e3 * x for x in region["reach"])
    share = region["share_of_simulated"]
    sys.stdout.write(
        f"Nonlinear, saturated continuous loop, regulating at {1e3 * region['gap']:.4g} mm: from "
        f"rest every error from {low:.4g} mm to {high:.4g} mm is guaranteed, at every ratio of the "
        f"family; {region['cells']} cells proved. Area {region['area']:.3g} m²/s"
        + ("" if share is None else f", {100 * share:.3g} % of what the simulation survives")
        + f"; {len(region['contradictions'])} contradictions.\n\n"
    )


def _print_condition(document: dict[str, Any]) -> None:
    forms = document["closed_form"]
    if forms:
        sys.stdout.write(f"Stable if and only if {forms['condition']}\n")
        for name, form in forms.items():
            if name != "condition":
                sys.stdout.write(f"  {name}: {form}\n")
    else:
        sys.stdout.write("Stable if and only if all of these are positive:\n")
        for condition in document["conditions"]:
            sys.stdout.write(f"  {condition}\n")
    sys.stdout.write("\n")


def _where(gap: Any) -> str:
    if isinstance(gap, Sequence):
        return f"{1e3 * gap[0]:.4g} to {1e3 * gap[1]:.4g} mm"
    return f"{1e3 * gap:.4g} mm"


def _ends(row: dict[str, Any], digits: int = 10, scale: float = 1.0) -> tuple[str, str]:
    if not row["stable"]:
        return ("none", "none")
    upper = row["upper"]
    last = "no end" if upper is None or upper == float("inf") else f"{scale * upper:.{digits}g}"
    return f"{scale * row['lower']:.{digits}g}", last


def _print_intervals(title: str, document: dict[str, Any]) -> None:
    rows = []
    for row in document["exact_interval"]:
        for part in row["intervals"] or [{}]:
            known = {**row, **part}
            rows.append(
                (
                    row["equilibrium"],
                    _where(row["gap"]),
                    *_ends(known),
                    _short(known.get("upper_exact")),
                )
            )
    table(title, ("reading", "gap", "above", "below", "exactly"), rows, words=2)


def _short(exact: str | None, most: int = 40) -> str:
    """Return an exact number where it fits into a line."""
    if exact is None:
        return "-"
    return exact if len(exact) <= most else "(see --json)"


def _print_gaps(document: dict[str, Any]) -> None:
    rows = [
        (row["equilibrium"], *_ends({**row, **part}, scale=1e3), _metres(part.get("upper_exact")))
        for row in document["exact_gaps"]
        for part in row["intervals"] or [{}]
    ]
    header = ("reading", "above [mm]", "below [mm]", "exactly [m]")
    table("Continuous loop, exact beta: gaps at which it is stable", header, rows)


def _metres(exact: str | None) -> str:
    return _short(exact)


def _print_sampled(document: dict[str, Any]) -> None:
    rows = []
    for row in document["sampled_interval"]:
        for part in row["intervals"] or [{}]:
            known = {**row, **part}
            rows.append((row["equilibrium"], _where(row["gap"]), *_ends(known), _width(known)))
    sampled = document["sampled"]
    title = (
        f"Sampled loop ({document['method']}, {1e3 * sampled['period_s']:g} ms, delay "
        f"{1e3 * sampled['delay_s']:g} ms): beta_c/beta for which it is stable, ends enclosed"
    )
    table(title, ("reading", "gap", "above", "below", "relative width"), rows, words=2)
    times = []
    for label, key in (("sampling period", "max_period"), ("delay", "max_delay")):
        limit = sampled[key]
        cells = (
            ("none found", "-", "-")
            if limit is None
            else (
                number(1e3 * limit["stable"], "ms", 8),
                number(1e3 * limit["unstable"], "ms", 8),
                number(1e3 * limit["gap"], "mm"),
            )
        )
        times.append((f"largest {label}", *cells))
    header = ("exact beta, every gap", "proved stable", "proved unstable", "at gap")
    table("What the sampled loop survives", header, times)
    radius = sampled["spectral_radius_at"]
    sys.stdout.write(
        f"Spectral radius over the family: {sampled['spectral_radius']:.6g}, at "
        f"{1e3 * radius['gap']:.4g} mm and beta_c/beta = {radius['ratio']:.4g}.\n\n"
    )


def _width(row: dict[str, Any]) -> str:
    """Return the larger relative width of the two ends' enclosures."""
    widths = [
        float((Fraction(pair[1]) - Fraction(pair[0])) / Fraction(pair[1]))
        for pair in (row.get("lower_enclosure"), row.get("upper_enclosure"))
        if pair is not None and pair[0] is not None and pair[1] is not None and pair[1] > 0
    ]
    return f"{max(widths):.0e}" if widths else "-"


def _print_margins(document: dict[str, Any]) -> None:
    shown = (
        ("Ms", "ms", "", 1.0),
        ("Mt", "mt", "", 1.0),
        ("gain may rise by", "gain_up", "x", 1.0),
        ("gain may fall to", "gain_down", "x", 1.0),
        ("phase", "phase_deg", "deg", 1.0),
        ("further delay", "delay_s", "ms", 1e3),
        ("disk", "disk", "", 1.0),
    )
    rows = []
    for label, key, unit, scale in shown:
        cells = []
        for where in ("margins_continuous", "margins"):
            entry = document[where][key]
            cells += [
                _margin(entry["value"], unit, scale),
                number(1e3 * entry["gap"], "mm"),
                number(entry["ratio"]),
            ]
        rows.append((label, *cells))
    header = ("margin", "continuous", "at gap", "ratio", "sampled", "at gap", "ratio")
    table("Margins, each where it is worst in the family", header, rows)


def _margin(value: float | None, unit: str, scale: float) -> str:
    if value is None or value != value:  # noqa: PLR0124 - nan: an unstable loop
        return "none"
    return "no limit" if value == float("inf") else number(scale * value, unit)
