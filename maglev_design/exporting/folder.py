"""From a saved design to a folder that stands alone."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maglev_design import __version__
from maglev_design.errors import InputError
from maglev_design.exporting.controller import ExportedController, controller_of, promise
from maglev_design.exporting.printing import TEMPLATES, printed
from maglev_design.exporting.text import checked_prefix
from maglev_design.exporting.vectors import record_vectors
from maglev_design.files import digest, json_bytes, output_folder, read_document, write_bytes
from maglev_design.options import SCHEMA_VERSION, Target
from maglev_design.record import LARGEST_RECORD, DesignRecord, document_bytes

KIND = "maglev-design export"
MANIFEST = "manifest.json"


@dataclass(frozen=True)
class Export:
    """What was written: the folder, and the SHA-256 of every file by its name, manifest last."""

    folder: Path
    sha256: Mapping[str, str]
    doubts: tuple[str, ...]


def export_folder(
    record: DesignRecord,
    target: Target,
    folder: Path,
    *,
    prefix: str = "maglev",
    allow_unverified: bool = False,
    force: bool = False,
) -> Export:
    """Write the controller of a saved design into a folder.

    Parameters
    ----------
    record : DesignRecord
    target : {"python", "c", "matlab"}
    folder : Path
        Made when it does not exist.
    prefix : str
        What every public name and file begins with.
    allow_unverified : bool
        Whether a design may be exported whose re-simulation failed or that has no certificate.
    force : bool
        Whether a folder that this program did not make may be written into.

    Raises
    ------
    InputError
        For a design that may not be exported, an unusable prefix or an unusable folder.
    """
    checked_prefix(prefix)
    controller = controller_of(record, prefix)
    found = controller.doubts
    if found and not allow_unverified:
        raise InputError(
            f"this design is not exported: {' '.join(found)} Tune it again (or certify it), or "
            "take it as it is with --allow-unverified, which the exported files then say"
        )
    content = files_of(controller, target)
    folder = output_folder(folder, force=force)
    stale = _own_files(folder) - set(content)
    for name, data in content.items():
        write_bytes(folder / name, data)
    for name in stale:
        (folder / name).unlink(missing_ok=True)
    return Export(folder, {name: sha256(data) for name, data in content.items()}, found)


def files_of(controller: ExportedController, target: Target) -> dict[str, bytes]:
    """Return the content of every file of an export by its name, the manifest last."""
    vectors, rows = record_vectors(controller)
    content = printed(controller, target, rows)
    content["vectors.csv"] = vectors.encode("ascii")
    content["design.json"] = document_bytes(controller.record.document)
    content[MANIFEST] = _manifest(controller, target, content)
    return content


def sha256(data: bytes) -> str:
    """Return the digest of a file's content."""
    return hashlib.sha256(data).hexdigest()


def _manifest(controller: ExportedController, target: Target, files: Mapping[str, bytes]) -> bytes:
    document = controller.record.document
    body = {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "target": target,
        "prefix": controller.prefix,
        "versions": {**document["versions"], "exporter": __version__},
        "rig": document["rig"],
        "controller_sha256": controller.record.design.sha256,
        "gains": document["gains"],
        "constants": {
            c.name: {"value": c.value, "unit": c.unit, "meaning": c.meaning}
            for c in (*controller.law_constants, *controller.guard_constants)
        },
        "hold_samples": controller.hold_samples,
        "promise": promise(document),
        "doubts": list(controller.doubts),
        "files": {name: sha256(data) for name, data in sorted(files.items())},
    }
    return json_bytes(body | {"sha256": digest(body)}, ascii_only=True)


def _own_files(folder: Path) -> set[str]:
    """Return the files that an earlier export left here unchanged; they may be replaced."""
    try:
        document = read_manifest(folder)
    except InputError:
        return set()
    return {
        name
        for name, told in document["files"].items()
        if (folder / name).is_file() and sha256((folder / name).read_bytes()) == told
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of an exported folder.

    Raises
    ------
    InputError
        When there is none, or it is damaged or of another schema.
    """
    path = folder / MANIFEST
    try:
        document = read_document(path, "a manifest", LARGEST_RECORD)
    except InputError as error:
        there = "export again" if path.exists() else "give a folder that `export` wrote"
        raise InputError(f"{error}; {there}") from error
    if document.get("kind") != KIND:
        raise InputError(f"{path}: not the manifest of an export; export again")
    if document.get("schema_version") != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema_version = {document.get('schema_version')!r}: this program reads "
            f"{SCHEMA_VERSION}; export again"
        )
    files = document.get("files")
    plain_names = isinstance(files, dict) and all(
        isinstance(name, str) and Path(name).name == name and isinstance(told, str)
        for name, told in files.items()
    )
    usable = plain_names and {"design.json", "vectors.csv"} <= set(files or ())
    if not usable or document.get("target") not in TEMPLATES:
        raise InputError(f"{path}: damaged: its target or its files are unusable; export again")
    try:
        checked_prefix(str(document.get("prefix")))
    except InputError as error:
        raise InputError(f"{path}: damaged: {error}") from error
    return document
