"""The report in its forms: whole, the same every time, and safe whatever the rig is called."""

from __future__ import annotations

import html as entities
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest
from records import HOSTILE, renamed, tuned

from maglev_design.record import DesignRecord
from maglev_design.reporting.content import Report
from maglev_design.reporting.html_form import html
from maglev_design.reporting.latex_form import latex
from maglev_design.reporting.markdown_form import markdown
from maglev_design.reporting.words import number_text
from maglev_design.reporting.write import pictures, report_of, write_report

OVERFULL = 0.5
"""Points; what sticks out less is not seen."""
NEEDS_TEX = pytest.mark.skipif(shutil.which("pdflatex") is None, reason="pdflatex is not installed")


@pytest.fixture(scope="module")
def record() -> DesignRecord:
    return tuned()


@pytest.fixture(scope="module")
def report(record: DesignRecord) -> Report:
    return report_of(record)


@pytest.fixture(scope="module")
def hostile(record: DesignRecord) -> DesignRecord:
    return renamed(record, HOSTILE)


class Page(HTMLParser):
    """What a browser would see: tags in their order, attributes, text."""

    VOID = ("meta", "img", "input", "br", "mspace")

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.links: list[str] = []
        self.names: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("href", "src", "srcset", "action", "data"):
                self.links.append(value or "")
            if name == "id":
                self.names.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def pages(record: DesignRecord, report: Report) -> dict[str, str]:
    drawn = pictures(record, report, [".svg"])
    svg = {name.removesuffix(".svg"): content for name, content in drawn.items()}
    return {
        "markdown": markdown(report, "figures"),
        "latex": latex(report, "figures"),
        "html": html(report, svg),
    }


@pytest.fixture(scope="module")
def forms(record: DesignRecord, report: Report) -> dict[str, str]:
    return pages(record, report)


def test_every_form_has_the_same_numbers(record: DesignRecord, forms: dict[str, str]) -> None:
    worst = record.document["worst_case"]
    for value, unit in (
        (worst["itae"], "m s^2"),
        (worst["peak_voltage"], "V"),
        (record.document["margins"]["phase_deg"]["value"], "deg"),
        (record.document["gains"]["k3"], "1/s"),
    ):
        text = number_text(value, unit, 8 if unit == "1/s" else 4)
        assert text in forms["markdown"]
        assert text in forms["html"]
        assert text.split(" ")[0] in forms["latex"]


def test_every_form_has_every_equation_table_and_figure(
    report: Report, forms: dict[str, str]
) -> None:
    assert {
        "diagram",
        "tracking",
        "error",
        "voltage",
        "landscape",
        "trade_off",
        "certificate",
    } <= set(report.labels)
    for target, label in report.labels.items():
        if label.startswith("("):
            assert rf"\tag{{{target}}}" in forms["markdown"]
            assert rf"\label{{{target}}}" in forms["latex"]
            assert f"<span>{label}</span>" in forms["html"]
        else:
            assert f"**{label}.**" in forms["markdown"]
            assert rf"\label{{{target}}}" in forms["latex"]
            assert f"<b>{label}.</b>" in forms["html"]


def test_every_figure_and_table_names_its_command(report: Report, forms: dict[str, str]) -> None:
    count = sum(label.startswith(("Table", "Figure")) for label in report.labels.values())
    assert forms["markdown"].count("Made by `maglev-design") == count
    assert forms["html"].count("Made by <code>maglev-design") == count


def test_writing_twice_gives_the_same_bytes(record: DesignRecord, tmp_path: Path) -> None:
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        folder.mkdir()
    first, second = (write_report(record, f, ["markdown", "latex", "html"]) for f in folders)
    assert [p.relative_to(folders[0]) for p in first] == [p.relative_to(folders[1]) for p in second]
    for one, two in zip(first, second, strict=True):
        assert one.read_bytes() == two.read_bytes(), one.name
        assert str(tmp_path).encode() not in one.read_bytes()


def test_a_record_without_curves_says_so(record: DesignRecord) -> None:
    bare = report_of(DesignRecord(record.rig, record.design, record.document, {}))
    assert [figure.id for figure in bare.figures()] == ["diagram"]
    assert "design.npz" in markdown(bare, "figures")


def test_what_is_certified_is_told_with_units_and_what_is_not_with_the_reason(
    record: DesignRecord,
) -> None:
    def told(**certificate: object) -> str:
        document = {**record.document, "certificate": certificate}
        return markdown(report_of(DesignRecord(record.rig, record.design, document, {})), "f")

    family = {"gaps": [0.012, 0.0246], "ratios": [0.85, 1.15], "decay": 36.5}
    shown = told(certified=True, status="certified", largest_beta_error=0.625, **family)
    for text in ("| gaps to | 0.0246 m |", "36.5 1/s |", "| 62.5 % |", "## Certificate"):
        assert text in shown
    assert (
        " %"
        not in told(certified=True, status="certified", largest_beta_error=None, **family)
        .partition("## Certificate")[2]
        .partition("##")[0]
    )
    refused = told(certified=False, status="not certified: narrow the gap range")
    assert "The sampled loop is not certified: narrow the gap range." in refused


# --- markdown ------------------------------------------------------------------------------


