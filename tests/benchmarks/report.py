"""The measurements as tables, figures and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from maglev_design.reporting.plots.style import WIDTH, house_style, plain_ticks, save_figure

Data = dict[str, Any]

MARKERS = "osD^vP*X"


@dataclass(frozen=True)
class Target:
    """One ratio to reach."""

    name: str
    limit: float
    reached: float | None
    obstacle: str
    at_least: bool = False

    @property
    def met(self) -> bool | None:
        """Whether it is reached; None when it was not measured."""
        if self.reached is None:
            return None
        return self.reached >= self.limit if self.at_least else self.reached <= self.limit

    def row(self) -> list[str]:
        """Return the row of the table."""
        sign = ">=" if self.at_least else "<="
        verdict = {True: "yes", False: "**no**", None: "not measured"}[self.met]
        reached = "-" if self.reached is None else number(self.reached)
        why = "" if self.met else self.obstacle
        return [self.name, f"{sign} {self.limit:g}", reached, verdict, why]


def number(value: float) -> str:
    """Return three digits, without an exponent where a person would write none."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"


def targets(found: Data) -> list[Target]:
    """Return what the issue asks for beside what was measured."""
    times, commands, tune = found["loops"]["seconds"], found["commands"], found["tune"]
    yard, bare = times["yardstick"], commands["python -c pass"]
    own, lanes, peer = tune["own"], times["lanes, sampled"], tune.get("peer_extrapolated")
    rates = found["sweep"]["steady"]
    inside = own["plain_seconds"] + own["carrying_seconds"]
    share, cores = inside / own["solve"], found["machine"]["cores"]
    shares = {
        name: commands[name] / bare
        for name in ("import typer", "import numpy", "import casadi", "import sympy")
    }
    parts = ", ".join(f"`{name}` is {number(value)}" for name, value in shares.items())
    lane_text = (
        f"{found['machine']['lanes']} lanes of doubles a register; the step's divisions and "
        "square roots do not overlap more than this"
    )
    return [
        Target(
            "single compiled loop, in yardsticks",
            1.5,
            times["single, continuous"] / yard,
            "the yardstick is compiled with -ffast-math and has no crash test, no extremes, no "
            "total variation and no exact quadrature of |e|",
        ),
        Target("sampled loop in lanes, in yardsticks", 0.25, lanes / yard, lane_text),
        Target(
            "the same with noise, in yardsticks",
            0.4,
            times["lanes, sampled, noise"] / yard,
            lane_text + "; with noise |e| changes sign in most steps, which needs a root each",
        ),
        Target(
            "loop with two sensitivities, in loops",
            3.0,
            times["lanes, sampled, 2 sensitivities"] / lanes,
            "more live values than vector registers",
        ),
        Target(
            "robust tune, verification and rows of its own apart, in yardsticks",
            2000,
            own["solve"] / tune["yardstick"],
            f"{share:.0%} of the time is in simulate_batch ({own['plain_loops']} loops and "
            f"{own['carrying_loops']} with gradients); the rest is the linear limits (CasADi's "
            "virtual machine and NumPy) and SLSQP",
        ),
        Target(
            "robust tune, times faster than python-control with scipy.optimize",
            1000,
            None if peer is None else peer / own["solve"],
            "as above: what is not simulation costs the same on both sides",
            at_least=True,
        ),
        Target("`--help`, in `python -c pass`", 16, commands["maglev-design --help"] / bare, parts),
        Target(
            "warm `simulate`, in `python -c pass`",
            70,
            commands["maglev-design simulate"] / bare,
            parts,
        ),
        Target(
            "sweep on two processes, in one",
            1.8,
            rates["2 processes"] / rates["1 processes"] if rates else None,
            f"{cores} cores are shared with the process that writes the files"
            if rates
            else "left out of a quick run",
            at_least=True,
        ),
    ]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a markdown table."""
    escaped = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    lines = [head, ["---"] * len(head), *escaped]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def milliseconds(seconds: float) -> str:
    """Return a time in milliseconds."""
    return number(1e3 * seconds)


def text(found: Data) -> str:
    """Return the report as markdown."""
    loops, machine = found["loops"], found["machine"]
    times, tune = loops["seconds"], found["tune"]
    yard, own = times["yardstick"], tune["own"]
    errors = loops["errors"]
    quick = (
        "**A quick run: tiny sizes, no peers. The figures mean nothing.**\n"
        if found["quick"]
        else ""
    )
    sections = [
        "# Performance",
        "Made by `python tests/benchmarks -o reports`. Everything is measured side by side in one "
        "run, the contenders in turn, the least of several runs; the ratios are the result, the "
        "times are those of one machine. One closed loop is the paper's rig over its seven "
        "seconds. The yardstick is `tests/benchmarks/yardstick.c`: that loop by hand in scalar C, "
        "continuous, Runge-Kutta 4 at 1 ms with the three integrals as states.",
        quick,
        f"{machine['cores']} cores, {machine['architecture']}, {machine['lanes']} lanes; "
        f"{machine['compiler']} `{' '.join(machine['flags'])}`; Python {machine['python']}, "
        + ", ".join(f"{n} {machine[n]}" for n in ("numpy", "scipy", "casadi", "control"))
        + ".",
        "## Targets",
        table(
            ["ratio", "target", "reached", "", "what stands in the way"],
            [t.row() for t in targets(found)],
        ),
        "## One closed loop",
        table(
            ["loop", "ms", "yardsticks"],
            [[n, milliseconds(t), number(t / yard)] for n, t in times.items()],
        ),
        f"Processor time. In lanes: {loops['batch']} loops a call, time a loop. `simulate_batch` "
        "is the public function: designs and scenarios in, summaries out; the other compiled rows "
        "are arrays in, figures out. A single loop fills all lanes with itself: four without "
        "branches take less time than one with. Relative error of ITAE: yardstick "
        f"{errors['yardstick']:.1e}, compiled or interpreted continuous "
        f"{errors['continuous']:.1e}, sampled {errors['sampled']:.1e} (against steps sixteen "
        f"times shorter). The two back ends differ by {loops['back_ends']:.0e}.",
        "## Work and precision",
        "The continuous loop. Error of ITAE against SciPy's DOP853 with steps of at most 1 ms and "
        "rtol 1e-10.",
        "![Error of ITAE over time, contender by contender](performance/work-precision.svg)",
        table(
            ["contender", "setting", "ms", "yardsticks", "relative error"],
            [
                [
                    row["contender"],
                    row["setting"],
                    milliseconds(row["seconds"]),
                    number(row["seconds"] / yard),
                    f"{row['error']:.1e}",
                ]
                for row in found["precision"]
            ],
        ),
        "## Gradients",
        table(
            ["loop", "in loops without"],
            [
                [name, number(times[name] / times[base])]
                for name, base in (
                    ("lanes, sampled, 2 sensitivities", "lanes, sampled"),
                    ("lanes, sampled, 4 sensitivities", "lanes, sampled"),
                    ("single, sampled, 2 sensitivities", "single, sampled"),
                    ("interpreted, sampled, 2 sensitivities", "interpreted, sampled"),
                )
            ],
        ),
        "Forward differences cost one loop more than there are variables, and half the digits.",
        "## Scenarios and cores",
        "![Time a loop over the number of loops](performance/scaling.svg)",
        table(
            ["loops a call", "ms a loop, 1 thread", "2 threads", "yardsticks, 1", "2", "gain"],
            [
                [
                    str(row["loops"]),
                    *[milliseconds(row["threads"][t]) for t in ("1", "2")],
                    *[number(row["threads"][t] / row["yardstick"]) for t in ("1", "2")],
                    number(row["threads"]["1"] / row["threads"]["2"]),
                ]
                for row in found["scaling"]
            ],
        ),
        "## Start-up",
        table(
            ["", "imports, ms", "build, ms", "first loop, ms", "second loop, ms"],
            [
                [name, *[milliseconds(row[k]) for k in ("imports", "build", "first", "second")]]
                for name, row in found["start"]["times"].items()
            ],
        ),
        "Cold: nothing is compiled yet. Warm: another process has compiled this loop before.",
        table(
            ["process", "ms", "in `python -c pass`"],
            [
                [f"`{n}`", milliseconds(t), number(t / found["commands"]["python -c pass"])]
                for n, t in found["commands"].items()
            ],
        ),
        "## Memory",
        table(
            ["loops in one call", "peak before, MB", "peak after, MB"],
            [
                [f"{row['loops']:.0f}", number(row["before"]), number(row["after"])]
                for row in found["start"]["memory"]
            ],
        ),
        "## A robust tune",
        table(
            ["part", "s", "yardsticks"],
            [
                [name, number(value), number(value / tune["yardstick"])]
                for name, value in (
                    ("search, judgement and alternatives", own["solve"]),
                    ("of it: loops", own["plain_seconds"]),
                    ("of it: loops with gradients", own["carrying_seconds"]),
                    ("what measuring U would bring, and the emulated rig", own["rows"]),
                    ("independent verification", own["verification"]),
                )
            ],
        ),
        f"In process, warm, imports apart, processor time; zeta = {own['poles'][0]:.4g}, omega_n = "
        f"{own['poles'][1]:.5g} rad/s; {own['plain_loops']} loops without gradients and "
        f"{own['carrying_loops']} with.",
        _peer(tune),
        "## A sweep",
        _sweep(found["sweep"]),
    ]
    return "\n\n".join(section for section in sections if section) + "\n"


def _peer(tune: Data) -> str:
    peer = tune["peer"]
    if not peer:
        return "The same with python-control and scipy.optimize was left out of this run."
    return (
        "The same job with python-control and scipy.optimize: timed is what SLSQP asks for at its "
        f"first point, the worst ITAE over {peer['ratios']} values of beta and its gradient by "
        "differences (continuous loop, rtol 1e-6), "
        f"{peer['loops']} loops in {number(peer['seconds'])} s. *Extrapolated*: with the loops of "
        "this package's search, a gradient by two variables being three loops, "
        f"{tune['peer_loops_needed']} loops take {number(tune['peer_extrapolated'])} s, "
        f"{number(tune['peer_extrapolated'] / tune['own']['solve'])} times as long. python-control "
        "cannot mix a sampled controller with a continuous plant: its loop is the easier one."
    )


def _sweep(found: Data) -> str:
    whole, steady = found["whole"], found["steady"] or {}
    names = [name for name in whole if name not in ("samples", "chunk")]
    rows = [[name, number(whole[name])] for name in names]
    rows += [[f"{name}, once they are up", number(rate)] for name, rate in steady.items()]
    return (
        table(["who", "scenarios a second"], rows)
        + f"\n\n{whole['samples']} scenarios in chunks of {whole['chunk']}; wall time, the start "
        "of the processes included unless it says otherwise."
    )


def precision_figure(found: Data) -> Figure:
    """Return the work-precision diagram."""
    figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
    axes = figure.add_subplot()
    names = list(dict.fromkeys(row["contender"] for row in found["precision"]))
    for marker, name in zip(MARKERS, names, strict=False):
        rows = [row for row in found["precision"] if row["contender"] == name]
        axes.loglog(
            [1e3 * row["seconds"] for row in rows],
            [max(row["error"], 1e-12) for row in rows],
            marker=marker,
            label=name,
        )
    axes.set_xlabel("processor time a closed loop [ms]")
    axes.set_ylabel("relative error of ITAE [-]")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def scaling_figure(found: Data) -> Figure:
    """Return time a loop over the number of loops in one call."""
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    axes = figure.add_subplot()
    counts = [row["loops"] for row in found["scaling"]]
    for threads, marker in (("1", "o"), ("2", "s")):
        ratios = [row["threads"][threads] / row["yardstick"] for row in found["scaling"]]
        label = f"{threads} thread{'s' if threads != '1' else ''}"
        axes.loglog(counts, ratios, marker=marker, label=label)
    axes.set_xlabel("closed loops in one call [-]")
    axes.set_ylabel("wall time a loop [yardsticks]")
    plain_ticks(axes.yaxis)
    axes.legend()
    return figure


def write(found: Data, folder: Path) -> list[Path]:
    """Write performance.md, its figures and performance.json; return their paths."""
    pictures = folder / "performance"
    pictures.mkdir(parents=True, exist_ok=True)
    judged = [
        {"name": t.name, "limit": t.limit, "at_least": t.at_least}
        | {"reached": t.reached, "met": t.met, "obstacle": None if t.met else t.obstacle}
        for t in targets(found)
    ]
    paths = [folder / "performance.md", folder / "performance.json"]
    paths[0].write_text(text(found), "utf-8")
    document = _without_nan(found | {"targets": judged})
    paths[1].write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", "utf-8")
    with house_style():
        for name, draw in (("work-precision", precision_figure), ("scaling", scaling_figure)):
            paths.append(save_figure(draw(found), pictures / f"{name}.svg"))
    return paths


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
