# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # (a) From Newton to the flat output
#
# A ball, a coil, a gap. The magnet pulls the ball up with the square of the current over the gap;
# gravity pulls it down. This notebook goes from that sentence to the model a controller is designed
# with. Equation numbers are those of Belmonte et al., *Mathematics* 9 (2021) 1424; every formula
# below is an object of `maglev_design.symbolic`, and the same objects are simulated, tuned and
# printed as source code elsewhere in the package.
#
# **What you will know at the end**
#
# - why five constants act as one, $\beta$, and how far its value matters;
# - why every gap has its equilibrium, and why each is unstable, with which time constant;
# - how to linearise there, and why a *measured* equilibrium needs no $\beta$ at all;
# - what a flat output is, how controllability singles it out, and what one does with it;
# - for which part of a motion the linear model's feedforward is exact.

# %%
import math

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp
from matplotlib_inline.backend_inline import set_matplotlib_formats
from scipy.integrate import solve_ivp

from maglev_design.controller.checks import check_path_voltage
from maglev_design.controller.design import (
    believed_equilibrium,
    plant_beta,
    reference_path,
    true_equilibrium,
)
from maglev_design.derivation import NOTATION
from maglev_design.errors import InputError
from maglev_design.lowering import lower
from maglev_design.reporting.plots.style import BLUE, GREY, RED, STYLE, WIDTH
from maglev_design.rig import load_rig, make_rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.flatness import flat_model, round_trip_residual
from maglev_design.symbolic.linearisation import linearise, taylor_residual
from maglev_design.symbolic.reference import bezier_step, tau

plt.rcParams.update(STYLE)
set_matplotlib_formats("svg")
# SymPy writes the paper's letters: acc becomes y with two dots, C_Y_hat a C with a hat.
LETTERS = {entry.symbol: entry.latex for entry in NOTATION}
sp.init_printing(use_latex="mathjax", symbol_names=LETTERS)


def equation(left, right):
    """Show an equation as it stands, without evaluating it."""
    return sp.Eq(left, right, evaluate=False)


# %% [markdown]
# ## 1. The plant
#
# The gap $y$ is counted downwards from the magnet, so gravity is positive. Newton's second law (1)
# has the magnet's force as a postulate; the offset $y_0$ is not in the paper ($y_0 = 0$ is its
# model), but on many real rigs the force does not grow without bound where the gap reads zero.

# %%
plant = p.magnetic_levitation()
equation(p.m * p.acc, plant.force_balance)

# %% [markdown]
# The current driver follows its input voltage at once, $i = C u$ (2). Insert it, divide by the
# mass, and three constants collapse into one, $\beta = K C^2/m$: this is (4), the only plant from
# here on.

# %%
by_hand = (plant.force_balance / p.m).subs(p.i, p.C * p.u)
equation(p.acc, plant.acceleration)

# %%
# Check: our division by the mass and the library's (4) are the same function once beta is K C^2/m.
assert sp.simplify(by_hand - plant.acceleration.subs(p.beta, plant.beta)) == 0
# So doubling K and doubling m together changes nothing: no experiment on the motion of the ball can
# tell the two constants apart.
doubled = plant.beta.subs({p.K: 2 * p.K, p.m: 2 * p.m}, simultaneous=True)
assert sp.simplify(doubled - plant.beta) == 0

# %% [markdown]
# ## 2. Equilibria, and what happens beside them
#
# At rest the acceleration is zero. Solve (4) for the voltage and take the positive root: (5).

# %%
equation(p.U, plant.equilibrium_voltage)

# %%
rig = load_rig("belmonte2021")
beta, g, Y = plant_beta(rig), rig.plant.gravity, rig.operating_point.gap
rest = true_equilibrium(rig, beta, Y)
print(f"beta = {beta:.8f} m^3/(s^2 V^2)")
print(f"Y = {1e3 * Y:g} mm needs U = {rest.U:.4f} V")

# %% [markdown]
# Every gap has its equilibrium voltage; with $y_0 = 0$ it is proportional to the gap. But the force
# at a *fixed* voltage falls when the ball sinks. A ball slightly too low is pulled too little,
# sinks further, and is pulled even less. Hold $u = U$, move the ball by 10 µm, and let go:

# %%
acceleration = lower((p.g, p.beta, p.y0, p.y, p.u), {"acc": plant.acceleration}).scalar()


def motion(_time, state):
    """Return (y', y'') of the nonlinear plant under the constant voltage U."""
    gap, velocity = state
    return velocity, acceleration(g, beta, rig.plant.gap_offset, gap, rest.U)[0]


