"""The rig: every table of the file together, and what holds only between them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, Self

from pydantic import BaseModel, Field, model_validator

from maglev_design.options import Actuation, PlantKind
from maglev_design.rig.sections import (
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
    fault,
)
from maglev_design.rig.uncertainty import DRAWN, Uncertainty, beyond

MOST_SAMPLES = 1_000_000
"""Samples in one closed loop, so that a period typed in microseconds cannot fill the memory."""


class Rig(Section):
    """One magnetic-levitation rig and what it is asked to do; immutable, SI units.

    Required are ``[plant]``, ``[operating_point]`` and ``[sampling]``. Without ``[initial]``
    the ball starts at rest at Y; without ``[reference]`` it is held at Y for one second.
    """

    sparse: ClassVar[frozenset[str]] = frozenset({"drive"})

    name: str = Field(default="unnamed rig", max_length=200, description="name of the rig [-]")
    source: str = Field(default="", max_length=2000, description="where the values are from [-]")
    notes: str = Field(default="", max_length=4000, description="what they do not claim [-]")
    plant: PlantParameters
    drive: Drive = Drive()
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

    @property
    def current_gain(self) -> float:
        """C [A/V], for a coil under voltage 1/R."""
        if self.drive.resistance is not None:
            return 1 / self.drive.resistance
        gain = self.plant.current_gain or self.drive.current_gain
        assert gain is not None  # noqa: S101 - validation lets none through
        return gain

    def stated(self, name: str) -> float:
        """Return the rig's value of what a key of ``[uncertainty]`` spreads; 0 if it has none."""
        if name == "current_gain":
            return self.current_gain
        model, field = DRAWN[name]
        (section,) = (
            x for x in (self.plant, self.drive, self.initial, self.noise) if type(x) is model
        )
        return float(getattr(section, field) or 0.0)

    @property
    def kind(self) -> PlantKind:
        """What the plant is made of; what is only uncertain, and 0 in the file, is part of it."""
        plant, drive, spread = self.plant, self.drive, self.uncertainty
        actuation: Actuation = "lag" if drive.lag else "ideal"
        if drive.kind == "voltage":
            actuation = "coil" if drive.inductance_law == "energy" else "lag"
        return PlantKind(
            plant.force_law,
            plant.current_exponent,
            actuation,
            damped=bool(plant.damping) or spread.damping is not None,
            offset=bool(drive.input_offset) or spread.input_offset is not None,
        )

    @model_validator(mode="after")
    def _one_current_gain(self) -> Self:
        """Refuse two statements of C, and none."""
        given = {
            name: value
            for name, value in (
                ("plant.current_gain", self.plant.current_gain),
                ("drive.current_gain", self.drive.current_gain),
                ("drive.resistance", self.drive.resistance),
            )
            if value is not None
        }
        if not given:
            raise fault(
                "plant.current_gain",
                None,
                "required and missing (C, coil current per input voltage [A/V]; under voltage "
                "drive [drive] has the resistance [ohm] instead)",
            )
        if len(given) > 1:
            last = list(given)[-1]
            why = "under voltage drive the current gain is 1/R; leave plant.current_gain out"
            if last == "drive.current_gain":
                why = "the current gain stands twice; leave one of the two out"
            raise fault(last, given[last], f"given beside {next(iter(given))}: {why}")
        return self

    @model_validator(mode="after")
    def _spread_of_the_drive(self) -> Self:
        """Refuse a spread of what this drive has not, and a lag that may be 0."""
        spreads, voltage = self.uncertainty.spreads, self.drive.kind == "voltage"
        for name, belongs in (
            ("lag", not voltage),
            ("resistance", voltage),
            ("inductance", voltage),
        ):
            spread = spreads.get(name)
            if spread is None:
                continue
            where, reach = f"uncertainty.{name}", list(spread.reach)
            if not belongs:
                kind = "current" if voltage else "voltage"
                raise fault(where, reach, f"belongs to [drive] kind = {kind!r}")
            if not (reach[0] > 0 and self.stated(name) > 0):
                raise fault(
                    where, reach, f"needs drive.{name} and every value of its spread above 0"
                )
        return self

    @model_validator(mode="after")
    def _actuator_range(self) -> Self:
        """Refuse a voltage that attracts again where the force is even in it."""
        low = self.limits.voltage[0]
        if low < 0 and self.kind.exponent == 2 and self.kind.actuation == "ideal":
            net = low - self.drive.input_offset
            if net < 0:
                raise fault(
                    "limits.voltage",
                    low,
                    f"the lower end must be {max(0.0, self.drive.input_offset):g} V or more (the "
                    "plant sees u^2, a negative voltage attracts too)",
                )
        return self

    @model_validator(mode="after")
    def _in_front_of_the_magnet(self) -> Self:
        """Refuse gaps at which y + y0 is not positive."""
        if self.plant.force_law == "exponential":
            spread = self.uncertainty.gap_offset
            if spread is not None:
                raise fault(
                    "uncertainty.gap_offset",
                    list(spread.reach),
                    "an exponential force law has none; spread force_constant instead",
                )
            return self
        offset, (low, _) = self.plant.gap_offset, self.limits.gap
        spread = self.uncertainty.gap_offset
        least, whose = offset, "plant.gap_offset ="
        if spread is not None and spread.reach[0] < offset:
            least, whose = spread.reach[0], "uncertainty.gap_offset down to"
        gaps = {
            "operating_point.gap": self.operating_point.gap,
            "initial.gap": self.initial.gap,
            "reference.start_gap": self.reference.start_gap,
            "reference.end_gap": self.reference.end_gap,
        }
        if low > 0:
            gaps["limits.gap"] = low
        for field, gap in gaps.items():
            if gap + least <= 0:
                raise fault(
                    field,
                    gap,
                    f"must be above {-least:g} m, because the magnetic gap y + y0 with {whose} "
                    f"{least:g} m has to be positive",
                )
        return self

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
