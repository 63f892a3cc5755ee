"""The control laws: every law that can be run.

A law is a linear core from what is measured to a correction w, a static map from w and the
reference to the commanded voltage, an anti-windup rule, the bounds of its integrators and the
state it starts from. How a law is sampled, clamped and guarded is in
:mod:`maglev_design.symbolic.sampling`; simulation, tuning and export lower the same expressions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.options import TAN_GPI, Controller
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.gpi import gain_symbols, gpi_division, gpi_transfer
from maglev_design.symbolic.linearisation import design_tangent

w = Symbol("w", real=True)
"""Output of a law's linear core: a voltage on top of the feedforward [V], for FEE-GPI [m/s^2]."""
u_min, u_max = Symbol("u_min", real=True), Symbol("u_max", real=True)
omega_f = Symbol("omega_f", positive=True)
"""[rad/s] Pole of the derivative's filter."""


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
    definitions : mapping of Symbol to Expr
        Letters of `core` that stand for longer expressions in the gains and the believed
        coefficients; none in a law of second order.
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
    definitions: Mapping[Symbol, Expr] = field(default_factory=dict)

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
f_y, f_v, f_a, f_j = sp.symbols("f_y f_v f_a f_j", real=True)
ERROR = p.y - p.y_ref


def control_law(controller: Controller = TAN_GPI) -> ControlLaw:
    """Return the law of a controller with its options."""
    if controller.name == "fee-gpi":
        return fee_gpi()
    if controller.name == "lin-pid":
        return lin_pid(controller)
    if controller.name == "state-feedback":
        return state_feedback()
    return tan_gpi(controller)


def closed_loop_order(controller: Controller) -> int:
    """Return the order of the polynomial whose roots a controller's gains place."""
    if controller.name in ("lin-pid", "state-feedback"):
        return 3
    return 2 * controller.plant_order


def tan_gpi(controller: Controller = TAN_GPI) -> ControlLaw:
    """Return the TAN-GPI law (20), or its like for a plant of another order, bounded realisation.

    The partial fractions of G(s) give an integrator and the poles of Q, all bounded in closed loop,
    where (20) as printed carries hidden integrators that grow for ever. For the paper's plant,

        x1' = e,  x2' = -k3 x2 + e,
        w = (1/C_U) ((k2 + C_Y) e + (k0/k3) x1 + (k1 - k2 k3 - k0/k3) x2).

    The plant of the controller is den(s) y_delta = -(C/c) u_delta with den monic
    (:func:`~maglev_design.symbolic.linearisation.design_tangent`); then w = (c/C) G e and the
    feedforward is U - (c/C) den(d/dt) (y* - Y).
    """
    tangent = design_tangent(controller.design_model)
    denominator, gain = tangent.denominator, -1 / tangent.flat_gain
    gains = gain_symbols(2 * tangent.order)
    over, under = gpi_division(denominator, gains)
    core = _scaled(_partial_fractions(over, under), gain)
    definitions: dict[Symbol, Expr] = {}
    if tangent.order > 2:
        core, definitions = _lettered(core)
    states = sp.symbols(f"x1:{1 + tangent.order}", real=True)
    law = replace(_tangent(controller, states, (ERROR,), core, gains), definitions=definitions)
    return law if not controller.of_other_plant else _with_feedforward(law, denominator, gain)


def _with_feedforward(law: ControlLaw, denominator: sp.Poly, gain: Expr) -> ControlLaw:
    """Return a law whose feedforward is that of the plant `denominator`/`gain`."""
    path = (p.y_ref - p.Y, p.v_ref, p.acc_ref, p.jerk_ref)
    letters = (f_y, f_v, f_a, f_j)
    command: Expr = p.U + w
    constants: dict[Symbol, Expr] = {}
    for power, (letter, signal) in enumerate(zip(letters, path, strict=True)):
        factor = sp.factor(-gain * denominator.coeff_monomial(p.s**power))
        if power == 0 and law.controller.static_voltage == "series":
            constants |= dict(zip(SERIES, STATIC, strict=True))
            command += horner(SERIES, signal)
        elif factor != 0:
            constants[letter] = factor
            command += letter * signal
    return replace(law, command=command, constants=constants)


SERIES: tuple[Symbol, ...] = sp.symbols("s1:9", real=True)
"""Coefficients of the static voltage less U in powers of y* - Y, from the first on [V/m^n]."""
STATIC: tuple[Symbol, ...] = sp.symbols("S1:9", real=True)
"""The same as the controller believes them, numbers of the plant."""


def horner(coefficients: Sequence[Expr], x: Expr) -> Expr:
    """Return c_1 x + c_2 x^2 + ... as nested products."""
    value: Expr = sp.Integer(0)
    for c in reversed(coefficients):
        value = (c + value) * x if value != 0 else c * x
    return value


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
    over, under = sp.fraction(sp.together(transfer))
    return _partial_fractions(sp.Poly(over, p.s), sp.Poly(sp.cancel(under / p.s), p.s))


def _partial_fractions(over: sp.Poly, under: sp.Poly) -> StateSpace:
    """Return an integrator and the companion form of Q whose sum is N/(s Q), Q monic of degree k.

    States x1 of the integrator; x2, x3, ... of Q, of which x2 has the input and each further one is
    the integral of that before it.
    """
    order = under.degree()
    # letter by letter, in the order in which hand computation has it
    through = sp.factor(over.coeff_monomial(p.s ** (order + 1)))
    integral = sp.factor(over.eval(0) / under.eval(0))
    rest = over - through * p.s * under - integral * under
    if order == 1:  # the residue at the pole, which factors more simply
        pole = -under.eval(0)
        shares = [sp.factor(sp.cancel(over.eval(pole) / pole))]
    else:
        shares = [rest.coeff_monomial(p.s ** (k + 1)) for k in range(order - 1, -1, -1)]
    own = [-under.coeff_monomial(p.s**k) for k in range(order - 1, -1, -1)]
    companion = Matrix(order, order, lambda r, c: own[c] if r == 0 else int(r == c + 1))
    return StateSpace(
        A=sp.diag(0, companion),
        B=Matrix([1, 1, *[0] * (order - 1)]),
        C=Matrix([[integral, *shares]]),
        D=Matrix([[through]]),
    )


def _lettered(core: StateSpace) -> tuple[StateSpace, dict[Symbol, Expr]]:
    """Return a core in letters for its longer entries, and what these are."""
    letters: dict[Symbol, Expr] = {}

    def named(prefix: str) -> Callable[[Expr], Expr]:
        def name(entry: Expr) -> Expr:
            if entry.is_Integer:
                return entry
            symbol = Symbol(f"{prefix}{sum(x.name[0] == prefix for x in letters)}", real=True)
            letters[symbol] = entry
            return symbol

        return name

    return (
        StateSpace(
            core.A.applyfunc(named("q")),
            core.B,
            core.C.applyfunc(named("r")),
            core.D.applyfunc(named("d")),
        ),
        letters,
    )


def _scaled(core: StateSpace, factor: Expr) -> StateSpace:
    return StateSpace(core.A, core.B, core.C * factor, core.D * factor)


def reference_voltage() -> Expr:
    """Return u*_delta = -(1/C_U) (y*'' - C_Y (y* - Y)) [V], second line of (20)."""
    return (-p.acc_ref + p.C_Y * (p.y_ref - p.Y)) / p.C_U
