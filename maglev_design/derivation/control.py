"""Equations (14)-(25): state feedback, the GPI law, its bounded form and its gains."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix

from maglev_design.derivation import terms as d
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.flatness import FlatModel
from maglev_design.symbolic.gpi import (
    gain_symbols,
    gpi_transfer,
    match_coefficients,
    pole_pairs_polynomial,
)
from maglev_design.symbolic.laws import (
    reference_voltage,
    tan_gpi,
)
from maglev_design.symbolic.stability import closed_loop_polynomial

FEEDBACK, GPI, GAINS = (
    "State feedback",
    "Generalised proportional integral control",
    "Gains",
)
FOUR = (p.k0, p.k1, p.k2, p.k3)
Steps = list[d.Equation]


@dataclass(frozen=True)
class PrintedLaw:
    """The three lines of (20) as the paper prints them, the statement the checks compare with.

    Attributes
    ----------
    feedback : Expr
        u_delta in the reconstructed velocity, the error and its two integrals.
    feedforward : Expr
        u*_delta in the reference.
    estimate : Expr
        The reconstructed velocity in the integrals of voltage and gap, eq. (18).
    """

    feedback: Expr
    feedforward: Expr
    estimate: Expr

    def correction(self) -> Expr:
        """Return u_delta - u*_delta over e in Laplace's variable, all three lines inserted."""
        transform = {
            d.int_u: p.u_d / p.s,
            d.int_y: p.y_d / p.s,
            d.int_e: p.e / p.s,
            d.iint_e: p.e / p.s**2,
            p.v_ref: p.s * d.y_dr,
            p.acc_ref: p.s**2 * d.y_dr,
        }
        law = self.feedback.subs(d.v_hat, self.estimate).subs(d.u_dr, self.feedforward)
        law = law.subs(transform).subs(p.y_d, d.y_dr + p.e)
        # linear in the voltage, which stands on both sides
        voltage = law.subs(p.u_d, 0) / (1 - sp.diff(law, p.u_d))
        return sp.factor((voltage - self.feedforward.subs(transform)) / p.e)


def printed_law(c_u: Expr, c_y: Expr) -> PrintedLaw:
    """Return (20), or (A1) with the hatted coefficients."""
    bracket = -p.k3 * (d.v_hat - p.v_ref) - (p.k2 + c_y) * p.e - p.k1 * d.int_e - p.k0 * d.iint_e
    return PrintedLaw(
        feedback=d.u_dr - bracket / c_u,
        feedforward=-(p.acc_ref - c_y * d.y_dr) / c_u,
        estimate=-c_u * d.int_u + c_y * d.int_y,
    )


def state_feedback(flat: FlatModel) -> Steps:
    """Return (14)-(16): the law with a measured velocity and its closed loop."""
    bracket = -p.k3 * d.e1 - (p.k2 + p.C_Y) * p.e - p.k1 * d.int_e
    law = d.u_dr - bracket / p.C_U
    error_acceleration = flat.acceleration.subs(
        {p.y_d: p.e, p.u_d: p.u_d - d.u_dr}, simultaneous=True
    )
    wished = -p.k3 * d.e1 - p.k2 * p.e - p.k1 * d.int_e
    (solved,) = sp.solve(error_acceleration - wished, p.u_d)
    loop = d.e2 - error_acceleration.subs(p.u_d, law)
    third = d.e3 + p.k3 * d.e2 + p.k2 * d.e1 + p.k1 * p.e
    polynomial = p.s**3 + p.k3 * p.s**2 + p.k2 * p.s + p.k1
    return [
        d.proved(
            "14",
            FEEDBACK,
            "State feedback with integral",
            [(p.u_d, law)],
            "Wish for an error acceleration of minus `k3` times the velocity error, `k2` times the "
            "error and `k1` times its integral, and solve (13) for the voltage that gives it.",
            checks=[law - solved],
        ),
        d.proved(
            "15",
            FEEDBACK,
            "Its error dynamics",
            [(third, sp.Integer(0))],
            "Insert (14) in (13); the coefficient `C_Y` cancels. Differentiate once to be rid of "
            "the integral.",
            checks=[_differentiated(loop, 1) - _in_time(third, 1)],
        ),
        d.proved(
            "16",
            FEEDBACK,
            "Its characteristic polynomial",
            [(d.poly_3, polynomial)],
            "Laplace's variable for the derivative in (15). The printed exponent (3) is a power.",
            checks=[_operator(third) - polynomial, sp.cancel(p.s * _operator(loop)) - polynomial],
        ),
    ]


