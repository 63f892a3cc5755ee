"""Node and Chromium for the tests of what is printed as JavaScript."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

SLOW = 120
"""[s] A browser's start on a busy machine."""
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")


def node(script: str) -> Any:
    """Return what a script's last expression is: it calls ``answer`` with it."""
    program = shutil.which("node")
    if program is None:
        return _answered(script)
    text = f'const answer = (x) => console.log(JSON.stringify(x));\n"use strict";\n{script}'
    done = subprocess.run(  # noqa: S603 - our own script
        [program, "-"], input=text, capture_output=True, text=True, timeout=SLOW, check=True
    )
    return json.loads(done.stdout)


def _answered(script: str) -> Any:
    """Return the same from a page of the browser, where there is no Node."""
    import tempfile  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(
            '<meta charset="utf-8"><pre></pre><script>const answer = (x) => {'
            'document.querySelector("pre").textContent = JSON.stringify(x);};\n'
            f"{script}</script>",
            encoding="utf-8",
        )
        found = re.search(r"<pre>(.*?)</pre>", dom(page), re.DOTALL)
        assert found is not None
        return json.loads(found[1])


def dom(page: Path, fragment: str = "") -> str:
    """Return a page's document after its scripts ran."""
    done = _chromium("--dump-dom", f"{page.as_uri()}{'#' if fragment else ''}{fragment}")
    return done.stdout


def screenshot(page: Path, picture: Path, fragment: str = "", *, dark: bool = False) -> Path:
    """Draw a page as a browser shows it."""
    scheme = ("--blink-settings=preferredColorScheme=0",) if dark else ()
    url = f"{page.as_uri()}{'#' if fragment else ''}{fragment}"
    _chromium(*scheme, f"--screenshot={picture}", "--window-size=1000,1400", url)
    return picture


def _chromium(*arguments: str) -> subprocess.CompletedProcess[str]:
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("chromium is not installed")
    return subprocess.run(  # noqa: S603 - our own pages
        [program, *FLAGS, *arguments], capture_output=True, text=True, timeout=SLOW, check=True
    )
