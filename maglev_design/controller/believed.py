"""What a controller takes the plant to be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from maglev_design.options import Controller, DesignModel

MODEL_NUMBERS: Mapping[DesignModel, tuple[str, ...]] = {
    "undamped": (),
    "damped": ("delta",),
    "lag": ("delta", "tau", "kappa"),
}
"""What a design model has besides C_U and C_Y."""


@dataclass(frozen=True)
class Believed:
    """What the controller takes the equilibrium to be.

    U [V], C_U [m/(s^2 V)], C_Y [1/s^2] and beta [m^3/(s^2 V^2) for the inverse-square law], the
    force constant that these numbers imply: the beta_c of the ratio beta_c/beta. For a plant other
    than the paper's also the damping delta [1/s], the time constant tau [s] of the drive and
    kappa [1/s] of its back-EMF, and the power series of the static voltage around Y [V/m^n].
    """

    U: float
    C_U: float
    C_Y: float
    beta: float
    delta: float = 0.0
    tau: float = 0.0
    kappa: float = 0.0
    series: tuple[float, ...] = ()

    def as_inputs(self) -> dict[str, float]:
        """Return the numbers by the names of the symbols that stand for them."""
        return {
            "C_U_hat": self.C_U,
            "C_Y_hat": self.C_Y,
            "beta_c": self.beta,
            "delta_hat": self.delta,
            "tau_hat": self.tau,
            "kappa_hat": self.kappa,
            **{f"S{n}": value for n, value in enumerate(self.series, 1)},
        }

    def of_model(self, controller: Controller) -> dict[str, Any]:
        """Return what `controller` takes from here besides U, C_U and C_Y, as plain data."""
        numbers: dict[str, Any] = {
            name: getattr(self, name) for name in MODEL_NUMBERS[controller.design_model]
        }
        if controller.static_voltage == "series":
            numbers["series"] = list(self.series)
        return numbers
