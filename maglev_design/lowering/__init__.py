"""The one door from SymPy to CasADi graphs, NumPy callables and source text.

Expressions become a straight-line program: elementary operations on numbered values, in one
fixed order, common subexpressions shared, integer powers as products, rational constants
correctly rounded (:func:`lower`). What a program can be printed as: :class:`Program`. SymPy is
imported when something is lowered; a program that exists does without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from maglev_design.lowering.program import Language, Operation, Program, check_names

if TYPE_CHECKING:
    from sympy import Expr, Symbol

__all__ = ["Language", "Operation", "Program", "lower"]


def lower(
    inputs: Sequence[Symbol],
    outputs: Mapping[str, Expr],
    definitions: Mapping[Symbol, Expr] | None = None,
) -> Program:
    """Return the straight-line program that computes `outputs` from `inputs`.

    Parameters
    ----------
    inputs : sequence of Symbol
        In call order; every free symbol of the outputs must be among them.
    outputs : mapping of str to Expr
        Names and expressions; made of +, -, *, /, integer and half-integer powers, Min, Max, Abs,
        Piecewise, exp, sinh, cosh, sin, cos and rational constants.
    definitions : mapping of Symbol to Expr, optional
        Intermediate symbols and what they stand for, in an order in which each uses earlier ones.

    Raises
    ------
    ValueError
        For an unknown symbol, an unusable name or a construct that has no lowering.

    Examples
    --------
    >>> from sympy import Symbol
    >>> x = Symbol("x")
    >>> lower([x], {"cube": x**3}).source("c")
    ['const double t0 = x * x;', 'const double t1 = t0 * x;', 'cube = t1;']
    """
    from maglev_design.lowering.emission import emitted  # noqa: PLC0415 - imports SymPy

    names = tuple(symbol.name for symbol in inputs)
    check_names(names, tuple(outputs))
    return Program(names, tuple(outputs), *emitted(inputs, [*outputs.values()], definitions or {}))
