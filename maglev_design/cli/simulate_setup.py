"""What ``simulate`` runs: one controller on one plant, from the options."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_design.cli.arguments import flag
from maglev_design.cli.law import PID, asked_poles, chosen_law
from maglev_design.controller.checks import check_path_voltage
from maglev_design.controller.design import (
    Design,
    coefficient_inputs,
    difference_coefficients,
    make_design,
    plant_beta,
    voltage_on_plant,
)
from maglev_design.errors import InputError
from maglev_design.options import DEFAULT_PRESET, Controller, LawName, Method
from maglev_design.paper.trials import TRIALS, Trial
from maglev_design.programs import gains_program
from maglev_design.rig import Emulator, Rig, load_rig, make_rig
from maglev_design.simulation import Scenario, emulated

if TYPE_CHECKING:
    from maglev_design.cli.commands.simulate import SimulateOptions

RATIOS = (0.01, 20.0)
"""beta_c/beta that can be asked for: a voltage at equilibrium three times too low or too high."""
PLANT_MOVES = "the plant moves, the controller stays"
LAWS: dict[LawName, str] = {
    "tan-gpi": "TAN-GPI (20)",
    "fee-gpi": "FEE-GPI",
    "lin-pid": "LIN-PID",
    "state-feedback": "state feedback (14)",
    "tan-gpi-2": "TAN-GPI (20), the second-order law",
}
METHODS: dict[Method, str] = {
    "tustin": "Tustin",
    "euler": "forward Euler",
    "zoh": "zero-order hold",
}


def _trial(options: SimulateOptions) -> Trial:
    """Return the paper's test that was asked for; the nominal one by default."""
    return next(trial for trial in TRIALS if trial.name == (options.test or "nominal"))


def _ratio(options: SimulateOptions) -> float:
    """Return the ratio beta_c/beta that was asked for, or that of the test; refuse what is none."""
    if options.beta_ratio is None:
        return _trial(options).ratio
    ratio, (low, high) = options.beta_ratio, RATIOS
    if not low <= ratio <= high:
        percent = f"; is it per cent? {ratio:g} % is {ratio / 100:g}" if ratio > high else ""
        raise InputError(
            f"beta-ratio = {ratio!r} [-]: must be a number from {low:g} to {high:g}, the "
            f"controller's beta over the plant's{percent}"
        )
    return ratio


def _continuous(options: SimulateOptions) -> bool:
    """Whether the continuous law was asked for."""
    return options.sample_time == 0


@dataclass(frozen=True)
class SimulationSetup:
    """One controller on one plant, ready to run.

    Attributes
    ----------
    rig : Rig
        The plant, on the path, period and voltage range of the controller.
    design : Design
    scenario : Scenario
    ratio : float
        beta_c/beta [-].
    moves : str
        What makes the ratio what it is.
    continuous, emulate : bool
    rediscretised : bool
        Whether a saved controller runs at another period than its own, as another controller.
    by_default : bool
        Whether nobody asked for these poles.
    """

    rig: Rig
    design: Design
    scenario: Scenario
    ratio: float
    moves: str
    continuous: bool = False
    emulate: bool = False
    rediscretised: bool = False
    by_default: bool = False

    def __str__(self) -> str:
        """Return what runs in one line: law, poles, period, reading, ratio and plant."""
        design, period = self.design, f"{1e3 * self.rig.sampling.period:g} ms"
        words = [law_words(self.rig, design.controller)]
        words += [design.controller.variant] if design.controller.variant else []
        words.append(_placement(design) + (" (the paper's default)" if self.by_default else ""))
        words.append("continuous" if self.continuous else f"{METHODS[design.method]} at {period}")
        if self.rediscretised:
            words[-1] += " (rediscretised: another controller)"
        words.append(f"reading {design.equilibrium}")
        words.append(f"beta_c/beta = {self.ratio:g} ({self.moves})")
        words.append(f"{'emulated ' if self.emulate else ''}plant: {self.rig.name}")
        return ", ".join(words)

    def as_dict(self) -> dict[str, Any]:
        """Return what runs for JSON."""
        design, period = self.design, self.rig.sampling.period
        return {
            "ran": str(self),
            "controller": design.controller.name,
            "variant": design.controller.variant or "default",
            "controller_sha256": None if self.continuous else design.sha256,
            "poles": design.poles.pairs,
            "gains": design.named_gains,
            "equilibrium": design.equilibrium,
            "method": None if self.continuous else design.method,
            "sample_time": 0.0 if self.continuous else period,
            "rediscretised": self.rediscretised,
            "plant": self.rig.name,
            "ratio": self.ratio,
            "noise": self.scenario.noise,
            "seed": self.scenario.seed,
            "emulated": self.emulate,
        }


