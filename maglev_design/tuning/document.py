"""A tuning as plain data, for ``--json`` and for the design record."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from maglev_design.controller.design import Design, PoleSpec
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
        "equilibrium": problem.equilibrium,
        "method": problem.method,
        "beta_error": problem.beta_error,
        "beta_error_given": problem.given_beta_error,
        "excitation": None if problem.excitation is None else problem.excitation.as_dict(),
        "warnings": list(result.warnings),
        "family": family_as_data(problem),
        "scenarios": scenarios_of(problem),
        "seed": problem.seed,
        "bounds": {"zeta": list(problem.bounds[0]), "omega_n": list(problem.bounds[1])},
        "zeta": result.poles.first[0],
        "omega_n": result.poles.first[1],
        "poles": _pairs(result.poles),
        "gains": result.design.named_gains,
        "difference_equation": difference_equation(result.design),
        "controller_sha256": result.design.sha256,
        "worst_case": _figures(problem, figures),
        "initial_error": abs(problem.rig.initial.gap - problem.rig.reference.start_gap),
        "nominal": figures.nominal.as_dict(),
        "other_sign": figures.other_sign.as_dict(),
        "with_noise": None if result.with_noise is None else asdict(result.with_noise),
        "baseline": _baseline(result),
        "tightest": _tightest(result),
        "constraints": [
            {"name": c.name, "unit": c.unit, "side": c.side, "limit": c.limit}
            | {"value": c.value, "satisfied": c.satisfied, "binding": abs(c.slack) < BINDING}
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
                "poles": _pairs(a.poles),
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


def family_as_data(problem: TuningProblem) -> dict[str, Any]:
    """Return the plants that the worst case is taken over: gaps [m], ratios, y0 [m]."""
    over, offset = problem.family, problem.rig.plant.gap_offset
    return {
        "gaps": list(over.gaps),
        "ratios": list(over.ratios),
        "gap_offsets": [offset + shift for shift in over.shifts],
        "voltage_held": over.held is not None,
    }


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


def _pairs(poles: PoleSpec) -> list[list[float]]:
    return [list(poles.first), list(poles.second)]


def _tightest(result: TuneResult) -> dict[str, Any]:
    """Return the limit with the least slack; where it is broken, with what would help."""
    limit, found = result.figures.tightest, result.relief
    return {
        "name": limit.name,
        "unit": limit.unit,
        "limit": limit.limit,
        "value": limit.value,
        "poles": _pairs(result.poles),
        "hint": None if found is None else found.hint,
    }


def _figures(problem: TuningProblem, figures: Figures) -> dict[str, Any]:
    shift = figures.case.shift
    return figures.worst.as_dict() | {
        "ms": figures.ms,
        "ms_one_more_sample": figures.ms_one_more_sample,
        "spectral_radius": figures.radius,
        "spectral_radius_one_more_sample": figures.radius_one_more_sample,
        "max_error": figures.max_error,
        "max_error_from_move": figures.max_error_from_move,
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
