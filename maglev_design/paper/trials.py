"""The paper's tests, its controllers and what it leaves open about them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from maglev_design.controller.design import (
    PAPER_POLES,
    PoleSpec,
    make_design,
    plant_beta,
    voltage_on_plant,
)
from maglev_design.figures import EXTREMES, INDICES
from maglev_design.options import TAN_GPI, Controller, Equilibrium, Method
from maglev_design.rig import Rig, make_rig
from maglev_design.simulation import (
    LoopGraph,
    Response,
    Scenario,
    emulated,
    loop_for,
    mirrored,
    settling_time,
    simulate,
    total_variation,
    undershoot,
)

MISMATCH = 1.15
"""beta_c/beta of test 3, sec. 4.3."""
SLOW_PERIOD = 0.002
"""[s] Sampling period of the experiments, sec. 5.2."""
REAL_SENSOR_NOISE = 1.0e-5
"""[m] Standard deviation of an ordinary optical gap sensor, assumed; test 2 has 1.4e-9 m."""


@dataclass(frozen=True)
class Trial:
    """One of the paper's tests.

    Attributes
    ----------
    name : str
        As on the command line.
    title : str
    ratio : float
        beta_c/beta.
    noise, emulate : bool
        Whether the rig's noise and the effects of the emulator act.
    """

    name: str
    title: str
    ratio: float = 1.0
    noise: bool = False
    emulate: bool = False


NOMINAL = Trial("nominal", "Test 1, nominal")
NOISE = Trial("noise", "Test 2, noise", noise=True)
MISMATCHED = Trial("mismatch", "Test 3, noise and beta_c = 1.15 beta", MISMATCH, noise=True)
TRIALS = (NOMINAL, NOISE, MISMATCHED)
"""Secs. 4.1 to 4.3."""
EMULATION = Trial("emulator", "Sec. 5 emulated, not the experiment", noise=True, emulate=True)


@dataclass(frozen=True)
class Contender:
    """One controller in the comparison.

    Attributes
    ----------
    label : str
        As in the paper's figures.
    controller : Controller
    poles : PoleSpec
    guess : str
        What about it is our reading and not in the paper; empty where nothing is.
    """

    label: str
    controller: Controller
    poles: PoleSpec
    guess: str = ""

    @property
    def variant(self) -> str:
        """The controller's variant in words, "default" for the first of its kind."""
        return self.controller.variant or "default"

    def as_dict(self) -> dict[str, str]:
        """Return who it is, for JSON."""
        return {
            "controller": self.controller.name,
            "label": self.label,
            "variant": self.variant,
            "guess": self.guess,
        }


PID_GUESS = (
    "the paper says a linear PID with poles at -70 and no more: feedforward, filter, what is "
    "differentiated and the start are our readings"
)
FEE_GUESS = (
    "the law and its fourth-order polynomial are our reading of the source that the paper cites; "
    "it gives the poles at -70 only"
)
STATE_GUESS = "eq. (14) with the velocity measured without error; the paper never simulates it"

PID_VARIANTS = (
    Controller("lin-pid"),
    Controller("lin-pid", feedforward="static"),
    Controller("lin-pid", derivative="measurement"),
    Controller("lin-pid", start="bumpless"),
    Controller("lin-pid", filter=5.0),
    Controller("lin-pid", feedforward="static", derivative="measurement"),
)
"""The default first: what of the paper's text fits no other feedforward."""


def contenders(tuned: PoleSpec | None = None, *, variants: bool = True) -> tuple[Contender, ...]:
    """Return the controllers in the order of the paper, default variants first.

    Parameters
    ----------
    tuned : PoleSpec, optional
        Poles of the tuned TAN-GPI, which then comes fourth.
    variants : bool
        Whether the other readings of the PID and the state feedback (14) follow.
    """
    poles = PoleSpec.double(*PAPER_POLES)
    pids = [Contender("LIN-PID", c, poles, PID_GUESS) for c in PID_VARIANTS]
    chosen = [
        Contender("TAN-GPI", TAN_GPI, poles),
        pids[0],
        Contender("FEE-GPI", Controller("fee-gpi"), poles, FEE_GUESS),
    ]
    if tuned is not None:
        chosen.append(Contender("TAN-GPI tuned", TAN_GPI, tuned))
    if variants:
        chosen.append(Contender("STATE (14)", Controller("state-feedback"), poles, STATE_GUESS))
        chosen += pids[1:]
    return tuple(chosen)


