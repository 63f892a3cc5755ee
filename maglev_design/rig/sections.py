"""The tables of a rig file: each number with its unit, its meaning and what is allowed."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from maglev_design.options import DriveKind, ForceLaw, InductanceLaw, Method

LONGEST_GAP = 0.5
"""[m] No laboratory rig levitates across half a metre: beyond it, millimetres were meant."""
LARGEST_EXPONENT = 8.0
"""Of the gap in a force law; dipoles far apart have 4, measured fits up to 5."""
LARGEST_RESISTANCE, LARGEST_INDUCTANCE = 1e4, 10.0
"""[ohm], [H] No coil of a levitation rig has more: beyond it, milliohm or millihenry were meant."""
LONGEST_PERIOD = 0.1
"""[s] Slower than ten samples a second nothing levitates: beyond it, milliseconds were meant."""
LONGEST_HORIZON = 3600.0
"""[s] An hour; beyond it, milliseconds were meant."""
MOST_SAMPLES = 1_000_000
"""Samples in one closed loop, so that a period typed in microseconds cannot fill the memory."""
MOST_DELAYED_PERIODS = 50
"""Periods of delay that a loop keeps in mind; no rig levitates with as many."""


def quantity(unit: str, text: str, **limits: Any) -> Any:
    """Return the pydantic field of one number: its unit, its meaning and its bounds.

    Formulas in the meaning stand between backticks.
    """
    return Field(description=f"{text} [{unit}]", json_schema_extra={"unit": unit}, **limits)


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Bound = Annotated[float, Field(strict=True)]


def fault(field: str, value: Any, allowed: str) -> PydanticCustomError:
    """Return the error of one field of a section, judged together with its neighbours."""
    return PydanticCustomError(
        "rig", "{text}", {"field": field, "value": value, "text": f"{field}: {allowed}"}
    )


def in_words(info: FieldInfo | None) -> str:
    """Return the documented meaning and unit of a field; nothing for a table."""
    described = info.description.replace("`", "") if info is not None and info.description else ""
    return f" ({described})" if described else ""


class Section(BaseModel):
    """Base of every table of a rig file: frozen, and no key that is not documented."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    sparse: ClassVar[frozenset[str]] = frozenset()
    """Fields that plain data leaves out where they are as by default."""

    @model_serializer(mode="wrap")
    def _plain(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        for name in self.sparse & data.keys():
            if getattr(self, name) == type(self).model_fields[name].default:
                del data[name]
        return data


class PlantParameters(Section):
    """The ball and the magnet, eqs. (1)-(2), and force laws other than theirs."""

    sparse = frozenset({"force_law", "current_exponent", "gap_exponent", "decay_length", "damping"})

    mass: Number = quantity("kg", "`m`, mass of the ball", gt=0)
    gravity: Number = quantity("m/s^2", "`g`, gravitational acceleration", gt=0)
    current_gain: Number | None = quantity(
        "A/V",
        "`C`, coil current per input voltage; under voltage drive it is `1/R`",
        default=None,
        gt=0,
    )
    force_constant: Number = quantity(
        "N m^2/A^2", "`K`, force `K i^2/(y + y0)^2` of the magnet on the ball", gt=0
    )
    gap_offset: Number = quantity(
        "m",
        "`y0`, magnetic offset added to the measured gap",
        default=0.0,
        ge=-LONGEST_GAP,
        le=LONGEST_GAP,
    )
    force_law: ForceLaw = Field(
        default="inverse-square",
        description="how the force falls with the gap: inverse-square `K i^2/(y + y0)^2`, power "
        "`K i^p/(y + y0)^q`, exponential `K i^2 exp(-y/a)` [-]",
    )
    current_exponent: Literal[1, 2] = Field(
        default=2, description="`p` of a power law; 1 for a permanent magnet [-]"
    )
    gap_exponent: Number | None = quantity(
        "-", "`q` of a power law", default=None, gt=0, le=LARGEST_EXPONENT
    )
    decay_length: Number | None = quantity(
        "m", "`a` of the exponential law", default=None, gt=0, le=LONGEST_GAP
    )
    damping: Number = quantity("N s/m", "viscous damping of the ball", default=0.0, ge=0)

    @model_validator(mode="after")
    def _one_force_law(self) -> Self:
        needed = {"power": ("gap_exponent",), "exponential": ("decay_length",)}
        for name in ("gap_exponent", "decay_length"):
            given, wanted = getattr(self, name), name in needed.get(self.force_law, ())
            if wanted and given is None:
                raise fault(name, given, f"required for force_law = {self.force_law!r}")
            if given is not None and not wanted:
                law = next(law for law, names in needed.items() if name in names)
                raise fault(
                    name,
                    given,
                    f"belongs to force_law = {law!r} and not to {self.force_law!r}",
                )
        if self.force_law != "power" and self.current_exponent != 2:
            raise fault(
                "current_exponent", self.current_exponent, "other than 2 only in a power law"
            )
        if self.force_law == "exponential" and self.gap_offset:
            raise fault(
                "gap_offset",
                self.gap_offset,
                "an offset of the gap is a factor exp(-y0/a) of the force_constant in an "
                "exponential law; multiply it in and leave gap_offset out",
            )
        return self


class Drive(Section):
    """How the input voltage makes the coil current."""

    sparse = frozenset(
        {"current_gain", "lag", "input_offset", "resistance", "inductance", "inductance_law"}
    )

    kind: DriveKind = Field(
        default="current",
        description="current: `i = C (u - u0)` after a first-order lag; voltage: "
        "`u - u0 = R i + d(L(y) i)/dt` [-]",
    )
    current_gain: Number | None = quantity(
        "A/V", "`C` of a current drive, where [plant] does not say it", default=None, gt=0
    )
    lag: Number = quantity(
        "s", "time constant of the amplifier or inner current loop", default=0.0, ge=0, le=1.0
    )
    input_offset: Number = quantity("V", "`u0`, input at which no current flows", default=0.0)
    resistance: Number | None = quantity(
        "ohm", "`R` of coil and wires", default=None, gt=0, le=LARGEST_RESISTANCE
    )
    inductance: Number | None = quantity(
        "H", "`L` of the coil at the gap `Y`", default=None, gt=0, le=LARGEST_INDUCTANCE
    )
    inductance_law: InductanceLaw = Field(
        default="energy",
        description="energy: `L(y)` and the back-EMF that belong to the force; constant: `L` at "
        "every gap, no back-EMF [-]",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        other = ("resistance", "inductance") if self.kind == "current" else ("current_gain", "lag")
        for name in other:
            given = getattr(self, name)
            if given:
                wanted = "voltage" if self.kind == "current" else "current"
                why = "; 1/R is the current_gain" if name == "current_gain" else ""
                raise fault(name, given, f"belongs to kind = {wanted!r}, not {self.kind!r}{why}")
        if self.kind == "voltage":
            for name, unit in (("resistance", "ohm"), ("inductance", "H")):
                if getattr(self, name) is None:
                    raise fault(name, None, f"required for kind = 'voltage' [{unit}]")
        return self

    @property
    def time_constant(self) -> float:
        """The lag, or L/R at the gap Y [s]."""
        if self.resistance is not None and self.inductance is not None:
            return self.inductance / self.resistance
        return self.lag


class OperatingPoint(Section):
    """The equilibrium around which the controller is designed, eq. (5)."""

    gap: Number = quantity("m", "`Y`, gap of the equilibrium", gt=0, le=LONGEST_GAP)
    voltage: Number | None = quantity(
        "V", "`U`, measured voltage that holds the ball at `Y`", default=None, gt=0
    )


class InitialState(Section):
    """The ball when the controller is switched on."""

    gap: Number = quantity("m", "`y(0)`, initial gap", gt=0, le=LONGEST_GAP)
    velocity: Number = quantity("m/s", "initial velocity, positive downwards", default=0.0)


class ReferencePath(Section):
    """The rest-to-rest Bezier path, eqs. (27)-(29)."""

    start_gap: Number = quantity("m", "gap before the move", gt=0, le=LONGEST_GAP)
    end_gap: Number = quantity("m", "gap after the move", gt=0, le=LONGEST_GAP)
    start_time: Number = quantity("s", "`t_i`, start of the move", ge=0)
    end_time: Number = quantity("s", "`t_f`, end of the move", gt=0)
    horizon: Number = quantity(
        "s", "end of the simulation and of the metrics", gt=0, le=LONGEST_HORIZON
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.end_time <= self.start_time:
            raise fault(
                "end_time", self.end_time, f"must be after start_time = {self.start_time} s"
            )
        if self.horizon < self.end_time:
            raise fault(
                "horizon",
                self.horizon,
                f"must not be before the end of the move, end_time = {self.end_time} s",
            )
        return self


class Sampling(Section):
    """The sampled controller."""

    period: Number = quantity("s", "`T`, sampling period", gt=0, le=LONGEST_PERIOD)
    delay: Number = quantity(
        "s", "time from a sample to the voltage computed from it", default=0.0, ge=0, le=1.0
    )
    method: Method = Field(
        default="tustin", description="how the law is discretised: tustin, euler or zoh [-]"
    )

    @model_validator(mode="after")
    def _few_periods(self) -> Self:
        if self.delay > MOST_DELAYED_PERIODS * self.period:
            raise fault(
                "delay",
                self.delay,
                f"must be at most {MOST_DELAYED_PERIODS} periods, "
                f"{MOST_DELAYED_PERIODS * self.period:g} s",
            )
        return self


class Limits(Section):
    """What the actuator can do and where the ball can be."""

    voltage: tuple[Bound, Bound] = quantity("V", "actuator range", default=(0.0, math.inf))
    gap: tuple[Bound, Bound] = quantity(
        "m", "beyond it the ball has hit the magnet or dropped", default=(0.0, math.inf)
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for name, unit in (("voltage", "V"), ("gap", "m")):
            low, high = getattr(self, name)
            if not math.isfinite(low) or (name == "gap" and low < 0):
                raise fault(name, low, f"the lower end must be 0 {unit} or more")
            if math.isnan(high) or high <= low:
                raise fault(name, high, f"the upper end must be above the lower, {low} {unit}")
        return self


class Noise(Section):
    """Standard deviations of the white noise, sec. 4.2."""

    input: Number = quantity("V", "noise added to the applied voltage", default=0.0, ge=0)
    position: Number = quantity("m", "noise added to the measured gap", default=0.0, ge=0)


class Emulator(Section):
    """Effects that only the rig emulator adds; what is absent is as in the rest of the file."""

    inductance: Number = quantity("H", "`L`, coil inductance", default=0.0, ge=0)
    resistance: Number = quantity("ohm", "`R`, coil resistance", default=0.0, ge=0)
    sensor_step: Number = quantity("m", "quantisation of the gap", default=0.0, ge=0)
    actuator_step: Number = quantity("V", "quantisation of the voltage", default=0.0, ge=0)
    period: Number | None = quantity(
        "s", "`T` on the emulated rig", default=None, gt=0, le=LONGEST_PERIOD
    )
    delay: Number | None = quantity(
        "s", "delay from sample to voltage on the emulated rig", default=None, ge=0, le=1.0
    )
    position_noise: Number | None = quantity(
        "m", "standard deviation of the sensor's noise on the emulated rig", default=None, ge=0
    )

    @model_validator(mode="after")
    def _coil_is_whole(self) -> Self:
        if self.inductance > 0 and self.resistance == 0:
            raise fault(
                "resistance", self.resistance, "must be above 0 ohm when an inductance is given"
            )
        return self

    @property
    def time_constant(self) -> float:
        """L/R [s]; 0 for a coil whose current follows at once."""
        return self.inductance / self.resistance if self.inductance else 0.0
