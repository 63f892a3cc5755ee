"""A tuning as plain data, for ``--json`` and for the design record."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from maglev_design.controller.design import Design
from maglev_design.files import picked
from maglev_design.options import Scenarios
from maglev_design.simulation.independent import INTEGRATOR
from maglev_design.tuning.figures import (
    VERIFICATION_TOLERANCE,
    Figures,
    Verification,
    times_smaller,
)
from maglev_design.tuning.problem import TuningProblem
from maglev_design.tuning.result import TuneResult

BINDING = 2e-3
"""Slack below which a limit is said to bind."""


def as_json(result: TuneResult) -> dict[str, Any]:
    """Return the result as plain data for ``--json`` and the design record."""
    problem, figures = result.problem, result.figures
    return {
        "status": result.status.name.lower(),
        "message": result.status.value,
        "objective": problem.objective.key,
        **picked(problem, "equilibrium", "method", "beta_error"),
        "beta_error_given": problem.given_beta_error,
        "excitation": problem.excitation and asdict(problem.excitation),
        "warnings": list(result.warnings),
        "family": problem.family.as_data(problem.rig.plant.gap_offset),
        "scenarios": scenarios_of(problem),
        "seed": problem.seed,
        "bounds": {"zeta": list(problem.bounds[0]), "omega_n": list(problem.bounds[1])},
        "zeta": result.poles.first[0],
        "omega_n": result.poles.first[1],
        "poles": result.poles.pairs,
        "gains": result.design.named_gains,
        "difference_equation": difference_equation(result.design),
        "controller_sha256": result.design.sha256,
        "worst_case": _figures(problem, figures),
        "initial_error": abs(problem.rig.initial.gap - problem.rig.reference.start_gap),
        "nominal": figures.nominal.as_dict(),
        "other_sign": figures.other_sign.as_dict(),
        "with_noise": result.with_noise and asdict(result.with_noise),
        "baseline": _baseline(result),
        "tightest": _tightest(result),
        "constraints": [
            picked(c, "name", "unit", "side", "limit", "value", "satisfied")
            | {"binding": abs(c.slack) < BINDING}
            for c in figures.constraints
        ],
        "emulated": result.emulated and result.emulated.as_dict(),
        "verification": _verification(problem, result.verification),
        "alternatives": [
            {
                "kind": a.kind,
                "voltage_error": problem.rig.uncertainty.voltage_error
                if a.kind == "planning"
                else None,
                "name": a.name,
                "tuned": a.tuned,
                **({"supply_voltage": a.supply_voltage} if a.kind == "drive" else {}),
                "poles": a.poles.pairs,
                "worst_case": _figures(problem, a.figures),
                "feasible": a.figures.feasible,
                "improvement": times_smaller(
                    getattr(figures.worst, problem.objective.key),
                    getattr(a.figures.worst, problem.objective.key),
                ),
            }
            for a in result.alternatives
        ],
        "evaluations": result.evaluations,
    }


def scenarios_of(problem: TuningProblem) -> Scenarios:
    """Return what was tuned on."""
    if problem.emulated_runs is not None:
        return "emulated"
    return "robust" if any(case.flipped for case in problem.cases) else "nominal"


def difference_equation(design: Design) -> dict[str, Any]:
    """Return the numbers of the difference equation, with its constants and limits."""
    low, high = design.voltage_limits
    return {
        "period": design.period,
        "Y": design.Y,
        "U": design.believed.U,
        "u_min": low,
        "u_max": high,
        **design.coefficients,
    }


def _tightest(result: TuneResult) -> dict[str, Any]:
    """Return the limit with the least slack; where it is broken, with what would help."""
    limit, found = result.figures.tightest, result.relief
    own = picked(limit, "name", "unit", "limit", "value")
    return own | {"poles": result.poles.pairs, "hint": found and found.hint}


def _figures(problem: TuningProblem, figures: Figures) -> dict[str, Any]:
    shift = figures.case.shift
    return {
        **figures.worst.as_dict(),
        **picked(figures, "ms", "ms_one_more_sample", "spectral_radius"),
        **picked(figures, "spectral_radius_one_more_sample", "max_error", "max_error_from_move"),
        "noise_voltage": figures.noise_voltage,
        "ratio": problem.family.ratio_at(figures.ratio, shift),
        "gap_offset": problem.rig.plant.gap_offset + shift,
    }


def _baseline(result: TuneResult) -> dict[str, Any] | None:
    """Return the poles to compare with; None where there are none."""
    problem, found = result.problem, result.baseline
    if found is None:
        return None
    return {
        "zeta": found.poles.first[0],
        "omega_n": found.poles.first[1],
        "worst_case": _figures(problem, found.figures),
        "feasible": found.figures.feasible,
        "violated": [c.name for c in found.figures.constraints if not c.satisfied],
        "improvement": result.improvement,
        "verification": _verification(problem, found.verification),
    }


def _verification(problem: TuningProblem, verification: Verification) -> dict[str, Any]:
    return {
        "integrator": INTEGRATOR,
        problem.objective.key: verification.reference,
        "relative_difference": verification.relative_difference,
        "tolerance": VERIFICATION_TOLERANCE,
        "passed": verification.passed,
    }
