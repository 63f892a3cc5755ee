"""The verbs as they are typed: options and help, one module a verb.

Only typer is imported here; what a verb needs is imported when it runs, so that asking for help
costs nothing. The options of a verb are a frozen dataclass, and its fields are all that typer is
told: a command is a function of that dataclass.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar, get_type_hints

Options = TypeVar("Options")


def spread(command: Callable[[Options], None]) -> Callable[..., None]:
    """Return a command as typer reads it: a parameter for each field of its options."""
    options: Callable[..., Options] = get_type_hints(command)["options"]
    hints = get_type_hints(options, include_extras=True)

    def called(**given: Any) -> None:
        command(options(**given))

    called.__name__, called.__doc__ = command.__name__, command.__doc__
    called.__annotations__ = hints
    called.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            field.replace(annotation=hints[name])
            for name, field in inspect.signature(options).parameters.items()
        ]
    )
    return called
