"""The user's cache folder: what was derived or printed once, kept for the next process.

An entry is named after the hash of everything that it was made from and begins with the hash of
its own content. It is written beside its place and renamed, so that processes may read and write
the same entry at once; one that is damaged is made anew. Nothing here is needed: without the
folder everything is made again.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from maglev_design.errors import InputError
from maglev_design.files import write_bytes

T = TypeVar("T")


def cache_folder() -> Path:
    """Return ``MAGLEV_DESIGN_CACHE`` where it is set, else the folder in the user's cache."""
    chosen = os.environ.get("MAGLEV_DESIGN_CACHE")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    if sys.platform == "darwin" and not base:
        return Path.home() / "Library" / "Caches" / "maglev-design"
    return (Path(base) if base else Path.home() / ".cache") / "maglev-design"


def digest(*parts: str | bytes) -> str:
    """Return the SHA-256 of `parts`, each with its length, so that no two lists look alike."""
    whole = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        whole.update(b"%d:" % len(content))
        whole.update(content)
    return whole.hexdigest()


def kept(kind: str, key: str, make: Callable[[], str], read: Callable[[str], T]) -> T:
    """Return what `read` makes of the text of `make`, kept in the cache folder.

    Parameters
    ----------
    kind : str
        Subfolder.
    key : str
        Name of the entry: :func:`digest` of everything that decides what `make` returns.
    make : callable
        Called where there is no such entry, or one that is not whole.
    read : callable
        From the text to what is wanted; `ValueError` for a text that it cannot have come from.
    """
    path = cache_folder() / kind / key
    try:
        proof, _, content = path.read_bytes().partition(b"\n")
        if proof == digest(content).encode():
            return read(content.decode())
    except (OSError, ValueError):
        pass  # not there yet, not ours to read, or not what we wrote
    text = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, digest(text).encode() + b"\n" + text.encode())
    except (OSError, InputError):
        pass  # a folder that cannot be written costs the next process time, nothing else
    return read(text)


def sources(*places: Path) -> tuple[bytes, ...]:
    """Return the content of the source files in folders (and of files), in a fixed order."""
    files = [f for p in places for f in (sorted(p.glob("*.py")) if p.is_dir() else [p])]
    return tuple(file.read_bytes() for file in files)
