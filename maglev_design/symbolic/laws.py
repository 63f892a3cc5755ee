"""The control laws: gains by coefficient matching, and every law that can be run.

A law is a linear core from what is measured to a correction w, a static map from w and the
reference to the commanded voltage, an anti-windup rule, the bounds of its integrators and the
state it starts from. How a law is sampled, clamped and guarded is in
:mod:`maglev_design.symbolic.sampling`; simulation, tuning and export lower the same expressions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.options import TAN_GPI, Controller
from maglev_design.symbolic import plant as p

w = Symbol("w", real=True)
"""Output of a law's linear core: a voltage on top of the feedforward [V], for FEE-GPI [m/s^2]."""
u_min, u_max = Symbol("u_min", real=True), Symbol("u_max", real=True)
omega_f = Symbol("omega_f", positive=True)
"""[rad/s] Pole of the derivative's filter."""


def gain_symbols(order: int) -> tuple[Symbol, ...]:
    """Return (k_0, ..., k_{order-1}), the letters of (16) and (23) for any order."""
    return tuple(sp.Symbol(f"k{index}", positive=True) for index in range(order))


def match_coefficients(desired: Expr, order: int) -> tuple[Expr, ...]:
    """Return the gains (k_0, ..., k_{order-1}) that place the poles, eqs. (24)-(25) for any order.

    Equates s^n + k_{n-1} s^{n-1} + ... + k_0 with the monic polynomial `desired` in s.

    Raises
    ------
    ValueError
        When `desired` is not monic of that order.

    Examples
    --------
    >>> from maglev_design.symbolic.plant import s, zeta, omega_n
    >>> match_coefficients((s**2 + 2 * zeta * omega_n * s + omega_n**2) ** 2, 4)[3]
    4*omega_n*zeta
    """
    polynomial = sp.Poly(sp.expand(desired), p.s)
    if polynomial.degree() != order or polynomial.LC() != 1:
        raise ValueError(f"the desired polynomial must be monic of order {order} in s")
    unknown = gain_symbols(order)
    closed_loop = p.s**order + sum(k * p.s**index for index, k in enumerate(unknown))
    difference = sp.Poly(sp.expand(closed_loop) - polynomial.as_expr(), p.s)
    equations = [difference.coeff_monomial(p.s**index) for index in range(order)]
    ((*values,),) = sp.linsolve(equations, unknown)
    return tuple(sp.factor(value) for value in values)


def pole_pairs_polynomial(pairs: Sequence[tuple[Expr, Expr]]) -> Expr:
    """Return prod (s^2 + 2 zeta_i omega_i s + omega_i^2), eq. (24) with an `s` restored."""
    return sp.Mul(*[p.s**2 + 2 * damping * speed * p.s + speed**2 for damping, speed in pairs])


def gpi_transfer(gains: Sequence[Expr]) -> Expr:
    """Return G(s) with u_delta - u*_delta = (1/C_U) G(s) e, the law (20) for any order n >= 3.

    ``gains`` is (k_0, ..., k_{n-1}). The law as printed is solved for C_U (u_delta - u*_delta)
    in Laplace's variable, its velocity estimate (18) inserted; n = 4 gives

        G = ((k2 + C_Y) s^2 + (k1 + k3 C_Y) s + k0)/(s (s + k3)).
    """
    order = len(gains)
    effort = Symbol("effort")
    reconstructed = (-effort + p.C_Y * p.e) / p.s
    integrals = sum(gains[order - 2 - n] * p.e / p.s**n for n in range(1, order - 1))
    law = effort - (gains[order - 1] * reconstructed + (gains[order - 2] + p.C_Y) * p.e + integrals)
    (solution,) = sp.solve(law, effort)
    return sp.factor(sp.together(solution / p.e))


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B r, w = C x + D r (continuous) or its difference equation (sampled)."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix

    def transfers(self, variable: Symbol) -> tuple[Expr, ...]:
        """Return C (variable I - A)^-1 B + D, one entry for each input."""
        order = self.A.shape[0]
        resolvent = (variable * sp.eye(order) - self.A).inv()
        return tuple(sp.factor(entry) for entry in self.C * resolvent * self.B + self.D)

    def transfer(self, variable: Symbol) -> Expr:
        """Return the transfer function of a core with one input."""
        (single,) = self.transfers(variable)
        return single


