"""The programs that everything computes with: derived once, then read back from the cache folder.

A program depends on the symbolic statement, on how it is lowered and on SymPy. The hash of all of
these is part of its name in the cache, so that a changed equation is never answered with an old
program; and a process that finds its programs there does not import SymPy.
"""

from __future__ import annotations

from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from maglev_design import lowering, options
from maglev_design.cache import kept, sources
from maglev_design.files import joint_hash
from maglev_design.lowering import Program
from maglev_design.options import (
    PAPER_PLANT,
    TAN_GPI,
    Controller,
    Equilibrium,
    Method,
    PlantKind,
)

if TYPE_CHECKING:
    from maglev_design.symbolic.laws import ControlLaw

HERE = Path(__file__).parent
SOURCES = (HERE.parent / "symbolic", Path(lowering.__file__).parent, HERE, Path(options.__file__))
"""Folders and files whose text decides what a program is."""


@cache
def fingerprint() -> str:
    """Return the hash of all that decides what the programs are."""
    return joint_hash(metadata.version("sympy"), *sources(*SOURCES))


@cache
def program(name: str, *arguments: str | int | Controller | PlantKind) -> Program:
    """Return the program of that name: a function of :mod:`maglev_design.programs.derived`."""

    def derive() -> str:
        from maglev_design.programs import derived  # noqa: PLC0415 - imports SymPy

        made: Program = getattr(derived, name)(*arguments)
        return made.to_json()

    key = f"{name}-{joint_hash(fingerprint(), name, repr(arguments))[:32]}"
    return kept("programs", key, derive, Program.from_json)


def law(controller: Controller = TAN_GPI) -> ControlLaw:
    """Return the law of a controller, derived once a process."""
    from maglev_design.programs import derived  # noqa: PLC0415 - imports SymPy

    return derived.law(controller)


def gains_program(controller: Controller = TAN_GPI) -> Program:
    """Return the program (zeta_1, omega_1, zeta_2, omega_2) -> the law's gains."""
    return program("gains", controller)


