"""The rig: every table of the file together, and what holds only between them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Self

from pydantic import BaseModel, Field, model_validator

from maglev_design.rig.sections import (
    MOST_DELAYED_PERIODS,
    Emulator,
    InitialState,
    Limits,
    Noise,
    OperatingPoint,
    PlantParameters,
    ReferencePath,
    Sampling,
    Section,
    fault,
)
from maglev_design.rig.uncertainty import Uncertainty, beyond

MOST_SAMPLES = 1_000_000
"""Samples in one closed loop, so that a period typed in microseconds cannot fill the memory."""


class Rig(Section):
    """One magnetic-levitation rig and what it is asked to do; immutable, SI units.

    Required are ``[plant]``, ``[operating_point]`` and ``[sampling]``. Without ``[initial]``
    the ball starts at rest at Y; without ``[reference]`` it is held at Y for one second.
    """

    name: str = Field(default="unnamed rig", max_length=200, description="name of the rig [-]")
    source: str = Field(default="", max_length=2000, description="where the values are from [-]")
    notes: str = Field(default="", max_length=4000, description="what they do not claim [-]")
    plant: PlantParameters
    operating_point: OperatingPoint
    initial: InitialState
    reference: ReferencePath
    sampling: Sampling
    limits: Limits = Limits()
    noise: Noise = Noise()
    uncertainty: Uncertainty = Uncertainty()
    emulator: Emulator = Emulator()

    @model_validator(mode="before")
    @classmethod
    def _defaults(cls, data: Any) -> Any:
        """Start at rest at Y and hold there, where the file does not say otherwise."""
        if not isinstance(data, dict):
            return data
        point = data.get("operating_point")
        gap = point.get("gap") if isinstance(point, dict) else getattr(point, "gap", None)
        if isinstance(gap, int | float) and not isinstance(gap, bool):
            data = dict(data)
            data.setdefault("initial", {"gap": gap})
            hold = {"start_gap": gap, "end_gap": gap, "start_time": 0.0}
            data.setdefault("reference", hold | {"end_time": 1.0, "horizon": 1.0})
        return data

    @model_validator(mode="after")
    def _inside_the_limits(self) -> Self:
        low, high = self.limits.gap
        gaps = {
            "operating_point.gap": self.operating_point.gap,
            "initial.gap": self.initial.gap,
            "reference.start_gap": self.reference.start_gap,
            "reference.end_gap": self.reference.end_gap,
        }
        for field, gap in gaps.items():
            if not low < gap < high:
                raise fault(field, gap, f"must be inside limits.gap, {low} m to {high} m")
        spread = self.uncertainty.initial_gap
        for gap in spread.reach if spread is not None else ():
            if spread is not None and not low < gap < high:
                allowed = f"must be inside limits.gap, {low} m to {high} m"
                raise beyond("uncertainty.initial_gap", spread, gap, allowed)
        self._emulator_is_possible()
        samples = self.reference.horizon / self.sampling.period
        if samples > MOST_SAMPLES:
            raise fault(
                "sampling.period",
                self.sampling.period,
                f"gives {samples:.3g} samples over the horizon, at most {MOST_SAMPLES} are "
                "simulated; was another unit meant?",
            )
        return self

    def _emulator_is_possible(self) -> None:
        """Refuse a delay that the emulated loop would have to remember for too long."""
        period = self.emulator.period or self.sampling.period
        delay = self.emulator.delay
        if delay is not None and delay > MOST_DELAYED_PERIODS * period:
            raise fault(
                "emulator.delay",
                delay,
                f"must be at most {MOST_DELAYED_PERIODS} of its periods, "
                f"{MOST_DELAYED_PERIODS * period:g} s",
            )


def fields(model: type[BaseModel] = Rig, prefix: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield every field of a rig as ``(dotted name, unit, meaning)``, for documentation.

    Formulas in the meaning stand between backticks.
    """
    for name, info in model.model_fields.items():
        inner = info.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            yield from fields(inner, f"{prefix}{name}.")
        else:
            meaning, _, unit = (info.description or "").rpartition(" [")
            yield f"{prefix}{name}", unit.rstrip("]"), meaning