def _in_time(expression: Expr, integrals: int) -> Expr:
    """Return `expression` with the error as the `integrals`-th derivative of a function of t."""
    function = sp.Function("E")(p.t)
    orders = {d.iint_e: -2, d.int_e: -1, p.e: 0, d.e1: 1, d.e2: 2, d.e3: 3, d.e4: 4}
    return expression.subs(
        {
            symbol: sp.Derivative(function, (p.t, order + integrals))
            if order + integrals
            else function
            for symbol, order in orders.items()
            if order + integrals >= 0
        },
        simultaneous=True,
    )


def _differentiated(expression: Expr, integrals: int) -> Expr:
    return sp.diff(_in_time(expression, integrals), p.t, integrals)


def _operator(expression: Expr) -> Expr:
    """Return the polynomial in s that acts on the error, initial values aside."""
    powers = {d.iint_e: -2, d.int_e: -1, p.e: 0, d.e1: 1, d.e2: 2, d.e3: 3, d.e4: 4}
    return expression.subs({symbol: p.s**n for symbol, n in powers.items()}, simultaneous=True)


def reconstruction(flat: FlatModel) -> Steps:
    """Return (17)-(19): the velocity as integrals of voltage and gap."""
    estimate = printed_law(p.C_U, p.C_Y).estimate
    velocity = estimate + d.v_0
    start = sp.Symbol("y_d(0)", real=True)
    transform = {d.int_u: p.u_d / p.s, d.int_y: p.y_d / p.s, d.v_0: d.v_0 / p.s}
    # L{y''} = s^2 Y - s y(0) - y'(0), so L{y'} = s Y - y(0) = (L{y''} + y'(0))/s
    gap_transform = (flat.acceleration + p.s * start + d.v_0) / p.s**2
    transformed = p.s * gap_transform - start
    return [
        d.proved(
            "17",
            GPI,
            "Velocity by integration",
            [(p.v_d, velocity)],
            "Integrate (10) once from 0 to `t`; checked in Laplace's variable, where the initial "
            "velocity enters as its value over `s`.",
            checks=[velocity.subs(transform) - transformed],
        ),
        d.proved(
            "18",
            GPI,
            "Reconstructed velocity",
            [(d.v_hat, estimate)],
            "Leave the unknown initial velocity of (17) out. The scan prints the estimate "
            "without its dot: it is of the velocity, not of the gap.",
            checks=[
                velocity.subs(d.v_0, 0) - estimate,
                p.s * estimate.subs(transform) - flat.acceleration,
            ],
        ),
        d.proved(
            "19",
            GPI,
            "Its error is constant",
            [(p.v_d, d.v_hat + d.v_0)],
            "Subtract (18) from (17): the reconstruction is off by the initial velocity, a "
            "constant, which the further integral of the law removes.",
            checks=[velocity - (d.v_hat + d.v_0).subs(d.v_hat, estimate)],
        ),
    ]


def gpi_law(flat: FlatModel) -> Steps:
    """Return (20) with its transfer function, and (21)-(23)."""
    law = printed_law(p.C_U, p.C_Y)
    stated = ((p.k2 + p.C_Y) * p.s**2 + (p.k1 + p.k3 * p.C_Y) * p.s + p.k0) / (p.s * (p.s + p.k3))
    transfer, correction = gpi_transfer(FOUR), law.correction()
    return [
        d.proved(
            "20",
            GPI,
            "The GPI law",
            [(p.u_d, law.feedback), (d.u_dr, law.feedforward), (d.v_hat, law.estimate)],
            "The state feedback (14) with the reconstructed velocity (18) and a second integral "
            "of the error against the constant it is off by. Second line: (11) on the reference. "
            "The scan loses dots: the reference acceleration in the second line, the velocity in "
            "the third.",
            checks=[
                correction - transfer / p.C_U,
                law.feedforward - reference_voltage().subs(p.y_ref, p.Y + d.y_dr),
                law.estimate.subs({d.int_u: p.u_d, d.int_y: p.y_d}) - flat.acceleration,
            ],
        ),
        d.proved(
            "20-transfer",
            GPI,
            "The same law as a transfer function",
            [(d.w, d.G * p.e / p.C_U), (d.G, stated)],
            "Insert all three lines of (20) into each other in Laplace's variable and solve for "
            "the voltage, which stands on both sides.",
            checks=[stated - transfer, correction - stated / p.C_U],
        ),
        *_closed_loop(flat, law),
    ]


