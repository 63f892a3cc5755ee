"""Equations (27)-(29), the reference, and (A1)-(A7), the loop with a wrong beta."""

from __future__ import annotations

import sympy as sp
from sympy import Expr, Matrix

from maglev_design.derivation import terms as d
from maglev_design.derivation.control import FOUR, printed_law
from maglev_design.symbolic import plant as p
from maglev_design.symbolic import reference as ref
from maglev_design.symbolic.flatness import FlatModel
from maglev_design.symbolic.gpi import (
    gpi_transfer,
    match_coefficients,
    pole_pairs_polynomial,
)
from maglev_design.symbolic.laws import (
    tan_gpi,
)
from maglev_design.symbolic.linearisation import Linearisation, believed_coefficients
from maglev_design.symbolic.stability import (
    believed,
    closed_loop_polynomial,
    routh_hurwitz,
    stability_condition,
)

REFERENCE, APPENDIX = "Reference", "Appendix A: the loop with a wrong beta"
PRINTED_29 = (12870, 91520, 288288, 524160, 600600, 443520, 205920, 54912, 6435)
"""r_1 to r_9 as the paper prints them, the statement that the Bezier polynomial is held against."""
CHECKED_ORDERS = ((5, 3), (7, 3), (8, 4), (9, 5), (12, 6), (16, 8))
Steps = list[d.Equation]


def reference() -> Steps:
    """Return (27)-(29), the flatness at both ends and the general order."""
    step = ref.bezier_step()
    ratio = (p.t - ref.start_time) / (ref.end_time - ref.start_time)
    signs = [(-1) ** n for n in range(len(d.r))]
    series = sum(sign * r * ref.tau**n for n, (sign, r) in enumerate(zip(signs, d.r, strict=True)))
    stated = (ref.tau**8 * series).subs(dict(zip(d.r, PRINTED_29, strict=True)))
    derived = ref.printed_coefficients(step)
    return [
        _rest_to_rest(step, ratio),
        d.proved(
            "28",
            REFERENCE,
            "Bezier step of order 16",
            [(d.phi, ref.tau**8 * series), (ref.tau, ratio)],
            "The Bezier polynomial whose first eight control values are 0 and the others 1, in "
            "powers of `tau`; constant before and after the move.",
            checks=[
                sp.expand(stated - step.value),
                step.value.subs(ref.tau, 0),
                step.value.subs(ref.tau, 1) - 1,
            ],
        ),
        d.proved(
            "29",
            REFERENCE,
            "Its coefficients",
            [(r, sp.Integer(value)) for r, value in zip(d.r, derived, strict=True)],
            "Expand the polynomial; its order and its leading zeros are all that is chosen.",
            checks=[
                sp.Integer(hand - value) for hand, value in zip(PRINTED_29, derived, strict=True)
            ],
        ),
        _ends(step),
        _general_order(),
    ]


def _rest_to_rest(step: ref.BezierStep, ratio: Expr) -> d.Equation:
    motion = ref.rest_to_rest(step)
    inside = {sp.Min(sp.Max(ratio, 0), 1): ref.tau}
    gap, velocity, acceleration = (part.xreplace(inside) for part in motion)
    travel, duration = ref.end_gap - ref.start_gap, ref.end_time - ref.start_time
    stated = ref.start_gap + travel * step.value
    lines = [
        (p.y_ref, ref.start_gap + travel * d.phi),
        (p.v_ref, travel / duration * d.dphi),
        (p.acc_ref, travel / duration**2 * d.ddphi),
    ]
    return d.proved(
        "27",
        REFERENCE,
        "Rest-to-rest reference",
        lines,
        "From the first gap to the last along a step from 0 to 1; the derivatives by the chain "
        "rule. The acceleration is what the feedforward in (20) needs.",
        checks=[
            gap - stated,
            sp.expand(velocity - sp.diff(stated, ref.tau) / duration),
            sp.expand(acceleration - sp.diff(stated, ref.tau, 2) / duration**2),
            gap.subs(ref.tau, 0) - ref.start_gap,
            gap.subs(ref.tau, 1) - ref.end_gap,
        ],
    )


