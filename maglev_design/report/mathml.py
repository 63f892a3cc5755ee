"""LaTeX of this program as MathML, which browsers draw without any script."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

_REWRITTEN = (
    (r"\bigl(", r"\left("),
    (r"\bigr)", r"\right)"),
    (r"\!", ""),
    (r"\lvert", "|"),
    (r"\rvert", "|"),
)
"""What the converter does not know, and what it knows it by."""
_ROW = re.compile(r"<mrow>(.*)</mrow></math>$", re.DOTALL)


@cache
def inline(latex: str) -> str:
    """Return a formula within a line."""
    return _converted(latex, "inline")


def displayed(rows: Sequence[tuple[str, str]]) -> str:
    """Return a displayed formula; rows are aligned where their two sides meet."""
    if len(rows) == 1:
        return _converted(" ".join(rows[0]), "block")
    cells = "".join(
        f'<mtr><mtd class="left">{_inner(left)}</mtd><mtd class="right">{_inner(right)}</mtd></mtr>'
        for left, right in rows
    )
    return (
        '<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">'
        f'<mtable displaystyle="true">{cells}</mtable></math>'
    )


def _converted(latex: str, display: str) -> str:
    from latex2mathml.converter import convert  # noqa: PLC0415 - for this form alone

    for known, replacement in _REWRITTEN:
        latex = latex.replace(known, replacement)
    return str(convert(latex, display=display))


def _inner(latex: str) -> str:
    found = _ROW.search(_converted(latex, "block")) if latex else None
    return f"<mrow>{found[1]}</mrow>" if found else ""
