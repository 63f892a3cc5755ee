"""Sensitivities of a closed loop to the poles of its controller, as they are carried along."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller.design import (
    Design,
    coefficient_inputs,
    gain_names,
)
from maglev_design.options import Controller, Method
from maglev_design.programs import coefficients_program, gains_program, start_program
from maglev_design.simulation import grid as grids
from maglev_design.simulation.scenario import Scenario, first_sample

if TYPE_CHECKING:
    import casadi as ca

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives by chosen directions of the poles, one column each.

    Attributes
    ----------
    parameters : array, shape (n_parameters, directions)
        Of the loop's parameter vector; only :func:`maglev_design.simulation.grid.pole_names` move.
    gains : array, shape (n_gains, directions)
        Of the law's gains.
    """

    parameters: Array
    gains: Array


@cache
def _start_jacobian(controller: Controller) -> ca.Function:
    """Return the derivative of the law's first states with respect to its gains."""
    import casadi as ca  # noqa: PLC0415 - only for sensitivities

    program = start_program(controller)
    inputs = {name: ca.SX.sym(name) for name in program.inputs}
    gains = ca.vertcat(*[inputs[name] for name in gain_names(controller)])
    states = ca.vertcat(*program.casadi(*inputs.values()))
    slopes = ca.jacobian(states, gains)
    return ca.Function("start", list(inputs.values()), [slopes], list(inputs), ["slopes"])


def start_sensitivities(
    loop: grids.LoopGraph, design: Design, scenario: Scenario, first_noise: float, gains: Array
) -> Array:
    """Return the derivative of the loop's first state, shape (n_states, directions)."""
    known = first_sample(loop, design, scenario, first_noise)
    jacobian = _start_jacobian(design.controller)
    rows = np.zeros((len(loop.state_names), gains.shape[1]))
    own = [loop.state_names.index(name) for name in start_program(design.controller).outputs]
    rows[own] = jacobian(*[known[name] for name in jacobian.name_in()]).full() @ gains
    return rows


@cache
def _pole_jacobian(
    method: Method | None, controller: Controller, names: tuple[str, ...]
) -> ca.Function:
    """Return the derivatives of the parameters `names` and of the gains by the four pole values."""
    import casadi as ca  # noqa: PLC0415 - only for sensitivities

    poles = ca.SX.sym("poles", 4)
    program = gains_program(controller)
    gains = program.casadi(*ca.vertsplit(poles))
    values = dict(zip(program.outputs, gains, strict=True))
    fixed: dict[str, Any] = {}
    if method is not None:
        program = coefficients_program(method, controller)
        fixed = {name: ca.SX.sym(name) for name in program.inputs if name not in values}
        known = fixed | values
        numbers = program.casadi(*[known[name] for name in program.inputs])
        values |= dict(zip(program.outputs, numbers, strict=True))
    moving = ca.vertcat(*[values.get(name, ca.SX(0)) for name in names])
    return ca.Function(
        "pole_jacobian",
        [poles, *fixed.values()],
        [ca.jacobian(moving, poles), ca.jacobian(ca.vertcat(*gains), poles)],
        ["poles", *fixed],
        ["slopes", "gains"],
    )


def pole_sensitivities(loop: grids.LoopGraph, design: Design, directions: Array) -> Sensitivities:
    """Return the derivatives of parameters and gains by the poles, times `directions`.

    Parameters
    ----------
    directions : array, shape (4, d)
        Columns in (zeta_1, omega_1, zeta_2, omega_2); [[1, 0], [0, 1], [1, 0], [0, 1]] for a
        double pair.
    """
    function = _pole_jacobian(loop.method, loop.controller, loop.parameter_names)
    known = coefficient_inputs(loop.rig, design.believed)
    fixed = [known[name] for name in function.name_in()[1:]]
    slopes, gains = function(design.poles.values, *fixed)
    # An unlimited voltage makes the integrator's bound infinite, and its slope, too.
    rows = np.where(np.isfinite(slopes.full()), slopes.full(), 0.0)
    return Sensitivities(rows @ directions, gains.full() @ directions)
