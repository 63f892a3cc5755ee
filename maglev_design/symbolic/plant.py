"""The symbol table and the nonlinear plant, eqs. (1)-(5), with a gap offset y0.

With y0 = 0 every expression is the paper's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import sympy as sp
from sympy import Expr, Symbol


@dataclass(frozen=True)
class Entry:
    """One row of the symbol table."""

    symbol: Symbol
    latex: str
    unit: str
    meaning: str


_TABLE: list[Entry] = []


def _symbol(name: str, latex: str, unit: str, meaning: str, *, positive: bool = False) -> Symbol:
    symbol = Symbol(name, positive=True) if positive else Symbol(name, real=True)
    _TABLE.append(Entry(symbol, latex, unit, meaning))
    return symbol


m = _symbol("m", "m", "kg", "mass of the ball", positive=True)
g = _symbol("g", "g", "m/s^2", "gravitational acceleration", positive=True)
K = _symbol("K", "K", "N m^2/A^2", "force constant of the magnet", positive=True)
C = _symbol("C", "C", "A/V", "coil current per input voltage", positive=True)
beta = _symbol("beta", r"\beta", "m^3/(s^2 V^2)", "`K C^2/m` of the plant", positive=True)
y0 = Symbol("y0", nonnegative=True)
_TABLE.append(Entry(y0, "y_0", "m", "magnetic offset of the gap"))
y = _symbol("y", "y", "m", "gap between ball and magnet")
v = _symbol("v", r"\dot{y}", "m/s", "velocity of the ball, downwards")
acc = _symbol("acc", r"\ddot{y}", "m/s^2", "acceleration of the ball, downwards")
i = _symbol("i", "i", "A", "coil current")
u = _symbol("u", "u", "V", "input voltage")
L = _symbol("L", "L", "H", "inductance of the coil", positive=True)
R = _symbol("R", "R", r"ohm", "resistance of the coil", positive=True)
u_coil = _symbol("u_coil", r"u_i", "V", "coil current over `C`, the voltage that it stands for")

Y = _symbol("Y", "Y", "m", "gap of the equilibrium", positive=True)
U = _symbol("U", "U", "V", "voltage of the equilibrium", positive=True)
C_U = _symbol("C_U", "C_U", "m/(s^2 V)", "voltage coefficient of the linearisation", positive=True)
C_Y = _symbol("C_Y", "C_Y", "1/s^2", "gap coefficient of the linearisation", positive=True)

y_d = _symbol("y_d", r"y_\delta", "m", "incremental gap, `y - Y`")
v_d = _symbol("v_d", r"\dot{y}_\delta", "m/s", "incremental velocity")
acc_d = _symbol("acc_d", r"\ddot{y}_\delta", "m/s^2", "incremental acceleration")
u_d = _symbol("u_d", r"u_\delta", "V", "incremental voltage, `u - U`")

y_ref = _symbol("y_ref", "y^*", "m", "reference gap")
v_ref = _symbol("v_ref", r"\dot{y}^*", "m/s", "reference velocity")
acc_ref = _symbol("acc_ref", r"\ddot{y}^*", "m/s^2", "reference acceleration")
e = _symbol("e", "e", "m", "tracking error, `y - y^*`")

beta_c = _symbol("beta_c", r"\beta_c", "m^3/(s^2 V^2)", "the controller's `beta`", positive=True)
C_U_hat = _symbol(
    "C_U_hat", r"\hat{C}_U", "m/(s^2 V)", "`C_U` that the controller believes", positive=True
)
C_Y_hat = _symbol(
    "C_Y_hat", r"\hat{C}_Y", "1/s^2", "`C_Y` that the controller believes", positive=True
)
C_U_true = _symbol("C_U_true", "C_U'", "m/(s^2 V)", "`C_U` at the actual gap", positive=True)
C_Y_true = _symbol("C_Y_true", "C_Y'", "1/s^2", "`C_Y` at the actual gap", positive=True)
rho = _symbol("rho", r"\rho", "-", "`C_U'/C_U` of the controller, the loop's gain", positive=True)

s = _symbol("s", "s", "1/s", "Laplace variable")
z = _symbol("z", "z", "-", "variable of the z-transform")
t = _symbol("t", "t", "s", "time", positive=True)
T = _symbol("T", "T", "s", "sampling period", positive=True)

k0 = _symbol("k0", "k_0", "1/s^4", "gain of the double integral", positive=True)
k1 = _symbol("k1", "k_1", "1/s^3", "gain of the integral", positive=True)
k2 = _symbol("k2", "k_2", "1/s^2", "gain of the error", positive=True)
k3 = _symbol("k3", "k_3", "1/s", "gain of the velocity", positive=True)
zeta = _symbol("zeta", r"\zeta", "-", "damping of the desired poles", positive=True)
omega_n = _symbol("omega_n", r"\omega_n", "rad/s", "frequency of the desired poles", positive=True)
zeta_1 = _symbol("zeta_1", r"\zeta_1", "-", "damping of the first pole pair", positive=True)
omega_1 = _symbol("omega_1", r"\omega_1", "rad/s", "frequency of the first pair", positive=True)
zeta_2 = _symbol("zeta_2", r"\zeta_2", "-", "damping of the second pole pair", positive=True)
omega_2 = _symbol("omega_2", r"\omega_2", "rad/s", "frequency of the second pair", positive=True)

SYMBOLS: tuple[Entry, ...] = tuple(_TABLE)
"""Every symbol of the derivation: letter, LaTeX, unit, meaning."""


@dataclass(frozen=True)
class Plant:
    """The plant as expressions in the symbols of this module.

    Attributes
    ----------
    force_balance : Expr
        Right side of (1), m y'' in newtons, in the current i.
    current : Expr
        Right side of (2), i in amperes.
    beta : Expr
        beta = K C^2/m.
    acceleration : Expr
        Right side of (4), y'' = g - beta u^2/(y + y0)^2 [m/s^2].
    equilibrium_voltage : Expr
        U(Y) of (5), sqrt(g/beta) (Y + y0) [V].
    coil_rate : Expr
        d(i/C)/dt [V/s] of a coil that is no ideal current source: L i' = R (C u - i).
    """

    force_balance: Expr
    current: Expr
    beta: Expr
    acceleration: Expr
    equilibrium_voltage: Expr
    coil_rate: Expr


@cache
def magnetic_levitation() -> Plant:
    """Return the plant m y'' = m g - K i^2/(y + y0)^2, i = C u, eqs. (1)-(5).

    Examples
    --------
    >>> plant = magnetic_levitation()
    >>> plant.acceleration.subs({y: Y, u: plant.equilibrium_voltage}).simplify()
    0
    """
    acceleration = g - beta * u**2 / (y + y0) ** 2
    rest = sp.solve(acceleration.subs(y, Y), u)
    (voltage,) = [root for root in rest if root.is_positive]
    return Plant(
        force_balance=m * g - K * i**2 / (y + y0) ** 2,
        current=C * u,
        beta=K * C**2 / m,
        acceleration=acceleration,
        equilibrium_voltage=sp.factor(voltage),
        coil_rate=sp.factor(R * (C * u - C * u_coil) / L / C),
    )