pole = math.sqrt(rest.C_Y)
times = np.linspace(0.0, 0.22, 200)
figure, axes = plt.subplots(figsize=(WIDTH, 2.8), layout="constrained")
for start, colour, side in ((1e-5, RED, "below"), (-1e-5, BLUE, "above")):
    fall = solve_ivp(motion, (0, times[-1]), (Y + start, 0.0), t_eval=times, rtol=1e-9, atol=1e-12)
    moved = 1e3 * (fall.y[0] - Y)
    axes.plot(1e3 * times, moved, color=colour, label=f"10 µm {side}: (4)")
    linear = 1e3 * start * np.cosh(pole * times)
    axes.plot(1e3 * times, linear, color=GREY, ls=":", label=f"10 µm {side}: linear")
axes.set(xlabel="time $t$ [ms]", ylabel="gap minus $Y$ [mm]", title="Without control, $u = U$")
axes.margins(x=0)
axes.legend()
plt.show()

# %% [markdown]
# The dotted curves are $\pm 10\,\mu\mathrm{m} \cdot \cosh(\sqrt{C_Y}\,t)$, with the coefficient
# $C_Y$ that the next section derives. They are right until the ball is a millimetre away: long
# enough for a controller that acts within milliseconds.

# %% [markdown]
# ## 3. Tangent linearisation
#
# Write (4) with everything on one side, $F(\ddot y, y, u) = 0$ (6), and expand $F$ to first order
# around $(0, Y, U)$. What the increments $y_\delta = y - Y$ and $u_\delta = u - U$ obey is (10).

# %%
lin = linearise(plant)
equation(p.acc_d, -lin.C_U * p.u_d + lin.C_Y * p.y_d)

# %%
# Check: differentiate F by hand. The coefficient of the voltage is dF/du at rest, that of the gap
# is -dF/dy at rest.
at_rest = {p.acc: 0, p.y: p.Y, p.u: p.U}
assert sp.simplify(sp.diff(lin.implicit, p.u).subs(at_rest) - lin.C_U) == 0
assert sp.simplify(sp.diff(lin.implicit, p.y).subs(at_rest) + lin.C_Y) == 0
# And the library's own proof of (8) and (9): of F nothing of order zero or one is left over.
assert taylor_residual(plant, lin) == 0

# %% [markdown]
# "First order" is a statement about how the error shrinks: halve the increment, and what the linear
# model misses must fall to a quarter. This is worth computing once.

# %%
c_u, c_y = rest.C_U, rest.C_Y


def missed(gap, voltage):
    """Return what (10) misses of the acceleration [m/s^2] for two increments [m, V]."""
    exact = acceleration(g, beta, rig.plant.gap_offset, Y + gap, rest.U + voltage)[0]
    return exact - (-c_u * voltage + c_y * gap)


sizes = 1e-3 / 2.0 ** np.arange(6)
errors = np.array([missed(size, 0.0) for size in sizes])
for size, error in zip(sizes, errors, strict=True):
    print(f"y_delta = {1e3 * size:8.5f} mm   missed {error:12.4e} m/s^2")

# %%
# Check: each halving divides what is missed by four, ever more exactly.
ratios = errors[:-1] / errors[1:]
assert np.all(np.abs(ratios - 4) < 0.25)
assert abs(ratios[-1] - 4) < abs(ratios[0] - 4)

# %% [markdown]
# ### No $\beta$ needed
#
# (7) says that $\beta U^2 = g\,(Y + y_0)^2$. Eliminate $\beta$ with it, and both coefficients are
# made of gravity and of the measured pair $(Y, U)$ alone. This is the most useful line of the
# notebook: whoever measures which voltage holds the ball needs no model constant for the design.

# %%
sp.Matrix([[lin.C_U, lin.C_U_rest], [lin.C_Y, lin.C_Y_rest]])

# %%
# Check: left and right column are the same once U is the equilibrium voltage (5).
for with_beta, without in ((lin.C_U, lin.C_U_rest), (lin.C_Y, lin.C_Y_rest)):
    assert sp.simplify((with_beta - without).subs(p.U, plant.equilibrium_voltage)) == 0
assert math.isclose(c_u, 2 * g / rest.U)
assert math.isclose(c_y, 2 * g / Y)
print(f"C_U = {c_u:.4f} m/(s^2 V), C_Y = {c_y:.2f} 1/s^2")

# %% [markdown]
# ### Unstable everywhere, and faster near the magnet
#
# The poles of (10) are $\pm\sqrt{C_Y} = \pm\sqrt{2g/(Y + y_0)}$: real, symmetric, one of them in
# the right half-plane at every gap. Neither mass nor $\beta$ decides how fast the ball escapes; the
# gap does. Both coefficients are proportional to $1/(y + y_0)$, so a controller designed at one gap
# and used at another sees *both* multiplied by the same factor.

