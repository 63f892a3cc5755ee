"""The report as PDF, by the tool that is present: TeX, or the wheels of the extra ``[pdf]``.

TeX prints the LaTeX form. Without it, pandoc turns the markdown form into Typst's language and
Typst sets it; both come as wheels.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from maglev_design.errors import InputError
from maglev_design.reporting.templates import text_of

Tool = Literal["tex", "typst"]
PASSES = 3
"""References and the widths of long tables settle at the third."""
SLOWEST = 120.0
"""[s] for a pass of TeX."""
READ = "markdown-yaml_metadata_block-citations-raw_html-raw_tex-raw_attribute-implicit_figures"
"""What pandoc takes our markdown for: nothing in it is anybody's raw code."""


def tool() -> Tool | None:
    """Return the tool that is present, the better one where both are."""
    if shutil.which("pdflatex"):
        return "tex"
    return "typst" if find_spec("pypandoc") and find_spec("typst") else None


def required_tool() -> Tool:
    """Return the tool that is present.

    Raises
    ------
    InputError
        When there is none.
    """
    found = tool()
    if found is None:
        raise InputError(
            "format = pdf: needs pdflatex (Debian: texlive-latex-base) or pip install "
            "'maglev-design[pdf]'; or take html and print it from a browser"
        )
    return found


def from_latex(source: str, figures: Mapping[str, bytes]) -> bytes:
    """Return the PDF of a LaTeX document.

    Parameters
    ----------
    source : str
    figures : mapping of str to bytes
        By their paths relative to the document.

    Raises
    ------
    InputError
        When TeX fails.
    """
    program = shutil.which("pdflatex") or "pdflatex"
    command = [program, "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape"]
    with tempfile.TemporaryDirectory() as place:
        folder = _laid_out(Path(place), "report.tex", source, figures)
        for _ in range(PASSES):
            try:
                done = subprocess.run(  # noqa: S603 - TeX on the text above, no shell escape
                    [*command, "report.tex"],
                    cwd=folder,
                    capture_output=True,
                    timeout=SLOWEST,
                    check=False,
                )
            except (OSError, subprocess.TimeoutExpired) as error:
                raise InputError(f"format = pdf: {program} did not finish: {error}") from error
            if done.returncode:
                told = done.stdout.decode("latin-1")[-600:]
                raise InputError(f"format = pdf: {program} failed:\n{told}")
        return (folder / "report.pdf").read_bytes()


def from_markdown(text: str, figures: Mapping[str, bytes]) -> bytes:
    """Return the PDF of a markdown document; parameters and errors as for :func:`from_latex`."""
    import pypandoc  # noqa: PLC0415 - of the extra [pdf]
    import typst  # noqa: PLC0415 - of the extra [pdf]

    with tempfile.TemporaryDirectory() as place:
        folder = _laid_out(Path(place), "header.typ", text_of("header.typ"), figures)
        options = ["--standalone", f"--include-in-header={folder / 'header.typ'}"]
        options += ["--variable=papersize:a4", "--variable=fontsize:10pt"]
        try:
            source = pypandoc.convert_text(text, "typst", format=READ, extra_args=options)
            (folder / "report.typ").write_text(source, encoding="utf-8")
            return bytes(typst.compile(str(folder / "report.typ"), root=str(folder)))
        except (OSError, RuntimeError) as error:  # typst's own error is a RuntimeError
            raise InputError(f"format = pdf: pandoc or typst failed:\n{error}") from error


def _laid_out(folder: Path, name: str, source: str, figures: Mapping[str, bytes]) -> Path:
    for path, content in figures.items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_bytes(content)
    (folder / name).write_text(source, encoding="utf-8")
    return folder
