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
# # (b) GPI control, and what the integral reconstructor really does
#
# The state feedback (14) needs the velocity of the ball, and the rig measures only the gap.
# Generalised proportional integral (GPI) control replaces the velocity by integrals of what is
# known: the voltage and the gap. This notebook derives the law (20), then asks what it *is*. The
# answer is older than its name, and it decides how the law must be programmed.
#
# **What you will know at the end**
#
# - how the velocity is reconstructed without differentiating, and what the reconstruction leaves
#   out;
# - how four gains place four poles, (25);
# - that (20) is, exactly, a PID with a filtered derivative: its four gains in ohms and volts, so to
#   speak;
# - why the law as printed must not be programmed: two integrators that nobody sees run away;
# - the bounded form with two states, which is what this package simulates, proves and exports;
# - which disturbances leave no error, and which leave how much.

# %%
import math

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp
from matplotlib_inline.backend_inline import set_matplotlib_formats

from maglev_design.controller.design import PoleSpec, make_design
from maglev_design.derivation import NOTATION
from maglev_design.derivation.control import printed_law
from maglev_design.options import Controller
from maglev_design.paper.theory_disturbances import error_of_disturbance, lasting
from maglev_design.paper.theory_law import pid_numbers
from maglev_design.paper.theory_linear import (
    TriedRig,
    answer,
    linear_loop,
)
from maglev_design.reporting.plots.style import BLUE, GREEN, GREY, RED, STYLE, WIDTH
from maglev_design.rig import load_rig
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.gpi import (
    gain_symbols,
    gpi_transfer,
    match_coefficients,
    pole_pairs_polynomial,
)
from maglev_design.symbolic.laws import (
    control_law,
    tan_gpi,
)
from maglev_design.symbolic.stability import closed_loop_polynomial

plt.rcParams.update(STYLE)
set_matplotlib_formats("svg")
LETTERS = {entry.symbol: entry.latex for entry in NOTATION}
sp.init_printing(use_latex="mathjax", symbol_names=LETTERS)
GAINS = (p.k0, p.k1, p.k2, p.k3)


def equation(left, right):
    """Show an equation as it stands, without evaluating it."""
    return sp.Eq(left, right, evaluate=False)


rig = load_rig("belmonte2021")
design = make_design(rig, PoleSpec.double(1.0, 70.0))
loop = linear_loop(TriedRig(rig, design.poles))
print(dict(zip(("k0", "k1", "k2", "k3"), design.gains, strict=True)))

# %% [markdown]
# ## 1. The law that one would like to run
#
# With $e = y - y^*$ and the voltage $u^*_\delta$ that (11) assigns to the path, the error obeys
# $\ddot e = C_Y e - C_U (u_\delta - u^*_\delta)$ (13). Wish for
# $\ddot e = -k_3 \dot e - k_2 e - k_1 \int e$ and solve for the voltage: that is (14), and its
# closed loop has the polynomial (16). The library knows the law; as designed ($\rho = 1$,
# $C_Y' = \hat C_Y$) its loop polynomial is:

# %%
exact = {p.rho: 1, p.C_Y_true: p.C_Y, p.C_Y_hat: p.C_Y}


def loop_polynomial(controller):
    """Return the characteristic polynomial of a law with exact parameters."""
    coefficients = closed_loop_polynomial(control_law(controller))
    return sp.Poly([sp.expand(c.subs(exact)) for c in coefficients], p.s).as_expr()


loop_polynomial(Controller("state-feedback"))

# %% [markdown]
# $C_Y$ has gone: feedback has replaced the plant's own stiffness by the wished one. The price is
# $\dot e$ in the law.

# %% [markdown]
# ## 2. The velocity from integrals
#
# Integrate (10) once from 0 to $t$. On the left stands $\dot y_\delta(t) - \dot y_\delta(0)$, on
# the right integrals of the voltage, which the controller has chosen itself, and of the gap, which
# it measures. Leave the unknown $\dot y_\delta(0)$ out, and you have the reconstructed velocity
# (18):

# %%
law = printed_law(p.C_U, p.C_Y)
law.estimate

# %% [markdown]
# It is off by a constant, the initial velocity. A constant error of the velocity acts like a
# constant disturbance $k_3\,\dot y_\delta(0)$ on the error, and a further integral removes that.
# Hence *two* integrals of the error in (20), a fourth order, and one more gain:

# %%
law.feedback

# %%
loop_polynomial(Controller("tan-gpi"))

# %% [markdown]
# The gains are the coefficients of the closed loop's polynomial (23). Wish for two equal pole pairs
# (24) and compare power by power: (25).

