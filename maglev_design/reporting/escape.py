"""Text that somebody typed, made harmless for each form a report is printed in."""

from __future__ import annotations

import re
import unicodedata

_MARKDOWN_SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|$~^&!])")
_MARKDOWN_MARK = re.compile(r"^(\s*)(?=[-+=](?:[\s=-]|$))|^(\s*\d+)(?=[.)](?:\s|$))")

_LATEX_SPECIAL = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "#": r"\#",
    "%": r"\%",
    "&": r"\&",
    "$": r"\$",
    "'": r"{'}",
    "`": r"{`}",
    '"': r"{\char34}",
    "|": "$|$",
    "<": "$<$",
    ">": "$>$",
    "°": r"$^\circ$",
    "±": r"$\pm$",
    "×": r"$\times$",
    "÷": r"$\div$",
    "·": r"$\cdot$",
    "µ": r"$\mu$",
    "−": r"$-$",
    "≤": r"$\le$",
    "≥": r"$\ge$",
    "≈": r"$\approx$",
    "∞": r"$\infty$",
    "→": r"$\to$",
    "–": "--",
    "—": "---",
    "‘": "`",
    "’": "'",
    "“": "``",
    "”": "''",
    "…": r"\ldots{}",
    "ß": r"\ss{}",
    "æ": r"\ae{}",
    "Æ": r"\AE{}",
    "œ": r"\oe{}",
    "Œ": r"\OE{}",
    "ø": r"\o{}",
    "Ø": r"\O{}",
    "ł": r"\l{}",
    "Ł": r"\L{}",
    "ı": r"\i{}",
    "Ω": r"$\Omega$",
}
_ACCENTS = {
    "\u0300": "`",
    "\u0301": "'",
    "\u0302": "^",
    "\u0303": "~",
    "\u0304": "=",
    "\u0306": "u",
    "\u0307": ".",
    "\u0308": '"',
    "\u030a": "r",
    "\u030b": "H",
    "\u030c": "v",
    "\u0327": "c",
}
GREEK_NAMES = (
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa"),
    *("lambda", "mu", "nu", "xi", "", "pi", "rho", "varsigma", "sigma", "tau", "upsilon"),
    *("phi", "chi", "psi", "omega"),
)
"""From alpha on; empty for omicron, which LaTeX writes as an o."""
_GREEK = {chr(0x3B1 + n): name for n, name in enumerate(GREEK_NAMES) if name}


def one_line(text: str) -> str:
    r"""Return `text` in one line, what cannot be printed replaced.

    Control characters, and those that turn the direction of writing, could move or hide what
    stands around them.

    Examples
    --------
    >>> one_line("two\nlines \u202e")
    'two lines �'
    """
    flat = " ".join(text.split())
    return "".join(c if c.isprintable() else "\ufffd" for c in flat)


def latex_text(text: str) -> str:
    r"""Return `text` as LaTeX for plain pdflatex; what its fonts lack by its code point.

    Examples
    --------
    >>> latex_text("\\input{x} à 球")
    '\\textbackslash{}input\\{x\\} \\`{a} {[U+7403]}'
    """
    return "".join(_latex_character(character) for character in text)


def _latex_character(character: str) -> str:
    if character in _LATEX_SPECIAL:
        return _LATEX_SPECIAL[character]
    if character.isascii():
        return character
    if character in _GREEK:
        return rf"$\{_GREEK[character]}$"
    base, *marks = tuple(unicodedata.normalize("NFD", character))
    if len(marks) == 1 and marks[0] in _ACCENTS and base.isascii() and base.isalpha():
        return rf"\{_ACCENTS[marks[0]]}{{{base}}}"
    return f"{{[U+{ord(character):04X}]}}"


def markdown_text(text: str, *, begins: bool = True) -> str:
    r"""Return `text` so that no renderer of markdown takes a part of it for markup.

    A list or a heading is made by what `begins` a line; the rest may stand there unescaped.

    Examples
    --------
    >>> markdown_text("<b> *d*")
    '\\<b\\> \\*d\\*'
    """
    marked = _MARKDOWN_SPECIAL.sub(r"\\\1", text)
    return _MARKDOWN_MARK.sub(r"\1\2\\", marked) if begins else marked


def markdown_line(text: str, *, begins: bool = True) -> str:
    """Return `text` in one line, what cannot be printed replaced, and nothing of it markup."""
    return markdown_text(one_line(text), begins=begins)


def markdown_code(text: str) -> str:
    """Return `text` in one line as code, fenced by more backticks than it has."""
    text = one_line(text)
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence = "`" * (longest + 1)
    pad = " " if text.startswith("`") or text.endswith("`") else ""
    return f"{fence}{pad}{text}{pad}{fence}"


def markdown_maths(latex: str) -> str:
    r"""Return a formula so that a code host does not take a part of it for emphasis.

    It reads emphasis before maths, and no maths where a space stands before the closing dollar.

    Examples
    --------
    >>> markdown_maths("y^*")
    'y^{\\ast}'
    """
    return latex.replace("*", r"{\ast}")
