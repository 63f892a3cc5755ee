"""A search on coarse grids, for answers of which nobody reads the last digit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from maglev_design.tuning import dense, search


@contextmanager
def coarse() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "GRID", 9)
        patch.setattr(dense, "WIDE", 15)
        patch.setattr(dense, "FINEST", 0.25 * dense.LOCAL)
        yield
