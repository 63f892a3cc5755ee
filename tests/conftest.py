"""What several test modules need: the rigs, hypothesis without a clock, the order of the tests."""

from __future__ import annotations

import tempfile
from typing import Any

import once
import pytest
import scheduling
from exported import judged
from hypothesis import HealthCheck, settings
from rigs import OFFSET, SHORT, rig_with

from maglev_design.controller.design import PoleSpec
from maglev_design.derivation import Equation, derivation
from maglev_design.paper import claims
from maglev_design.paper.ledger import Claim, chosen
from maglev_design.paper.survey import Row, survey
from maglev_design.record import DesignRecord
from maglev_design.rig import Rig, load_rig

settings.register_profile(
    "repeatable",
    deadline=None,  # the first call derives the expressions
    derandomize=True,  # the same examples on every machine
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")

FOLDER = pytest.StashKey[tempfile.TemporaryDirectory[str] | None]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[FOLDER] = once.begin()


def pytest_unconfigure(config: pytest.Config) -> None:
    once.end(config.stash[FOLDER])


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: scheduling.order(item.nodeid))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    if config.getvalue("dist") == "loadgroup":
        return scheduling.scheduler(config, log)
    return None


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
    return once.once("tuned_record", lambda: judged(PoleSpec.double(1.1, 75.0)))


@pytest.fixture(scope="session")
def short_survey(short_rig: Rig) -> tuple[Row, ...]:
    """Every reading of the paper on the 0.4 s path."""
    return once.once("short_survey", lambda: survey(short_rig))


@pytest.fixture(scope="session")
def derived() -> tuple[Equation, ...]:
    """The derivation, proved as it is built."""
    return once.once("derived", derivation)


@pytest.fixture(scope="session")
def paper_claims(paper_rig: Rig, short_survey: tuple[Row, ...]) -> tuple[Claim, ...]:
    """The ledger of the paper's rig and six others; what many runs decide, on the short path."""

    def made() -> tuple[Claim, ...]:
        grounds = claims.Grounds(paper_rig, rigs=6, seed=17)
        grounds.__dict__["rows"] = short_survey
        return tuple(claims.judged(chosen(None), grounds))

    return once.once("paper_claims", made)
