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
# # (f) From gains to a microcontroller
#
# Four gains are not yet a program. Between them and a voltage on a pin lie a sampling period, a
# discretisation, a clamp, a delay, a sensor that is never quite still, and numbers with finitely
# many digits. This notebook takes each of them in turn, on the law of notebook (b).
#
# **What you will know at the end**
#
# - the difference equation that runs, and its source text, the same in every language;
# - what Tustin, Euler and zero-order hold change, and what they do not;
# - why the command must be clamped at zero, and what happens to an integrator that does not know of
#   the clamp;
# - how many samples of delay the loop stands;
# - what sensor noise becomes on the actuator, predicted and simulated;
# - why single precision is enough for this law, and would not be for the law as printed;
# - how the controller leaves, and how it is proved that what left is what was designed.

# %%
import math
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp
from matplotlib_inline.backend_inline import set_matplotlib_formats

from maglev_design import linear_loop as loops
from maglev_design.certification.intervals.sampled import setting
from maglev_design.certification.intervals.sampled_limits import largest_period
from maglev_design.certification.lyapunov.lmi import certify_sampled
from maglev_design.certification.margins import sampled_margins
from maglev_design.controller.design import (
    PoleSpec,
    make_design,
    plant_beta,
    reference_path,
    true_equilibrium,
)
from maglev_design.controller.family import Family, family_of
from maglev_design.derivation import NOTATION
from maglev_design.exporting import export_folder
from maglev_design.exporting.verify import verify_folder
from maglev_design.options import METHODS
from maglev_design.paper.theory_law import hold_drift
from maglev_design.paper.theory_linear import TriedRig, linear_loop
from maglev_design.programs import acceleration_program, law, step_program
from maglev_design.record import make_record
from maglev_design.reporting.plots.style import BLUE, GREEN, GREY, RED, STYLE, WIDTH
from maglev_design.rig import load_rig, make_rig
from maglev_design.simulation import Scenario, loop_for, nominal_scenario, simulate
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.sampling import difference_equation
from maglev_design.tuning import build_problem, solve

plt.rcParams.update(STYLE)
set_matplotlib_formats("svg")
LETTERS = {entry.symbol: entry.latex for entry in NOTATION}
sp.init_printing(use_latex="mathjax", symbol_names=LETTERS)
COLOURS = dict(zip(METHODS, (RED, BLUE, GREEN), strict=True))

rig = load_rig("belmonte2021")
beta, Y, T = plant_beta(rig), rig.operating_point.gap, rig.sampling.period
poles = PoleSpec.double(1.0, 70.0)
designs = {method: make_design(rig, poles, method=method) for method in METHODS}
design = designs["tustin"]

# %% [markdown]
# ## 1. The difference equation
#
# The continuous law has an integrator and a lag. Tustin's rule replaces $s$ by
# $\frac{2}{T}\frac{z - 1}{z + 1}$, which is the trapezoidal rule for both states. What is left is a
# step from one sample to the next, with a handful of coefficients:

# %%
equation = difference_equation(law(), "tustin")
sp.Matrix([[symbol, value] for symbol, value in equation.coefficients.items()])

# %%
for name, value in design.coefficients.items():
    print(f"{name:7s} {value!r}")

# %%
# Check: evaluate the symbolic coefficients with the numbers of the design; they are those that run.
k0, k1, k2, k3 = design.gains
numbers = {p.k0: k0, p.k1: k1, p.k2: k2, p.k3: k3, p.T: T}
numbers |= {p.C_U: design.believed.C_U, p.C_Y: design.believed.C_Y}
limits = dict(zip(sp.symbols("u_min u_max", real=True), rig.limits.voltage, strict=True))
for symbol, value in equation.coefficients.items():
    assert math.isclose(float(value.subs(numbers | limits)), design.coefficients[symbol.name])

# %% [markdown]
# The step is one straight-line program: elementary operations, in a fixed order. Printed as C it
# looks as follows. No library function, no branch that depends on data except choices, no division:
# the divisions were done when the coefficients were made.

# %%
program = step_program("tustin")
print("\n".join(program.source("c")))

# %%
# Check: the text divides nowhere and calls nothing.
assert not any("/" in line or "pow" in line or "sqrt" in line for line in program.source("c"))

# %% [markdown]
# The order of operations is fixed because floating-point addition depends on it: in the same order,
# every language gives the same bits. The plain-Python printing of the same program therefore
# repeats the library's simulation exactly, not approximately:

