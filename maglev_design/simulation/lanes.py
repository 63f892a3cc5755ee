"""What the compiled loop and its callers agree on: lanes, and the figures of a loop, in order."""

from __future__ import annotations

from importlib import resources

from maglev_design.figures import EXTREMES, INDICES

LANES = 4
"""Loops in one call of the step: a register of AVX2. gcc takes wider vectors apart.

A single loop fills all of them: four without branches take less time than one with.
"""
PARTS = 9
SCALARS = (*EXTREMES, "total_variation", "final_error", "survived", "last_gap")
GRADIENTS = (*INDICES, *EXTREMES)


def resource(name: str) -> str:
    """Return a text file that stands beside this module."""
    return (resources.files("maglev_design.simulation") / name).read_text("utf-8")


def figures_count(directions: int) -> int:
    """Return how many numbers the kernel gives for each loop."""
    return PARTS + len(SCALARS) + len(GRADIENTS) * directions
