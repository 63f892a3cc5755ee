"""What one worker makes for all of them: computed once in a run of the tests, then read."""

from __future__ import annotations

import os
import pickle
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")

FOLDER = "MAGLEV_DESIGN_TESTS_ONCE"
"""The environment variable that tells the workers of a run where."""
_known: dict[str, Any] = {}


def begin() -> tempfile.TemporaryDirectory[str] | None:
    """Make the folder of this run, unless this is a worker of one that has it."""
    if FOLDER in os.environ:
        return None
    folder = tempfile.TemporaryDirectory(prefix="maglev-tests-")
    os.environ[FOLDER] = folder.name
    return folder


def end(folder: tempfile.TemporaryDirectory[str] | None) -> None:
    if folder is not None:
        del os.environ[FOLDER]
        folder.cleanup()


def once(name: str, make: Callable[[], T]) -> T:
    """Return what `make` returns, which the first to ask for `name` calls; the others wait.

    It is the same for everybody, read from a file, and nobody may change it.
    """
    if name not in _known:
        _known[name] = _made(Path(os.environ[FOLDER]) / name, make)
    found: T = _known[name]
    return found


def _made(path: Path, make: Callable[[], Any]) -> Any:
    lock = path.with_suffix(".lock")
    while not path.exists():
        try:
            lock.mkdir()
        except FileExistsError:
            time.sleep(0.05)
            continue
        try:
            if not path.exists():
                part = path.with_suffix(".part")
                part.write_bytes(pickle.dumps(make()))
                part.replace(path)
        finally:
            lock.rmdir()
    return pickle.loads(path.read_bytes())  # noqa: S301 - our own, of this run