def test_markdown_maths_and_tables_are_whole(forms: dict[str, str]) -> None:
    text = forms["markdown"]
    blocks = text.split("$$")
    assert len(blocks) % 2 == 1
    for block in blocks[1::2]:
        assert block.startswith("\n")
        assert block.count("{") == block.count("}")
        assert "*" not in block
    assert all(len(re.findall(r"(?<!\\)\$", outside)) % 2 == 0 for outside in blocks[0::2])
    widths: list[int] = []
    for line in text.splitlines():
        if line.startswith("| "):
            widths.append(len(re.findall(r"(?<!\\)\|", line)))
        elif widths:
            assert len(set(widths)) == 1
            widths = []


def test_markdown_figures_are_beside_it(record: DesignRecord, tmp_path: Path) -> None:
    write_report(record, tmp_path, ["markdown"])
    text = (tmp_path / "report.md").read_text("utf-8")
    shown = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
    assert len(shown) == 6
    assert all((tmp_path / name).read_bytes().startswith(b"<?xml") for name in shown)


def test_markdown_keeps_a_name_as_text(hostile: DesignRecord) -> None:
    text = markdown(report_of(hostile), "figures")
    outside = "".join(text.split("```")[0::2])
    assert "<b>" not in outside.replace(r"\<b\>", "")
    assert "![i]" not in outside
    assert r"\</script\>\<b\>" in outside


# --- HTML ----------------------------------------------------------------------------------


def test_the_page_is_whole_and_asks_the_network_for_nothing(forms: dict[str, str]) -> None:
    page = Page(forms["html"])
    assert page.open == []
    assert len(page.names) == len(set(page.names))
    targets = [link[1:] for link in page.links if link.startswith("#")]
    assert targets
    assert set(targets) <= set(page.names)
    others = [link for link in page.links if not link.startswith("#")]
    assert others
    assert all(link.startswith("data:image/svg+xml;base64,") for link in others)
    known = ("http://www.w3.org/1998/Math/MathML", "http://www.w3.org/2000/svg")
    assert set(re.findall(r"https?://[^\s\"'<]+", forms["html"])) <= set(known)
    assert "default-src 'none'" in forms["html"]
    assert "prefers-color-scheme: dark" in forms["html"]


def test_all_maths_of_the_page_is_markup_and_none_is_left_as_latex(forms: dict[str, str]) -> None:
    visible = "".join(Page(forms["html"].split("<script>")[0]).words)
    assert "\\" not in visible.replace("\\u", "")
    assert forms["html"].count("<math") > 200


def test_a_name_cannot_break_out_of_the_page(hostile: DesignRecord, forms: dict[str, str]) -> None:
    text = pages(hostile, report_of(hostile))["html"]
    page = Page(text)
    usual = Page(forms["html"])
    assert page.open == []
    assert page.tags.count("script") == usual.tags.count("script") == 1
    assert page.tags.count("b") == usual.tags.count("b")
    assert entities.escape("</script><b>") in text
    assert "<<<" not in forms["html"]
    assert "<%" not in forms["html"]


# --- LaTeX and PDF -------------------------------------------------------------------------


def test_latex_keeps_a_name_as_text(hostile: DesignRecord) -> None:
    text = latex(report_of(hostile), "figures")
    assert r"\input{" not in text
    assert text.count(r"\end{document}") == 1
    assert text.isascii()


@NEEDS_TEX
@pytest.mark.parametrize("name", ["record", "hostile"])
def test_latex_compiles_and_nothing_runs_off_the_page(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    write_report(request.getfixturevalue(name), tmp_path, ["latex"])
    program = str(shutil.which("pdflatex"))
    for _ in range(3):
        run = subprocess.run(  # noqa: S603
            [program, "-interaction=nonstopmode", "-halt-on-error", "report.tex"],
            cwd=tmp_path,
            capture_output=True,
            timeout=120,
            check=False,
        )
        log = (tmp_path / "report.log").read_text(encoding="latin-1")
        assert run.returncode == 0, log[-2000:]
    too_wide = [float(width) for width in re.findall(r"Overfull \\[hv]box \(([\d.]+)pt", log)]
    assert all(width <= OVERFULL for width in too_wide), too_wide
    assert "undefined references" not in log
    assert "Rerun to get" not in log


@NEEDS_TEX
def test_the_pdf_has_the_same_bytes_twice(record: DesignRecord, tmp_path: Path) -> None:
    made = []
    for folder in (tmp_path / "one", tmp_path / "another"):
        folder.mkdir()
        (path,) = write_report(record, folder, ["pdf"])
        made.append(path.read_bytes())
    assert made[0] == made[1]
    assert made[0].startswith(b"%PDF")
    assert b"CreationDate" not in made[0]
    assert str(tmp_path).encode() not in made[0]


@pytest.mark.parametrize("name", ["record", "hostile"])
def test_without_tex_the_wheels_make_the_pdf(
    name: str, request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pypandoc")
    pytest.importorskip("typst")
    which = shutil.which
    monkeypatch.setattr(
        "shutil.which", lambda n, *a, **k: None if "tex" in n else which(n, *a, **k)
    )
    made = []
    for folder in (tmp_path / "one", tmp_path / "another"):
        folder.mkdir()
        (path,) = write_report(request.getfixturevalue(name), folder, ["pdf"])
        made.append(path.read_bytes())
    assert made[0] == made[1]
    assert made[0].startswith(b"%PDF")
    assert str(tmp_path).encode() not in made[0]
