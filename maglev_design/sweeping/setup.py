"""What a sweep is made of, and its key: whatever has the same key has the same numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from maglev_design.controller.data import design_as_data
from maglev_design.controller.design import Design
from maglev_design.errors import InputError
from maglev_design.files import digest, finite, picked
from maglev_design.options import SCHEMA_VERSION, Backend, Equilibrium
from maglev_design.rig import Rig, Spread
from maglev_design.simulation.lanes import LANES
from maglev_design.sweeping.draws import Sampling, beta_is_computed, drawn_spreads

MOST_SAMPLES = 10_000_000
"""Scenarios; the quantiles keep one figure of all of them in memory, 8 bytes each."""
MOST_A_CHUNK = 1 << 20
COMPILED_CHUNK, INTERPRETED_CHUNK = 4096, 64
"""Loops of one design a chunk: below a second on one core, or a few."""
OF_A_SWEEP = ("samples", "seed", "sampling", "chunk", "noise", "backend")
"""What a setup holds beside the rig, the designs and their family: what a user may say."""
KIND = "maglev-design sweep"


@dataclass(frozen=True, eq=False)
class Setup:
    """One sweep. Two are equal when their keys are.

    Attributes
    ----------
    rig : Rig
        The plant, its path, noise and uncertainty.
    designs : tuple of Design
        Each runs the same scenarios.
    samples : int
        Scenarios.
    seed : int
        Of the draws and of the noise.
    sampling : {"lhs", "sobol", "random"}
    chunk : int
        Scenarios a file; a multiple of the lanes, so that who runs beside whom is fixed.
    noise : bool
        Whether noise acts.
    backend : {"compiled", "interpreted"}
    beta_error : float or None
        Half the width of the interval of beta_c/beta [-]; None: what the rig says for the reading.
    """

    rig: Rig
    designs: tuple[Design, ...]
    samples: int
    seed: int
    sampling: Sampling
    chunk: int
    noise: bool
    backend: Backend
    beta_error: float | None = None

    def __post_init__(self) -> None:
        for name, most in (("samples", MOST_SAMPLES), ("chunk", MOST_A_CHUNK)):
            value = getattr(self, name)
            if not 1 <= value <= most:
                raise InputError(f"{name} = {value}: must be from 1 to {most} [-]")
        if self.chunk % LANES:
            raise InputError(f"chunk = {self.chunk}: must be a multiple of {LANES} [-]")
        if not 0 <= self.seed < 2**32:
            raise InputError(f"seed = {self.seed}: must be from 0 to {2**32 - 1} [-]")
        first, *others = self.designs
        for other in others:
            if _plants_known_by(other) != _plants_known_by(first):
                raise InputError(
                    f"two families of plants: {_family_in_words(first)}, and "
                    f"{_family_in_words(other)}; the scenarios of a sweep are those of one: sweep "
                    "each design alone"
                )

    @property
    def equilibrium(self) -> Equilibrium:
        """The reading whose family of plants is drawn from."""
        return self.designs[0].equilibrium

    @property
    def spreads(self) -> dict[str, Spread]:
        """What is drawn for each scenario, in order."""
        return drawn_spreads(self.rig, self.equilibrium, self.beta_error)

    @property
    def beta_from(self) -> str:
        """Where the plant's beta comes from, in words."""
        if beta_is_computed(self.rig, self.equilibrium):
            return "drawn values"
        measured = self.equilibrium == "measured"
        return "the voltage that holds the ball at Y" if measured else "beta_c/ratio"

    @property
    def chunks(self) -> int:
        """How many files it takes."""
        return -(-self.samples // self.chunk)

    def span(self, number: int) -> tuple[int, int]:
        """Return the first scenario of a chunk, and how many it has."""
        first = number * self.chunk
        return first, min(self.chunk, self.samples - first)

    @cached_property
    def description(self) -> dict[str, Any]:
        """All of it as JSON data, ``key`` included; an unlimited upper bound is None."""
        data: dict[str, Any] = finite(
            {
                "kind": KIND,
                "schema_version": SCHEMA_VERSION,
                **picked(self, *OF_A_SWEEP, "beta_error"),
                "designs": [design_as_data(design) for design in self.designs],
                "rig": self.rig.model_dump(exclude_none=True),
            }
        )
        return data | {"key": digest(data)}

    @property
    def key(self) -> str:
        """Hash of the description."""
        return str(self.description["key"])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Setup) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


def _plants_known_by(design: Design) -> tuple[bool, float]:
    """Return whether the plants are known by their voltage, and the beta_c that their ratio is of.

    ``model`` and ``appendix-a`` have the same plants.
    """
    return design.equilibrium == "measured", design.believed.beta


def _family_in_words(design: Design) -> str:
    return (
        f"that of the reading {design.equilibrium!r} with beta_c = {design.believed.beta:.6g} "
        "m^3/(s^2 V^2)"
    )


def differences(stored: dict[str, Any], wanted: dict[str, Any]) -> str:
    """Return in words where two descriptions differ."""
    found = []
    for name, value in wanted.items():
        other = stored.get(name)
        if name == "key" or other == value:
            continue
        if isinstance(value, dict | list):
            found.append(f"another {name.removesuffix('s') if name == 'designs' else name}")
        else:
            found.append(f"{name} = {other!r} there, {value!r} here")
    return "; ".join(found) or "another version of the program"
