from __future__ import annotations

import ctypes
import itertools
import math
import os
import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from browser import node
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import Expr

from maglev_design.lowering import Language, Program, lower
from maglev_design.options import METHODS, Method
from maglev_design.programs import (
    gains_program,
    metrics_program,
    reference_program,
    step_program,
)

Values = Sequence[float]
Back = Callable[..., Sequence[float]]

a, b, c = SYMBOLS = sp.symbols("a b c", real=True)
LANGUAGES: tuple[Language, ...] = ("python", "c", "matlab", "javascript")

ROUNDING = 1e-11
"""Relative to the sum of the magnitudes of what is added: a few hundred operations at 1.1e-16."""
DIGITS = 40
"""For sympy's evalf: far beyond double precision."""
LIBRARY = 4e-16
"""exp, sinh, cosh, sin and cos of different libraries differ by a unit in the last place or two."""


# --- back ends -----------------------------------------------------------------------------


def through_casadi(program: Program) -> Back:
    inputs = [ca.SX.sym(name) for name in program.inputs]
    function = ca.Function("f", inputs, [ca.vertcat(*program.casadi(*inputs))])
    return lambda *values: [float(x) for x in function(*values).full().ravel()]


def c_text(program: Program) -> str:
    reads = [f"const double {name} = given_values[{n}];" for n, name in enumerate(program.inputs)]
    declares = [f"double {name};" for name in program.outputs]
    writes = [f"result_values[{n}] = {name};" for n, name in enumerate(program.outputs)]
    body = "\n".join([*reads, *declares, *program.source("c"), *writes])
    return (
        "#include <math.h>\n#include <stdbool.h>\n"
        f"void run(const double *given_values, double *result_values) {{\n\n{body}\n}}\n"
    )


@pytest.fixture(scope="module")
def compile_c(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Program], Back]:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("no gcc")
    folder = tmp_path_factory.mktemp("compiled")
    numbers = itertools.count()

    def compiled(program: Program) -> Back:
        stem = folder / f"program{next(numbers)}"
        stem.with_suffix(".c").write_text(c_text(program), encoding="utf-8")
        flags = [
            "-std=c99",
            "-O2",
            "-ffp-contract=off",
            "-Wall",
            "-Wextra",
            "-pedantic",
            "-Werror",
            "-Wno-unused",
        ]
        subprocess.run(  # noqa: S603 - the compiler on the text above
            [gcc, *flags, "-shared", "-fPIC", f"{stem}.c", "-o", f"{stem}.so", "-lm"], check=True
        )
        run = ctypes.CDLL(f"{stem}.so").run

        def call(*values: float) -> list[float]:
            given = (ctypes.c_double * max(len(values), 1))(*values)
            result = (ctypes.c_double * len(program.outputs))()
            run(given, result)
            return list(result)

        return call

    return compiled


def bits(values: Values) -> list[bytes]:
    return [struct.pack("<d", float(x)) for x in values]


# --- random expressions --------------------------------------------------------------------

RATIONALS = st.fractions(-9, 9, max_denominator=20).map(
    lambda f: sp.Rational(*f.as_integer_ratio())
)
LEAVES = st.one_of(st.sampled_from(SYMBOLS), RATIONALS)


def combined(inner: st.SearchStrategy[Expr]) -> st.SearchStrategy[Expr]:
    pair = st.tuples(inner, inner)
    return st.one_of(
        pair.map(lambda p: p[0] + p[1]),
        pair.map(lambda p: p[0] - p[1]),
        pair.map(lambda p: p[0] * p[1]),
        pair.map(lambda p: p[0] / (2 + sp.Abs(p[1]))),
        inner.map(lambda x: sp.sqrt(1 + sp.Abs(x))),
        inner.map(lambda x: (1 + sp.Abs(x)) ** sp.Rational(-3, 2)),
        inner.map(sp.Abs),
        pair.map(lambda p: sp.Min(*p)),
        pair.map(lambda p: sp.Max(*p)),
        st.tuples(inner, inner, inner, inner).map(
            lambda p: sp.Piecewise((p[0], sp.StrictLessThan(p[2], p[3])), (p[1], True))
        ),
        st.tuples(inner, inner, inner).map(
            lambda p: sp.Piecewise(
                (p[0], sp.And(p[0] > p[1], sp.Or(p[1] <= p[2], p[0] >= 0))), (p[2], True)
            )
        ),
    )


