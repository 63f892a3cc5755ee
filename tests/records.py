"""Design records for the tests of the reports: one tuned, others made of chosen poles."""

from __future__ import annotations

from typing import Any

from once import once
from recorded import recorded
from rigs import SHORT, rig_with

from maglev_design.controller.data import design_as_data
from maglev_design.controller.design import Design, PoleSpec, make_design
from maglev_design.options import SCHEMA_VERSION, Equilibrium, Method
from maglev_design.record import KIND, RECORD_VERSION, DesignRecord, rig_as_data
from maglev_design.rig import Rig
from maglev_design.tuning import TuneResult, build_problem, solve, trade_off
from maglev_design.tuning.document import difference_equation

HOSTILE = (
    "</script><b>\\input{x} \"q\" 's' `t` $\\frac{ %d {0} \n {{ x }} <<< y >>> <% z %> | & ~ ^ # _ "
    "\u2028 🧲 é ß µ 球 a*b*c ![i](j) --> \\end{document}"
)
"""A name that would break every form if it were not escaped."""


def tuned() -> DesignRecord:
    """Return a tuned design of a rig that is no preset, with all that a record can hold.

    The trade-off has one and the same certified error everywhere; nothing but its drawing is read.
    """
    return once("tuned", _tuned)


def _tuned() -> DesignRecord:
    problem = build_problem(
        rig_with(SHORT, {"uncertainty.beta": 0.1, "sampling.period": 0.002, "name": "short"})
    )
    result = solve(problem)
    assert isinstance(result, TuneResult)
    return recorded(result, trade_off(result, lambda _: 0.1, lambda *_: None))


def renamed(record: DesignRecord, text: str) -> DesignRecord:
    """Return a record whose rig has `text` wherever a user can write some."""
    rig = record.rig.model_copy(update={"name": text[:200], "notes": text, "source": text})
    document = {**record.document, "rig": rig_as_data(rig)}
    return DesignRecord(rig, record.design, document, record.curves)


def chosen(
    rig: Rig, poles: PoleSpec, method: Method = "tustin", equilibrium: Equilibrium = "model"
) -> DesignRecord:
    """Return as much of a record as the interactive figure reads, for poles of one's choice."""
    document: dict[str, Any] = {
        "rig": rig_as_data(rig),
        "bounds": {"zeta": [0.3, 3.0], "omega_n": [10.0, 500.0]},
        "beta_error": rig.uncertainty.beta,
    }
    design = make_design(rig, poles, method=method, equilibrium=equilibrium)
    return DesignRecord(rig, design, document, {})


def document_of(rig: Rig, design: Design, **more: Any) -> dict[str, Any]:
    """Return as much of a record as is read back before anything is done with it."""
    return {
        "schema_version": SCHEMA_VERSION,
        "record_version": RECORD_VERSION,
        "kind": KIND,
        "rig": rig_as_data(rig),
        "design": design_as_data(design),
        "gains": design.named_gains,
        "difference_equation": difference_equation(design),
        "controller_sha256": design.sha256,
        "beta_error_given": None,
        **more,
    }