@dataclass(frozen=True)
class ControlLaw:
    """One controller, symbolic and complete.

    Attributes
    ----------
    controller : Controller
        What was chosen on the command line.
    states : tuple of Symbol
        Controller states.
    inputs : tuple of Expr
        What the core reads, in y, y', y*, y*' and Y.
    core : StateSpace
        From the inputs to w, in the gains and the believed coefficients.
    command : Expr
        Commanded voltage [V] in w, y*, y*'', Y, U and the symbols of `constants`; rises with w.
    constants : mapping of Symbol to Expr
        The constants of `command` in the believed coefficients.
    slope : Expr
        d command/d w at rest at the gap y* under the voltage u.
    loop_gain : Expr
        C_U times `slope` as the controller believes them: rho = 1 is this gain.
    C_Y : Expr
        The gap coefficient with which the gains were placed.
    span : Expr
        Width of w that takes the command across the actuator's range at Y.
    integrators : tuple of int
        Positions of the states that integrate. Each is frozen while the clamp is active and the
        step would push the command further out, and bounded so that its own share of w never
        exceeds `span`.
    start : tuple of Expr
        States before the first sample, in what the first sample measures; zero but for a start
        that is asked to be bumpless.
    gains : tuple of Symbol
        What the pole placement sets.
    """

    controller: Controller
    states: tuple[Symbol, ...]
    inputs: tuple[Expr, ...]
    core: StateSpace
    command: Expr
    constants: Mapping[Symbol, Expr]
    slope: Expr
    loop_gain: Expr
    C_Y: Expr
    span: Expr
    integrators: tuple[int, ...]
    start: tuple[Expr, ...]
    gains: tuple[Symbol, ...]

    @property
    def feedforward(self) -> Expr:
        """Voltage commanded at w = 0, in y*, y*'', Y, U and the believed coefficients."""
        return self.command.subs(w, 0).subs(self.constants)

    def transfer(self, variable: Symbol = p.s) -> Expr:
        """Return H(s) from the gap to w, y' being s y."""
        pairs = zip(self.core.transfers(variable), self.inputs, strict=True)
        seen = [h * (sp.diff(r, p.y) + variable * sp.diff(r, p.v)) for h, r in pairs]
        return sp.factor(sp.Add(*seen))


x1, x2 = sp.symbols("x1 x2", real=True)
f_y, f_a = Symbol("f_y", real=True), Symbol("f_a", real=True)
ERROR = p.y - p.y_ref


def control_law(controller: Controller = TAN_GPI) -> ControlLaw:
    """Return the law of a controller with its options."""
    if controller.name == "fee-gpi":
        return fee_gpi()
    if controller.name == "lin-pid":
        return lin_pid(controller)
    if controller.name == "state-feedback":
        return state_feedback()
    return tan_gpi()


def closed_loop_order(controller: Controller) -> int:
    """Return the order of the polynomial whose roots a controller's gains place."""
    return 3 if controller.name in ("lin-pid", "state-feedback") else 4


def tan_gpi() -> ControlLaw:
    """Return the TAN-GPI law (20) in its bounded two-state realisation.

    The partial fractions of G(s) give an integrator and a lag at -k3, both bounded in closed
    loop, where (20) as printed carries two hidden integrators that grow for ever:

        x1' = e,  x2' = -k3 x2 + e,
        w = (1/C_U) ((k2 + C_Y) e + (k0/k3) x1 + (k1 - k2 k3 - k0/k3) x2).
    """
    gains = (p.k0, p.k1, p.k2, p.k3)
    core = _two_states(gpi_transfer(gains))
    return _tangent(TAN_GPI, (x1, x2), (ERROR,), _scaled(core, 1 / p.C_U), gains)


def fee_gpi() -> ControlLaw:
    """Return the FEE-GPI law of Morales and Sira-Ramirez, Int. J. Control 83 (2010) 1155.

    Exact feedforward linearisation with the reference in the place of the gap,

        u = (y* + y0) sqrt((g - nu)/beta_c),  nu = y*'' - G_0(s) e,

    G_0 the GPI law of the double integrator, (20) with C_Y = 0. The root is continued as an odd
    function, so that a correction beyond free fall commands a negative voltage, which the
    actuator clamps.
    """
    gains = (p.k0, p.k1, p.k2, p.k3)
    core = _two_states(gpi_transfer(gains).subs(p.C_Y, 0))
    gravity, offset = Symbol("f_g", real=True), Symbol("f_0", real=True)
    scale = Symbol("f_b", real=True)
    pull = gravity - p.acc_ref + w
    root = sp.Piecewise((1, pull > 0), (-1, True)) * sp.sqrt(sp.Abs(pull))
    square = scale**2 * (p.y_ref + offset) ** 2 * pull  # of the command, where it is positive
    constants = {gravity: p.g, offset: p.y0, scale: 1 / sp.sqrt(p.beta_c)}
    rise = sp.diff(square, w).subs(constants)
    return ControlLaw(
        controller=Controller("fee-gpi"),
        states=(x1, x2),
        inputs=(ERROR,),
        core=core,
        command=scale * (p.y_ref + offset) * root,
        constants=constants,
        slope=rise / (2 * p.u),
        loop_gain=sp.Integer(1),
        C_Y=sp.Integer(0),
        span=(u_max**2 - u_min**2) / rise.subs(p.y_ref, p.Y),
        integrators=(0,),
        start=(sp.Integer(0), sp.Integer(0)),
        gains=gains,
    )


def state_feedback() -> ControlLaw:
    """Return the flatness-based state feedback (14): position, velocity and an integral.

    x1' = e,  w = (1/C_U) (k1 x1 + (k2 + C_Y) e + k3 e'); the velocity is taken as measured.
    """
    core = StateSpace(
        A=Matrix([[0]]),
        B=Matrix([[1, 0]]),
        C=Matrix([[p.k1]]),
        D=Matrix([[p.k2 + p.C_Y, p.k3]]),
    )
    inputs = (ERROR, p.v - p.v_ref)
    controller = Controller("state-feedback")
    return _tangent(controller, (x1,), inputs, _scaled(core, 1 / p.C_U), (p.k1, p.k2, p.k3))


