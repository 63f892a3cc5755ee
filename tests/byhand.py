"""The control laws once more, written by hand with numpy: what the package's are held against.

A core reads r = (e, e', d), e the error, d the measured gap from Y, and gives w.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete

from maglev_design.options import Controller, Method

Array = NDArray[np.float64]
Matrices = tuple[Array, Array, Array, Array]

LAWS: dict[str, Controller] = {
    "tan-gpi": Controller(),
    "fee-gpi": Controller("fee-gpi"),
    "state-feedback": Controller("state-feedback"),
    "lin-pid": Controller("lin-pid"),
    "lin-pid with feedforward": Controller("lin-pid", feedforward="static"),
    "lin-pid of the measurement": Controller(
        "lin-pid", feedforward="static", derivative="measurement", filter=4.0
    ),
    "bumpless lin-pid": Controller("lin-pid", filter=7.5, start="bumpless"),
}
SOME = [LAWS[name] for name in ("tan-gpi", "fee-gpi", "state-feedback")]
SOME += [LAWS["lin-pid of the measurement"]]
"""One of each."""
OTHERS = [name for name in LAWS if name != "tan-gpi"]
SCIPY_NAME = {"tustin": "bilinear", "euler": "euler", "zoh": "zoh"}


@dataclass(frozen=True)
class Known:
    """What a controller is told: the equilibrium (Y, U), its coefficients and the physics."""

    Y: float
    U: float
    C_U: float
    C_Y: float
    beta: float
    g: float
    y0: float


def gains_of(law: Controller, poles: tuple[float, ...]) -> dict[str, float]:
    """Return the gains that put the roots where they are wanted, by multiplying them out."""
    zeta_1, omega_1, zeta_2, omega_2 = poles
    roots = [*np.roots([1.0, 2 * zeta_1 * omega_1, omega_1**2])]
    if law.name in ("tan-gpi", "fee-gpi"):
        roots += [*np.roots([1.0, 2 * zeta_2 * omega_2, omega_2**2])]
        return dict(zip(("k3", "k2", "k1", "k0"), np.poly(roots).real[1:].tolist(), strict=True))
    own = dict(zip(("k3", "k2", "k1"), np.poly([*roots, -omega_2]).real[1:].tolist(), strict=True))
    return own | ({"omega_f": law.filter * omega_2} if law.name == "lin-pid" else {})


def core(law: Controller, k: Mapping[str, float], c_u: float, c_y: float) -> Matrices:
    """Return A, B, C, D of a law's linear core from (e, e', d) to w."""
    error, speed, gap = np.eye(3)
    if law.name in ("tan-gpi", "fee-gpi"):
        if law.name == "fee-gpi":
            c_u, c_y = 1.0, 0.0
        lag = k["k1"] - k["k2"] * k["k3"] - k["k0"] / k["k3"]
        a = np.diag([0.0, -k["k3"]])
        b, c, d = [error, error], [k["k0"] / k["k3"], lag], (k["k2"] + c_y) * error
    elif law.name == "state-feedback":
        a, b, c = np.zeros((1, 1)), [error], [k["k1"]]
        d = (k["k2"] + c_y) * error + k["k3"] * speed
    else:
        moved = error if law.derivative == "error" else gap
        pole = k["omega_f"]
        a, b, c = np.diag([0.0, -pole]), [error, moved], [k["k1"], -k["k3"] * pole**2]
        d = (k["k2"] + c_y) * error + k["k3"] * pole * moved
    return a, np.array(b), np.array([c]) / c_u, np.array([d]) / c_u


def sampled(matrices: Matrices, period: float, method: Method) -> Matrices:
    """Return the difference equation of a core."""
    a, b, c, d, _ = cont2discrete(matrices, period, SCIPY_NAME[method])
    return a, b, c, d


def command(law: Controller, w: float, y_ref: float, acc_ref: float, known: Known) -> float:
    """Return the commanded voltage."""
    if law.name == "fee-gpi":
        pull = known.g - acc_ref + w
        return (y_ref + known.y0) * math.copysign(math.sqrt(abs(pull) / known.beta), pull)
    static = known.C_Y * (y_ref - known.Y)
    if law.name == "lin-pid":
        return known.U + w + (static / known.C_U if law.feedforward == "static" else 0.0)
    return known.U + w + (static - acc_ref) / known.C_U


def slope(law: Controller, u: float, y_ref: float, known: Known) -> float:
    """Return d u/d w at rest at y* under the voltage u."""
    if law.name == "fee-gpi":
        return (y_ref + known.y0) ** 2 / (2 * known.beta * u)
    return 1.0


def span(law: Controller, low: float, high: float, known: Known) -> float:
    """Return the width of w that takes the command across the range [low, high] at Y."""
    if law.name == "fee-gpi":
        return known.beta * (high**2 - low**2) / (known.Y + known.y0) ** 2
    return high - low
