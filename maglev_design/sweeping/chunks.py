"""The folder of a sweep: ``setup.json`` and one file a chunk, each whole or not there."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.arrays import LARGEST, file_sha256, read_arrays
from maglev_design.errors import InputError
from maglev_design.files import json_bytes, read_document, write_bytes
from maglev_design.sweeping.scenarios import FIGURES
from maglev_design.sweeping.setup import Setup, differences

Array = NDArray[np.float64]
SETUP, CHUNKS = "setup.json", "chunks"
LARGEST_SETUP = 50_000_000
"""[bytes]"""
HEAD = 1000
"""[bytes] At most, of an array in a file, beside its numbers."""


def chunk_path(folder: Path, number: int) -> Path:
    """Return where a chunk is kept."""
    return folder / CHUNKS / f"{number:06d}.npz"


def open_folder(setup: Setup, folder: Path, *, force: bool) -> None:
    """Make `folder` that of this sweep, or see that it is.

    Raises
    ------
    InputError
        When another sweep is in it, unless `force`: then that one is written over.
    """
    path = folder / SETUP
    stored = _stored(path)
    if stored is not None and stored.get("key") != setup.key and not force:
        raise InputError(
            f"{folder}: another sweep is here ({differences(stored, setup.description)}); choose "
            "another folder, or write over it with --force"
        )
    if stored is None and path.exists() and not force:
        raise InputError(
            f"{path}: damaged, so it is not known what the chunks beside it are; choose another "
            "folder, or write over it with --force"
        )
    try:
        (folder / CHUNKS).mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder / CHUNKS}: cannot be made ({error.strerror})") from error
    if stored != setup.description:
        write_bytes(path, json_bytes(setup.description))


def _stored(path: Path) -> dict[str, Any] | None:
    """Return the description in a folder; None without one, or when it cannot be read."""
    try:
        return read_document(path, "the setup of a sweep", LARGEST_SETUP)
    except InputError:
        return None


def _proof(setup: Setup, number: int) -> NDArray[np.uint8]:
    """Return what says that a file is this chunk of this sweep."""
    digest = hashlib.sha256(f"{setup.key} {number}".encode()).digest()
    return np.frombuffer(digest, dtype=np.uint8)


def names(setup: Setup) -> list[str]:
    """Return the names of the arrays of a chunk."""
    own = [f"{n}_{figure}" for n in range(len(setup.designs)) for figure in FIGURES]
    return [f"drawn_{name}" for name in setup.spreads] + own


def write_chunk(setup: Setup, folder: Path, number: int, arrays: dict[str, Array]) -> None:
    """Write one chunk beside its place, then rename it; the bytes depend on the setup alone."""
    buffer = io.BytesIO()
    ordered: dict[str, Any] = {name: arrays[name] for name in names(setup)}
    np.savez(buffer, proof=_proof(setup, number), **ordered)
    write_bytes(chunk_path(folder, number), buffer.getvalue())


def is_done(setup: Setup, folder: Path, number: int, *, force: bool = False) -> bool:
    """Whether a chunk is there and whole: every checksum is tried.

    Raises
    ------
    InputError
        When it is whole and belongs to another sweep, unless `force`.
    """
    path = chunk_path(folder, number)
    size = _size(setup, number)
    try:
        proof = read_arrays(path, ["proof"], max(LARGEST, size))["proof"]
    except InputError:
        return False
    if not np.array_equal(proof, _proof(setup, number)):
        if force:
            return False
        raise InputError(
            f"{path}: a chunk of another sweep; take it away, or compute it anew with --force"
        )
    try:
        arrays = read_arrays(path, names(setup), size)
    except InputError:
        return False
    shape, kind = (setup.span(number)[1],), np.dtype(np.float64)
    return all((one.shape, one.dtype) == (shape, kind) for one in arrays.values())


def _size(setup: Setup, number: int) -> int:
    """Return the bytes that a chunk's file has at most."""
    return (len(names(setup)) + 1) * (8 * setup.span(number)[1] + HEAD)


def chunk_sha256(folder: Path, number: int) -> str:
    """Return the hash of a chunk's file."""
    return file_sha256(chunk_path(folder, number))


def column(setup: Setup, folder: Path, name: str) -> Array:
    """Return one array of all chunks together, 8 bytes a scenario."""
    whole = np.empty(setup.samples)
    for first, part in _parts(setup, folder, name):
        whole[first : first + len(part)] = part
    return whole


def _parts(setup: Setup, folder: Path, name: str) -> Iterator[tuple[int, Array]]:
    for number in range(setup.chunks):
        first, count = setup.span(number)
        yield first, read(setup, folder, number, name)[:count]


def read(setup: Setup, folder: Path, number: int, name: str) -> Array:
    """Return one array of one chunk."""
    path = chunk_path(folder, number)
    try:
        part: Array = read_arrays(path, [name], _size(setup, number))[name]
    except InputError as error:
        raise InputError(f"{error}; run the same sweep again to compute it anew") from error
    if part.shape != (setup.span(number)[1],):
        raise InputError(f"{path}: damaged; run the same sweep again to compute it anew")
    return part