@dataclass(frozen=True)
class Reading:
    """What the paper leaves open about the loop.

    Attributes
    ----------
    equilibrium : str
    method : str or None
        None for a continuous controller.
    period : float
        [s]
    mirrored : bool
        Whether the initial error has the other sign.
    position_noise : float
        Standard deviation of the sensor's noise [m].
    controller_moves : bool
        Whether a wrong beta is the controller's (the paper's test 3) or the plant's.
    """

    equilibrium: Equilibrium
    method: Method | None
    period: float
    position_noise: float
    mirrored: bool = False
    controller_moves: bool = True


def default_reading(rig: Rig, equilibrium: Equilibrium = "model") -> Reading:
    """Return the reading that the rig's file and the contract's defaults give."""
    sampling = rig.sampling
    return Reading(equilibrium, sampling.method, sampling.period, rig.noise.position)


@lru_cache(maxsize=64)
def rig_for(rig: Rig, reading: Reading, *, emulate: bool = False) -> Rig:
    """Return `rig` with the period and the sensor noise of a reading, or as it is emulated."""
    data = rig.model_dump(exclude_none=True)
    data["sampling"]["period"] = reading.period
    data["noise"]["position"] = reading.position_noise
    changed = make_rig(data, "reading")
    return emulated(changed) if emulate else changed


@lru_cache(maxsize=128)
def _loop(
    rig: Rig, controller: Controller, poles: PoleSpec, method: Method | None, emulate: bool
) -> LoopGraph:
    """Return a loop, which knows the structure and not the numbers; a build serves every beta."""
    design = make_design(rig, poles, controller=controller, method=method)
    return loop_for(rig, design, continuous=method is None, emulate=emulate)


def run_trial(
    rig: Rig, contender: Contender, trial: Trial, reading: Reading, *, seed: int = 0
) -> tuple[Rig, Response]:
    """Return the rig as it was run and the response of one closed loop."""
    own = rig_for(rig, reading, emulate=trial.emulate)
    beta = plant_beta(rig)
    beta_c, beta_plant = beta * trial.ratio, beta
    if not reading.controller_moves:
        beta_c, beta_plant = beta, beta / trial.ratio
    # a sampled loop does not depend on the poles; a continuous one takes its step from them
    poles = contender.poles if reading.method is None else PoleSpec.double(*PAPER_POLES)
    loop = _loop(own, contender.controller, poles, reading.method, trial.emulate)
    design = make_design(
        own,
        contender.poles,
        controller=contender.controller,
        equilibrium=reading.equilibrium,
        method=reading.method,
        beta_c=beta_c,
        voltage=voltage_on_plant(own, beta_plant),
    )
    scenario = Scenario(
        beta_plant, own.initial.gap, own.initial.velocity, noise=trial.noise, seed=seed
    )
    if reading.mirrored:
        scenario = mirrored(own, scenario)
    return own, simulate(loop, design, scenario)


def _centre(rig: Rig) -> float:
    """Return the middle of "second 3 to second 5" of sec. 4.1 as it lies in the rig's move [s]."""
    path = rig.reference
    return path.start_time + 0.6 * (path.end_time - path.start_time)


def figures(rig: Rig, response: Response) -> dict[str, float]:
    """Return the figures of one run in SI units, the indices' splits, and ``crashed`` as 0 or 1."""
    found, path = response.metrics, rig.reference
    error = np.abs(response.gap - response.reference)
    centre = np.abs(response.times - _centre(rig)) <= 0.2 * (path.end_time - path.start_time)
    moving = (response.times > path.start_time) & (response.times <= path.end_time)
    holding = response.times > path.end_time
    values = {
        **{x: getattr(found, x) for x in (*INDICES, *EXTREMES[:3])},
        "total_variation": total_variation(response),
        "settling": settling_time(rig, response),
        "undershoot": undershoot(rig, response),
        "largest_error_moving": float(error[moving].max(initial=0.0)),
        "largest_error_centre": float(error[centre].max(initial=0.0)),
        "mean_error_holding": float(error[holding].mean()) if holding.any() else math.nan,
        "final_error": found.final_error,
        "crashed": float(found.crashed),
    }
    for index in INDICES:
        parts = getattr(found, f"{index}_split")
        values |= {f"{index}_{part}": value for part, value in parts.items()}
    return values
