"""Plants other than the paper's: stated, linearised, controlled, simulated."""

from __future__ import annotations

import itertools
import math
from typing import Any, get_args

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray
from rigs import SHORT, changed, rig_with
from scipy.linalg import expm

from maglev_design import linear_loop as loops
from maglev_design import programs
from maglev_design.controller import matching
from maglev_design.controller.design import (
    Design,
    PoleSpec,
    coefficient_inputs,
    make_design,
    plant_beta,
    tangent_matrices,
    true_equilibrium,
)
from maglev_design.controller.family import family_of
from maglev_design.controller.plant import (
    on_plant,
)
from maglev_design.errors import InputError
from maglev_design.linear_loop.general import PlacedLaw, any_order
from maglev_design.options import (
    METHODS,
    PAPER_PLANT,
    TAN_GPI,
    Actuation,
    Controller,
    DesignModel,
    ForceLaw,
    PlantKind,
)
from maglev_design.rig import Rig
from maglev_design.simulation import (
    Scenario,
    build,
    nominal_scenario,
    pole_sensitivities,
    resimulate,
    resimulate_continuous,
    simulate,
    simulate_batch,
)
from maglev_design.symbolic import gpi
from maglev_design.symbolic import plant as p
from maglev_design.symbolic.flatness import path_input
from maglev_design.symbolic.linearisation import Tangent, design_tangent, linearise, tangent_at_rest
from maglev_design.tuning import build_problem, solve
from maglev_design.tuning.result import TuneResult

Array = NDArray[np.float64]

ROUNDING = 1e-12
BACK_ENDS = 1e-9
"""Relative difference of two back ends: rounding, and exponentials of two libraries."""
INTEGRATORS = 1e-5
"""Relative difference of RK4 at the default step and an adaptive integrator."""

KINDS = [
    PlantKind(force, power, actuation, bool(damped), bool(offset))
    for force, power, actuation, damped, offset in itertools.product(
        get_args(ForceLaw), (2, 1), get_args(Actuation), (0, 1), (0, 1)
    )
    if power == 2 or force == "power"
]
COIL = {"kind": "voltage", "resistance": 1 / 1.05, "inductance": 0.0048}
PLANTS: dict[str, dict[str, Any]] = {
    "lag": {"drive.lag": 0.003},
    "coil": {"drive": COIL, "plant.current_gain": None},
    "constant": {"drive": COIL | {"inductance_law": "constant"}, "plant.current_gain": None},
    "offset": {"drive": {"lag": 0.003, "input_offset": 0.3}},
    "damped": {"plant.damping": 0.5},
    "dipole": {
        "plant.force_law": "power",
        "plant.current_exponent": 1,
        "plant.gap_exponent": 4.0,
        "plant.force_constant": 3.285e-8,
    },
    "measured": {
        "plant.force_law": "power",
        "plant.gap_exponent": 2.31,
        "plant.gap_offset": 0.002,
        "plant.force_constant": 8.8e-6,
        "drive": COIL,
        "plant.current_gain": None,
    },
    "exponential": {
        "plant.force_law": "exponential",
        "plant.decay_length": 0.0123,
        "plant.force_constant": 0.295,
        "drive": COIL | {"inductance": 0.012},
        "plant.current_gain": None,
    },
}
"""Changes of the quick rig: one that has each piece."""


def plant_named(name: str) -> Rig:
    """Return the quick rig with another plant."""
    data = changed(SHORT, {k: v for k, v in PLANTS[name].items() if v is not None})
    for field, value in PLANTS[name].items():
        if value is None:
            section, key = field.split(".")
            del data[section][key]
    return rig_with(data)


def placed(rig: Rig, zeta: float = 1.2, omega_n: float = 80.0, **how: Any) -> Design:
    return make_design(rig, PoleSpec.double(zeta, omega_n), **how)


# --- the statement -------------------------------------------------------------------------


