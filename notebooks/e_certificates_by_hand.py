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
# # (e) Certificates one can check by hand
#
# A thousand simulations that went well are a thousand simulations. A certificate is a small object,
# found by a computer, that anybody can check without trusting the computer that found it. Here it
# is a matrix of fractions, and the check is elimination as taught in the first year.
#
# **What you will know at the end**
#
# - why "stable at every gap" does not say "stable while the gap changes", and what does;
# - how one quadratic function proves it for infinitely many plants, and why four matrices suffice;
# - how a solver's floating-point answer becomes a proof in fractions;
# - how to read, check and break a certificate;
# - how far from the path the *nonlinear* loop with its clamp may start, with proof.

# %%
import inspect
import tempfile
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp
from matplotlib_inline.backend_inline import set_matplotlib_formats
from scipy.linalg import expm

from maglev_design.certification.lyapunov import certificate, exact
from maglev_design.certification.lyapunov.lmi import LmiStatus, certify_family
from maglev_design.certification.region.guaranteed import guaranteed_region
from maglev_design.certification.region.simulated import (
    contradictions,
    region_curves,
    region_extent,
    simulated_map,
)
from maglev_design.controller.design import PoleSpec, make_design, plant_beta, true_equilibrium
from maglev_design.reporting.plots.region import region_figure
from maglev_design.reporting.plots.style import BLUE, GREY, RED, STYLE, WIDTH
from maglev_design.rig import load_rig

plt.rcParams.update(STYLE)
set_matplotlib_formats("svg")

rig = load_rig("belmonte2021")
beta = plant_beta(rig)
design = make_design(rig, PoleSpec.double(1.0, 70.0))


def floats(matrix):
    """Return a matrix of fractions as an array."""
    return np.array([[float(x) for x in row] for row in matrix])


# %% [markdown]
# ## 1. Stable at each instant is not stable
#
# While the ball travels, its linearisation changes. Take two stable matrices, switch between them
# at the right moments, and the motion explodes:

# %%
first = np.array([[-1.0, 10.0], [-100.0, -1.0]])
second = np.array([[-1.0, 100.0], [-10.0, -1.0]])
quarter = np.pi / 2 / np.sqrt(1000)
turn = expm(second * quarter) @ expm(first * quarter)
print("eigenvalues of the two:", np.linalg.eigvals(first), np.linalg.eigvals(second))
print("growth in one round:   ", np.abs(np.linalg.eigvals(turn)).max())

# %%
# Check: both are stable, with the same eigenvalues; one round multiplies by more than 8.
assert np.linalg.eigvals(first).real.max() < 0
assert np.allclose(sorted(np.linalg.eigvals(first).imag), sorted(np.linalg.eigvals(second).imag))
assert np.abs(np.linalg.eigvals(turn)).max() > 8

# %% [markdown]
# What excludes this is a *common* Lyapunov function: one $P > 0$ for which $V = x'Px$ falls under
# every one of the matrices. Then $V$ falls whichever acts, and in whatever order.

# %% [markdown]
# ## 2. The family, and its four corners
#
# The loop in the states $(e, \dot e, x_1, x_2)$ depends on the gap and the ratio through $\rho$ and
# $C_Y'$ alone. Both are proportional to $1/(y + y_0)$, so for one ratio all gaps lie on a ray
# through the origin. The family is a piece of a fan, not a rectangle:

# %%
gaps = np.linspace(rig.reference.end_gap, rig.operating_point.gap, 30)
ratios = np.linspace(0.85, 1.15, 7)


def point(gap, ratio):
    """Return (rho, C_Y') at a gap [m] and a ratio, reading `model`."""
    true = true_equilibrium(rig, beta / ratio, gap)
    return true.C_U / design.believed.C_U, true.C_Y


figure, axes = plt.subplots(figsize=(WIDTH, 3.0), layout="constrained")
for ratio in ratios:
    ray = np.array([point(gap, ratio) for gap in gaps])
    axes.plot(ray[:, 0], ray[:, 1], color=GREY, lw=0.9)
