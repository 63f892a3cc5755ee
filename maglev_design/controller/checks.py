"""What a rig must be able to do before anything is designed for it, and what contradicts itself."""

from __future__ import annotations

import math

import numpy as np

from maglev_design.controller.design import (
    believed_equilibrium,
    plant_beta,
    reference_path,
)
from maglev_design.controller.plant import (
    on_plant,
    path_gaps,
)
from maglev_design.errors import InputError
from maglev_design.programs import inductance_program, path_voltage_program
from maglev_design.rig import Rig


def voltage_warning(rig: Rig) -> str | None:
    """Return a warning where a measured voltage and K, C, m disagree; None where they do not.

    The voltage that holds the ball at Y implies beta, for the inverse-square law g (Y + y0)^2/U^2,
    which should lie inside the stated uncertainty of K C^2/m.
    """
    if rig.operating_point.voltage is None:
        return None
    implied, typed = believed_equilibrium(rig, "measured").beta, plant_beta(rig)
    if abs(implied / typed - 1) <= rig.uncertainty.beta:
        return None
    return (
        f"operating_point.voltage = {rig.operating_point.voltage:g} V implies beta = "
        f"{implied:.4g} m^3/(s^2 V^2), {implied / typed:.3g} times K C^2/m = {typed:.4g}: outside "
        f"uncertainty.beta = {rig.uncertainty.beta:g}; one of mass, force_constant, current_gain, "
        "gap_offset and voltage is wrong"
    )


def check_path_voltage(rig: Rig) -> None:
    """Raise `InputError` when following the path needs a voltage outside the rig's range.

    The need is that of the nonlinear plant, u = (y + y0) sqrt((g - y'')/beta) for the paper's kind,
    along the path and at rest at the initial gap; for a coil its inductance must be positive there
    and over ``limits.gap``.
    """
    _check_inductance(rig)
    path = rig.reference
    times = np.linspace(0.0, path.horizon, 2001)
    program = path_voltage_program(rig.kind)
    gap, velocity, acceleration, *jerk = reference_path(rig, times, 3 if rig.kind.order > 2 else 2)
    if float(acceleration.max()) >= rig.plant.gravity:
        raise InputError(
            f"reference: y*'' reaches {acceleration.max():.3g} m/s^2; a magnet that only pulls "
            f"cannot push the ball down faster than gravity, {rig.plant.gravity} m/s^2; give the "
            "move more time"
        )
    known = {"y": np.append(gap, rig.initial.gap), "v": np.append(velocity, 0.0)}
    known["acc"] = np.append(acceleration, 0.0)
    if jerk:
        known["jerk_ref"] = np.append(jerk[0], 0.0)
    gap = known["y"]
    fixed = (rig.plant.gravity, plant_beta(rig), rig.plant.gap_offset)
    (need,) = program.numpy()(*on_plant(program, rig, *fixed, moved=known))
    low, high = rig.limits.voltage
    for worst, bad, side in (
        (need.max(), need.max() > high, "most"),
        (need.min(), need.min() < low, "least"),
    ):
        if bad:
            at = float(gap[int(np.argmax(need) if side == "most" else np.argmin(need))])
            raise InputError(
                f"limits.voltage = [{low:g}, {high:g}] V: the path needs {worst:.4g} V at the gap "
                f"{at:.4g} m, the {side} on its way; allowed is a range that contains it (or check "
                "mass, force_constant and current_gain: their units are kg, N m^2/A^2, A/V)"
            )


def _check_inductance(rig: Rig) -> None:
    """Raise `InputError` where the coil's L(y) is not positive wherever the ball may be."""
    if rig.kind.actuation != "coil":
        return
    low, high = rig.limits.gap
    own = path_gaps(rig, 2)
    ends = (max(low, 0.0) or float(own[0]), high if math.isfinite(high) else float(own[-1]))
    program = inductance_program(rig.kind)
    for gap in ends:
        fixed = (gap, plant_beta(rig), rig.plant.gap_offset)
        (value,) = program.scalar()(*on_plant(program, rig, *fixed))
        if not value > 0:
            raise InputError(
                f"drive.inductance = {rig.drive.inductance!r} H: with the force constant K it "
                f"makes L(y) = {value:.3g} H at the gap {gap:g} m, inside limits.gap, and an "
                "inductance is positive; give the L of the coil at Y, narrow limits.gap, or take "
                'inductance_law = "constant" for a fit that holds near Y only'
            )
