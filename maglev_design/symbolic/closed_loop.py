"""State matrices of the linear closed loop, continuous and sampled, over gap and ratio.

The plant is linearised where the ball is, at the gap y; the controller is one, its numbers fixed.
Gap and ratio enter through two numbers,

    q = (Y + y0)/(y + y0),  m = C_U'(Y)/C_U^,

the first in the gap alone, the second in the ratio beta_c/beta alone, because C_U' and C_Y' are
both proportional to 1/(y + y0):

    rho = C_U'/C_U^ = m q,  C_Y' = C_Y'(Y) q.

In the plane (rho, C_Y') the gaps of one ratio are a segment of a ray.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import sympy as sp
from sympy import Expr, Matrix, Symbol

from maglev_design.options import Method
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.laws import ControlLaw, StateSpace, tan_gpi
from maglev_design.symbolic.linearisation import linearise
from maglev_design.symbolic.sampling import named_core
from maglev_design.symbolic.stability import believed, first_part

ratio = Symbol("ratio", positive=True)
"""beta_c/beta [-]."""
q = Symbol("q", positive=True)
"""C_Y'(y)/C_Y'(Y) = C_U'(y)/C_U'(Y) [-]."""
m_gain = Symbol("m_gain", positive=True)
"""C_U'(Y)/C_U^ [-]: rho at the gap of the design."""
C_Y_rest = Symbol("C_Y_rest", positive=True)
"""C_Y'(Y), the true coefficient at the gap of the design [1/s^2]."""
rise, travel, turn = sp.symbols("rise travel turn", positive=True)
fresh_gap, fresh_speed = sp.symbols("fresh_gap fresh_speed", positive=True)
stale_gap, stale_speed = sp.symbols("stale_gap stale_speed", nonnegative=True)


@dataclass(frozen=True)
class AtDesignGap:
    """What is known of the loop at the gap of the design.

    Attributes
    ----------
    gain_squared : Expr
        m^2, rational where m itself is not; in g, beta_c, Y, y0, C_U^ and the ratio.
    C_Y : Expr
        C_Y'(Y) [1/s^2].
    fall : Expr
        q in Y, y0 and the gap y.
    """

    gain_squared: Expr
    C_Y: Expr
    fall: Expr


def at_design_gap() -> AtDesignGap:
    """Return m^2, C_Y'(Y) and q.

    Examples
    --------
    >>> at_design_gap().gain_squared
    4*beta_c*g/(C_U_hat**2*ratio*(Y + y0)**2)
    """
    plant = p.magnetic_levitation()
    local = linearise(plant)
    c_u = local.C_U_rest.subs(p.U, plant.equilibrium_voltage.subs(p.beta, p.beta_c / ratio))
    return AtDesignGap(
        gain_squared=sp.factor(sp.powsimp((c_u / p.C_U_hat) ** 2)),
        C_Y=local.C_Y_rest,
        fall=sp.factor(local.C_Y_rest.subs(p.Y, p.y) / local.C_Y_rest),
    )


def continuous_matrix(law: ControlLaw | None = None) -> Matrix:
    """Return A of the continuous loop in the states (e, e', controller states).

        e'' = C_Y' e - C_U' w,  w = C x + D r,  x' = A_c x + B_c r,

    r what the law reads of (e, e'). In rho, C_Y', C_Y^ and the gains; affine in rho, in C_Y' and
    in rho C_Y^, all three being proportional to q at a fixed ratio.
    """
    law = law or tan_gpi()
    core, read = _believed_core(law.core), _reads(law)
    gain = p.rho * believed(law.loop_gain)
    plant = Matrix([[0, 1], [p.C_Y_true, 0]]) - gain * Matrix.vstack(sp.zeros(1, 2), core.D * read)
    push = -gain * Matrix.vstack(sp.zeros(1, core.C.shape[1]), core.C)
    return _simple(Matrix.vstack(Matrix.hstack(plant, push), Matrix.hstack(core.B * read, core.A)))


def sampled_matrix(
    method: Method, whole: int = 0, *, partial: bool = False, law: ControlLaw | None = None
) -> Matrix:
    """Return A of the sampled loop from one sample to the next.

    States (e, e', controller states, b_{k-1}, ..., b_{k-held}), with b_k = m C_U^ u_k [m/s^2] the
    acceleration that the voltage of sample k would give at the gap of the design. Over one period,
    with the delay n T + T_1 and the hold exact,

        (e, e')_{k+1} = Phi (e, e')_k - Gamma_0 b_{k-n} - Gamma_1 b_{k-n-1};

    Phi and the Gammas are the functions :data:`HOLD` of q, for which symbols stand here. The
    controller is its difference equation: in these symbols, m, C_U^ and the coefficients of
    :func:`maglev_design.symbolic.sampling.named_core`; affine in the symbols of :data:`HOLD`, and
    in m.

    Parameters
    ----------
    whole : int
        n, whole periods of delay.
    partial : bool
        Whether T_1 > 0.
    """
    law = law or tan_gpi()
    (core, _), read = named_core(law, method), _reads(law)
    order, held = 2 + len(law.states), whole + partial
    width = order + held
    effort = m_gain * p.C_U_hat * Matrix.hstack(core.D * read, core.C)
    efforts = [Matrix.hstack(effort, sp.zeros(1, held))]
    efforts += [sp.eye(width)[order + n, :] for n in range(held)]

    phi = Matrix([[1 + rise, travel], [turn, 1 + rise]])
    plant = Matrix.hstack(phi, sp.zeros(2, width - 2))
    plant -= Matrix([fresh_gap, fresh_speed]) * efforts[whole]
    if partial:
        plant -= Matrix([stale_gap, stale_speed]) * efforts[whole + 1]
    controller = Matrix.hstack(core.B * read, core.A, sp.zeros(order - 2, held))
    return _simple(Matrix.vstack(plant, controller, *efforts[:held]))


def _hold() -> Mapping[Symbol, Expr]:
    """Return what stands for the symbols of the sampled matrix, in q, C_Y'(Y), T and T_1."""
    a = sp.sqrt(q * C_Y_rest)

    def gap(time: Expr) -> Expr:  # of the ball a time after a unit acceleration sets in
        return (sp.cosh(a * time) - 1) / a**2

    def speed(time: Expr) -> Expr:
        return sp.sinh(a * time) / a

    held = p.T - first_part
    return MappingProxyType(
        {
            rise: a**2 * gap(p.T),
            travel: speed(p.T),
            turn: a**2 * speed(p.T),
            fresh_gap: q * gap(held),
            fresh_speed: q * speed(held),
            stale_gap: q * (gap(p.T) - gap(held)),
            stale_speed: q * (speed(p.T) - speed(held)),
        }
    )


HOLD: Mapping[Symbol, Expr] = _hold()
"""Entries of the plant's exact discretisation: entire functions of q with positive series."""


def _believed_core(core: StateSpace) -> StateSpace:
    return StateSpace(*(m.applyfunc(believed) for m in (core.A, core.B, core.C, core.D)))


def _reads(law: ControlLaw) -> Matrix:
    """Return r in (e, e'): one row for each input of the law."""
    return Matrix([[sp.diff(r, p.y), sp.diff(r, p.v)] for r in law.inputs])


def _simple(matrix: Matrix) -> Matrix:
    return matrix.applyfunc(lambda entry: sp.factor(sp.cancel(entry)))
