"""``sweep``."""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_design import sweeping as sweeps
from maglev_design.cli.arguments import flag
from maglev_design.cli.law import asked_poles
from maglev_design.cli.output import (
    INTERRUPTED,
    number,
    print_json,
    progress_bar,
    say,
    shown,
    table,
    warn,
)
from maglev_design.controller.checks import check_path_voltage
from maglev_design.controller.design import (
    Design,
    make_design,
)
from maglev_design.controller.matching import law_named
from maglev_design.errors import InputError, nearest
from maglev_design.figures import DESCRIBED, OBJECTIVES, OF_A_RUN
from maglev_design.files import finite, json_bytes, output_folder, picked, write_bytes
from maglev_design.options import DEFAULT_PRESET, LAWS, Controller
from maglev_design.record import DesignRecord, load
from maglev_design.reporting.words import unit_text
from maglev_design.rig import DRAWN, Drive, PlantParameters, Rig, load_rig
from maglev_design.simulation import cores

if TYPE_CHECKING:
    from maglev_design.cli.commands.sweep import SweepOptions

RESULT = "sweep.json"
OF_CONTROLLER = ("plant", "drive", "operating_point", "sampling", "limits")
"""Sections of a rig that a design is computed from."""
SHOWN = (0.05, 0.5, 0.95, 0.99, 1.0)
MOST_ROWS = 5


def sweep(options: SweepOptions) -> None:
    """Compute what is missing, print, save."""
    rig, designs, error = _subject(options)
    check_path_voltage(rig)
    asked = picked(options, *sweeps.OF_A_SWEEP)
    setup = sweeps.make_setup(rig, designs, **asked, beta_error=error)
    runner = _runner(options)
    folder = output_folder(options.output, force=options.force)
    for text in _warnings(setup):
        warn(text)
    result, kept = None, 0
    with progress_bar() as progress:
        meter = _Meter(setup, progress)
        try:
            result = sweeps.sweep(setup, folder, runner, force=options.force, told=meter.told)
        except KeyboardInterrupt:
            kept = meter.kept
    if result is None:  # outside the handler, so that no interrupt is behind the exit
        say(
            f"interrupted: {kept} of {setup.chunks} chunks are kept in {options.output}; the "
            "same command continues"
        )
        sys.exit(INTERRUPTED)
    document = finite(result)
    write_bytes(folder / RESULT, json_bytes(document))
    if options.json:
        print_json(document)
    else:
        _print(document)
    say(meter.summary())
    say(f"written: {folder / RESULT}")


class _Meter:
    """How fast it goes and how long it will take, from the loops of this run."""

    def __init__(self, setup: sweeps.Setup, progress: Any) -> None:
        self._setup, self._progress = setup, progress
        self._begun = time.monotonic()
        self._done = self._wanted = self._found = 0

    def told(self, done: int, wanted: int, found: int) -> None:
        self._done, self._wanted, self._found = done, wanted, found
        share = (found + done) / max(1, found + wanted)
        left = "" if not done else f", {_clock((wanted - done) * self._spent() / done)} left"
        self._progress(f"{self._rate():,.0f} loops/s{left}" if done else "starting", share)

    @property
    def kept(self) -> int:
        return self._found + self._done

    def summary(self) -> str:
        if not self._done:
            return f"every one of the {self._found} chunks was there already"
        rest = f", {self._found} chunks were there already" if self._found else ""
        return (
            f"{self._loops()} loops in {_clock(self._spent())}, {self._rate():,.0f} a second{rest}"
        )

    def _loops(self) -> int:
        setup = self._setup
        return min(self._done * setup.chunk, setup.samples) * len(setup.designs)

    def _spent(self) -> float:
        return time.monotonic() - self._begun

    def _rate(self) -> float:
        return self._loops() / max(self._spent(), 1e-9)


