"""A standard excitation for a rig on which nothing moves: every design would have error zero."""

from __future__ import annotations

from dataclasses import dataclass

from maglev_design.controller.checks import check_path_voltage
from maglev_design.errors import InputError
from maglev_design.rig import InitialState, Rig

SHARE = 0.02
"""Of Z = Y + y0: how far from the path's gap the ball starts."""


@dataclass(frozen=True)
class Excitation:
    """Where the ball starts although the rig file has it at rest on its path.

    Attributes
    ----------
    initial_gap, offset : float
        [m]
    share_of_Z : float
        |offset|/(Y + y0) [-].
    """

    initial_gap: float
    offset: float
    share_of_Z: float  # noqa: N815 - the paper's letter


def nothing_moves(rig: Rig) -> bool:
    """Return whether the ball starts at rest on a path that stays where it is.

    Noise moves the ball, but what is minimised is the response without it.
    """
    path, start = rig.reference, rig.initial
    return path.start_gap == path.end_gap == start.gap and start.velocity == 0


def excited(rig: Rig) -> tuple[Rig, Excitation | None]:
    """Return `rig` with the standard excitation where nothing moves, else as it is.

    The ball starts farther from the magnet, or nearer where the limits of gap or voltage forbid
    that.

    Raises
    ------
    InputError
        When both directions are forbidden.
    """
    if not nothing_moves(rig):
        return rig, None
    low, high = rig.limits.gap
    refused = InputError("limits.gap: too narrow for the standard excitation")
    for sign in (1, -1):
        offset = sign * SHARE * (rig.operating_point.gap + rig.plant.gap_offset)
        gap = rig.initial.gap + offset
        if not low < gap < high:
            continue
        moved = rig.model_copy(update={"initial": InitialState(gap=gap)})
        try:
            check_path_voltage(moved)
        except InputError as error:
            refused = error
            continue
        return moved, Excitation(gap, offset, SHARE)
    raise InputError(
        f"nothing moves on this rig, and it cannot start {100 * SHARE:g} % of Y + y0 away from "
        f"its path either: {refused}; give [initial] gap or a [reference] that moves"
    )
