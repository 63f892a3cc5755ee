"""The one door from SymPy to CasADi graphs, NumPy callables and source text.

Expressions become a straight-line program: elementary operations on numbered values, in one
fixed order, common subexpressions shared, integer powers as products, rational constants
correctly rounded. Every back end performs those same operations in that same order, so that in
IEEE double precision they agree to the last bit (C compiled with ``-ffp-contract=off``), except
for ``exp``, ``sinh``, ``cosh``, ``sin`` and ``cos``, which each language has from a library of its
own, and for min and max of nan or of zeros of both signs.
"""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
import sympy as sp
from sympy import Expr, Symbol
from sympy.logic.boolalg import Boolean

Language = Literal["python", "c", "matlab"]

_CALLS = {
    sp.exp: "exp",
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


class Operation(NamedTuple):
    """One elementary operation; ``arguments`` are positions of earlier values."""

    name: str
    arguments: tuple[int, ...]
    constant: float = 0.0


@dataclass(frozen=True)
class Program:
    """A straight-line program from named inputs to named outputs.

    Attributes
    ----------
    inputs : tuple of str
        In call order.
    outputs : tuple of str
        In the order of the returned values.
    operations : tuple of Operation
        The first ``len(inputs)`` read the inputs.
    results : tuple of int
        Positions of the outputs' values.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    operations: tuple[Operation, ...]
    results: tuple[int, ...]

    def evaluate(self, operators: Mapping[str, Callable[..., Any]], *values: Any) -> list[Any]:
        """Run the program on `values` with the given `operators`, one result an output."""
        if len(values) != len(self.inputs):
            raise TypeError(f"expected {len(self.inputs)} values: {', '.join(self.inputs)}")
        slots: list[Any] = list(values)
        for operation in self.operations[len(values) :]:
            if operation.name == "const":
                slots.append(operation.constant)
            else:
                slots.append(operators[operation.name](*[slots[a] for a in operation.arguments]))
        return [slots[position] for position in self.results]

    def casadi(self, *values: Any) -> list[Any]:
        """Return the outputs as CasADi expressions of the given CasADi `values`.

        CasADi's own simplifications, (a b)/b to a and the like, are off meanwhile: they round
        otherwise than the other back ends.
        """
        import casadi as ca  # noqa: PLC0415 - heavy, and only this back end needs it

        before = ca.GlobalOptions.getSimplificationOnTheFly()
        ca.GlobalOptions.setSimplificationOnTheFly(False)
        try:
            return self.evaluate(_casadi_operators(), *values)
        finally:
            ca.GlobalOptions.setSimplificationOnTheFly(before)

    def numpy(self) -> Callable[..., list[Any]]:
        """Return a callable for scalars and broadcasting arrays."""
        return lambda *values: self.evaluate(_NUMPY_OPERATORS, *values)

    def scalar(self) -> Callable[..., tuple[float, ...]]:
        """Return a fast callable for plain floats, compiled once from :meth:`source` text."""
        return self._scalar

    @cached_property
    def _scalar(self) -> Callable[..., tuple[float, ...]]:
        body = "\n".join(f"    {line}" for line in self.source("python"))
        arguments = ", ".join(self.inputs)
        returned = ", ".join(self.outputs)
        text = f"def program({arguments}):\n{body or '    pass'}\n    return ({returned},)\n"
        namespace: dict[str, Any] = {"math": math}
        exec(compile(text, "<lowered>", "exec"), namespace)  # noqa: S102 - text made above, names checked
        return namespace["program"]  # type: ignore[no-any-return]

    @property
    def used(self) -> frozenset[str]:
        """The inputs that some output depends on."""
        read = {a for operation in self.operations[len(self.inputs) :] for a in operation.arguments}
        read |= set(self.results)
        return frozenset(name for n, name in enumerate(self.inputs) if n in read)

    def source(self, language: Language, *, real: str = "double", literal: str = "{}") -> list[str]:
        """Return one statement a line, assigning every output from the inputs.

        Values that are used once are still named, ``t0``, ``t1``, ...: the order of the
        operations is what makes the languages agree.

        Parameters
        ----------
        language : {"python", "c", "matlab"}
        real : str
            C only: the type of a number.
        literal : str
            How a constant is wrapped; ``{}`` stands for its digits.
        """
        syntax = replace(
            _SYNTAX[language],
            real=_SYNTAX[language].real.replace("double", real),
            literal=literal,
        )
        names: list[str] = list(self.inputs)
        lines: list[str] = []
        for operation in self.operations[len(self.inputs) :]:
            if operation.name == "const":
                names.append(syntax.number(operation.constant))
                continue
            name = f"t{len(lines)}"
            operands = [names[a] for a in operation.arguments]
            text = syntax.forms[operation.name].format(*operands, name=name)
            lines.append(syntax.statement(operation.name, name, text))
            names.append(name)
        lines += [
            syntax.assign.format(output, names[position])
            for output, position in zip(self.outputs, self.results, strict=True)
        ]
        return lines


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
    >>> x = Symbol("x")
    >>> lower([x], {"cube": x**3}).source("c")
    ['const double t0 = x * x;', 'const double t1 = t0 * x;', 'cube = t1;']
    """
    names = [symbol.name for symbol in inputs]
    for name in [*names, *outputs]:
        if not name.isidentifier() or keyword.iskeyword(name) or _is_reserved(name):
            raise ValueError(f"{name!r} cannot name a variable in every target language")
    if len(set(names)) != len(names) or set(names) & set(outputs):
        raise ValueError("inputs and outputs must have distinct names")
    builder = _Builder(inputs)
    for symbol, meaning in (definitions or {}).items():
        builder.done[symbol] = builder.emit(sp.sympify(meaning))
    results = tuple(builder.emit(sp.sympify(expression)) for expression in outputs.values())
    return Program(tuple(names), tuple(outputs), tuple(builder.operations), results)


def _is_reserved(name: str) -> bool:
    return name[:1] == "t" and name[1:].isdigit()


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
            raise ValueError(f"no lowering for the power {base}**{exponent}")
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


_NUMPY_OPERATORS: Mapping[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "sin": np.sin,
    "cos": np.cos,
    "abs": np.abs,
    "min": np.fmin,
    "max": np.fmax,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "and": np.logical_and,
    "or": np.logical_or,
    "where": np.where,
}


def _casadi_operators() -> Mapping[str, Callable[..., Any]]:
    import casadi as ca  # noqa: PLC0415 - heavy, and only this back end needs it

    return {
        **_NUMPY_OPERATORS,
        "sqrt": ca.sqrt,
        "exp": ca.exp,
        "sinh": ca.sinh,
        "cosh": ca.cosh,
        "sin": ca.sin,
        "cos": ca.cos,
        "abs": ca.fabs,
        "min": ca.fmin,
        "max": ca.fmax,
        "and": ca.logic_and,
        "or": ca.logic_or,
        "where": ca.if_else,
    }


@dataclass(frozen=True)
class _Syntax:
    """How one language writes a statement; a form that starts with ``if`` is one by itself."""

    forms: Mapping[str, str]
    real: str
    logical: str
    assign: str
    infinity: str
    literal: str = "{}"

    def statement(self, operation: str, name: str, text: str) -> str:
        if text.startswith("if "):
            return text
        boolean = operation in ("lt", "le", "and", "or")
        return (self.logical if boolean else self.real).format(name, text)

    def number(self, value: float) -> str:
        """Return the shortest decimal that reads back as `value`."""
        if math.isinf(value):
            return self.infinity if value > 0 else f"(-{self.infinity})"
        digits = self.literal.format(repr(abs(value)))
        return digits if value >= 0 else f"(-{digits})"


_INFIX = {
    "add": "{} + {}",
    "sub": "{} - {}",
    "mul": "{} * {}",
    "div": "{} / {}",
    "neg": "-{}",
    "lt": "{} < {}",
    "le": "{} <= {}",
}

_SYNTAX: Mapping[Language, _Syntax] = {
    "python": _Syntax(
        _INFIX
        | {f: f"math.{f}({{}})" for f in ("sqrt", "exp", "sinh", "cosh", "sin", "cos")}
        | {
            "abs": "abs({})",
            "min": "{0} if {0} < {1} else {1}",
            "max": "{0} if {0} > {1} else {1}",
            "and": "{} and {}",
            "or": "{} or {}",
            "where": "{1} if {0} else {2}",
        },
        "{} = {}",
        "{} = {}",
        "{} = {}",
        "math.inf",
    ),
    "c": _Syntax(
        _INFIX
        | {f: f"{f}({{}})" for f in ("sqrt", "exp", "sinh", "cosh", "sin", "cos")}
        | {
            "abs": "fabs({})",
            "min": "({0} < {1}) ? {0} : {1}",
            "max": "({0} > {1}) ? {0} : {1}",
            "and": "{} && {}",
            "or": "{} || {}",
            "where": "{0} ? {1} : {2}",
        },
        "const double {} = {};",
        "const bool {} = {};",
        "{} = {};",
        "INFINITY",
    ),
    "matlab": _Syntax(
        _INFIX
        | {f: f"{f}({{}})" for f in ("sqrt", "exp", "sinh", "cosh", "sin", "cos", "abs")}
        | {
            "min": "min({}, {})",
            "max": "max({}, {})",
            "and": "{} && {}",
            "or": "{} || {}",
            "where": "if {0}, {name} = {1}; else, {name} = {2}; end",
        },
        "{} = {};",
        "{} = {};",
        "{} = {};",
        "Inf",
    ),
}
