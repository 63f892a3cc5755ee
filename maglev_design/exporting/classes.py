"""Every class of argument in every state of the controller, against the rule stated apart."""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Iterator

from maglev_design.exporting.controller import ExportedController
from maglev_design.exporting.loops import NewDevice
from maglev_design.exporting.vectors import Recorder, Sample, limits


def class_samples(controller: ExportedController) -> Iterator[Sample]:
    """Yield one sample of every combination of classes of the first three arguments.

    Those that a law reads besides are tried one by one, the others at rest.
    """
    n, rest = controller.numbers, controller.record.rig.reference.start_gap
    nan, inf = math.nan, math.inf
    odd = (nan, -nan, inf, -inf, 1.7e308, -1.7e308, 5e-324, -5e-324, 0.0, -0.0)
    gaps = (*odd, rest, n["gap_low"], n["gap_high"], *_beyond(n["gap_low"], n["gap_high"]))
    limit = n["acc_max"]
    accelerations = (*odd, limit, -limit, *_beyond(-limit, limit))
    zeros = (0.0,) * len(controller.more)
    for sample in itertools.product(gaps, gaps, accelerations):
        yield (*sample, *zeros)
    still = [rest, rest, 0.0, *zeros]
    for place, (low, high) in list(enumerate(limits(controller)))[3:]:
        for value in (*odd, low, high, *_beyond(low, high)):
            yield tuple(value if n == place else x for n, x in enumerate(still))


def _beyond(low: float, high: float) -> tuple[float, float]:
    return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)


def single(value: float) -> float:
    """Return a number as single precision holds it, infinite beyond its range."""
    try:
        return float(struct.unpack("f", struct.pack("f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


def wrong_answers(
    controller: ExportedController, new: NewDevice, *, exact: bool
) -> tuple[int, int]:
    """Return (answers that break the rule, answers) over all classes, fresh and running.

    Every sample meets a new controller and one that runs; then a good sample must be answered as
    if a bad one had never been. With `exact` every voltage and status must be that of
    :class:`Recorder`; else (single precision, which rounds the edges of the ranges) it must be
    finite and inside the range.
    """
    n, path = controller.numbers, controller.record.rig.reference
    rest = (path.start_gap * 1.001, path.start_gap, 0.0, *(0.0 for _ in controller.more))
    low, high = n["u_min"], n["u_max"]
    if not exact:
        low, high = single(low), single(high)
    wrong = answers = 0
    fresh, running = new(), new()
    model, moved = Recorder(controller), Recorder(controller)
    for sample in class_samples(controller):
        fresh.reset()
        model.forget()
        running.reset()
        moved.forget()
        pairs = [
            (fresh.step(*sample), model.step(*sample)[1]),
            (running.step(*rest), moved.step(*rest)[1]),
            (running.step(*sample), moved.step(*sample)[1]),
            (running.step(*rest), moved.step(*rest)[1]),
        ]
        for told, expected in pairs:
            answers += 1
            wrong += not low <= told <= high or (exact and told != expected)
    return wrong, answers
