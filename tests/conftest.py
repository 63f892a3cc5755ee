"""What several test modules need: the rigs, and hypothesis without a clock."""

from __future__ import annotations

import pytest
from exported import judged
from hypothesis import HealthCheck, settings
from rigs import OFFSET, SHORT, rig_with

from maglev_design.design import PoleSpec
from maglev_design.record import DesignRecord
from maglev_design.rig import Rig, load_rig

settings.register_profile(
    "repeatable",
    deadline=None,  # the first call derives the expressions
    derandomize=True,  # the same examples on every machine
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def paper_rig() -> Rig:
    """The rig of the paper: 7 s at 1 ms."""
    return load_rig("belmonte2021")


@pytest.fixture(scope="session")
def short_rig() -> Rig:
    """The paper's ball on a 0.4 s path."""
    return rig_with(SHORT)


@pytest.fixture(scope="session")
def offset_rig() -> Rig:
    """A rig with a gap offset."""
    return rig_with(OFFSET)


@pytest.fixture(scope="session")
def tuned_record() -> DesignRecord:
    """A design on a 0.4 s path as `tune` saves it, with a name that no target language can hold."""
    return judged(PoleSpec.double(1.1, 75.0))
