"""The whole derivation, (1)-(29), Appendix A and the sampled forms, proved as it is built.

Each step is derived from the objects of
:mod:`maglev_design.symbolic`; the paper's form, corrected where the print
is wrong, stands beside it by hand, and the difference of the two is simplified to zero when
:func:`derivation` runs.
"""

from __future__ import annotations

from sympy import Expr, Symbol

from maglev_design.derivation import appendix, control, plant, sampling, terms
from maglev_design.derivation.terms import NOTATION, Equation, Line, Relation
from maglev_design.options import TAN_GPI, Controller
from maglev_design.programs.derived import gain_expressions
from maglev_design.symbolic.flatness import flat_model
from maglev_design.symbolic.linearisation import linearise
from maglev_design.symbolic.plant import magnetic_levitation

__all__ = [
    "NOTATION",
    "Equation",
    "Line",
    "Relation",
    "appendix",
    "control",
    "derivation",
    "gains",
    "plant",
    "sampling",
    "terms",
]


def gains(controller: Controller = TAN_GPI) -> dict[Symbol, Expr]:
    """Return a law's gains in (zeta_1, omega_1, zeta_2, omega_2) of its poles; (25) for TAN-GPI.

    Examples
    --------
    >>> [str(name) for name in gains()] == ["k0", "k1", "k2", "k3"]
    True
    """
    return dict(gain_expressions(controller))


def derivation() -> tuple[Equation, ...]:
    """Return every equation in order, each with the residual of its proof.

    Examples
    --------
    >>> {str(equation.residual) for equation in derivation()} == {"0", "None"}
    True
    """
    levitation = magnetic_levitation()
    lin = linearise(levitation)
    flat = flat_model(levitation, lin)
    return (
        *plant.model(levitation),
        *plant.linearisation(levitation, lin),
        *plant.linear_plant(levitation, lin, flat),
        *plant.flatness(levitation, lin, flat),
        *plant.error_dynamics(flat),
        *control.state_feedback(flat),
        *control.reconstruction(flat),
        *control.gpi_law(flat),
        *control.bounded_form(flat),
        *control.gains(),
        *plant.numbers(levitation),
        *appendix.reference(),
        *appendix.wrong_beta(levitation, lin, flat),
        *appendix.stability(),
        *sampling.sampling(),
    )