# %%
response = simulate(loop_for(rig, design), design, nominal_scenario(rig, beta))
step = program.scalar()
fixed = dict(design.coefficients, Y=Y, U=design.believed.U)
fixed |= {"u_min": rig.limits.voltage[0], "u_max": rig.limits.voltage[1]}


def run_step(known, x1, x2, **signals):
    """Return (x1, x2, commanded, applied) after one sample."""
    values = dict(known, x1=x1, x2=x2, **signals)
    return step(*[values[name] for name in program.inputs])


path, _, acceleration_path = reference_path(rig, response.times)
x1 = x2 = 0.0
commanded = []
for k in range(len(response.commanded)):
    x1, x2, command, _ = run_step(
        fixed, x1, x2, y=response.gap[k], y_ref=path[k], acc_ref=acceleration_path[k]
    )
    commanded.append(command)

# %%
# Check: seven thousand samples, and no difference larger than a rounding of the reference path.
difference = np.abs(np.array(commanded) - response.commanded)
equal = np.count_nonzero(difference == 0)
print(f"{equal} of {len(difference)} equal, largest difference {difference.max():.1e} V")
assert difference.max() < 1e-12

# %% [markdown]
# ## 2. Three ways to discretise
#
# Forward Euler takes $s = (z - 1)/T$; `zoh` is exact for an error that is held over the period. The
# multiplier of the lag tells them apart: $\frac{2 - k_3T}{2 + k_3T}$, $1 - k_3T$, $e^{-k_3T}$.
# Which one is nearest to the continuous law? Not the one that is called exact:

# %%
omega = np.geomspace(10, math.pi / T, 300)
z, s = np.exp(1j * omega * T), 1j * omega
b_u = design.believed
continuous = ((k2 + b_u.C_Y) * s**2 + (k1 + k3 * b_u.C_Y) * s + k0) / (s * (s + k3)) / b_u.C_U


def pulse(made):
    """Return the frequency response of a difference equation, error to voltage [V/m]."""
    c = made.coefficients
    return c["c1"] * c["b1"] / (z - 1) + c["c2"] * c["b2"] / (z - c["a22"]) + c["d"]


figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 2.8), layout="constrained")
left.loglog(omega, np.abs(continuous), color="black", lw=0.9, ls=":", label="continuous")
right.semilogx(omega, np.rad2deg(np.angle(continuous)), color="black", lw=0.9, ls=":")
for (method, made), dash in zip(designs.items(), ("-", "--", "-."), strict=True):
    left.loglog(omega, np.abs(pulse(made)), color=COLOURS[method], ls=dash, label=method)
    right.semilogx(omega, np.rad2deg(np.angle(pulse(made))), color=COLOURS[method], ls=dash)
left.set(xlabel="angular frequency [rad/s]", ylabel="gain [V/m]", title="gain")
right.set(xlabel="angular frequency [rad/s]", ylabel="phase [deg]", title="phase")
left.legend()
plt.show()

# %%
# Check: at omega_n Tustin is off by less than 0.1 %, Euler by a few, zoh by ten: the real error is
# not held, and the lag that takes it for held sees it half a sample late.
at = int(np.argmin(np.abs(omega - 70)))
errors = {m: abs(pulse(made)[at] / continuous[at] - 1) for m, made in designs.items()}
for method, value in errors.items():
    print(f"{method:7s} off by {100 * value:.3f} % at {omega[at]:.0f} rad/s")
assert errors["tustin"] < 1e-3 < errors["euler"] < errors["zoh"] < 0.15
late = designs["zoh"].coefficients["c2"] / k3 * 70 * T / 2
assert math.isclose(errors["zoh"] * abs(continuous[at]), abs(late), rel_tol=0.2)

# %% [markdown]
# ## 3. Clamp and anti-windup
#
# The plant sees $u^2$. A negative voltage pulls the ball *up* like a positive one, so below zero
# the sign of the loop is wrong. Write the loop by hand, with the step above and a Runge-Kutta step
# for (4), and let the ball start far from where it should be:

# %%
acceleration = acceleration_program().scalar()


