"""The plant of a rig as numbers for the lowered programs, and the gaps of its path."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.lowering import Program
from maglev_design.programs import plant_program
from maglev_design.rig import Rig


def plant_numbers(rig: Rig) -> dict[str, float]:
    """Return the numbers of the rig's plant besides g, beta and y0, by symbol; SI units.

    Those of :attr:`maglev_design.symbolic.plant.Plant.extras`: a lag that is no coil's has R = 1
    and L its time constant.
    """
    plant, drive = rig.plant, rig.drive
    voltage = drive.kind == "voltage"
    known = {
        "n_gap": plant.gap_exponent,
        "decay": plant.decay_length,
        "delta": plant.damping / plant.mass,
        "L": drive.inductance if voltage else drive.lag,
        "R": drive.resistance if voltage else 1.0,
        "m": plant.mass,
        "Y": rig.operating_point.gap,
        "u0": drive.input_offset,
    }
    return {name: value for name, value in known.items() if value is not None}


def on_plant(
    program: Program, rig: Rig, *fixed: Any, moved: Mapping[str, Any] | None = None
) -> list[Any]:
    """Return the arguments of a plant's program: `fixed` first, then the plant's own numbers.

    `moved` says which of these are not the rig's.
    """
    own: dict[str, Any] = {**plant_numbers(rig), **(moved or {})}
    return [*fixed, *(own[name] for name in program.inputs[len(fixed) :])]


def path_gaps(rig: Rig, points: int) -> NDArray[np.float64]:
    """Return `points` gaps [m] over the hull of the path, the initial gap and Y, ends included."""
    path = rig.reference
    ends = (path.start_gap, path.end_gap, rig.initial.gap, rig.operating_point.gap)
    return (
        np.linspace(min(ends), max(ends), points) if min(ends) < max(ends) else np.array(ends[:1])
    )


def fastest_unstable_pole(rig: Rig) -> float:
    """Return p = sqrt(C_Y) [1/s] of the plant at the smallest gap of its path.

    C_Y, for the paper's force 2 g/(y + y0), does not depend on beta.
    """
    program, gap = plant_program(rig.kind), float(path_gaps(rig, 2)[0])
    fixed = (rig.plant.gravity, 1.0, rig.plant.gap_offset, gap)
    _, _, c_y = program.scalar()(*on_plant(program, rig, *fixed))
    return math.sqrt(c_y)
