"""The polynomials of a loop whose plant is of any order: a coil, a lag, a damped ball.

The plant is held exactly over a period (the series of the exponential, then squarings); plant and
law are taken apart by Leverrier's recursion in w = z - 1, in which short periods lose no digits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from maglev_design import programs
from maglev_design.controller.plant import (
    on_plant,
)
from maglev_design.linear_loop.polynomials import resolvent, shifted, sum_of, times
from maglev_design.lowering import Program
from maglev_design.options import Controller, Method
from maglev_design.rig import Rig

TERMS, SQUARINGS = 14, 5
"""Of the exponential: exact to rounding for periods of up to fifteen time constants."""


@dataclass(frozen=True)
class PlacedLaw:
    """A law and the numbers that its coefficients are made of, by symbol.

    `slope` is that of the command in the law's output.
    """

    controller: Controller
    method: Method
    numbers: Mapping[str, Any]
    slope: Any


def any_order(
    rig: Rig, law: PlacedLaw, beta_c: float, where: tuple[Any, Any], part: float
) -> tuple[dict[str, list[Any]], list[Any]]:
    """Return the sampled loop's polynomials and the Routh-Hurwitz conditions of the continuous one.

    Parameters
    ----------
    rig : Rig
    law : PlacedLaw
    beta_c : float
        The controller's beta: each condition is divided by its size on that plant at the gap Y.
    where : tuple
        Gap [m] and the plant's beta.
    part : float
        T_1, what is left of the delay after whole periods [s].

    Returns
    -------
    dict
        ``num``, ``den`` and ``effort`` as :class:`maglev_design.symbolic.stability.SampledLoop` has
        them, highest power first.
    list
        The conditions.
    """
    gap, beta = where
    a, b = _plant(rig, gap, beta)
    period = rig.sampling.period
    parts = _sampled(a, b, law, period, part)
    conditions = _conditions(_continuous(a, b, law))
    designed = _conditions(_continuous(*_plant(rig, rig.operating_point.gap, beta_c), law))
    return parts, [x / ca.fabs(y) for x, y in zip(conditions, designed, strict=True)]


def _plant(rig: Rig, gap: Any, beta: Any) -> tuple[Any, Any]:
    """Return A and B of the plant at rest."""
    program = programs.tangent_program(rig.kind)
    fixed = (rig.plant.gravity, beta, rig.plant.gap_offset, gap)
    found = _matrices(program, [ca.SX(x) for x in on_plant(program, rig, *fixed)])
    return found["A"], found["B"]


def _matrices(program: Program, values: Sequence[Any]) -> dict[str, Any]:
    """Return the matrices whose entries a program gives row by row; A is square."""
    entries: dict[str, list[Any]] = {}
    for name, value in zip(program.outputs, program.casadi(*values), strict=True):
        entries.setdefault(name.rstrip("0123456789"), []).append(ca.SX(value))
    order = round(len(entries["A"]) ** 0.5)
    height = {"A": order, "B": order, "C": 1, "D": 1}
    return {
        name: ca.vertcat(*[ca.horzcat(*row) for row in _rows(of, height.get(name))])
        for name, of in entries.items()
    }


def _rows(entries: list[Any], height: int | None) -> list[list[Any]]:
    """Return entries in `height` rows; without one in rows of two, of gap and velocity."""
    width = len(entries) // height if height else 2
    return [entries[n : n + width] for n in range(0, len(entries), width)]


def _held(a: Any, b: Any, time: float) -> tuple[Any, Any]:
    """Return exp(A t) - I and the integral of exp(A s) B from 0 to t."""
    order = a.shape[0]
    block = ca.vertcat(ca.horzcat(a, b), ca.SX(1, order + 1)) * (time / 2**SQUARINGS)
    unit = ca.SX.eye(order + 1)
    total = ca.SX(block) / TERMS
    for k in range(TERMS - 1, 0, -1):
        total = (block @ (unit + total)) / k if k > 1 else block @ (unit + total)
    for _ in range(SQUARINGS):
        total = total @ total + 2 * total
    return total[:order, :order], total[:order, order]


def _sampled(a: Any, b: Any, law: PlacedLaw, period: float, part: float) -> dict[str, list[Any]]:
    grown, fresh = _held(a, b, period - part)
    step, stale = grown, ca.SX(b.shape[0], 1)
    if part:
        early, entered = _held(a, b, part)
        step = early + grown + grown @ early
        stale = entered + grown @ entered
    denominator, adjugate = resolvent(step)
    # B_0 + B_1/z over 1/z: in w, z is w + 1
    gap, velocity = (
        sum_of(
            times([(x @ fresh)[row] for x in adjugate], [ca.SX(1), ca.SX(1)]),
            [(x @ stale)[row] for x in adjugate],
        )
        for row in (0, 1)
    )
    program = programs.coefficients_program(law.method, law.controller)
    known = dict(zip(program.outputs, program.casadi(*_of(program, law)), strict=True))
    core = programs.sampled_core_program(law.method, law.controller)
    found = _matrices(core, [known[name] for name in core.inputs])
    found["A"] = found["A"] - ca.SX.eye(found["A"].shape[0])
    own, seen = _transfers(found)
    through = sum_of(times(gap, seen[0]), times(velocity, seen[1]))
    later = [ca.SX(1), ca.SX(1)]
    return {
        "num": [-law.slope * x for x in shifted(through)],
        "den": shifted(times(times(denominator, later), own)),
        "effort": [law.slope * x for x in shifted(times(times(denominator, later), seen[0]))],
    }


def _of(program: Program, law: PlacedLaw) -> list[Any]:
    return [ca.SX(law.numbers[name]) for name in program.inputs]


def _transfers(core: Mapping[str, Any]) -> tuple[list[Any], tuple[list[Any], list[Any]]]:
    """Return a core's denominator, and its numerators from the gap and from the velocity."""
    denominator, adjugate = resolvent(core["A"])
    seen = []
    for column in (0, 1):
        read = core["R"][:, column]
        strict = [core["C"] @ x @ core["B"] @ read for x in adjugate]
        direct = core["D"] @ read
        seen.append(sum_of([direct * x for x in denominator], strict))
    return denominator, (seen[0], seen[1])


def _continuous(a: Any, b: Any, law: PlacedLaw) -> list[Any]:
    """Return the polynomial of the continuous loop in s, monic."""
    denominator, adjugate = resolvent(a)
    program = programs.continuous_core_program(law.controller)
    own, seen = _transfers(_matrices(program, _of(program, law)))
    closed = times(denominator, own)
    for row in (0, 1):
        pushed = times([(x @ b)[row] for x in adjugate], seen[row])
        closed = sum_of(closed, [-law.slope * x for x in pushed])
    return closed


def _conditions(polynomial: Sequence[Any]) -> list[Any]:
    program = programs.conditions_program(len(polynomial) - 1)
    return program.casadi(*polynomial[1:])
