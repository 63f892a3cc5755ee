"""The figure of a guaranteed region inside the map that simulation draws."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from maglev_design.reporting.plots.style import RED, WIDTH, Curves, literal

LOST, SURVIVED = "#f0f0f0", "#9ecae1"
"""Light, so that the outline stands out, and apart in grey."""


def region_figure(curves: Curves, title: str) -> Figure:
    """Draw the simulated map and the guaranteed region in the plane of the initial errors.

    On the left the whole plane, on the right the region's surroundings. ``curves`` is as
    :func:`maglev_design.certification.region.simulated.region_curves` returns it: SI units; without
    the map of the surroundings when nothing is guaranteed.
    """
    panels = [name for name in ("whole", "near") if f"{name}_e" in curves]
    titles = {"whole": "all gaps the rig allows", "near": "around the guaranteed region"}
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        _map(axes, curves, name)
        axes.set(xlabel="initial position error $e(0)$ [mm]", title=titles[name])
    figure.axes[0].set_ylabel("initial velocity error $\\dot{e}(0)$ [m/s]")
    figure.suptitle(literal(title), fontsize=9)
    handles = [
        Patch(facecolor=SURVIVED, edgecolor="#333333", label="survived (simulation)"),
        Patch(facecolor=LOST, edgecolor="#333333", label="lost (simulation)"),
        Patch(facecolor="none", edgecolor=RED, label="guaranteed (proof)"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _map(axes: Any, curves: Curves, name: str) -> None:
    """Draw one map and the outline over it."""
    axes.pcolormesh(
        1e3 * curves[f"{name}_e"],
        curves[f"{name}_v"],
        curves[f"{name}_survived"],
        cmap=ListedColormap([LOST, SURVIVED]),
        vmin=0,
        vmax=1,
        shading="nearest",
        rasterized=True,
    )
    e, low, high = (curves[f"outline_{part}"] for part in ("e", "low", "high"))
    if e.size:
        loop = np.concatenate([e, e[::-1], e[:1]]), np.concatenate([low, high[::-1], low[:1]])
        axes.plot(1e3 * loop[0], loop[1], color=RED)
    axes.grid(False)