def _closed_loop(flat: FlatModel, law: PrintedLaw) -> Steps:
    measured = law.feedback.subs(d.v_hat, p.v_ref + d.e1 - d.v_0)
    inserted = flat.acceleration.subs({p.y_d: p.e, p.u_d: measured - d.u_dr}, simultaneous=True)
    left = d.e2 + p.k3 * d.e1 + p.k2 * p.e + p.k1 * d.int_e + p.k0 * d.iint_e
    fourth = d.e4 + p.k3 * d.e3 + p.k2 * d.e2 + p.k1 * d.e1 + p.k0 * p.e
    polynomial = p.s**4 + p.k3 * p.s**3 + p.k2 * p.s**2 + p.k1 * p.s + p.k0
    exact = {p.rho: 1, p.C_Y_true: p.C_Y, p.C_Y_hat: p.C_Y}
    loop = sum(c.subs(exact) * p.s ** (4 - n) for n, c in enumerate(closed_loop_polynomial()))
    return [
        d.proved(
            "21",
            GPI,
            "Perturbed error dynamics",
            [(left, p.k3 * d.v_0)],
            "Insert (20) in (13), the velocity by (19). This is the linear plant (10); the paper "
            "names (4), and prints the second derivative of the increment where that of the error "
            "stands.",
            checks=[(d.e2 - inserted) - (left - p.k3 * d.v_0)],
        ),
        d.proved(
            "22",
            GPI,
            "Error dynamics of fourth order",
            [(fourth, sp.Integer(0))],
            "Differentiate (21) twice: the constant on the right, the unknown initial velocity, "
            "is gone.",
            checks=[_differentiated(left - p.k3 * d.v_0, 2) - _in_time(fourth, 2)],
        ),
        d.proved(
            "23",
            GPI,
            "Characteristic polynomial",
            [(d.poly, polynomial)],
            "Laplace's variable for the derivative in (22); the same as the denominator of the "
            "loop made of (10) and the transfer function of the law.",
            checks=[_operator(fourth) - polynomial, loop - polynomial],
        ),
    ]


def bounded_form(flat: FlatModel) -> Steps:
    """Return the two-state realisation and the hidden integrators of (20) as printed."""
    core = tan_gpi().core
    states = Matrix([d.x1, d.x2])
    rates = core.A * states + core.B * p.e
    voltage = (core.C * states + core.D * p.e)[0]
    share = (p.k2 + p.C_Y) * p.e + p.k0 / p.k3 * d.x1 + (p.k1 - p.k2 * p.k3 - p.k0 / p.k3) * d.x2
    law = printed_law(p.C_U, p.C_Y)
    at_rest = {d.u_dr: 0, p.v_ref: 0}
    printed = law.feedback.subs(d.v_hat, law.estimate).subs(at_rest).subs(p.e, p.y_d)
    six = Matrix([p.y_d, p.v_d, d.int_u, d.int_y, d.int_e, d.iint_e])
    motion = Matrix([p.v_d, flat.acceleration.subs(p.u_d, printed), printed, p.y_d, p.y_d, d.int_e])
    own = Matrix([p.v_d, flat.acceleration.subs(p.u_d, voltage), *rates]).subs(p.e, p.y_d)
    four = own.jacobian(Matrix([p.y_d, p.v_d, *states]))
    characteristic = motion.jacobian(six).charpoly().as_expr(p.s)
    polynomial = p.s**4 + p.k3 * p.s**3 + p.k2 * p.s**2 + p.k1 * p.s + p.k0
    return [
        d.proved(
            "20-bounded",
            GPI,
            "The law with two bounded states",
            [(d.dx1, rates[0]), (d.dx2, rates[1]), (p.C_U * d.w, share)],
            "Partial fractions of `G(s)`: an integrator and a lag at `-k3`. Its transfer function "
            "is `G(s)`, so from a zero start it is the law (20); with the plant it makes four "
            "states whose polynomial is `p(s)`, nothing hidden, so both stay bounded. It is the "
            "form that is run and exported.",
            checks=[
                p.C_U * core.transfer(p.s) - gpi_transfer(FOUR),
                core.transfer(p.s) - law.correction(),
                p.C_U * voltage - share,
                four.charpoly().as_expr(p.s) - polynomial,
            ],
        ),
        d.proved(
            "20-hidden",
            GPI,
            "Hidden integrators of the printed law",
            [(d.poly_6, d.poly * p.s**2)],
            "Run as printed, (20) has four integrators: of voltage, of gap, of the error and of "
            "that integral. With the plant that is six states, and two of the six poles lie at "
            "zero. What they hold grows for ever, although the error tends to zero.",
            checks=[characteristic - p.s**2 * polynomial],
        ),
    ]


