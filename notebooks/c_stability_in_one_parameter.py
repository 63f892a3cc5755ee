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
# # (c) Stability in one parameter
#
# The controller was designed with $\beta_c$, at the gap $Y$. The plant has $\beta$, and the ball is
# somewhere else. For which ratios $\beta_c/\beta$ is the loop still stable? Appendix A of the paper
# answers with a number, 1/2.63. This notebook answers with a proof, and gets another one.
#
# **What you will know at the end**
#
# - why two numbers, $\rho$ and $C_Y'$, carry everything that can be wrong with the plant;
# - how the Routh-Hurwitz conditions become a table of polynomials, without a single fraction;
# - that one inequality decides, and that Appendix A's bound is $1/(4\zeta^2 + 1) = 1/5$;
# - how to refute a printed number: by proof, by eigenvalues and by simulation;
# - the *exact* interval of $\beta_c/\beta$ for three ways to know the equilibrium, at one gap and
#   along a path;
# - what sampling takes away from it.

# %%
import math
from fractions import Fraction

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp
from matplotlib_inline.backend_inline import set_matplotlib_formats

from maglev_design.certification.intervals.interval import (
    exact_loop,
    gaps_at,
    ratios_at,
    ratios_over,
)
from maglev_design.certification.intervals.sampled import setting
from maglev_design.certification.intervals.sampled_interval import sampled_ratios_at
from maglev_design.certification.rationals import decimal
from maglev_design.controller.design import PoleSpec, make_design, plant_beta, voltage_on_plant
from maglev_design.controller.timing import exact_timing
from maglev_design.derivation import NOTATION
from maglev_design.options import EQUILIBRIA
from maglev_design.paper.theory_appendix import bounds
from maglev_design.paper.theory_linear import TriedRig, linear_loop
from maglev_design.reporting.plots.style import BLUE, GREEN, GREY, RED, STYLE, WIDTH
from maglev_design.rig import load_rig, make_rig
from maglev_design.simulation import Scenario, loop_for, simulate
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.gpi import (
    match_coefficients,
    pole_pairs_polynomial,
)
from maglev_design.symbolic.laws import (
    tan_gpi,
)
from maglev_design.symbolic.robustness import GAP, largest_ratio
from maglev_design.symbolic.stability import (
    closed_loop_polynomial,
    routh_hurwitz,
    stability_condition,
)

plt.rcParams.update(STYLE)
set_matplotlib_formats("svg")
LETTERS = {entry.symbol: entry.latex for entry in NOTATION}
sp.init_printing(use_latex="mathjax", symbol_names=LETTERS)
COLOURS = dict(zip(EQUILIBRIA, (BLUE, RED, GREEN), strict=True))

rig = load_rig("belmonte2021")
poles = PoleSpec.double(1.0, 70.0)
beta, Y = plant_beta(rig), rig.operating_point.gap

# %% [markdown]
# ## 1. Two numbers
#
# Hats are what the controller believes, primes what is true at the gap where the ball is. The loop
# multiplies the believed $1/\hat C_U$ by the true $C_U'$, so only their ratio
# $\rho = C_U'/\hat C_U$ enters, and $C_Y'$ enters as the true stiffness. The coefficients of the
# closed loop's polynomial, highest power first:

# %%
coefficients = closed_loop_polynomial(tan_gpi())
sp.Matrix(coefficients)

# %%
# Check: with the right values, rho = 1 and C_Y' = C_Y^, the designed polynomial (23) is back.
exact = {p.rho: 1, p.C_Y_true: p.C_Y_hat}
designed = [sp.expand(c.subs(exact)) for c in coefficients]
assert designed == [1, p.k3, p.k2, p.k1, p.k0]

# %% [markdown]
# ## 2. Routh and Hurwitz without fractions
#
# A polynomial of order four has all its roots in the left half-plane if and only if the four
# Hurwitz determinants are positive. The textbook's Routh array divides; multiply each of its rows
# by the determinant above, and every entry stays a polynomial. For any
# $s^4 + a_3 s^3 + a_2 s^2 + a_1 s + a_0$:

