"""An exported controller as something to call: it runs in a process of its own, never in this one.

A process that ends or does not answer in time is an error, whatever code it ends with.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from maglev_design.errors import VerificationError
from maglev_design.exporting import child
from maglev_design.exporting.controller import ExportedController
from maglev_design.exporting.loops import NewDevice
from maglev_design.tools import end

LONGEST_ANSWER = 20.0
"""[s] For one sample."""
INTERPRETER = (sys.executable, "-I", "-B", child.__file__)
"""Isolated: neither the folder nor the user's modules are looked at."""


@dataclass(frozen=True)
class Runnable:
    """A built controller: what :mod:`maglev_design.exporting.child` is started with."""

    words: tuple[str, ...]

    @classmethod
    def python(cls, path: Path) -> Runnable:
        """Return a Python source."""
        return cls(("python", str(path)))

    @classmethod
    def native(
        cls, library: Path, controller: ExportedController, *, single: bool = False
    ) -> Runnable:
        """Return a shared library of the C sources, in double or single precision."""
        lists = (",".join(controller.more), ",".join(controller.states))
        kind = "float" if single else "double"
        return cls(("c", str(library), controller.prefix, kind, *lists))

    @contextmanager
    def started(self) -> Iterator[NewDevice]:
        """Run it, and yield what makes new controllers there.

        Raises
        ------
        VerificationError
            Where it is used, when the process ends or does not answer in time.
        """
        process = subprocess.Popen(  # noqa: S603 - our own interpreter and script
            [*INTERPRETER, *self.words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            start_new_session=True,
        )
        talk = _Talk(process)
        try:
            with _one_core(process.pid):
                yield talk.new
        finally:
            talk.over.set()
            end(process)
            for pipe in (process.stdin, process.stdout):
                assert pipe is not None  # noqa: S101 - asked for above
                with suppress(OSError):
                    pipe.close()


@contextmanager
def _one_core(other: int) -> Iterator[None]:
    """Keep this thread and another process on one core, where the system can.

    They take turns: a switch on one core costs a seventh of waking another.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    core = {sorted(allowed)[other % len(allowed)]}
    try:
        with suppress(OSError):
            os.sched_setaffinity(other, core)
            os.sched_setaffinity(0, core)
        yield
    finally:
        with suppress(OSError):
            os.sched_setaffinity(0, allowed)


@dataclass
class _Talk:
    """Questions to one process."""

    process: subprocess.Popen[bytes]
    over: threading.Event = field(default_factory=threading.Event)
    made: int = 0
    asked_at: float | None = None

    def __post_init__(self) -> None:
        given, told = self.process.stdin, self.process.stdout
        assert given is not None  # noqa: S101 - asked for
        assert told is not None  # noqa: S101 - asked for
        self._given, self._told = given.fileno(), told.fileno()
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        """End the process when an answer takes too long."""
        while not self.over.wait(min(1.0, LONGEST_ANSWER / 4)):
            since = self.asked_at
            if since is not None and time.monotonic() - since > LONGEST_ANSWER:
                end(self.process)
                return

    def ask(self, word: int, number: int, *sample: float) -> tuple[float, float, int]:
        """Return (commanded, voltage, status) of one request."""
        self.asked_at = time.monotonic()
        try:
            room = (*sample, *(0.0,) * (5 - len(sample)))
            os.write(self._given, child.REQUEST.pack(word, number, len(sample), *room))
            answer, size = b"", child.ANSWER.size
            while len(answer) < size and (part := os.read(self._told, size - len(answer))):
                answer += part
        except OSError:
            answer = b""
        late = time.monotonic() - self.asked_at > LONGEST_ANSWER
        self.asked_at = None
        if len(answer) != child.ANSWER.size:
            why = f"no answer in {LONGEST_ANSWER:g} s" if late else "it ended instead of answering"
            raise VerificationError(f"the exported controller, in its own process: {why}")
        commanded, voltage, status = child.ANSWER.unpack(answer)
        return commanded, voltage, status

    def new(self) -> RemoteController:
        """Return a new controller there."""
        self.made += 1
        return RemoteController(self, self.made - 1)


class RemoteController:
    """One exported controller that runs in another process, as the exported class is called."""

    def __init__(self, talk: _Talk, number: int) -> None:
        self._talk, self._number = talk, number
        self.commanded, _, self.status = talk.ask(child.NEW, number)

    def reset(self) -> None:
        """Forget errors and faults."""
        self.commanded, _, self.status = self._talk.ask(child.RESET, self._number)

    def step(self, gap: float, reference: float, acceleration: float, *more: float) -> float:
        """Return the voltage for one sample."""
        told = self._talk.ask(child.STEP, self._number, gap, reference, acceleration, *more)
        self.commanded, voltage, self.status = told
        return voltage