# %%
for gap in (0.0246, 0.0242, 0.012):
    local = true_equilibrium(rig, beta, gap)
    escape = 1e3 * math.log(2) / math.sqrt(local.C_Y)
    print(
        f"{1e3 * gap:5.1f} mm: C_U = {local.C_U:6.3f} m/(s^2 V), C_Y = {local.C_Y:7.1f} 1/s^2, "
        f"pole {math.sqrt(local.C_Y):5.2f} 1/s, its mode doubles in {escape:4.1f} ms"
    )

# %%
# Check: from Y = 24.6 mm to the end of the paper's path, 12 mm, both coefficients grow by 24.6/12.
end = true_equilibrium(rig, beta, rig.reference.end_gap)
growth = Y / rig.reference.end_gap
assert math.isclose(end.C_U / c_u, growth)
assert math.isclose(end.C_Y / c_y, growth)

# %% [markdown]
# ## 4. Controllable, hence flat
#
# With the state $(y_\delta, \dot y_\delta)$, (10) has the controllability matrix $[B, AB]$:

# %%
flat = flat_model(plant, lin)
flat.controllability

# %% [markdown]
# Its determinant is $-C_U^2$, which is never zero. For one input, controllable and *flat* are the
# same: there is an output in whose derivatives everything can be written. The recipe to find it is
# the last row of the inverse of $[B, AB]$ times the state. That output does not see the input in
# its first derivative ($cB = 0$) but in its second ($cAB \ne 0$): its relative degree is the order
# of the plant, and nothing is left hidden.

# %%
# Check: the recipe gives the incremental gap, the determinant is -C_U^2, and c B = 0 != c A B.
assert flat.flat_output == p.y_d
assert sp.simplify(flat.controllability.det() + p.C_U**2) == 0
c = sp.Matrix([[1, 0]])
assert (c * lin.B)[0] == 0
assert (c * lin.A * lin.B)[0] == -p.C_U

# %% [markdown]
# "Everything" means the voltage, too. Solve (10) for it and read from right to left: choose *any*
# smooth motion of the gap, and (11) is the voltage that makes it. No differential equation is left
# to solve.

# %%
equation(p.u_d, flat.input)

# %% [markdown]
# The nonlinear plant has the same property. The voltage of a motion $y(t)$ follows from (4),

# %%
equation(p.u, flat.nonlinear_input)

# %%
# Check: (11) and (10) undo each other, and so do the nonlinear voltage and (4).
assert round_trip_residual(flat) == 0
back = plant.acceleration.subs(p.u, flat.nonlinear_input)
assert sp.simplify(back - p.acc) == 0

# %% [markdown]
# The nonlinear voltage is real only for $\ddot y < g$: a magnet that only pulls cannot push the
# ball down faster than it falls.

# %% [markdown]
# ## 5. How good is the linear feedforward?
#
# On a path $y^*$, (11) asks for $U + \frac{C_Y}{C_U}(y^* - Y) - \frac{1}{C_U}\ddot y^*$. The first
# two terms are the *static* feedforward. Since $C_Y/C_U = U/(Y + y_0)$, they add up to
# $U\,(y^* + y_0)/(Y + y_0)$: exactly the voltage that holds the ball at $y^*$, however far from
# $Y$. Only the acceleration term is approximate. The path is the paper's, rest to rest along a
# Bezier polynomial (27) to (29), first in its five seconds and then in a quarter of one.

# %%
static = p.U + lin.C_Y_rest / lin.C_U_rest * (p.y_ref - p.Y)
holding = plant.equilibrium_voltage.subs(p.Y, p.y_ref)
assert sp.simplify((static - holding).subs(p.U, plant.equilibrium_voltage)) == 0

nonlinear = lower((p.g, p.beta, p.y0, p.y, p.acc), {"u": flat.nonlinear_input}).numpy()


def feedforwards(duration):
    """Return times [s], the exact voltage, the linear one and its static part [V] of a move."""
    data = rig.model_dump(exclude_none=True)
    data["reference"] |= {"start_time": 0.0, "end_time": duration, "horizon": duration}
    moving = make_rig(data)
    t = np.linspace(0, duration, 400)
    gap, _, acc = reference_path(moving, t)
    (exact,) = nonlinear(g, beta, 0.0, gap, acc)
    held = rest.U + c_y / c_u * (gap - Y)
    return t, exact, held - acc / c_u, held


figure, panels = plt.subplots(1, 2, figsize=(WIDTH, 2.8), layout="constrained")
worst = {}
for axes, duration in zip(panels, (5.0, 0.25), strict=True):
    t, exact, linear, held = feedforwards(duration)
    worst[duration] = np.abs(exact - linear).max(), np.abs(exact - held).max()
    axes.plot(t, exact, color=RED, label="exact")
    axes.plot(t, linear, color=BLUE, ls="--", label="linear (11)")
    axes.plot(t, held, color=GREY, ls=":", label="static part")
    axes.set(xlabel="time $t$ [s]", title=f"24.2 mm to 12 mm in {duration:g} s")
    axes.margins(x=0)
