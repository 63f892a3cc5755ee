"""The rig as an emulation of the real one: a plant that no controller was designed for."""

from __future__ import annotations

from maglev_design.parameters import Rig, make_rig


def emulated(rig: Rig, period: float | None = None) -> Rig:
    """Return `rig` with the period, delay and sensor noise of its ``[emulator]`` table.

    With `period` [s] it is sampled at that one, as a design is that runs at its own. The coil and
    the steps of sensor and actuator act in a loop that is built with ``emulate=True``.
    """
    effects = rig.emulator
    data = rig.model_dump(exclude_none=True)
    data["sampling"]["period"] = period or effects.period or rig.sampling.period
    if effects.delay is not None:
        data["sampling"]["delay"] = effects.delay
    if effects.position_noise is not None:
        data["noise"]["position"] = effects.position_noise
    return make_rig(data, "emulator")
