"""Which law the command line names, with the options of the PID."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from maglev_design.errors import InputError
from maglev_design.options import Controller, ControllerName


def chosen_law(name: ControllerName, options: Mapping[str, Any]) -> Controller:
    """Return the law with its options; those of the PID are refused for the others."""
    given = {option: value for option, value in options.items() if value is not None}
    if given and name != "lin-pid":
        names = ", ".join(f"--{option}" for option in given)
        raise InputError(
            f"{names}: only for --controller lin-pid, not for {name}, which leaves nothing open"
        )
    return Controller(name, **given)
