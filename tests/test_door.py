"""The front door: one lazy page whose names stay what they are."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import control
import numpy as np
import pytest
from exported import judged

import maglev_design
from maglev_design.certification.lyapunov.lmi import LmiStatus
from maglev_design.controller.design import PoleSpec
from maglev_design.errors import InputError
from maglev_design.linear_loop import loop_of
from maglev_design.record import DesignRecord

DOOR = sorted(set(dir(maglev_design)) - {"__version__"})
VERBS = [name for name in DOOR if name.islower()]


def test_the_door_imports_no_room() -> None:
    code = "import sys, maglev_design; print(*sorted(n for n in sys.modules if 'maglev' in n))"
    loaded = subprocess.run(  # noqa: S603 - our own interpreter and text
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert loaded.stdout.split() == ["maglev_design"]


@pytest.mark.parametrize("name", DOOR)
def test_every_name_of_the_door_is_there_and_told(name: str) -> None:
    found = getattr(maglev_design, name)
    assert callable(found)
    assert found.__doc__


def test_no_room_is_called_like_a_function_of_the_door() -> None:
    rooms = {module.name for module in pkgutil.iter_modules(maglev_design.__path__)}
    assert rooms.isdisjoint(DOOR)


@pytest.mark.parametrize("verb", VERBS)
def test_a_function_of_the_door_stays_one_when_every_room_is_loaded(verb: str) -> None:
    for module in pkgutil.iter_modules(maglev_design.__path__):
        if module.name != "__main__":
            importlib.import_module(f"maglev_design.{module.name}")
    assert type(getattr(maglev_design, verb)).__name__ == "function"


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="tunes"):
        maglev_design.tunes  # noqa: B018


def test_a_record_answers_with_systems_of_python_control(tuned_record: DesignRecord) -> None:
    law, plant = tuned_record.controller(), tuned_record.plant()
    assert (law.dt, plant.dt) == (tuned_record.rig.sampling.period, 0)
    loop = control.feedback(control.c2d(plant, law.dt) * law, sign=1)
    design = tuned_record.design
    linear = loop_of(tuned_record.rig, design)
    row, _ = linear.characteristic(design.poles.values, design.Y, 1.0)
    assert np.poly([*loop.poles(), 0.0]) == pytest.approx(
        row.full().ravel() / float(row[0]), rel=1e-6
    )


# --- a record as a subject ------------------------------------------------------------------


@pytest.fixture(scope="module")
def narrow() -> DesignRecord:
    """A record made with another error of beta than its rig's 10 %."""
    return judged(PoleSpec.double(1.1, 75.0), beta_error=0.05)


def test_a_record_is_certified_over_the_family_that_it_was_made_for(narrow: DesignRecord) -> None:
    found = maglev_design.certify(narrow)
    over = found.assessment.subject.family
    assert over.as_data(narrow.rig.plant.gap_offset) == narrow.document["family"]
    assert over.ratios == (0.95, 1.05)
    assert {one.claim.ratios for one in found.certificates} == {
        (Fraction(19, 20), Fraction(21, 20))
    }
    assert found.assessment.subject.design == narrow.design
    assert found.certified
    for one in found.certificates:
        lost = replace(one, status=LmiStatus.UNSTABLE)
        others = tuple(lost if other is one else other for other in found.certificates)
        assert replace(found, certificates=others).certified == (one.claim.loop == "continuous")
    assert not replace(found, certificates=()).certified


def test_a_record_is_swept_over_the_family_that_it_was_made_for(
    narrow: DesignRecord, tmp_path: Path
) -> None:
    other = maglev_design.design(narrow.rig, 1, 60)
    found = maglev_design.sweep(narrow, [other], tmp_path / "record", samples=64)
    assert found.setup.designs == (narrow.design, other)
    assert found.setup.spreads["ratio"].reach == (0.95, 1.05)
    beside = maglev_design.sweep(narrow.rig, [narrow.design], tmp_path / "rig", samples=64)
    assert beside.setup.spreads["ratio"].reach == (0.9, 1.1)


def test_a_record_is_simulated_on_its_own_rig(narrow: DesignRecord) -> None:
    found = maglev_design.simulate(narrow, ratio=1.05, noise=True, seed=3)
    same = maglev_design.simulate(narrow.rig, narrow.design, ratio=1.05, noise=True, seed=3)
    assert found.gap.tobytes() == same.gap.tobytes()


@pytest.mark.parametrize("verb", ["simulate", "certify"])
def test_a_subject_has_one_controller(verb: str, narrow: DesignRecord) -> None:
    call = getattr(maglev_design, verb)
    with pytest.raises(InputError, match="brings its own controller"):
        call(narrow, narrow.design)
    with pytest.raises(InputError, match="a rig alone"):
        call(narrow.rig)
