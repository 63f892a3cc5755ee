"""The nonlinear plant in closed loop: sampled or continuous, with figures that state their error.

``build`` makes a loop ready to run, ``simulate`` runs it, ``resimulate`` runs the same loop with
an integrator that shares nothing with the first.
"""

from maglev_design.simulate.graph import LoopGraph, build
from maglev_design.simulate.independent import resimulate
from maglev_design.simulate.response import (
    Crash,
    Metrics,
    Response,
    Scenario,
    error_bounds,
    mirrored,
    nominal_scenario,
    pole_tangent,
    simulate,
)

__all__ = [
    "Crash",
    "LoopGraph",
    "Metrics",
    "Response",
    "Scenario",
    "build",
    "error_bounds",
    "mirrored",
    "nominal_scenario",
    "pole_tangent",
    "resimulate",
    "simulate",
]
