"""The claims of the paper judged, each on no more than it needs.

Sections 1 to 3 and Appendix A are proved in symbols where they can be and tried in numbers on rigs
that the paper does not know; a claim that is general has to hold on all of them. Sections 4 and 5
are decided by simulations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from inspect import signature

from maglev_design.paper import (
    equations,
    single_runs,
    surveyed,
    theory_appendix,
    theory_disturbances,
    theory_law,
    theory_path,
    theory_plant,
    theory_stability,
)
from maglev_design.paper.ledger import JUDGES, Claim, Statement
from maglev_design.paper.rigs import random_rigs
from maglev_design.paper.survey import Row, survey
from maglev_design.paper.theory_linear import TriedRig, tried_rigs
from maglev_design.rig import Rig

PARTS = (
    equations,
    theory_plant,
    theory_law,
    theory_disturbances,
    theory_path,
    theory_appendix,
    theory_stability,
    surveyed,
    single_runs,
)
"""The modules with the judges."""


@dataclass(frozen=True)
class Grounds:
    """What claims are judged on; an attribute is made when the first function asks for its name.

    Attributes
    ----------
    rig : Rig
        The paper's: its numbers are those of the evidence.
    rigs : int
        How many random rigs the general claims are tried on as well, each with poles of its own.
    seed : int
        Of those rigs, and of the noise where a run of its own is needed.
    progress : callable
    """

    rig: Rig
    rigs: int = 20
    seed: int = 0
    progress: Callable[[str, float], None] = lambda _stage, _done: None

    @cached_property
    def tried(self) -> tuple[TriedRig, ...]:
        """Return the rig, then the random ones."""
        return tried_rigs(self.rig, random_rigs(self.rigs, self.seed))

    @property
    def case(self) -> TriedRig:
        """Return the rig with the poles of the paper."""
        return self.tried[0]

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """Return every controller in every test under every reading."""
        return survey(self.rig, self.progress)


def judged(wanted: Sequence[Statement], grounds: Grounds) -> list[Claim]:
    """Return what became of claims."""
    claims = []
    for n, said in enumerate(wanted):
        grounds.progress(said.id, n / len(wanted))
        judge = JUDGES[said.id]
        needs = signature(judge.gather).parameters
        claims.append(judge(**{name: getattr(grounds, name) for name in needs}))
    return claims
