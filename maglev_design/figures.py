"""The figures that the program speaks of, each described once: key, label, unit, worse side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from maglev_design.options import Objective

OBJECTIVES: tuple[Objective, ...] = get_args(Objective)
"""What can be minimised, as people are offered it."""
INDICES = ("ise", "iae", "itae")
"""Integrals of e^2, |e| and t |e|, in the order of the paper."""
PARTS = ("start", "move", "hold")
"""Of a run: before, during and after the move."""
EXTREMES = ("peak_voltage", "min_voltage", "peak_applied", "min_gap", "max_gap")
"""Of the commanded and the applied voltage and of the gap, in the order of the compiled loop."""
OF_A_RUN = (*EXTREMES, "final_error", "total_variation")
"""What a sweep keeps of a run beside the indices."""
OF_A_FAMILY = (
    *("peak_voltage", "min_voltage", "ms", "ms_one_more_sample"),
    *("spectral_radius", "noise_voltage", "ratio"),
)
"""What a worst case says beside the indices."""
MARGINS = ("gain_up", "gain_down", "phase_deg", "delay_s")
"""Of a linear loop, beside the peaks of |S| and |T| and the disk margin."""


@dataclass(frozen=True)
class ShownFigure:
    """How one figure is told.

    Attributes
    ----------
    key : str
        In documents.
    label : str
    unit : str
        SI, powers written with ^; "-" for none.
    worse : {"high", "low"}
    shown, scale : str and float
        Unit of the terminal's tables, and what an SI number is multiplied by for it.
    """

    key: str
    label: str
    unit: str = "-"
    worse: Literal["high", "low"] = "high"
    shown: str = ""
    scale: float = 1.0


DESCRIBED = {
    figure.key: figure
    for figure in (
        ShownFigure("itae", "ITAE", "m s^2"),
        ShownFigure("iae", "IAE", "m s"),
        ShownFigure("ise", "ISE", "m^2 s"),
        ShownFigure("peak_voltage", "largest commanded voltage", "V"),
        ShownFigure("min_voltage", "smallest commanded voltage", "V", "low"),
        ShownFigure("peak_applied", "largest applied voltage", "V"),
        ShownFigure("min_gap", "smallest gap", "m", "low", "mm", 1e3),
        ShownFigure("max_gap", "largest gap", "m", "high", "mm", 1e3),
        ShownFigure("final_error", "error at the end", "m", "high", "µm", 1e6),
        ShownFigure("total_variation", "total variation of the voltage", "V"),
        ShownFigure("ms", "Ms"),
        ShownFigure("mt", "Mt"),
        ShownFigure("ms_one_more_sample", "Ms, one more sample"),
        ShownFigure("spectral_radius", "spectral radius"),
        ShownFigure("noise_voltage", "voltage from sensor noise", "V"),
        ShownFigure("ratio", "at beta_c/beta"),
        ShownFigure("gain_up", "gain may rise by", "-", "low", "x"),
        ShownFigure("gain_down", "gain may fall to", "-", "high", "x"),
        ShownFigure("phase_deg", "phase", "deg", "low"),
        ShownFigure("delay_s", "further delay", "s", "low", "ms", 1e3),
        ShownFigure("disk", "disk", "-", "low"),
    )
}
"""By key, in the order in which tables show them."""
