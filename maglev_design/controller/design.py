"""From a rig and desired poles to gains and to the difference equation that runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.controller import matching
from maglev_design.controller.believed import Believed
from maglev_design.controller.plant import on_plant
from maglev_design.errors import InputError, check_numbers, check_word
from maglev_design.files import digest, finite
from maglev_design.options import (
    EQUILIBRIA,
    METHODS,
    TAN_GPI,
    Controller,
    Equilibrium,
    Method,
)
from maglev_design.programs import (
    believed_program,
    beta_program,
    coefficients_program,
    gains_program,
    plant_program,
    reference_program,
    static_series_program,
    tangent_program,
)
from maglev_design.rig import Rig

PATH_ENDS = ("start_gap", "end_gap", "start_time", "end_time")
"""Of the move of the reference [m, m, s, s]."""
PAPER_POLES = (1.0, 70.0)
"""zeta_d and omega_nd of sec. 4: the yardstick of every tuning."""


@dataclass(frozen=True)
class PoleSpec:
    """Two pole pairs s^2 + 2 zeta_i omega_i s + omega_i^2; the paper's (24) has them equal.

    A law of a higher order has the second pair as often as it needs.
    A controller of third order (`lin-pid`, `state-feedback`) has the first pair and a real pole at
    -omega_n of the second.

    Attributes
    ----------
    first, second : tuple of float
        (zeta [-], omega_n [rad/s]), both positive.
    """

    first: tuple[float, float]
    second: tuple[float, float]

    def __post_init__(self) -> None:
        for name, value in zip(("zeta", "omega_n") * 2, self.values, strict=True):
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{name} = {value!r}: must be a finite number greater than 0")

    @classmethod
    def double(cls, zeta: float, omega_n: float) -> PoleSpec:
        """Return the double pole pair of (24)."""
        return cls((zeta, omega_n), (zeta, omega_n))

    @property
    def values(self) -> tuple[float, float, float, float]:
        """(zeta_1, omega_1, zeta_2, omega_2)."""
        (zeta_1, omega_1), (zeta_2, omega_2) = self.first, self.second
        return float(zeta_1), float(omega_1), float(zeta_2), float(omega_2)

    @property
    def pairs(self) -> list[list[float]]:
        """Both pairs, as JSON has them."""
        return [list(self.first), list(self.second)]


@dataclass(frozen=True)
class Design:
    """One controller: its numbers, fixed once made. A ratio beta_c/beta moves the plant.

    Attributes
    ----------
    poles : PoleSpec
    equilibrium : str
        Reading of the equilibrium (``model``, ``appendix-a`` or ``measured``).
    method : str
        Discretisation (``tustin``, ``euler`` or ``zoh``).
    gains : tuple of float
        Of the law, in its order: (k0, k1, k2, k3), eq. (25) for a double pair; (k1, k2, k3) of
        (16) for third order, for a PID with the filter's pole omega_f behind.
    believed : Believed
    Y : float
        Gap of the equilibrium [m].
    coefficients : mapping of str to float
        Of the difference equation: see
        :func:`maglev_design.symbolic.sampling.difference_equation`.
    period : float
        T [s].
    voltage_limits : tuple of float
        Of the clamp [V].
    reference : tuple of float
        start_gap [m], end_gap [m], start_time [s] and end_time [s] of the move.
    controller : Controller
        Which law.
    """

    poles: PoleSpec
    equilibrium: Equilibrium
    method: Method
    gains: tuple[float, ...]
    believed: Believed
    Y: float
    coefficients: Mapping[str, float]
    period: float
    voltage_limits: tuple[float, float]
    reference: tuple[float, float, float, float]
    controller: Controller = TAN_GPI

    @property
    def named_gains(self) -> dict[str, float]:
        """The gains by the names of the law's symbols."""
        return dict(zip(gain_names(self.controller), self.gains, strict=True))

    @property
    def numbers(self) -> dict[str, Any]:
        """What runs, as plain data: the law and every number of it; no label, no reading."""
        believed = self.believed
        return {
            "law": self.controller.as_data(),
            "method": self.method,
            "period": self.period,
            "Y": self.Y,
            "U": believed.U,
            "C_U": believed.C_U,
            "C_Y": believed.C_Y,
            **believed.of_model(self.controller),
            "gains": self.named_gains,
            "coefficients": dict(self.coefficients),
            "voltage_limits": list(self.voltage_limits),
            "reference": list(self.reference),
        }

    @property
    def sha256(self) -> str:
        """The controller's name: the SHA-256 of :attr:`numbers`."""
        return digest(finite(self.numbers))

    def beta_at(self, ratio: float) -> float:
        """Return the plant's beta [m^3/(s^2 V^2)] at a ratio beta_c/beta."""
        check_numbers(positive=True, ratio=ratio)
        return self.believed.beta / ratio


