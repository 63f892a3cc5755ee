"""LaTeX of this program as MathML, which browsers draw without any script."""

from __future__ import annotations

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


@cache
def inline(latex: str) -> str:
    """Return a formula within a line."""
    return _converted(latex, "inline")


def displayed(rows: Sequence[tuple[str, str]]) -> str:
    """Return a displayed formula; rows are aligned where their two sides meet.

    The rows stand in a table of the page: browsers align no cells of MathML's own.
    """
    if len(rows) == 1:
        return _converted(" ".join(rows[0]), "block")
    sides = (f"<td>{_side(left)}</td><td>{_side(right)}</td>" for left, right in rows)
    body = "".join(f"<tr>{pair}</tr>" for pair in sides)
    return f'<table class="rows" role="presentation">{body}</table>'


def _side(latex: str) -> str:
    """Return one side as a line of text holds it, but as large as when displayed."""
    if not latex:
        return ""
    large = _converted(latex, "block")
    return large.replace(' display="block"', ' display="inline" displaystyle="true"', 1)


def _converted(latex: str, display: str) -> str:
    from latex2mathml.converter import convert  # noqa: PLC0415 - for this form alone

    for known, replacement in _REWRITTEN:
        latex = latex.replace(known, replacement)
    return str(convert(latex, display=display))
