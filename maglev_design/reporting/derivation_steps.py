"""The derivation as plain data, kept in the cache folder: proving it takes seconds.

The entry is named after everything that decides what the derivation says, so that a changed
equation is never printed from an old entry.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from maglev_design.cache import kept, sources
from maglev_design.files import joint_hash
from maglev_design.programs import fingerprint

HERE = Path(__file__).parent
SOURCES = (
    HERE.parent / "derivation",
    HERE / "derivation_text.py",
    HERE / "formulas.py",
    Path(__file__),
)
"""Whose text decides what the derivation says, besides the programs."""


@dataclass(frozen=True)
class Step:
    """One equation of the derivation.

    Attributes
    ----------
    id, section, title, reason : str
        As :class:`maglev_design.derivation.terms.Equation` has them.
    rows : tuple of (str, str)
        LaTeX left and right of where the rows are aligned.
    residual : str or None
        "0" where it was proved, None for a postulate or a definition.
    """

    id: str
    section: str
    title: str
    reason: str
    rows: tuple[tuple[str, str], ...]
    residual: str | None


@dataclass(frozen=True)
class Derivation:
    """All steps, the letters they are written in, and the Routh array.

    Attributes
    ----------
    steps : tuple of Step
    symbols : tuple of (str, str, str)
        LaTeX, unit and meaning.
    routh : tuple of (str, tuple of str)
        LaTeX of the power of s and of the row's entries.
    """

    steps: tuple[Step, ...]
    symbols: tuple[tuple[str, str, str], ...]
    routh: tuple[tuple[str, tuple[str, ...]], ...]


def derivation_steps() -> Derivation:
    """Return the derivation, proved by this process or by one before it."""
    own = sources(*SOURCES)
    return kept("derivation", joint_hash(fingerprint(), *own), _proved, _read)


def _proved() -> str:
    import sympy as sp  # noqa: PLC0415 - only where the cache has nothing

    from maglev_design.derivation import NOTATION, derivation  # noqa: PLC0415
    from maglev_design.derivation import terms as d  # noqa: PLC0415
    from maglev_design.reporting.derivation_text import equation_rows, occurring  # noqa: PLC0415
    from maglev_design.reporting.formulas import latex  # noqa: PLC0415
    from maglev_design.symbolic.stability import routh_array  # noqa: PLC0415

    equations = derivation()
    names = {entry.symbol: entry.latex for entry in NOTATION}
    array = routh_array((sp.Integer(1), d.a3, d.a2, d.a1, d.a0))
    return json.dumps(
        asdict(
            Derivation(
                tuple(
                    Step(
                        e.id,
                        e.section,
                        e.title,
                        e.reason,
                        tuple(equation_rows(e, NOTATION)),
                        None if e.residual is None else str(e.residual),
                    )
                    for e in equations
                ),
                tuple((x.latex, x.unit, x.meaning) for x in occurring(equations, NOTATION)),
                tuple(
                    (
                        f"s^{len(array) - 1 - n}",
                        tuple(latex(entry, names) for entry in row),
                    )
                    for n, row in enumerate(array)
                ),
            )
        )
    )


def _read(text: str) -> Derivation:
    try:
        data = json.loads(text)
        return Derivation(
            tuple(
                Step(**{**step, "rows": tuple(map(tuple, step["rows"]))}) for step in data["steps"]
            ),
            tuple(map(tuple, data["symbols"])),
            tuple((power, tuple(entries)) for power, entries in data["routh"]),
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"not a derivation: {error}") from error
