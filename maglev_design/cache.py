"""The user's cache folder: what was derived or printed once, kept for the next process.

An entry is named after the hash of everything that it was made from and begins with the hash of its
own content. It is written beside its place and renamed, so that processes may read and write the
same entry at once; one that is damaged is made anew. Nothing in the folder is needed: without it
everything is made again. Because what lies there is run, a folder into which somebody else may
write is not used: a private one takes its place, as long as this process lives.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

from maglev_design.errors import InputError
from maglev_design.files import joint_hash, write_bytes

T = TypeVar("T")

VARIABLE = "MAGLEV_DESIGN_CACHE"
OTHERS = 0o022
"""Permission of the group and of everybody to write."""


def chosen_folder() -> Path:
    """Return :data:`VARIABLE` where it is set, else the folder in the user's cache.

    Raises
    ------
    RuntimeError
        When the user has no home.
    """
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return Path(chosen).absolute()
    base = os.environ.get("XDG_CACHE_HOME")
    if sys.platform == "darwin" and not base:
        return Path.home() / "Library" / "Caches" / "maglev-design"
    return (Path(base) if base else Path.home() / ".cache") / "maglev-design"


def cache_folder(kind: str = "") -> Path | None:
    """Return a folder that is there and into which nobody but the user may write.

    The chosen one or a subfolder of it, or else one that goes with this process, which is said
    once. None where not even that can be made.
    """
    try:
        folder = chosen_folder()
    except RuntimeError as error:
        return _private(f"no cache folder: {error}", kind)
    for place in dict.fromkeys((folder, folder / kind)):
        reason = _unfit(place)
        if reason:
            return _private(f"the cache folder {place} is not used ({reason})", kind)
    return folder / kind


def _unfit(folder: Path) -> str:
    """Return why what lies in a folder is not to be trusted, or nothing; the folder is made."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except (OSError, ValueError) as error:
        return str(error.strerror if isinstance(error, OSError) else error)
    if hasattr(os, "geteuid") and found.st_uid != os.geteuid():
        return "it belongs to somebody else"
    if os.name == "posix" and found.st_mode & OTHERS:
        return "others may write to it"
    return "" if os.access(folder, os.W_OK | os.X_OK) else "it cannot be written"


@cache
def _private(reason: str, kind: str) -> Path | None:
    """Return a subfolder of the private folder; the reason is said by the first who needs one."""
    folder = _own(reason)
    if folder is None:
        return None
    (folder / kind).mkdir(mode=0o700, exist_ok=True)
    return folder / kind


@cache
def _own(reason: str) -> Path | None:
    """Make a folder that goes with this process, and say why."""
    sys.stderr.write(f"note: {reason}; nothing is kept for the next time, see {VARIABLE}\n")
    try:
        folder = tempfile.mkdtemp(prefix="maglev-design-")
    except OSError:
        return None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def kept(kind: str, key: str, make: Callable[[], str], read: Callable[[str], T]) -> T:
    """Return what `read` makes of the text of `make`, kept in the cache folder.

    Parameters
    ----------
    kind : str
        Subfolder.
    key : str
        Name of the entry: :func:`joint_hash` of everything that decides what `make` returns.
    make : callable
        Called where there is no such entry, or one that is not whole.
    read : callable
        From the text to what is wanted; `ValueError` for a text that it cannot have come from.
    """
    folder = cache_folder(kind)
    if folder is None:
        return read(make())
    path = folder / key
    try:
        proof, _, content = path.read_bytes().partition(b"\n")
        if proof == joint_hash(content).encode():
            return read(content.decode())
    except (OSError, ValueError):
        pass  # not there yet, or not what we wrote
    text = make()
    with suppress(InputError):  # a full disk costs the next process time, nothing else
        write_bytes(path, joint_hash(text).encode() + b"\n" + text.encode())
    return read(text)


def sources(*places: Path) -> tuple[bytes, ...]:
    """Return the content of the source files in folders (and of files), in a fixed order."""
    found = [f for p in places for f in (sorted(p.glob("*.py")) if p.is_dir() else [p])]
    return tuple(file.read_bytes() for file in found)
