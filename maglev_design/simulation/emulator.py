"""The rig as an emulation of the real one: a plant that no controller was designed for."""

from __future__ import annotations

from maglev_design.errors import InputError
from maglev_design.rig import Rig, make_rig


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


def emulator_effects(rig: Rig) -> tuple[str, ...]:
    """Return what ``[emulator]`` adds at any period, in words; empty where it adds nothing."""
    own = rig.emulator
    known = (
        (own.time_constant, 1e3, "coil with L/R = {:.3g} ms"),
        (own.delay, 1e3, "delay {:.3g} ms"),
        (own.sensor_step, 1e6, "sensor step {:.3g} um"),
        (own.actuator_step, 1e3, "actuator step {:.3g} mV"),
        (own.position_noise, 1e6, "sensor noise {:.3g} um"),
    )
    return tuple(words.format(scale * value) for value, scale, words in known if value)


def at_own_period(rig: Rig) -> Rig:
    """Return :func:`emulated` at the period of ``[sampling]``, at which a design of it runs."""
    own = rig.emulator.model_copy(update={"period": None})
    return emulated(rig.model_copy(update={"emulator": own}))


def designed_for(rig: Rig) -> Rig:
    """Return :func:`emulated`, on which a controller is then designed.

    Raises
    ------
    InputError
        Where there is nothing to emulate.
    """
    if not emulator_effects(rig) and rig.emulator.period is None:
        raise InputError(
            "--scenarios emulated: the rig's [emulator] has no effect; add what the real rig has, "
            "at least one of these lines: inductance = L [H] and resistance = R [ohm], "
            "sensor_step = ... [m], actuator_step = ... [V], delay = ... [s], "
            "position_noise = ... [m], period = ... [s]"
        )
    return emulated(rig)