@pytest.mark.parametrize("name", get_args(ForceLaw))
def test_the_potential_of_a_force_law_is_its_integral(name: ForceLaw) -> None:
    force = p.FORCES[name]
    assert sp.simplify(sp.diff(force.potential, p.y) + force.fall) == 0


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_at_rest_nothing_moves(kind: PlantKind) -> None:
    plant = p.magnetic_levitation(kind)
    held = plant.equilibrium_voltage.subs(p.Y, p.y)
    net = held - p.u0 if kind.offset else held
    rest = {p.v: 0, p.u_coil: net}
    acting = net if kind.order > 2 else held
    assert sp.simplify(plant.acceleration.subs(p.u, acting).subs(rest)) == 0
    assert sp.simplify(plant.static.subs(p.u, held).subs(rest)) == 0
    assert sp.simplify(plant.drive_rate.subs(p.u, held).subs(rest)) == 0


@pytest.mark.parametrize("force", get_args(ForceLaw))
def test_the_coil_keeps_its_energy(force: ForceLaw) -> None:
    """Power in, less the losses, is the rate of the stored energy and the work on the ball."""
    plant = p.magnetic_levitation(PlantKind(force, 2, "coil"))
    profile, constant = p.FORCES[force], p.beta * p.m * p.R**2
    inductance = p.L + 2 * constant * (profile.potential - profile.potential.subs(p.y, p.Y))
    current = p.u_coil / p.R
    stored = inductance * current**2 / 2
    rate = sp.diff(stored, p.y) * p.v + sp.diff(stored, p.u_coil) * plant.drive_rate
    work = -constant * current**2 * profile.fall * p.v  # the magnet pulls towards smaller gaps
    power = (p.u - p.R * current) * current
    assert sp.simplify(power - rate - work) == 0
    assert sp.simplify(plant.inductance - inductance) == 0


def test_the_denominator_of_a_coil_is_the_published_one() -> None:
    """(1 + tau s)(s^2 - C_Y) + kappa s with kappa = 4 K g/(R Z^2), K = beta m R^2."""
    local = tangent_at_rest(p.magnetic_levitation(PlantKind(actuation="coil")))
    z = p.Y + p.y0
    tau, kappa = p.L / p.R, 4 * p.beta * p.m * p.R * p.g / z**2
    known = (1 + tau * p.s) * (p.s**2 - 2 * p.g / z) + kappa * p.s
    own = local.denominator.as_expr().subs(p.y, p.Y)
    assert sp.simplify(tau * own - known) == 0
    gain = (2 * p.g / p.magnetic_levitation().equilibrium_voltage) / tau
    assert sp.simplify(local.flat_gain.subs(p.y, p.Y) + gain) == 0


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_what_a_controller_believes_is_the_plant_at_its_gap(kind: PlantKind) -> None:
    plant = p.magnetic_levitation(kind)
    believed = programs.believed_program("model", kind)
    tangent = programs.tangent_program(kind)
    random = np.random.default_rng(3)
    known = dict(zip(("g", "beta_c", "Y", "y0"), (9.81, 1.3e-3, 0.02, 0.001), strict=True))
    known |= {"n_gap": 2.3, "decay": 0.01, "delta": 0.4, "L": 0.01, "R": 2.0, "m": 0.02}
    known |= {"u0": 0.2, "U": 0.0, "beta": known["beta_c"], "y": known["Y"]}
    known = {name: x * random.uniform(0.8, 1.2) for name, x in known.items()}
    known |= {"beta": known["beta_c"], "y": known["Y"]}
    _, c_u, c_y, _, *behind = believed.scalar()(*[known[n] for n in believed.inputs])
    delta, tau, kappa = behind or (0.0, 0.0, 0.0)
    model: DesignModel = "lag" if kind.order > 2 else "damped"
    numbers = dict(zip(p_letters(), (c_u, c_y, delta, tau, kappa), strict=True))
    designed: Tangent = design_tangent(model)
    expected = np.array(sp.Matrix.hstack(designed.A, designed.B).subs(numbers), dtype=float)
    order = plant.kind.order
    entries = np.array(tangent.scalar()(*[known[n] for n in tangent.inputs]))
    own = np.hstack([entries[: order**2].reshape(order, order), entries[order**2 :, None]])
    assert own == pytest.approx(expected, rel=1e-9, abs=1e-9)