def _clock(seconds: float) -> str:
    """Return a duration as people say it."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def _runner(options: SweepOptions) -> sweeps.Runner:
    if options.scheduler is not None:
        if options.jobs is not None:
            raise InputError("--jobs: not with --scheduler, whose workers are what they are")
        return sweeps.on_cluster(options.scheduler)
    if options.jobs is None:
        return partial(sweeps.locally, cores=cores())
    if options.jobs == 1:
        return sweeps.in_process
    return partial(sweeps.in_processes, jobs=options.jobs)


def _subject(
    options: SweepOptions,
) -> tuple[Rig, tuple[Design, ...], float | None]:
    """Return the rig whose scenarios are drawn, every controller that runs them, the error of beta.

    Saved designs bring the error that they were made with, unless a rig is named.
    """
    paths, named = options.design or [], options.controller or []
    made = bool(named) or not paths
    if not made:
        for name in ("zeta", "omega_n", "equilibrium", "method"):
            if getattr(options, name) is not None:
                raise InputError(
                    f"{flag(name)}: belongs to --controller; what a saved design is "
                    "stands in its file"
                )
    records = [load(path) for path in paths]
    if options.rig is not None or not records:
        rig = load_rig(options.rig or DEFAULT_PRESET)
    else:
        rig = records[0].rig
    for path, record in zip(paths, records, strict=True):
        against = options.rig or paths[0]
        _same_rig(path, record, rig, against=str(against), named=options.rig is not None)
    designs = [record.design for record in records]
    if made:
        poles = asked_poles(options)
        designs += [
            make_design(
                rig,
                poles,
                controller=_controller(name, rig),
                equilibrium=options.equilibrium or "model",
                method=options.method,
            )
            for name in named or ("tan-gpi",)
        ]
    return rig, tuple(designs), None if options.rig is not None else _error(paths, records)


def _error(paths: list[Path], records: list[DesignRecord]) -> float | None:
    """Return the error of beta that all of the records were made with; None: what the rig says."""
    errors = [record.given_beta_error for record in records]
    for path, error in zip(paths, errors, strict=True):
        if error != errors[0]:
            raise InputError(
                f"{path}: made with --beta-error {_said(error)}, {paths[0]} with "
                f"{_said(errors[0])}: two families of plants; sweep each design alone, or say with "
                "--rig whose uncertainty is meant"
            )
    return errors[0] if errors else None


def _said(error: float | None) -> str:
    return "left out" if error is None else f"{error:g}"


def _controller(word: str, rig: Rig) -> Controller:
    name = next((name for name in LAWS if name == word), None)
    if name is None:
        raise InputError(
            f"--controller {word!r}: must be one of {', '.join(LAWS)}" + nearest(word, LAWS)
        )
    return law_named(name, rig)


def _same_rig(path: Path, record: DesignRecord, rig: Rig, *, against: str, named: bool) -> None:
    """Refuse a design that was made for another plant, or whose scenarios are not the same."""
    sections = [name for name in Rig.model_fields if name not in ("name", "source", "notes")]
    for section in OF_CONTROLLER if named else sections:
        for field, value in getattr(record.rig, section):
            other = getattr(getattr(rig, section), field)
            if value == other:
                continue
            remedy = (
                "tune again for this rig"
                if section in OF_CONTROLLER
                else "say with --rig which rig's scenarios are meant"
            )
            raise InputError(
                f"{path}: made for a rig with {section}.{field} = {value!r}, not "
                f"{other!r} as {against} has it; {remedy}"
            )


def _warnings(setup: sweeps.Setup) -> list[str]:
    """Return what a person must know before the sweep is worth its time."""
    rig, found = setup.rig, []
    spreads = setup.spreads
    if not spreads:
        found.append(
            "the rig states no uncertainty: all scenarios are "
            + ("alike but for the noise" if setup.noise else "one and the same")
            + "; give it an [uncertainty] table"
        )
    unused = [name for name in rig.uncertainty.spreads if name not in spreads]
    if unused:
        found.append(
            f"uncertainty.{', '.join(unused)}: not drawn: under the reading "
            f"{setup.equilibrium!r} the plant's beta follows from the voltage that holds the ball"
        )
    if sweeps.beta_is_computed(rig, setup.equilibrium) and rig.uncertainty.beta:
        found.append(
            f"uncertainty.beta = {rig.uncertainty.beta:g} is not used: the plant's beta follows "
            "from what is drawn for mass, current_gain and force_constant"
        )
    for name, spread in spreads.items():
        if name not in DRAWN:
            continue
        value, (low, high) = rig.stated(name), spread.reach
        if DRAWN[name][0] in (PlantParameters, Drive) and not low <= value <= high:
            found.append(
                f"uncertainty.{name}: {low:g} to {high:g} does not hold the rig's own {value:g}, "
                "which the controller has"
            )
    if not setup.noise and {"input_noise", "position_noise"} & set(spreads):
        found.append("--no-noise: what is drawn for input_noise and position_noise does nothing")
    if setup.sampling == "sobol" and setup.samples & (setup.samples - 1):
        found.append("a Sobol sequence is balanced only when --samples is a power of 2")
    return found


def _print(document: dict[str, Any]) -> None:
    setup = document["setup"]
    drawn = ", ".join(document["drawn"]) or "nothing"
    sys.stdout.write(
        f"{setup['samples']} scenarios, {setup['sampling']}, seed {setup['seed']}, "
        f"noise {'on' if setup['noise'] else 'off'}; drawn: {drawn}; plant's beta from "
        f"{document['beta_from']}\n\n"
    )
    for position, design in enumerate(document["designs"]):
        _print_design(position, design)


def _print_design(position: int, design: dict[str, Any]) -> None:
    (zeta, omega_n), *_ = design["poles"]
    name = design["controller"]
    title = f"{position}: {name}, zeta = {zeta:.4g}, omega_n = {omega_n:.4g} rad/s"
    rows = [
        (
            f"{key} [{unit_text(DESCRIBED[key].unit)}]",
            *[number(design["quantiles"][key][f"{p:g}"]) for p in SHOWN],
        )
        for key in (*OBJECTIVES, *OF_A_RUN)
    ]
    low, high = design["stable_fraction_interval"]
    table(title, ("quantile", *[f"{100 * p:g} %" for p in SHOWN]), rows)
    sys.stdout.write(
        f"The ball levitates to the end in {100 * design['stable_fraction']:.6g} % of the "
        f"scenarios (95 % interval {100 * low:.4g} % to {100 * high:.4g} %, for independent "
        "draws).\n\n"
    )
    worst = design["worst"][:MOST_ROWS]
    names = list(worst[0]["drawn"])
    table(
        "Worst scenarios; run one again with simulate --replay "
        f"{RESULT}:SCENARIO{f':{position}' if position else ''}",
        ("scenario", "ball", "ITAE", *names),
        [
            (
                str(one["scenario"]),
                one["crash"]["where"] if one["crash"] else "levitated",
                shown("itae", one["itae"]),
                *[number(one["drawn"][name], "", 6) for name in names],
            )
            for one in worst
        ],
        words=2,
    )
