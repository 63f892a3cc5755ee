"""The words that a user may choose from, each list stated once and cheap to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

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

METHODS: tuple[Method, ...] = get_args(Method)
EQUILIBRIA: tuple[Equilibrium, ...] = get_args(Equilibrium)
CONTROLLERS: tuple[ControllerName, ...] = get_args(ControllerName)
BACKENDS: tuple[Backend, ...] = get_args(Backend)
DEFAULT_PRESET = "belmonte2021"
DEFAULT_MAX_MS = 2.0
"""Usual upper end of what textbooks allow for the peak of |S|."""
SCHEMA_VERSION = 1
"""Of every JSON document that this program prints or saves."""


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
    """

    name: ControllerName = "tan-gpi"
    feedforward: Feedforward = "none"
    derivative: Derivative = "error"
    filter: float = 10.0
    start: Start = "kick"

    def __post_init__(self) -> None:
        check_word("controller", self.name, CONTROLLERS)
        check_word("feedforward", self.feedforward, get_args(Feedforward))
        check_word("derivative", self.derivative, get_args(Derivative))
        check_word("start", self.start, get_args(Start))
        check_numbers(positive=True, filter=self.filter)

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
        return ", ".join(words)


TAN_GPI = Controller()
DEFAULT_FILTER = TAN_GPI.filter
