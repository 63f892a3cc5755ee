"""The text of sections 1 to 3 and of Appendix A, where mathematics decides without a simulation.

Each claim is proved in symbols where it can be, and tried in numbers on rigs that the paper does
not know; a claim that is general has to hold on all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

from maglev_design.paper.ledger import Claim
from maglev_design.paper.theory_appendix import appendix_claims
from maglev_design.paper.theory_disturbances import disturbance_claims, wrong_beta_claims
from maglev_design.paper.theory_law import law_claims
from maglev_design.paper.theory_linear import cases
from maglev_design.paper.theory_path import path_claims
from maglev_design.paper.theory_plant import plant_claims
from maglev_design.paper.theory_stability import stability_claims
from maglev_design.rig import Rig


def theory_claims(rig: Rig, rigs: Sequence[Rig]) -> tuple[Claim, ...]:
    """Return the claims that mathematics decides.

    Parameters
    ----------
    rig : Rig
        The paper's: its numbers are those of the evidence.
    rigs : sequence of Rig
        Others, on which the general claims are tried as well, each with poles of its own.
    """
    tried = cases(rig, rigs)
    return (
        *plant_claims(tried),
        *law_claims(tried),
        *disturbance_claims(tried),
        *path_claims(tried),
        *appendix_claims(tried),
        *wrong_beta_claims(tried),
        *stability_claims(tried),
    )