def coefficients_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the program (C_U^, C_Y^, [beta_c, g, Y, y0,] T, u_min, u_max, gains) -> coefficients.

    What stands in brackets only where the law uses it.
    """
    return program("coefficients", method, controller)


def slope_program(controller: Controller = TAN_GPI) -> Program:
    """Return the program (u, y_ref, beta_c, y0) -> (slope of the command in w, loop gain^).

    The second is the gain C_U times slope that the controller reckons with, in C_U^.
    """
    return program("slope", controller)


def believed_program(equilibrium: Equilibrium, kind: PlantKind = PAPER_PLANT) -> Program:
    """Return the program (g, beta_c, Y, y0, U, ...) -> (U_hat, C_U_hat, C_Y_hat, beta_hat, ...).

    A plant with damping or a drive also delta_hat, tau_hat and kappa_hat. What the dots of the
    inputs stand for, here and below, is :attr:`maglev_design.symbolic.plant.Plant.extras`.
    """
    return program("believed", equilibrium, kind)


def plant_program(kind: PlantKind = PAPER_PLANT) -> Program:
    """Return the program (g, beta, y0, y, ...) -> (U, C_U, C_Y) of the plant at rest at gap y."""
    return program("plant", kind)


def tangent_program(kind: PlantKind = PAPER_PLANT) -> Program:
    """Return the program (g, beta, y0, y, ...) -> A and B at rest at gap y, row by row.

    The states are y, y' and, behind a drive with a state, the coil current over C.
    """
    return program("tangent", kind)


def beta_program(kind: PlantKind = PAPER_PLANT) -> Program:
    """Return the program (m, C, K) -> beta = K C^p/m."""
    return program("beta", kind)


def path_voltage_program(kind: PlantKind = PAPER_PLANT) -> Program:
    """Return the program (g, beta, y0, y, [y',] y'', ...) -> the voltage that the path needs."""
    return program("path_voltage", kind)


def static_series_program(kind: PlantKind) -> Program:
    """Return the program (g, beta, y0, Y, ...) -> coefficients of the static voltage at Y."""
    return program("static_series", kind)


def reference_program(derivatives: int = 2) -> Program:
    """Return the program (t, start_gap, end_gap, start_time, end_time) -> (y*, y*', y*'', ...)."""
    return program("reference", derivatives)


def peak_program() -> Program:
    """Return the program (start_gap, end_gap, start_time, end_time) -> largest |y*''|."""
    return program("peak")


def acceleration_program(kind: PlantKind = PAPER_PLANT) -> Program:
    """Return the program (g, beta, y0, y, u, ...) -> acceleration of the plant (4) [m/s^2]."""
    return program("acceleration", kind)


def drive_program(kind: PlantKind) -> Program:
    """Return the program (u_coil, u, ...) -> rate of u_coil, the coil current over C [V/s]."""
    return program("drive", kind)


def inductance_program(kind: PlantKind) -> Program:
    """Return the program (y, beta, y0, ...) -> inductance of the coil at a gap [H]."""
    return program("inductance", kind)


def conditions_program(order: int) -> Program:
    """Return the program (a_{n-1}, ..., a_0) -> the first column of its Routh array."""
    return program("conditions", order)


def sampled_core_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the program (coefficients of the step) -> A, B, C, D, R of the core, row by row.

    R is what the law reads of gap and velocity, one row an input.
    """
    return program("sampled_core", method, controller)


def continuous_core_program(controller: Controller = TAN_GPI) -> Program:
    """Return the program (believed coefficients, gains) -> A, B, C, D, R of the continuous core."""
    return program("continuous_core", controller)


def metrics_program(crossing: bool = True) -> Program:
    """Return the program of one step's increments of ISE, IAE and ITAE.

    Without `crossing` for steps at whose ends the error has one sign.
    """
    return program("metrics", crossing)


def step_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the sampled law's step: states, signals, Y, U, limits, coefficients -> next states.

    The signals are y, y*, y*'' (and y', y*' where the law reads them). Outputs: the next states,
    the commanded and the applied voltage. This program, printed, is the exported controller.
    """
    return program("step", method, controller)


def feedforward_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the program y*, y*'', Y, U, limits, coefficients -> clamped voltage at w = 0."""
    return program("feedforward", method, controller)


def start_program(controller: Controller = TAN_GPI) -> Program:
    """Return the program signals, Y, gains -> the law's states before the first sample."""
    return program("start", controller)


def bumpless_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the program signals, u, Y, U, limits, coefficients -> states that command u."""
    return program("bumpless", method, controller)


def continuous_program(controller: Controller = TAN_GPI) -> Program:
    """Return the continuous law: states, signals, Y, U, limits, believed, gains -> rates."""
    return program("continuous", controller)


def gains_of_pid_program() -> Program:
    """Return the program (K_p, K_i, K_d, C_U^, C_Y^) -> k1, k2 and k3 of a PID."""
    return program("gains_of_pid")


def routh_program(controller: Controller = TAN_GPI) -> Program:
    """Return the program (rho, C_Y, C_Y^, gains) -> polynomial of the loop, its Routh array."""
    return program("routh", controller)


def hurwitz_program(controller: Controller = TAN_GPI) -> Program:
    """Return the program (rho, C_Y, C_Y^, gains) -> Routh-Hurwitz conditions, 1 as designed."""
    return program("hurwitz", controller)


def sampled_loop_program(method: Method, controller: Controller = TAN_GPI) -> Program:
    """Return the program of the sampled open loop: its numerator, denominator, and the effort.

    Inputs: loop gain, C_U^, C_Y^, C_Y, T, the first part of the period and the gains. The effort is
    what sensor noise does to the voltage.
    """
    return program("sampled_loop", method, controller)
