"""What ``certify`` found, as tables for a person."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from maglev_design.cli.output import number, shown, table
from maglev_design.figures import DESCRIBED, MARGINS

SUBJECTS = {"fixed": "this one", "recomputed": "computed anew on each plant"}


def print_assessment(document: dict[str, Any]) -> None:
    """Print the document of ``certify`` as tables."""
    family = document["family"]
    (zeta, omega_n), second = document["poles"]
    poles = f"zeta = {zeta:g}, omega_n = {omega_n:g} rad/s"
    if [zeta, omega_n] != second:
        poles += f" and {second[0]:g}, {second[1]:g} rad/s"
    sys.stdout.write(
        f"{document['rig']}: {document['controller']}, {poles}, {document['method']}, "
        f"{document['equilibrium']} reading\nController {document['controller_sha256']}; its "
        "numbers stay, the ratio beta_c/beta moves the plant.\n\n"
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
        f"Nonlinear, saturated loop of the continuous law, regulating at {1e3 * region['gap']:.4g} "
        f"mm: from rest every error from {low:.4g} mm to {high:.4g} mm is guaranteed, at every "
        f"ratio of the family; {region['cells']} cells proved. Area {region['area']:.3g} m²/s"
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
                    SUBJECTS[row["controller"]],
                    row["equilibrium"],
                    _where(row["gap"]),
                    *_ends(known),
                    _short(known.get("upper_exact")),
                )
            )
    header = ("controller", "reading", "gap", "above", "below", "exactly")
    table(title, header, rows, words=3)


def _short(exact: str | None, most: int = 40) -> str:
    """Return an exact number where it fits into a line."""
    if exact is None:
        return "-"
    return exact if len(exact) <= most else "(see --json)"


def _print_gaps(document: dict[str, Any]) -> None:
    rows = [
        (*_ends({**row, **part}, scale=1e3), _short(part.get("upper_exact")))
        for row in document["exact_gaps"]
        for part in row["intervals"] or [{}]
    ]
    header = ("above [mm]", "below [mm]", "exactly [m]")
    table("Continuous loop, exact beta: gaps at which it is stable", header, rows)


def _print_sampled(document: dict[str, Any]) -> None:
    rows = []
    for row in document["sampled_interval"]:
        for part in row["intervals"] or [{}]:
            known = {**row, **part}
            rows.append((_where(row["gap"]), *_ends(known), _width(known)))
    sampled = document["sampled"]
    title = (
        f"Sampled loop ({document['method']}, {1e3 * sampled['period_s']:g} ms, delay "
        f"{1e3 * sampled['delay_s']:g} ms): beta_c/beta for which it is stable, ends enclosed"
    )
    table(title, ("gap", "above", "below", "relative width"), rows)
    times = []
    for label, key in (("sampling period, same gains", "max_period"), ("delay", "max_delay")):
        limit = sampled[key]
        digits, how = (4, "by eigenvalues") if limit["status"] == "unstable" else (8, "proved")
        cells = [
            "-" if limit[name] is None else number(1e3 * limit[name], unit, places) + after
            for name, unit, places, after in (
                ("stable", "ms", 8, ""),
                ("unstable", "ms", digits, f", {how}"),
                ("gap", "mm", 4, ""),
            )
        ]
        times.append((f"largest {label}", limit["status"], *cells))
    header = ("exact beta, every gap", "search", "proved stable", "unstable", "at gap")
    table("What the sampled loop survives", header, times, words=2)
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
    rows = []
    for key in ("ms", "mt", *MARGINS, "disk"):
        cells = []
        for where in ("margins_continuous", "margins"):
            entry = document[where][key]
            cells += [
                _margin(key, entry["value"]),
                number(1e3 * entry["gap"], "mm"),
                number(entry["ratio"]),
            ]
        rows.append((DESCRIBED[key].label, *cells))
    header = ("margin", "continuous", "at gap", "ratio", "sampled", "at gap", "ratio")
    table("Margins, each where it is worst in the family", header, rows)


def _margin(key: str, value: float | None) -> str:
    if value is None or value != value:  # noqa: PLR0124 - nan: an unstable loop
        return "none"
    return "no limit" if value == float("inf") else shown(key, value)
