"""The floors of the house, its circles, its heavy libraries, its names: read from the source."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

import maglev_design

ROOT = Path(maglev_design.__file__).parent
README = Path(__file__).parent.parent / "README.md"


@dataclass(frozen=True)
class Floor:
    """Some modules and packages that do not know one another, and what lives in them.

    On an `open` floor they may, but for circles.
    """

    name: str
    rooms: tuple[str, ...]
    what: str
    open: bool = False


FLOORS = (
    Floor(
        "ground",
        ("errors", "options", "figures", "files", "arrays", "cache", "interrupt", "tools"),
        "the words a user may choose from, the figures that are told, files that are whole, the "
        "arrays in them, the cache folder, Ctrl-C, other programs run with a limit of time",
        open=True,
    ),
    Floor(
        "statement",
        ("rig", "symbolic", "lowering"),
        "a rig's numbers with their units; the mathematics, stated once, in SymPy; what carries an "
        "expression as one straight-line program to CasADi, NumPy and source text",
    ),
    Floor(
        "programs",
        ("programs",),
        "every lowered program by its name, derived once and kept",
    ),
    Floor(
        "controller",
        ("controller",),
        "rig, poles and a reading of the equilibrium to one controller; the plants that it meets",
    ),
    Floor(
        "loop",
        ("linear_loop", "simulation"),
        "its loop, linear and nonlinear: interpreted, as compiled C in "
        "vector lanes, and once more, independently, with SciPy",
    ),
    Floor(
        "work",
        ("certification", "derivation", "sweeping", "tuning"),
        "proofs, the derivation told with a proof of every equation, drawn rigs, the search",
    ),
    Floor(
        "record",
        ("paper", "record"),
        "what is about this one paper, and nothing else is; the saved design",
    ),
    Floor("out", ("exporting", "reporting"), "what is printed to run, and what is told"),
    Floor(
        "door",
        ("chain", "cli", "__main__"),
        "the chain as functions; parse, call, print, exit",
        open=True,
    ),
)
"""From the ground up; the README shows this table."""

LEVEL = {room: n for n, floor in enumerate(FLOORS) for room in floor.rooms}

HEAVY = {
    "sympy": {
        "symbolic",
        "lowering",
        "programs",
        "derivation",
        "certification",
        "paper",
        "reporting",
    },
    "flint": {"certification"},
    "casadi": {"lowering", "linear_loop", "simulation", "tuning"},
    "cvxpy": {"certification"},
    "clarabel": {"certification"},
    "control": {"certification", "record"},
    "matplotlib": {"reporting"},
    "jinja2": {"exporting", "reporting"},
    "typer": {"cli"},
    "rich": {"cli"},
    "pydantic": {"rig"},
    "pydantic_core": {"rig"},
    "dask": {"sweeping"},
    "distributed": {"sweeping"},
}
"""Where each heavy library may be imported, lazily or not."""

LONGEST = 450
"""Lines of a module."""

LATE = {
    "sympy",
    "mpmath",
    "flint",
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


def module_of(path: Path) -> str:
    """Return the dotted name of a file's module."""
    parts = ["maglev_design", *path.relative_to(ROOT).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def for_types_alone(tree: ast.AST) -> set[ast.AST]:
    """Return all nodes that only a type checker reads."""
    return {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for statement in node.body
        for inner in ast.walk(statement)
    }


def imported(path: Path, *, types: bool = True) -> Iterator[tuple[int, str]]:
    """Yield (line, dotted name) of every import of a file, wherever in it.

    Without `types` only what is imported when the program runs, at once or later.
    """
    package = ["maglev_design", *path.relative_to(ROOT).parts[:-1]]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    left_out = set() if types else for_types_alone(tree)
    for node in ast.walk(tree):
        if node in left_out:
            continue
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            start = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((node.lineno, f"{start}.{alias.name}") for alias in node.names)


def uses() -> dict[str, set[str]]:
    """Return which modules of this program each module imports, at once or later."""
    modules = {module_of(path): path for path in files()}

    def meant(name: str) -> str | None:
        """Return the module that an imported name is, or is taken from."""
        return next((x for x in (name, name.rpartition(".")[0]) if x in modules), None)

    return {
        own: {other for _, name in imported(path, types=False) if (other := meant(name))} - {own}
        for own, path in modules.items()
    }


def circle(graph: Mapping[str, Collection[str]]) -> list[str]:
    """Return one circle of a graph, its first node again at the end; nothing without one."""
    done: set[str] = set()

    def walked(path: list[str]) -> list[str]:
        for other in sorted(graph[path[-1]]):
            if other in path:
                return [*path[path.index(other) :], other]
            if other not in done and (found := walked([*path, other])):
                return found
        done.add(path[-1])
        return []

    return next((found for node in sorted(graph) if (found := walked([node]))), [])


def test_every_module_has_one_floor() -> None:
    rooms = [room for floor in FLOORS for room in floor.rooms]
    assert sorted(rooms) == sorted({unit_of(path) for path in files()})


def test_the_house_has_nine_floors_at_most() -> None:
    assert len(FLOORS) <= 9


def test_the_readme_shows_the_floors() -> None:
    lines = ["| floor | rooms | what lives there |", "|---|---|---|"]
    for floor in FLOORS:
        rooms = ", ".join(f"`{room}`" for room in floor.rooms)
        lines.append(f"| {floor.name} | {rooms} | {floor.what} |")
    shown = README.read_text("utf-8").split("<!-- floors -->\n")[1].split("<!-- end -->")[0]
    assert shown.splitlines() == lines


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(ROOT)))
def test_a_module_imports_only_from_floors_below(path: Path) -> None:
    own = unit_of(path)
    for line, name in imported(path):
        library, _, rest = name.partition(".")
        other = rest.partition(".")[0]
        if library != "maglev_design" or other in (own, "__version__"):
            continue
        near = FLOORS[LEVEL[own]].open and LEVEL[other] == LEVEL[own]
        assert near or LEVEL[other] < LEVEL[own], f"{path}:{line} imports {name}"


def test_no_module_imports_itself_by_way_of_others() -> None:
    assert circle(uses()) == []


def test_a_circle_is_found() -> None:
    assert circle({"a": "bc", "b": "c", "c": ""}) == []
    assert circle({"a": "b", "b": "c", "c": "db", "d": ""}) == ["b", "c", "b"]


def test_no_two_classes_have_one_name() -> None:
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in files()]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    named = Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    assert sorted(name for name, count in named.items() if count > 1) == []


def test_no_module_is_too_long_to_read() -> None:
    lengths = {path: len(path.read_text("utf-8").splitlines()) for path in files()}
    long = sorted(p.relative_to(ROOT).as_posix() for p, n in lengths.items() if n > LONGEST)
    assert long == []


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


def test_the_mathematics_reads_and_writes_nothing() -> None:
    for path in (*(ROOT / "symbolic").glob("*.py"), *(ROOT / "derivation").glob("*.py")):
        names = {name.partition(".")[0] for _, name in imported(path)}
        outside = names - {"sympy", "maglev_design"}
        assert outside - set(sys.stdlib_module_names) == set(), path
        assert outside & {"os", "io", "pathlib", "subprocess", "sys", "json"} == set(), path
