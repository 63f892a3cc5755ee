"""The closed loop's CasADi step as C text, one statement an instruction, in vector lanes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import casadi as ca

from maglev_design.programs import metrics_program
from maglev_design.simulation import lanes
from maglev_design.simulation.grid import LoopGraph
from maglev_design.simulation.stepping import step_function

_FORMS: dict[int, str] = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_SQRT: "root({0})",
    ca.OP_EXP: "exponential({0})",
    ca.OP_LOG: "logarithm({0})",
    ca.OP_FABS: "absolute({0})",
    ca.OP_SIGN: "sign_of({0})",
    ca.OP_FLOOR: "lower({0})",
    ca.OP_FMIN: "smaller({0}, {1})",
    ca.OP_FMAX: "larger({0}, {1})",
    ca.OP_LT: "{0} < {1}",
    ca.OP_LE: "{0} <= {1}",
    ca.OP_EQ: "{0} == {1}",
    ca.OP_NE: "{0} != {1}",
    ca.OP_NOT: "opposite({0})",
    ca.OP_AND: "{0} & {1}",
    ca.OP_OR: "{0} | {1}",
    ca.OP_IF_ELSE_ZERO: "guarded({0}, {1})",
}
_LOGIC = frozenset({ca.OP_NOT, ca.OP_AND, ca.OP_OR})
_CONDITIONS = _LOGIC | {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}


Made = dict[str, tuple[int, list[str]]]
"""What each value is: operation and operands."""


def printed(
    function: ca.Function, head: str, read: Callable[[int, int], str], fixed: int | None = None
) -> str:
    """Return an SX function as C, one statement an instruction.

    A quotient by what stays during the run becomes a product with its reciprocal, which the
    compiler takes out of the loop, and so does each further quotient by one and the same value, as
    the slopes of a quotient are; it is rounded once more.

    Parameters
    ----------
    function : casadi.Function
    head : str
        Its signature; outputs are ``out0``, ``out1``, ...
    read : callable
        (input, element) -> how it is written.
    fixed : int, optional
        Position of the input that stays during the run.
    """
    names: dict[int, str] = {}
    stays: set[str] = set()
    conditions: set[str] = set()
    divisors: set[str] = set()
    made: Made = {}
    lines: list[tuple[str, str]] = []
    for k in range(function.n_instructions()):
        kind, name = function.instruction_id(k), f"w{k}"
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if kind == ca.OP_OUTPUT:
            value = _as_number(names[sources[0]], conditions)
            lines.append(("", f"out{targets[0]}[{targets[1]}] = {value};"))
            continue
        if kind == ca.OP_INPUT:
            text, constant = read(*sources), sources[0] == fixed
        elif kind == ca.OP_CONST:
            text = f"spread({_number(float(function.instruction_constant(k)))})"
            constant = fixed is not None
        else:
            operands = [names[s] for s in sources]
            made[name] = kind, operands
            constant = stays.issuperset(operands)
            text = (
                _choice(made, name, conditions)
                or _share(made, name)
                or (None if constant else _product(made, name, stays, divisors, conditions))
                or _operation(kind, operands, conditions)
            )
            if kind == ca.OP_DIV:
                divisors.add(operands[1])
        if constant:
            stays.add(name)
        if kind in _CONDITIONS:
            conditions.add(name)
        names[targets[0]] = name
        kept = "mask" if kind in _CONDITIONS else "real"
        lines.append((name, f"const {kept} {name} = {text};"))
    body = "\n    ".join(_needed(lines))
    return f"{head}\n{{\n    {body}\n}}\n"


def _needed(lines: list[tuple[str, str]]) -> list[str]:
    """Return the statements without the values that a choice has made superfluous."""
    used: set[str] = set()
    kept = []
    for name, text in reversed(lines):
        if not name or name in used:
            kept.append(text)
            used |= set(re.findall(r"\bw\d+\b", text.partition("=")[2]))
    return kept[::-1]


def _product(
    made: Made, name: str, stays: set[str], divisors: set[str], conditions: set[str]
) -> str | None:
    """Return a quotient by what stays, or by what was divided by before, as a product.

    With what stays in one factor, also where it stands in the product above; None for the rest.
    """
    kind, operands = made[name]
    if kind != ca.OP_DIV or operands[1] not in stays | divisors:
        return None
    above, below = operands
    form, factors = made.get(above, (None, []))
    kept = [x for x in factors if x in stays]
    if below in stays and form == ca.OP_MUL and len(kept) == 1:
        (moving,) = (x for x in factors if x not in stays)
        return f"{moving} * ({kept[0]} / {below})"
    return f"{_as_number(above, conditions)} * (1.0 / {_as_number(below, conditions)})"


def _operation(kind: int, operands: list[str], conditions: set[str]) -> str:
    """Return one operation; conditions stay conditions until one is used as a number."""
    asked = len(operands) if kind in _LOGIC else int(kind == ca.OP_IF_ELSE_ZERO)
    return _FORMS[kind].format(
        *(_as_condition(x, conditions) for x in operands[:asked]),
        *(_as_number(x, conditions) for x in operands[asked:]),
    )


def _as_number(name: str, conditions: set[str]) -> str:
    return f"truth({name})" if name in conditions else name


def _as_condition(name: str, conditions: set[str]) -> str:
    return name if name in conditions else f"({name} != 0.0)"


def _choice(made: Made, name: str, conditions: set[str]) -> str | None:
    """Return the sum (a where c, else 0) + (b where not c, else 0) as one choice; None for others.

    CasADi takes if_else apart into this sum.
    """
    kind, terms = made[name]
    parts = [made.get(term, (None, []))[0] for term in terms]
    if kind != ca.OP_ADD or parts != [ca.OP_IF_ELSE_ZERO] * 2:
        return None
    (first, a), (second, b) = (made[term][1] for term in terms)
    a, b = (_as_number(x, conditions) for x in (a, b))
    if made.get(second) == (ca.OP_NOT, [first]):
        return f"chosen({_as_condition(first, conditions)}, {a}, {b})"
    if made.get(first) == (ca.OP_NOT, [second]):
        return f"chosen({_as_condition(second, conditions)}, {b}, {a})"
    return None


def _share(made: Made, name: str) -> str | None:
    """Return (a <= b)/((a <= b) + (b <= a)) without a division; None for anything else.

    CasADi's slope of min and max: 1 for the one that is taken, 1/2 for each of two equal ones.
    """
    kind, operands = made[name]
    if kind != ca.OP_DIV:
        return None
    own, total = operands
    form, compared = made.get(own, (None, []))
    sign, terms = made.get(total, (None, []))
    if form != ca.OP_LE or sign != ca.OP_ADD or own not in terms:
        return None
    low, high = compared
    other = terms[1 - terms.index(own)]
    return f"shared({own}, {other})" if made.get(other) == (ca.OP_LE, [high, low]) else None


def _number(value: float) -> str:
    """Return a constant in C, to the last bit."""
    if math.isnan(value):
        return '__builtin_nan("")'
    if math.isinf(value):
        return "__builtin_inf()" if value > 0 else "-__builtin_inf()"
    return repr(value)


def source(loop: LoopGraph) -> str:
    """Return the C text of a loop's kernel."""
    step, width = step_function(loop), 1 + loop.directions
    size = len(loop.state_names)
    sizes = {
        "LANES": lanes.LANES,
        "N_STATE": size,
        "N_PARAMETER": len(loop.parameter_names),
        "N_INPUT": step.size1_in(2),
        "PIECES": loop.pieces,
        "NODES": (step.size1_in(2) - loop.pieces) // len(loop.reference_names),
        "NODES_A_PIECE": loop.nodes_a_piece,
        "DIRECTIONS": loop.directions,
        "N_FIGURES": lanes.figures_count(loop.directions),
        "ALIVE": loop.state_names.index("alive"),
    }
    defines = "".join(f"#define {name} {value}\n" for name, value in sizes.items())

    def of_step(position: int, element: int) -> str:
        name = ("state", "parameters", "inputs", "noise")[position]
        text = f"{name}[{element}]"
        return f"spread({text})" if name == "inputs" else text

    signature = (
        "static inline void step(const real *state, const real *parameters, const double *inputs,"
        " const real *noise, real *restrict out0, real *restrict out1, real *restrict out2)"
    )
    return "\n".join(
        [
            defines,
            lanes.resource("lanes.h"),
            "static inline real spread(double x);",
            printed(step, signature, of_step, fixed=1),
            *_measures(width),
            _KEEP,
            lanes.resource("kernel.c"),
        ]
    )