def lin_pid(controller: Controller) -> ControlLaw:
    """Return the linear PID: the gains of (14) and a filtered derivative.

        x1' = e,  x2' = -omega_f x2 + d,
        w = (1/C_U) (k1 x1 + (k2 + C_Y) e + k3 omega_f (d - omega_f x2)),

    d the error or the measured gap from Y. The paper says no more than "PID, poles at -70": the
    options of `controller` are the readings.
    """
    core = StateSpace(
        A=Matrix([[0, 0], [0, -omega_f]]),
        B=Matrix([[1, 0], [0, 1]]),
        C=Matrix([[p.k1, -p.k3 * omega_f**2]]),
        D=Matrix([[p.k2 + p.C_Y, p.k3 * omega_f]]),
    )
    differentiated = ERROR if controller.derivative == "error" else p.y - p.Y
    inputs: tuple[Expr, ...] = (ERROR, differentiated)
    if controller.derivative == "error":
        core = StateSpace(core.A, Matrix([1, 1]), core.C, Matrix([sum(core.D)]))
        inputs = (ERROR,)
    quiet = controller.start == "bumpless"
    law = _tangent(
        controller, (x1, x2), inputs, _scaled(core, 1 / p.C_U), (p.k1, p.k2, p.k3, omega_f)
    )
    return replace(
        law,
        command=law.command.subs(f_a, 0).subs(
            {} if controller.feedforward == "static" else {f_y: 0}
        ),
        constants={f_y: law.constants[f_y]} if controller.feedforward == "static" else {},
        start=(sp.Integer(0), differentiated / omega_f if quiet else sp.Integer(0)),
    )


K_p, K_i, K_d = sp.symbols("Kp Ki Kd", positive=True)
"""Gains of a PID as it is written for a plant's input: [V/m], [V/(m s)], [V s/m]."""


def pid_transfer() -> Expr:
    """Return Kp + Ki/s + Kd s omega_f/(s + omega_f), from the error y - y* to the voltage.

    The magnet pulls against gravity: where the gap is too large the voltage has to rise, so that
    all gains of y - y* are positive. Of y* - y, as many write it, they are all negative.
    """
    return K_p + K_i / p.s + K_d * p.s * omega_f / (p.s + omega_f)


def gains_of_pid() -> dict[Symbol, Expr]:
    """Return (k1, k2, k3) of :func:`lin_pid` with the transfer function :func:`pid_transfer`.

    Examples
    --------
    >>> gains_of_pid()
    {k1: C_U*Ki, k2: C_U*Kp - C_Y, k3: C_U*Kd}
    """
    gains = (p.k1, p.k2, p.k3)
    own = lin_pid(Controller("lin-pid")).transfer()
    difference = sp.numer(sp.together(own - pid_transfer()))
    (found,) = sp.solve(sp.Poly(difference, p.s).coeffs(), gains, dict=True)
    return {gain: sp.expand(found[gain]) for gain in gains}


def _tangent(
    controller: Controller,
    states: tuple[Symbol, ...],
    inputs: tuple[Expr, ...],
    core: StateSpace,
    gains: tuple[Symbol, ...],
) -> ControlLaw:
    """Return a law that adds w [V] to U + u*_delta: all but FEE-GPI do."""
    voltage = reference_voltage()
    return ControlLaw(
        controller=controller,
        states=states,
        inputs=inputs,
        core=core,
        command=p.U + f_y * (p.y_ref - p.Y) + f_a * p.acc_ref + w,
        constants={f_y: sp.diff(voltage, p.y_ref), f_a: sp.diff(voltage, p.acc_ref)},
        slope=sp.Integer(1),
        loop_gain=p.C_U,
        C_Y=p.C_Y,
        span=u_max - u_min,
        integrators=(0,),
        start=(sp.Integer(0),) * len(states),
        gains=gains,
    )


def _two_states(transfer: Expr) -> StateSpace:
    """Return the integrator and the lag at -k3 whose sum is `transfer`."""
    through = sp.limit(transfer, p.s, sp.oo)
    integral = sp.limit(p.s * transfer, p.s, 0)
    lag = sp.factor(sp.cancel((p.s + p.k3) * transfer).subs(p.s, -p.k3))
    return StateSpace(
        A=Matrix([[0, 0], [0, -p.k3]]),
        B=Matrix([1, 1]),
        C=Matrix([[integral, lag]]),
        D=Matrix([[through]]),
    )


def _scaled(core: StateSpace, factor: Expr) -> StateSpace:
    return StateSpace(core.A, core.B, core.C * factor, core.D * factor)


def reference_voltage() -> Expr:
    """Return u*_delta = -(1/C_U) (y*'' - C_Y (y* - Y)) [V], second line of (20)."""
    return (-p.acc_ref + p.C_Y * (p.y_ref - p.Y)) / p.C_U
