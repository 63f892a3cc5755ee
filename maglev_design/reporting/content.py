"""What a report says, whatever form it is printed in.

Text is data: each form escapes it in its own way. Mathematics is LaTeX made by this program, never
by a user. Numbers stay numbers with a unit until a form prints them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Maths:
    """A formula within a line of text, LaTeX without dollar signs."""

    latex: str


@dataclass(frozen=True)
class Code:
    """A command, a file or a key, in a fixed-width font."""

    text: str


@dataclass(frozen=True)
class Strong:
    """Text that stands out."""

    text: str


@dataclass(frozen=True)
class Quantity:
    """A number with its unit; None is printed as "none".

    Attributes
    ----------
    value : float or None
    unit : str
        As in the symbol table, "m^3/(s^2 V^2)"; "-" for none.
    digits : int
        Significant digits.
    """

    value: float | None
    unit: str = "-"
    digits: int = 4


@dataclass(frozen=True)
class Link:
    """A reference to a formula, table or figure by its id."""

    target: str


Inline = str | Maths | Code | Strong | Quantity | Link
Runs = tuple[Inline, ...]


@dataclass(frozen=True)
class Paragraph:
    """Running text."""

    runs: Runs


@dataclass(frozen=True)
class Bullets:
    """A list."""

    items: tuple[Runs, ...]


@dataclass(frozen=True)
class Formula:
    """A displayed formula.

    Attributes
    ----------
    rows : tuple of (str, str)
        LaTeX left and right of where the rows are aligned.
    tag : str
        The number it carries, the paper's where it has one; empty for none.
    """

    rows: tuple[tuple[str, str], ...]
    tag: str = ""


@dataclass(frozen=True)
class Table:
    """A table with a caption and the command that makes its numbers again.

    Attributes
    ----------
    id : str
    caption : Runs
    header : tuple of Runs
    rows : tuple of tuple of Runs
    command : str
    align : str
        A letter a column, ``l`` or ``r``; ``p`` for words that may take several lines.
    """

    id: str
    caption: Runs
    header: tuple[Runs, ...]
    rows: tuple[tuple[Runs, ...], ...]
    command: str
    align: str

    def __post_init__(self) -> None:
        widths = {len(self.align), len(self.header), *map(len, self.rows)}
        if len(widths) != 1:
            raise ValueError(f"table {self.id}: rows of different lengths: {sorted(widths)}")


Cell = Inline | Runs
"""Of a table: one run, or several."""


def tabled(
    name: str, caption: Cell, header: Iterable[Cell], rows: Iterable[Iterable[Cell]], *how: str
) -> Table:
    """Return a table whose cells may be single runs; `how` is its command and its alignment."""

    def runs(cells: Iterable[Cell]) -> tuple[Runs, ...]:
        return tuple(cell if isinstance(cell, tuple) else (cell,) for cell in cells)

    command, align = how
    (told,) = runs([caption])
    return Table(name, told, runs(header), tuple(map(runs, rows)), command, align)


def yes(holds: bool) -> Inline:
    """Return the word of a cell that says whether something holds."""
    return "yes" if holds else Strong("no")


@dataclass(frozen=True)
class Figure:
    """A figure that stands in a file, with the command that makes it again.

    Attributes
    ----------
    id : str
        Also the file's name without its ending.
    caption : Runs
    command : str
    """

    id: str
    caption: Runs
    command: str


@dataclass(frozen=True)
class Listing:
    """Lines as they are typed or stored."""

    text: str


@dataclass(frozen=True)
class Explorer:
    """The interactive figure; forms that cannot move say where it is.

    Attributes
    ----------
    data : dict
        Plain data for the page's script: see :mod:`maglev_design.reporting.explorer`.
    script : str
        The lowered programs as JavaScript.
    """

    data: dict[str, Any]
    script: str


Block = Paragraph | Bullets | Formula | Table | Figure | Listing | Explorer


@dataclass(frozen=True)
class ReportSection:
    """A heading and what stands under it; ``depth`` 1 is a chapter."""

    title: str
    blocks: tuple[Block, ...]
    depth: int = 1


@dataclass(frozen=True)
class Report:
    """A whole report."""

    title: str
    subtitle: str
    sections: tuple[ReportSection, ...]
    labels: dict[str, str] = field(init=False)
    """Id -> "Table 3", "Figure 1" or "(25)", in order of appearance."""

    def __post_init__(self) -> None:
        labels: dict[str, str] = {}
        counts = {Table: 0, Figure: 0}
        for block in self.blocks():
            if isinstance(block, Table | Figure):
                counts[type(block)] += 1
                label = f"{type(block).__name__} {counts[type(block)]}"
                _claimed(labels, block.id, label)
            elif isinstance(block, Formula) and block.tag:
                _claimed(labels, block.tag, f"({block.tag})")
        object.__setattr__(self, "labels", labels)

    def blocks(self) -> Iterator[Block]:
        """Yield every block in order."""
        for section in self.sections:
            yield from section.blocks

    def figures(self) -> tuple[Figure, ...]:
        """Return the figures in order."""
        return tuple(block for block in self.blocks() if isinstance(block, Figure))


def _claimed(labels: dict[str, str], key: str, label: str) -> None:
    if key in labels:
        raise ValueError(f"two blocks of a report are called {key!r}")
    labels[key] = label
