"""From SymPy expressions to elementary operations, in one fixed order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import sympy as sp
from sympy import Expr, Symbol
from sympy.logic.boolalg import Boolean

from maglev_design.lowering.program import Operation

_CALLS = {
    sp.exp: "exp",
    sp.log: "log",
    sp.sinh: "sinh",
    sp.cosh: "cosh",
    sp.sin: "sin",
    sp.cos: "cos",
    sp.Abs: "abs",
}
_RELATIONS = {
    sp.StrictLessThan: ("lt", False),
    sp.LessThan: ("le", False),
    sp.StrictGreaterThan: ("lt", True),
    sp.GreaterThan: ("le", True),
}


def emitted(
    inputs: Sequence[Symbol], outputs: Sequence[Expr], definitions: Mapping[Symbol, Expr]
) -> tuple[tuple[Operation, ...], tuple[int, ...]]:
    """Return the operations and the positions of the outputs, as :class:`Program` has them."""
    builder = _Builder(inputs)
    for symbol, meaning in definitions.items():
        builder.done[symbol] = builder.emit(sp.sympify(meaning))
    results = tuple(builder.emit(sp.sympify(expression)) for expression in outputs)
    return tuple(builder.operations), results


class _Builder:
    """Emits operations, each distinct one once."""

    def __init__(self, inputs: Sequence[Symbol]) -> None:
        self.operations: list[Operation] = []
        self.known: dict[Operation, int] = {}
        self.done: dict[Expr, int] = {}
        for position, symbol in enumerate(inputs):
            self.operations.append(Operation("input", (position,)))
            self.done[symbol] = position

    def add(self, name: str, *arguments: int, constant: float = 0.0) -> int:
        operation = Operation(name, arguments, constant)
        if operation not in self.known:
            self.known[operation] = len(self.operations)
            self.operations.append(operation)
        return self.known[operation]

    def emit(self, expression: Expr | Boolean) -> int:
        if expression not in self.done:
            self.done[expression] = self._emit(expression)
        return self.done[expression]

    def _emit(self, x: Any) -> int:  # noqa: PLR0911 - one case a kind of expression
        if x.is_Symbol:
            raise ValueError(f"symbol {x.name!r} is not among the inputs")
        if x.is_Rational:
            return self.add("const", constant=_rounded(x))
        if x.is_Add:
            return self._sum(x)
        if x.is_Mul:
            return self._product(x)
        if x.is_Pow:
            return self._power(x.base, x.exp)
        if x.func in _CALLS:
            return self.add(_CALLS[x.func], self.emit(x.args[0]))
        if x.func in (sp.Min, sp.Max):
            return self._fold("min" if x.func is sp.Min else "max", _ordered(x.args))
        if x.func in _RELATIONS:
            name, swapped = _RELATIONS[x.func]
            left, right = (x.rhs, x.lhs) if swapped else (x.lhs, x.rhs)
            return self.add(name, self.emit(left), self.emit(right))
        if x.func in (sp.And, sp.Or):
            return self._fold("and" if x.func is sp.And else "or", _ordered(x.args))
        if x.func is sp.ITE:  # what SymPy makes of a Piecewise inside a condition
            return self.emit(x.to_nnf())
        if x.func is sp.Piecewise:
            return self._piecewise(x)
        raise ValueError(f"no lowering for {x.func.__name__} in {x}")

    def _fold(self, name: str, terms: Iterable[Any]) -> int:
        first, *others = [self.emit(term) for term in terms]
        for other in others:
            first = self.add(name, first, other)
        return first

    def _sum(self, x: Any) -> int:
        positive = [a for a in _ordered(x.args) if not a.could_extract_minus_sign()]
        negative = [-a for a in _ordered(x.args) if a.could_extract_minus_sign()]
        if not positive:
            return self.add("neg", self._fold("add", negative))
        total = self._fold("add", positive)
        for term in negative:
            total = self.add("sub", total, self.emit(term))
        return total

    def _product(self, x: Any) -> int:
        coefficient, factors = x.as_coeff_mul()
        if coefficient.is_negative:
            return self.add("neg", self.emit(-x))
        above = [f for f in _ordered(factors) if not _is_inverse(f)]
        below = [1 / f for f in _ordered(factors) if _is_inverse(f)]
        if not above:
            above = [sp.Integer(coefficient.p)]
            below = ([sp.Integer(coefficient.q)] if coefficient.q != 1 else []) + below
        elif coefficient != 1:
            above = [coefficient, *above]
        # a quotient, and no product with a reciprocal: x/x is 1 to the last bit, so that a move
        # ends at rest
        numerator = self._fold("mul", above or [sp.Integer(1)])
        return self.add("div", numerator, self._fold("mul", below)) if below else numerator

    def _power(self, base: Any, exponent: Any) -> int:
        if exponent.is_negative:
            return self.add("div", self.emit(sp.Integer(1)), self._power(base, -exponent))
        if exponent == sp.Rational(1, 2):
            return self.add("sqrt", self.emit(base))
        if exponent.is_Rational and exponent.q == 2:
            return self.add(
                "mul",
                self._power(base, exponent - sp.Rational(1, 2)),
                self._power(base, sp.Rational(1, 2)),
            )
        if not exponent.is_Integer:
            if exponent.is_number:
                raise ValueError(f"no lowering for the power {base}**{exponent}")
            # of a positive base, as a force that falls with a measured exponent is written
            return self.emit(sp.exp(exponent * sp.log(base)))
        count = int(exponent)
        if count == 1:
            return self.emit(base)
        half = self._power(base, sp.Integer(count // 2))
        square = self.add("mul", half, half)
        return self.add("mul", square, self.emit(base)) if count % 2 else square

    def _piecewise(self, x: Any) -> int:
        *cases, (last, default) = x.args
        if default is not sp.true:
            raise ValueError("a Piecewise must end with a default case")
        result = self.emit(last)
        for value, condition in reversed(cases):
            result = self.add("where", self.emit(condition), self.emit(value), result)
        return result


def _ordered(terms: Iterable[Any]) -> list[Any]:
    return sorted(terms, key=sp.default_sort_key)


def _is_inverse(x: Any) -> bool:
    return bool(x.is_Pow and x.exp.is_negative)


def _rounded(x: Any) -> float:
    try:
        return float(Fraction(int(x.p), int(x.q)))
    except OverflowError as error:
        raise ValueError("a constant is too large for double precision") from error
