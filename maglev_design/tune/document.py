"""A tuning as plain data, for ``--json`` and for the design record."""

from __future__ import annotations

from typing import Any

from maglev_design.design import PAPER_POLES, Design
from maglev_design.simulate.independent import INTEGRATOR
from maglev_design.tune.problem import TuningProblem
from maglev_design.tune.result import (
    VERIFICATION_TOLERANCE,
    Figures,
    TuneResult,
    Verification,
    times_smaller,
)


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
        "scenarios": "robust" if len(problem.cases) > 1 else "nominal",
        "seed": problem.seed,
        "bounds": {"zeta": list(problem.bounds[0]), "omega_n": list(problem.bounds[1])},
        "zeta": result.poles.first[0],
        "omega_n": result.poles.first[1],
        "poles": [list(result.poles.first), list(result.poles.second)],
        "gains": dict(zip(("k0", "k1", "k2", "k3"), result.design.gains, strict=True)),
        "difference_equation": difference_equation(problem, result.design),
        "worst_case": _figures(figures),
        "nominal": figures.nominal.as_dict(),
        "other_sign": figures.other_sign.as_dict(),
        "baseline": {
            "zeta": PAPER_POLES[0],
            "omega_n": PAPER_POLES[1],
            "worst_case": _figures(result.baseline),
            "feasible": result.baseline.feasible,
            "violated": [c.name for c in result.baseline.constraints if not c.satisfied],
            "improvement": result.improvement,
        },
        "constraints": [
            {"name": c.name, "unit": c.unit, "side": c.side, "limit": c.limit}
            | {"value": c.value, "satisfied": c.satisfied}
            for c in figures.constraints
        ],
        "verification": _verification(problem, result.verification)
        | {"baseline": _verification(problem, result.baseline_verification)},
        "alternatives": [
            {
                "kind": a.kind,
                "name": a.name,
                "tuned": a.tuned,
                "poles": [list(a.poles.first), list(a.poles.second)],
                "worst_case": _figures(a.figures),
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


def difference_equation(problem: TuningProblem, design: Design) -> dict[str, Any]:
    """Return the numbers of the difference equation, with its constants and limits."""
    low, high = problem.rig.limits.voltage
    return {
        "period": problem.rig.sampling.period,
        "Y": design.Y,
        "U": design.believed.U,
        "u_min": low,
        "u_max": high,
        **design.coefficients,
    }


def _figures(figures: Figures) -> dict[str, Any]:
    return figures.worst.as_dict() | {
        "ms": figures.ms,
        "ms_one_more_sample": figures.ms_one_more_sample,
        "spectral_radius": figures.radius,
        "spectral_radius_one_more_sample": figures.radius_one_more_sample,
        "noise_voltage": figures.noise_voltage,
        "ratio": figures.ratio,
    }


def _verification(problem: TuningProblem, verification: Verification) -> dict[str, Any]:
    return {
        "integrator": INTEGRATOR,
        problem.objective.key: verification.reference,
        "relative_difference": verification.relative_difference,
        "tolerance": VERIFICATION_TOLERANCE,
        "passed": verification.passed,
    }