def p_letters() -> tuple[sp.Symbol, ...]:
    return (p.C_U, p.C_Y, p.delta, p.tau, p.kappa)


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_the_input_of_a_path_moves_the_plant_along_it(kind: PlantKind) -> None:
    plant = p.magnetic_levitation(kind)
    motion = {p.y: 0.017, p.v: 0.04, p.acc: 0.9, p.jerk_ref: -3.0}
    numbers = {p.g: 9.81, p.beta: 1.3e-3, p.y0: 0.001, p.Y: 0.02, p.m: 0.02, p.L: 0.01, p.R: 2.0}
    numbers |= {p.n_gap: 2.3, p.decay: 0.01, p.delta: 0.4, p.u0: 0.2}
    given = float(path_input(plant).subs(motion | numbers))
    if kind.order == 2:
        pulled = plant.acceleration.subs(numbers).subs(motion).subs(p.u, given)
        assert float(pulled) == pytest.approx(motion[p.acc], rel=1e-9)
        return
    at = plant.acceleration.subs(numbers).subs(p.u, p.u_coil)
    (held, *_) = [
        x for x in sp.solve(at.subs(motion) - motion[p.acc], p.u_coil) if sp.im(x) == 0 and x > 0
    ]
    rate = plant.drive_rate.subs(numbers).subs(motion).subs({p.u_coil: held, p.u: given})
    jerk = (sp.diff(at, p.y) * p.v + sp.diff(at, p.v) * p.acc + sp.diff(at, p.u_coil) * rate).subs(
        motion
    )
    assert float(jerk.subs(p.u_coil, held)) == pytest.approx(motion[p.jerk_ref], rel=1e-6)


def test_a_plant_with_zeros_has_no_flat_gap() -> None:
    seen = Tangent(sp.Matrix([[0, 1], [p.C_Y, 0]]), sp.Matrix([1, -p.C_U]))
    with pytest.raises(ValueError, match="no flat output"):
        _ = seen.flat_gain


# --- GPI of any order ----------------------------------------------------------------------


def of_fourth_order() -> sp.Poly:
    return sp.Poly(p.s**4 + sum(sp.Symbol(f"a{k}") * p.s**k for k in range(4)), p.s)


@pytest.mark.parametrize(
    ("denominator", "integrators"),
    [
        *[(design_tangent("undamped").denominator, m) for m in (0, 1, 2)],
        (design_tangent("damped").denominator, 1),
        (design_tangent("lag").denominator, 1),
        (of_fourth_order(), 1),
    ],
    ids=lambda x: str(x if isinstance(x, int) else x.degree()),
)
def test_the_division_is_the_chain_of_integral_reconstructors(
    denominator: sp.Poly, integrators: int
) -> None:
    gains = gpi.gain_symbols(2 * denominator.degree() - 1 + integrators)
    over, under = gpi.gpi_division(denominator, gains, integrators)
    divided = over.as_expr() / (p.s**integrators * under.as_expr())
    chained = gpi.reconstructed_transfer(denominator, gains, integrators)
    assert sp.cancel(sp.together(divided - chained)) == 0


def test_for_second_order_and_one_integrator_it_is_the_papers_law() -> None:
    gains = gpi.gain_symbols(4)
    over, under = gpi.gpi_division(design_tangent("undamped").denominator, gains)
    assert sp.cancel(over.as_expr() / (p.s * under.as_expr()) - gpi.gpi_transfer(gains)) == 0


def test_gains_of_another_number_and_plants_that_are_not_monic_are_refused() -> None:
    denominator = design_tangent("lag").denominator
    with pytest.raises(ValueError, match="needs 6 gains, not 4"):
        gpi.gpi_division(denominator, gpi.gain_symbols(4))
    with pytest.raises(ValueError, match="monic"):
        gpi.gpi_division(2 * denominator, gpi.gain_symbols(6))


def core_of(program: Any, known: dict[str, float], order: int) -> tuple[Array, Array, Array, Array]:
    values = dict(
        zip(program.outputs, program.scalar()(*[known[n] for n in program.inputs]), strict=True)
    )
    shapes = {"A": (order, order), "B": (order, 1), "C": (1, order), "D": (1, 1)}
    return tuple(  # type: ignore[return-value]
        np.array([values[f"{name}{n}"] for n in range(math.prod(shape))]).reshape(shape)
        for name, shape in shapes.items()
    )


