"""Check that the output shown in the README is the output that the program prints.

``readme.py README.md OUTPUT``: the block after ``<!-- output -->`` must stand in OUTPUT, digit for
digit in the words and to four significant digits in the numbers, which may differ in the last
places from one processor to another.
"""

import re
import sys
from pathlib import Path

NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
RELATIVE = 2e-3
"""The tables print four digits, and the last one may turn over."""
SMALL = 1e-6
"""Differences of the integrators and what is left in the hold: only their size counts."""


def shown(readme: str) -> list[str]:
    """Return the non-empty lines of the block that shows the output."""
    block = readme.split("<!-- output -->", 1)[1].split("```", 2)[1]
    return [line.strip() for line in block.splitlines()[1:] if line.strip()]


def same(a: str, b: str) -> bool:
    """Whether two lines agree in their words and, to the tolerance, in their numbers."""
    if NUMBER.sub("#", " ".join(a.split())) != NUMBER.sub("#", " ".join(b.split())):
        return False
    pairs = zip(map(float, NUMBER.findall(a)), map(float, NUMBER.findall(b)), strict=True)
    return all(abs(x - y) <= RELATIVE * max(abs(x), abs(y)) + SMALL for x, y in pairs)


def main() -> int:
    """Return 1 and name the first line that the program does not print."""
    readme, output = (Path(name).read_text("utf-8") for name in sys.argv[1:3])
    printed = [line.strip() for line in output.splitlines() if line.strip()]
    for line in shown(readme):
        if not any(same(line, other) for other in printed):
            print(f"README.md shows a line that was not printed: {line!r}")
            return 1
    print(f"{len(shown(readme))} lines agree")
    return 0


if __name__ == "__main__":
    sys.exit(main())