# %%
pair = (p.zeta, p.omega_n)
matched = match_coefficients(pole_pairs_polynomial([pair, pair]), 4)
sp.Matrix([list(GAINS), list(matched)]).T

# %%
# Check: for zeta = 1 and omega_n = 70 rad/s all four poles lie at -70 1/s, and the library's gains
# are the numbers of (25).
numbers = [float(k.subs({p.zeta: 1, p.omega_n: 70})) for k in matched]
assert np.allclose(numbers, design.gains)
assert np.allclose(np.poly([-70.0] * 4), [1, *reversed(design.gains)])

# %% [markdown]
# ## 3. What the law is: a PID
#
# The voltage stands on both sides of (20): the law integrates what it commands. Collect it, in
# Laplace's variable, and solve. Then the law is one transfer function from the error to the
# voltage, $u_\delta - u^*_\delta = \frac{1}{C_U} G(s)\, e$.

# %%
G = gpi_transfer(GAINS)
equation(sp.Symbol("G(s)"), G)

# %%
# Check: the three printed lines of (20), inserted into each other, are this G over C_U.
assert sp.simplify(law.correction() - G / p.C_U) == 0

# %% [markdown]
# Look at its poles: one at 0, one at $-k_3$. An integrator and a lag. Partial fractions make the
# structure plain,

# %%
parts = sp.apart(G, p.s)
parts

# %% [markdown]
# and the lag plus the constant is nothing but a proportional part plus a derivative with a filter:
# $\frac{K_d s}{1 + s/N}$ with $N = k_3$.

# %%
K_p, K_i, K_d = sp.symbols("K_p K_i K_d")
pid = K_p + K_i / p.s + K_d * p.s / (1 + p.s / p.k3)
over = sp.fraction(sp.together(G - pid))[0]
(found,) = sp.solve(sp.Poly(sp.expand(over), p.s).coeffs(), (K_p, K_i, K_d), dict=True)
sp.Matrix([[K_p, sp.expand(found[K_p])], [K_i, found[K_i]], [K_d, sp.expand(found[K_d])]])

# %%
# Check: nothing is left over, so (20) IS this PID with a filtered derivative.
assert sp.simplify(G - pid.subs(found)) == 0
values = dict(zip((*GAINS, p.C_Y), (*loop.gains, loop.c_y_hat), strict=True))
by_hand = [float(found[k].subs(values)) / loop.c_u_hat for k in (K_p, K_i, K_d)]
kp, ki, kd, pole = pid_numbers(loop)
assert np.allclose(by_hand, (kp, ki, kd))
print(f"K_p = {kp:.1f} V/m, K_i = {ki:.0f} V/(m s), K_d = {kd:.3f} V s/m")
print(
    f"derivative filter at {pole:g} rad/s = {pole / (2 * math.pi):.1f} Hz, lag {1e3 / pole:.2f} ms"
)

# %% [markdown]
# So the reconstructor does not *avoid* the low-pass filter of a numerical derivative and its delay.
# It *is* one, with the corner frequency at $k_3 = 4 \zeta \omega_n$: the fourth pole that had to be
# placed for it. What GPI control gives is a way to *choose* the filter together with the other
# three gains, so that all four closed-loop poles lie where one wants them. That is worth having,
# and it is not the same as needing no filter.

# %%
omega = np.geomspace(1, 1e4, 400)
s = 1j * omega
ideal = kp + ki / s + kd * s
filtered = kp + ki / s + kd * s / (1 + s / pole)
figure, axes = plt.subplots(figsize=(WIDTH, 2.8), layout="constrained")
axes.loglog(omega, np.abs(filtered), color=RED, label="GPI law (20)")
axes.loglog(omega, np.abs(ideal), color=BLUE, ls="--", label="the same PID without a filter")
axes.axvline(pole, color=GREY, ls=":", label="$k_3$")
axes.set(
    xlabel="angular frequency [rad/s]",
    ylabel="error to voltage [V/m]",
    title="The law (20) with the paper's gains",
)
axes.legend()
plt.show()

# %%
# Check: the frequency response of G is that of the PID, at every frequency of the figure.
response = sp.lambdify(p.s, G.subs(values) / loop.c_u_hat)(s)
assert np.allclose(response, filtered, rtol=1e-12)

# %% [markdown]
# ## 4. Integrators that nobody sees
#
# G has two poles, so two states are enough. The law as printed has four integrals: of the voltage,
# of the gap, of the error, and of that integral. The two superfluous ones must cancel, and they
# cancel as integrators at $s = 0$. Put the printed law around the linear plant and count poles:

# %%
matrix, reference = loop.printed
for value in sorted(np.linalg.eigvals(matrix), key=lambda x: x.real):
    print(f"{value.real:9.3f} {value.imag:+8.3f}j")