def _ends(step: ref.BezierStep) -> d.Equation:
    at_start, at_end = ref.flatness_at_ends(step)
    checks = [
        sp.diff(step.value, ref.tau, n).subs(ref.tau, end)
        for end, count in ((0, at_start), (1, at_end))
        for n in range(1, count + 1)
    ]
    return d.proved(
        "28-ends",
        REFERENCE,
        "Flatness at both ends",
        [(d.flat_start, sp.Integer(at_start)), (d.flat_end, sp.Integer(at_end))],
        "Near 0 the step grows like `tau^8`, so its first 7 derivatives vanish there; "
        "near 1 it closes like `(1 - tau)^9`, so 8 vanish. All that start and end "
        "smoothly need is more than two.",
        checks=[sp.Integer(at_start - 7), sp.Integer(at_end - 8), *checks],
    )


def _general_order() -> d.Equation:
    bernstein = (
        sp.binomial(d.order_n, d.index) * ref.tau**d.index * (1 - ref.tau) ** (d.order_n - d.index)
    )
    scale = d.order_n * sp.binomial(d.order_n - 1, d.leading - 1)
    slope = scale * ref.tau ** (d.leading - 1) * (1 - ref.tau) ** (d.order_n - d.leading)
    checks: list[Expr] = []
    for order, leading in CHECKED_ORDERS:
        step = ref.bezier_step(order, leading)
        numbers = {d.order_n: order, d.leading: leading}
        checks += [
            sp.expand(sp.diff(step.value, ref.tau) - slope.subs(numbers)),
            sp.expand(step.slope - slope.subs(numbers)),
            sp.expand(sp.diff(step.slope, ref.tau) - step.curvature),
            step.value.subs(ref.tau, 0),
            step.value.subs(ref.tau, 1) - 1,
            *(
                sp.Integer(found - expected)
                for found, expected in zip(
                    ref.flatness_at_ends(step), (leading - 1, order - leading), strict=True
                )
            ),
        ]
    return d.proved(
        "28-n",
        REFERENCE,
        "Bezier step of any order",
        [(d.phi, sp.Sum(bernstein, (d.index, d.leading, d.order_n))), (d.dphi, slope)],
        "The derivative of the sum telescopes to one term, which never changes sign: the step is "
        "monotone, with `p - 1` derivatives zero at the start and `N - p` at the end. Checked for "
        "several orders `N` and leading zeros `p`.",
        checks=checks,
    )


