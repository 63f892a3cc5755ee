"""The rig: what a person measures and writes down, validated and in SI units.

No formula of the physics stands here; what follows from these numbers (beta, U, C_U, C_Y) is
computed by :mod:`maglev_design.design` from the symbolic layer.
"""

from __future__ import annotations

import math
import operator
import reprlib
import tomllib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from maglev_design.errors import InputError, nearest
from maglev_design.options import DEFAULT_PRESET, Method

LONGEST_GAP = 0.5
"""[m] No laboratory rig levitates across half a metre: beyond it, millimetres were meant."""
LONGEST_PERIOD = 0.1
"""[s] Slower than ten samples a second nothing levitates: beyond it, milliseconds were meant."""
LONGEST_HORIZON = 3600.0
"""[s] An hour; beyond it, milliseconds were meant."""
MOST_SAMPLES = 1_000_000
"""Samples in one closed loop, so that a period typed in microseconds cannot fill the memory."""
MOST_DELAYED_PERIODS = 50
"""Periods of delay that a loop keeps in mind; no rig levitates with as many."""
LARGEST_RIG_FILE = 1_000_000
"""[bytes] A rig is a page of text."""
LARGEST_DRAW = 8.3
"""Standard deviations beyond which nothing is drawn: no probability below 2^-54 is."""
LARGEST_SHOWN = 10**30
"""Larger integers are described in a message, not printed."""


def _quantity(unit: str, text: str, **limits: Any) -> Any:
    """Return the pydantic field of one number: its unit, its meaning and its bounds.

    Formulas in the meaning stand between backticks.
    """
    return Field(description=f"{text} [{unit}]", json_schema_extra={"unit": unit}, **limits)


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Bound = Annotated[float, Field(strict=True)]


class Section(BaseModel):
    """Base of every table of a rig file: frozen, and no key that is not documented."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class PlantParameters(Section):
    """The ball and the coil, eqs. (1)-(2)."""

    mass: Number = _quantity("kg", "`m`, mass of the ball", gt=0)
    gravity: Number = _quantity("m/s^2", "`g`, gravitational acceleration", gt=0)
    current_gain: Number = _quantity("A/V", "`C`, coil current per input voltage", gt=0)
    force_constant: Number = _quantity(
        "N m^2/A^2", "`K`, force `K i^2/(y + y0)^2` of the magnet on the ball", gt=0
    )
    gap_offset: Number = _quantity(
        "m", "`y0`, magnetic offset added to the measured gap", default=0.0, ge=0, le=LONGEST_GAP
    )


class OperatingPoint(Section):
    """The equilibrium around which the controller is designed, eq. (5)."""

    gap: Number = _quantity("m", "`Y`, gap of the equilibrium", gt=0, le=LONGEST_GAP)
    voltage: Number | None = _quantity(
        "V", "`U`, measured voltage that holds the ball at `Y`", default=None, gt=0
    )


class InitialState(Section):
    """The ball when the controller is switched on."""

    gap: Number = _quantity("m", "`y(0)`, initial gap", gt=0, le=LONGEST_GAP)
    velocity: Number = _quantity("m/s", "initial velocity, positive downwards", default=0.0)


class ReferencePath(Section):
    """The rest-to-rest Bezier path, eqs. (27)-(29)."""

    start_gap: Number = _quantity("m", "gap before the move", gt=0, le=LONGEST_GAP)
    end_gap: Number = _quantity("m", "gap after the move", gt=0, le=LONGEST_GAP)
    start_time: Number = _quantity("s", "`t_i`, start of the move", ge=0)
    end_time: Number = _quantity("s", "`t_f`, end of the move", gt=0)
    horizon: Number = _quantity(
        "s", "end of the simulation and of the metrics", gt=0, le=LONGEST_HORIZON
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.end_time <= self.start_time:
            raise _fault(
                "end_time", self.end_time, f"must be after start_time = {self.start_time} s"
            )
        if self.horizon < self.end_time:
            raise _fault(
                "horizon",
                self.horizon,
                f"must not be before the end of the move, end_time = {self.end_time} s",
            )
        return self


class Sampling(Section):
    """The sampled controller."""

    period: Number = _quantity("s", "`T`, sampling period", gt=0, le=LONGEST_PERIOD)
    delay: Number = _quantity(
        "s", "time from a sample to the voltage computed from it", default=0.0, ge=0, le=1.0
    )
    method: Method = Field(
        default="tustin", description="how the law is discretised: tustin, euler or zoh [-]"
    )

    @model_validator(mode="after")
    def _few_periods(self) -> Self:
        if self.delay > MOST_DELAYED_PERIODS * self.period:
            raise _fault(
                "delay",
                self.delay,
                f"must be at most {MOST_DELAYED_PERIODS} periods, "
                f"{MOST_DELAYED_PERIODS * self.period:g} s",
            )
        return self


class Limits(Section):
    """What the actuator can do and where the ball can be."""

    voltage: tuple[Bound, Bound] = _quantity("V", "actuator range", default=(0.0, math.inf))
    gap: tuple[Bound, Bound] = _quantity(
        "m", "beyond it the ball has hit the magnet or dropped", default=(0.0, math.inf)
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for name, unit in (("voltage", "V"), ("gap", "m")):
            low, high = getattr(self, name)
            if not (math.isfinite(low) and low >= 0):
                why = "the plant sees u^2, a negative voltage attracts too"
                note = f" ({why})" if name == "voltage" else ""
                raise _fault(name, low, f"the lower end must be 0 {unit} or more{note}")
            if math.isnan(high) or high <= low:
                raise _fault(name, high, f"the upper end must be above the lower, {low} {unit}")
        return self


class Noise(Section):
    """Standard deviations of the white noise, sec. 4.2."""

    input: Number = _quantity("V", "noise added to the applied voltage", default=0.0, ge=0)
    position: Number = _quantity("m", "noise added to the measured gap", default=0.0, ge=0)


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
    lower: Number | None = _quantity("-", "smallest value that is drawn", default=None)
    upper: Number | None = _quantity("-", "largest value that is drawn", default=None)
    mode: Number | None = _quantity("-", "most frequent value (triangular)", default=None)
    mean: Number | None = _quantity("-", "mean before it is cut off (normal)", default=None)
    deviation: Number | None = _quantity(
        "-", "standard deviation before it is cut off (normal)", default=None, gt=0
    )

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        needed, optional = _SPREADS[self.distribution]
        for name in needed:
            if getattr(self, name) is None:
                raise _fault(name, None, f"required for a {self.distribution} distribution")
        for name in ("lower", "upper", "mode", "mean", "deviation"):
            value = getattr(self, name)
            if value is not None and name not in (*needed, *optional):
                raise _fault(
                    name,
                    value,
                    f"does not belong to a {self.distribution} distribution, which takes "
                    + ", ".join((*needed, *optional)),
                )
        low, high = self.lower, self.upper
        if low is not None and high is not None and low >= high:
            raise _fault("upper", high, f"must be above lower = {low}")
        for name in ("mode", "mean"):
            middle = getattr(self, name)
            if middle is None:
                continue
            if (low is not None and middle < low) or (high is not None and middle > high):
                raise _fault(name, middle, f"must be from lower = {low} to upper = {high}")
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
    }
)
"""The keys of ``[uncertainty]`` besides beta, and whose value each of them spreads."""


def _drawn(name: str) -> Any:
    """Return the field of one uncertain parameter: unit and meaning are the parameter's own."""
    model, field = DRAWN[name]
    text, _, unit = (model.model_fields[field].description or "").rpartition(" [")
    return _quantity(unit.rstrip("]"), f"spread of: {text}", default=None)


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
            return _beyond(name, spread, value, f"must be {text} {at} {unit}")
    return None