# %% [markdown]
# Four poles near $-70$ (a fourfold eigenvalue is hard to compute, hence the scatter) and two at
# zero. The error does not show the two: it converges like $p(s)$ says. But what the integrators
# hold does not. Ask the ball to stay at the end of the paper's path, 12.6 mm above $Y$:

# %%
step = rig.reference.end_gap - rig.operating_point.gap
times = np.linspace(0, 0.5, 120)
held = np.array([answer(matrix, reference * step, np.zeros(6), 0, t) for t in times])
# The same loop with two states: errors start at -step, because the ball starts at Y.
small = loop.bounded
start = np.array([-step, 0.0, 0.0, 0.0])
calm = np.array([answer(small, np.zeros(4), start, 0, t) for t in times])

figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 2.8), layout="constrained")
left.plot(times, 1e3 * (held[:, 0] - step), color=RED, label="(20) as printed")
left.plot(times, 1e3 * calm[:, 0], color=BLUE, ls="--", label="bounded form")
left.set(xlabel="time $t$ [s]", ylabel="error $e$ [mm]", title="what one sees")
right.plot(times, 1e3 * held[:, 3], color=RED, label="printed: $\\int y_\\delta$")
right.plot(times, 1e3 * calm[:, 2], color=BLUE, ls="--", label="bounded: $x_1$")
right.plot(times, 1e3 * calm[:, 3], color=GREEN, ls="-.", label="bounded: $x_2$")
right.set(xlabel="time $t$ [s]", ylabel="content [mm s]", title="what the controller holds")
for axes in (left, right):
    axes.margins(x=0)
    axes.legend()
plt.show()

# %%
# Check: both laws give the same error, to rounding; but at the end the printed one's integrals of
# gap and voltage still run, at the rates y_delta and u_delta that hold the ball.
assert np.abs(held[:, 0] - step - calm[:, 0]).max() < 1e-9 * abs(step) + 1e-12
late = answer(matrix, reference * step, np.zeros(6), 0, 3.0)
rates = matrix @ late + reference * step
voltage = loop.c_y / loop.c_u * step
print(f"int(u_d) grows by {rates[2]:.4f} V s a second, int(y_d) by {1e3 * rates[3]:.2f} mm s")
assert math.isclose(rates[3], step, rel_tol=1e-6)
assert math.isclose(rates[2], voltage, rel_tol=1e-6)
assert np.abs(calm[-1]).max() < 1e-6

# %% [markdown]
# Nothing is wrong in the model: there is no mismatch, no noise, and the error is zero. Still two
# numbers in the controller's memory grow without bound, until a floating-point sum loses the small
# increments or a fixed-point one overflows. In an analogue circuit with a time constant of one
# second and amplifiers of $\pm 10$ V, the first saturates within ten seconds.

# %% [markdown]
# ### The bounded form
#
# The cure is algebra. Give each partial fraction one state: an integrator and a lag,
#
# $$\dot x_1 = e, \qquad \dot x_2 = -k_3 x_2 + e,$$
#
# and read the voltage from them. This is the law that the whole package runs:

# %%
core = tan_gpi().core
sp.Matrix([core.C.row(0)]).T

# %%
# Check: its transfer function is G/C_U, and with the plant it has the four designed poles and no
# others.
assert sp.simplify(core.transfer(p.s) - G / p.C_U) == 0
assert np.allclose(np.poly(small), [1, *reversed(design.gains)], rtol=1e-6)

# %% [markdown]
# ## 5. What the reconstructed velocity really says
#
# (19) says: the estimate is off by a constant. That holds for the plant (10), undisturbed. Push the
# ball with one per cent of its weight and watch: the feedback holds the ball, the velocity returns
# to zero, and the estimate keeps falling, because the voltage that carries the extra weight is
# integrated as if it accelerated the ball.

# %%
push = 0.01 * rig.plant.gravity
forcing = np.array([0.0, push, 0.0, 0.0, 0.0, 0.0])
pushed = np.array([answer(matrix, forcing, np.zeros(6), 0, t) for t in times])
estimate = -loop.c_u_hat * pushed[:, 2] + loop.c_y_hat * pushed[:, 3]
figure, axes = plt.subplots(figsize=(WIDTH, 2.6), layout="constrained")
axes.plot(times, 1e3 * pushed[:, 1], color=RED, label="velocity of the ball")
axes.plot(times, 1e3 * estimate, color=BLUE, ls="--", label="reconstructed (18)")
axes.set(
    xlabel="time $t$ [s]", ylabel="velocity [mm/s]", title="A constant push of 1 % of the weight"
)
axes.margins(x=0)
axes.legend()
plt.show()

