"""Claims that need closed loops of their own, beyond the survey."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maglev_design.controller.design import make_design, plant_beta
from maglev_design.figures import INDICES
from maglev_design.paper.ledger import Finding, claim, finding
from maglev_design.paper.survey import NAMES, Row, ordering
from maglev_design.paper.surveyed import EVERYONE, OPPONENTS
from maglev_design.paper.trials import (
    EMULATION,
    NOISE,
    NOMINAL,
    Contender,
    contenders,
    default_reading,
    figures,
    rig_for,
    run_trial,
)
from maglev_design.rig import Emulator, Rig
from maglev_design.simulation import Scenario, build, simulate


@claim("4.2-measurement-noise")
def noise_role(rig: Rig, seed: int) -> Finding:
    """Judge what the measurement noise of test 2 does."""
    tan = contenders()[0]
    base = default_reading(rig)
    quiet = _without(rig, input=0.0)
    blind = _without(rig, position=0.0)
    cases = {
        "none": (rig, NOMINAL, base),
        "measurement": (quiet, NOISE, base),
        "input": (blind, NOISE, replace(base, position_noise=0.0)),
        "both": (rig, NOISE, base),
    }
    itae = {
        name: figures(*run_trial(r, tan, t, reading, seed=seed))["itae"]
        for name, (r, t, reading) in cases.items()
    }
    share = abs(itae["measurement"] - itae["none"]) / abs(itae["both"] - itae["none"])
    return finding(
        share > 0.05,
        f"ITAE of TAN-GPI: {itae['none']:.4g} m s² without noise, {itae['measurement']:.4g} "
        f"with the measurement noise of {rig.noise.position:g} m alone, {itae['input']:.4g} "
        f"with the input noise of {rig.noise.input:g} V alone, {itae['both']:.4g} with both: "
        f"the measurement noise makes {100 * share:.2g} % of the change.",
        "Test 2 shows the robustness against noise at the input.",
        **{f"itae_{name}": value for name, value in itae.items()},
        share=share,
    )


def _without(rig: Rig, **noise: float) -> Rig:
    return rig.model_copy(update={"noise": rig.noise.model_copy(update=noise)})


@claim("4.1-one-sign")
def sign_of_the_error(rig: Rig, rows: Sequence[Row]) -> Finding:
    """Judge whether the ranking survives the other sign of the initial error."""
    flips = []
    for opponent, index in itertools.product(OPPONENTS, INDICES):
        found = ordering(rows, NOMINAL.name, opponent, index).by_level["initial_error"]
        shares = list(found.values())
        if max(shares) - min(shares) > 0.5:
            told = ", ".join(f"{100 * share:.3g} % at {level}" for level, share in found.items())
            flips.append(f"{NAMES[index]} against {opponent}: better in {told}")
    error = 1e3 * (rig.initial.gap - rig.reference.start_gap)
    return finding(
        not flips,
        f"The paper starts {error:+.3g} mm from the path. From the other side: "
        + ("; ".join(flips) if flips else "no index changes its ranking by half")
        + ".",
        flipped=len(flips),
    )


@claim("6-large-errors")
def initial_error_survived(rig: Rig) -> Finding:
    """Judge the robustness against large initial errors by the largest that is survived."""
    survived = {
        (c.label, sign): largest_error(rig, c, sign) for c in contenders()[:3] for sign in (1, -1)
    }
    bare = {s: largest_error(rig, contenders()[0], s, clamped=False) for s in (1, -1)}
    ours = min(survived["TAN-GPI", 1], survived["TAN-GPI", -1])
    own = abs(rig.initial.gap - rig.reference.start_gap)
    told = "; ".join(
        f"{label} {1e3 * survived[label, -1]:.3g} mm towards the magnet and "
        f"{1e3 * survived[label, 1]:.3g} mm away from it"
        for label in EVERYONE
    )
    return finding(
        ours > own,
        f"Initial error from rest up to which the sampled, clamped loop survives: {told} "
        f"(the allowed gaps, {1e3 * rig.limits.gap[0]:g} to {1e3 * rig.limits.gap[1]:g} mm, "
        "end there if it survives them all). "
        f"The paper's own is {1e3 * own:.3g} mm. Without the clamp at "
        f"{rig.limits.voltage[0]:g} V TAN-GPI survives {1e3 * bare[-1]:.3g} mm and "
        f"{1e3 * bare[1]:.3g} mm: the plant sees u², a negative command attracts.",
        **(
            {
                f"{label}, {'away' if sign > 0 else 'towards'}": value
                for (label, sign), value in survived.items()
            }
            | {f"TAN-GPI unclamped, {w}": bare[s] for s, w in ((1, "away"), (-1, "towards"))}
        ),
    )


def largest_error(
    rig: Rig, contender: Contender, sign: int, *, clamped: bool = True, resolution: float = 1e-5
) -> float:
    """Return up to which initial error of one sign a sampled loop survives every start [m].

    From rest, at exact beta, held at the start of the path, with starts inside ``limits.gap``.
    Thirty starts outwards find the first that is lost; bisection finishes.
    """
    own = rig_for(rig, default_reading(rig))
    start = own.reference.start_gap
    hold = {"end_gap": start, "start_time": 0.0, "end_time": 1.0, "horizon": 1.0}
    own = own.model_copy(update={"reference": own.reference.model_copy(update=hold)})
    beta = plant_beta(own)
    design = make_design(own, contender.poles, controller=contender.controller)
    loop = build(own, design.method, controller=contender.controller)
    far = own.limits.gap[1 if sign > 0 else 0]
    limit = abs(far - start) if math.isfinite(far) else 10 * start

    def survives(error: float) -> bool:
        scenario = Scenario(beta, start + sign * error)
        found = simulate(loop, design, scenario, clamped=clamped).metrics
        return not found.crashed and abs(found.final_error) < 1e-3 * start

    good = 0.0
    for bad in limit * (1 - 1e-6) * np.arange(1, 31) / 30:
        if not survives(bad):
            break
        good = float(bad)
    else:
        return good
    while bad - good > resolution:
        middle = (good + bad) / 2
        good, bad = (middle, bad) if survives(middle) else (good, middle)
    return good


@claim("5-experiments")
def experiments(rig: Rig, seed: int) -> Finding:
    """State what can be said of sec. 5: an emulation, not the experiment."""
    why = "The experiments cannot be repeated here."
    values: dict[str, float] = {}
    if rig.emulator != Emulator():
        for contender in contenders()[:3]:
            runs = [
                figures(*run_trial(rig, contender, EMULATION, default_reading(rig), seed=seed + k))
                for k in range(5)
            ]
            for figure in (*INDICES, "total_variation"):
                median = float(np.median([run[figure] for run in runs]))
                values[f"{contender.label}_{figure}"] = median
        why += (
            " On the emulated rig (coil, delay, quantisation, 2 ms; an emulation, not the "
            "experiment), medians of 5 seeds, TAN-GPI / PID / FEE-GPI: "
            + "; ".join(
                f"{NAMES[figure]} "
                + " / ".join(f"{values[f'{label}_{figure}']:.3g}" for label in EVERYONE)
                for figure in (*INDICES, "total_variation")
            )
            + "."
        )
    return finding("not-checkable", why, **values)