EXPRESSIONS = st.recursive(LEAVES, combined, max_leaves=8)
# Powers of two and thirds of them: sums that are exact beside sums that are not.
POINTS = st.tuples(*[st.floats(-8, 8, allow_subnormal=False)] * 3)
PROGRAMS = 60
"""Random programs of six outputs each."""


@settings(max_examples=PROGRAMS)
@given(
    expressions=st.lists(EXPRESSIONS, min_size=1, max_size=6),
    points=st.lists(POINTS, min_size=1, max_size=8),
)
def test_every_back_end_gives_the_same_bits(
    compile_c: Callable[[Program], Back],
    expressions: list[Expr],
    points: list[tuple[float, float, float]],
) -> None:
    program = lower(SYMBOLS, {f"out{n}": x for n, x in enumerate(expressions)})
    backs = [program.numpy(), through_casadi(program), compile_c(program)]
    scalar = program.scalar()
    arrays = program.numpy()(*np.array(points).T)
    for n, point in enumerate(points):
        expected = scalar(*point)
        for back in backs:
            assert bits(back(*point)) == bits(expected)
        columns = [np.broadcast_to(x, len(points))[n] for x in arrays]
        assert bits(columns) == bits(expected)


def test_a_condition_on_a_piecewise_is_lowered() -> None:
    a, b, _ = SYMBOLS
    chosen = sp.Piecewise((sp.Integer(1), a < b), (sp.Integer(-1), True))
    for condition in (sp.ITE(a < b, a > 0, b > 1), sp.ITE(a < b, a < b, sp.false)):
        expression = sp.Piecewise((chosen, condition), (sp.Integer(7), True))
        run = lower(SYMBOLS, {"out": expression}).scalar()
        for point in [(0.5, 1, 0), (-0.5, 1, 0), (3, 2, 0), (3, 0.5, 0), (-2, -2, 0)]:
            exact = expression.subs(dict(zip(SYMBOLS, point, strict=True)))
            assert run(*point) == (float(exact),)


@settings(max_examples=PROGRAMS)
@given(expression=EXPRESSIONS, point=POINTS)
def test_a_program_computes_its_expression(
    expression: Expr, point: tuple[float, float, float]
) -> None:
    exact = dict(zip(SYMBOLS, (sp.Rational(x) for x in point), strict=True))
    if _near_a_switch(expression, exact):
        return
    (value,) = lower(SYMBOLS, {"out": expression}).scalar()(*point)
    expected = sp.N(expression.subs(exact), DIGITS)
    size = _magnitude(expression, exact)
    assert abs(value - float(expected)) <= ROUNDING * size


def _near_a_switch(expression: Expr, exact: dict[Expr, Expr]) -> bool:
    """Whether rounding may decide a comparison the other way."""
    return any(
        abs(sp.N((r.lhs - r.rhs).subs(exact), DIGITS)) < ROUNDING * 1e6
        for r in expression.atoms(sp.core.relational.Relational)
    )


def _magnitude(expression: Expr, exact: dict[Expr, Expr]) -> float:
    """Return the largest magnitude of any part of `expression`, one at least."""
    parts = [part for part in sp.preorder_traversal(expression) if isinstance(part, Expr)]
    sizes = [abs(float(sp.N(part.subs(exact), 20))) for part in parts]
    return math.prod(max(1.0, size) for size in sizes[:1]) + max(sizes) ** 2 + 1.0