def wrong_beta(plant: p.Plant, lin: Linearisation, flat: FlatModel) -> Steps:
    """Return (A1)-(A5): the law with a wrong beta, its operator form, the loop it makes."""
    law = printed_law(p.C_U_hat, p.C_Y_hat)
    g_hat, correction = believed(gpi_transfer(FOUR)), law.correction()
    rest = (p.k2 * p.s**2 + p.k1 * p.s + p.k0) / (p.s * (p.s + p.k3))
    feedback = (p.C_Y_hat * p.y_d - p.acc_ref + d.R * p.e) / p.C_U_hat
    from_law = law.feedforward.subs(d.y_dr, p.y_d - p.e) + correction * p.e
    loop = (
        p.C_Y_hat * (p.C_Y / p.C_Y_hat - p.C_U / p.C_U_hat) * p.y_d
        + (p.C_U / p.C_U_hat - 1) * p.acc_ref
        - p.C_U / p.C_U_hat * d.R * p.e
    )
    inserted = flat.acceleration.subs(p.u_d, feedback) - p.acc_ref
    simple = (d.mu - 1) * p.acc_ref - d.mu * d.R * p.e
    equal = {p.C_U: d.mu * p.C_U_hat, p.C_Y: d.mu * p.C_Y_hat}
    return [
        d.proved(
            "A1",
            APPENDIX,
            "The law with the controller's coefficients",
            [(p.u_d, law.feedback), (d.u_dr, law.feedforward), (d.v_hat, law.estimate)],
            "The law (20) with hats. Corrected: the printed gammas carry a second `1/C_U_hat` and, "
            "in `gamma_1`, what belongs to the solved form (A2); inside the bracket of (A1) stand "
            "`k3`, `k2 + C_Y_hat`, `k1` and `k0`.",
            checks=[
                correction - g_hat / p.C_U_hat,
                correction - believed(tan_gpi().core.transfer(p.s)),
            ],
        ),
        d.proved(
            "A2",
            APPENDIX,
            "The law solved for the voltage",
            [
                (p.u_d - d.u_dr, d.G_hat * p.e / p.C_U_hat),
                (p.u_d, feedback),
                (d.R, rest),
            ],
            "Apply the operator, `s` for `d/dt`, and solve. Corrected: the printed (A2) pulls "
            "`C_Y_hat/C_U_hat` out of a bracket of which it is a factor of the gap alone. With the "
            "gap instead of the reference gap in front, `C_Y_hat` leaves the fraction: the gammas "
            "of (A2) to (A7) are `k2`, `k1` and `k0`.",
            checks=[
                g_hat - p.C_Y_hat - rest,
                from_law - feedback.subs(d.R, rest),
                correction * p.C_U_hat - g_hat,
            ],
        ),
        d.proved(
            "A3",
            APPENDIX,
            "The loop with two unknown ratios",
            [(p.acc_d - p.acc_ref, loop)],
            "Insert (A2) in (10).",
            checks=[inserted - loop],
        ),
        _one_ratio(plant, lin, loop.subs(equal), simple),
        d.proved(
            "A5",
            APPENDIX,
            "What the wrong beta disturbs",
            [(d.f, (d.mu - 1) * p.acc_ref)],
            "The part of (A4) without the error. It is bounded, and zero once the reference rests.",
            checks=[simple.subs(p.e, 0) - (d.mu - 1) * p.acc_ref],
        ),
    ]


def _one_ratio(plant: p.Plant, lin: Linearisation, loop: Expr, simple: Expr) -> d.Equation:
    _, c_u, c_y = believed_coefficients(plant, lin, "appendix-a")
    return d.proved(
        "A4",
        APPENDIX,
        "The loop with one ratio",
        [
            (p.acc_d - p.acc_ref, simple),
            (p.C_U / p.C_U_hat, d.mu),
            (p.C_Y / p.C_Y_hat, d.mu),
            (d.mu, p.beta / p.beta_c),
        ],
        "With `U` measured (reading appendix-a) both coefficients are proportional to `beta`, "
        "their ratios are equal and the term in the gap cancels. With `U` computed from the "
        "controller's `beta` they are not, and (A4) does not hold.",
        checks=[
            lin.C_U / c_u - p.beta / p.beta_c,
            lin.C_Y / c_y - p.beta / p.beta_c,
            loop - simple,
        ],
    )


def stability() -> Steps:
    """Return (A6), (A7), the Routh-Hurwitz conditions and the general condition."""
    polynomial = p.s**4 + p.k3 * p.s**3 + d.mu * (p.k2 * p.s**2 + p.k1 * p.s + p.k0)
    rest = believed(gpi_transfer(FOUR)) - p.C_Y_hat
    error = d.F_s / (p.s**2 + d.mu * rest)
    stated = p.s * (p.s + p.k3) / polynomial * d.F_s
    own = {p.rho: d.mu, p.C_Y_true: d.mu * p.C_Y_hat}
    loop = [c.subs(own) for c in closed_loop_polynomial()]
    from_loop = sum(c * p.s ** (4 - n) for n, c in enumerate(loop))
    bound = p.k3**2 * p.k0 / (p.k1 * (p.k3 * p.k2 - p.k1))
    conditions = routh_hurwitz(loop)
    pair = (p.zeta, p.omega_n)
    designed = dict(
        zip(FOUR, match_coefficients(pole_pairs_polynomial([pair, pair]), 4), strict=True)
    )
    edge = 1 / (4 * p.zeta**2 + 1)
    return [
        d.proved(
            "A6",
            APPENDIX,
            "From the disturbance to the error",
            [(d.E_s, stated)],
            "Transform (A4) from rest and solve for the error. The `s` in the numerator lets a "
            "constant disturbance leave no error, if the denominator is Hurwitz.",
            checks=[error - stated, from_loop - polynomial, (stated / d.F_s).subs(p.s, 0)],
        ),
        _routh(),
        d.proved(
            "A7",
            APPENDIX,
            "How wrong beta may be",
            [(d.mu, bound, ">"), (d.mu, edge, ">")],
            "Of the Routh-Hurwitz conditions of (A6) the third decides. With the gains (25) it "
            "holds for any frequency; with both damping ratios one the bound is 1/5. Corrected: "
            "the paper prints 1/2.63, which its text does not give. Holds under the reading "
            "appendix-a.",
            checks=[
                conditions[2] - d.mu * p.k1 * (p.k3 * p.k2 - p.k1) * (d.mu - bound),
                bound.subs(designed) - edge,
                (stability_condition().subs(own) / p.omega_n**2) - (d.mu - edge),
            ],
        ),
        _general_condition(designed),
    ]


