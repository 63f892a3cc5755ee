"""All that reads and writes: whole files, folders with a mark, documents.

A document is JSON with its own hash.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import secrets
import stat
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from maglev_design.errors import InputError

BINARY = getattr(os, "O_BINARY", 0)
"""Line ends stay what they are, on systems that would change them."""
DEEPEST = 32
"""Tables and lists in one another, of a document."""

MARK = ".maglev-design"
"""A file of this name says that this program made the folder and may write into it again."""


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` to `path` so that a reader sees the old file or the new, never a part.

    The file may be read and written by whom the umask allows.

    Raises
    ------
    InputError
        When the place cannot be written, or something else than a regular file has the name: a
        link, a device and a folder are never replaced.
    """
    try:
        if os.path.lexists(path) and not stat.S_ISREG(path.lstat().st_mode):
            raise InputError(f"{path}: cannot be written (no regular file has that name)")
        part = path.with_name(f".{secrets.token_hex(8)}.part")
        handle = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | BINARY, 0o666)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written ({_reason(error)})") from error


def output_file(path: Path, endings: Collection[str], *, force: bool) -> str:
    """Return the ending of a file that may be written, before anything is computed for it.

    Parameters
    ----------
    path : Path
    endings : collection of str
        That it may have, in lower case; a stream may have any.
    force : bool
        Whether a file that exists may be replaced.

    Raises
    ------
    InputError
        When it exists (unless `force`), is a folder or a link to nowhere, or has another ending.
    """
    ending = path.suffix.lower()
    if _is_stream(path):
        return ending
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder, the name of a file is needed")
        if path.is_symlink() and not path.exists():
            raise InputError(f"{path}: is a link that leads nowhere; take it away")
        if path.exists() and not force:
            raise InputError(
                f"{path}: exists already; choose another name, or write over it with --force"
            )
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written ({_reason(error)})") from error
    if ending not in endings:
        raise InputError(f"{path}: must end in {', '.join(endings)}")
    return ending


def write_file(path: Path, content: bytes, endings: Collection[str], *, force: bool) -> None:
    """Write a file that a user named: a whole one, or through what is no regular file.

    Raises
    ------
    InputError
        As :func:`output_file` and :func:`write_bytes`.
    """
    output_file(path, endings, force=force)
    if not _is_stream(path):
        write_bytes(path.resolve() if path.is_symlink() else path, content)
        return
    try:
        if _is_open(path, sys.stdout):
            sys.stdout.flush()
            handle = os.dup(sys.stdout.fileno())
        else:
            handle = _at_once(str(path), os.O_WRONLY)
            if hasattr(os, "set_blocking"):
                os.set_blocking(handle, True)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({_reason(error)})") from error


def _is_stream(path: Path) -> bool:
    """Whether a name is that of a pipe, a device, or of what our own output goes to."""
    try:
        kind = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)) or _is_open(path, sys.stdout)


def _is_open(path: Path, stream: TextIO | None) -> bool:
    """Whether a stream goes to what has this name."""
    try:
        return stream is not None and os.path.samestat(path.stat(), os.fstat(stream.fileno()))
    except (OSError, ValueError):
        return False


def _reason(error: OSError | ValueError) -> str:
    return str(error.strerror if isinstance(error, OSError) else error)


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


def finite(value: Any) -> Any:
    """Return what a JSON document can hold: no infinity and no nan, lists, Python's own numbers.

    Infinities and nan become None, tuples lists, what is NumPy's Python's, and an object what its
    ``as_dict`` says, or its fields where it has none.
    """
    if is_dataclass(value):
        value = value.as_dict() if hasattr(value, "as_dict") else vars(value)
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if hasattr(value, "tolist"):  # an array or a scalar of NumPy, which is not imported for this
        return finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def picked(of: object, *names: str) -> dict[str, Any]:
    """Return what `of` says under some of its names, in their order, for a document."""
    return {name: getattr(of, name) for name in names}