def gain_names(controller: Controller) -> tuple[str, ...]:
    """Return the names of a law's gains, in the order of ``Design.gains``."""
    return gains_program(controller).outputs


def plant_beta(rig: Rig) -> float:
    """Return beta = K C^2/m of the rig [m^3/(s^2 V^2)], eq. (4).

    Examples
    --------
    >>> from maglev_design.rig import load_rig
    >>> round(plant_beta(load_rig("belmonte2021")), 8)
    0.00136884
    """
    plant = rig.plant
    (value,) = beta_program(rig.kind).scalar()(plant.mass, rig.current_gain, plant.force_constant)
    return value


def reference_path(
    rig: Rig, times: NDArray[np.float64], derivatives: int = 2
) -> NDArray[np.float64]:
    """Return y*, y*' and y*'' of the rig's path at `times` [s], shape (3, len(times)); SI.

    With `derivatives` 3 also y*'''.
    """
    path = rig.reference
    rows = reference_program(derivatives).numpy()(
        np.asarray(times, dtype=float),
        path.start_gap,
        path.end_gap,
        path.start_time,
        path.end_time,
    )
    return np.stack([np.broadcast_to(row, np.shape(times)) for row in rows])


def true_equilibrium(
    rig: Rig, beta: float, gap: float, moved: Mapping[str, float] | None = None
) -> Believed:
    """Return U, C_U and C_Y of the plant with `beta` at rest at `gap`.

    `moved` says which further numbers of the plant are not the rig's, by symbol.
    """
    program = plant_program(rig.kind)
    offset = (moved or {}).get("y0", rig.plant.gap_offset)
    gravity = (moved or {}).get("g", rig.plant.gravity)
    values = on_plant(program, rig, gravity, beta, offset, gap, moved=moved)
    voltage, c_u, c_y = program.scalar()(*values)
    return Believed(voltage, c_u, c_y, beta)


