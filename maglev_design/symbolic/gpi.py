"""GPI of any order: the polynomial that is wanted, and the transfer function that places it."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp
from sympy import Expr, Symbol

from maglev_design.symbolic import plant as p


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


def gpi_division(
    denominator: sp.Poly, gains: Sequence[Expr], integrators: int = 1
) -> tuple[sp.Poly, sp.Poly]:
    """Return N and Q of the GPI law G = N/(s^m Q) for any flat plant, both polynomials in s.

    The plant is den(s) y_delta = -(C/c) u_delta with den monic of degree n; the loop's polynomial
    p_des = s^(2 n - 1 + m) + k_{2n-2+m} s^(2n-2+m) + ... + k_0 is to be

        den s^m Q + N = p_des,  deg N < n + m,

    so that Q is the quotient of p_des by den s^m and N the remainder: a division, with one answer
    whatever the plant. For n = 2 and m = 1 it is the law (20).

    Parameters
    ----------
    denominator : Poly
        den, monic in s.
    gains : sequence of Expr
        (k_0, ..., k_{2n-2+m}).
    integrators : int
        m.

    Raises
    ------
    ValueError
        For another number of gains, or a denominator that is not monic.
    """
    order = denominator.degree()
    if denominator.LC() != 1:
        raise ValueError("the plant's denominator must be monic in s")
    if len(gains) != 2 * order - 1 + integrators:
        raise ValueError(
            f"a plant of order {order} with {integrators} integrators needs "
            f"{2 * order - 1 + integrators} gains, not {len(gains)}"
        )
    desired = sp.Poly([1, *reversed(gains)], p.s)
    quotient, remainder = sp.div(desired, denominator * sp.Poly(p.s**integrators, p.s))
    return remainder, quotient


def reconstructed_transfer(
    denominator: sp.Poly, gains: Sequence[Expr], integrators: int = 1
) -> Expr:
    """Return G of :func:`gpi_division` as integral reconstructors built one on the other make it.

    A law with n - 1 derivatives and m integrals of e,

        v = lambda_{n-1} e^(n-1) + ... + lambda_0 e + integrals,  den y = -v  (scaled input),

    reads its derivatives off the plant: integrated once, den e = -v says what e^(n-1) is in lower
    derivatives and the integral of v; integrated twice, what e^(n-2) is; each reconstructor uses
    those below it and no derivative. What they leave out, the unknown start, asks for n - 1 more
    integrals of e. The lambdas are what places the poles at the `gains`.
    """
    order, s = denominator.degree(), p.s
    effort, width = Symbol("effort"), 2 * order - 1 + integrators
    unknown = sp.symbols(f"lambda0:{width}")
    below = [denominator.coeff_monomial(s**k) for k in range(order)]
    known: list[Expr] = [p.e]  # of e, its first derivative, ...: estimates in e and the effort
    for k in range(1, order):
        # the k-th derivative: den e = -effort, integrated n - k times; where the sum asks for a
        # lower derivative it is the estimate that is already there
        total = -effort / s ** (order - k)
        for j, a in enumerate(below):
            left = j - (order - k)
            total -= a * (known[left] if left >= 0 else p.e * s**left)
        known.append(sp.expand(total))
    law = sum(unknown[k] * known[k] for k in range(order))
    law += sum(unknown[order + k] * p.e / s ** (k + 1) for k in range(width - order))
    (solved,) = sp.solve(effort - law, effort)
    over, under = (sp.Poly(sp.expand(x), s) for x in sp.fraction(sp.together(solved / p.e)))
    # a common factor s would be a hidden integrator; none is left once the coefficients agree
    loop = sp.Poly(denominator * under + over, s)
    wanted = sp.Poly([1, *reversed(gains)], s) * sp.Poly(loop.LC(), s)
    shift = loop.degree() - wanted.degree()
    difference = loop - wanted * sp.Poly(s**shift, s)
    (placed,) = sp.solve(difference.coeffs(), unknown, dict=True)
    return sp.cancel(sp.together((over.as_expr() / under.as_expr()).subs(placed)))
