"""Counterparts of the paper's Figs. 3-12, and of 15-18 on the emulated rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from maglev_design.figures import INDICES
from maglev_design.reporting.plots.style import (
    BLUE,
    GREEN,
    ORANGE,
    RED,
    WIDTH,
    house_style,
    literal,
    save_figure,
)
from maglev_design.reporting.words import headed

LOOKS: Mapping[str, tuple[str, Any, str]] = {
    "TAN-GPI": (RED, "-", "o"),
    "LIN-PID": (GREEN, "--", "s"),
    "FEE-GPI": (BLUE, "-.", "^"),
    "TAN-GPI tuned": (ORANGE, (0, (1, 1)), "D"),
}
"""Colour as in the paper, dash and marker for those who see none."""
FIRST_FIGURE = {"nominal": 3, "noise": 6, "mismatch": 9, "emulator": 15}
STARS = " (* our reading of a controller that the paper does not give)"
START = 0.25
"""[s] What the left panel of a figure shows."""

Curve = Mapping[str, Any]


def comparison_figures(
    document: Mapping[str, Any], curves: Mapping[str, Sequence[Curve]], folder: Path
) -> tuple[Path, ...]:
    """Write every figure into `folder` as PNG and SVG; return the paths.

    Parameters
    ----------
    document : mapping
        As ``comparison.json`` holds it.
    curves : mapping
        Test -> curves with label, times, gap, reference, commanded (SI units).
    """
    drawings: dict[str, Figure] = {}
    starred = {r["label"]: r["label"] + ("*" if r["guess"] else "") for r in document["results"]}
    with house_style():
        titles = {trial["name"]: trial["title"] for trial in document["tests"]}
        for test, all_curves in curves.items():
            shown = [
                {**curve, "name": starred[curve["label"]]}
                for curve in all_curves
                if curve["label"] in LOOKS
            ]
            first, title = FIRST_FIGURE[test], titles[test]
            drawings[f"figure_{first:02}"] = gap_figure(shown, title)
            drawings[f"figure_{first + 1:02}"] = error_figure(shown, title)
            drawings[f"figure_{first + 2:02}"] = voltage_figure(shown, title, document)
        tests = [name for name in ("nominal", "noise", "mismatch") if name in titles]
        drawings["figure_12"] = index_figure(document, tests)
        if "emulator" in titles:
            drawings["figure_18"] = index_figure(document, ["emulator"])
        written = [
            save_figure(figure, folder / f"{name}.svg") for name, figure in sorted(drawings.items())
        ]
    return tuple(written)


def _panels(title: str) -> tuple[Figure, Any, Any]:
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.6))
    figure.suptitle(literal(f"{title}{STARS}"), fontsize=9)
    left.set(xlabel="time $t$ [s]", title="the start")
    right.set(xlabel="time $t$ [s]", title="the rest")
    for axes in (left, right):
        axes.margins(x=0)
    return figure, left, right


def _legend(figure: Figure, axes: Any) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


def _drawn(curve: Curve) -> dict[str, Any]:
    colour, dash, _ = LOOKS[curve["label"]]
    return {"color": colour, "ls": dash, "label": curve["name"]}


def gap_figure(curves: Sequence[Curve], title: str) -> Figure:
    """Draw the gap of every controller and the reference."""
    figure, left, right = _panels(title)
    for axes, early in ((left, True), (right, False)):
        for curve in curves:
            part = _part(curve["times"], early)
            axes.plot(curve["times"][part], 1e3 * curve["gap"][part], **_drawn(curve))
        part = _part(curves[0]["times"], early)
        axes.plot(
            curves[0]["times"][part],
            1e3 * curves[0]["reference"][part],
            color="black",
            lw=0.9,
            ls=":",
            label="reference $y^*$",
        )
    left.set_ylabel("gap $y$ [mm]")
    _legend(figure, right)
    return figure


def error_figure(curves: Sequence[Curve], title: str) -> Figure:
    """Draw the tracking error of every controller."""
    figure, left, right = _panels(title)
    for curve in curves:
        error = 1e6 * (curve["gap"] - curve["reference"])
        for axes, early in ((left, True), (right, False)):
            part = _part(curve["times"], early)
            axes.plot(curve["times"][part], error[part], **_drawn(curve))
    left.set_ylabel("error $e$ [µm]")
    _legend(figure, right)
    return figure


def voltage_figure(curves: Sequence[Curve], title: str, document: Mapping[str, Any]) -> Figure:
    """Draw the commanded voltage of every controller with the actuator's range."""
    figure, left, right = _panels(title)
    for curve in curves:
        times = curve["times"][:-1]
        for axes, early in ((left, True), (right, False)):
            part = _part(times, early)
            axes.step(times[part], curve["commanded"][part], where="post", **_drawn(curve))
    for bound in document["rig"]["limits"]["voltage"]:
        if bound is not None:
            left.axhline(bound, color="black", lw=0.8, ls=":")
    left.set_ylabel("commanded voltage $u$ [V]")
    _legend(figure, right)
    return figure


def _part(times: NDArray[np.float64], early: bool) -> NDArray[np.bool_]:
    return np.asarray(times <= START if early else times > START)


def index_figure(document: Mapping[str, Any], tests: Sequence[str]) -> Figure:
    """Draw ISE, IAE and ITAE of the default variants, with 95 % intervals where noise enters.

    A point on a logarithmic axis: the indices lie decades apart, and bars have no foot there.
    """
    figure = Figure(figsize=(WIDTH, 2.8), layout="constrained")
    shown = [r for r in document["results"] if r["variant"] == "default" and r["label"] in LOOKS]
    first = (shown[0]["method"], shown[0]["equilibrium"])
    shown = [r for r in shown if (r["method"], r["equilibrium"]) == first]
    for axes, index in zip(figure.subplots(1, 3), INDICES, strict=True):
        for k, label in enumerate(LOOKS):
            colour, _, marker = LOOKS[label]
            rows = [
                (tests.index(r["test"]), r)
                for r in shown
                if r["label"] == label and r["test"] in tests
            ]
            if not rows:
                continue
            place = [n + 0.18 * (k - 1.5) for n, _ in rows]
            value = [r[index] for _, r in rows]
            low, high = (
                [abs(r["spread"].get(index, {}).get(end, r[index]) - r[index]) for _, r in rows]
                for end in ("low", "high")
            )
            axes.errorbar(
                place,
                value,
                yerr=(low, high),
                color=colour,
                fmt=marker,
                ms=5,
                capsize=2,
                label=label + ("*" if rows[0][1]["guess"] else ""),
            )
        axes.set(yscale="log", title=headed(index), xlim=(-0.5, len(tests) - 0.5))
        axes.set_xticks(range(len(tests)), tests)
        axes.grid(axis="x", visible=False)
        axes.margins(y=0.15)
    _legend(figure, figure.axes[0])
    return figure