# %%
# Check: in the end the estimate falls by exactly the pushed acceleration, for ever.
slope = (estimate[-1] - estimate[-11]) / (times[-1] - times[-11])
print(f"slope of the estimate {slope:.4f} m/s^2, push {push:.4f} m/s^2")
assert math.isclose(slope, -push, rel_tol=1e-3)

# %% [markdown]
# The law survives that because its double integral of the error provides the opposite ramp. But
# then that integral is used up. From a disturbing acceleration $d$ to the error, the closed loop is

# %%
transfer = error_of_disturbance(4)
equation(sp.Symbol("E(s)/D(s)"), transfer)

# %% [markdown]
# with *one* factor $s$ in the numerator. One factor $s$ means: a constant leaves no error, a ramp
# leaves a constant one. Two integrals in the law, one of them for the reconstructor.

# %%
# Check: the final value theorem says 0 for a constant and k3/k0 times the slope for a ramp; the
# simulated loop says the same.
assert lasting(transfer, 0) == 0
assert sp.simplify(lasting(transfer, 1) - p.k3 / p.k0) == 0
left_over = answer(small, np.array([0, 1.0, 0, 0]), np.zeros(4), 1, 2.0)[0]
k0, _, _, k3 = design.gains
print(f"a push that grows by 1 m/s^2 a second leaves {1e6 * left_over:.2f} µm")
assert math.isclose(left_over, k3 / k0, rel_tol=1e-6)

# %% [markdown]
# ## Exercises
#
# 1. Somebody slows the design down to $\omega_n = 40$ rad/s, $\zeta = 1$. What PID is it, and where
#    is its filter? Is a smaller $K_d$ the whole difference in the amplification of sensor noise at
#    high frequencies?
# 2. The amplifier adds 10 mV to every voltage. What does the integrator $x_1$ hold in the end, and
#    what is the error?
# 3. Design the law one order higher so that a ramp leaves no error. What does its transfer function
#    look like, and what do you pay?

# %% [markdown]
# ## Answers
#
# **1.** At high frequencies the law is a plain gain, $(k_2 + C_Y)/C_U$, whatever the split into
# $K_p$ and $K_d N$. Both the derivative gain and the filter's corner fall.

# %%
slower = make_design(rig, PoleSpec.double(1.0, 40.0))
slow = pid_numbers(linear_loop(TriedRig(rig, slower.poles)))
print("K_p = {:.1f} V/m, K_i = {:.0f} V/(m s), K_d = {:.3f} V s/m, N = {:g} rad/s".format(*slow))
high = slow[0] + slow[2] * slow[3]
print(f"gain at high frequency {high:.0f} V/m, before {kp + kd * pole:.0f} V/m")
assert math.isclose(slow[3], 4 * 1.0 * 40.0)
assert math.isclose(high, (slower.gains[2] + loop.c_y_hat) / loop.c_u_hat)
# The ratio of the two is not that of the K_d's alone: the filters differ, too.
assert high / (kp + kd * pole) < slow[2] / kd

# %% [markdown]
# **2.** At rest $e = 0$, $x_2 = 0$, and the voltage of $x_1$ must be $-10$ mV:
# $x_1 = -\frac{k_3 C_U}{k_0} \cdot 10$ mV.

# %%
offset = 0.010
rest = answer(small, np.array([0, -loop.c_u * offset, 0, 0]), np.zeros(4), 0, 2.0)
print(f"e = {1e9 * rest[0]:.3f} nm, x1 = {1e6 * rest[2]:.4f} µm s")
assert abs(rest[0]) < 1e-12
assert math.isclose(rest[2], -k3 * loop.c_u / k0 * offset, rel_tol=1e-6)

# %% [markdown]
# **3.** $G$ gets a second integrator, $s^2$ in the denominator; so does the numerator of $E/D$. The
# price is a fifth pole to place, and with five poles at the same place a larger gain at high
# frequencies.

# %%
five = gain_symbols(5)
wish = (p.s + p.omega_n) ** 5
placed = match_coefficients(wish, 5)
assert sp.degree(sp.fraction(gpi_transfer(five))[1], p.s) == 3
assert sp.limit(gpi_transfer(five) * p.s**2, p.s, 0) != 0
higher = error_of_disturbance(5)
assert lasting(higher, 1) == 0
assert lasting(higher, 2) != 0
before = design.gains[2] + loop.c_y_hat
after = float(placed[3].subs(p.omega_n, 70)) + loop.c_y_hat
print(f"gain at high frequency: {after / before:.2f} times that of the fourth order")
assert after > before
