"""The cache folder: what is kept there is whole, or is made again."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from maglev_design.store import cache_folder, digest, kept, sources


class Counted:
    """Something to make, and how often it was made."""

    def __init__(self, text: str = "made\nof λ lines\n") -> None:
        self.text, self.count = text, 0

    def __call__(self) -> str:
        self.count += 1
        return self.text


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_a_text_is_made_once_and_alone_in_its_folder(folder: Path) -> None:
    made = Counted()
    assert [kept("texts", "key", made, str) for _ in range(3)] == [made.text] * 3
    assert made.count == 1
    assert [p.name for p in (folder / "texts").iterdir()] == ["key"]


@pytest.mark.parametrize("damage", ["cut", "bit", "empty", "proof", "bytes", "folder"])
def test_a_damaged_entry_is_made_anew(damage: str, folder: Path) -> None:
    made = Counted()
    kept("texts", "key", made, str)
    path = folder / "texts" / "key"
    whole = path.read_bytes()
    if damage == "folder":
        path.unlink()
        path.mkdir()
    else:
        path.write_bytes(
            {
                "cut": whole[:-1],
                "bit": whole[:-1] + bytes([whole[-1] ^ 1]),
                "empty": b"",
                "proof": b"x" + whole[1:],
                "bytes": digest(b"\xff").encode() + b"\n\xff",
            }[damage]
        )
    assert kept("texts", "key", made, str) == made.text
    assert made.count == 2
    if damage != "folder":
        assert path.read_bytes() == whole


def test_an_entry_that_cannot_be_read_as_what_is_wanted_is_made_anew(folder: Path) -> None:
    assert kept("numbers", "key", Counted("none"), str) == "none"
    made = Counted("7")
    assert kept("numbers", "key", made, int) == 7
    assert kept("numbers", "key", Counted("8"), int) == 7


def test_a_folder_that_cannot_be_made_costs_time_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "file" / "cache"))
    made = Counted()
    assert [kept("texts", "key", made, str) for _ in range(2)] == [made.text] * 2
    assert made.count == 2


def test_a_hash_tells_where_one_part_ends() -> None:
    assert len({digest("ab", "c"), digest("a", "bc"), digest("abc"), digest("ab", "c", "")}) == 4
    assert digest("λ") == digest("λ".encode())


def test_sources_are_read_in_one_order(tmp_path: Path) -> None:
    for name in ("b.py", "a.py", "c.txt"):
        (tmp_path / name).write_text(name)
    assert sources(tmp_path, tmp_path / "c.txt") == (b"a.py", b"b.py", b"c.txt")


def test_the_cache_folder_can_be_chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "here"))
    assert cache_folder() == tmp_path / "here"
    monkeypatch.delenv("MAGLEV_DESIGN_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "maglev-design"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "maglev-design"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert cache_folder() == tmp_path / "Library" / "Caches" / "maglev-design"
