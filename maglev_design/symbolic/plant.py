"""The symbol table and the nonlinear plants: eqs. (1)-(5), other force laws, a coil, damping.

With u = u_i + u0 and u_i = i/C the voltage that the coil current stands for,

    y'' = g - delta y' - beta u_i^p f(y),  beta = K C^p/m,

f the profile of the force. For f = 1/(y + y0)^2 and p = 2, undamped, with u_i = u, this is (4);
with y0 = 0 every expression is the paper's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import sympy as sp
from sympy import Expr, Symbol

from maglev_design.options import PAPER_PLANT, ForceLaw, PlantKind


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

n_gap = _symbol("n_gap", "q", "-", "exponent of the gap in the force", positive=True)
decay = _symbol("decay", "a", "m", "length over which the force falls to 1/e", positive=True)
delta = _symbol("delta", r"\delta", "1/s", "viscous damping of the ball over its mass")
u0 = _symbol("u0", "u_0", "V", "offset of the input")
jerk_ref = _symbol("jerk_ref", r"\dddot{y}^*", "m/s^3", "third derivative of the reference")
tau = _symbol("tau", r"\tau", "s", "time constant of the drive at the design gap", positive=True)
kappa = _symbol("kappa", r"\kappa", "1/s", "`C_U` times the back-EMF of a velocity [V s/m]")
delta_hat = _symbol("delta_hat", r"\hat{\delta}", "1/s", "`delta` that the controller believes")
tau_hat = _symbol(
    "tau_hat", r"\hat{\tau}", "s", "`tau` that the controller believes", positive=True
)
kappa_hat = _symbol("kappa_hat", r"\hat{\kappa}", "1/s", "`kappa` that the controller believes")

OTHER_SYMBOLS: tuple[Entry, ...] = tuple(_TABLE[len(SYMBOLS) :])
"""Symbols of plants other than the paper's."""


@dataclass(frozen=True)
class ForceProfile:
    """How a force law falls with the gap.

    Attributes
    ----------
    fall : Expr
        f(y): the magnet pulls with K i^p f(y).
    potential : Expr
        F(y) with F' = -f; the flux through the coil is L i + p K i^(p-1) (F(y) - F(Y)).
    numbers : tuple of Symbol
        What f is made of besides y and y0.
    """

    fall: Expr
    potential: Expr
    numbers: tuple[Symbol, ...] = ()


FORCES: Mapping[ForceLaw, ForceProfile] = {
    "inverse-square": ForceProfile((y + y0) ** -2, 1 / (y + y0)),
    "power": ForceProfile((y + y0) ** -n_gap, (y + y0) ** (1 - n_gap) / (n_gap - 1), (n_gap,)),
    "exponential": ForceProfile(sp.exp(-y / decay), decay * sp.exp(-y / decay), (decay,)),
}
"""The force laws. A further one is an entry here, its word in ``options.ForceLaw``, and the numbers
that it needs in the rig file."""


@dataclass(frozen=True)
class Plant:
    """A plant as expressions in the symbols of this module.

    Attributes
    ----------
    kind : PlantKind
    force_balance : Expr
        Right side of (1), m y'' in newtons, in the current i.
    current : Expr
        Right side of (2), i in amperes.
    beta : Expr
        beta = K C^p/m; letter and unit are those of (4).
    acceleration : Expr
        y'' [m/s^2] in y, y' and the input that acts, u; for (4) g - beta u^2/(y + y0)^2. Behind a
        drive with a state that input is u_i, the coil current over C.
    equilibrium_voltage : Expr
        U(Y), for (5) sqrt(g/beta) (Y + y0) [V], the input's offset included.
    drive_rate : Expr
        d(u_i)/dt [V/s] under the input u; in L and R, with R = 1 and L the time constant for a lag
        that is no coil's. Zero where the current follows at once.
    inductance : Expr
        Of the coil at the gap y [H], the flux by the current; must be positive.
    """

    kind: PlantKind
    force_balance: Expr
    current: Expr
    beta: Expr
    acceleration: Expr
    equilibrium_voltage: Expr
    drive_rate: Expr
    inductance: Expr

    @property
    def profile(self) -> ForceProfile:
        """How the force falls with the gap."""
        return FORCES[self.kind.force]

    @property
    def static(self) -> Expr:
        """The acceleration in y, y' and the input u of the rig, the drive settled."""
        if self.kind.offset and self.kind.order > 2:
            return self.acceleration.subs(u, u - u0)
        return self.acceleration

    @property
    def extras(self) -> tuple[Symbol, ...]:
        """What the plant is made of besides g, beta and y0, in one order."""
        kind = self.kind
        coil = {"ideal": (), "lag": (L, R), "coil": (L, R, m, Y)}[kind.actuation]
        damping, offset = (delta,) * kind.damped, (u0,) * kind.offset
        return (*self.profile.numbers, *damping, *coil, *offset)


@cache
def magnetic_levitation(kind: PlantKind = PAPER_PLANT) -> Plant:
    """Return the plant of a kind; without one m y'' = m g - K i^2/(y + y0)^2, i = C u, (1)-(5).

    The coil obeys u - u0 = R i + d(lambda)/dt with the flux lambda of :class:`ForceProfile`, which
    has the force as the gradient of its co-energy: for p = 2 that is d(L(y) i)/dt with
    L(y) = L + 2 K (F(y) - F(Y)), L the inductance at the gap Y.

    Examples
    --------
    >>> plant = magnetic_levitation()
    >>> plant.acceleration.subs({y: Y, u: plant.equilibrium_voltage}).simplify()
    0
    """
    force, power = FORCES[kind.force], kind.exponent
    acting = u - u0 if kind.offset and kind.actuation == "ideal" else u
    acceleration = g - beta * acting**power * force.fall
    if kind.damped:
        acceleration -= delta * v
    held = sp.powdenest((g / (beta * force.fall.subs(y, Y))) ** sp.Rational(1, power), force=True)
    if kind == PAPER_PLANT:
        held = sp.factor(held)
    rate, inductance = _drive(kind, force)
    return Plant(
        kind=kind,
        force_balance=m * g - K * i**power * force.fall - (m * delta * v if kind.damped else 0),
        current=C * u,
        beta=K * C**power / m,
        acceleration=acceleration,
        equilibrium_voltage=held + (u0 if kind.offset else 0),
        drive_rate=rate,
        inductance=inductance,
    )


def _drive(kind: PlantKind, force: ForceProfile) -> tuple[Expr, Expr]:
    """Return the rate of u_coil, and the inductance.

    From u - u0 = u_coil + (flux by i) i' + (flux by y) y'.
    """
    if kind.actuation == "ideal":
        return sp.Integer(0), sp.Integer(0)
    power = kind.exponent
    flux = L * i
    if kind.actuation == "coil":
        constant = beta * m * R**power  # K, since C = 1/R
        flux += power * constant * i ** (power - 1) * (force.potential - force.potential.subs(y, Y))
    current = u_coil / R
    by_current, by_gap = (sp.diff(flux, x).subs(i, current) for x in (i, y))
    given = u - u0 if kind.offset else u
    rate = sp.factor(R * (given - u_coil)) / by_current - sp.simplify(by_gap * R) * v / by_current
    return rate, by_current
