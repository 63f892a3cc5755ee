"""The one style of every figure: units on the axes, readable in grey and in print."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullLocator
from numpy.typing import NDArray

from maglev_design.errors import InputError
from maglev_design.files import write_bytes
from maglev_design.reporting.escape import one_line

Curves = Mapping[str, NDArray[np.float64]]

RED, BLUE, GREEN, GREY, ORANGE = "#c1272d", "#0072b2", "#009e73", "#5f5f5f", "#d98200"
PURPLE, SKY = "#cc79a7", "#56b4e9"
"""Okabe-Ito's colours and a red that keeps its distance from them in grey."""

EDGE, GRID = "#333333", "#d9d9d9"

STYLE: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": EDGE,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelsize": 9,
    "axes.linewidth": 0.7,
    "axes.prop_cycle": cycler(color=[RED, BLUE, GREEN, ORANGE, GREY, PURPLE, SKY, "black"]),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 9,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "savefig.dpi": 200,
    "svg.fonttype": "path",
    "svg.hashsalt": "maglev-design",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
}
WIDTH = 6.3
"""[in] A text column of an A4 page."""


@contextmanager
def house_style() -> Iterator[None]:
    """Apply the style to the figures made inside, and to no others."""
    with mpl.rc_context(STYLE):
        yield


DARK = f"""@media (prefers-color-scheme: dark) {{
[id^="text_"], [id^="patch_"], [id^="line2d_"] {{ fill: #e6e6e3 }}
#patch_1 path {{ fill: #16181b !important }}
[style*="stroke: #000000"] {{ stroke: #e6e6e3 !important }}
[style*="stroke: {EDGE}"] {{ stroke: #a3a6aa !important }}
[style*="stroke: {GRID}"] {{ stroke: #3a3e44 !important }}
}}
"""
"""How an SVG is shown where its reader asks for dark pages: text, ground, lines, edges, grid."""

METADATA: Mapping[str, dict[str, None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
}
"""Formats that can be written, and what would tell when and by what the figure was made."""


def save_figure(figure: Figure, path: Path) -> Path:
    """Write `figure` in the format of its ending, the same bytes for the same figure.

    Raises
    ------
    InputError
        For an ending that is not .png, .svg or .pdf.
    """
    suffix = path.suffix.lower()
    if suffix not in METADATA:
        raise InputError(f"{path}: a plot must end in {', '.join(METADATA)}")
    write_bytes(path, figure_bytes(figure, suffix))
    return path


def figure_bytes(figure: Figure, ending: str) -> bytes:
    """Return `figure` in the format of an ending of :data:`METADATA`."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=ending[1:], metadata=METADATA[ending])
    content = buffer.getvalue()
    if ending == ".svg":
        return content.replace(b"</style>", DARK.encode() + b"</style>", 1)
    return content


def literal(text: str) -> str:
    """Return `text` in one line, without mathematics, and with no sign that the font lacks."""
    font = get_font(findfont(STYLE["font.family"]))
    drawn = (c if font.get_char_index(ord(c)) else "\ufffd" for c in one_line(text))
    return "".join(drawn).replace("$", r"\$")


def plain_ticks(axis: Any) -> None:
    """Label a logarithmic axis, its data drawn, with 1, 2, 5, 10 and not with powers of ten."""
    low, high = axis.get_view_interval()
    round_numbers = (m * 10.0**k for k in range(-3, 7) for m in (1, 2, 5))
    axis.set_major_locator(FixedLocator([v for v in round_numbers if low <= v <= high]))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())
