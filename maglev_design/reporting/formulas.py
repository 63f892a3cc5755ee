r"""Expressions as LaTeX in the order in which a textbook writes them.

SymPy sorts by name. Here a product has its numbers and parameters before what moves,
:math:`k_1 \dot{e}`, and a sum falls in powers of s or z, then in derivatives, positive terms
before negative ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp
from sympy import Expr, Symbol
from sympy.printing.latex import LatexPrinter

ORDERS: Mapping[str, int] = {
    **dict.fromkeys(("y", "i", "u", "y_d", "u_d", "y_ref", "y_d*", "u_d*", "e", "t", "w"), 0),
    **dict.fromkeys(("v", "v_d", "v_ref", "v_d_hat", "e'", "x1'", "x2'"), 1),
    **dict.fromkeys(("acc", "acc_d", "acc_ref", "e''"), 2),
    "e'''": 3,
    "e''''": 4,
    **dict.fromkeys(("int(e)", "int(u_d)", "int(y_d)"), -1),
    "int(int(e))": -2,
    **dict.fromkeys(("v_d(0)", "x1", "x2", "f_d", "phi", "phi'", "phi''", "tau"), 0),
    **dict.fromkeys(("E(s)", "F_d(s)", "G(s)", "G_hat(s)", "R(s)", "s", "z"), 0),
}
"""What moves, by the names of the letters: how often it is differentiated."""
POWERS = {"s": 1, "z": 1, "tau": -1}
"""In whose powers a sum falls; it rises in the step's."""


def latex(expression: Any, names: Mapping[Symbol, str]) -> str:
    r"""Return an expression or a matrix as LaTeX, the letters as `names` has them.

    Examples
    --------
    >>> from maglev_design.symbolic.plant import e, k0, k1, s
    >>> print(latex(k0 + s * k1 + s**2, {k0: "k_0", k1: "k_1"}), latex(e * k1, {k1: "k_1"}))
    s^{2} + k_1 s + k_0 k_1 e
    """
    return str(_Printer(names).doprint(expression))


class _Printer(LatexPrinter):  # type: ignore[misc]  # SymPy has no types
    """SymPy's printer of LaTeX with another order of terms and factors."""

    def __init__(self, names: Mapping[Symbol, str]) -> None:
        super().__init__({"symbol_names": dict(names), "order": "none"})
        self.place = {symbol: n for n, symbol in enumerate(names)}

    def _as_ordered_terms(self, expr: Expr, order: str | None = None) -> list[Expr]:  # noqa: ARG002 - SymPy's
        return ordered_terms(expr)

    def _print_Mul(self, expr: Expr) -> str:
        if expr.could_extract_minus_sign():
            opposite = self._print(-expr)
            return rf"- \left({opposite}\right)" if (-expr).is_Add else f"- {opposite}"
        above, below = sp.fraction(expr)
        if below != 1:
            return rf"\frac{{{self._print(above)}}}{{{self._print(below)}}}"
        ordered = sorted(expr.as_ordered_factors(), key=self._product_key)
        return str(super()._print_Mul(sp.Mul(*ordered, evaluate=False)))

    def _product_key(self, factor: Expr) -> tuple[int, bool, int]:
        letters = factor.free_symbols
        place = max((self.place.get(letter, len(self.place)) for letter in letters), default=0)
        return (_kind(factor), not factor.as_base_exp()[0].is_Symbol, place)


def ordered_terms(total: Expr) -> list[Expr]:
    """Return the terms of a sum in the order in which they are written."""
    return sorted(total.as_ordered_terms(), key=_sum_key)


def _kind(factor: Expr) -> int:
    """Return a factor's rank: number, parameter, s or z, transform, signal."""
    moving = {letter.name for letter in factor.free_symbols if letter.name in ORDERS}
    if not moving:
        return 1 if factor.free_symbols else 0
    if moving <= {"s", "z"}:
        return 2
    return 3 if all(name.endswith("(s)") for name in moving) else 4


def _sum_key(term: Expr) -> tuple[int, bool, int]:
    above, below = sp.fraction(term)
    factors = above.as_powers_dict()
    degree = sum(POWERS.get(str(base), 0) * n for base, n in factors.items() if n.is_Integer)
    carriers = [base for base in factors if base.is_Symbol or below == 1]
    orders = [ORDERS.get(letter.name, 0) for base in carriers for letter in base.free_symbols]
    return (-int(degree), term.could_extract_minus_sign(), -max(orders, default=0))
