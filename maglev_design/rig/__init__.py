"""The rig: what a person measures and writes down, validated and in SI units.

No formula of the physics stands here; what follows from these numbers (beta, U, C_U, C_Y) is
computed by :mod:`maglev_design.controller.design` from the symbolic layer.
"""

from maglev_design.rig.model import MOST_SAMPLES, Rig, fields
from maglev_design.rig.reading import (
    LARGEST_RIG_FILE,
    is_papers,
    load_rig,
    make_rig,
    parse_rig,
    preset_names,
    preset_text,
)
from maglev_design.rig.sections import (
    LONGEST_GAP,
    LONGEST_HORIZON,
    LONGEST_PERIOD,
    MOST_DELAYED_PERIODS,
    Drive,
    Emulator,
    InitialState,
    Limits,
    Noise,
    OperatingPoint,
    PlantParameters,
    ReferencePath,
    Sampling,
    Section,
)
from maglev_design.rig.uncertainty import (
    DEFAULT_VOLTAGE_ERROR,
    DRAWN,
    LARGEST_DRAW,
    Spread,
    Uncertainty,
)

__all__ = [
    "DEFAULT_VOLTAGE_ERROR",
    "DRAWN",
    "LARGEST_DRAW",
    "LARGEST_RIG_FILE",
    "LONGEST_GAP",
    "LONGEST_HORIZON",
    "LONGEST_PERIOD",
    "MOST_DELAYED_PERIODS",
    "MOST_SAMPLES",
    "Drive",
    "Emulator",
    "InitialState",
    "Limits",
    "Noise",
    "OperatingPoint",
    "PlantParameters",
    "ReferencePath",
    "Rig",
    "Sampling",
    "Section",
    "Spread",
    "Uncertainty",
    "fields",
    "is_papers",
    "load_rig",
    "make_rig",
    "parse_rig",
    "preset_names",
    "preset_text",
]