@pytest.mark.parametrize("name", ["lag", "coil", "measured", "exponential", "damped"])
def test_the_gains_place_the_poles_on_the_plant_of_the_design(name: str) -> None:
    rig = plant_named(name)
    design = make_design(rig, PoleSpec((1.3, 60.0), (0.8, 90.0)))
    known = coefficient_inputs(rig, design.believed) | design.named_gains
    order = design.controller.plant_order
    a, b, c, d = core_of(programs.continuous_core_program(design.controller), known, order)
    pa, pb, pc, _ = tangent_matrices(rig, design.believed.beta, design.Y)
    whole = np.block([[pa + pb @ d @ pc, pb @ c], [b @ pc, a]])
    pairs = [(1.3, 60.0), *[(0.8, 90.0)] * (order - 1)]
    desired = np.poly1d([1.0])
    for zeta, omega in pairs:
        desired = desired * np.poly1d([1.0, 2 * zeta * omega, omega**2])
    assert np.poly(whole) == pytest.approx(desired.coeffs, rel=1e-6)


@pytest.mark.parametrize("zeta", [0.7, 1.0, 1.9])
def test_the_step_invariant_core_is_that_of_the_matrix_exponential(zeta: float) -> None:
    rig = plant_named("coil")
    design = placed(rig, zeta, method="zoh")
    known = coefficient_inputs(rig, design.believed) | design.named_gains
    a, b, c, d = core_of(programs.continuous_core_program(design.controller), known, 3)
    step = core_of(
        programs.sampled_core_program("zoh", design.controller), dict(design.coefficients), 3
    )
    block = expm(np.block([[a, b], [np.zeros((1, 4))]]) * rig.sampling.period)
    for own, expected in zip(step, (block[:3, :3], block[:3, 3:], c, d), strict=True):
        assert own == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", ["dipole", "measured", "exponential"])
def test_the_feedforward_holds_the_ball_at_every_gap_of_the_path(name: str) -> None:
    rig = plant_named(name)
    design = placed(rig)
    program = programs.feedforward_program(design.method, design.controller)
    for gap in np.linspace(rig.reference.end_gap, rig.reference.start_gap, 5):
        known = dict.fromkeys(("v_ref", "acc_ref", "jerk_ref"), 0.0) | dict(design.coefficients)
        known |= {"y_ref": float(gap), "Y": design.Y, "U": design.believed.U}
        known |= {"u_min": 0.0, "u_max": math.inf}
        (voltage,) = program.scalar()(*[known[n] for n in program.inputs])
        expected = true_equilibrium(rig, design.believed.beta, float(gap)).U
        assert voltage == pytest.approx(expected, rel=1e-6)


def test_which_law_belongs_to_which_plant() -> None:
    assert matching.matching_law(rig_with(SHORT)) == TAN_GPI
    assert matching.matching_law(plant_named("coil")) == Controller(design_model="lag")
    fast = rig_with(changed(SHORT, {"drive.lag": 0.001}))
    assert matching.matching_law(fast) == TAN_GPI
    assert matching.matching_law(plant_named("damped")) == Controller(design_model="damped")
    assert matching.matching_law(plant_named("dipole")) == Controller(static_voltage="series")
    assert matching.law_named("tan-gpi-2", plant_named("coil")) == TAN_GPI
    with pytest.raises(InputError, match="on this rig tan-gpi is of second order"):
        matching.law_named("tan-gpi-2", rig_with(SHORT))
    with pytest.raises(InputError, match="inverse-square force"):
        matching.law_named("fee-gpi", plant_named("dipole"))


# --- the linear loop -----------------------------------------------------------------------

LAWS = (TAN_GPI, Controller("state-feedback"), Controller("lin-pid", derivative="measurement"))