# %%
a3, a2, a1, a0 = sp.symbols("a_3 a_2 a_1 a_0")
conditions = routh_hurwitz([sp.Integer(1), a3, a2, a1, a0])
sp.Matrix(conditions)

# %%
# Check: on 500 random polynomials the conditions and the computed roots never disagree.
generator = np.random.default_rng(1)
tests = sp.lambdify((a3, a2, a1, a0), conditions)
stable = 0
for row in generator.uniform(0, 4, (500, 4)):
    roots = np.roots([1, *row])
    assert (min(tests(*row)) > 0) == (roots.real.max() < 0)
    stable += roots.real.max() < 0
print(f"{stable} of 500 polynomials with positive coefficients are stable")

# %% [markdown]
# Insert the loop's coefficients and the gains (25). The conditions factor, and only one factor has
# a sign that is not obvious.

# %%
pair = (p.zeta, p.omega_n)
matched = match_coefficients(pole_pairs_polynomial([pair, pair]), 4)
gains = dict(zip((p.k0, p.k1, p.k2, p.k3), matched, strict=True))
determinants = routh_hurwitz([c.subs(gains) for c in coefficients])
condition = stability_condition()
condition

# %%
# Check: D1 and D2 are positive without any condition, D3 is their product times the margin above,
# and D4 is k0 rho D3. So the margin is positive if and only if the loop is stable.
D1, D2, D3, D4 = determinants
k0, k1, k2, k3 = matched
assert sp.simplify(D1 - k3) == 0
assert sp.simplify(D2 - p.rho * (k2 * k3 - k1)) == 0
assert sp.factor(k2 * k3 - k1).is_positive
assert sp.simplify(D3 - D1 * D2 * condition) == 0
assert sp.simplify(D4 - k0 * p.rho * D3) == 0

# %% [markdown]
# In words: **the loop is stable if and only if**
# $\rho\,(\omega_n^2 + \hat C_Y) > C_Y' + \frac{\omega_n^2}{4\zeta^2 + 1}$. Too *little* loop gain
# is the danger, since the plant would fall by itself; too much there is not, in continuous time.

# %% [markdown]
# ## 3. Appendix A, and the number 2.63
#
# The appendix assumes that $U$ is measured, and computes $\hat C_U$ and $\hat C_Y$ from it with
# $\beta_c$. Then both coefficients are off by the same factor: $\rho = \mu$ and
# $C_Y' = \mu\,\hat C_Y$ with $\mu = \beta/\beta_c$. The condition loses $C_Y$ altogether:

# %%
mu = sp.Symbol("mu", positive=True)
appendix = sp.expand(condition.subs({p.rho: mu, p.C_Y_true: mu * p.C_Y_hat}))
(bound,) = sp.solve(appendix, mu)
sp.Eq(mu, sp.factor(bound), evaluate=False)

# %%
# Check: the formula of (A7) with gamma_n = k_n is this bound, for every zeta and omega_n; at
# zeta = 1 it is 1/5.
formula = k0 * k3**2 / (k1 * (k2 * k3 - k1))
assert sp.simplify(formula - 1 / (4 * p.zeta**2 + 1)) == 0
assert sp.simplify(bound - formula) == 0
assert bound.subs(p.zeta, 1) == sp.Rational(1, 5)

# %% [markdown]
# The paper prints 1/2.63 for $\zeta = 1$. Its $\gamma$s are described in two places that contradict
# each other; perhaps one of them gives the number? The library evaluates (A7) for every reading of
# the text:

# %%
loop = linear_loop(TriedRig(rig, poles))
readings = bounds(loop)
for name, value in readings.items():
    print(f"mu > {value:10.4f}   {name}")
print(f"     {1 / 2.63:10.4f}   printed")

# %%
# Check: no reading gives the printed number, and only gamma_n = k_n gives the true one.
assert all(abs(value - 1 / 2.63) > 0.1 for value in readings.values())
assert [name for name, value in readings.items() if math.isclose(value, 0.2)] == ["gamma_n = k_n"]

# %% [markdown]
# A formula can be misread. Eigenvalues cannot: here are the four poles while $\mu$ falls from 1 to
# 0.15. At 1/2.63 nothing happens; at 1/5 a pair crosses the axis.

