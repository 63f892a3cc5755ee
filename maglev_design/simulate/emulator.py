"""The rig as an emulation of the real one: a plant that no controller was designed for."""

from __future__ import annotations

from maglev_design.parameters import Rig, make_rig


def emulated(rig: Rig) -> Rig:
    """Return `rig` with the period, delay and sensor noise of its ``[emulator]`` table.

    The controller is sampled at that period with the gains it has; the coil and the steps of
    sensor and actuator act in a loop that is built with ``emulate=True``.
    """
    effects = rig.emulator
    data = rig.model_dump(exclude_none=True)
    if effects.period is not None:
        data["sampling"]["period"] = effects.period
    if effects.delay is not None:
        data["sampling"]["delay"] = effects.delay
    if effects.position_noise is not None:
        data["noise"]["position"] = effects.position_noise
    return make_rig(data, "emulator")