def law_words(rig: Rig, law: Controller) -> str:
    """Return what a law is called on a rig."""
    if law.plant_order > 2:
        return "TAN-GPI of third order"
    second = law.name == "tan-gpi" and rig.kind.order > 2
    return LAWS["tan-gpi-2" if second else law.name]


def _are_placed(design: Design) -> bool:
    """Whether the gains are those of the poles, and not somebody's own."""
    placed = gains_program(design.controller).scalar()(*design.poles.values)
    return all(math.isclose(a, b, rel_tol=1e-12) for a, b in zip(placed, design.gains, strict=True))


def _placement(design: Design) -> str:
    """Return the poles in words, or the gains where no poles placed them."""
    if not _are_placed(design):
        return "gains " + ", ".join(f"{name} = {x:g}" for name, x in design.named_gains.items())
    (zeta, omega), (other, last) = design.poles.first, design.poles.second
    if design.controller.name in ("lin-pid", "state-feedback"):
        return f"zeta {zeta:g}, omega_n {omega:g} rad/s, real pole -{last:g} rad/s"
    if design.poles.first == design.poles.second:
        return f"zeta {zeta:g}, omega_n {omega:g} rad/s"
    return f"zeta {zeta:g} and {other:g}, omega_n {omega:g} and {last:g} rad/s"


def set_up(options: SimulateOptions) -> SimulationSetup:
    """Return what the options ask for."""
    if options.design is None:
        return _without_a_design(options)
    return _saved(options, options.design)


def _without_a_design(options: SimulateOptions) -> SimulationSetup:
    """Return a controller made here, as in the paper: its beta_c moves, the plant stays."""
    if options.plant is not None:
        raise InputError(
            "--plant: puts a saved controller on another plant; give it with --design, or take "
            f"--rig {options.plant}"
        )
    ratio, rig = _ratio(options), load_rig(options.rig or DEFAULT_PRESET)
    period = options.sample_time or None
    if period is not None:
        rig = _with_period(rig, period)
    rig = _emulated(rig, period, options)
    check_path_voltage(rig)
    beta = plant_beta(rig)
    design = make_design(
        rig,
        asked_poles(options),
        controller=chosen_law(options.controller or "tan-gpi", rig, options),
        equilibrium=options.equilibrium or "model",
        method=options.method,
        beta_c=beta * ratio,
        voltage=voltage_on_plant(rig, beta),
    )
    return SimulationSetup(
        rig,
        design,
        _scenario(rig, beta, options),
        ratio,
        "the plant stays, the controller's beta_c moves, as in the paper's test 3",
        _continuous(options),
        options.emulate,
        by_default=options.zeta is None and options.omega_n is None,
    )


def _saved(options: SimulateOptions, path: Path) -> SimulationSetup:
    """Return a saved controller, its numbers as they are: the plant moves."""
    from maglev_design.record import load  # noqa: PLC0415 - only when a design is given

    if options.rig is not None:
        raise InputError(
            f"--rig with --design: a saved design has its rig; --plant {options.rig} is how it "
            "meets another plant"
        )
    ratio, record = _ratio(options), load(path)
    own, design, moves = record.rig, record.design, PLANT_MOVES
    _check_same(options, design)
    period = options.sample_time or design.period
    if period != design.period:
        own = _with_period(own, period)
        known = coefficient_inputs(own, design.believed) | design.named_gains
        made = difference_coefficients(known, design.method, design.controller)
        design = replace(design, period=period, coefficients=made)
    rig, beta, plant_gap = own, design.beta_at(ratio), None
    if options.plant is not None:
        rig = _on_plant(own, design, options.plant, options)
        if rig.kind.actuation == "coil":  # where its inductance is what the file says
            plant_gap = load_rig(options.plant).operating_point.gap
        beta, moves = plant_beta(rig), "another rig's plant, the controller stays"
        ratio = design.believed.beta / beta
    rig = _emulated(rig, period, options)
    check_path_voltage(rig)
    scenario = _scenario(rig, beta, options)
    if plant_gap is not None:
        scenario = replace(scenario, numbers=(("Y", plant_gap),))
    return SimulationSetup(
        rig,
        design,
        scenario,
        ratio,
        moves,
        _continuous(options),
        options.emulate,
        rediscretised=period != record.design.period,
    )