inner = sp.Symbol("inner", real=True)
HIDDEN = {
    "product over factor": (a * b, inner / b),
    "factor over product": (a * b, a / inner),
    "quotient times divisor": (a / b, inner * b),
    "sum less term": (a + b, inner - b),
    "difference plus term": (a - b, inner + b),
    "square of a root": (sp.sqrt(a), inner * inner),
    "inverse of an inverse": (1 / a, 1 / inner),
    "product with an inverse": (1 / b, a * inner),
}
"""What algebra would shorten and rounding does not allow to: a definition, and what uses it."""


@pytest.mark.parametrize("name", HIDDEN)
def test_no_back_end_shortens_what_rounding_does_not_allow(
    compile_c: Callable[[Program], Back], name: str
) -> None:
    meaning, use = HIDDEN[name]
    program = lower([a, b], {"out": use}, {inner: meaning})
    backs = [program.numpy(), through_casadi(program), compile_c(program)]
    scalar = program.scalar()
    for point in np.random.default_rng(13).uniform(0.1, 5.0, size=(300, 2)):
        values = [float(x) for x in point]
        assert all(bits(back(*values)) == bits(scalar(*values)) for back in backs)


@pytest.mark.parametrize("method", METHODS)
def test_the_controller_gives_the_same_bits_everywhere(
    compile_c: Callable[[Program], Back], method: Method
) -> None:
    program = step_program(method)
    backs = [program.scalar(), program.numpy(), through_casadi(program), compile_c(program)]
    random = np.random.default_rng(11)
    for _ in range(300):
        values = random.normal(size=len(program.inputs)) * 10 ** random.uniform(-3, 3)
        expected = bits(backs[0](*[float(x) for x in values]))
        assert all(bits(back(*values)) == expected for back in backs[1:])


def test_the_metrics_and_the_gains_give_the_same_bits_everywhere(
    compile_c: Callable[[Program], Back],
) -> None:
    random = np.random.default_rng(12)
    for program in (metrics_program(), gains_program(), reference_program()):
        backs = [program.numpy(), through_casadi(program), compile_c(program)]
        scalar = program.scalar()
        for _ in range(300):
            values = [float(x) for x in random.uniform(0.01, 2.0, size=len(program.inputs))]
            assert all(bits(back(*values)) == bits(scalar(*values)) for back in backs)


def through_javascript(programs: Sequence[Program], points: Sequence[Sequence[Values]]) -> Any:
    """Return the outputs of every program at its own points, all from one run of Node."""
    functions = [
        f"({', '.join(program.inputs)}) => {{\n"
        + "\n".join(program.source("javascript"))
        + f"\nreturn [{', '.join(program.outputs)}];\n}}"
        for program in programs
    ]
    lists = [[[float(x) for x in point] for point in group] for group in points]
    return node(
        f"const run = [{', '.join(functions)}];\nconst points = {lists!r};\n"
        "answer(run.map((f, n) => points[n].map((point) => f(...point))));"
    )


def test_a_page_gives_the_same_bits() -> None:
    random = np.random.default_rng(14)
    programs = [
        lower(SYMBOLS, {"first": EVERYTHING["first"], "root": sp.sqrt(sp.Abs(a)) / (1 + b**7)}),
        lower(SYMBOLS, {"inside": sp.Piecewise((a, sp.Or(a < b, b <= c)), (sp.Max(b, c), True))}),
        *[step_program(method) for method in METHODS],
        metrics_program(),
        gains_program(),
        reference_program(),
    ]
    points = [random.uniform(0.01, 2.0, size=(100, len(x.inputs))).tolist() for x in programs]
    for program, group, found in zip(
        programs, points, through_javascript(programs, points), strict=True
    ):
        scalar = program.scalar()
        for point, values in zip(group, found, strict=True):
            expected = [x + 0.0 for x in scalar(*point)]  # JSON has no negative zero
            assert bits(values) == bits(expected)


