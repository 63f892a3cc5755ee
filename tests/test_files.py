from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from maglev_design.errors import InputError
from maglev_design.files import (
    MARK,
    digest,
    finite,
    joint_hash,
    output_file,
    output_folder,
    read_bytes,
    read_document,
    write_bytes,
    write_file,
)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# --- documents -----------------------------------------------------------------------------


def test_a_digest_does_not_depend_on_the_layout_or_on_itself() -> None:
    document = {"b": [1, 2.5, None], "a": "x"}
    assert digest(document) == digest({"a": "x", "b": [1, 2.5, None], "sha256": "any"})
    assert digest(document) != digest({"a": "y", "b": [1, 2.5, None]})


def test_a_digest_of_what_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        digest({"a": float("inf")})


def test_what_no_document_can_hold_becomes_what_it_can() -> None:
    whole = {1: (np.inf, np.array([[1.5, np.nan]])), "a": [np.float64(2), np.int64(3), -np.inf]}
    found = finite(whole | {"b": (np.True_, None, "x", 4)})
    assert found == {"1": [None, [[1.5, None]]], "a": [2.0, 3, None], "b": [True, None, "x", 4]}
    assert [type(x) for x in found["a"][:2]] == [float, int]


def test_a_document_is_read_as_a_table(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"a": [1]}', encoding="utf-8")
    assert read_document(tmp_path / "a.json", "a test", 100) == {"a": [1]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[1]", "a table is needed"),
        (b"{", "not valid JSON"),
        (b"\xff", "not valid JSON"),
        (b"[" * 90_000, "not valid JSON"),
        (b" " * 100_001, "larger than 100000 bytes"),
        (b'{"a": ' * 900 + b"1" + b"}" * 900, "nested more than 32 deep"),
        (b'{"a": NaN}', "not finite"),
        (b'{"a": [1e999]}', "not finite"),
        (b'{"a": "\\ud800"}', "half a character"),
        (b'{"\\udfff": 1}', "half a character"),
        (b"{" + b"".join(b'"%d":1,' % n for n in range(10_000)) + b'"9999":1}', "'9999' stands"),
        (b'{"a": ' + b"9" * 5000 + b"}", "not valid JSON"),
    ],
    ids=lambda x: repr(x[:12]),
)
def test_what_is_no_document_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_document(tmp_path / "a.json", "a test", 100_000)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names")
def test_a_pipe_and_a_device_are_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(InputError):
            read_bytes(path, 100)


def test_a_file_of_just_the_largest_size_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * 100)
    assert read_bytes(tmp_path / "a", 100) == b"x" * 100
    with pytest.raises(InputError, match="larger than 99 bytes"):
        read_bytes(tmp_path / "a", 99)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="a file without a size")
def test_a_file_that_says_it_is_empty_is_read_to_the_largest_size() -> None:
    with pytest.raises(InputError, match="larger than 10 bytes"):
        read_bytes(Path("/proc/self/status"), 10)


# --- files ---------------------------------------------------------------------------------


def test_a_written_file_holds_exactly_the_bytes(tmp_path: Path) -> None:
    content = bytes(range(256)) * 3
    write_bytes(tmp_path / "a.bin", content)
    assert (tmp_path / "a.bin").read_bytes() == content
    assert names(tmp_path) == ["a.bin"]


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_written_file_can_be_read_by_whom_the_umask_allows(
    tmp_path: Path, mask: int, mode: int
) -> None:
    before = os.umask(mask)
    try:
        write_bytes(tmp_path / "a", b"x")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == mode


@pytest.mark.parametrize("leads", ["to a file", "nowhere"])
def test_a_link_is_never_replaced(tmp_path: Path, leads: str) -> None:
    if leads == "to a file":
        (tmp_path / "target").write_bytes(b"old")
    (tmp_path / "a").symlink_to(tmp_path / "target")
    with pytest.raises(InputError, match="no regular file has that name"):
        write_bytes(tmp_path / "a", b"new")
    assert (tmp_path / "a").is_symlink()
    assert leads == "nowhere" or (tmp_path / "target").read_bytes() == b"old"


# --- a file that a user named --------------------------------------------------------------

CSV = (".csv",)


