"""The whole derivation, (1)-(29), Appendix A and the sampled forms, proved as it is built.

Each step is derived from the objects of this package; the paper's form, corrected where the print
is wrong, stands beside it by hand, and the difference of the two is simplified to zero when
:func:`derivation` runs.
"""

from __future__ import annotations

from maglev_design.symbolic import (
    derivation_appendix,
    derivation_control,
    derivation_plant,
    derivation_sampling,
    derivation_terms,
)
from maglev_design.symbolic.derivation_terms import NOTATION, Equation, Line, Relation
from maglev_design.symbolic.flatness import flat_model
from maglev_design.symbolic.linearisation import linearise
from maglev_design.symbolic.plant import magnetic_levitation

__all__ = ["NOTATION", "Equation", "Line", "Relation", "derivation"]


def derivation() -> tuple[derivation_terms.Equation, ...]:
    """Return every equation in order, each with the residual of its proof.

    Examples
    --------
    >>> {str(equation.residual) for equation in derivation()} == {"0", "None"}
    True
    """
    plant = magnetic_levitation()
    lin = linearise(plant)
    flat = flat_model(plant, lin)
    return (
        *derivation_plant.model(plant),
        *derivation_plant.linearisation(plant, lin),
        *derivation_plant.linear_plant(plant, lin, flat),
        *derivation_plant.flatness(plant, lin, flat),
        *derivation_plant.error_dynamics(flat),
        *derivation_control.state_feedback(flat),
        *derivation_control.reconstruction(flat),
        *derivation_control.gpi_law(flat),
        *derivation_control.bounded_form(flat),
        *derivation_control.gains(),
        *derivation_plant.numbers(plant),
        *derivation_appendix.reference(),
        *derivation_appendix.wrong_beta(plant, lin, flat),
        *derivation_appendix.stability(),
        *derivation_sampling.sampling(),
    )
