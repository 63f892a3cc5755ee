"""The figures of a design record: tracking, error, voltage, the search, what robustness costs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from maglev_design.figures import DESCRIBED
from maglev_design.record import called
from maglev_design.reporting.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    WIDTH,
    Curves,
    house_style,
    literal,
    plain_ticks,
    save_figure,
)
from maglev_design.reporting.words import headed

SHADES = ListedColormap(mpl.colormaps["Greys_r"](np.linspace(0.3, 0.9, 256)))
"""Greys that neither white nor dark paper has."""

LIMIT_STYLES = {
    "Ms": (BLUE, "-"),
    DESCRIBED["peak_voltage"].label: (RED, "--"),
    DESCRIBED["min_voltage"].label: (ORANGE, "--"),
    "noise voltage": (GREEN, "-."),
    "spectral radius": (GREY, ":"),
    "Routh-Hurwitz": ("black", ":"),
    DESCRIBED["min_gap"].label: (GREY, "-."),
    DESCRIBED["max_gap"].label: (GREY, "--"),
}


def _axes(height: float = 3.0) -> tuple[Figure, Any]:
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.add_subplot()


def tracking(curves: Curves, document: Mapping[str, Any]) -> Figure:
    """Draw the gap and its reference, tuned and baseline, at the worst ratio of each."""
    figure, axes = _axes()
    t = curves["times"]
    for name, colour, dash, label in _compared(document):
        axes.plot(t, 1e3 * curves[f"{name}_gap"], color=colour, ls=dash, label=label)
    axes.plot(t, 1e3 * curves["worst_gap"], color=RED, label=_design_label(document))
    axes.plot(t, 1e3 * curves["reference"], color="black", lw=0.9, ls=":", label="reference $y^*$")
    axes.set(xlabel="time $t$ [s]", ylabel="gap $y$ [mm]", title=_title(document, "Tracking"))
    axes.margins(x=0)
    axes.legend()
    return figure


def error(curves: Curves, document: Mapping[str, Any]) -> Figure:
    """Draw the tracking error, the start on the left and the rest on the right."""
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.6))
    t, reference = curves["times"], curves["reference"]
    early = _start(t, document)
    for name, colour, dash, label in (
        *_compared(document),
        ("worst", RED, "-", _design_label(document)),
        ("nominal", GREEN, "-.", f"{called(document)}, exact beta"),
    ):
        e = 1e6 * (curves[f"{name}_gap"] - reference)
        left.plot(t[early], e[early], color=colour, ls=dash)
        right.plot(t[~early], e[~early], color=colour, ls=dash, label=label)
    left.set(xlabel="time $t$ [s]", ylabel="error $e$ [µm]", title="the start")
    right.set(xlabel="time $t$ [s]", title="the rest")
    for axes in (left, right):
        axes.margins(x=0)
    figure.suptitle(_title(document, "Tracking error"), fontsize=9)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _start(t: NDArray[np.float64], document: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Return the instants of the initial transient."""
    return np.asarray(t <= start_of(document))


def start_of(document: Mapping[str, Any]) -> float:
    """Return how long the initial transient is shown [s]."""
    return max(0.2, 20 * float(document["rig"]["sampling"]["period"]))