def gains() -> Steps:
    """Return (24), (25) and the matching of any order."""
    pair = (p.zeta, p.omega_n)
    desired = pole_pairs_polynomial([pair, pair])
    stated = (
        p.omega_n**4,
        4 * p.zeta * p.omega_n**3,
        4 * p.zeta**2 * p.omega_n**2 + 2 * p.omega_n**2,
        4 * p.zeta * p.omega_n,
    )
    matched = match_coefficients(desired, 4)
    return [
        d.proved(
            "24",
            GAINS,
            "Desired polynomial",
            [(d.poly_des, desired)],
            "A choice: two equal pole pairs. The paper's middle term lacks its `s`, restored here; "
            "without it the expression is not a quadratic in `s`, and (25) does not follow.",
            checks=[(p.s**2 + 2 * p.zeta * p.omega_n * p.s + p.omega_n**2) ** 2 - desired],
        ),
        d.proved(
            "25",
            GAINS,
            "Gains of two equal pole pairs",
            list(zip(reversed(FOUR), (sp.expand(k) for k in reversed(matched)), strict=True)),
            "Equate the coefficients of (23) and (24) power by power.",
            checks=[k - hand for k, hand in zip(matched, stated, strict=True)],
        ),
        *_any_order(),
    ]


def _any_order() -> Steps:
    first, second, third = (
        (p.zeta_1, p.omega_1),
        (p.zeta_2, p.omega_2),
        (d.zeta_3, d.omega_3),
    )
    real_pole = p.s + d.pole
    wishes = {
        3: pole_pairs_polynomial([first]) * real_pole,
        4: pole_pairs_polynomial([first, second]),
        5: pole_pairs_polynomial([first, second]) * real_pole,
        6: pole_pairs_polynomial([first, second, third]),
    }
    matched = {n: match_coefficients(wish, n) for n, wish in wishes.items()}
    laws = {n: gpi_transfer(gain_symbols(n)) for n in wishes}
    numerator, denominator = (sp.collect(part, p.s) for part in sp.fraction(laws[5]))
    return [
        d.proved(
            "20-n",
            GAINS,
            "The law for any order",
            [(d.G, numerator / denominator), (d.poly_n, _monic(5))],
            "Each further integral of the error raises the order by one; shown for order 5, "
            "checked for orders 3 to 6. The plant's `C_Y` cancels and the gains are the "
            "coefficients of the closed loop's polynomial.",
            checks=[_loop_of(law) - _monic(n) for n, law in laws.items()],
        ),
        d.proved(
            "25-n",
            GAINS,
            "Gains for any poles",
            [
                *zip(gain_symbols(3), matched[3], strict=True),
                *zip(gain_symbols(4), (sp.expand(k) for k in matched[4]), strict=True),
            ],
            "Pole pairs, and a real pole where the order is odd: order 3 in the first three "
            "lines, order 4 with two different pairs below; orders 5 and 6 are checked, too.",
            checks=[
                _monic(n).subs(dict(zip(gain_symbols(n), values, strict=True))) - wishes[n]
                for n, values in matched.items()
            ],
        ),
    ]


def _monic(order: int) -> Expr:
    return p.s**order + sum(k * p.s**n for n, k in enumerate(gain_symbols(order)))


def _loop_of(law: Expr) -> Expr:
    """Return the closed-loop polynomial of (13) with the transfer function of a law."""
    numerator, denominator = sp.fraction(law)
    return sp.expand(denominator * (p.s**2 - p.C_Y) + numerator)
