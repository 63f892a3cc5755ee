"""Writing without losing anything, folders with a mark, and documents that are whole."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maglev_design.errors import InputError

MARK = ".maglev-design"
"""A file of this name says that this program made the folder and may write into it again."""


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` to `path` so that a reader sees the old file or the new, never a part.

    Raises
    ------
    InputError
        When the place cannot be written.
    """
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            Path(name).chmod(0o644)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error


def output_folder(path: Path, *, force: bool) -> Path:
    """Return `path` as a folder that may be written into, made when it does not exist.

    Raises
    ------
    InputError
        When it holds something that this program did not write (unless `force`), is a file, or
        cannot be written.
    """
    try:
        if path.exists() and not path.is_dir():
            raise InputError(f"{path}: is a file, a folder is needed")
        path.mkdir(parents=True, exist_ok=True)
        if any(path.iterdir()) and not (path / MARK).exists() and not force:
            raise InputError(
                f"{path}: not empty and not written by this program; choose another folder or "
                "allow it with --force"
            )
        if not os.access(path, os.W_OK):
            raise InputError(f"{path}: the folder cannot be written")
    except OSError as error:
        raise InputError(f"{path}: cannot be used as a folder ({error.strerror})") from error
    if not (path / MARK).exists():
        write_bytes(path / MARK, b"maglev-design writes here\n")
    return path


def digest(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a JSON document, whatever its layout, without its key ``sha256``.

    Raises
    ------
    ValueError
        For a number that is not finite.
    """
    body = {key: value for key, value in document.items() if key != "sha256"}
    text = json.dumps(body, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def read_document(path: Path, kind: str, largest: int) -> dict[str, Any]:
    """Return the JSON table of a file of at most `largest` bytes that should be `kind`.

    Raises
    ------
    InputError
        When it cannot be read or is something else, or a table in it has a key twice.
    """

    def table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(f"{path}: {twice[:80]!r} stands twice in one table; leave one of them")
        return found

    try:
        if path.stat().st_size > largest:
            raise InputError(f"{path}: larger than {largest} bytes, not {kind}")
        document = json.loads(path.read_bytes().decode("utf-8"), object_pairs_hook=table)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: not {kind} (not valid JSON)") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: not {kind} (a table is needed)")
    return document
