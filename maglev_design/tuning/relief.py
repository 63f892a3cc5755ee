"""Where nothing is feasible: the poles that come closest, and which options or rates would do."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design import linear_loop as loops
from maglev_design.controller.matching import second_order_law
from maglev_design.rig import MOST_DELAYED_PERIODS
from maglev_design.tuning import dense
from maglev_design.tuning.cautions import sampling_product
from maglev_design.tuning.figures import judge
from maglev_design.tuning.problem import TuningCase, TuningProblem, changed

Array = NDArray[np.float64]

ROOM = 1.03
"""Factor on a relaxed limit: a search needs a region, a single point is not found."""
OPTIONS: Mapping[str, tuple[str, ...]] = {
    "Ms": ("Ms",),
    "noise voltage": ("noise voltage",),
    "--allow-saturation": ("smallest commanded voltage", "largest commanded voltage"),
}
"""The limits that an option of a tuning can relax."""


@dataclass(frozen=True)
class Relief:
    """Options of :func:`maglev_design.tuning.build_problem` that make a problem feasible.

    Attributes
    ----------
    options : mapping
    hint : str
        The same as a person types them.
    """

    options: Mapping[str, Any]
    hint: str


def _pairs(problem: TuningProblem) -> list[tuple[TuningCase, float]]:
    ratios = dict.fromkeys(problem.family.ratios)
    return [(case, ratio) for case in problem.cases for ratio in ratios]


def closest(problem: TuningProblem, told: Callable[[], None]) -> Array | None:
    """Return the stable point of the box whose worst broken limit is broken least; None if none."""
    return _least(problem, dense.least_violation, told)


def _least(problem: TuningProblem, score: dense.Score, told: Callable[[], None]) -> Array | None:
    return dense.lowest(problem, score, _pairs(problem), clamped=True, told=told)[0]


def relief(problem: TuningProblem, tightest: str) -> Relief | None:
    """Return the smallest change of options that makes the problem feasible, None without one.

    else as many as have to move. Before them all, behind a drive, the second-order law, since the
    poles of the third-order one may have to be too fast.
    """
    if problem.controller.plant_order > 2:
        law = second_order_law(problem.rig)
        other = changed(problem, controller=law)
        point = closest(other, lambda: None)
        if point is not None and judge(other, other.poles(point)).feasible:
            return Relief({"controller": law}, "--controller tan-gpi-2 would do")
    kinds = sorted(OPTIONS, key=lambda kind: tightest not in OPTIONS[kind])
    for group in [*([kind] for kind in kinds), kinds]:
        names = [name for kind in group for name in OPTIONS[kind]]
        point = _least(problem, dense.least_breach_of(names), lambda: None)
        if point is None:
            continue
        found = _relief(problem, point, names)
        if found.options:
            return found
        if problem.certifies is not None:  # every other limit can be kept
            return Relief({"certifies": None}, "leaving --certify out would do")
    return None


def _relief(problem: TuningProblem, point: Array, names: Sequence[str]) -> Relief:
    score, pairs = dense.least_breach_of(names), _pairs(problem)
    _, slacks, _ = dense.scored(problem, point[None, :], score, pairs, clamped=True, centre=point)
    broken = [name for name in names if name in slacks and slacks[name][0] < 0]
    options: dict[str, Any] = {}
    hints = []
    limits = problem.limits
    for name, key, flag, limit in (
        ("Ms", "max_ms", "--max-ms", limits.max_ms),
        ("noise voltage", "max_noise_voltage", "--max-noise-voltage", limits.max_noise_voltage),
    ):
        if name in broken:
            options[key] = _rounded_up(ROOM * limit * math.exp(-slacks[name][0]))
            hints.append(f"{flag} {options[key]:g}")
    if set(broken) & set(OPTIONS["--allow-saturation"]):
        options["allow_saturation"] = True
        hints.append("--allow-saturation (or a wider limits.voltage)")
    return Relief(options, f"{' with '.join(hints)} would do")


def _rounded_up(value: float) -> float:
    """Return `value` with two digits, not smaller."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / scale - 1e-9) * scale:.3g}")


@dataclass(frozen=True)
class Unstabilisable:
    """No poles in the box stabilise the sampled loop; what would [s], nan where nothing does."""

    problem: TuningProblem
    largest_period: float
    largest_delay: float

    def __str__(self) -> str:
        """Return what was found in words, with what would do."""
        sampling = self.problem.rig.sampling
        remedies = [
            f"the largest {name} that some poles stabilise is about {1e3 * value:.3g} ms"
            for name, value in (("period", self.largest_period), ("delay", self.largest_delay))
            if not math.isnan(value)
        ]
        return (
            f"no poles in the search box stabilise the sampled loop with sampling.period = "
            f"{1e3 * sampling.period:g} ms and sampling.delay = {1e3 * sampling.delay:g} ms "
            f"(limit: spectral radius below 1 over the gaps and ratios): "
            f"{sampling_product(self.problem)}; "
            + ("; ".join(remedies) if remedies else "no shorter period alone would do")
            + " (the other as it is)"
        )


def what_would_stabilise(problem: TuningProblem) -> Unstabilisable:
    """Return the largest period and, at the rig's period, the largest delay that could work."""
    sampling = problem.rig.sampling
    shortest = sampling.delay / MOST_DELAYED_PERIODS
    return Unstabilisable(
        problem,
        _largest(problem, shortest, sampling.period, lambda value: {"period": value}),
        _largest(problem, 0.0, sampling.delay, lambda value: {"delay": value}),
    )


def _largest(
    problem: TuningProblem, low: float, high: float, change: Callable[[float], dict[str, float]]
) -> float:
    """Bisect from `low` to the hopeless `high` for the largest value that still works."""
    found = math.nan
    for _ in range(10):
        middle = (low + high) / 2
        if _stabilisable(problem, change(middle)):
            low = found = middle
        else:
            high = middle
    return found


def _stabilisable(problem: TuningProblem, change: dict[str, float]) -> bool:
    rig = problem.rig
    sampling = rig.sampling.model_copy(update=change)
    moved = rig.model_copy(update={"sampling": sampling})
    loop = loops.build_loop(
        moved, problem.believed, method=problem.method, controller=problem.controller
    )
    zeta, omega_n = (np.geomspace(low, high, 12) for low, high in problem.bounds)
    return any(
        loops.spectral_radius(loop, (z, w, z, w), problem.family).value < 1
        for z in zeta
        for w in omega_n
    )
