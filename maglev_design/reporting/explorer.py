"""The interactive figure of the page: the lowered programs as JavaScript, and the rig's numbers.

What the page computes with is printed here from the programs that simulation and tuning run; the
script beside it (``templates/explorer.js``) only integrates, finds roots and draws.
"""

from __future__ import annotations

from typing import Any

from maglev_design.controller.design import PATH_ENDS
from maglev_design.controller.plant import (
    path_gaps,
)
from maglev_design.controller.timing import timing
from maglev_design.files import picked
from maglev_design.lowering import Program
from maglev_design.programs import (
    acceleration_program,
    coefficients_program,
    feedforward_program,
    gains_program,
    metrics_program,
    plant_program,
    reference_program,
    sampled_loop_program,
    slope_program,
    start_program,
    step_program,
)
from maglev_design.record import DesignRecord
from maglev_design.reporting.plots.design import start_of
from maglev_design.simulation import grid as grids
from maglev_design.simulation import nominal_scenario
from maglev_design.simulation.response import loop_for

WIDER = 3.0
"""By how much the sliders of the poles go beyond the design, both ways, within the search box."""
FURTHER = 2.0
"""By how much the slider of the ratio goes beyond the uncertainty."""
LEAST_SPREAD = 0.2
"""Of the ratio's slider where the uncertainty is small."""


def programs_of(record: DesignRecord) -> dict[str, Program]:
    """Return every program that the page runs, by the name the script calls it."""
    design = record.design
    method, controller = design.method, design.controller
    return {
        "gains": gains_program(controller),
        "plant": plant_program(),
        "slope": slope_program(controller),
        "coefficients": coefficients_program(method, controller),
        "reference": reference_program(),
        "start": start_program(controller),
        "step": step_program(method, controller),
        "feedforward": feedforward_program(method, controller),
        "acceleration": acceleration_program(),
        "metrics": metrics_program(),
        "sampled_loop": sampled_loop_program(method, controller),
    }


def javascript(programs: dict[str, Program]) -> str:
    """Return the programs as one object of functions, from an object of inputs to one of outputs.

    Examples
    --------
    >>> from sympy import Symbol
    >>> from maglev_design.lowering import lower
    >>> print(javascript({"twice": lower([Symbol("x")], {"y": 2 * Symbol("x")})}))
    {
    twice({x}) {
      const t0 = 2.0 * x;
      const y = t0;
      return {y};
    },
    }
    """
    functions = []
    for name, lowered in programs.items():
        body = "".join(f"  {line}\n" for line in lowered.source("javascript"))
        returned = f"  return {{{', '.join(lowered.outputs)}}};\n"
        functions.append(f"{name}({{{', '.join(lowered.inputs)}}}) {{\n{body}{returned}}},\n")
    return "{\n" + "".join(functions) + "}"


def explorer_data(record: DesignRecord) -> dict[str, Any]:
    """Return the rig's numbers and the sliders for the page, plain data, SI units.

    An unlimited voltage or gap is None.
    """
    rig, design = record.rig, record.design
    loop = loop_for(rig, design)
    when = timing(rig.sampling.period, rig.sampling.delay)
    path, gaps = rig.reference, path_gaps(rig, 2)
    believed = design.believed
    start = nominal_scenario(rig, believed.beta)
    return {
        "known": {
            "g": rig.plant.gravity,
            "beta_c": believed.beta,
            "U": believed.U,
            "C_U_hat": believed.C_U,
            "C_Y_hat": believed.C_Y,
            "Y": design.Y,
            "y0": rig.plant.gap_offset,
            "T": rig.sampling.period,
            "T_1": when.part,
            "u_min": rig.limits.voltage[0],
            "u_max": rig.limits.voltage[1],
            **picked(path, *PATH_ENDS),
            "gap_low": grids.contact_gap(rig),
            "gap_high": rig.limits.gap[1],
        },
        "initial": {"y": start.initial_gap, "v": start.initial_velocity},
        "periods": len(loop.times) - 1,
        "horizon": path.horizon,
        "whole": when.whole,
        "held": when.held,
        "substeps": list(loop.substeps),
        "gaps": sorted({float(gaps[0]), float(gaps[-1])}),
        "early": start_of(record.document),
        "sliders": _sliders(record),
    }


def _sliders(record: DesignRecord) -> list[dict[str, Any]]:
    (zeta_1, omega_1), (zeta_2, omega_2) = record.design.poles.first, record.design.poles.second
    bounds = record.document["bounds"]

    def slider(
        name: str, label: tuple[str, str, str], unit: str, value: float, sets: list[str]
    ) -> dict[str, Any]:
        low, high = bounds["zeta" if name.startswith("zeta") else "omega_n"]
        low, high = max(low, value / WIDER), min(high, value * WIDER)
        return {"id": name, "label": label, "unit": unit, "value": value, "sets": sets} | {
            "low": min(low, value),
            "high": max(high, value),
        }

    if (zeta_1, omega_1) == (zeta_2, omega_2):
        poles = [
            slider("zeta", ("ζ", "", ""), "", zeta_1, ["zeta_1", "zeta_2"]),
            slider("omega_n", ("ω", "n", ""), "rad/s", omega_1, ["omega_1", "omega_2"]),
        ]
    else:
        poles = [
            slider("zeta_1", ("ζ", "1", ""), "", zeta_1, ["zeta_1"]),
            slider("omega_1", ("ω", "1", ""), "rad/s", omega_1, ["omega_1"]),
            slider("zeta_2", ("ζ", "2", ""), "", zeta_2, ["zeta_2"]),
            slider("omega_2", ("ω", "2", ""), "rad/s", omega_2, ["omega_2"]),
        ]
    spread = min(max(FURTHER * record.document["beta_error"], LEAST_SPREAD), 0.9)
    ratio = {"id": "ratio", "label": ("β", "c", "/β"), "unit": "", "value": 1.0, "sets": ["ratio"]}
    return [*poles, ratio | {"low": 1 - spread, "high": 1 + spread}]
