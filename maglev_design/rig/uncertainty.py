"""``[uncertainty]``: how far the parameters may be off, and what a sweep draws them from."""

from __future__ import annotations

import operator
from types import MappingProxyType
from typing import Any, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from maglev_design.rig.sections import (
    Drive,
    InitialState,
    Noise,
    Number,
    PlantParameters,
    Section,
    fault,
    in_words,
    quantity,
)

LARGEST_DRAW = 8.3
"""Standard deviations beyond which nothing is drawn: no probability below 2^-54 is."""


class Spread(Section):
    """What one physical parameter is drawn from, in the unit of the parameter.

    In a rig file either ``[lower, upper]``, which is uniform, or a table:

    - ``{ distribution = "uniform", lower = , upper = }``
    - ``{ distribution = "triangular", lower = , mode = , upper = }``
    - ``{ distribution = "normal", mean = , deviation = }``, the standard deviation; with ``lower``
      or ``upper`` or both, what lies beyond is never drawn (the rest is drawn as often as before,
      in proportion).
    """

    distribution: Literal["uniform", "triangular", "normal"] = Field(
        description="uniform, triangular or normal [-]"
    )
    lower: Number | None = quantity("-", "smallest value that is drawn", default=None)
    upper: Number | None = quantity("-", "largest value that is drawn", default=None)
    mode: Number | None = quantity("-", "most frequent value (triangular)", default=None)
    mean: Number | None = quantity("-", "mean before it is cut off (normal)", default=None)
    deviation: Number | None = quantity(
        "-", "standard deviation before it is cut off (normal)", default=None, gt=0
    )

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        needed, optional = _SPREADS[self.distribution]
        for name in needed:
            if getattr(self, name) is None:
                raise fault(name, None, f"required for a {self.distribution} distribution")
        for name in ("lower", "upper", "mode", "mean", "deviation"):
            value = getattr(self, name)
            if value is not None and name not in (*needed, *optional):
                raise fault(
                    name,
                    value,
                    f"does not belong to a {self.distribution} distribution, which takes "
                    + ", ".join((*needed, *optional)),
                )
        low, high = self.lower, self.upper
        if low is not None and high is not None and low >= high:
            raise fault("upper", high, f"must be above lower = {low}")
        for name in ("mode", "mean"):
            middle = getattr(self, name)
            if middle is None:
                continue
            if (low is not None and middle < low) or (high is not None and middle > high):
                raise fault(name, middle, f"must be from lower = {low} to upper = {high}")
        return self

    @property
    def reach(self) -> tuple[float, float]:
        """The smallest and the largest value that can be drawn."""
        low, high = self.lower, self.upper
        if self.mean is not None and self.deviation is not None:
            far = LARGEST_DRAW * self.deviation
            low = self.mean - far if low is None else low
            high = self.mean + far if high is None else high
        if low is None or high is None:
            raise ValueError("a spread without ends")  # validation lets none through
        return low, high


DEFAULT_VOLTAGE_ERROR = 0.01
"""Relative error of a measured U where the rig does not state it."""

_SPREADS: MappingProxyType[str, tuple[tuple[str, ...], tuple[str, ...]]] = MappingProxyType(
    {
        "uniform": (("lower", "upper"), ()),
        "triangular": (("lower", "mode", "upper"), ()),
        "normal": (("mean", "deviation"), ("lower", "upper")),
    }
)
"""What each distribution needs and what it may have besides."""

DRAWN: MappingProxyType[str, tuple[type[Section], str]] = MappingProxyType(
    {
        "mass": (PlantParameters, "mass"),
        "current_gain": (PlantParameters, "current_gain"),
        "force_constant": (PlantParameters, "force_constant"),
        "gravity": (PlantParameters, "gravity"),
        "gap_offset": (PlantParameters, "gap_offset"),
        "initial_gap": (InitialState, "gap"),
        "initial_velocity": (InitialState, "velocity"),
        "input_noise": (Noise, "input"),
        "position_noise": (Noise, "position"),
        "damping": (PlantParameters, "damping"),
        "lag": (Drive, "lag"),
        "resistance": (Drive, "resistance"),
        "inductance": (Drive, "inductance"),
        "input_offset": (Drive, "input_offset"),
    }
)
"""The keys of ``[uncertainty]`` besides beta, and whose value each of them spreads."""


def _drawn(name: str) -> Any:
    """Return the field of one uncertain parameter: unit and meaning are the parameter's own."""
    model, field = DRAWN[name]
    text, _, unit = (model.model_fields[field].description or "").rpartition(" [")
    return quantity(unit.rstrip("]"), f"spread of: {text}", default=None)