def hold(start, limits, *, guarded=True, number=float, steps=350, ratio=1.0):
    """Hold the ball at Y; return the gaps [m] and the commands [V] until it is lost or time is up.

    Without `guarded` the law knows nothing of the clamp behind it.
    """
    low, high = limits
    known = dict(fixed, u_min=low, u_max=high, y_ref=Y, acc_ref=0.0)
    if not guarded:
        known |= {"u_min": -math.inf, "u_max": math.inf, "x1_max": math.inf}
    known = {name: number(value) for name, value in known.items()}
    evaluate = program.numpy()
    x1, x2, gap, speed = number(0), number(0), Y + start, 0.0
    gaps, commands, h = [gap], [], T / 4
    for _ in range(steps):
        values = dict(known, x1=x1, x2=x2, y=number(gap))
        x1, x2, command, _ = evaluate(*[values[name] for name in program.inputs])
        commands.append(float(command))
        u = min(max(float(command), low), high)

        def rate(state, u=u):
            pull = acceleration(rig.plant.gravity, beta / ratio, 0.0, state[0], u)[0]
            return np.array([state[1], pull])

        for _ in range(4):
            state = np.array([gap, speed])
            r1 = rate(state)
            r2 = rate(state + h / 2 * r1)
            r3 = rate(state + h / 2 * r2)
            r4 = rate(state + h * r3)
            gap, speed = state + h / 6 * (r1 + 2 * r2 + 2 * r3 + r4)
        gaps.append(float(gap))
        if not rig.limits.gap[0] < gap < rig.limits.gap[1]:
            break
    return np.array(gaps), np.array(commands)


trials = {
    "clamp 0 to 5 V": (-8e-3, (0.0, 5.0), True),
    "clamp -5 to 5 V": (-8e-3, (-5.0, 5.0), True),
    "with anti-windup": (14e-3, (0.0, 5.0), True),
    "without": (14e-3, (0.0, 5.0), False),
}
results = {name: hold(a, b, guarded=c) for name, (a, b, c) in trials.items()}
figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 2.8), layout="constrained")
for axes, names in ((left, list(trials)[:2]), (right, list(trials)[2:])):
    for name, colour, dash in zip(names, (BLUE, RED), ("-", "--"), strict=True):
        gaps, _ = results[name]
        axes.plot(T * np.arange(len(gaps)), 1e3 * gaps, color=colour, ls=dash, label=name)
    axes.axhline(1e3 * Y, color=GREY, lw=0.8, ls=":")
    axes.set(xlabel="time $t$ [s]", ylim=(0, 52))
    axes.legend(loc="lower right")
left.set(ylabel="gap $y$ [mm]", title="8 mm too near")
right.set_title("14 mm too far")
plt.show()

# %%
# Check: with the clamp at zero and the guarded integrator the ball comes back from both sides; with
# a negative voltage, or with an integrator that winds up, it is lost.
for name in ("clamp 0 to 5 V", "with anti-windup"):
    assert abs(results[name][0][-1] - Y) < 1e-5
for name in ("clamp -5 to 5 V", "without"):
    gaps, _ = results[name]
    assert not rig.limits.gap[0] < gaps[-1] < rig.limits.gap[1]

# %% [markdown]
# Look for the two guards in the C text. The two choices around `x1_max` bound the integrator, so
# that its own share of the voltage never exceeds the actuator's range. The choice that gives back
# `x1` itself freezes it while the command is outside the range *and* the step would push it further
# out; a step that leads back is always taken, or a frozen integrator would be no better than a
# wound-up one.

# %% [markdown]
# ## 4. Delay
#
# Reading the sensor, computing and writing take time. Add whole samples of delay to the loop, at
# every gap of the path and every ratio within 15 %:

# %%
family = family_of(rig)
believed = designs["tustin"].believed
samples = range(6)
radius = {
    method: [
        loops.spectral_radius(
            loops.build_loop(rig, believed, method=method, extra_samples=n),
            poles.values,
            family,
        ).value
        for n in samples
    ]
    for method in METHODS
}
figure, axes = plt.subplots(figsize=(WIDTH, 2.6), layout="constrained")
for method, marker in zip(METHODS, "os^", strict=True):
    axes.plot(samples, radius[method], marker + "-", color=COLOURS[method], ms=4, label=method)
