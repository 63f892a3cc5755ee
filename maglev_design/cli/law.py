"""Which law and which poles the command line names."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from maglev_design.controller.design import PAPER_POLES, PoleSpec
from maglev_design.controller.matching import law_named
from maglev_design.errors import InputError
from maglev_design.options import Controller, LawName
from maglev_design.rig import Rig

if TYPE_CHECKING:
    from maglev_design.cli.commands.certify import CertifyOptions
    from maglev_design.cli.commands.design import DesignOptions
    from maglev_design.cli.commands.simulate import SimulateOptions
    from maglev_design.cli.commands.sweep import SweepOptions

PID = ("feedforward", "derivative", "filter", "start")
"""Options of the linear PID alone."""


def chosen_law(name: LawName, rig: Rig, options: SimulateOptions | DesignOptions) -> Controller:
    """Return the law as the rig's plant asks for it, with its options.

    Those of the PID are refused for the others.
    """
    given = {option: getattr(options, option) for option in PID}
    given = {option: value for option, value in given.items() if value is not None}
    if given and name != "lin-pid":
        names = ", ".join(f"--{option}" for option in given)
        raise InputError(
            f"{names}: only for --controller lin-pid, not for {name}, which leaves nothing open"
        )
    return replace(law_named(name, rig), **given)


def asked_poles(options: SimulateOptions | SweepOptions | CertifyOptions) -> PoleSpec:
    """Return the double pair of poles that was asked for; the paper's where nothing was said."""
    zeta, omega_n = PAPER_POLES
    return PoleSpec.double(
        zeta if options.zeta is None else options.zeta,
        omega_n if options.omega_n is None else options.omega_n,
    )