_KEEP = """
#define WIDTH (1 + DIRECTIONS)
static inline void keep_larger(real *held, const real *value, int stride, real counts)
{
    const mask better = (value[0] > held[0]) & (counts > 0.0);
    for (int d = 0; d < WIDTH; d++) held[d] = chosen(better, value[d * stride], held[d]);
}
static inline void keep_smaller(real *held, const real *value, int stride, real counts)
{
    const mask better = (value[0] < held[0]) & (counts > 0.0);
    for (int d = 0; d < WIDTH; d++) held[d] = chosen(better, value[d * stride], held[d]);
}
#undef WIDTH
"""


def _measures(width: int) -> list[str]:
    """Return the increments of the metrics with their slopes, with and without a sign change."""
    names = ("before", "now", "slope", "rate")
    texts = []
    for name, crossing in (("measure", False), ("measure_crossing", True)):
        values = [ca.SX.sym(f"{n}_value") for n in names]
        seeds = [ca.SX.sym(f"{n}_slopes", width - 1) for n in names]
        start, length = ca.SX.sym("start"), ca.SX.sym("length")
        before, now, slope, rate = values
        program = metrics_program(crossing)
        sums = ca.vertcat(*program.casadi(before, now, slope, rate, start, length))
        out = [sums]
        if width > 1:
            moved = ca.jtimes(sums, ca.vertcat(*values), ca.vertcat(*[s.T for s in seeds]))
            out.append(ca.vec(moved))
        inputs = [ca.vertcat(v, s) for v, s in zip(values, seeds, strict=True)]
        function = ca.Function(name, [*inputs, start, length], [ca.vertcat(*out)])

        def read(position: int, element: int) -> str:
            if position < len(names):
                return f"{names[position]}[{element}]"
            return f"spread({('start', 'length')[position - len(names)]})"

        arrays = ", ".join(f"const real *{n}" for n in names)
        head = f"static inline void {name}({arrays}, double start, double length, real *out0)"
        texts.append(printed(function, head, read))
    return texts
