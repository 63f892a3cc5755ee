"""Pole placement tuned on the sampled nonlinear loop, worst case over the uncertainty of beta.

``build_problem`` states the problem, ``solve`` searches it, judges the answer at every ratio,
re-simulates it with an independent integrator and compares it with the paper's poles.
"""

from maglev_design.tune.document import as_json
from maglev_design.tune.emulated import EmulatedRow, emulated_row
from maglev_design.tune.figures import Figures, judge
from maglev_design.tune.problem import OBJECTIVES, TuningProblem, build_problem
from maglev_design.tune.relief import Unstabilisable
from maglev_design.tune.result import (
    Status,
    TuneResult,
    solve,
    solve_every_method,
)
from maglev_design.tune.tradeoff import TradeOff, trade_off

__all__ = [
    "OBJECTIVES",
    "EmulatedRow",
    "Figures",
    "Status",
    "TradeOff",
    "TuneResult",
    "TuningProblem",
    "Unstabilisable",
    "as_json",
    "build_problem",
    "emulated_row",
    "judge",
    "solve",
    "solve_every_method",
    "trade_off",
]