@pytest.mark.parametrize("law", LAWS, ids=lambda x: x.name)
@pytest.mark.parametrize("delay", [0.0, 0.0004])
def test_the_loop_of_any_order_is_the_closed_form_for_the_papers_plant(
    law: Controller, delay: float
) -> None:
    rig = rig_with(changed(SHORT, {"sampling.delay": delay}))
    design = placed(rig, controller=law)
    closed = loops.loop_of(rig, design)
    beta = design.believed.beta / 1.1
    numbers = coefficient_inputs(rig, design.believed) | design.named_gains
    own = PlacedLaw(law, design.method, numbers, 1.0)
    parts, _ = any_order(rig, own, design.believed.beta, (0.021, beta), delay)
    given = [x.full().ravel() for x in closed.open_loop(design.poles.values, 0.021, 1.1)]
    for name, expected in zip(("num", "den"), given, strict=True):
        values = np.array([float(ca.evalf(ca.SX(x))) for x in parts[name]])
        assert values == pytest.approx(expected, rel=1e-9, abs=1e-9 * abs(expected).max())


@pytest.mark.parametrize("name", ["lag", "coil", "measured", "exponential", "offset"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("delay", [0.0, 0.0013])
def test_the_poles_of_the_sampled_loop_are_those_of_its_matrix(
    name: str, method: Any, delay: float
) -> None:
    """The matrix is put together with SciPy's exponential from the plant and the step."""
    rig = plant_named(name)
    rig = rig.model_copy(update={"sampling": rig.sampling.model_copy(update={"delay": delay})})
    design = placed(rig, method=method)
    gap, ratio = 0.021, 0.9
    a, b, c, _ = tangent_matrices(rig, design.believed.beta / ratio, gap)
    core = programs.sampled_core_program(method, design.controller)
    ca_, cb, cc, cd = core_of(core, dict(design.coefficients), design.controller.plant_order)
    period, n, m = rig.sampling.period, len(a), len(ca_)
    whole, part = divmod(delay, period)

    def held(time: float) -> tuple[Array, Array]:
        block = expm(np.block([[a, b], [np.zeros((1, n + 1))]]) * time)
        return block[:n, :n], block[:n, n:]

    late, entered = held(part)
    rest, fresh = held(period - part)
    past = int(whole) + (part > 0)
    size = n + m + past
    matrix = np.zeros((size, size))
    effort = np.zeros((1, size))
    effort[:, :n], effort[:, n : n + m] = cd @ c, cc
    voltages = [effort, *[np.eye(size)[n + m + k : n + m + k + 1] for k in range(past)]]
    matrix[:n, :n] = rest @ late
    matrix[:n] += fresh @ voltages[int(whole)]
    if part > 0:
        matrix[:n] += rest @ entered @ voltages[int(whole) + 1]
    matrix[n : n + m, :n], matrix[n : n + m, n : n + m] = cb @ c, ca_
    for k in range(past):
        matrix[n + m + k] = voltages[k]
    loop = loops.loop_of(rig, design)
    polynomial, _ = loop.characteristic(design.poles.values, gap, ratio)
    own = np.poly(matrix)
    found = polynomial.full().ravel()
    assert found[: len(own)] == pytest.approx(own, rel=1e-7, abs=1e-7)
    assert found[len(own) :] == pytest.approx(0, abs=1e-9)


# --- the nonlinear loop --------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANTS)
def test_every_plant_levitates_and_every_back_end_agrees(name: str) -> None:
    rig = plant_named(name)
    design = placed(rig)
    loop = build(rig, design.method, controller=design.controller)
    start = nominal_scenario(rig, plant_beta(rig))
    run = simulate(loop, design, start).metrics
    assert not run.crashed
    (compiled,) = simulate_batch(loop, [design], [start], backend="compiled")
    assert compiled.metrics.itae == pytest.approx(run.itae, rel=BACK_ENDS)
    other = resimulate(rig, design, start)
    assert other.itae == pytest.approx(run.itae, rel=INTEGRATORS)
    assert other.peak_voltage == pytest.approx(run.peak_voltage, rel=INTEGRATORS)


@pytest.mark.parametrize("name", ["coil", "measured", "exponential"])
def test_the_continuous_law_agrees_with_an_adaptive_integrator(name: str) -> None:
    rig = plant_named(name)
    design = placed(rig)
    loop = build(rig, None, controller=design.controller, fastest=500.0)
    start = nominal_scenario(rig, plant_beta(rig))
    other = resimulate_continuous(loop, design, start)
    assert other.itae == pytest.approx(simulate(loop, design, start).metrics.itae, rel=INTEGRATORS)


@pytest.mark.parametrize("name", ["coil", "exponential"])
def test_the_gradients_of_a_coil_are_those_of_differences(name: str) -> None:
    rig = plant_named(name)
    loop = build(rig, "tustin", controller=matching.matching_law(rig), directions=2)
    directions = np.vstack([np.eye(2), np.eye(2)])
    start = nominal_scenario(rig, plant_beta(rig) / 0.9)

    def run(zeta: float, omega: float) -> Any:
        design = placed(rig, zeta, omega)
        moved = pole_sensitivities(loop, design, directions)
        return simulate(loop, design, start, moved)

    at, step = run(1.2, 80.0), 1e-5
    slopes = [
        (run(1.2 + step, 80.0).metrics.itae - run(1.2 - step, 80.0).metrics.itae) / (2 * step),
        (run(1.2, 80 + step).metrics.itae - run(1.2, 80 - step).metrics.itae) / (2 * step),
    ]
    assert at.gradients["itae"] == pytest.approx(slopes, rel=1e-4)


def test_a_ball_at_rest_behind_a_coil_stays_where_it_is() -> None:
    """Voltage and current of the start are those that hold it: nothing kicks."""
    rig = plant_named("coil")
    data = rig.model_dump(exclude_none=True) | {"initial": {"gap": rig.reference.start_gap}}
    rig = rig_with(data)
    design = placed(rig)
    run = simulate(
        build(rig, "tustin", controller=design.controller),
        design,
        nominal_scenario(rig, plant_beta(rig)),
    )
    still = run.times < rig.reference.start_time
    assert np.ptp(run.gap[still]) < 1e-12


def test_numbers_of_a_scenario_move_the_plant() -> None:
    rig = plant_named("coil")
    design = placed(rig)
    loop = build(rig, "tustin", controller=design.controller)
    beta = plant_beta(rig)
    slow = Scenario(beta, rig.initial.gap, numbers=(("L", 0.02),))
    own = simulate(loop, design, nominal_scenario(rig, beta)).metrics.itae
    moved = simulate(loop, design, slow).metrics
    assert moved.itae > 1.2 * own
    assert resimulate(rig, design, slow).itae == pytest.approx(moved.itae, rel=INTEGRATORS)


@pytest.mark.parametrize("name", ["coil", "dipole", "exponential"])
def test_another_law_of_force_is_another_motion(name: str) -> None:
    """Numbers that are not used would let two plants run alike."""
    rig, other = plant_named(name), plant_named("lag")
    assert rig.kind != other.kind
    program = programs.tangent_program(rig.kind)
    fixed = (9.81, plant_beta(rig), rig.plant.gap_offset, 0.022)
    assert len(on_plant(program, rig, *fixed)) == len(program.inputs)
    local = linearise(p.magnetic_levitation(rig.kind))
    assert (
        local.C_Y_rest != linearise(p.magnetic_levitation(PAPER_PLANT)).C_Y_rest or name == "coil"
    )


# --- tuning --------------------------------------------------------------------------------


def test_a_coil_is_tuned_within_every_limit() -> None:
    """The paper's rig with 5 ms: the second-order law has no feasible poles there."""
    lag = rig_with(changed(SHORT, {"drive.lag": 0.005, "uncertainty.beta": 0.15}))
    found = solve(build_problem(lag))
    assert isinstance(found, TuneResult)
    assert found.figures.feasible
    assert found.verification.passed
    worst = loops.peak_sensitivity(found.problem.loop, found.poles.values, family_of(lag))
    assert 1.9 < worst.value <= 2.0 + ROUNDING
    second = matching.second_order_law(lag)
    other = solve(build_problem(lag, controller=second))
    assert not (isinstance(other, TuneResult) and other.figures.feasible)
