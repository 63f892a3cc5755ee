"""The nonlinear plant in closed loop: sampled or continuous, with figures that state their error.

``build`` makes a loop ready to run, ``simulate`` runs it, ``resimulate`` runs the same loop with
an integrator that shares nothing with the first.
"""

from maglev_design.simulation.batch import Summary, cores, respond, simulate_batch
from maglev_design.simulation.emulator import (
    at_own_period,
    designed_for,
    emulated,
    emulator_effects,
)
from maglev_design.simulation.grid import LoopGraph, build
from maglev_design.simulation.independent import own_step, resimulate, resimulate_continuous
from maglev_design.simulation.response import (
    Crash,
    Metrics,
    Response,
    StatedErrors,
    loop_for,
    simulate,
    stated_errors,
)
from maglev_design.simulation.scenario import Scenario, mirrored, nominal_scenario
from maglev_design.simulation.sensitivities import Sensitivities, pole_sensitivities
from maglev_design.simulation.transient import settling_time, total_variation, undershoot

__all__ = [
    "Crash",
    "LoopGraph",
    "Metrics",
    "Response",
    "Scenario",
    "Sensitivities",
    "StatedErrors",
    "Summary",
    "at_own_period",
    "build",
    "cores",
    "designed_for",
    "emulated",
    "emulator_effects",
    "loop_for",
    "mirrored",
    "nominal_scenario",
    "own_step",
    "pole_sensitivities",
    "resimulate",
    "resimulate_continuous",
    "respond",
    "settling_time",
    "simulate",
    "simulate_batch",
    "stated_errors",
    "total_variation",
    "undershoot",
]
