"""Which worker runs what, and in which order: costly things are made once, long ones begin first.

The tests of a file go to one worker, so that what they share is made once. Files that share more
than their own fixtures go together; tests that share nothing are dealt out one by one, at the end,
when the workers have to finish at the same time.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import PurePosixPath
from typing import Any

TOGETHER = {
    "test_cli_claims": "the paper's claims",
    "test_paper_equations": "the paper's claims",
    "test_paper_theory": "the paper's claims",
}
"""File -> what it shares with others: the derivation and what is proved on the way."""
LONGEST_FIRST = (
    "test_cli_claims",
    "test_paper_equations",
    "test_paper_theory",
    "test_tune",
    "test_cli_paper",
    "test_cli_certify",
    "test_tune_truth",
    "test_tune_emulated",
    "test_certify_region",
    "test_benchmarks",
)
"""Files that begin in this order; the others follow by name."""
ALONE = {
    "test_architecture",
    "test_batch",
    "test_certify_interval",
    "test_certify_sampled",
    "test_cli",
    "test_cli_design",
    "test_compiled",
    "test_lowering",
    "test_linear_loop",
    "test_notebooks",
    "test_simulate",
}
"""Files whose tests share nothing that costs: dealt out one by one."""
_BEFORE = {name: place for place, name in enumerate(LONGEST_FIRST)}


def stem(nodeid: str) -> str:
    return PurePosixPath(nodeid.partition("::")[0]).stem


def scope(nodeid: str) -> str:
    """Return what names the tests that one worker has to run together."""
    name = stem(nodeid)
    if name in ALONE:
        return nodeid
    return TOGETHER.get(name, nodeid.partition("::")[0])


def order(nodeid: str) -> tuple[int, int]:
    """Return the key by which the tests are sorted, those of a scope beside each other."""
    name = stem(nodeid)
    return name in ALONE, _BEFORE.get(name, len(_BEFORE))


def scheduler(config: Any, log: Any) -> Any:
    """Return the scheduling of xdist by :func:`scope`, in the order of the collection.

    The marks of `--dist=loadgroup` would do, but not with every pytest: they are written into the
    names of the tests, which pytest from 9.1 on does not let change.
    """
    found = import_module("xdist.scheduler").LoadScopeScheduling(config, log)
    found._split_scope = scope
    config.option.loadscopereorder = False
    return found