def test_library_functions_of_a_page_agree_to_the_last_place() -> None:
    functions = (sp.exp, sp.sinh, sp.cosh, sp.sin, sp.cos)
    programs = [lower([a], {"out": function(a)}) for function in functions]
    where = [[float(x)] for x in np.linspace(-3, 3, 101)]
    for function, found in zip(
        functions, through_javascript(programs, [where] * len(functions)), strict=True
    ):
        expected = [getattr(math, function.__name__)(x) for (x,) in where]
        assert np.ravel(found) == pytest.approx(expected, rel=LIBRARY, abs=LIBRARY)


@pytest.mark.parametrize("function", [sp.exp, sp.sinh, sp.cosh, sp.sin, sp.cos])
def test_library_functions_agree_to_the_last_place(
    compile_c: Callable[[Program], Back], function: Callable[[Expr], Expr]
) -> None:
    program = lower([a], {"out": function(a)})
    reference = getattr(math, function.__name__)
    backs = [program.scalar(), program.numpy(), through_casadi(program), compile_c(program)]
    for x in np.linspace(-3, 3, 101):
        for back in backs:
            (value,) = back(float(x))
            assert value == pytest.approx(reference(x), rel=LIBRARY, abs=LIBRARY)


def test_powers_and_logarithms_agree_to_the_last_places(
    compile_c: Callable[[Program], Back],
) -> None:
    """A force that falls with a measured exponent; the base is positive."""
    program = lower([a, b], {"logarithm": sp.log(a), "power": a**b, "inverse": a ** (-b)})
    backs = [program.scalar(), program.numpy(), through_casadi(program), compile_c(program)]
    for x, y in np.random.default_rng(4).uniform(0.01, 4.0, size=(100, 2)).tolist():
        for back in backs:
            found = [float(value) for value in back(x, y)]
            assert found == pytest.approx([math.log(x), x**y, x**-y], rel=1e-14, abs=1e-14)


# --- determinism ---------------------------------------------------------------------------

HERE = str(Path(__file__).parent)
PRINT_ALL = """
from maglev_design import programs as p
from maglev_design.options import EQUILIBRIA, METHODS, PlantKind
from byhand import SOME
COIL = PlantKind(actuation="coil", damped=True, offset=True)
programs = [p.plant_program(), p.reference_program(), p.acceleration_program(),
    p.metrics_program(), p.drive_program(COIL), p.inductance_program(COIL),
    p.tangent_program(COIL), p.path_voltage_program(COIL), p.conditions_program(6)]
programs += [p.believed_program(reading) for reading in EQUILIBRIA]
for law in SOME:
    programs += [p.gains_program(law), p.slope_program(law), p.start_program(law),
        p.continuous_program(law), p.hurwitz_program(law)]
    for method in METHODS:
        programs += [p.step_program(method, law), p.feedforward_program(method, law),
            p.coefficients_program(method, law), p.sampled_loop_program(method, law)]
for one in programs:
    for language in ("python", "c", "matlab", "javascript"):
        print("\\n".join(one.source(language)))
"""


def test_another_process_with_other_hashes_writes_the_same_text(tmp_path: Path) -> None:
    """One derives everything anew, the other may read what a third process derived."""
    texts = [
        subprocess.run(  # noqa: S603 - our own interpreter and text
            [sys.executable, "-c", PRINT_ALL],
            env={
                **os.environ,
                "PYTHONHASHSEED": seed,
                "PYTHONPATH": os.pathsep.join((HERE, os.environ.get("PYTHONPATH", ""))),
                **cache,
            },
            capture_output=True,
            check=True,
        ).stdout
        for seed, cache in (("1", {}), ("4711", {"MAGLEV_DESIGN_CACHE": str(tmp_path)}))
    ]
    assert texts[0].count(b"\n") > 1000
    assert texts[0] == texts[1]


def test_the_order_of_construction_does_not_matter() -> None:
    forwards = a * b + c / (a + b) + sp.Max(a, b, c)
    backwards = sp.Max(c, b, a) + c / (b + a) + b * a
    assert lower(SYMBOLS, {"x": forwards}) == lower(SYMBOLS, {"x": backwards})


