from __future__ import annotations

import io
import os
import struct
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maglev_design.arrays import arrays_sha256, file_sha256, read_arrays
from maglev_design.errors import InputError

GIVEN = {"a": np.arange(6.0).reshape(2, 3), "b": np.arange(32, dtype=np.uint8), "c": np.zeros(0)}


@pytest.fixture(params=[np.savez, np.savez_compressed])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    request.param(tmp_path / "a.npz", **GIVEN)
    return tmp_path / "a.npz"


def member(path: Path, content: bytes, **how: Any) -> Path:
    """Write an archive whose array `a` is these bytes."""
    with zipfile.ZipFile(path, "w", **how) as archive:
        archive.writestr("a.npy", content)
    return path


def npy(array: Any, **how: Any) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, **how)
    return buffer.getvalue()


def test_what_was_written_comes_back(path: Path) -> None:
    found = read_arrays(path)
    assert list(found) == list(GIVEN)
    for name, array in found.items():
        assert array.dtype == GIVEN[name].dtype
        np.testing.assert_array_equal(array, GIVEN[name])
    assert list(read_arrays(path, ["b"])) == ["b"]
    with pytest.raises(InputError, match="damaged"):
        read_arrays(path, ["d"])


def test_every_cut_and_every_flipped_byte_is_read_or_refused(path: Path) -> None:
    whole = path.read_bytes()
    for position in range(len(whole)):
        for content in (
            whole[:position],
            whole[:position] + bytes([whole[position] ^ 0xFF]) + whole[position + 1 :],
            whole[:position] + bytes([whole[position] ^ 1]) + whole[position + 1 :],
        ):
            path.write_bytes(content)
            with suppress(InputError):
                read_arrays(path, GIVEN)


def test_a_bomb_is_refused_before_there_is_memory_for_it(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.npy", "w", force_zip64=True) as file,
    ):
        file.write(npy(np.zeros(0)))
        for _ in range(500):
            file.write(bytes(1_000_000))
    assert path.stat().st_size < 1_000_000
    with pytest.raises(InputError, match="larger than 400000000"):
        read_arrays(path)


@pytest.mark.parametrize(
    "content",
    [
        npy(np.array([{}], dtype=object), allow_pickle=True),
        npy(np.array(["text"])),
        npy(np.zeros(3, np.float32)),
        npy(np.zeros(3, ">f8")),
        npy(np.asfortranarray(np.zeros((2, 3)))),
        npy(np.zeros(3), version=(2, 0)),
        npy(np.zeros(3))[:-1],
        npy(np.zeros(3)) + b"\0",
        npy(np.zeros(6)).replace(b"(6,)", b"(-6)"),
        npy(np.zeros(6)).replace(b"(6,)", b"9999"),
        npy(np.zeros(6)).replace(b"'shape'", b"'sh\xffpe'"),
        npy(np.zeros(6)).replace(b"(6,)", b"((((")[:-8],
        b"\x93NUMPY\x01\x00" + struct.pack("<H", 65535) + b"(" * 65535,
        b"",
    ],
    ids=lambda content: repr(content[:8] + content[10:40]),
)
def test_what_is_no_array_of_this_program_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(InputError, match="damaged"):
        read_arrays(member(tmp_path / "a.npz", content))


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_compressions_are_refused(tmp_path: Path, method: int) -> None:
    with pytest.raises(InputError, match="compression"):
        read_arrays(member(tmp_path / "a.npz", npy(np.zeros(3)), compression=method))


def pipe(path: Path) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes with names here")
    os.mkfifo(path)


@pytest.mark.parametrize("make", [pipe, Path.mkdir])
def test_what_is_no_file_is_not_waited_for(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "a.npz")
    with pytest.raises(InputError, match=r"a\.npz"):
        read_arrays(tmp_path / "a.npz")
    with pytest.raises(InputError, match=r"a\.npz"):
        file_sha256(tmp_path / "a.npz")


def test_a_hash_is_of_names_shapes_and_numbers_not_of_the_packing(path: Path) -> None:
    told = arrays_sha256(read_arrays(path))
    assert told == arrays_sha256(GIVEN) == arrays_sha256(dict(reversed(GIVEN.items())))
    others = [
        {**GIVEN, "a": GIVEN["a"].reshape(3, 2)},
        {**GIVEN, "a": np.nextafter(GIVEN["a"], 1)},
        {**GIVEN, "a": GIVEN["a"].view(np.uint8)},
        {("d" if name == "c" else name): array for name, array in GIVEN.items()},
    ]
    assert len({told, *map(arrays_sha256, others)}) == 5
