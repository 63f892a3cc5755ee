"""The initial errors that the nonlinear, saturated loop is guaranteed to survive.

The loop is the continuous one with its clamp, its anti-windup and the bound of its integrator, and
it regulates at one gap. The guaranteed set is {z'P z <= level} in the deviations z from rest
(:mod:`maglev_design.certification.region.model`); P and the level are found by a search
(:mod:`maglev_design.certification.region.search`), rounded to rationals and proved in exact
arithmetic (:mod:`maglev_design.certification.region.proof`). What a user sees is its slice by the
plane of the initial errors of position and velocity, the controller's states at zero.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpq, fmpq_mat
from numpy.typing import NDArray

from maglev_design.certification.intervals.arithmetic import exact
from maglev_design.certification.rationals import decimal
from maglev_design.certification.region.model import Deviation, deviation
from maglev_design.certification.region.proof import RegionCheck, check
from maglev_design.certification.region.search import FoundForm, find_form
from maglev_design.controller.design import Design
from maglev_design.errors import InputError
from maglev_design.rig import Rig

Array = NDArray[np.float64]

DIGITS = 30
"""Binary digits kept of the found form, relative to its diagonal."""
STEPS = 28
"""Levels tried, each 5 % below the one before: the last is a quarter of what was hoped for."""
POINTS = 401
"""Points of the outline along e."""


class RegionStatus(enum.Enum):
    """What was found; the value is a sentence with the remedy."""

    GUARANTEED = (
        "Every start in the region converges under the continuous law without touching a limit of "
        "the gap."
    )
    SAMPLED_UNSTABLE = (
        "No region is offered: it would be the continuous law's, and the sampled loop, which runs, "
        "is unstable in the family; sample faster or take slower poles."
    )
    NO_FORM = (
        "No quadratic function proves anything: the continuous loop is unstable, or barely stable, "
        "somewhere in the ratio interval; narrow it, or take other poles."
    )
    START_OUTSIDE = (
        "A set was proved, but the controller's start under mismatch lies outside it: narrow the "
        "ratio interval, or give the integrator a start nearer to its rest."
    )


def status_as_data(status: RegionStatus) -> dict[str, str]:
    """Return a status for JSON, and of which law the region is."""
    name = status.name.lower().replace("_", "-")
    return {"law": "continuous", "status": name, "message": status.value}


@dataclass(frozen=True)
class Region:
    """A guaranteed set of initial errors, with what is needed to check it again.

    Attributes
    ----------
    status : RegionStatus
    model : Deviation
        The loop it is about.
    ratios : tuple of Fraction
        beta_c/beta for which it holds.
    P : fmpq_mat, shape (n, n)
        In the SI units of ``model.names``; empty when there is none.
    level : fmpq
    pace : fmpq
        Unit of the multipliers of the proof [1/s].
    check : RegionCheck or None
        What the exact check said.
    """

    status: RegionStatus
    model: Deviation
    ratios: tuple[Fraction, Fraction]
    P: fmpq_mat
    level: fmpq
    pace: fmpq
    check: RegionCheck | None

    def verified(self) -> RegionCheck:
        """Run the exact check again, without the search that found P."""
        return check(self.model, self.P, self.level, self.pace)

    def contains(self, e: float, v: float) -> bool:
        """Return whether the start with errors e [m] and v [m/s] is guaranteed; exact.

        V is convex along the line of starts that the ratios make, so its ends decide.
        """
        if self.status is not RegionStatus.GUARANTEED:
            return False
        return max(self._values(exact(e), exact(v))) <= self.level

    def _values(self, e: fmpq, v: fmpq) -> list[fmpq]:
        return [_product(self.P, *2 * (self.model.start(e, v, rest),)) for rest in self.model.rest]

    def outline(self) -> tuple[Array, Array, Array]:
        """Return e [m] and the least and largest v [m/s] of the region there."""
        if self.status is not RegionStatus.GUARANTEED:
            return (np.empty(0),) * 3
        slices = [_slice(self.P, self.level, self.model, rest) for rest in self.model.rest]
        ends = [one.extent() for one in slices]
        low, high = max(left for left, _ in ends), min(right for _, right in ends)
        e = (low + high) / 2 - (high - low) / 2 * np.cos(np.linspace(0, math.pi, POINTS))
        chords = np.array([one.chord(e) for one in slices])
        least, most = chords[:, 0].max(axis=0), chords[:, 1].min(axis=0)
        held = least <= most
        return e[held], least[held], most[held]

    @property
    def area(self) -> float:
        """Area of the region in the plane of the initial errors [m^2/s]."""
        e, least, most = self.outline()
        width = most - least
        return float((width[1:] + width[:-1]) @ np.diff(e) / 2)

    @property
    def reach(self) -> tuple[float, float]:
        """Least and largest position error [m] from which a start at rest is guaranteed."""
        if self.status is not RegionStatus.GUARANTEED:
            return 0.0, 0.0
        slices = [_slice(self.P, self.level, self.model, rest) for rest in self.model.rest]
        ends = [_roots(one.ee, one.e, one.rest) for one in slices]
        return max(low for low, _ in ends), min(high for _, high in ends)

    def as_dict(self) -> dict[str, Any]:
        """Return the region for JSON; the form as strings of exact rationals, SI units."""
        return {
            **status_as_data(self.status),
            "gap": float(self.model.gap),
            "ratios": [str(ratio) for ratio in self.ratios],
            "states": list(self.model.names),
            "P": [[str(x) for x in row] for row in self.P.tolist()],
            "level": str(self.level),
            "cells": self.check.cells if self.check else 0,
            "reach": list(self.reach),
            "area": self.area,
        }


@dataclass(frozen=True)
class _Slice:
    """V - level at a start, ee e^2 + 2 ev e v + vv v^2 + 2 (e_ e + v_ v) + rest, at one u_eq."""

    ee: float
    ev: float
    vv: float
    e: float
    v: float
    rest: float

    def chord(self, e: Array) -> tuple[Array, Array]:
        """Return the least and largest v where it is not positive; the wrong way round if none."""
        half = self.ev * e + self.v
        square = half**2 - self.vv * (self.ee * e**2 + 2 * self.e * e + self.rest)
        width = np.sqrt(np.maximum(square, 0.0))
        return (-half - width) / self.vv, (-half + width) / self.vv

    def extent(self) -> tuple[float, float]:
        """Return the least and largest e of its points."""
        return _roots(
            self.vv * self.ee - self.ev**2,
            self.vv * self.e - self.ev * self.v,
            self.vv * self.rest - self.v**2,
        )


def _slice(P: fmpq_mat, level: fmpq, model: Deviation, rest: fmpq) -> _Slice:
    """Return the slice of {z'P z <= level} by the starts."""
    zero, one = fmpq(0), fmpq(1)
    origin = model.start(zero, zero, rest)
    along_e = [x - y for x, y in zip(model.start(one, zero, rest), origin, strict=True)]
    along_v = [x - y for x, y in zip(model.start(zero, one, rest), origin, strict=True)]
    return _Slice(
        ee=float(_product(P, along_e, along_e)),
        ev=float(_product(P, along_e, along_v)),
        vv=float(_product(P, along_v, along_v)),
        e=float(_product(P, along_e, origin)),
        v=float(_product(P, along_v, origin)),
        rest=float(_product(P, origin, origin) - level),
    )


def _roots(square: float, half: float, rest: float) -> tuple[float, float]:
    """Return the roots of square x^2 + 2 half x + rest, which is not positive at one x."""
    width = math.sqrt(max(half**2 - square * rest, 0.0))
    return (-half - width) / square, (-half + width) / square


def _product(P: fmpq_mat, left: list[fmpq], right: list[fmpq]) -> fmpq:
    """Return left' P right."""
    return (fmpq_mat([left]) * P * fmpq_mat([right]).transpose())[0, 0]


def guaranteed_region(
    rig: Rig,
    design: Design,
    ratios: tuple[float | Fraction, float | Fraction] = (1.0, 1.0),
    gap: float | None = None,
) -> Region:
    """Return a region of initial errors that the loop survives at every ratio, with its proof.

    Parameters
    ----------
    rig : Rig
    design : Design
        Of TAN-GPI. It stays; the plant's beta is the design's beta_c over the ratio.
    ratios : tuple
        Interval of beta_c/beta; decimals are taken as exact.
    gap : float, optional
        Where the loop regulates [m]; default: the start of the rig's reference.

    Returns
    -------
    Region
        Its status says whether there is one.

    Raises
    ------
    InputError
        For a ratio that is not positive, and where
        :func:`maglev_design.certification.region.model.deviation` raises it.

    Notes
    -----
    "Exact" takes the numbers that run in double precision (gains, believed coefficients, limits)
    as they are. The law is the continuous one: nothing is said of the sampled law.
    """
    if not all(math.isfinite(x) and x > 0 for x in ratios):
        raise InputError(
            f"ratios = {[float(x) for x in ratios]}: the ends of an interval of beta_c/beta must "
            "be finite numbers greater than 0"
        )
    low, high = sorted(x if isinstance(x, Fraction) else decimal(x) for x in ratios)
    model = deviation(rig, design, (low, high), gap)
    found = find_form(model)
    empty = Region(RegionStatus.NO_FORM, model, (low, high), fmpq_mat(0, 0), fmpq(0), fmpq(0), None)
    return empty if found is None else _proved(empty, found)


def _proved(empty: Region, found: FoundForm) -> Region:
    """Return the region of the largest of the levels tried that is proved."""
    P = _rounded(found.P)
    pace = fmpq(math.ceil(16 * found.pace), 16)
    for n in range(STEPS):
        level = fmpq(math.floor(found.level * 0.95**n * 2**20), 2**20)
        said = check(empty.model, P, level, pace)
        if said.proved:
            region = replace(
                empty, status=RegionStatus.GUARANTEED, P=P, level=level, pace=pace, check=said
            )
            inside = region.contains(0.0, 0.0)
            return region if inside else replace(region, status=RegionStatus.START_OUTSIDE)
    return empty


def _rounded(P: Array) -> fmpq_mat:
    """Return P with short rational entries."""
    sizes = 2.0 ** np.round(np.log2(np.diag(P)) / 2)
    whole = np.round(P / np.outer(sizes, sizes) * 2**DIGITS)
    size = fmpq_mat(np.diag([exact(x) for x in sizes]).tolist())
    return size * fmpq_mat([[exact(x) for x in row] for row in whole]) * size / fmpq(2**DIGITS)