panels[0].set_ylabel("voltage $u$ [V]")
panels[0].legend()
plt.show()
for duration, (linear, held) in worst.items():
    print(f"{duration:5g} s: linear off by {1e3 * linear:9.4f} mV, static {1e3 * held:9.4f} mV")

# %%
# Check: on the paper's slow path the linear feedforward is good to a millivolt; twenty times faster
# it is not, because the acceleration grows with the square of the speed, four hundred times.
slow, fast = worst[5.0], worst[0.25]
assert slow[0] < 1e-3
assert fast[0] > 100 * slow[0]

# %% [markdown]
# ## Exercises
#
# 1. A rig has the same constants but a magnetic offset $y_0 = 3$ mm. Which of $U$, $C_U$, $C_Y$
#    change at $Y = 24.6$ mm, and does the ball escape faster or slower?
# 2. You measure that 2.2 V, not 2.0825 V, hold the ball at 24.6 mm. What is $\beta$ really, and by
#    how many per cent was each coefficient wrong that was computed from the old $\beta$?
# 3. In how short a time can the ball be moved from 24.2 mm to 12 mm at all, with 0 to 5 V and a
#    magnet that only pulls? Which of the two decides?

# %% [markdown]
# ## Answers
#
# **1.** $U$ is proportional to $Y + y_0$ and rises; $C_Y = 2g/(Y + y_0)$ and $C_U = 2g/U$ fall by
# the same factor. The pole is slower: an offset makes the ball easier to hold.

# %%
data = rig.model_dump(exclude_none=True)
data["plant"]["gap_offset"] = 0.003
shifted = true_equilibrium(make_rig(data), beta, Y)
factor = (Y + 0.003) / Y
print(f"factor {factor:.4f}: U = {shifted.U:.4f} V, pole {math.sqrt(shifted.C_Y):.2f} 1/s")
assert math.isclose(shifted.U, factor * rest.U)
assert math.isclose(shifted.C_U, rest.C_U / factor)
assert math.isclose(shifted.C_Y, rest.C_Y / factor)
assert shifted.C_Y < rest.C_Y

# %% [markdown]
# **2.** From (7), $\beta = g\,(Y + y_0)^2/U^2$. $C_Y$ was right, it never contained $\beta$;
# $C_U = 2g/U$ was wrong by as much as $U$ was. The library's reading `measured` takes the pair as
# it is.

# %%
data = rig.model_dump(exclude_none=True)
data["operating_point"]["voltage"] = 2.2
measured = believed_equilibrium(make_rig(data), "measured")
print(f"beta = {measured.beta:.6f} instead of {beta:.6f} m^3/(s^2 V^2)")
print(f"C_U too large by {100 * (rest.C_U / measured.C_U - 1):.2f} %, C_Y by 0 %")
assert math.isclose(measured.beta, g * Y**2 / 2.2**2)
assert math.isclose(rest.C_U / measured.C_U, 2.2 / rest.U)
assert math.isclose(measured.C_Y, rest.C_Y)

# %% [markdown]
# **3.** Gravity decides. The way up starts with a pull, for which 5 V are plenty; it ends with
# braking, and only gravity brakes. $\ddot y^*$ scales with one over the square of the duration, so
# the shortest one follows from $\max \ddot y^* = g$. The library refuses a path that needs a
# voltage outside the range or more than $g$; bisecting its answer gives the same duration.

# %%


def refusal(duration):
    """Return why a move of that duration [s] is impossible, or an empty text."""
    data = rig.model_dump(exclude_none=True)
    data["reference"] |= {"start_time": 0.0, "end_time": duration, "horizon": duration}
    data["initial"]["gap"] = rig.reference.start_gap
    try:
        check_path_voltage(make_rig(data))
    except InputError as error:
        return str(error)
    return ""


low, high = 0.01, 1.0
while high - low > 1e-5:
    middle = (low + high) / 2
    low, high = (middle, high) if refusal(middle) else (low, middle)
phi = sp.lambdify(tau, bezier_step().curvature)(np.linspace(0, 1, 20001))
travel = rig.reference.end_gap - rig.reference.start_gap
estimate = math.sqrt((travel * phi).max() / g)
print(f"shortest move {1e3 * high:.1f} ms; from the acceleration alone {1e3 * estimate:.1f} ms")
print(refusal(low))
assert "gravity" in refusal(low)
assert math.isclose(high, estimate, rel_tol=1e-3)
