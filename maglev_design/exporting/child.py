"""The process in which an exported controller runs: asked through a pipe, one sample at a time.

Started by its path with an interpreter that is isolated, so it needs the standard library alone::

    child.py python FILE              # answer requests with the class Controller of a source
    child.py c LIBRARY PREFIX TYPE    # the same with a shared library; TYPE is double or float
    child.py replay LIBRARY EVENTS COUNT ANSWERS SIZE FIGURES SIZE

A request is one of three words, the number of a controller and three numbers; an answer is the
commanded and the applied voltage and the status.
"""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

REQUEST = struct.Struct("<BI3d")
ANSWER = struct.Struct("<2di")
NEW, RESET, STEP = range(3)


def python_class(path: Path) -> Callable[[], Any]:
    """Return the class of an exported Python controller."""
    space: dict[str, Any] = {"__name__": path.stem}
    exec(compile(path.read_bytes(), path.name, "exec"), space)  # noqa: S102 - what this is for
    new: Callable[[], Any] = space["Controller"]
    return new


def native_class(path: Path, prefix: str, real: Any) -> Callable[[], Any]:
    """Return the functions of an exported C controller as such a class."""
    library = ctypes.CDLL(str(path))

    class State(ctypes.Structure):
        """The controller's memory as the header declares it."""

        _fields_ = (
            ("x1", real),
            ("x2", real),
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

        def step(self, gap: float, reference: float, acceleration: float) -> float:
            return float(step(self._memory, gap, reference, acceleration))

    return Native


def answer(new: Callable[[], Any], asked: int, told: int) -> None:
    """Answer requests until there are no more."""
    controllers = []
    while len(request := os.read(asked, REQUEST.size)) == REQUEST.size:
        word, number, *sample = REQUEST.unpack(request)
        voltage = 0.0
        if word == NEW:
            controllers.append(new())
        elif word == RESET:
            controllers[number].reset()
        else:
            voltage = controllers[number].step(*sample)
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
        answer(native_class(Path(words[0]), words[1], real), 0, told)


if __name__ == "__main__":
    main(*sys.argv[1:])
