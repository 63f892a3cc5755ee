from __future__ import annotations

import os
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from maglev_design import cache
from maglev_design.cache import cache_folder, chosen_folder, kept, sources
from maglev_design.files import joint_hash


@pytest.fixture(autouse=True)
def forgotten() -> None:
    """Forget what was said of other folders."""
    cache._own.cache_clear()
    cache._private.cache_clear()


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
                "bytes": joint_hash(b"\xff").encode() + b"\n\xff",
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
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "file" / "cache"))
    made = Counted()
    assert [kept("texts", "key", made, str) for _ in range(2)] == [made.text] * 2
    assert made.count == 1  # kept as long as this process lives
    (note,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / "file" / "cache") in note
    assert "MAGLEV_DESIGN_CACHE" in note


def test_sources_are_read_in_one_order(tmp_path: Path) -> None:
    for name in ("b.py", "a.py", "c.txt"):
        (tmp_path / name).write_text(name)
    assert sources(tmp_path, tmp_path / "c.txt") == (b"a.py", b"b.py", b"c.txt")


def test_the_cache_folder_can_be_chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "here"))
    assert chosen_folder() == tmp_path / "here"
    monkeypatch.delenv("MAGLEV_DESIGN_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert chosen_folder() == tmp_path / "xdg" / "maglev-design"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert chosen_folder() == tmp_path / ".cache" / "maglev-design"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert chosen_folder() == tmp_path / "Library" / "Caches" / "maglev-design"


POSIX = pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")


@POSIX
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o720, 0o702])
@pytest.mark.parametrize("kind", ["", "texts"])
def test_a_folder_that_others_may_write_to_is_not_used(
    folder: Path, capsys: pytest.CaptureFixture[str], mode: int, kind: str
) -> None:
    made = Counted()
    kept("texts", "key", made, str)
    path = folder / "texts" / "key"
    path.write_bytes(joint_hash("planted").encode() + b"\nplanted")
    assert kept("texts", "key", made, str) == "planted"
    (folder / kind).chmod(mode)
    assert kept("texts", "key", made, str) == made.text
    found = cache_folder("texts")
    assert found is not None
    assert folder not in found.parents
    assert stat.S_IMODE(found.stat().st_mode) == 0o700
    (note,) = capsys.readouterr().err.splitlines()
    assert "others may write to it" in note


@POSIX
def test_a_folder_of_somebody_else_is_not_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.mkdir()
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    assert cache_folder() != folder
    assert "belongs to somebody else" in capsys.readouterr().err


@POSIX
def test_what_is_made_is_the_users_alone_whatever_the_umask(folder: Path) -> None:
    before = os.umask(0)
    try:
        kept("texts", "key", Counted(), str)
    finally:
        os.umask(before)
    for place in (folder, folder / "texts"):
        assert stat.S_IMODE(place.stat().st_mode) == 0o700


def test_without_owners_and_permissions_the_folder_is_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "geteuid", raising=False)
    folder.mkdir()
    assert cache_folder() == folder


def test_a_relative_folder_is_meant_from_where_the_user_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.chmod(0o700)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", ".")
    assert cache_folder() == tmp_path


def homeless() -> Path:
    raise RuntimeError("Could not determine home directory.")


def test_without_a_home_nothing_is_kept_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("MAGLEV_DESIGN_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    made = Counted()
    assert [kept("texts", "key", made, str) for _ in range(2)] == [made.text] * 2
    assert made.count == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_without_any_folder_at_all_everything_is_made_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nowhere(**_: str) -> str:
        raise FileNotFoundError(2, "No usable temporary directory found")

    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "mkdtemp", nowhere)
    made = Counted()
    assert [kept("texts", "key", made, str) for _ in range(2)] == [made.text] * 2
    assert made.count == 2


def test_the_private_folder_goes_with_its_process(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    text = "from maglev_design.cache import cache_folder; print(cache_folder('a'), cache_folder())"
    done = subprocess.run(  # noqa: S603 - our own interpreter and text
        [sys.executable, "-c", text],
        env=os.environ | {"MAGLEV_DESIGN_CACHE": str(tmp_path / "file")},
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    inner, outer = map(Path, done.stdout.split())
    assert inner.parent == outer
    assert not outer.exists()
    assert len(done.stderr.splitlines()) == 1
