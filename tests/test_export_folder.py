from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import get_args

import pytest
from exported import HOSTILE, with_document

from maglev_design.errors import InputError
from maglev_design.exporting import export_folder
from maglev_design.exporting.controller import doubts
from maglev_design.exporting.printing import TEMPLATES
from maglev_design.files import MARK
from maglev_design.options import Target
from maglev_design.record import DesignRecord, load

TARGETS: tuple[Target, ...] = get_args(Target)


def export(
    record: DesignRecord, target: Target, folder: Path, *, force: bool = False
) -> dict[str, bytes]:
    export_folder(record, target, folder, allow_unverified=True, force=force)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("target", TARGETS)
def test_a_folder_is_whole_ascii_and_says_what_is_in_it(
    tuned_record: DesignRecord, tmp_path: Path, target: Target
) -> None:
    files = export(tuned_record, target, tmp_path / "out")
    manifest = json.loads(files.pop("manifest.json"))
    assert files.pop(MARK)
    assert manifest["files"] == {n: hashlib.sha256(b).hexdigest() for n, b in files.items()}
    assert manifest["rig"]["name"] == HOSTILE
    assert len(files) == len(TEMPLATES[target]) + 3
    for name, content in files.items():
        if name != "design.json":
            text = content.decode("ascii")
            assert "{{" not in text.replace("{{U+", "")
            assert "{%" not in text
            assert str(tmp_path) not in text
    assert load(tmp_path / "out").document["gains"] == tuned_record.document["gains"]


@pytest.mark.parametrize("target", TARGETS)
def test_two_exports_have_the_same_bytes(
    tuned_record: DesignRecord, tmp_path: Path, target: Target
) -> None:
    first, second = (export(tuned_record, target, tmp_path / n) for n in ("one", "two"))
    assert first == second


def test_a_hostile_name_reaches_no_source_unescaped(
    tuned_record: DesignRecord, tmp_path: Path
) -> None:
    for target in TARGETS:
        for name, content in export(tuned_record, target, tmp_path / target).items():
            if name.endswith((".c", ".h", ".py", ".m", ".md")):
                text = content.decode("ascii")
                assert "??/" not in text
                assert "{U+002A}{U+002F}" in text
    comments = re.findall(r"/\*.*?\*/", (tmp_path / "c" / "maglev.c").read_text("ascii"), re.DOTALL)
    assert "Levitation controller" in comments[0]
    assert comments[0].endswith("every bit agrees.\n */")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"certificate": None}, "no stability certificate"),
        ({"certificate": {"certified": False}}, "no stability certificate"),
        ({"certificate": "yes"}, "no stability certificate"),
        ({"certificate": {"certified": True}, "verification": {"passed": False}}, "re-simulation"),
        ({"certificate": {"certified": True}, "status": "infeasible"}, "infeasible"),
    ],
)
def test_a_design_in_doubt_is_exported_only_on_demand_and_then_says_so(
    tuned_record: DesignRecord, tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    record = with_document(tuned_record, **changes)
    with pytest.raises(InputError, match="--allow-unverified") as caught:
        export_folder(record, "python", tmp_path / "out")
    assert words in str(caught.value)
    assert not (tmp_path / "out").exists()
    files = export(record, "python", tmp_path / "out")
    for name in ("maglev.py", "README.md"):
        text = re.sub(r"\s*\n[#>]? *", " ", files[name].decode("ascii"))
        assert "NOT VERIFIED" in text
        assert words in text


def test_a_verified_and_certified_design_is_exported_without_a_word(
    tuned_record: DesignRecord, tmp_path: Path
) -> None:
    record = with_document(tuned_record, certificate={"certified": True})
    assert doubts(record) == ()
    done = export_folder(record, "c", tmp_path / "out")
    assert done.doubts == ()
    assert "NOT VERIFIED" not in (tmp_path / "out" / "maglev.h").read_text("ascii")


def test_another_target_replaces_what_was_exported_and_nothing_else(
    tuned_record: DesignRecord, tmp_path: Path
) -> None:
    export(tuned_record, "python", tmp_path)
    (tmp_path / "mine.txt").write_text("keep")
    (tmp_path / "example.py").write_text("changed by hand")
    files = export(tuned_record, "c", tmp_path)
    assert "maglev.py" not in files
    assert files["mine.txt"] == b"keep"
    assert files["example.py"] == b"changed by hand"
    assert "maglev.c" in files


def test_a_folder_of_somebody_else_is_refused_without_force(
    tuned_record: DesignRecord, tmp_path: Path
) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(InputError, match="--force"):
        export(tuned_record, "c", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    assert export(tuned_record, "c", tmp_path, force=True)["mine.txt"] == b"keep"
