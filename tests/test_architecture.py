"""Who may import whom: the floors of the house and its heavy libraries, read from the source."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import maglev_design

ROOT = Path(maglev_design.__file__).parent

FLOORS = {
    "errors": -2,
    "options": -1,
    "files": 0,
    "interrupt": 0,
    "parameters": 0,
    "symbolic": 1,
    "lowering": 1,  # SymPy's expressions, whatever they mean
    "programs": 2,
    "design": 3,
    "design_data": 4,
    "linear_loop": 4,  # stands on design
    "simulate": 4,
    "tune": 5,
    "derivation": 5,
    "sweep": 5,
    "certify": 5,
    "paper": 6,
    "record": 6,
    "export": 7,
    "report": 7,
    "cli": 8,
    "__main__": 9,
}
"""A module or package imports only from floors below its own, and from itself."""

HEAVY = {
    "sympy": {"symbolic", "lowering", "programs", "derivation", "certify", "paper", "report"},
    "mpmath": {"certify"},
    "casadi": {"lowering", "linear_loop", "simulate", "tune"},
    "cvxpy": {"certify"},
    "clarabel": {"certify"},
    "control": {"certify"},
    "matplotlib": {"report"},
    "jinja2": {"export", "report"},
    "typer": {"cli"},
    "rich": {"cli"},
    "pydantic": {"parameters"},
    "pydantic_core": {"parameters"},
    "dask": {"sweep"},
    "distributed": {"sweep"},
}
"""Where each heavy library may be imported, lazily or not."""

LATE = {
    "sympy",
    "mpmath",
    "casadi",
    "numpy",
    "control",
    "cvxpy",
    "clarabel",
    "scipy",
    "matplotlib",
    "pydantic",
    "rich",
    "jinja2",
    "dask",
    "distributed",
}
"""What the command line must not load before it knows that it needs it."""


def unit_of(path: Path) -> str:
    """Return the top-level module or package a file belongs to."""
    first = path.relative_to(ROOT).parts[0]
    return first.removesuffix(".py")


def files() -> list[Path]:
    return sorted(p for p in ROOT.rglob("*.py") if p != ROOT / "__init__.py")


def imported(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, dotted name) of every import of a file, wherever in it."""
    package = ["maglev_design", *path.relative_to(ROOT).parts[:-1]]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            start = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((node.lineno, f"{start}.{alias.name}") for alias in node.names)


def test_every_module_has_a_floor() -> None:
    assert {unit_of(path) for path in files()} - set(FLOORS) == set()


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(ROOT)))
def test_a_module_imports_only_from_floors_below(path: Path) -> None:
    own = unit_of(path)
    for line, name in imported(path):
        library, _, rest = name.partition(".")
        other = rest.partition(".")[0]
        if library != "maglev_design" or other in (own, "__version__"):
            continue
        assert FLOORS[other] < FLOORS[own], f"{path}:{line} imports {name}"


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(ROOT)))
def test_a_heavy_library_is_imported_only_where_it_belongs(path: Path) -> None:
    own = unit_of(path)
    for line, name in imported(path):
        allowed = HEAVY.get(name.partition(".")[0])
        assert allowed is None or own in allowed, f"{path}:{line} imports {name}"


def test_the_command_line_starts_without_any_heavy_library() -> None:
    code = "import sys, maglev_design.cli; print(*{n.partition('.')[0] for n in sys.modules})"
    loaded = subprocess.run(  # noqa: S603 - our own interpreter and text
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert LATE & set(loaded.stdout.split()) == set()


def test_the_symbolic_floor_reads_and_writes_nothing() -> None:
    for path in (ROOT / "symbolic").rglob("*.py"):
        names = {name.partition(".")[0] for _, name in imported(path)}
        outside = names - {"sympy", "maglev_design"}
        assert outside - set(sys.stdlib_module_names) == set(), path
        assert outside & {"os", "io", "pathlib", "subprocess", "sys", "json"} == set(), path