def _check_same(options: SimulateOptions, design: Design) -> None:
    """Refuse options that would make another controller than the saved one."""
    law, poles, placed = design.controller, design.poles.values, _are_placed(design)
    own: dict[str, tuple[Any, ...]] = {
        "zeta": poles[0::2] if placed else (),
        "omega_n": poles[1::2] if placed else (),
        "equilibrium": (design.equilibrium,),
        "method": (design.method,),
        "controller": (law.name,),
        **{name: (getattr(law, name),) for name in PID},
    }
    asked = vars(options)
    other = {
        name: asked[name]
        for name, values in own.items()
        if asked[name] is not None and set(values) != {asked[name]}
    }
    if other:
        names = ", ".join(f"{flag(name)} {x}" for name, x in other.items())
        raise InputError(
            f"{names}: not what the saved design has ({LAWS[law.name]}, {_placement(design)}, "
            f"method {design.method}, reading {design.equilibrium}), and --design runs exactly "
            "that; leave the option out, make another controller with the verb design, or leave "
            "--design out"
        )


def _on_plant(own: Rig, design: Design, source: str, options: SimulateOptions) -> Rig:
    """Return another rig's plant on the path, period and voltage range of the controller's."""
    plant = load_rig(source)
    if options.beta_ratio is not None or options.test == "mismatch":
        raise InputError(
            "--plant with --beta-ratio or --test mismatch: the other rig has its own beta; leave "
            "one of the two out"
        )
    constants = [(rig.plant.gravity, rig.plant.gap_offset) for rig in (own, plant)]
    if _continuous(options) and design.controller.name == "fee-gpi" and len(set(constants)) > 1:
        raise InputError(
            "--plant with --sample-time 0: the continuous FEE-GPI would read gravity and "
            "gap_offset of the other plant; leave --sample-time out"
        )
    data, mine = plant.model_dump(exclude_none=True), own.model_dump(exclude_none=True)
    data |= {name: mine[name] for name in ("operating_point", "reference", "sampling")}
    data["limits"]["voltage"] = mine["limits"]["voltage"]
    return make_rig(data, f"--plant {source}")


def _emulated(rig: Rig, period: float | None, options: SimulateOptions) -> Rig:
    """Return the rig as it is emulated, where that was asked for, at a period that was given."""
    if not options.emulate:
        return rig
    if rig.emulator == Emulator():
        raise InputError(
            f"--emulate: the rig {rig.name!r} has no [emulator] table; give it inductance [H] and "
            "resistance [ohm], sensor_step [m], actuator_step [V], period [s] or delay [s]"
        )
    if _continuous(options):
        raise InputError("--emulate: the emulated rig runs a sampled controller, not sample-time 0")
    return emulated(rig, period)


def _with_period(rig: Rig, period: float) -> Rig:
    data = rig.model_dump(exclude_none=True)
    data["sampling"]["period"] = period
    return make_rig(data, "--sample-time")


def _scenario(rig: Rig, beta: float, options: SimulateOptions) -> Scenario:
    """Return the start that was asked for, checked against the gap limits, and the noise."""
    gap, velocity = rig.initial.gap, rig.initial.velocity
    if options.initial_error is not None:
        gap = rig.reference.start_gap + options.initial_error
        low, high = rig.limits.gap
        if not low < gap < high:
            raise InputError(
                f"initial-error = {options.initial_error!r} m: the ball would start at {gap:.4g} m;"
                f" allowed is a start inside limits.gap, {low:g} m to {high:g} m"
            )
    if options.initial_velocity is not None:
        velocity = options.initial_velocity
        if not math.isfinite(velocity):
            raise InputError(f"initial-velocity = {velocity!r}: must be finite")
    noise = _trial(options).noise if options.noise is None else options.noise
    return Scenario(beta, gap, velocity, noise=noise, seed=options.seed)
