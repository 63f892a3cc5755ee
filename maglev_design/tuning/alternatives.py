"""Besides the law of a rig with a coil or a lag: that of second order, and a current loop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from maglev_design.controller.design import PoleSpec
from maglev_design.controller.matching import design_model, matching_law, second_order_law
from maglev_design.rig import Rig, make_rig
from maglev_design.simulation import simulate
from maglev_design.simulation.scenario import at_rest
from maglev_design.tuning.evaluation import design_at, scenario_at
from maglev_design.tuning.figures import Figures, judge
from maglev_design.tuning.problem import TuningProblem, changed

FASTER = 10
"""How many times faster than coil or lag the inner current loop is taken to be."""
Tuned = Callable[[TuningProblem], PoleSpec | None]
"""Tunes a problem quickly; None where no poles are stable."""


def other_laws_and_drives(
    problem: TuningProblem, tuned: Tuned
) -> list[tuple[str, str, PoleSpec, Figures, float | None]]:
    """Return kind, name, poles, figures and supply voltage of each alternative, tuned anew.

    None on a plant of second order. The second-order law is judged with the coil; the current loop
    is a current drive of time constant tau/10 around the same coil, with its own law and the supply
    voltage [V] that it needs.
    """
    rig = problem.rig
    if design_model(rig) != "lag":
        return []
    found: list[tuple[str, str, PoleSpec, Figures, float | None]] = []
    second = problem.controller.plant_order == 2
    other = changed(problem, controller=matching_law(rig) if second else second_order_law(rig))
    poles = tuned(other)
    if poles is not None:
        name = "tan-gpi" if second else "tan-gpi-2"
        found.append(("law", name, poles, judge(other, poles), None))
    own = with_current_loop(rig)
    looped = changed(replace(problem, rig=own), controller=matching_law(own))
    poles = tuned(looped)
    if poles is not None:
        figures = judge(looped, poles)
        supply = supply_voltage(looped, poles, figures, rig.drive.time_constant)
        found.append(("drive", f"current loop of tau/{FASTER}", poles, figures, supply))
    return found


def with_current_loop(rig: Rig) -> Rig:
    """Return the rig with a current loop around its coil, ten times faster than the coil."""
    data = rig.model_dump(exclude_none=True)
    data["plant"]["current_gain"] = rig.current_gain
    data["drive"] = {"kind": "current", "lag": rig.drive.time_constant / FASTER}
    if rig.drive.input_offset:
        data["drive"]["input_offset"] = rig.drive.input_offset
    for name in ("resistance", "inductance", "lag"):  # of the coil, whose place the loop takes
        data.get("uncertainty", {}).pop(name, None)
    return make_rig(data, "current loop")


def supply_voltage(
    problem: TuningProblem, poles: PoleSpec, figures: Figures, time_constant: float
) -> float:
    """Return the largest voltage [V] that the loop asks of the coil, over the worst run.

    u_i + tau u_i' with u_i the current over C and tau the coil's own time constant; the back-EMF is
    not in it.
    """
    design = design_at(problem, poles)
    scenario, rig = scenario_at(problem, figures.case, figures.ratio), problem.rig
    run = simulate(problem.runs, design, scenario)
    lag, offset = rig.drive.lag, rig.drive.input_offset
    left = math.exp(-rig.sampling.period / lag)
    _, current = at_rest(rig, scenario)
    largest = current
    for voltage in (run.applied - offset).tolist():
        largest = max(largest, current + time_constant / lag * (voltage - current))
        current = voltage + (current - voltage) * left
    return float(largest + offset)
