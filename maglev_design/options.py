"""The words that a user may choose from, each list stated once and cheap to import."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from maglev_design.errors import check_numbers, check_word

Method = Literal["tustin", "euler", "zoh"]
Equilibrium = Literal["model", "appendix-a", "measured"]
Objective = Literal["itae", "iae", "ise"]
Scenarios = Literal["nominal", "robust", "emulated"]
ControllerName = Literal["tan-gpi", "fee-gpi", "lin-pid", "state-feedback"]
Feedforward = Literal["none", "static"]
Derivative = Literal["error", "measurement"]
Start = Literal["kick", "bumpless"]
Backend = Literal["auto", "compiled", "interpreted"]
TestName = Literal["nominal", "noise", "mismatch"]
Target = Literal["python", "c", "matlab"]
ForceLaw = Literal["inverse-square", "power", "exponential"]
DriveKind = Literal["current", "voltage"]
InductanceLaw = Literal["energy", "constant"]
Actuation = Literal["ideal", "lag", "coil"]
DesignModel = Literal["undamped", "damped", "lag"]
StaticVoltage = Literal["line", "series"]
LawName = Literal["tan-gpi", "fee-gpi", "lin-pid", "state-feedback", "tan-gpi-2"]

METHODS: tuple[Method, ...] = get_args(Method)
EQUILIBRIA: tuple[Equilibrium, ...] = get_args(Equilibrium)
CONTROLLERS: tuple[ControllerName, ...] = get_args(ControllerName)
BACKENDS: tuple[Backend, ...] = get_args(Backend)
LAWS: tuple[LawName, ...] = get_args(LawName)
"""What a user may ask for: the controllers, and the second-order law on a rig of third order."""
DEFAULT_PRESET = "belmonte2021"
DEFAULT_MAX_MS = 2.0
"""Usual upper end of what textbooks allow for the peak of |S|."""
SCHEMA_VERSION = 1
"""Of every JSON document that this program prints or saves."""


@dataclass(frozen=True)
class PlantKind:
    """What a plant is made of; its numbers are the rig's.

    Attributes
    ----------
    force : {"inverse-square", "power", "exponential"}
        How the force falls with the gap.
    exponent : {2, 1}
        p of the current in the force: 1 where a permanent magnet is in the ball.
    actuation : {"ideal", "lag", "coil"}
        Current at once, after a first-order lag, or through a coil whose inductance depends on
        the gap, with its back-EMF.
    damped : bool
        Whether the ball is damped.
    offset : bool
        Whether the input has an offset u0.
    """

    force: ForceLaw = "inverse-square"
    exponent: int = 2
    actuation: Actuation = "ideal"
    damped: bool = False
    offset: bool = False

    @property
    def order(self) -> int:
        """Number of the plant's states."""
        return 2 if self.actuation == "ideal" else 3


PAPER_PLANT = PlantKind()
"""Inverse-square, ideal current drive, no damping: eqs. (1)-(5)."""


@dataclass(frozen=True)
class Controller:
    """Which law, and what the linear PID leaves open.

    Attributes
    ----------
    name : str
        ``tan-gpi`` (20), ``fee-gpi`` (Morales and Sira-Ramirez 2010), ``lin-pid`` or
        ``state-feedback`` (14). The other attributes are of ``lin-pid`` alone.
    feedforward : {"none", "static"}
        Whether the voltage that holds the ball at y* is added.
    derivative : {"error", "measurement"}
        What is differentiated.
    filter : float
        Pole of the derivative's filter over the real closed-loop pole.
    start : {"kick", "bumpless"}
        Filter at zero, so that it differentiates the first error as a step, or at rest on the
        first sample.
    design_model : {"undamped", "damped", "lag"}
        Of ``tan-gpi``: the tangent plant that its gains are placed with, s^2 - C_Y; with a damping
        of the ball; with that and the lag of drive or coil, of third order.
    static_voltage : {"line", "series"}
        The voltage that holds the ball at y*: on a line through Y, exact where C_Y/C_U = U/Z, or
        as a power series.
    """

    name: ControllerName = "tan-gpi"
    feedforward: Feedforward = "none"
    derivative: Derivative = "error"
    filter: float = 10.0
    start: Start = "kick"
    design_model: DesignModel = "undamped"
    static_voltage: StaticVoltage = "line"

    def __post_init__(self) -> None:
        check_word("controller", self.name, CONTROLLERS)
        check_word("feedforward", self.feedforward, get_args(Feedforward))
        check_word("derivative", self.derivative, get_args(Derivative))
        check_word("start", self.start, get_args(Start))
        check_word("design_model", self.design_model, get_args(DesignModel))
        check_word("static_voltage", self.static_voltage, get_args(StaticVoltage))
        check_numbers(positive=True, filter=self.filter)

    @property
    def plant_order(self) -> int:
        """Order of the tangent plant that the gains are placed with."""
        return 3 if self.design_model == "lag" else 2

    @property
    def of_other_plant(self) -> bool:
        """Whether the law is one for a plant other than the paper's."""
        return (self.design_model, self.static_voltage) != ("undamped", "line")

    def as_data(self) -> dict[str, Any]:
        """Return the options as plain data; what is for other plants only where it is used."""
        data = asdict(self)
        for name in ("design_model", "static_voltage"):
            if data[name] == getattr(TAN_GPI, name):
                del data[name]
        return data

    @property
    def variant(self) -> str:
        """What differs from the default of this controller, in words; empty for the default."""
        words = []
        if self.feedforward != "none":
            words.append(f"{self.feedforward} feedforward")
        if self.derivative != "error":
            words.append(f"derivative of the {self.derivative}")
        if self.filter != DEFAULT_FILTER:
            words.append(f"filter at {self.filter:g} times the pole")
        if self.start != "kick":
            words.append(f"{self.start} start")
        if self.design_model == "lag":
            words.append("third order")
        if self.design_model == "damped":
            words.append("damped design model")
        return ", ".join(words)


TAN_GPI = Controller()
DEFAULT_FILTER = TAN_GPI.filter