def _routh() -> d.Equation:
    letters = (sp.Integer(1), d.a3, d.a2, d.a1, d.a0)
    conditions = routh_hurwitz(letters)
    padded = [sp.Integer(0)] * 3 + [*letters] + [sp.Integer(0)] * 4  # a_4 at position 3
    hurwitz = Matrix(4, 4, lambda r, c: padded[2 * c - r + 4])
    minors = [hurwitz[:n, :n].det() for n in range(1, 5)]
    coefficients = closed_loop_polynomial()[1:]
    law = believed(gpi_transfer(FOUR))
    numerator, denominator = sp.fraction(law)
    loop = denominator * (p.s**2 - p.C_Y_true) + p.rho * numerator
    powers = enumerate(coefficients)
    return d.proved(
        "A7-routh",
        APPENDIX,
        "Routh-Hurwitz conditions of the loop",
        [
            *zip(letters[1:], coefficients, strict=True),
            *zip(d.D, conditions, strict=True),
            *((symbol, sp.Integer(0), ">") for symbol in d.D),
        ],
        "The plant at the actual gap has its own coefficients, `C_U'` and `C_Y'`; of the voltage "
        "coefficients only their ratio `rho` enters. The loop is stable when the four determinants "
        "of its polynomial `s^4 + a3 s^3 + a2 s^2 + a1 s + a0` are positive.",
        checks=[
            *(minor - condition for minor, condition in zip(minors, conditions, strict=True)),
            loop - p.s**4 - sum(c * p.s ** (3 - n) for n, c in powers),
        ],
    )


def _general_condition(designed: dict[sp.Symbol, Expr]) -> d.Equation:
    condition = stability_condition()
    margin = p.rho * (p.omega_n**2 + p.C_Y_hat) - p.C_Y_true - p.omega_n**2 / (4 * p.zeta**2 + 1)
    loop = [c.subs(designed) for c in closed_loop_polynomial()]
    first, second, third, fourth = routh_hurwitz(loop)
    second_stated = p.rho * (p.k3 * p.k2 - p.k1)
    return d.proved(
        "A7-general",
        APPENDIX,
        "Stability at any gap with any coefficients",
        [
            (
                p.rho * (p.omega_n**2 + p.C_Y_hat),
                p.C_Y_true + p.omega_n**2 / (4 * p.zeta**2 + 1),
                ">",
            ),
            (d.D[0], p.k3),
            (d.D[1], second_stated),
            (d.D[2], d.D[0] * d.D[1] * d.margin),
            (d.D[3], p.rho * p.k0 * d.D[2]),
            (d.margin, margin),
        ],
        "With the gains (25) the first two determinants are positive whatever `beta` and the gap "
        "are, the third is their product times the margin of the inequality and the fourth has "
        "the sign of the third: the inequality is necessary and sufficient.",
        checks=[
            condition - margin,
            first - p.k3.subs(designed),
            second - second_stated.subs(designed),
            third - first * second * margin,
            fourth - (p.rho * p.k0).subs(designed) * third,
        ],
    )
