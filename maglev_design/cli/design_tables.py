"""What ``tune`` and ``design`` found, as tables for a person."""

from __future__ import annotations

import sys
from typing import Any

from maglev_design.cli.emulated_text import emulated_headline, print_emulated
from maglev_design.cli.output import number, shown, table
from maglev_design.figures import DESCRIBED, MARGINS, OBJECTIVES, OF_A_FAMILY, PARTS
from maglev_design.reporting.words import GAIN_UNITS


def print_design(document: dict[str, Any]) -> None:
    """Print the document of ``tune`` or ``design`` as tables."""
    _print_head(document)
    _print_poles(document)
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


def _print_poles(document: dict[str, Any]) -> None:
    pairs = document["poles"]
    double = pairs[0] == pairs[1]
    rows = [
        (f"zeta{'' if double else f'_{n + 1}'}, omega_n", f"{zeta:.6g}, {omega_n:.6g} rad/s")
        for n, (zeta, omega_n) in enumerate(pairs[:1] if double else pairs)
    ]
    rows += [
        (name, number(value, GAIN_UNITS.get(name, "rad/s"), 8))
        for name, value in document["gains"].items()
    ]
    rows += [
        ("discretisation", document["method"]),
        ("equilibrium reading", document["equilibrium"]),
    ]
    table(document["rig"]["name"], ("design", "value"), rows)


def _print_figures(document: dict[str, Any]) -> None:
    base = document["baseline"]
    others = [] if base is None else [base["worst_case"]]
    columns = [document["worst_case"], *others, document["nominal"]]

    def row(key: str) -> tuple[str, ...]:
        told = DESCRIBED[key]
        return (told.label, *(figure(c[key], told.unit) if key in c else "-" for c in columns))

    rows = [
        *map(row, OBJECTIVES),
        *((f"  ITAE, {x}", *(shown("itae", c["itae_split"][x]) for c in columns)) for x in PARTS),
        *(row(key) for key in OF_A_FAMILY if key != "spectral_radius"),
    ]
    poles = [] if base is None else [f"zeta={base['zeta']:g}, omega_n={base['omega_n']:g}"]
    low, high = document["family"]["ratios"]
    from maglev_design.record import called  # noqa: PLC0415 - loads the simulator

    name = called(document)
    header = ("worst case", name, *poles, f"{name}, nominal")
    table(f"Worst case over beta_c/beta in [{low:g}, {high:g}]", header, rows)
    margins, unstable = document["margins"], document["worst_case"]["spectral_radius"] >= 1
    table(
        "Margins of the sampled loop, each where it is smallest",
        ("margin", "value", "gap", "beta_c/beta"),
        [
            (
                DESCRIBED[key].label,
                "unstable" if unstable else shown(key, margins[key]["value"]),
                number(1e3 * margins[key]["gap"], "mm"),
                number(margins[key]["ratio"]),
            )
            for key in MARGINS
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
                figure(c["value"], c["unit"]),
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
        if other.get("supply_voltage"):
            poles += f", {other['supply_voltage']:.3g} V supply"
        rows.append(
            (
                f"{other['kind']}: {other['name']} ({poles})",
                number(worst[key]),
                _times(other["improvement"]) + " x",
                number(worst["peak_voltage"], "V"),
                figure(worst["ms"]),
                "yes" if other["feasible"] else "NO",
            )
        )
    header = ("otherwise", f"worst {key.upper()}", "better by", "command", "Ms", "limits kept")
    table("What another choice would give", header, rows)


def figure(value: float | None, unit: str = "") -> str:
    """Return a figure of the linear loop, which an unstable loop does not have."""
    return "unstable" if value is None else number(value, unit)