# %%


def spectrum(value):
    """Return the poles of the loop at Y under Appendix A's reading, mu = `value`."""
    case = TriedRig(rig, poles)
    return np.linalg.eigvals(linear_loop(case, ratio=1 / value, reading="appendix-a").bounded)


figure, axes = plt.subplots(figsize=(WIDTH, 3.2), layout="constrained")
path = np.array([spectrum(value) for value in np.geomspace(1.0, 0.15, 250)])
axes.plot(
    path.real.ravel(), path.imag.ravel(), ".", color=GREY, ms=2, label="$\\mu$ from 1 to 0.15"
)
marks = ((1.0, "s", BLUE, "1"), (1 / 2.63, "o", GREEN, "1/2.63"), (0.2, "*", RED, "1/5"))
for value, marker, colour, label in marks:
    at = spectrum(value)
    axes.plot(at.real, at.imag, marker, color=colour, ms=7, label=f"$\\mu = {label}$", ls="none")
axes.axvline(0, color="black", lw=0.8)
axes.set(xlabel="real part [1/s]", ylabel="imaginary part [rad/s]", xlim=(-220, 25))
axes.set_title("Poles of the loop at $Y$, reading of Appendix A")
axes.legend(loc="upper left")
plt.show()

# %%
# Check: one per cent above 1/5 stable, one per cent below unstable; at 1/2.63 far from the edge.
assert spectrum(0.202).real.max() < 0 < spectrum(0.198).real.max()
assert spectrum(1 / 2.63).real.max() < -5

# %% [markdown]
# And the nonlinear plant agrees. Hold the ball at $Y$, start 0.1 mm off, and give the controller a
# $\beta_c$ that the paper rules out (3.5 times the true one) and one that the theorem rules out
# (5.5 times).

# %%
data = rig.model_dump(exclude_none=True)
data["reference"] = {
    "start_gap": Y,
    "end_gap": Y,
    "start_time": 0.0,
    "end_time": 2.5,
    "horizon": 2.5,
}
holding = make_rig(data)
figure, axes = plt.subplots(figsize=(WIDTH, 2.6), layout="constrained")
responses = {}
for ratio, colour in ((3.5, BLUE), (5.5, RED)):
    design = make_design(
        holding,
        poles,
        equilibrium="appendix-a",
        beta_c=ratio * beta,
        voltage=voltage_on_plant(holding, beta),
    )
    response = simulate(
        loop_for(holding, design, continuous=True), design, Scenario(beta, Y + 1e-4)
    )
    responses[ratio] = response
    error = 1e3 * (response.gap - response.reference)
    axes.plot(response.times, error, color=colour, label=f"$\\beta_c/\\beta = {ratio}$")
axes.set(xlabel="time $t$ [s]", ylabel="error $e$ [mm]", title="The nonlinear plant, held at $Y$")
axes.margins(x=0)
axes.legend()
plt.show()

# %%
# Check: from the first half second to the last the error falls below a hundredth at 3.5, and grows
# threefold at 5.5.
early, late = slice(0, 500), slice(-500, None)
size = {ratio: np.abs(r.gap - r.reference) for ratio, r in responses.items()}
assert size[3.5][late].max() < 1e-2 * size[3.5][early].max()
assert responses[5.5].metrics.crashed or size[5.5][late].max() > 3 * size[5.5][early].max()

# %% [markdown]
# ## 4. Three ways to know the equilibrium
#
# Which $U$, $\hat C_U$ and $\hat C_Y$ a controller uses is a choice that matters more than its
# gains:
#
# - `model`: $U$ is computed from $\beta_c$; $\hat C_U = 2g/U$ is off by $\sqrt{\beta_c/\beta}$,
#   $\hat C_Y = 2g/(Y + y_0)$ is right.
# - `appendix-a`: $U$ is measured, the coefficients are computed with $\beta_c$; both are off by
#   $\beta_c/\beta$.
# - `measured`: $U$ is measured, and the coefficients are $2g/U$ and $2g/(Y + y_0)$. No $\beta$
#   anywhere.
#
# Appendix A computes the controller anew on each plant, with that plant's own $U$ where one is
# measured: as many controllers as plants. Insert each reading in the condition and solve for the
# ratio. These are the largest stable $\beta_c/\beta$ at a gap $y$, in closed form:

