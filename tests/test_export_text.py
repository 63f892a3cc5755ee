from __future__ import annotations

import pytest
from exported import HOSTILE
from hypothesis import given
from hypothesis import strategies as st

from maglev_design.errors import InputError
from maglev_design.exporting.text import LONGEST_NAME, checked_prefix, plain, wrapped

HARMLESS = set("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789 .,:;()+=_-{}")


@given(st.text())
def test_any_text_becomes_one_harmless_line(text: str) -> None:
    shown = plain(text)
    assert set(shown) <= HARMLESS
    assert "\n" not in shown
    assert plain(text) == shown


def test_what_can_be_read_stays_readable() -> None:
    name = "Feedback 33-210 (Belmonte et al. 2021)"
    assert plain(name) == name
    assert plain("a */ b") == "a {U+002A}{U+002F} b"
    assert "{U+1F9F2}" in plain(HOSTILE)
    assert plain("x" * 1000) == "x" * LONGEST_NAME + "..."


@pytest.mark.parametrize(
    "prefix",
    [
        "",
        "a b",
        "9a",
        "Lev",
        "été",
        "int",
        "class",
        "end",
        "math",
        "a-b",
        "../a",
        "a" * 25,
        "check",
    ],
)
def test_a_prefix_that_some_language_cannot_hold_is_refused(prefix: str) -> None:
    with pytest.raises(InputError, match="--prefix"):
        checked_prefix(prefix)


def test_a_long_comment_is_wrapped_and_every_line_marked() -> None:
    lines = wrapped("word " * 100, "# ", "#   ").splitlines()
    assert len(lines) > 4
    assert all(line.startswith("#") and len(line) <= 96 for line in lines)