def test_a_file_that_exists_needs_force(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    write_file(path, b"one", CSV, force=False)
    with pytest.raises(InputError, match=r"a\.csv: exists already; .*--force"):
        write_file(path, b"two", CSV, force=False)
    assert path.read_bytes() == b"one"
    write_file(path, b"two", CSV, force=True)
    assert path.read_bytes() == b"two"
    assert names(tmp_path) == ["a.csv"]


def test_the_ending_is_one_of_those_that_are_meant(tmp_path: Path) -> None:
    assert output_file(tmp_path / "a.CSV", CSV, force=False) == ".csv"
    for name in ("a", "a.toml", "design.json", ".csv"):
        with pytest.raises(InputError, match=r"must end in \.csv"):
            output_file(tmp_path / name, CSV, force=True)
    (tmp_path / "b.csv").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        output_file(tmp_path / "b.csv", CSV, force=True)
    with pytest.raises(InputError):
        write_file(tmp_path / "c\0.csv", b"", CSV, force=True)


def test_with_force_the_file_behind_a_link_is_written_and_the_link_stays(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "a.csv"
    link.symlink_to(target)
    with pytest.raises(InputError, match="leads nowhere"):
        write_file(link, b"new", CSV, force=True)
    target.write_bytes(b"old")
    with pytest.raises(InputError, match="exists already"):
        write_file(link, b"new", CSV, force=False)
    write_file(link, b"new", CSV, force=True)
    assert link.is_symlink()
    assert target.read_bytes() == b"new"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names")
def test_what_is_no_regular_file_is_written_through(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(InputError, match="cannot be written"):
        write_file(path, b"nobody reads", CSV, force=False)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    write_file(path, b"somebody reads", CSV, force=False)
    assert os.read(reader, 100) == b"somebody reads"
    os.close(reader)
    assert stat.S_ISFIFO(path.stat().st_mode)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a full device")
def test_a_device_stays_one_and_its_failure_is_an_input_error() -> None:
    write_file(Path("/dev/null"), b"x", CSV, force=False)
    with pytest.raises(InputError, match="No space left"):
        write_file(Path("/dev/full"), b"x", CSV, force=True)
    assert all(stat.S_ISCHR(Path(f"/dev/{name}").stat().st_mode) for name in ("null", "full"))


def test_where_our_own_output_goes_is_written_behind_it(tmp_path: Path) -> None:
    path = tmp_path / "out"
    text = (
        "import sys; from pathlib import Path; from maglev_design.files import write_file; "
        "print('first'); write_file(Path(sys.argv[1]), b'second', ('.csv',), force=False); "
        "print('third')"
    )
    with path.open("wb") as file:
        subprocess.run(  # noqa: S603 - our own interpreter and text
            [sys.executable, "-c", text, str(path)], stdout=file, check=True
        )
    assert path.read_bytes().split() == [b"first", b"secondthird"]


def test_writing_replaces_the_whole_file(tmp_path: Path) -> None:
    write_bytes(tmp_path / "a", b"long, long, long")
    write_bytes(tmp_path / "a", b"short")
    assert (tmp_path / "a").read_bytes() == b"short"


@pytest.mark.parametrize("fault", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failure_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: BaseException
) -> None:
    write_bytes(tmp_path / "a", b"old")

    def fail(self: Path, target: Path) -> Path:
        raise fault

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises((InputError, KeyboardInterrupt)) as caught:
        write_bytes(tmp_path / "a", b"new")
    monkeypatch.undo()
    assert (tmp_path / "a").read_bytes() == b"old"
    assert names(tmp_path) == ["a"]
    if isinstance(fault, OSError):
        assert "No space left" in str(caught.value)


def test_a_place_that_is_a_folder_is_an_input_error_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="a: cannot be written"):
        write_bytes(tmp_path / "a", b"x")
    assert names(tmp_path) == ["a"]


@pytest.mark.parametrize("place", ["missing/a", "file/a", "n" * 300])
def test_a_place_that_cannot_be_is_named(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match=r"cannot be written \("):
        write_bytes(tmp_path / place, b"x")
    assert names(tmp_path) == ["file"]


# --- folders -------------------------------------------------------------------------------


def test_a_new_folder_is_made_with_its_parents_and_marked(tmp_path: Path) -> None:
    folder = output_folder(tmp_path / "a" / "b", force=False)
    assert folder == tmp_path / "a" / "b"
    assert names(folder) == [MARK]


def test_an_empty_folder_is_taken(tmp_path: Path) -> None:
    assert names(output_folder(tmp_path, force=False)) == [MARK]


def test_a_folder_of_ours_is_taken_again_and_nothing_in_it_is_touched(tmp_path: Path) -> None:
    folder = output_folder(tmp_path / "a", force=False)
    (folder / "mine.txt").write_text("kept")
    before = (folder / MARK).stat().st_mtime_ns
    output_folder(folder, force=False)
    assert names(folder) == [MARK, "mine.txt"]
    assert (folder / "mine.txt").read_text() == "kept"
    assert (folder / MARK).stat().st_mtime_ns == before


def test_a_foreign_folder_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match=r"not empty.*--force"):
        output_folder(tmp_path, force=False)
    assert names(tmp_path) == ["thesis.tex"]


def test_a_hidden_file_makes_a_folder_foreign(tmp_path: Path) -> None:
    (tmp_path / ".git").mkdir()
    with pytest.raises(InputError, match="not empty"):
        output_folder(tmp_path, force=False)


def test_force_takes_a_foreign_folder_and_deletes_nothing(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    output_folder(tmp_path, force=True)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"
    output_folder(tmp_path, force=False)  # now it is marked


@pytest.mark.parametrize("force", [False, True])
def test_a_file_is_no_folder(tmp_path: Path, force: bool) -> None:
    (tmp_path / "a").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        output_folder(tmp_path / "a", force=force)
    with pytest.raises(InputError, match="cannot be used as a folder"):
        output_folder(tmp_path / "a" / "b", force=force)
    assert (tmp_path / "a").read_text() == "x"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    with pytest.raises(InputError, match="cannot be"):
        output_folder(locked, force=False)


def test_a_hash_tells_where_one_part_ends() -> None:
    assert (
        len(
            {
                joint_hash("ab", "c"),
                joint_hash("a", "bc"),
                joint_hash("abc"),
                joint_hash("ab", "c", ""),
            }
        )
        == 4
    )
    assert joint_hash("λ") == joint_hash("λ".encode())
