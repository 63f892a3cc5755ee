"""From TOML to a rig: the files that people write, and the presets of the package."""

from __future__ import annotations

import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from maglev_design.errors import InputError, nearest
from maglev_design.files import read_bytes
from maglev_design.options import DEFAULT_PRESET
from maglev_design.rig.faults import sentence
from maglev_design.rig.model import Rig

LARGEST_RIG_FILE = 1_000_000
"""[bytes] A rig is a page of text."""
DEEPEST_KEY = 16
"""Parts of a dotted key; reading longer ones takes time that grows with their square."""
_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
DEEP_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:\.[ \t]*{_PART}){{{DEEPEST_KEY - 1}}}")


def preset_names() -> tuple[str, ...]:
    """Return the names of the rigs that come with the package, sorted.

    Examples
    --------
    >>> "belmonte2021" in preset_names()
    True
    """
    files = resources.files("maglev_design.rig") / "presets"
    return tuple(sorted(f.name[:-5] for f in files.iterdir() if f.name.endswith(".toml")))


def preset_text(name: str) -> str:
    """Return the TOML text of a preset, comments and sources included.

    Raises
    ------
    InputError
        When no preset has that name.
    """
    if name not in preset_names():
        raise InputError(
            f"no preset named {name!r}{nearest(name, preset_names())}; "
            f"presets: {', '.join(preset_names())}"
        )
    return (resources.files("maglev_design.rig") / "presets" / f"{name}.toml").read_text("utf-8")


def is_papers(rig: Rig) -> bool:
    """Whether the plant, the equilibrium and the move are the paper's, whatever else is not."""
    paper = load_rig(DEFAULT_PRESET)
    same = ("plant", "reference")
    return rig.operating_point.gap == paper.operating_point.gap and all(
        getattr(rig, name) == getattr(paper, name) for name in same
    )


def load_rig(source: str | Path) -> Rig:
    """Return the rig of a TOML file (a path, or a name ending in ``.toml``) or of a preset.

    Raises
    ------
    InputError
        Naming the file, the field, the value, its unit and what is allowed.

    Examples
    --------
    >>> load_rig("belmonte2021").plant.mass
    0.02
    """
    path = Path(source)
    is_path = isinstance(source, Path) or path.suffix == ".toml" or _exists(path)
    if str(source) in preset_names() or not is_path:
        return parse_rig(preset_text(str(source)), str(source))
    try:
        text = read_bytes(path, LARGEST_RIG_FILE).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8") from error
    return parse_rig(text, str(path))


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # too long, or characters that no file name has
        return False


def parse_rig(text: str, origin: str) -> Rig:
    """Return the rig written in TOML `text`; `origin` names it in errors."""
    if DEEP_KEY.search(text):
        raise InputError(f"{origin}: a key of {DEEPEST_KEY} parts or more is none of a rig")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{origin}: not valid TOML: {error}") from error
    except RecursionError as error:
        raise InputError(f"{origin}: not valid TOML: nested too deeply") from error
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"{origin}: not valid TOML: {error}") from error
    return make_rig(data, origin)


def make_rig(data: dict[str, Any], origin: str = "rig") -> Rig:
    """Return the validated rig of plain `data`, as it stands in TOML or in a saved design."""
    try:
        return Rig.model_validate(data)
    except ValidationError as error:
        given = data if isinstance(data, dict) else {}
        details = [
            detail
            for detail in error.errors()
            if detail["loc"][:1] not in (("initial",), ("reference",)) or detail["loc"][0] in given
        ]
        raise InputError("\n".join(f"{origin}: {sentence(d)}" for d in details)) from error