# %%
largest = {reading: largest_ratio(tan_gpi(), recomputed=reading) for reading in EQUILIBRIA}
for reading, value in largest.items():
    print(f"{reading:11s}", "no ratio enters" if value is None else value)

# %% [markdown]
# The library also computes the set without the closed form: the boundary polynomials with every
# number of the rig an exact rational, their real roots isolated, one rational point tested in
# between. What comes out is the complete set, its ends exact.

# %%
exact_ends = {}
one = make_design(rig, poles)
for reading in EQUILIBRIA:
    whole = exact_loop(rig, one, recomputed=reading)
    (at_y,) = ratios_at(whole, Y).spans
    path_gaps = (rig.reference.end_gap, Y)
    (over,) = ratios_over(whole, path_gaps).spans
    exact_ends[reading] = at_y.upper, over.upper
    print(f"{reading:11s} at Y: below {at_y.upper.exact or 'no end'}")
    end = "no end" if math.isinf(over.upper.value) else f"{over.upper.value:.4f}"
    print(f"{'':11s} at every gap of the path: below {end}")

# %%
# Check: the closed form, evaluated at Y with the rig's numbers, is the exact rational end.
typed = {p.Y: sp.Rational("0.0246"), GAP: sp.Rational("0.0246"), p.g: sp.Rational("9.81")}
closed = largest["model"].subs(typed | {p.y0: 0, p.zeta: 1, p.omega_n: 70})
assert closed == sp.Rational(exact_ends["model"][0].exact) == sp.Rational(8526400, 829921)
assert exact_ends["appendix-a"][0].exact == "5"
assert math.isinf(exact_ends["measured"][0].value)

# %% [markdown]
# `appendix-a` gives exactly 5, the inverse of 1/5. `model` gives more than twice that, and
# `measured` has no end, because each plant has a controller of its own. A controller that leaves
# the house is one: its numbers stay, and the ratio moves the plant. Whatever the reading was, its
# interval is that of its numbers; with the true $U$ typed in, the three readings are one.

# %%
voltage = voltage_on_plant(rig, beta)
fixed = {
    reading: make_design(rig, poles, equilibrium=reading, voltage=voltage) for reading in EQUILIBRIA
}
for reading, design in fixed.items():
    (at_y,) = ratios_at(exact_loop(rig, design), Y).spans
    print(f"{reading:11s} U = {design.believed.U:.4f} V, stable below {at_y.upper.value:.6f}")
    assert math.isclose(at_y.upper.value, exact_ends["model"][0].value, rel_tol=1e-9)

# %% [markdown]
# Now let the ball move. Nearer to the
# magnet $\rho$ and $C_Y'$ both grow, and the condition gets easier; further away it gets harder.
# Hence the worst of the gaps travelled is the largest, $Y$ itself.

# %%
gaps = np.linspace(0.008, 0.045, 75)
figure, axes = plt.subplots(figsize=(WIDTH, 3.0), layout="constrained")
known = {p.Y: Y, p.y0: 0.0, p.g: rig.plant.gravity, p.zeta: 1.0, p.omega_n: 70.0}
for reading in ("model", "appendix-a"):
    symbols = largest[reading].free_symbols
    left = {x: value for x, value in known.items() if x in symbols}
    curve = sp.lambdify(GAP, largest[reading].subs(left))(gaps)
    axes.plot(1e3 * gaps, curve, color=COLOURS[reading], label=f"{reading}: stable below")
axes.axvspan(12, 24.6, color="#eeeeee", label="the paper's path, and $Y$")
axes.axhline(2.63, color=GREY, ls=":", label="2.63, as printed")
axes.axhline(1, color="black", lw=0.8)
axes.set(
    xlabel="gap $y$ [mm]",
    ylabel="largest $\\beta_c/\\beta$",
    yscale="log",
    title="Designed at 24.6 mm, used at $y$",
)
axes.set_yticks([1, 2, 5, 10, 20], labels=["1", "2", "5", "10", "20"])
axes.legend()
plt.show()

