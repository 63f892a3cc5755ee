"""The report as PDF, by the tool that is present: TeX, or the wheels of the extra ``[pdf]``."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from maglev_design.errors import InputError

PASSES = 3
"""References and the widths of long tables settle at the third."""
SLOWEST = 120.0
"""[s] for a pass of TeX."""


def available() -> bool:
    """Return whether a tool for PDF is present."""
    return shutil.which("pdflatex") is not None


def pdf(source: str, figures: Mapping[str, bytes]) -> bytes:
    """Return the PDF of a LaTeX document.

    Parameters
    ----------
    source : str
    figures : mapping of str to bytes
        By their paths relative to the document.

    Raises
    ------
    InputError
        Where no tool is present, or the tool fails.
    """
    program = shutil.which("pdflatex")
    if program is None:
        raise InputError(
            "format = pdf: needs pdflatex (Debian: texlive-latex-base); or take html and print it"
        )
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, content in figures.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(content)
        (folder / "report.tex").write_text(source, encoding="utf-8")
        command = [program, "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape"]
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