axes.axhline(1, color="black", lw=0.8, ls=":")
axes.set(
    xlabel="delay [samples of 1 ms]", ylabel="spectral radius", title="Worst over gaps and ratios"
)
axes.legend()
plt.show()
ready = loops.build_loop(rig, believed, method="tustin")
margins = sampled_margins(ready, poles.values, family)
print(f"tustin: margin of {1e3 * margins.delay_s.value:.2f} ms at {1e3 * margins.delay_s.gap:g} mm")

# %%
# Check: the delay margin of the frequency response lies between the last stable and the first
# unstable number of samples.
stable = [n for n in samples if radius["tustin"][n] < 1]
assert max(stable) * T < margins.delay_s.value < (max(stable) + 1) * T

# %% [markdown]
# ## 5. Noise
#
# The law differentiates, so sensor noise comes out amplified. For white noise the standard
# deviation of the voltage is a number of the linear loop, per metre of sensor noise:

# %%
at_y = Family((Y, Y), (1.0, 1.0))
predicted = {
    method: loops.noise_voltage(
        loops.build_loop(rig, believed, method=method), poles.values, at_y, 1e-6
    ).value
    for method in METHODS
}
data = rig.model_dump(exclude_none=True)
data["reference"] = {
    "start_gap": Y,
    "end_gap": Y,
    "start_time": 0.0,
    "end_time": 4.0,
    "horizon": 4.0,
}
holding = make_rig(data)
seen = {}
for method in METHODS:
    made = make_design(holding, poles, method=method)
    noisy = Scenario(beta, Y, noise=True, seed=3, input_noise=0.0, position_noise=1e-6)
    quiet = simulate(loop_for(holding, made), made, noisy)
    seen[method] = float(np.std(quiet.commanded[500:]))
    print(f"{method:7s} 1 µm makes {1e3 * predicted[method]:.3f} mV", end=", ")
    print(f"simulated {1e3 * seen[method]:.3f} mV")

# %%
# Check: prediction and nonlinear simulation agree to five per cent; Tustin is the quietest.
for method in METHODS:
    assert math.isclose(predicted[method], seen[method], rel_tol=0.05)
assert min(predicted, key=predicted.get) == "tustin"

# %% [markdown]
# ## 6. Single precision
#
# Many microcontrollers compute fast in 32 bits only. The gap then has a last digit:

# %%
digit = float(np.spacing(np.float32(Y)))
print(f"the gap's last digit in single precision: {1e9 * digit:.2f} nm")
double, u_double = hold(4e-4, rig.limits.voltage, steps=600, ratio=0.85)
single, u_single = hold(4e-4, rig.limits.voltage, steps=600, ratio=0.85, number=np.float32)
print(f"largest difference of the gaps {1e9 * np.abs(single - double).max():.2f} nm")
print(f"largest difference of the commands {1e6 * np.abs(u_single - u_double).max():.2f} µV")

# %%
# Check: single precision moves the ball by no more than a few last digits, and the voltage by about
# what a last digit of the gap makes of it.
assert np.abs(single - double).max() < 5 * digit
assert np.abs(u_single - u_double).max() < 5 * digit * design.coefficients["d"]

# %% [markdown]
# That is the bounded form. The law (20) as printed integrates the incremental voltage for ever, and
# whoever programs it in single precision meets its hidden integrators (notebook (b)) within the
# hour. The estimate multiplies them by $k_3$, so their last digit becomes a step of the voltage:

# %%
drift = hold_drift(linear_loop(TriedRig(rig, poles)), rig.reference.end_gap - Y)
for minutes in (1, 10, 60, 24 * 60):
    held = np.float32(abs(drift[1]) * 60 * minutes)
    jump = k3 * float(np.spacing(held))
    print(
        f"after {minutes:5d} min: holds {held:9.1f} V s, voltage in steps of {1e3 * jump:8.3f} mV"
    )

# %%
# Check: after a day the steps are larger than the voltage that holds the ball there.
need = true_equilibrium(rig, beta, rig.reference.end_gap).U
print(f"holding the ball there takes {need:.3f} V")
assert jump > need

# %% [markdown]
# ## 7. Out of the house
#
# Everything above, clamp, guards, reset and the reference's generator included, leaves as a folder
# that stands alone. `maglev-design export` writes it in C99, Python or MATLAB from a saved design;
# here is the same from a program, for the tuned poles of notebook (d), as Python:

