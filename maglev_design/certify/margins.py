"""Margins of the sampled loop by python-control, at the worst point of the family."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from maglev_design.loop import Family, Loop


@dataclass(frozen=True)
class Margin:
    """One margin and the point of the family where it is smallest.

    Attributes
    ----------
    value : float
        nan where the loop has none or is unstable.
    gap : float
        [m]
    ratio : float
        beta_c/beta.
    """

    value: float
    gap: float
    ratio: float


@dataclass(frozen=True)
class Margins:
    """Margins of a sampled loop, each at its worst gap and ratio.

    Attributes
    ----------
    ms : Margin
        max |S|, one over the distance of the Nyquist curve from -1.
    gain_up, gain_down : Margin
        Factors by which the loop gain may rise and fall; the plant is unstable, so both exist.
    phase_deg : Margin
        Phase margin [deg].
    delay_s : Margin
        Further delay until instability [s].
    """

    ms: Margin
    gain_up: Margin
    gain_down: Margin
    phase_deg: Margin
    delay_s: Margin

    def as_dict(self) -> dict[str, Any]:
        """Return the margins for JSON."""
        return asdict(self)


def sampled_margins(loop: Loop, poles: Sequence[float], over: Family) -> Margins:
    """Return the classical margins of `loop`, each at its worst over a grid of `over`.

    Parameters
    ----------
    poles : sequence of float
        (zeta_1, omega_1, zeta_2, omega_2).
    """
    rows = []
    for gap, ratio in over.grid(3, 2).T:
        numerator, denominator = loop.open_loop(poles, gap, ratio)
        rows.append(
            (float(gap), float(ratio), *_at(numerator.full(), denominator.full(), loop.period))
        )
    table = np.array(rows)

    def worst(column: int, largest: bool) -> Margin:
        values = table[:, column]
        pick = int(np.argmax(values) if largest else np.argmin(values))
        return Margin(float(values[pick]), float(table[pick, 0]), float(table[pick, 1]))

    return Margins(
        ms=worst(2, True),
        gain_up=worst(3, False),
        gain_down=worst(4, True),
        phase_deg=worst(5, False),
        delay_s=worst(6, False),
    )


def _at(numerator: Any, denominator: Any, period: float) -> tuple[float, ...]:
    """Return (Ms, gain up, gain down, phase [deg], delay [s]) of one loop."""
    import control  # noqa: PLC0415 - heavy, and needed only here

    system = control.tf(numerator.ravel(), denominator.ravel(), period)
    if np.abs(system.feedback(1).poles()).max() >= 1:
        return (math.nan,) * 5
    omega = np.geomspace(1e-3, 1.0, 1000) * math.pi / period
    response = control.frd(system, omega, smooth=True)
    gains, phases, distances, _, crossings, _ = control.stability_margins(response, returnall=True)
    up, down = gains[gains > 1], gains[gains < 1]
    # a distance without a local minimum is smallest at an end of the frequencies
    nearest = (
        float(np.abs(1 + response.eval(omega).ravel()).min()) if not distances.size else math.inf
    )
    delays = np.deg2rad(np.abs(phases)) / crossings
    return (
        1 / min(float(distances.min(initial=math.inf)), nearest),
        float(up.min()) if up.size else math.inf,
        float(down.max()) if down.size else 0.0,
        float(np.abs(phases).min()) if phases.size else math.inf,
        float(delays.min()) if delays.size else math.inf,
    )
