"""The record that `tune` saves, made from a result."""

from __future__ import annotations

from maglev_design.certification.lyapunov.lmi import certify_family
from maglev_design.certification.margins import sampled_margins
from maglev_design.controller.matching import is_certified_law
from maglev_design.record import DesignRecord, make_record
from maglev_design.tuning import TradeOff, TuneResult


def recorded(result: TuneResult, trade_off: TradeOff | None = None) -> DesignRecord:
    problem = result.problem
    margins = sampled_margins(problem.loop, result.poles.values, problem.family)
    certificate = None
    if is_certified_law(problem.rig, problem.controller):
        (certificate,) = certify_family(
            result.design, problem.rig, beta_error=problem.given_beta_error, loops=("sampled",)
        )
    return make_record(result, margins, certificate, trade_off)