def _beyond(name: str, spread: Spread, value: float, allowed: str) -> PydanticCustomError:
    """Return the fault of a spread that reaches `value`, which is not possible."""
    end = "lower" if value == spread.reach[0] else "upper"
    if getattr(spread, end) is not None:
        return _fault(f"{name}.{end}", value, allowed)
    return _fault(
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

    beta: Number = _quantity(
        "-", "`u`: `beta_c/beta` may be anywhere in `[1 - u, 1 + u]`", default=0.0, ge=0, lt=1
    )
    voltage: Number | None = _quantity(
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
                unit = _unit_of(["uncertainty", name])
                raise _fault(
                    name,
                    value,
                    "must be [lower, upper] or a table such as "
                    f'{{ distribution = "normal", mean = ..., deviation = ... }}{unit}',
                )
        return data

    @model_validator(mode="after")
    def _possible(self) -> Self:
        for name, spread in self.spreads.items():
            fault = _impossible(name, spread)
            if fault is not None:
                raise fault
        return self

    @property
    def voltage_error(self) -> float:
        """Relative error of a measured U, stated or taken for granted [-]."""
        return DEFAULT_VOLTAGE_ERROR if self.voltage is None else self.voltage

    @property
    def spreads(self) -> dict[str, Spread]:
        """What is given besides beta, in the order of the fields."""
        return {name: spread for name in DRAWN if (spread := getattr(self, name)) is not None}


class Emulator(Section):
    """Effects that only the rig emulator adds; what is absent is as in the rest of the file."""

    inductance: Number = _quantity("H", "`L`, coil inductance", default=0.0, ge=0)
    resistance: Number = _quantity("ohm", "`R`, coil resistance", default=0.0, ge=0)
    sensor_step: Number = _quantity("m", "quantisation of the gap", default=0.0, ge=0)
    actuator_step: Number = _quantity("V", "quantisation of the voltage", default=0.0, ge=0)
    period: Number | None = _quantity(
        "s", "`T` on the emulated rig", default=None, gt=0, le=LONGEST_PERIOD
    )
    delay: Number | None = _quantity(
        "s", "delay from sample to voltage on the emulated rig", default=None, ge=0, le=1.0
    )
    position_noise: Number | None = _quantity(
        "m", "standard deviation of the sensor's noise on the emulated rig", default=None, ge=0
    )

    @model_validator(mode="after")
    def _coil_is_whole(self) -> Self:
        if self.inductance > 0 and self.resistance == 0:
            raise _fault(
                "resistance", self.resistance, "must be above 0 ohm when an inductance is given"
            )
        return self

    @property
    def time_constant(self) -> float:
        """L/R [s]; 0 for a coil whose current follows at once."""
        return self.inductance / self.resistance if self.inductance else 0.0


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
                raise _fault(field, gap, f"must be inside limits.gap, {low} m to {high} m")
        spread = self.uncertainty.initial_gap
        for gap in spread.reach if spread is not None else ():
            if spread is not None and not low < gap < high:
                allowed = f"must be inside limits.gap, {low} m to {high} m"
                raise _beyond("uncertainty.initial_gap", spread, gap, allowed)
        self._emulator_is_possible()
        samples = self.reference.horizon / self.sampling.period
        if samples > MOST_SAMPLES:
            raise _fault(
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
            raise _fault(
                "emulator.delay",
                delay,
                f"must be at most {MOST_DELAYED_PERIODS} of its periods, "
                f"{MOST_DELAYED_PERIODS * period:g} s",
            )


def _fault(field: str, value: Any, allowed: str) -> PydanticCustomError:
    """Return the error of one field of a section, judged together with its neighbours."""
    return PydanticCustomError(
        "rig", "{text}", {"field": field, "value": value, "text": f"{field}: {allowed}"}
    )


def preset_names() -> tuple[str, ...]:
    """Return the names of the rigs that come with the package, sorted.

    Examples
    --------
    >>> "belmonte2021" in preset_names()
    True
    """
    files = resources.files("maglev_design") / "presets"
    return tuple(sorted(f.name[:-5] for f in files.iterdir() if f.name.endswith(".toml")))


def preset_text(name: str) -> str:
    """Return the TOML text of a preset, comments and sources included.

    Raises
    ------
    InputError
        When no preset has that name.
    """
    if name not in preset_names():
        raise InputError(
            f"no preset named {name!r}{nearest(name, preset_names())}; "
            f"presets: {', '.join(preset_names())}"
        )
    return (resources.files("maglev_design") / "presets" / f"{name}.toml").read_text("utf-8")


def is_papers(rig: Rig) -> bool:
    """Whether the plant, the equilibrium and the move are the paper's, whatever else is not."""
    paper = load_rig(DEFAULT_PRESET)
    same = ("plant", "reference")
    return rig.operating_point.gap == paper.operating_point.gap and all(
        getattr(rig, name) == getattr(paper, name) for name in same
    )


def load_rig(source: str | Path) -> Rig:
    """Return the rig of a TOML file (a path, or a name ending in ``.toml``) or of a preset.

    Raises
    ------
    InputError
        Naming the file, the field, the value, its unit and what is allowed.

    Examples
    --------
    >>> load_rig("belmonte2021").plant.mass
    0.02
    """
    path = Path(source)
    is_path = isinstance(source, Path) or path.suffix == ".toml" or _exists(path)
    if str(source) in preset_names() or not is_path:
        return parse_rig(preset_text(str(source)), str(source))
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_RIG_FILE + 1)
        if len(content) > LARGEST_RIG_FILE:
            raise InputError(f"{path}: larger than {LARGEST_RIG_FILE} bytes, not a rig file")
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8") from error
    except ValueError as error:
        raise InputError(f"{str(path)!r}: not a file name ({error})") from error
    return parse_rig(text, str(path))


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # too long, or characters that no file name has
        return False


def parse_rig(text: str, origin: str) -> Rig:
    """Return the rig written in TOML `text`; `origin` names it in errors."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{origin}: not valid TOML: {error}") from error
    except RecursionError as error:
        raise InputError(f"{origin}: not valid TOML: nested too deeply") from error
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"{origin}: not valid TOML: {error}") from error
    return make_rig(data, origin)


def make_rig(data: dict[str, Any], origin: str = "rig") -> Rig:
    """Return the validated rig of plain `data`, as it stands in TOML or in a saved design."""
    try:
        return Rig.model_validate(data)
    except ValidationError as error:
        given = data if isinstance(data, dict) else {}
        details = [
            detail
            for detail in error.errors()
            if detail["loc"][:1] not in (("initial",), ("reference",)) or detail["loc"][0] in given
        ]
        raise InputError("\n".join(f"{origin}: {_sentence(d)}" for d in details)) from error


def _sentence(detail: ErrorDetails) -> str:  # noqa: PLR0911 - one case a kind of fault
    """Return one fault of a rig file as a sentence: field, value, unit, what is allowed."""
    location = [str(part) for part in detail["loc"]]
    section = ".".join(location[:-1])
    field = ".".join(location)
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if kind == "rig":
        inside = ".".join([*location, context["field"]])
        shown = _shown(context["value"])
        return f"{inside} = {shown}: {context['text'].split(': ', 1)[1]}" + _hint(
            inside, context["value"]
        )
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
    described = info.description.replace("`", "") if info is not None and info.description else ""
    return f" ({described})" if described else ""


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
