"""A straight-line program and its printings: CasADi graphs, NumPy callables, source text, JSON.

Every back end performs the same operations in the same order, so that in IEEE double precision
they agree to the last bit (C compiled with ``-ffp-contract=off``), except for ``exp``, ``log``,
``sinh``, ``cosh``, ``sin`` and ``cos``, which each language has from a library of its own, and for
min and max of nan or of zeros of both signs.
"""

from __future__ import annotations

import json
import keyword
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

Language = Literal["python", "c", "matlab", "javascript"]


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

    def evaluate(
        self,
        operators: Mapping[str, Callable[..., Any]],
        *values: Any,
        constant: Callable[[float], Any] = float,
    ) -> list[Any]:
        """Run the program on `values` with the given `operators`, one result an output.

        `constant` makes a value of a constant, for operators that take no plain floats.
        """
        if len(values) != len(self.inputs):
            raise TypeError(f"expected {len(self.inputs)} values: {', '.join(self.inputs)}")
        slots: list[Any] = list(values)
        for operation in self.operations[len(values) :]:
            if operation.name == "const":
                slots.append(constant(operation.constant))
            else:
                slots.append(operators[operation.name](*[slots[a] for a in operation.arguments]))
        return [slots[position] for position in self.results]

    def depending(self, names: Collection[str]) -> frozenset[str]:
        """Return the outputs that any of the inputs `names` enters.

        Examples
        --------
        >>> from sympy import symbols
        >>> from maglev_design.lowering import lower
        >>> x, y = symbols("x y")
        >>> sorted(lower((x, y), {"a": x + 1, "b": x * y, "c": 2 * y}).depending(["y"]))
        ['b', 'c']
        """
        touched = [name in names for name in self.inputs]
        for operation in self.operations[len(touched) :]:
            touched.append(any(touched[a] for a in operation.arguments))
        ends = zip(self.outputs, self.results, strict=True)
        return frozenset(name for name, position in ends if touched[position])

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

    def exact(self, *values: Fraction) -> list[Fraction]:
        """Return the outputs in rational arithmetic, nothing rounded.

        Raises
        ------
        ValueError
            When a constant of the program is not an integer over a small power of two, so that it
            may be a rounded one, or an operation leaves the rationals.
        ZeroDivisionError
        """
        for operation in self.operations:
            if not (operation.constant * _DYADIC).is_integer():
                raise ValueError(f"the constant {operation.constant!r} may have been rounded")
            if operation.name not in ("input", "const", *_EXACT_OPERATORS):
                raise ValueError(f"{operation.name} leaves the rationals")
        return [Fraction(value) for value in self.evaluate(_EXACT_OPERATORS, *values)]

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

    def to_json(self) -> str:
        """Return the program as JSON text, every constant to the last bit."""
        fields = (self.inputs, self.outputs, self.operations, self.results)
        return json.dumps(fields, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> Program:
        """Return the program of :meth:`to_json`.

        Raises
        ------
        ValueError
            When the text is no program: of another shape, with names that are none, an unknown
            operation or one that reads what comes later.
        """
        try:
            inputs, outputs, rows, results = json.loads(text)
            operations = tuple(Operation(str(n), tuple(a), float(c)) for n, a, c in rows)
            check_names(inputs, outputs)
            for position, (name, arguments, _) in enumerate(operations):
                if position < len(inputs):
                    sound = name == "input" and arguments == (position,)
                else:
                    sound = name in _ARITY and len(arguments) == _ARITY[name]
                    sound = sound and all(a in range(position) for a in arguments)
                if not sound:
                    raise ValueError(f"operation {position} is none")
            if len(outputs) != len(results) or not all(
                r in range(len(operations)) for r in results
            ):
                raise ValueError("results that are not there")
        except (TypeError, AttributeError, ValueError) as error:
            raise ValueError(f"not a program: {error}") from error
        return cls(tuple(inputs), tuple(outputs), operations, tuple(results))

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


def check_names(inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Raise `ValueError` unless the names are distinct and usable in every target language."""
    for name in (*inputs, *outputs):
        if not name.isidentifier() or keyword.iskeyword(name) or _is_reserved(name):
            raise ValueError(f"{name!r} cannot name a variable in every target language")
    if len(set(inputs)) != len(inputs) or set(inputs) & set(outputs):
        raise ValueError("inputs and outputs must have distinct names")


def _is_reserved(name: str) -> bool:
    return name[:1] == "t" and name[1:].isdigit()


_ARITY = {"const": 0, "neg": 1, "where": 3}
_ARITY |= dict.fromkeys(("sqrt", "exp", "log", "sinh", "cosh", "sin", "cos", "abs"), 1)
_ARITY |= dict.fromkeys(("add", "sub", "mul", "div", "min", "max", "lt", "le", "and", "or"), 2)
"""Of every operation but ``input``, how many values it reads."""


_NUMPY_OPERATORS: Mapping[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
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


_DYADIC = 2**10
"""Denominators of the constants that double precision certainly holds exactly."""

_EXACT_OPERATORS: Mapping[str, Callable[..., Any]] = {
    "add": lambda a, b: Fraction(a) + Fraction(b),
    "sub": lambda a, b: Fraction(a) - Fraction(b),
    "mul": lambda a, b: Fraction(a) * Fraction(b),
    "div": lambda a, b: Fraction(a) / Fraction(b),
    "neg": lambda a: -Fraction(a),
}


def _casadi_operators() -> Mapping[str, Callable[..., Any]]:
    import casadi as ca  # noqa: PLC0415 - heavy, and only this back end needs it

    return {
        **_NUMPY_OPERATORS,
        "sqrt": ca.sqrt,
        "exp": ca.exp,
        "log": ca.log,
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
        | {f: f"math.{f}({{}})" for f in ("sqrt", "exp", "log", "sinh", "cosh", "sin", "cos")}
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
        | {f: f"{f}({{}})" for f in ("sqrt", "exp", "log", "sinh", "cosh", "sin", "cos")}
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
        | {f: f"{f}({{}})" for f in ("sqrt", "exp", "log", "sinh", "cosh", "sin", "cos", "abs")}
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
    "javascript": _Syntax(
        _INFIX
        | {
            f: f"Math.{f}({{}})"
            for f in ("sqrt", "exp", "log", "sinh", "cosh", "sin", "cos", "abs")
        }
        | {
            "min": "{0} < {1} ? {0} : {1}",
            "max": "{0} > {1} ? {0} : {1}",
            "and": "{} && {}",
            "or": "{} || {}",
            "where": "{0} ? {1} : {2}",
        },
        "const {} = {};",
        "const {} = {};",
        "const {} = {};",
        "Infinity",
    ),
}
