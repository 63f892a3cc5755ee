"""Numbers and units as people write them, as text and as LaTeX."""

from __future__ import annotations

import re

from maglev_design.figures import DESCRIBED

GAIN_UNITS = {"k0": "1/s^4", "k1": "1/s^3", "k2": "1/s^2", "k3": "1/s"}
"""Of the gains of the law (20)."""

_RAISED = str.maketrans("-0123456789n", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹ⁿ")
_POWER = re.compile(r"\^(\d+|\([^)]*\))")


def mantissa(value: float, digits: int) -> tuple[str, int | None]:
    """Return a rounded number as digits and a power of ten, None where none is needed."""
    text, _, power = f"{value:.{digits}g}".partition("e")
    return text.replace("-", "−"), int(power) if power else None


def number_text(value: float | None, unit: str = "-", digits: int = 4) -> str:
    """Return a number with its unit as plain text.

    Examples
    --------
    >>> number_text(9.9347e-06, "m s^2")
    '9.935 × 10⁻⁶ m s²'
    >>> number_text(None)
    'none'
    """
    if value is None:
        return "none"
    text, power = mantissa(value, digits)
    if power is not None:
        text += f" × 10{str(power).translate(_RAISED)}"
    return text if unit == "-" else f"{text} {unit_text(unit)}"


def number_latex(value: float | None, unit: str = "-", digits: int = 4) -> str:
    r"""Return a number with its unit as LaTeX that stands in text.

    Examples
    --------
    >>> number_latex(9.9347e-06, "m s^2")
    '$9.935 \\times 10^{-6}\\,\\mathrm{m\\,s^{2}}$'
    """
    if value is None:
        return "none"
    text, power = mantissa(value, digits)
    text = text.replace("−", "-")
    if power is not None:
        text += rf" \times 10^{{{power}}}"
    return f"${text}$" if unit == "-" else rf"${text}\,{unit_latex(unit)}$"


def unit_text(unit: str) -> str:
    """Return a unit such as "m^3/(s^2 V^2)" with raised powers; a dash for none."""
    if unit == "-":
        return "–"
    raised = _POWER.sub(lambda match: match[1].strip("()").translate(_RAISED), unit)
    return raised.replace("ohm", "Ω")


def headed(key: str) -> str:
    """Return what stands over a column or at an axis of a figure.

    Examples
    --------
    >>> headed("itae")
    'ITAE [m s²]'
    """
    return f"{DESCRIBED[key].label} [{unit_text(DESCRIBED[key].unit)}]"


def unit_latex(unit: str) -> str:
    """Return a unit such as "m^3/(s^2 V^2)" in upright letters."""
    powers = _POWER.sub(lambda match: f"^{{{match[1].strip('()')}}}", unit)
    powers = powers.replace("ohm", r"\Omega").replace("%", r"\%")
    return r"\mathrm{" + powers.replace(" ", r"\,") + "}"