# %%
problem = build_problem(rig)
result = solve(problem)
record = make_record(
    result,
    sampled_margins(problem.loop, result.poles.values, problem.family),
    certify_sampled(result.design, rig),
)
with tempfile.TemporaryDirectory() as place:
    folder = Path(place) / "controller"
    exported = export_folder(record, "python", folder)
    verdict = verify_folder(folder)
    text = (folder / "maglev.py").read_text("utf-8")
print(*exported.sha256, sep=", ")
for check in verdict.checks:
    print(f"{'passed' if check.passed else 'FAILED'}  {check.name:44s} {check.note}")

# %%
# Check: all is kept that the design promised, the recorded samples to the last bit, and the
# controller needs nothing but Python.
assert not exported.doubts
assert all(check.passed for check in verdict.checks)
bits = next(check for check in verdict.checks if check.name == "vectors, Python")
assert bits.value == 0
lines = [line.split() for line in text.splitlines() if line.startswith(("import ", "from "))]
assert {words[1].partition(".")[0] for words in lines} <= sys.stdlib_module_names

# %% [markdown]
# On a machine with a C compiler, `maglev-design export design/design.json --target c` and
# `maglev-design verify` do the same with the compiled text, run it on an emulated Cortex-M4 and
# count its instructions.

# %% [markdown]
# ## Exercises
#
# 1. How long may the sampling period be before the loop is lost, with Tustin and with Euler, at
#    exact $\beta$ over the path's gaps? Where does Euler's number come from?
# 2. The sensor covers 50 mm. How many bits must its converter have so that quantisation, taken as
#    white noise, moves the voltage by no more than 10 mV? Simulate it along the path.
# 3. Start the filter state $x_2$ such that the first command has no kick from the initial error of
#    0.4 mm. How large is the kick without?

# %% [markdown]
# ## Answers
#
# **1.** Euler's limit is the controller's own: its lag has the multiplier $1 - k_3T$, which leaves
# the unit circle at $T = 2/k_3$. Tustin's multiplier stays inside for every $T$; there it is the
# loop that gives up, a little later.

# %%
longest = {}
for method in ("tustin", "euler"):
    own = setting(rig, designs[method])
    longest[method] = largest_period(own, T, 0.0, (rig.reference.end_gap, Y))
    print(f"{method:7s} {1e3 * longest[method].stable:.4f} ms")
assert longest["tustin"].stable > longest["euler"].stable > 7 * T
assert math.isclose(longest["euler"].stable, 2 / k3, rel_tol=1e-3)

# %% [markdown]
# **2.** A step $q$ has the standard deviation $q/\sqrt{12}$. Solve for $q$ with the worst noise
# gain of the family, and round the number of bits up. Simulated with the quantised sensor, the
# command differs from the unquantised run by less than that.

# %%
per_metre = loops.noise_voltage(ready, poles.values, family, 1.0).value
bits = math.ceil(math.log2(0.05 / (0.010 * math.sqrt(12) / per_metre)))
step_size = 0.05 / 2**bits
data = rig.model_dump(exclude_none=True)
data["emulator"] = {"sensor_step": step_size}
coarse = make_rig(data)
fine_run = simulate(loop_for(rig, design), design, nominal_scenario(rig, beta))
coarse_run = simulate(loop_for(coarse, design, emulate=True), design, nominal_scenario(rig, beta))
moved = coarse_run.commanded - fine_run.commanded
print(f"{bits} bits, steps of {1e6 * step_size:.1f} µm: {1e3 * np.std(moved[1000:6000]):.2f} mV")
assert bits == 13
assert np.std(moved[1000:6000]) < 0.010
assert not coarse_run.metrics.crashed

# %% [markdown]
# **3.** The command holds $c_2 x_2 + d\,e$ (and $x_1 = 0$). With $x_2 = -d\,e/c_2$ the first
# command is the feedforward. Without, the kick is $d \cdot 0.4$ mm.

# %%
offset = 4e-4
kick = design.coefficients["d"] * offset
start = -design.coefficients["d"] * offset / design.coefficients["c2"]
gap = rig.reference.start_gap
calm = run_step(fixed, 0.0, start, y=gap + offset, y_ref=gap, acc_ref=0.0)
hard = run_step(fixed, 0.0, 0.0, y=gap + offset, y_ref=gap, acc_ref=0.0)
print(f"kick {kick:.3f} V on top of {calm[2]:.3f} V")
assert math.isclose(hard[2] - calm[2], kick)
assert math.isclose(calm[2], true_equilibrium(rig, beta, gap).U)