def json_bytes(document: Any, indent: int = 2, *, ascii_only: bool = False) -> bytes:
    """Return a document as a file holds it: :func:`finite`, with a newline at its end."""
    text = json.dumps(finite(document), indent=indent, ensure_ascii=ascii_only, allow_nan=False)
    return (text + "\n").encode()


def digest(document: Mapping[str, Any], *, allow_nan: bool = False) -> str:
    """Return the SHA-256 of a JSON document, whatever its layout, without its key ``sha256``.

    Raises
    ------
    ValueError
        For a number that is not finite, unless `allow_nan`.
    """
    body = {key: value for key, value in document.items() if key != "sha256"}
    text = json.dumps(body, sort_keys=True, separators=(",", ":"), allow_nan=allow_nan)
    return hashlib.sha256(text.encode()).hexdigest()


def read_bytes(path: Path, largest: int) -> bytes:
    """Return the content of a regular file of at most `largest` bytes.

    Raises
    ------
    InputError
        As :func:`opened`.
    """
    with opened(path, largest) as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise InputError(f"{path}: larger than {largest} bytes")
    return content


@contextmanager
def opened(path: Path, largest: int | None = None) -> Iterator[BinaryIO]:
    """Open a regular file to be read.

    Whatever else has the name (a pipe, a device, a folder) is refused and not waited for.

    Raises
    ------
    InputError
        When it is larger than `largest` bytes, no regular file, or cannot be read.
    """
    try:
        with open(path, "rb", opener=_at_once) as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                raise InputError(f"{path}: no regular file; save it as one")
            if largest is not None and found.st_size > largest:
                raise InputError(f"{path}: larger than {largest} bytes")
            yield file
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({_reason(error)})") from error


def _at_once(path: str, flags: int) -> int:
    """Open without waiting for somebody at the other end."""
    return os.open(path, flags | BINARY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0))


def read_document(path: Path, kind: str, largest: int) -> dict[str, Any]:
    """Return the JSON table of a file of at most `largest` bytes that should be `kind`.

    What it holds can be written again as it is: text, finite numbers, and tables and lists in one
    another to a depth of :data:`DEEPEST`.

    Raises
    ------
    InputError
        When it cannot be read or is something else, or a table in it has a key twice.
    """

    def table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            counted = Counter(name for name, _ in pairs)
            twice = next(name for name, count in counted.items() if count > 1)
            raise InputError(f"{path}: {twice[:80]!r} stands twice in one table; leave one of them")
        return found

    content = read_bytes(path, largest)
    try:
        document = json.loads(content.decode("utf-8"), object_pairs_hook=table)
        _check(document)
    except (ValueError, RecursionError) as error:
        reason = error if isinstance(error, _UnfitError) else "not valid JSON"
        raise InputError(f"{path}: not {kind} ({reason})") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: not {kind} (a table is needed)")
    return document


class _UnfitError(ValueError):
    """JSON that no document of this program is."""


def _check(document: Any) -> None:
    """Raise `_UnfitError` for what cannot be written again, without descending into it."""
    level = [document]
    for _ in range(DEEPEST):
        deeper: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                deeper += value
                deeper += value.values()
            elif isinstance(value, list):
                deeper += value
            elif isinstance(value, float) and not math.isfinite(value):
                raise _UnfitError("a number that is not finite")
            elif isinstance(value, str) and any("\ud800" <= c <= "\udfff" for c in value):
                raise _UnfitError("half a character")
        if not deeper:
            return
        level = deeper
    raise _UnfitError(f"nested more than {DEEPEST} deep")


def joint_hash(*parts: str | bytes) -> str:
    """Return the SHA-256 of `parts`, each with its length, so that no two lists look alike."""
    whole = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        whole.update(b"%d:" % len(content))
        whole.update(content)
    return whole.hexdigest()