corners = np.array([point(gap, ratio) for gap in (gaps[0], gaps[-1]) for ratio in (0.85, 1.15)])
axes.plot(corners[:, 0], corners[:, 1], "o", color=RED, label="the four vertices")
low, high = corners.min(axis=0), corners.max(axis=0)
box = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
axes.plot(*np.vstack([box, box[:1]]).T, color=BLUE, ls="--", label="a box with independent ranges")
axes.set(
    xlabel="loop gain $\\rho$ [-]", ylabel="stiffness $C_Y'$ [1/s²]", title="Gaps times ratios"
)
figure.legend(loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# The state matrix is affine along each ray and across the rays, so every member is a weighted
# average of four matrices, with positive weights. The decrease of $V$ is affine in the matrix: if
# $A_v'P + PA_v < 0$ at the four corners, then on the whole family. Infinitely many inequalities
# have become four.

# %%
continuous, sampled = certify_family(design, rig)
for found in (continuous, sampled):
    print(f"{found.claim.loop}: {found.status.value}")
    print(
        f"  {len(found.polytope.vertices)} vertices, states scaled by {list(map(str, found.scale))}"
    )
    print(f"  sqrt(V) falls at least as exp(-{float(found.decay):.2f} t)")
    print(
        f"  largest error of beta with such a proof: {100 * float(found.largest_beta_error):.1f} %"
    )

# %%
# Check: the corner with the ratio 0.85 at 12 mm, computed from the plant, is among the vertices.
vertices = [floats(vertex) for vertex in continuous.polytope.vertices]
scale = np.array([float(x) for x in continuous.scale])
rho, stiffness = point(0.012, 0.85)
k0, k1, k2, k3 = design.gains
c_y = design.believed.C_Y
own = np.array(
    [
        [0, 1, 0, 0],
        [stiffness - rho * (k2 + c_y), 0, -rho * k0 / k3, -rho * (k1 - k2 * k3 - k0 / k3)],
        [1, 0, 0, 0],
        [1, 0, 0, -k3],
    ]
)
scaled = np.diag(scale) @ own @ np.diag(1 / scale)
assert min(np.abs(scaled - vertex).max() for vertex in vertices) < 1e-9 * np.abs(scaled).max()

# %% [markdown]
# The sampled loop is harder, since its matrix is no longer affine in the gap: $\cosh\sqrt{C_Y'}T$
# is not. The library encloses it by a thin polytope of rational vertices and bounds what the
# polytope misses; that bound is part of the inequality that is checked.

# %% [markdown]
# ## 3. From floating point to a proof
#
# The solver returns $P$ to some digits. Digits prove nothing, but there is room: if the inequality
# holds with a margin, it also holds for a *rounded* $P$. So round it to fractions, and check the
# fractions. How coarsely may one round? Try grids until the exact check succeeds:

# %%
plain = certify_family(design, rig, bisect=False, loops=("continuous",))[0]


def rounded(grid):
    """Return the solver's P in multiples of 1/grid."""
    return tuple(tuple(Fraction(round(x * grid), grid) for x in row) for row in plain.P)


grids = (5, 10, 20, 30, 50, 100, 150, 200, 300, 500, 1000, 2000, 5000, 10000)
coarsest = next(grid for grid in grids if replace(plain, P=rounded(grid)).verified())
by_hand = rounded(coarsest)
print(f"multiples of 1/{coarsest} suffice; {coarsest} P =")
sp.Matrix(4, 4, lambda i, j: sp.Integer(int(by_hand[i][j] * coarsest)))

# %% [markdown]
# This matrix of small integers proves that the continuous loop is stable at every gap from 12 mm to
# 24.6 mm, for every $\beta_c/\beta$ from 0.85 to 1.15, and while both change in time. The whole
# check is this function of ten lines, and one line for the decrease:

# %%
print(inspect.getsource(exact.is_positive_definite))
print(inspect.getsource(exact.continuous_slack))

# %%
# Check: do it yourself. P is positive definite, and so is minus the derivative at each corner.
assert exact.is_positive_definite(by_hand)
for vertex in plain.polytope.vertices:
    slack = exact.continuous_slack(vertex, by_hand, Fraction(0), plain.polytope.remainder)
    assert exact.is_positive_definite(slack)
# And once more by another route: SymPy's determinants of the leading minors.
leading = [sp.Matrix(n, n, lambda i, j: sp.Rational(str(by_hand[i][j]))).det() for n in range(1, 5)]
assert all(minor > 0 for minor in leading)
print([str(minor) for minor in leading])

# %% [markdown]
# A check that cannot fail is worth nothing. Change one entry of $P$ and ask again:

# %%
broken = [list(row) for row in by_hand]
broken[3][3] = broken[3][3] / 10
damaged = tuple(tuple(row) for row in broken)
fails = exact.failing(
    plain.polytope.vertices,
    damaged,
    decay=Fraction(0),
    remainder=plain.polytope.remainder,
    period=None,
)
print(f"V does not fall at the vertices {fails}")
assert fails
assert not replace(plain, P=damaged).verified()

# %% [markdown]
# ## 4. What it says, seen
#
# Let the sampled loop run with another gap and another ratio drawn anew *every millisecond*: any
# averages of the vertices. No rig does that; the certificate covers it all the same. $\sqrt V$
# stays below the proved exponential, for each start.

# %%
generator = np.random.default_rng(7)
P = floats(sampled.P)
members = np.array([floats(vertex) for vertex in sampled.polytope.vertices])
steps, period = 150, float(sampled.period)
time = period * np.arange(steps + 1)
figure, axes = plt.subplots(figsize=(WIDTH, 2.8), layout="constrained")
worst = np.zeros(steps + 1)
for _ in range(30):
    x = generator.normal(size=len(P))
    x /= np.sqrt(x @ P @ x)
    sizes = [1.0]
    for _ in range(steps):
        weights = generator.dirichlet(np.full(len(members), 0.3))
        x = np.tensordot(weights, members, 1) @ x
        sizes.append(np.sqrt(x @ P @ x))
    worst = np.maximum(worst, sizes)
    axes.semilogy(1e3 * time, sizes, color=GREY, lw=0.6)
bound = np.exp(-float(sampled.decay) * time)
axes.semilogy(1e3 * time, bound, color=RED, label="proved")
axes.plot([], [], color=GREY, lw=0.6, label="30 starts, everything changing")
axes.set(xlabel="time $t$ [ms]", ylabel="$\\sqrt{V}$ over its start", title="Sampled loop")
axes.margins(x=0)
axes.legend()
plt.show()

# %%
# Check: not one of the runs rises above the bound, at any sample.
assert np.all(worst <= bound * (1 + 1e-9))

# %% [markdown]
# ### A file for somebody else
#
# The certificate is written with the numbers of rig and controller, the vertices and $P$, all as
# fractions. The checker derives the vertices *anew* from rig and controller, so that a forged
# vertex is found, too. On the command line: `maglev-design certify --check certificate.json`.

# %%
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "certificate.json"
    certificate.write(path, (continuous, sampled))
    report = certificate.check(path)
    text = path.read_text()
    path.write_text(text.replace('"981/100"', '"982/100"'))
    forged = certificate.check(path)
for line in report.checks[:5]:
    print(f"{'holds' if line.passed else 'FAILS':6s} {line.name}: {line.detail}")

# %%
# Check: the file passes as written; with gravity changed in the second decimal it does not.
assert report.passed
assert '"981/100"' in text
assert not forged.passed
# Not the checksum alone finds it out: the vertices that gravity makes are other ones.
found_out = [line.name for line in forged.checks if not line.passed]
assert any("vertices" in name for name in found_out)

# %% [markdown]
# ## 5. The nonlinear loop with its clamp
#
# So far the plant was linear at each gap. The real one is not, and its voltage ends at 0 V and 5 V.
# For the nonlinear, saturated, continuous loop that regulates at one gap the library looks for a
# set $\{V \le \text{level}\}$ on which $V$ falls along *every* motion, clamp and anti-windup
# included, and proves it by cutting the set into cells, in exact arithmetic. What is proved lies
# inside the red line; what simulation survives is blue.

# %%
region = guaranteed_region(rig, design)
whole = simulated_map(rig, design)
near = simulated_map(rig, design, region_extent(region))
figure = region_figure(region_curves(region, whole, near), "Initial errors at 24.2 mm")
plt.close("all")
figure

# %%
# Check: with exact beta every error up to 1.6 mm from rest is proved, four times the paper's own;
# no point of either map contradicts the proof; and it proves less than simulation survives.
print(region.status.value)
print(f"from rest {1e3 * region.reach[0]:.3f} mm to {1e3 * region.reach[1]:.3f} mm")
assert region.contains(4e-4, 0.0)
assert min(-region.reach[0], region.reach[1]) > 1.6e-3
assert contradictions(region, whole) == contradictions(region, near) == ()
assert region.area < whole.area

# %% [markdown]
# ## Exercises
#
# 1. Is $P$ unique? Show that $3P$ is a certificate as well, and that $-P$ is not. Which of the two
#    conditions refuses $-P$?
# 2. Ask for a certificate over all gaps from 4 mm to 50 mm. Every corner is stable: what does the
#    answer mean, and what does it not mean?
# 3. How fast can any common $V$ fall at best? Compare the proved decay with the slowest eigenvalue
#    of the four corners.

# %% [markdown]
# ## Answers
#
# **1.** Both inequalities are homogeneous in $P$. A factor of $-1$ turns them round: $V = -x'Px$
# would have to be positive, and is not.

# %%
triple = tuple(tuple(3 * x for x in row) for row in by_hand)
negative = tuple(tuple(-x for x in row) for row in by_hand)
assert replace(plain, P=triple).verified()
assert not exact.is_positive_definite(negative)
assert not replace(plain, P=negative).verified()

# %% [markdown]
# **2.** It means that no quadratic function was found that serves the whole range; at each fixed
# gap the loop may be stable all the same, as it is at the corners. A certificate proves when it is
# there; its absence disproves nothing.

# %%
wide = certify_family(design, rig, gap_range=(0.004, 0.05), bisect=False, loops=("continuous",))[0]
print(wide.status.value)
assert wide.status is LmiStatus.INFEASIBLE
assert all(np.linalg.eigvals(floats(v)).real.max() < 0 for v in wide.polytope.vertices)

# %% [markdown]
# **3.** No common $V$ can fall faster than the slowest motion of any member. The proved decay comes
# close to that, which says that little was lost by asking for one $P$.

# %%
slowest = min(-np.linalg.eigvals(vertex).real.max() for vertex in vertices)
proved = float(continuous.decay)
print(f"proved {proved:.2f} 1/s of {slowest:.2f} 1/s, {100 * proved / slowest:.0f} %")
assert 0.5 * slowest < proved <= slowest