def _impossible(name: str, spread: Spread) -> PydanticCustomError | None:
    """Return the fault of a spread from which impossible values would be drawn, if it has one."""
    model, field = DRAWN[name]
    info = model.model_fields[field]
    unit = (info.description or "").rpartition(" [")[2].rstrip("]")
    low, high = spread.reach
    for limit in info.metadata:
        for word, value, broken, text in (
            ("gt", low, operator.le, "greater than"),
            ("ge", low, operator.lt, "at least"),
            ("lt", high, operator.ge, "less than"),
            ("le", high, operator.gt, "at most"),
        ):
            at = getattr(limit, word, None)
            if at is None or not broken(value, at):
                continue
            return beyond(name, spread, value, f"must be {text} {at} {unit}")
    return None


def beyond(name: str, spread: Spread, value: float, allowed: str) -> PydanticCustomError:
    """Return the fault of a spread that reaches `value`, which is not possible."""
    end = "lower" if value == spread.reach[0] else "upper"
    if getattr(spread, end) is not None:
        return fault(f"{name}.{end}", value, allowed)
    return fault(
        f"{name}.deviation",
        spread.deviation,
        f"draws reach {value:.4g} ({LARGEST_DRAW} deviations from the mean), which {allowed}; "
        f"give a smaller deviation, or cut the distribution off with {end} = ",
    )


class Uncertainty(Section):
    """How far the parameters may be off; beta, voltage and gap_offset make the family of plants.

    Each but `beta` and `voltage` is ``[lower, upper]`` or a table, see :class:`Spread`, in the unit
    of the parameter. In a sweep the plant's beta follows from what is drawn where mass,
    current_gain or force_constant is given, and `beta` is not used; else the true beta is
    beta_c/ratio with the ratio uniform over the family.
    """

    beta: Number = quantity(
        "-", "`u`: `beta_c/beta` may be anywhere in `[1 - u, 1 + u]`", default=0.0, ge=0, lt=1
    )
    voltage: Number | None = quantity(
        "-",
        "`d`: relative error of the measured `operating_point.voltage`, which stands for that of "
        "`beta` under the reading `measured`; 0.01 where it is absent",
        default=None,
        ge=0,
        lt=1,
    )
    mass: Spread | None = _drawn("mass")
    current_gain: Spread | None = _drawn("current_gain")
    force_constant: Spread | None = _drawn("force_constant")
    gravity: Spread | None = _drawn("gravity")
    gap_offset: Spread | None = _drawn("gap_offset")
    initial_gap: Spread | None = _drawn("initial_gap")
    initial_velocity: Spread | None = _drawn("initial_velocity")
    input_noise: Spread | None = _drawn("input_noise")
    position_noise: Spread | None = _drawn("position_noise")
    damping: Spread | None = _drawn("damping")
    lag: Spread | None = _drawn("lag")
    resistance: Spread | None = _drawn("resistance")
    inductance: Spread | None = _drawn("inductance")
    input_offset: Spread | None = _drawn("input_offset")

    @model_validator(mode="before")
    @classmethod
    def _intervals(cls, data: Any) -> Any:
        """Read ``[lower, upper]`` as a uniform distribution."""
        if not isinstance(data, dict):
            return data
        data = dict(data)
        for name in DRAWN:
            value = data.get(name)
            if isinstance(value, list | tuple) and len(value) == 2:
                data[name] = {"distribution": "uniform", "lower": value[0], "upper": value[1]}
            elif value is not None and not isinstance(value, dict | Spread):
                unit = in_words(cls.model_fields[name])
                raise fault(
                    name,
                    value,
                    "must be [lower, upper] or a table such as "
                    f'{{ distribution = "normal", mean = ..., deviation = ... }}{unit}',
                )
        return data

    @model_validator(mode="after")
    def _possible(self) -> Self:
        for name, spread in self.spreads.items():
            found = _impossible(name, spread)
            if found is not None:
                raise found
        return self

    @property
    def voltage_error(self) -> float:
        """Relative error of a measured U, stated or taken for granted [-]."""
        return DEFAULT_VOLTAGE_ERROR if self.voltage is None else self.voltage

    @property
    def spreads(self) -> dict[str, Spread]:
        """What is given besides beta, in the order of the fields."""
        return {name: spread for name in DRAWN if (spread := getattr(self, name)) is not None}