def tangent_matrices(
    rig: Rig, beta: float, gap: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return A, B, C and D of the plant with `beta` at rest at `gap`, from voltage to gap.

    States y_delta [m], y_delta' [m/s] and, behind a drive with a state, the current over C [V].
    """
    program, order = tangent_program(rig.kind), rig.kind.order
    fixed = (rig.plant.gravity, beta, rig.plant.gap_offset, gap)
    entries = np.array(program.scalar()(*on_plant(program, rig, *fixed)))
    a, b = entries[: order**2].reshape(order, order), entries[order**2 :, None]
    return a, b, np.eye(1, order), np.zeros((1, 1))


def believed_equilibrium(
    rig: Rig,
    equilibrium: Equilibrium,
    *,
    beta_c: float | None = None,
    voltage: float | None = None,
) -> Believed:
    """Return what a controller of `rig` believes under a reading of the equilibrium.

    Parameters
    ----------
    rig : Rig
    equilibrium : {"model", "appendix-a", "measured"}
    beta_c : float, optional
        The controller's K C^2/m [m^3/(s^2 V^2)]; default: the rig's.
    voltage : float, optional
        U [V] as measured, for ``appendix-a`` and ``measured``; default: the rig's.

    Raises
    ------
    InputError
        Where the reading needs a measured voltage and there is none.
    """
    point, plant = rig.operating_point, rig.plant
    check_word("equilibrium", equilibrium, EQUILIBRIA)
    check_numbers(positive=True, beta_c=beta_c, voltage=voltage)
    held = point.voltage if voltage is None else voltage
    if equilibrium != "model" and held is None:
        model = believed_equilibrium(rig, "model", beta_c=beta_c)
        raise InputError(
            f"operating_point.voltage [V] is missing: the reading {equilibrium!r} needs the "
            f"measured voltage that holds the ball at Y = {point.gap:g} m; measure it and write it "
            f"into the rig (K, C and m promise about {model.U:.4g} V), or take the reading 'model'"
        )
    program = believed_program(equilibrium, rig.kind)
    typed = plant_beta(rig) if beta_c is None else beta_c
    fixed = (plant.gravity, typed, point.gap, plant.gap_offset, held or 0.0)
    held_at, c_u, c_y, beta, *behind = program.scalar()(*on_plant(program, rig, *fixed))
    delta, tau, kappa = behind or (0.0, 0.0, 0.0)
    found = Believed(held_at, c_u, c_y, beta, delta, tau, kappa)
    if matching.statically_straight(rig):
        return found
    terms = static_series_program(rig.kind)
    at = on_plant(terms, rig, plant.gravity, found.beta, plant.gap_offset, point.gap)
    return replace(found, series=terms.scalar()(*at))


def voltage_on_plant(rig: Rig, beta_plant: float) -> float:
    """Return U [V] as the paper has it: measured on the plant at hand, whatever its beta.

    The rig's measured voltage where it has one, else the true one of a plant with `beta_plant`.
    For the paper's own runs only: a saved design has one U.
    """
    point = rig.operating_point
    return point.voltage or true_equilibrium(rig, beta_plant, point.gap).U


def make_design(
    rig: Rig,
    poles: PoleSpec,
    *,
    controller: Controller | None = None,
    equilibrium: Equilibrium = "model",
    method: Method | None = None,
    beta_c: float | None = None,
    voltage: float | None = None,
    gains: Sequence[float] | None = None,
) -> Design:
    """Return the controller of `rig` with the given poles.

    Parameters
    ----------
    rig : Rig
    poles : PoleSpec
    controller : Controller, optional
        Default: TAN-GPI of the order of the rig's plant.
    equilibrium : {"model", "appendix-a", "measured"}
    method : {"tustin", "euler", "zoh"}, optional
        Default: the rig's.
    beta_c, voltage : float, optional
        As :func:`believed_equilibrium`.
    gains : sequence of float, optional
        The law's gains, in its order, where they are given and not placed by `poles`.

    Raises
    ------
    InputError
        As :func:`believed_equilibrium`; for an unknown method.

    Examples
    --------
    >>> from maglev_design.rig import load_rig
    >>> make_design(load_rig("belmonte2021"), PoleSpec.double(1, 70)).gains
    (24010000.0, 1372000.0, 29400.0, 280.0)
    """
    method, controller = method or rig.sampling.method, controller or matching.matching_law(rig)
    check_word("method", method, METHODS)
    matching.check_law(rig, controller)
    believed = believed_equilibrium(rig, equilibrium, beta_c=beta_c, voltage=voltage)
    program = gains_program(controller)
    placed = program.scalar()(*poles.values) if gains is None else map(float, gains)
    named = dict(zip(program.outputs, placed, strict=True))
    check_numbers(positive=False, **named)
    return Design(
        poles,
        equilibrium,
        method,
        tuple(named.values()),
        believed,
        rig.operating_point.gap,
        difference_coefficients(coefficient_inputs(rig, believed) | named, method, controller),
        rig.sampling.period,
        (rig.limits.voltage[0], rig.limits.voltage[1]),
        reference_of(rig),
        controller,
    )


def reference_of(rig: Rig) -> tuple[float, float, float, float]:
    """Return start_gap, end_gap [m], start_time and end_time [s] of the rig's move."""
    path = rig.reference
    return path.start_gap, path.end_gap, path.start_time, path.end_time


def difference_coefficients(
    known: Mapping[str, float], method: Method, controller: Controller
) -> dict[str, float]:
    """Return the coefficients of the difference equation from what they are made of, by name."""
    program = coefficients_program(method, controller)
    values = program.scalar()(*[known[name] for name in program.inputs])
    return dict(zip(program.outputs, values, strict=True))


def coefficient_inputs(rig: Rig, believed: Believed) -> dict[str, float]:
    """Return what a law's coefficients are made of besides its gains, by symbol name."""
    low, high = rig.limits.voltage
    return {
        **believed.as_inputs(),
        "g": rig.plant.gravity,
        "Y": rig.operating_point.gap,
        "y0": rig.plant.gap_offset,
        "T": rig.sampling.period,
        "u_min": low,
        "u_max": high,
    }