# %%
# Check: at 12 mm the exact ends are larger than at Y for both readings.
for reading in ("model", "appendix-a"):
    whole = exact_loop(rig, one, recomputed=reading)
    (near,) = ratios_at(whole, 0.012).spans
    print(f"{reading:11s} at 12 mm: below {near.upper.value:.3f}")
    assert near.upper.value > exact_ends[reading][0].value
    assert exact_ends[reading][1].value == exact_ends[reading][0].value

# %% [markdown]
# ## 5. What sampling takes away
#
# The controller runs once a millisecond. Then too *much* gain destabilises, too, and a small
# $\beta_c$ means a large gain $1/\hat C_U$: the interval gets a lower end. Its ends are no longer
# algebraic, because $e^{\sqrt{C_Y'} T}$ is not; the library encloses them in rational intervals by
# proof.

# %%
when = exact_timing(decimal(rig.sampling.period), decimal(rig.sampling.delay))
(span,) = sampled_ratios_at(setting(rig, one), when, Y).spans
print(f"{span.lower.value:.6f} to {span.upper.value:.6f}")

# %%
# Check: sampled, the interval is narrower at both ends than the continuous one; the end is enclosed
# to better than 1e-9 of it.
assert span.lower.value > 0
assert span.upper.value < exact_ends["model"][0].value
assert float(span.upper.high - span.upper.low) < 1e-9 * span.upper.value
assert span.contains(Fraction(1))

# %% [markdown]
# ## Exercises
#
# 1. For which damping would the printed 1/2.63 be right?
# 2. The paper says that positive gains make (23) Hurwitz. Find the smallest counterexample that
#    comes to mind, and say which of the four conditions fails.
# 3. $\beta$ is exact, but the ball is lowered further and further. At which gap is the loop with
#    the paper's gains lost? And with $\omega_n = 30$ rad/s?

# %% [markdown]
# ## Answers
#
# **1.** $4\zeta^2 + 1 = 2.63$: a lightly damped pair.

# %%
(damping,) = [x for x in sp.solve(4 * p.zeta**2 + 1 - sp.Rational("2.63"), p.zeta) if x > 0]
print(f"zeta = {float(damping):.4f}")
lightly = TriedRig(rig, PoleSpec.double(float(damping), 70.0))
for factor, sign in ((0.99, -1), (1.01, 1)):
    at = linear_loop(lightly, ratio=2.63 * factor, reading="appendix-a")
    assert np.sign(np.linalg.eigvals(at.bounded).real.max()) == sign

# %% [markdown]
# **2.** $s^4 + s^3 + s^2 + s + 1$: all coefficients are one, the roots are four of the five fifth
# roots of one, two of them on the right. The second determinant is zero already.

# %%
ones = routh_hurwitz([sp.Integer(1)] * 5)
print(ones, np.roots([1] * 5).real.max())
assert ones[0] > 0
assert ones[1] == 0
assert math.isclose(np.roots([1] * 5).real.max(), math.cos(2 * math.pi / 5))

# %% [markdown]
# **3.** With exact $\beta$, $\rho = Y/y$ and $C_Y' = \hat C_Y\,Y/y$: the condition is
# $\frac{Y}{y}\,\omega_n^2 > \frac{\omega_n^2}{4\zeta^2 + 1}$, that is $y < (4\zeta^2 + 1)\,Y$,
# whatever $\omega_n$ is.

# %%
for speed in (70.0, 30.0):
    (span,) = gaps_at(exact_loop(rig, make_design(rig, PoleSpec.double(1.0, speed)))).spans
    print(f"omega_n = {speed:g}: stable up to {span.upper.exact} m")
    assert sp.Rational(span.upper.exact) == 5 * sp.Rational("0.0246")
# At 5.05 Y the plant itself is slower than at Y, and the loop all the same too weak to hold it.
beyond = linear_loop(TriedRig(rig, poles), gap=5.05 * Y)
assert beyond.c_y < loop.c_y
assert np.linalg.eigvals(beyond.bounded).real.max() > 0
