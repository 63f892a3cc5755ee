"""The fields of a certificate's document: read strictly, and named where they are wrong."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, TypeVar

from maglev_design.controller.design import gain_names
from maglev_design.errors import InputError, nearest
from maglev_design.options import METHODS, TAN_GPI
from maglev_design.programs import derived

LONGEST_NUMBER = 200
"""Characters of one rational."""
SIZES = (Fraction(1, 10**40), Fraction(10**30))
"""Magnitudes that a number other than 0 may have, in SI units."""
_RATIONAL = re.compile(r"-?[0-9]+(/[0-9]+)?", re.ASCII)
NUMBERS = ("law", "method", "period", "Y", "U", "C_U", "C_Y", "gains", "coefficients")
ENDS = ("voltage_limits", "reference")
POSITIVE = {"period": "s", "Y": "m", "U": "V", "C_U": "m/(s^2 V)", "C_Y": "1/s^2"}

T = TypeVar("T", bound=str)


def table(data: Any, name: str, keys: Sequence[str], where: str = "") -> dict[str, Any]:
    """Return a table that has exactly the given keys."""
    found = data.get(name) if isinstance(data, dict) else None
    if not isinstance(found, dict):
        raise InputError(f"{_at(where, name)}: must be a table")
    only(found, keys, _at(where, name))
    return found


def only(found: Mapping[str, Any], keys: Sequence[str], where: str = "") -> None:
    """Raise `InputError` for a key that is unknown, with the nearest, or that is missing."""
    for key in found:
        if key not in keys:
            raise InputError(f"{_at(where, key)[:80]}: unknown key{nearest(key, keys)}")
    for key in keys:
        if key not in found:
            raise InputError(f"{_at(where, key)}: missing")


def rational(value: Any, where: str) -> Fraction:
    """Return a rational written as "p" or "p/q"."""
    if not isinstance(value, str) or len(value) > LONGEST_NUMBER or not _RATIONAL.fullmatch(value):
        raise InputError(
            f"{where} = {str(value)[:40]!r}: must be a rational in a string, such as '981/100'"
        )
    over, _, under = value.partition("/")
    if under and int(under) == 0:
        raise InputError(f"{where} = {value[:40]!r}: divides by zero")
    number = Fraction(int(over), int(under or 1))
    if number and not SIZES[0] <= abs(number) <= SIZES[1]:
        raise InputError(f"{where} = {value[:40]!r}: larger or smaller than any rig's")
    return number


def rationals(row: Any, size: int, where: str) -> tuple[Fraction, ...]:
    """Return a list of so many rationals."""
    if not isinstance(row, list) or len(row) != size:
        raise InputError(f"{where}: must be a list of {size} rationals")
    return tuple(rational(value, f"{where}[{n}]") for n, value in enumerate(row))


def pair(found: dict[str, Any], name: str, where: str) -> tuple[Fraction, Fraction]:
    """Return two rationals."""
    low, high = rationals(found.get(name), 2, f"{where}.{name}")
    return low, high


def items(found: dict[str, Any], name: str, size: int | None = None, where: str = "") -> list[Any]:
    """Return a list, of so many rows where a size is given."""
    rows = found.get(name)
    if not isinstance(rows, list) or (size is not None and len(rows) != size):
        of = "" if size is None else f" of {size} rows"
        raise InputError(f"{_at(where, name)}: must be a list{of}")
    return rows


def choice(found: dict[str, Any], name: str, allowed: Sequence[T], where: str) -> T:
    """Return one of the allowed words."""
    for word in allowed:
        if found.get(name) == word:
            return word
    raise InputError(
        f"{where}.{name} = {str(found.get(name))[:40]!r}: must be one of {', '.join(allowed)}"
    )


def controller(data: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers of TAN-GPI as ``Design.numbers`` has them."""
    found = table(data, "controller", (*NUMBERS, *ENDS))
    if found["law"] != TAN_GPI.as_data():
        raise InputError("controller.law: must be that of tan-gpi, the only one that is certified")
    method = choice(found, "method", METHODS, "controller")
    for name, unit in POSITIVE.items():
        where = f"controller.{name}"
        positive(_finite(found[name], where, unit), where, unit)
    gains = table(found, "gains", gain_names(TAN_GPI), "controller")
    for name, value in gains.items():
        where = f"controller.gains.{name}"
        positive(_finite(value, where, "1/s^n"), where, "1/s^n")
    equation = derived.equation(method, TAN_GPI).coefficients
    names = [x.name for x in equation]
    coefficients = table(found, "coefficients", names, "controller")
    for name, value in coefficients.items():
        if value is not None or not name.endswith("_max"):  # an unlimited integrator
            _finite(value, f"controller.coefficients.{name}", "SI")
    low, high = items(found, "voltage_limits", 2, "controller")
    if _finite(low, "controller.voltage_limits[0]", "V") < 0:
        raise InputError(f"controller.voltage_limits[0] = {low!r} [V]: must be 0 or more")
    if high is not None and _finite(high, "controller.voltage_limits[1]", "V") <= low:
        raise InputError(
            f"controller.voltage_limits[1] = {high!r} [V]: must be greater than {low!r}, or null"
        )
    for n, value in enumerate(items(found, "reference", 4, "controller")):
        unit = "m" if n < 2 else "s"
        if _finite(value, f"controller.reference[{n}]", unit) < 0:
            raise InputError(f"controller.reference[{n}] = {value!r} [{unit}]: must not be below 0")
    return found


def positive(number: Fraction | float, where: str, unit: str) -> None:
    """Raise `InputError` for a number that is not greater than 0."""
    if number <= 0:
        raise InputError(f"{where} = {number} [{unit}]: must be greater than 0")


def _finite(value: Any, where: str, unit: str) -> float:
    """Return a finite number of JSON of a size that numbers of rigs have."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where} = {str(value)[:40]!r} [{unit}]: must be a number")
    if not math.isfinite(value) or (value and not SIZES[0] <= abs(Fraction(value)) <= SIZES[1]):
        raise InputError(f"{where} = {str(value)[:40]} [{unit}]: larger or smaller than any rig's")
    return float(value)


def _at(where: str, name: str) -> str:
    return f"{where}{'.' if where else ''}{name}"
