r"""Sentences with formulas between backticks, such as the reasons of the derivation.

Within backticks the letters have their names, as the terminal prints them: ``C_U_hat`` is
:math:`\hat{C}_U`, ``k3`` is :math:`k_3`, ``y_d`` is :math:`y_\delta`, ``u_d*`` is
:math:`u^*_\delta`.
"""

from __future__ import annotations

import re

from maglev_design.reporting.content import Inline, Maths, Runs
from maglev_design.reporting.escape import GREEK_NAMES, latex_text, markdown_maths, markdown_text

_NAME = re.compile(
    r"(?P<base>[A-Za-z]+)(?P<digits>\d*)(?:_(?!hat)(?P<sub>[A-Za-z0-9]+?))?(?P<hat>_hat)?"
    r"(?P<prime>'*)(?P<star>\^?\*)?(?![A-Za-z0-9_])"
)
_ROOT = re.compile(r"\\sqrt\(([^()]*)\)")
_POWER = re.compile(r"\^\(([^()]*)\)")
_FUNCTIONS = ("exp", "sqrt")


def formula(name: str) -> str:
    r"""Return a formula in the letters' names as LaTeX.

    Examples
    --------
    >>> print(formula("C_Y_hat/C_U_hat"), formula("k2 + C_Y'"), formula("u_d*"))
    \hat{C}_Y/\hat{C}_U k_2 + C_Y' u^*_\delta
    >>> print(formula("exp(+-sqrt(C_Y') T)"), formula("beta_c/beta"))
    \exp(\pm \sqrt{C_Y'} T) \beta_c/\beta
    """
    lettered = _POWER.sub(r"^{\1}", _ROOT.sub(r"\\sqrt{\1}", _NAME.sub(_letter, name)))
    return lettered.replace("+-", r"\pm ")


def _letter(found: re.Match[str]) -> str:
    base, below = found["base"], found["digits"] or found["sub"] or ""
    if base in GREEK_NAMES or base in _FUNCTIONS:
        base = "\\" + base
    if found["hat"]:
        base = rf"\hat{{{base}}}"
    if below == "d":
        below = r"\delta"
    elif len(below) > 1:
        below = rf"{{\mathrm{{{below}}}}}"
    star = "^*" if found["star"] else ""
    return base + star + (f"_{below}" if below else "") + found["prime"]


def plain(text: str) -> str:
    """Return a sentence as the terminal prints it."""
    return text.replace("`", "")


def runs(text: str) -> Runs:
    """Return a sentence as words and formulas."""
    parts: list[Inline] = list(text.split("`"))
    parts[1::2] = [Maths(formula(str(part))) for part in parts[1::2]]
    return tuple(part for part in parts if part)


def markdown(text: str) -> str:
    """Return a sentence as markdown with maths."""
    return "".join(
        f"${markdown_maths(run.latex)}$"
        if isinstance(run, Maths)
        else markdown_text(str(run), begins=n == 0)
        for n, run in enumerate(runs(text))
    )


def latex(text: str) -> str:
    """Return a sentence as LaTeX."""
    return "".join(
        f"${run.latex}$" if isinstance(run, Maths) else latex_text(str(run)) for run in runs(text)
    )
