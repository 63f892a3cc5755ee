"""The folder of a sweep: ``setup.json`` and one file a chunk, each whole or not there."""

from __future__ import annotations

import hashlib
import io
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_design.errors import InputError
from maglev_design.files import json_bytes, read_document, write_bytes
from maglev_design.sweeping.scenarios import FIGURES
from maglev_design.sweeping.setup import Setup, differences

Array = NDArray[np.float64]
SETUP, CHUNKS = "setup.json", "chunks"
LARGEST_SETUP = 50_000_000
"""[bytes]"""
_DAMAGED = (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error)


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
    if not path.exists():
        return False
    count = setup.span(number)[1]
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            proof = archive["proof"]
            whole = all(
                array.shape == (count,) and array.dtype == np.float64
                for array in (archive[name] for name in names(setup))
            )
    except _DAMAGED:
        if _is_another(path, setup, number) and not force:
            raise _foreign(path) from None
        return False
    if not np.array_equal(proof, _proof(setup, number)):
        if force:
            return False
        raise _foreign(path)
    return whole


def _is_another(path: Path, setup: Setup, number: int) -> bool:
    """Whether a file that is no chunk of this sweep is a whole one of another."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            proof = archive["proof"]
            for name in archive.files:
                archive[name]
    except _DAMAGED:
        return False
    return not np.array_equal(proof, _proof(setup, number))


def _foreign(path: Path) -> InputError:
    return InputError(
        f"{path}: a chunk of another sweep; take it away, or compute it anew with --force"
    )


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
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            part: Array = archive[name]
    except _DAMAGED as error:
        raise InputError(f"{path}: damaged; run the same sweep again to compute it anew") from error
    if part.shape != (setup.span(number)[1],):
        raise InputError(f"{path}: damaged; run the same sweep again to compute it anew")
    return part
