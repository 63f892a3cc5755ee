"""Which law belongs to which plant."""

from __future__ import annotations

from maglev_design.controller.plant import fastest_unstable_pole
from maglev_design.errors import InputError
from maglev_design.options import (
    PAPER_PLANT,
    TAN_GPI,
    Controller,
    DesignModel,
    LawName,
    StaticVoltage,
)
from maglev_design.rig import Rig

NO_IDEAL_DRIVE = 0.05
"""p tau from which a drive's lag is reckoned with; p is the plant's unstable pole."""


def design_model(rig: Rig) -> DesignModel:
    """Return the tangent plant of the rig that its law is designed with.

    A drive that is fast beside the plant's unstable pole p, p tau < 0.05, is no state of it: a law
    of third order would have to place its poles beyond 1/tau. Every judgement has it all the same.
    """
    product = fastest_unstable_pole(rig) * rig.drive.time_constant
    if rig.kind.order > 2 and product >= NO_IDEAL_DRIVE:
        return "lag"
    return "damped" if rig.kind.damped else "undamped"


def statically_straight(rig: Rig) -> bool:
    """Return whether the voltage that holds the ball is a straight line in the gap.

    (y + y0)^(q/p) is where q = p: the tangent feedforward is statically exact there.
    """
    plant = rig.plant
    if plant.force_law == "power":
        return plant.gap_exponent == plant.current_exponent
    return plant.force_law == "inverse-square"


def _static(rig: Rig) -> StaticVoltage:
    return "line" if statically_straight(rig) else "series"


def matching_law(rig: Rig) -> Controller:
    """Return TAN-GPI of the order of the rig's plant, but for a drive that is fast.

    Examples
    --------
    >>> from maglev_design.rig import load_rig
    >>> matching_law(load_rig("belmonte2021")).design_model
    'undamped'
    """
    return Controller(design_model=design_model(rig), static_voltage=_static(rig))


def second_order_law(rig: Rig) -> Controller:
    """Return TAN-GPI designed as if the current followed at once."""
    model: DesignModel = "damped" if rig.kind.damped else "undamped"
    return Controller(design_model=model, static_voltage=_static(rig))


def law_named(name: LawName, rig: Rig) -> Controller:
    """Return the law of a name on a rig, with its default options.

    Raises
    ------
    InputError
        For a law that the rig's plant has no use for.
    """
    if name == "tan-gpi":
        return matching_law(rig)
    if name == "tan-gpi-2":
        if design_model(rig) != "lag":
            raise InputError(
                "controller tan-gpi-2: the second-order law where tan-gpi is of third order; on "
                "this rig tan-gpi is of second order"
            )
        return second_order_law(rig)
    law = Controller(name)
    check_law(rig, law)
    return law


def check_law(rig: Rig, law: Controller) -> None:
    """Raise `InputError` for a law that does not fit the rig's plant."""
    if law.name == "fee-gpi" and not (
        rig.plant.force_law == "inverse-square" and not rig.kind.offset
    ):
        raise InputError(
            "controller fee-gpi: its exact linearisation is that of the inverse-square force "
            f"without an input offset, and this rig has {plant_words(rig)}"
        )


def plant_words(rig: Rig) -> str:
    """Return what the rig's plant has that the paper's has not; empty for the paper's kind."""
    plant, drive, kind = rig.plant, rig.drive, rig.kind
    words = []
    if kind.force == "power":
        words.append(f"the force K i^{plant.current_exponent}/(y + y0)^{plant.gap_exponent:g}")
    if kind.force == "exponential":
        words.append("the force K i^2 exp(-y/a)")
    if kind.order > 2:
        what = "a coil under voltage, L/R =" if drive.kind == "voltage" else "a drive with a lag of"
        words.append(f"{what} {1e3 * drive.time_constant:.3g} ms")
    if kind.damped:
        words.append("a damped ball")
    if kind.offset:
        words.append("an input offset")
    return ", ".join(words)


def only_papers_plant(rig: Rig, what: str, law: Controller = TAN_GPI) -> None:
    """Raise `InputError` where `what` is known for the paper's kind of plant alone."""
    if rig.kind != PAPER_PLANT or law.of_other_plant:
        raise InputError(
            f"{what} is available for an inverse-square force under ideal current drive, without "
            f"damping and offset; this rig has {plant_words(rig)}"
        )


def is_certified_law(rig: Rig, law: Controller) -> bool:
    """Return whether Lyapunov certificates are made of a law on the rig's kind of plant."""
    return law == TAN_GPI and rig.kind == PAPER_PLANT
