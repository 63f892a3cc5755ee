"""Ctrl-C between two simulations, never inside one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str, float], None]


@contextmanager
def interruptible(progress: Progress) -> Iterator[Progress]:
    """Let Ctrl-C take effect where `progress` is called, and not in the middle of a simulation.

    A second Ctrl-C before that takes effect at once.
    """
    pressed = False

    def note(_signal: int, _frame: object) -> None:
        nonlocal pressed
        if pressed:
            raise KeyboardInterrupt
        pressed = True

    def checked(stage: str, done: float) -> None:
        nonlocal pressed
        if pressed:
            pressed = False
            raise KeyboardInterrupt
        progress(stage, done)

    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is signal.SIG_IGN:
        yield progress
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield checked
    finally:
        signal.signal(signal.SIGINT, before)
