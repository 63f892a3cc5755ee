"""From a magnetic-levitation rig's equations to a controller that runs on it.

The main job, from a rig to a controller in C that was checked:

>>> from pathlib import Path
>>> from tempfile import TemporaryDirectory
>>> from maglev_design import certify, export, load_rig, simulate, tune, verify
>>> rig = load_rig("belmonte2021")
>>> tuned = tune(rig)
>>> f"{tuned.document['worst_case']['itae']:.3g} m s^2 at the worst beta_c/beta in [0.85, 1.15]"
'9.93e-06 m s^2 at the worst beta_c/beta in [0.85, 1.15]'
>>> simulate(tuned, ratio=1.15).metrics.crashed, certify(tuned).certified
(False, True)
>>> with TemporaryDirectory() as folder:
...     files = export(tuned, "c", Path(folder) / "controller").sha256
...     verify(Path(folder) / "controller").passed
True

Every name of this page is loaded when it is used; the functions are told in
:mod:`maglev_design.chain`. What is not on it, the rooms behind it, is open
to read and to import, and may change: ``maglev_design.symbolic`` states the mathematics,
``lowering`` and ``programs`` carry it to numbers, ``controller`` and ``linear_loop`` hold one
controller and its linear loop, ``simulation``, ``tuning``, ``sweeping`` and ``certification`` do
the work, ``exporting`` and ``reporting`` tell it, ``paper`` is about the one paper.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from maglev_design.chain import certify as certify
    from maglev_design.chain import design as design
    from maglev_design.chain import export as export
    from maglev_design.chain import report as report
    from maglev_design.chain import simulate as simulate
    from maglev_design.chain import sweep as sweep
    from maglev_design.chain import tune as tune
    from maglev_design.chain import verify as verify
    from maglev_design.controller.design import Design as Design
    from maglev_design.record import load as load
    from maglev_design.rig import Rig as Rig
    from maglev_design.rig import load_rig as load_rig

_CHAIN = ("certify", "design", "export", "report", "simulate", "sweep", "tune", "verify")
_HOME = dict.fromkeys(_CHAIN, "chain") | {
    "Design": "controller.design",
    "Rig": "rig",
    "load": "record",
    "load_rig": "rig",
}


def __getattr__(name: str) -> Any:
    """Return a name of this page, from the room where it is made."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    """Return the names of this page."""
    return ["__version__", *sorted(_HOME)]
