"""A controller as plain data, for records and sweeps: its numbers, and how they came about."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from maglev_design.controller.believed import (
    MODEL_NUMBERS,
    Believed,
)
from maglev_design.controller.design import (
    Design,
    PoleSpec,
    gain_names,
)
from maglev_design.errors import InputError
from maglev_design.files import finite
from maglev_design.options import CONTROLLERS, EQUILIBRIA, METHODS, Controller


def design_as_data(design: Design) -> dict[str, Any]:
    """Return a controller as JSON data, every number to the last digit.

    What runs is in ``numbers``, whose digest is the controller's name; the rest says how it came
    about.
    """
    return {
        "poles": design.poles.pairs,
        "equilibrium": design.equilibrium,
        "beta_c": design.believed.beta,
        "numbers": finite(design.numbers),
        "controller_sha256": design.sha256,
    }


def design_from_data(data: Mapping[str, Any], origin: str) -> Design:
    """Return the controller of :func:`design_as_data`; nothing is derived from a reading.

    Raises
    ------
    InputError
        When its numbers contradict each other or its name.
    """
    numbers = data["numbers"]
    if data["equilibrium"] not in EQUILIBRIA or numbers["method"] not in METHODS:
        raise InputError(f"{origin}: design: unknown equilibrium or method")
    first, second = ((float(zeta), float(omega_n)) for zeta, omega_n in data["poles"])
    controller = Controller(**numbers["law"])
    if controller.name not in CONTROLLERS:
        raise InputError(f"{origin}: design: law: unknown name")
    try:
        poles = PoleSpec(first, second)
    except InputError as error:
        raise InputError(f"{origin}: design: {error}") from error
    low, high = numbers["voltage_limits"]
    start, end, begin, finish = map(float, numbers["reference"])
    design = Design(
        poles,
        data["equilibrium"],
        numbers["method"],
        tuple(float(numbers["gains"][name]) for name in gain_names(controller)),
        _believed(numbers, float(data["beta_c"]), controller),
        float(numbers["Y"]),
        {name: _number(value) for name, value in numbers["coefficients"].items()},
        float(numbers["period"]),
        (float(low), math.inf if high is None else float(high)),
        (start, end, begin, finish),
        controller,
    )
    if data["controller_sha256"] != design.sha256:
        raise InputError(f"{origin}: design: its numbers are not those of its controller_sha256")
    return design


def _believed(numbers: Mapping[str, Any], beta: float, controller: Controller) -> Believed:
    """Return what a controller believes; only what its law takes is in its numbers."""
    known = {
        x: float(numbers[x]) for x in ("U", "C_U", "C_Y", *MODEL_NUMBERS[controller.design_model])
    }
    return Believed(**known, beta=beta, series=tuple(float(x) for x in numbers.get("series", ())))


def _number(value: Any) -> float:
    """Return a number of JSON; None is the bound of an unlimited integrator."""
    return math.inf if value is None else float(value)