# --- refusals ------------------------------------------------------------------------------


def test_an_unknown_symbol_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="'stranger' is not among the inputs"):
        lower([a], {"out": a + sp.Symbol("stranger")})


def test_the_same_name_with_other_assumptions_is_another_symbol() -> None:
    with pytest.raises(ValueError, match="'a' is not among the inputs"):
        lower([sp.Symbol("a", real=True)], {"out": sp.Symbol("a", positive=True)})


@pytest.mark.parametrize("name", ["2a", "a b", "lambda", "x;y", "", "t3", "a-b", "u'"])
def test_a_name_that_some_language_cannot_take_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="cannot name a variable"):
        lower([sp.Symbol(name)], {"out": sp.Integer(1)})
    with pytest.raises(ValueError, match="cannot name a variable"):
        lower([a], {name: a})


def test_names_used_twice_are_refused() -> None:
    with pytest.raises(ValueError, match="distinct names"):
        lower([a], {"a": a})
    with pytest.raises(ValueError, match="distinct names"):
        lower([a, sp.Symbol("a", positive=True)], {"out": a})


@pytest.mark.parametrize(
    "expression",
    [
        sp.tan(a),
        a ** sp.Rational(1, 3),
        sp.pi * a,
        sp.I * a,
        sp.oo,
        sp.nan,
        sp.gamma(a),
        sp.Function("f")(a),
        sp.Derivative(sp.Function("f")(a), a),
        sp.Rational(10**400) * a,
        0.5 * a,
        sp.Piecewise((a, a > 0)),
        sp.Piecewise((a, sp.Eq(a, b)), (b, True)),
    ],
    ids=lambda x: str(x)[:30],
)
def test_what_has_no_lowering_is_refused(expression: Expr) -> None:
    with pytest.raises(ValueError, match=r"no lowering for|default case|too large"):
        lower(SYMBOLS, {"out": expression})


def test_a_wrong_number_of_values_is_refused() -> None:
    with pytest.raises(TypeError, match="expected 3 values: a, b, c"):
        lower(SYMBOLS, {"out": a}).numpy()(1.0, 2.0)


# --- text ----------------------------------------------------------------------------------

EVERYTHING = {
    "first": sp.Piecewise(
        (sp.Min(a, b), sp.And(a < b, sp.Or(b <= c, c > 2))), (sp.Max(a, c), True)
    ),
    "second": sp.sqrt(sp.Abs(a)) / (1 + b**2) + sp.exp(a) + sp.sinh(b) + sp.cosh(c) + sp.sin(a),
    "third": sp.cos(a) - a**7 + sp.Rational(-1, 3),
}


def test_matlab_text_has_no_syntax_of_another_language() -> None:
    lines = lower(SYMBOLS, EVERYTHING).source("matlab")
    text = "\n".join(lines)
    foreign = (r"\*\*", "math", "const", "double", "fabs", r"\?", "True", "False", " and ", " or ")
    assert [word for word in foreign if re.search(word, text)] == []
    assert " if " not in text.replace("\nif ", "\n")
    assert all(line.endswith((";", "end")) for line in lines)
    assert re.search(r"^if t\d+, t\d+ = .+; else, t\d+ = .+; end$", text, re.MULTILINE)


def test_python_text_is_one_assignment_a_line() -> None:
    for line in lower(SYMBOLS, EVERYTHING).source("python"):
        assert re.fullmatch(r"\w+ = [^;?&|]+", line)


def test_every_value_is_assigned_once_and_before_its_use() -> None:
    for language in LANGUAGES:
        known = {"a", "b", "c"}
        for line in lower(SYMBOLS, EVERYTHING).source(language):
            used = set(re.findall(r"\bt\d+\b", line))
            assigned = set(re.findall(r"\b(\w+) = ", line))
            assert used - assigned <= known
            assert not assigned & known
            known |= assigned


