"""The block diagram of the control scheme, Fig. 2 of the paper with what a rig adds to it."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from maglev_design.reporting.plots.style import BLUE, GREY, RED, WIDTH

INK = "black"
Point = tuple[float, float]


def block_diagram() -> Figure:
    """Draw reference, feedforward, law, sampling, clamp, plant and the loop between them."""
    figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(-0.2, 14.6), ylim=(0.5, 6.4), aspect="equal")
    axes.axis("off")
    _box(axes, (0.9, 3.3), 1.9, 1.1, "reference\n(27)", GREY)
    _box(axes, (4.6, 5.6), 2.6, 1.1, "feedforward\n$u^*_\\delta$ (20)", BLUE)
    _box(axes, (4.6, 3.3), 2.0, 1.7, "law (20)\n$w = \\dfrac{1}{C_U}\\,G\\,e$", RED)
    _box(axes, (9.1, 3.3), 1.7, 1.2, "clamp,\nhold, delay", GREY)
    _box(
        axes, (12.1, 3.3), 2.4, 1.7, "rig (4)\n$\\ddot{y}=g-\\dfrac{\\beta u_a^2}{(y+y_0)^2}$", INK
    )
    _sum(axes, (2.8, 3.3))
    _sum(axes, (7.0, 3.3))
    _arrow(axes, (1.85, 3.3), (2.55, 3.3))
    axes.text(2.15, 3.5, "$y^*$", ha="center")
    axes.text(2.42, 2.86, "$-$", ha="center", va="center")
    axes.text(3.02, 2.72, "$+$", ha="left", va="center")
    _arrow(axes, (3.05, 3.3), (3.6, 3.3))
    axes.text(3.3, 3.5, "$e$", ha="center")
    _arrow(axes, (5.6, 3.3), (6.75, 3.3))
    axes.text(6.1, 3.5, "$w$", ha="center")
    _path(axes, [(2.1, 3.3), (2.1, 5.6), (3.3, 5.6)])
    _path(axes, [(5.9, 5.6), (7.0, 5.6), (7.0, 3.55)])
    axes.text(7.15, 4.4, "$u^*_\\delta$", ha="left", va="center")
    _path(axes, [(7.0, 1.9), (7.0, 3.05)])
    axes.text(7.0, 1.55, "$U$", ha="center", va="center")
    _arrow(axes, (7.25, 3.3), (8.25, 3.3))
    axes.text(7.72, 3.5, "$u$", ha="center")
    _arrow(axes, (9.95, 3.3), (10.9, 3.3))
    axes.text(10.45, 3.5, "$u_a$", ha="center")
    _path(axes, [(13.3, 3.3), (14.4, 3.3)])
    axes.text(13.85, 3.5, "$y$", ha="center")
    axes.plot([13.7], [3.3], "o", color=INK, ms=3)
    _path(axes, [(13.7, 3.3), (13.7, 0.8), (2.8, 0.8), (2.8, 3.05)])
    axes.text(8.2, 1.0, "sampled every $T$, with the sensor's noise", ha="center", fontsize=7)
    return figure


def _box(axes: Any, centre: Point, width: float, height: float, text: str, colour: str) -> None:
    corner = (centre[0] - width / 2, centre[1] - height / 2)
    axes.add_patch(
        FancyBboxPatch(
            corner, width, height, boxstyle="round,pad=0,rounding_size=0.12", fc="none", ec=colour
        )
    )
    axes.text(*centre, text, ha="center", va="center", fontsize=8, color=INK)


def _sum(axes: Any, centre: Point) -> None:
    axes.add_patch(Circle(centre, 0.25, fc="none", ec=INK))


def _path(axes: Any, points: list[Point]) -> None:
    for start, end in pairwise(points[:-1]):
        axes.plot([start[0], end[0]], [start[1], end[1]], color=INK, lw=1, solid_capstyle="butt")
    _arrow(axes, points[-2], points[-1])


def _arrow(axes: Any, start: Point, end: Point) -> None:
    style = {"arrowstyle": "-|>", "color": INK, "lw": 1, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=style)
