"""The words that a user may choose from, each list stated once and cheap to import."""

from __future__ import annotations

from typing import Literal, get_args

Method = Literal["tustin", "euler", "zoh"]
Equilibrium = Literal["model", "appendix-a", "measured"]
Objective = Literal["itae", "iae", "ise"]
Scenarios = Literal["nominal", "robust"]

METHODS: tuple[Method, ...] = get_args(Method)
EQUILIBRIA: tuple[Equilibrium, ...] = get_args(Equilibrium)
DEFAULT_PRESET = "belmonte2021"
DEFAULT_MAX_MS = 2.0
"""Usual upper end of what textbooks allow for the peak of |S|."""
SCHEMA_VERSION = 1
"""Of every JSON document that this program prints or saves."""