def test_a_common_part_is_computed_once() -> None:
    program = lower([a], {"x": sp.sqrt(1 + a**2) + 1, "y": 2 * sp.sqrt(1 + a**2)})
    assert sum(o.name == "sqrt" for o in program.operations) == 1


def test_definitions_stand_for_what_they_say() -> None:
    inner, outer = sp.symbols("inner outer", real=True)
    program = lower([a], {"out": outer - inner}, {inner: a + 1, outer: inner * inner})
    assert program.scalar()(3.0) == (12.0,)
    with pytest.raises(ValueError, match="'outer' is not among the inputs"):
        lower([a], {"out": a}, {inner: outer, outer: a})


@pytest.mark.parametrize("power", [2, 3, 7, 15, 16, 31])
def test_powers_are_products(power: int) -> None:
    program = lower([a], {"out": a**power})
    assert {o.name for o in program.operations} == {"input", "mul"}
    assert len(program.operations) <= 2 * power.bit_length()
    assert program.scalar()(2.0) == (2.0**power,)


def number_in(language: Language, value: Expr) -> float:
    (line,) = lower([], {"out": value}).source(language)
    text = line.removeprefix("const ").removeprefix("out = ").removesuffix(";")
    return float(text.removeprefix("(").removesuffix(")"))


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_a_constant_is_read_back_as_it_was(value: float) -> None:
    exact = sp.Rational(value)
    expected = value + 0.0  # a rational zero has no sign
    for language in LANGUAGES:
        assert bits([number_in(language, exact)]) == bits([expected])


@given(top=st.integers(-(10**30), 10**30), bottom=st.integers(1, 10**30))
def test_a_rational_constant_is_rounded_once(top: int, bottom: int) -> None:
    expected = float(Fraction(top, bottom))
    for language in LANGUAGES:
        assert number_in(language, sp.Rational(top, bottom)) == expected


def test_a_scalar_program_cannot_reach_beyond_its_text(tmp_path: Path) -> None:
    trap = tmp_path / "trap"
    name = f"__import__('pathlib').Path({str(trap)!r}).touch()"
    with pytest.raises(ValueError, match="cannot name a variable"):
        lower([sp.Symbol(name)], {"out": sp.Integer(1)}).scalar()
    assert not trap.exists()


def test_c_can_have_a_type_and_literals_of_its_own() -> None:
    lines = lower([a], {"x": 3 * a - sp.Rational(1, 2)}).source("c", real="real", literal="R({})")
    assert lines == ["const real t0 = R(3.0) * a;", "const real t1 = t0 - R(0.5);", "x = t1;"]


def test_a_program_knows_which_inputs_it_uses() -> None:
    assert lower([a, b, c], {"x": a * 2, "z": c}).used == {"a", "c"}


# --- rational arithmetic -------------------------------------------------------------------


def test_a_program_is_evaluated_exactly_over_the_rationals() -> None:
    expression = (a**3 - 2 * b) / (3 * a + c) - sp.Rational(1, 4) * b**-2
    program = lower(SYMBOLS, {"x": expression, "one": sp.Integer(1)})
    values = Fraction(1, 3), Fraction(-7, 5), Fraction(2, 11)
    exact = expression.subs(dict(zip(SYMBOLS, map(sp.Rational, values), strict=True)))
    assert program.exact(*values) == [Fraction(int(exact.p), int(exact.q)), Fraction(1)]


def test_a_constant_that_may_be_rounded_is_refused() -> None:
    with pytest.raises(ValueError, match="may have been rounded"):
        lower(SYMBOLS, {"x": a * sp.Rational(2, 3)}).exact(*[Fraction(1)] * 3)


def test_an_operation_that_leaves_the_rationals_is_refused() -> None:
    with pytest.raises(ValueError, match="sqrt leaves the rationals"):
        lower(SYMBOLS, {"x": sp.sqrt(a**2 + 1)}).exact(*[Fraction(1)] * 3)
