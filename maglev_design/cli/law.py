"""Which law and which poles the command line names."""

from __future__ import annotations

from typing import TYPE_CHECKING

from maglev_design.controller.design import PAPER_POLES, PoleSpec
from maglev_design.errors import InputError
from maglev_design.options import Controller, ControllerName

if TYPE_CHECKING:
    from maglev_design.cli.commands.certify import CertifyOptions
    from maglev_design.cli.commands.design import DesignOptions
    from maglev_design.cli.commands.simulate import SimulateOptions
    from maglev_design.cli.commands.sweep import SweepOptions

PID = ("feedforward", "derivative", "filter", "start")
"""Options of the linear PID alone."""


def chosen_law(name: ControllerName, options: SimulateOptions | DesignOptions) -> Controller:
    """Return the law with its options; those of the PID are refused for the others."""
    given = {option: getattr(options, option) for option in PID}
    given = {option: value for option, value in given.items() if value is not None}
    if given and name != "lin-pid":
        names = ", ".join(f"--{option}" for option in given)
        raise InputError(
            f"{names}: only for --controller lin-pid, not for {name}, which leaves nothing open"
        )
    return Controller(name, **given)


def asked_poles(options: SimulateOptions | SweepOptions | CertifyOptions) -> PoleSpec:
    """Return the double pair of poles that was asked for; the paper's where nothing was said."""
    zeta, omega_n = PAPER_POLES
    return PoleSpec.double(
        zeta if options.zeta is None else options.zeta,
        omega_n if options.omega_n is None else options.omega_n,
    )