def voltage(curves: Curves, document: Mapping[str, Any]) -> Figure:
    """Draw the commanded voltage, the start enlarged on the left, with the actuator's range."""
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1, 1.6))
    t = curves["times"][:-1]
    early = _start(t, document)
    for axes, part in ((left, early), (right, slice(None))):
        for name, colour, dash, label in (
            *_compared(document),
            ("worst", RED, "-", _design_label(document)),
        ):
            u = curves[f"{name}_commanded"]
            axes.step(t[part], u[part], where="post", color=colour, ls=dash, label=label)
        for bound in document["rig"]["limits"]["voltage"]:
            if bound is not None:
                axes.axhline(bound, color="black", lw=0.8, ls=":")
        axes.margins(x=0)
        axes.set_xlabel("time $t$ [s]")
    left.set(ylabel="commanded voltage $u$ [V]", title="the start")
    right.set_title("the whole")
    figure.suptitle(_title(document, "Voltage"), fontsize=9)
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def landscape(curves: Curves, document: Mapping[str, Any]) -> Figure:
    """Draw the objective over (zeta, omega_n), the limits as lines and the optimum."""
    figure, axes = _axes(4.6)
    zeta, omega_n = curves["landscape_zeta"], curves["landscape_omega_n"]
    values = curves["landscape_objective"]
    shown = np.log10(np.where(values > 0, values, np.nan))
    mesh = axes.pcolormesh(omega_n, zeta, shown, cmap=SHADES, shading="nearest", edgecolors="face")
    bar = figure.colorbar(mesh, ax=axes)
    bar.set_label(f"log₁₀ of worst-case {headed(document['objective'])}")
    stable = curves["slack: spectral radius"] > 0
    for name, (colour, dash) in LIMIT_STYLES.items():
        slack = curves.get(f"slack: {name}")
        if slack is None:
            continue
        inside = np.isfinite(slack) & (stable | (name == "spectral radius"))
        known = np.where(inside, np.clip(slack, -2, 2), np.nan)
        if np.nanmin(known) < 0 < np.nanmax(known):
            axes.contour(
                omega_n, zeta, known, levels=[0.0], colors=colour, linestyles=dash, linewidths=1.4
            )
            axes.plot([], [], color=colour, ls=dash, label=f"limit: {name}")
    for n, (damping, speed) in enumerate(sorted(map(tuple, document["poles"]))):
        label = called(document) if n == 0 else None
        axes.plot(speed, damping, "*", color=RED, ms=13, mec="white", label=label)
    base = document["baseline"]
    if base is not None:
        label = f"$\\zeta={base['zeta']:g}$, $\\omega_n={base['omega_n']:g}$"
        axes.plot(base["omega_n"], base["zeta"], "o", color=BLUE, mec="white", ms=8, label=label)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="frequency of the poles $\\omega_n$ [rad/s]",
        ylabel="damping of the poles $\\zeta$ [-]",
        title=_title(document, "Objective and limits"),
    )
    plain_ticks(axes.xaxis)
    plain_ticks(axes.yaxis)
    axes.grid(False)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def trade_off(curves: Curves, document: Mapping[str, Any]) -> Figure:
    """Draw the objective against the certified error of beta; the last placement is the tuned."""
    figure, axes = _axes(3.4)
    certified, objective = 100 * curves["pareto_certified"], curves["pareto_objective"]
    points = axes.scatter(
        certified[:-1],
        objective[:-1],
        c=curves["pareto_omega_n"][:-1],
        cmap="viridis",
        s=18,
        label="keeps every limit",
    )
    figure.colorbar(points, ax=axes).set_label("$\\omega_n$ [rad/s]")
    front = np.flatnonzero(curves["pareto_front"])
    order = front[np.argsort(certified[front])]
    axes.plot(
        certified[order], objective[order], color=GREY, lw=1.0, label="nothing better in both"
    )
    axes.plot(certified[-1:], objective[-1:], "*", color=RED, ms=13, mec="white", label="tuned")
    axes.set(
        yscale="log",
        xlabel="certified error of $\\beta$ [%]",
        ylabel=f"worst-case {headed(document['objective'])}",
        title=_title(document, "What robustness costs"),
    )
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _title(document: Mapping[str, Any], text: str) -> str:
    return f"{text} - {literal(document['rig']['name'])}"


def _design_label(document: Mapping[str, Any]) -> str:
    pairs = {tuple(pair) for pair in document["poles"]}
    poles = ", ".join(f"$\\zeta={z:.3g}$, $\\omega_n={w:.4g}$" for z, w in sorted(pairs))
    return f"{called(document)} ({poles}), ratio {document['worst_case']['ratio']:.3g}"


def _compared(document: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Return curve, colour, dash and label of the poles to compare with; nothing without any."""
    base = document["baseline"]
    if base is None:
        return []
    poles = f"$\\zeta={base['zeta']:g}$, $\\omega_n={base['omega_n']:g}$"
    return [("baseline", BLUE, "--", f"{poles}, ratio {base['worst_case']['ratio']:.3g}")]


DRAWINGS = {
    "tracking": tracking,
    "error": error,
    "voltage": voltage,
    "landscape": landscape,
    "trade_off": trade_off,
}
"""The figures of a design by the names of their files."""
NEEDS = {"landscape": "landscape_objective", "trade_off": "pareto_certified"}
"""Curves without which a figure is left out."""


def drawable(curves: Curves) -> tuple[str, ...]:
    """Return the names of the figures that a record's curves suffice for."""
    return tuple(name for name in DRAWINGS if NEEDS.get(name, "times") in curves)


def design_figures(curves: Curves, document: Mapping[str, Any], folder: Path) -> tuple[Path, ...]:
    """Write every figure of a design record into `folder`; return the paths."""
    with house_style():
        return tuple(
            save_figure(DRAWINGS[name](curves, document), folder / f"{name}.svg")
            for name in drawable(curves)
        )
