"""``python tests/benchmarks -o reports``: measure side by side and write the report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def main() -> None:
    """Read the command line, measure, write."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
    from benchmarks.measure import FULL, QUICK, measured  # noqa: PLC0415 - after the path
    from benchmarks.report import write  # noqa: PLC0415 - after the path

    parser = argparse.ArgumentParser(prog="benchmarks", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("reports"))
    parser.add_argument("--quick", action="store_true", help="tiny sizes, to see that it works")
    chosen = parser.parse_args()

    def told(stage: str) -> None:
        sys.stderr.write(f"{stage}\n")

    for path in write(measured(QUICK if chosen.quick else FULL, told), chosen.output):
        sys.stdout.write(f"{path}\n")


if __name__ == "__main__":
    main()
