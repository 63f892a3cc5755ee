"""``certify``."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from maglev_design.choices import SCHEMA_VERSION, Controller, ControllerName, Equilibrium, Method
from maglev_design.cli.output import number, print_json, progress_bar, say, table, warn
from maglev_design.errors import InputError
from maglev_design.files import output_folder, write_bytes

RESULT = "robustness.json"


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

    own = _subject(request)
    folder = output_folder(output, force=force) if output else None
    with progress_bar() as progress:
        found = assess(own, progress)
    document = {"rig": own.rig.name, **found.as_dict()}
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
        say(f"written: {folder / RESULT}")


def _subject(request: Request) -> Any:
    from maglev_design.certify.assessment import subject  # noqa: PLC0415
    from maglev_design.choices import DEFAULT_PRESET  # noqa: PLC0415
    from maglev_design.design import PAPER_POLES, PoleSpec, check_path_voltage  # noqa: PLC0415
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
    return subject(
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
    low, high = family["ratios"]
    near, far = family["gaps"]
    sys.stdout.write(
        f"Family: beta_c/beta in [{low:g}, {high:g}], gaps {1e3 * near:g} mm to {1e3 * far:g} mm.\n"
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
