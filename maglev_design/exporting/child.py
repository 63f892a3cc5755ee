"""The process in which an exported controller runs: asked through a pipe, one sample at a time.

Started by its path with an interpreter that is isolated, so it needs the standard library alone::

    child.py python FILE              # answer requests with the class Controller of a source
    child.py c LIBRARY PREFIX TYPE [SIGNALS STATES]
                                      # the same with a shared library; TYPE is double or float;
                                      # members of a point behind the acceleration; further states
    child.py replay LIBRARY EVENTS COUNT ANSWERS SIZE FIGURES SIZE

A request is one of three words, the number of a controller, how many numbers follow and room for
five; an answer is the commanded and the applied voltage and the status.
"""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

REQUEST = struct.Struct("<BIB5d")
ANSWER = struct.Struct("<2di")
NEW, RESET, STEP = range(3)


def python_class(path: Path) -> Callable[[], Any]:
    """Return the class of an exported Python controller."""
    space: dict[str, Any] = {"__name__": path.stem}
    exec(compile(path.read_bytes(), path.name, "exec"), space)  # noqa: S102 - what this is for
    new: Callable[[], Any] = space["Controller"]
    return new


def native_class(
    path: Path,
    prefix: str,
    real: Any,
    more: Sequence[str] = (),
    states: Sequence[str] = ("x1", "x2"),
) -> Callable[[], Any]:
    """Return the functions of an exported C controller as such a class."""
    library = ctypes.CDLL(str(path))
    point_fields = ("gap", "velocity", "acceleration", "jerk")[: 4 if "jerk_ref" in more else 3]

    class Point(ctypes.Structure):
        """A point of the reference as the header declares it."""

        _fields_ = tuple((name, real) for name in point_fields)

    class State(ctypes.Structure):
        """The controller's memory as the header declares it."""

        _fields_ = (
            *((name, real) for name in states),
            ("commanded", real),
            ("voltage", real),
            ("unusable", ctypes.c_uint32),
            ("status", ctypes.c_int),
        )

    memory = ctypes.POINTER(State)
    init, reset, step = (getattr(library, f"{prefix}_{name}") for name in ("init", "reset", "step"))
    init.argtypes, init.restype = (memory,), None
    reset.argtypes, reset.restype = (memory,), None
    step.argtypes, step.restype = (memory, real, real, real), real
    step_at = getattr(library, f"{prefix}_step_at")
    step_at.argtypes, step_at.restype = (memory, real, ctypes.POINTER(Point)), real

    class Native:
        """One compiled controller."""

        def __init__(self) -> None:
            self._state = State()
            self._memory = ctypes.byref(self._state)
            init(self._memory)

        @property
        def commanded(self) -> float:
            return float(self._state.commanded)

        @property
        def status(self) -> int:
            return int(self._state.status)

        def reset(self) -> None:
            reset(self._memory)

        def step(self, gap: float, reference: float, acceleration: float, *other: float) -> float:
            if not more:
                return float(step(self._memory, gap, reference, acceleration))
            known = dict(zip(more, other or (0.0,) * len(more), strict=True))
            rows = (reference, known.get("v_ref", 0.0), acceleration, known.get("jerk_ref", 0.0))
            point = Point(*rows[: len(point_fields)])
            return float(step_at(self._memory, gap, ctypes.byref(point)))

    return Native


def answer(new: Callable[[], Any], asked: int, told: int) -> None:
    """Answer requests until there are no more."""
    controllers = []
    while len(request := os.read(asked, REQUEST.size)) == REQUEST.size:
        word, number, count, *sample = REQUEST.unpack(request)
        voltage = 0.0
        if word == NEW:
            controllers.append(new())
        elif word == RESET:
            controllers[number].reset()
        else:
            voltage = controllers[number].step(*sample[:count])
        one = controllers[number]
        os.write(told, ANSWER.pack(one.commanded, voltage, one.status))


def replay(library: str, events: str, count: str, *outputs: str) -> None:
    """Let a compiled replay answer recorded events, and write what it says into two files."""
    places = [Path(name) for name in outputs[::2]]
    tables = [ctypes.create_string_buffer(int(size)) for size in outputs[1::2]]
    given = ctypes.create_string_buffer(Path(events).read_bytes())
    function = ctypes.CDLL(library).replay
    function.restype = None
    function(given, ctypes.c_uint32(int(count)), *tables)
    for place, table in zip(places, tables, strict=True):
        place.write_bytes(table.raw)


def main(kind: str, *words: str) -> None:
    """Do what the words say; what the controller itself prints goes nowhere."""
    told = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    if kind == "replay":
        replay(*words)
    elif kind == "python":
        answer(python_class(Path(words[0])), 0, told)
    else:
        real = {"double": ctypes.c_double, "float": ctypes.c_float}[words[2]]
        lists = [text.split(",") if text else [] for text in words[3:]] or [[], ["x1", "x2"]]
        answer(native_class(Path(words[0]), words[1], real, *lists), 0, told)


if __name__ == "__main__":
    main(*sys.argv[1:])
