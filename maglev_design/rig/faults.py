"""What is wrong with a rig file, as sentences: the field, its value, its unit, what is allowed."""

from __future__ import annotations

import reprlib
from typing import Any, get_args

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from maglev_design.errors import nearest
from maglev_design.rig.model import Rig
from maglev_design.rig.sections import LONGEST_GAP, LONGEST_PERIOD, in_words
from maglev_design.rig.uncertainty import Spread

LARGEST_SHOWN = 10**30
"""Larger integers are described in a message, not printed."""


def sentence(detail: ErrorDetails) -> str:  # noqa: PLR0911 - one case a kind of fault
    """Return one fault of a rig file as a sentence: field, value, unit, what is allowed."""
    location = [str(part) for part in detail["loc"]]
    section = ".".join(location[:-1])
    field = ".".join(location)
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if kind == "rig":
        inside = ".".join([*location, context["field"]])
        told = context["text"].split(": ", 1)[1]
        if context["value"] is None:
            return f"{inside}: {told}"
        return f"{inside} = {_shown(context['value'])}: {told}" + _hint(inside, context["value"])
    if not location:
        return (
            f"must be a table with [plant], [operating_point] and [sampling], not {_shown(value)}"
        )
    if kind == "extra_forbidden":
        known = list(_model_at(location[:-1]).model_fields)
        where = f"[{section}]" if section else "the top level"
        return (
            f"unknown key {_shown(field)}{nearest(location[-1][:100], known)}; "
            f"{where} takes: {', '.join(known)}"
        )
    if kind == "invalid_key":
        return f"key {_shown(value)}: keys must be text"
    if location[0] == "limits" and kind in ("missing", "too_long", "tuple_type") and location[1:]:
        pair = location[:2]
        shown = _shown(value)
        return f"{'.'.join(pair)} = {shown}: must be two numbers, [lower, upper]{_unit_of(pair)}"
    if kind == "missing":
        return f"{field}: required and missing{_unit_of(location)}"
    if kind in ("model_type", "dict_type"):
        return f"{field} = {_shown(value)}: must be a table, written [{field}]"
    allowed = detail["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    if kind == "finite_number":
        allowed = "a finite number"
    return f"{field} = {_shown(value)}: must be {allowed}{_unit_of(location)}" + _hint(field, value)


class _Short(reprlib.Repr):
    """A value as written, cut where it would fill the screen or the stack."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = 60

    def repr_int(self, x: int, level: int) -> str:  # noqa: ARG002 - reprlib's signature
        return repr(x) if abs(x) < LARGEST_SHOWN else f"an integer of {x.bit_length()} bits"


def _shown(value: Any) -> str:
    return _Short().repr(value)


def _hint(field: str, value: Any) -> str:
    """Say so when a gap or a time was plainly typed in thousandths."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return ""
    if not abs(value) < LARGEST_SHOWN:
        return ""
    quantity = field.removesuffix(".lower").removesuffix(".upper")
    metres = quantity.endswith(("gap", "gap_offset"))
    if metres and value > LONGEST_GAP:
        return f" (gaps are in metres: {value:g} mm is {value / 1000:g} m)"
    if field.startswith(("sampling", "emulator.")) and value > LONGEST_PERIOD:
        return f" (times are in seconds: {value:g} ms is {value / 1000:g} s)"
    return ""


def _model_at(location: list[str]) -> type[BaseModel]:
    model: type[BaseModel] = Rig
    for part in location:
        inner = model.model_fields[part].annotation if part in model.model_fields else None
        for kind in (inner, *get_args(inner)):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                model = kind
    return model


def _unit_of(location: list[str]) -> str:
    """Return the documented meaning and unit of a field, or nothing for a section."""
    names = [part for part in location if not part.isdigit()]
    if _model_at(names[:-1]) is Spread and names[-1] != "distribution":
        names = names[:-1]  # in the unit of what is spread
    info = _model_at(names[:-1]).model_fields.get(names[-1]) if names else None
    return in_words(info)
