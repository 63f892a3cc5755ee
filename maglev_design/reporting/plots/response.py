"""The figure of one simulated loop."""

from __future__ import annotations

from matplotlib.figure import Figure

from maglev_design.reporting.plots.style import BLUE, RED, WIDTH, Curves, literal


def response_figure(curves: Curves, title: str) -> Figure:
    """Draw one simulated loop: gap, error and voltage below each other.

    ``curves`` holds times, gap, reference [s, m, m] and commanded, applied [V].
    """
    figure = Figure(figsize=(WIDTH, 5.4), layout="constrained")
    upper, middle, lower = figure.subplots(3, 1, sharex=True)
    times, gap, reference = curves["times"], curves["gap"], curves["reference"]
    upper.plot(times, 1e3 * gap, color=RED, label="gap $y$")
    upper.plot(times, 1e3 * reference, color="black", lw=0.9, ls=":", label="reference $y^*$")
    upper.set(ylabel="gap [mm]", title=literal(title))
    upper.legend()
    middle.plot(times, 1e6 * (gap - reference), color=RED)
    middle.set(ylabel="error $e$ [µm]")
    for name, colour, dash in (("commanded", BLUE, "--"), ("applied", RED, "-")):
        lower.step(times[:-1], curves[name], where="post", color=colour, ls=dash, label=name)
    lower.set(xlabel="time $t$ [s]", ylabel="voltage [V]")
    lower.legend()
    upper.margins(x=0)
    return figure
