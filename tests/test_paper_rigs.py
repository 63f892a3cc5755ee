"""The random rigs: repeatable, different, and such that a controller can work on them."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_design.controller import checks, design
from maglev_design.paper.rigs import random_poles, random_rigs

MANY = 200


def test_the_same_seed_gives_the_same_rigs() -> None:
    assert random_rigs(5, 3) == random_rigs(5, 3)
    assert random_rigs(5, 3) != random_rigs(5, 4)
    assert random_poles(5, 3) == random_poles(5, 3)


def test_more_rigs_begin_with_the_same_ones() -> None:
    assert random_rigs(9, 8)[:4] == random_rigs(4, 8)
    assert random_poles(9, 8)[:4] == random_poles(4, 8)


def test_no_rig_needs_a_voltage_that_its_actuator_does_not_have() -> None:
    for rig in random_rigs(MANY, 1):
        checks.check_path_voltage(rig)
        beta = design.plant_beta(rig)
        low, high = rig.limits.voltage
        for gap in (rig.operating_point.gap, rig.reference.start_gap, rig.reference.end_gap):
            voltage = design.true_equilibrium(rig, beta, gap).U
            assert low < voltage < high
            force = rig.plant.force_constant * (rig.current_gain * voltage) ** 2
            weight = rig.plant.mass * rig.plant.gravity
            assert force / (gap + rig.plant.gap_offset) ** 2 == pytest.approx(weight)


def test_the_rigs_cover_what_differs_from_the_paper() -> None:
    rigs = random_rigs(MANY, 2)
    assert {rig.sampling.method for rig in rigs} == {"tustin", "euler", "zoh"}
    offsets = [rig.plant.gap_offset for rig in rigs]
    assert min(offsets) == 0.0 < max(offsets)
    moves = [np.sign(rig.reference.end_gap - rig.operating_point.gap) for rig in rigs]
    assert {float(move) for move in moves} == {-1.0, 1.0}
    assert len({rig.plant.mass for rig in rigs}) == MANY
    assert all(rig.operating_point.voltage is None for rig in rigs)


def test_no_rig_is_asked_for() -> None:
    assert random_rigs(0, 1) == ()
    assert random_poles(0, 1) == ()
