"""Arrays of a ``.npz`` file, read as if somebody else had written it.

Sizes are checked in the directory of the archive and in the head of every array before there is
memory for them; nothing is ever unpickled.
"""

from __future__ import annotations

import hashlib
import io
import math
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_design.errors import InputError
from maglev_design.files import joint_hash, opened

if TYPE_CHECKING:
    from numpy.typing import NDArray

ENDING = ".npy"
KINDS = ("<f8", "|u1")
"""What the arrays of this program consist of."""
LARGEST = 400_000_000
"""[bytes] Of all arrays of a file together, where nothing else is said."""
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def read_arrays(
    path: Path, names: Iterable[str] | None = None, largest: int = LARGEST
) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file, or some of them, by name.

    Parameters
    ----------
    path : Path
    names : iterable of str, optional
        Default: all.
    largest : int
        Bytes that the file may have, and that these arrays may have together.

    Raises
    ------
    InputError
        When the file is larger, is damaged, or lacks one of the names.
    """
    with opened(path, largest) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                every = [name.removesuffix(ENDING) for name in archive.namelist()]
                wanted = every if names is None else list(names)
                members = {name: archive.getinfo(name + ENDING) for name in wanted}
                if sum(member.file_size for member in members.values()) > largest:
                    raise InputError(f"{path}: its arrays are larger than {largest} bytes")
                return {name: _array(member, archive) for name, member in members.items()}
        except InputError:
            raise
        except Exception as error:
            raise InputError(f"{path}: damaged: {type(error).__name__} at {error}") from error


def _array(member: zipfile.ZipInfo, archive: zipfile.ZipFile) -> NDArray[Any]:
    """Return one array; `ValueError` for one that is not what its head says, or of another kind."""
    import numpy as np  # noqa: PLC0415 - heavy
    from numpy.lib import format as npy  # noqa: PLC0415

    if member.compress_type not in METHODS:
        raise ValueError(f"compression {member.compress_type}")
    content = io.BytesIO(archive.read(member))
    if npy.read_magic(content) != (1, 0):
        raise ValueError("another version of the format")
    shape, by_column, kind = npy.read_array_header_1_0(content)
    data = content.read()
    if kind.str not in KINDS or by_column or math.prod(shape) * kind.itemsize != len(data):
        raise ValueError(f"an array of {kind.str}, {shape}")
    return np.frombuffer(data, kind).reshape(shape).copy()


def arrays_sha256(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Return the hash of arrays with their names and shapes, however they are packed."""
    parts: list[str | bytes] = []
    for name in sorted(arrays):
        one = arrays[name]
        parts += [name, one.dtype.str, repr(one.shape), one.tobytes()]
    return joint_hash(*parts)


def file_sha256(path: Path) -> str:
    """Return the hash of a file's bytes.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    whole = hashlib.sha256()
    with opened(path) as file:
        while part := file.read(1 << 20):
            whole.update(part)
    return whole.hexdigest()
