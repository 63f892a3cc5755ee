"""Pole placement tuned on the sampled nonlinear loop, worst case over the uncertainty of beta.

``build_problem`` states the problem, ``solve`` searches it, judges the answer at every ratio,
re-simulates it with an independent integrator and compares it with the paper's poles.
"""

from maglev_design.tuning.document import as_json
from maglev_design.tuning.emulated import EmulatedRow, emulated_row
from maglev_design.tuning.figures import Figures, judge
from maglev_design.tuning.problem import TuningProblem, build_problem
from maglev_design.tuning.relief import Unstabilisable
from maglev_design.tuning.result import (
    Status,
    TuneResult,
    solve,
    solve_every_method,
)
from maglev_design.tuning.tradeoff import TradeOff, trade_off

__all__ = [
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
