from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from flint import fmpq, fmpq_mat
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rigs import MINIMAL, OFFSET, rig_with

from maglev_design.certification.intervals.arithmetic import exact
from maglev_design.certification.region.cells import FROZEN, RUNNING, Cell, enclose, modes
from maglev_design.certification.region.guaranteed import Region, RegionStatus, guaranteed_region
from maglev_design.certification.region.model import Deviation, deviation, force_program, share, x
from maglev_design.certification.region.proof import (
    MULTIPLIERS,
    Plane,
    RegionVerdict,
    check,
    positive_definite,
    upper_form,
)
from maglev_design.certification.region.simulated import (
    RegionMap,
    contradictions,
    region_curves,
    region_extent,
    simulated_map,
)
from maglev_design.controller.design import Design, PoleSpec, make_design, plant_beta
from maglev_design.errors import InputError
from maglev_design.options import Controller
from maglev_design.programs import acceleration_program, continuous_program
from maglev_design.reporting.plots.region import region_figure
from maglev_design.reporting.plots.style import house_style, save_figure
from maglev_design.rig import Rig, load_rig

Array = NDArray[np.float64]
ONE = (Fraction(1), Fraction(1))
WIDE = (Fraction("0.85"), Fraction("1.15"))
PAPER_ERROR = 0.0004
"""[m] The paper's own: from rest at 24.6 mm with the reference at 24.2 mm."""
FALLING = 1e-6
"""Share of the level by which V may seem to rise: integration and rounding, steps of 0.1 ms."""


@pytest.fixture(scope="module")
def design(paper_rig: Rig) -> Design:
    return make_design(paper_rig, PoleSpec.double(1, 70))


@pytest.fixture(scope="module")
def region(paper_rig: Rig, design: Design) -> Region:
    return guaranteed_region(paper_rig, design)


@pytest.fixture(scope="module")
def wide(paper_rig: Rig, design: Design) -> Region:
    return guaranteed_region(paper_rig, design, WIDE)


class Loop:
    """The loop that runs, by the programs that simulation runs, on a plant with one ratio."""

    def __init__(self, rig: Rig, design: Design, gap: float, ratio: float | Array) -> None:
        self.gap, self.rig = gap, rig
        self.beta = plant_beta(rig) / ratio
        low, high = rig.limits.voltage
        known = {
            "Y": design.Y,
            "U": design.believed.U,
            "u_min": low,
            "u_max": high,
            "C_U_hat": design.believed.C_U,
            "C_Y_hat": design.believed.C_Y,
            "y_ref": gap,
            "acc_ref": 0.0,
            **design.named_gains,
        }
        program = continuous_program(design.controller)
        moving = ("x1", "x2", "y")
        assert set(program.inputs) <= {*known, *moving}
        run = program.numpy()

        def law(y: Array, x1: Array, x2: Array) -> list[Array]:
            at = {**known, "y": y, "x1": x1, "x2": x2}
            return run(*[at[name] for name in program.inputs])

        self.law: Callable[..., list[Array]] = law
        distance = gap + rig.plant.gap_offset
        self.rest = np.sqrt(rig.plant.gravity / self.beta) * distance
        zero = np.zeros(1)
        self.feedforward = float(law(zero + gap, zero, zero)[-1][0])
        self.by_integral = float(law(zero + gap, zero + 1, zero)[-1][0]) - self.feedforward

    def rates(self, state: Array) -> Array:
        """Return the derivative of (y, v, x1, x2), columns of states."""
        y, v, x1, x2 = state
        first, second, commanded = self.law(y, x1, x2)
        low, high = self.rig.limits.voltage
        plant = self.rig.plant
        (acc,) = acceleration_program().numpy()(
            plant.gravity, self.beta, plant.gap_offset, y, np.clip(commanded, low, high)
        )
        return np.array([v, acc, *np.broadcast_arrays(first, second, y)[:2]])

    def deviations(self, state: Array) -> Array:
        """Return z = (e, q, v, x2)."""
        y, v, x1, x2 = state
        return np.array([y - self.gap, self.law(y, x1, x2)[-1] - self.rest, v, x2])

    def state(self, z: Array) -> Array:
        """Return (y, v, x1, x2) of the deviations z."""
        e, q, v, x2 = z
        bare = self.law(self.gap + e, 0 * e, x2)[-1]
        return np.array([self.gap + e, v, (q + self.rest - bare) / self.by_integral, x2])

    def advanced(self, state: Array, h: float) -> Array:
        """Return the state after one step of Runge and Kutta."""
        a = self.rates(state)
        b = self.rates(state + h / 2 * a)
        c = self.rates(state + h / 2 * b)
        return np.asarray(state + h / 6 * (a + 2 * (b + c) + self.rates(state + h * c)))


def form(region: Region) -> Array:
    return np.array((region.P / region.level).tolist(), float)


def inside(region: Region, count: int, seed: int, radius: float | None = None) -> Array:
    """Return random points of the set in z, columns; on {V = radius^2 level} where it is given."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(4, count))
    directions /= np.linalg.norm(directions, axis=0)
    radii = rng.uniform(size=count) ** 0.25 if radius is None else radius
    return np.asarray(np.linalg.solve(np.linalg.cholesky(form(region)).T, directions * radii))


def values(region: Region, z: Array) -> Array:
    found: Array = np.einsum("in,ij,jn->n", z, form(region), z)
    return found


def loop_of(region: Region, rig: Rig, design: Design, count: int, seed: int) -> Loop:
    """Return the loop with a random ratio of the region's interval for each of `count` starts."""
    low, high = (float(ratio) for ratio in region.ratios)
    ratios = np.random.default_rng(seed).uniform(low, high, size=count)
    ratios[:2] = low, high
    return Loop(rig, design, float(region.model.gap), ratios)


def test_the_region_contains_the_error_with_which_the_paper_starts(
    region: Region, wide: Region, paper_rig: Rig
) -> None:
    start = paper_rig.initial.gap - paper_rig.reference.start_gap
    assert start == pytest.approx(PAPER_ERROR)
    for one in (region, wide):
        assert one.status is RegionStatus.GUARANTEED
        assert one.contains(start, 0.0)
        assert one.contains(-start, 0.0)


def test_the_region_reaches_beyond_a_millimetre_from_rest(region: Region, wide: Region) -> None:
    for one in (region, wide):
        low, high = one.reach
        assert low < -0.001
        assert high > 0.001
        for e, held in ((low, True), (high, True)):
            assert one.contains(0.999 * e, 0.0) is held
            assert not one.contains(1.001 * e, 0.0)


def test_the_outline_is_where_the_exact_membership_changes(wide: Region) -> None:
    e, low, high = wide.outline()
    for k in range(20, len(e) - 20, 40):
        for v in (low[k], high[k]):
            middle = (low[k] + high[k]) / 2
            assert wide.contains(e[k], middle + 0.999 * (v - middle))
            assert not wide.contains(e[k], middle + 1.001 * (v - middle))
    grid_e, grid_v = np.linspace(e[0], e[-1], 61), np.linspace(low.min(), high.max(), 61)
    cell = (grid_e[1] - grid_e[0]) * (grid_v[1] - grid_v[0])
    counted = sum(wide.contains(a, b) for a in grid_e for b in grid_v) * cell
    assert wide.area == pytest.approx(counted, rel=0.02)


def test_the_exact_model_is_the_loop_that_simulation_runs(paper_rig: Rig, design: Design) -> None:
    rng = np.random.default_rng(1)
    ratio = 0.9
    model = deviation(paper_rig, design, (Fraction("0.9"),) * 2)
    loop = Loop(paper_rig, design, float(model.gap), ratio)
    assert float(model.rest[0]) == pytest.approx(loop.rest, rel=1e-12)
    z = rng.uniform(-1, 1, size=(4, 4000)) * np.array([[0.01], [6.0], [0.5], [3e-5]])
    (bound,) = [limit for limit in model.limits if limit.name == "integrator bound"]
    z = z[:, np.abs(np.array(bound.row, dtype=float) @ z) < float(bound.margin)]
    e, q = z[:2]
    assert np.ptp(np.sign([loop.rest + q - 5, loop.rest + q]), axis=1).min() == 2  # both clamps
    low, high = paper_rig.limits.voltage
    share_of_rest = np.clip(loop.rest + q, low, high) / loop.rest
    phi, *_ = force_program().numpy()(e / float(model.distance), share_of_rest)
    frozen = ((loop.rest + q > high) & (e > 0)) | ((loop.rest + q < low) & (e < 0))
    matrices = np.array([model.running.tolist(), model.frozen.tolist()], dtype=float)
    expected = np.einsum("nij,jn->in", matrices[frozen.astype(int)], z)
    expected[2] += float(model.gravity) * phi
    state = loop.state(z)
    assert loop.deviations(state) == pytest.approx(z, abs=1e-11)
    rates = loop.rates(state)
    step = 1e-3  # z is affine in the state, so that any step gives the derivative
    found = (loop.deviations(state + step * rates) - loop.deviations(state)) / step
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert found / scale == pytest.approx(expected / scale, abs=1e-9)


def test_the_start_under_mismatch_is_an_offset_of_the_command(
    paper_rig: Rig, design: Design
) -> None:
    model = deviation(paper_rig, design, (Fraction("1.1"),) * 2)
    loop = Loop(paper_rig, design, float(model.gap), 1.1)
    state = np.array([[float(model.gap) + 3e-4], [-0.02], [0.0], [0.0]])
    start = [float(value) for value in model.start(exact(3e-4), exact(-0.02), model.rest[0])]
    assert loop.deviations(state)[:, 0] == pytest.approx(start, rel=1e-9)
    assert start[1] - float(model.slope) * 3e-4 == pytest.approx(-0.1, abs=0.01)  # U_r - u_eq [V]


@pytest.mark.parametrize("name", ["region", "wide"])
def test_no_point_of_the_set_has_a_rising_value(
    name: str, paper_rig: Rig, design: Design, request: pytest.FixtureRequest
) -> None:
    one: Region = request.getfixturevalue(name)
    z = np.hstack([inside(one, 50_000, seed=2), inside(one, 50_000, seed=3, radius=1.0)])
    loop = loop_of(one, paper_rig, design, z.shape[1], seed=4)
    state = loop.state(z)
    step = 1e-6
    moved = loop.deviations(state + step * loop.rates(state)) - z
    slope = 2 * np.einsum("in,ij,jn->n", moved / step, form(one), z)
    assert slope.max() < 0


@pytest.mark.parametrize("name", ["region", "wide"])
def test_motions_from_the_boundary_converge_with_a_falling_value(
    name: str, paper_rig: Rig, design: Design, request: pytest.FixtureRequest
) -> None:
    one: Region = request.getfixturevalue(name)
    loop = loop_of(one, paper_rig, design, 300, seed=5)
    state = loop.state(inside(one, 300, seed=6, radius=1.0))
    clamped = np.zeros(300, dtype=bool)
    last = values(one, loop.deviations(state))
    for _ in range(3000):
        state = loop.advanced(state, 1e-4)
        z = loop.deviations(state)
        now = values(one, z)
        assert (now <= last + FALLING).all()
        last = now
        clamped |= (z[1] + loop.rest < 0) | (z[1] + loop.rest > 5)
    assert last.max() < 1e-4
    assert clamped.sum() > 20  # the clamp is in force, and not for show


@pytest.mark.parametrize("ratio", [0.85, 1.0, 1.15])
def test_the_simulated_map_does_not_contradict_the_region(
    ratio: float, wide: Region, paper_rig: Rig, design: Design
) -> None:
    near = simulated_map(paper_rig, design, region_extent(wide), points=21, ratio=ratio)
    assert sum(wide.contains(e, v) for e in near.e for v in near.v) > 100
    assert contradictions(wide, near) == ()


def test_a_lost_start_inside_the_region_is_reported(
    region: Region, paper_rig: Rig, design: Design
) -> None:
    near = simulated_map(paper_rig, design, region_extent(region), points=5)
    survived = near.survived.copy()
    survived[2, 2] = False
    survived[0, 0] = False  # outside
    assert contradictions(region, replace(near, survived=survived)) == ((near.e[2], near.v[2]),)
    with pytest.raises(ValueError, match="same loop"):
        contradictions(region, replace(near, ratio=1.1))
    with pytest.raises(ValueError, match="same loop"):
        contradictions(region, replace(near, continuous=False))


def test_simulation_survives_more_than_is_guaranteed_and_not_everything(
    region: Region, paper_rig: Rig, design: Design
) -> None:
    whole = simulated_map(paper_rig, design, points=21)
    assert 0.1 < whole.survived.mean() < 0.6
    assert 0.005 < region.area / whole.area < 0.1
    assert whole.survived[10].all()  # every gap the rig allows, from rest


def test_the_sampled_law_has_a_map_too(paper_rig: Rig, design: Design) -> None:
    extent = ((-0.002, 0.002), (-0.2, 0.2))
    sampled = simulated_map(paper_rig, design, extent, points=5, continuous=False)
    assert sampled.survived.all()
    assert not sampled.continuous
    document = sampled.as_dict()
    assert (document["starts"], document["survived"]) == (25, 25)
    assert document["area"] == pytest.approx(25 * 0.001 * 0.1)


def test_the_proof_can_be_checked_again_and_not_for_more(region: Region) -> None:
    assert region.verified().proved
    larger = check(region.model, region.P, region.level * fmpq(3, 2), region.pace)
    assert larger.verdict is RegionVerdict.NOT_FALLING
    assert larger.place is not None
    huge = check(region.model, region.P, region.level * 10**6, region.pace)
    assert huge.verdict is RegionVerdict.LIMIT
    assert huge.limit in {"gap", "integrator bound"}


def test_a_wrong_model_is_refused(region: Region) -> None:
    def refused(**changes: object) -> RegionVerdict:
        wrong = replace(region.model, **changes)  # type: ignore[arg-type]
        return check(wrong, region.P, region.level, region.pace).verdict

    swapped = fmpq_mat(region.model.running)
    swapped[1, 2] = -swapped[1, 2]
    assert refused(running=swapped) is RegionVerdict.NOT_FALLING
    held = fmpq_mat(region.model.frozen)
    held[1, 2] = -held[1, 2]
    assert refused(frozen=held) is RegionVerdict.NOT_FALLING
    assert refused(actuator=(fmpq(0), fmpq(5, 2))) is RegionVerdict.NOT_FALLING
    low, high = region.model.rest
    assert refused(rest=(low * fmpq(7, 10), high)) is RegionVerdict.NOT_FALLING


def test_a_tampered_form_is_refused(region: Region) -> None:
    turned = fmpq_mat(region.P)
    turned[0, 1] = turned[1, 0] = -turned[0, 1]
    verdict = check(region.model, turned, region.level, region.pace).verdict
    assert verdict in {RegionVerdict.NOT_POSITIVE, RegionVerdict.NOT_FALLING}
    crooked = fmpq_mat(region.P)
    crooked[0, 1] = crooked[0, 1] + 1
    assert (
        check(region.model, crooked, region.level, region.pace).verdict
        is RegionVerdict.NOT_POSITIVE
    )
    assert not positive_definite(fmpq_mat([[1, 2], [2, 1]]))
    assert positive_definite(fmpq_mat([[2, 1], [1, 2]]))


def test_the_force_is_monotonic_as_the_proof_uses_it() -> None:
    gap, part = sp.symbols("gap part", positive=True)  # 1 + x and the share
    program = force_program()
    operators: dict[str, Callable[..., sp.Expr]] = {
        "add": operator.add,
        "sub": operator.sub,
        "mul": operator.mul,
        "div": operator.truediv,
        "neg": operator.neg,
    }
    exact = program.evaluate(operators, gap - 1, part)
    phi, by_x, by_share = (sp.nsimplify(sp.simplify(value)) for value in exact)
    assert sp.simplify(phi - (1 - part**2 / gap**2)) == 0
    assert (sp.diff(phi, gap) - by_x).simplify() == 0
    assert (sp.diff(phi, part) - by_share).simplify() == 0
    assert by_x.is_positive
    assert by_share.is_negative
    assert sp.diff(by_x, gap).is_negative
    assert sp.diff(by_x, part).is_positive
    assert sp.diff(by_share, part).is_negative
    assert sp.diff(by_share, gap).is_positive
    assert (x.name, share.name) == program.inputs


def cells(seed: int, count: int) -> list[Cell]:
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        a, b = (fmpq(int(n), 64) for n in rng.integers(-64, 56, size=2))
        width, height = (fmpq(int(n), 64) for n in rng.integers(1, 9, size=2))
        found.append(Cell(a, a + width, b, b + height))
    return found


def test_the_enclosure_holds_the_force_at_every_point_of_a_cell(
    paper_rig: Rig, design: Design
) -> None:
    model = deviation(paper_rig, design, WIDE)
    extents = (fmpq(1, 4), fmpq(4))
    rng = np.random.default_rng(8)
    low, high = 0.0, 5.0
    for cell in cells(7, 150):
        force = enclose(model, extents, cell)
        spots = rng.uniform(size=(3, 200))
        spots[:, :4] = [[0, 0, 1, 1], [0, 1, 0, 1], [0, 1, 0, 1]]
        a = float(cell.left) + float(cell.right - cell.left) * spots[0]
        b = float(cell.low) + float(cell.high - cell.low) * spots[1]
        rest = float(model.rest[0]) + float(model.rest[1] - model.rest[0]) * spots[2]
        ratio = np.clip(rest + 4 * b, low, high) / rest
        phi = 1 - ratio**2 / (1 + a / 4) ** 2
        centre = [float(value) for value in cell.centre]
        slopes = [float(pair[0] + pair[1]) / 2 for pair in (force.by_e, force.by_q)]
        line = float(force.middle) + slopes[0] * (a - centre[0]) + slopes[1] * (b - centre[1])
        assert (np.abs(phi - line) <= float(force.rest) + 1e-12).all()
        frozen = ((rest + 4 * b > high) & (a > 0)) | ((rest + 4 * b < low) & (a < 0))
        assert set(np.where(frozen, 0, 1).tolist()) <= set(modes(model, extents, cell))


@pytest.fixture(scope="module")
def plane(wide: Region) -> Plane:
    """Return the inequality of the proof, on a plane of handy extents."""
    return Plane(wide.model, wide.P / wide.level, (fmpq(1, 4), fmpq(4)), wide.pace)


@pytest.mark.parametrize("mode", [FROZEN, RUNNING])
def test_the_forms_are_the_maximum_over_the_other_states(
    mode: int, plane: Plane, wide: Region
) -> None:
    rng = np.random.default_rng(9)
    P, model = form(wide), wide.model
    A = np.array((model.frozen, model.running)[mode].tolist(), dtype=float)
    scale = np.sqrt(np.diag(np.linalg.inv(P)))
    gravity = float(model.gravity)
    for pick in (0, 8, 16, 24):
        multiplier = float(MULTIPLIERS[pick] * wide.pace)
        S = np.array(plane.forms[mode][pick], dtype=float)
        for _ in range(20):
            s = rng.normal(size=3)
            e, q = s[0] * float(model.distance) / 4, s[1] * 4
            push = np.array([0.0, 0.0, gravity * s[2], 0.0])

            def rising(z: Array, push: Array = push, multiplier: float = multiplier) -> float:
                return float(2 * z @ P @ (A @ z + push) - multiplier * z @ P @ z)

            # the stationary point in (v, x2) of a quadratic, by its gradient and Hessian
            H = P @ A + A.T @ P - multiplier * P
            z = np.array([e, q, 0.0, 0.0])
            gradient = H @ z + P @ push
            z[2:] = -np.linalg.solve(H[2:, 2:], gradient[2:])
            assert rising(z) == pytest.approx(s @ S @ s, rel=1e-6, abs=1e-6 * np.abs(S).max())
            for _ in range(5):
                other = z.copy()
                other[2:] += rng.normal(size=2) * scale[2:]
                assert rising(other) < rising(z)


def test_a_rounded_form_is_an_upper_bound() -> None:
    rng = np.random.default_rng(12)
    for n in (2, 3):
        for _ in range(50):
            draws = rng.integers(-(10**18), 10**18, size=n * n).tolist()
            half = fmpq_mat(n, n, draws) / 10**17
            S = half + half.transpose()
            added = fmpq_mat(upper_form(S)) - S
            assert positive_definite(added)
            assert max(abs(x) for x in added.entries()) < max(abs(x) for x in S.entries()) / 10**9


@pytest.mark.parametrize("mode", [FROZEN, RUNNING])
def test_the_bound_of_a_cell_holds_everywhere_in_it_and_is_tight(mode: int, plane: Plane) -> None:
    rng = np.random.default_rng(10)
    model = plane.model
    for cell in cells(11, 60):
        force = enclose(model, plane.extents, cell)
        for pick in (0, 10, 20):
            S = np.array(plane.forms[mode][pick], dtype=float)
            spots = rng.uniform(size=(3, 300))
            spots[:, :8] = np.array(list(product((0, 1), repeat=3))).T
            a = float(cell.left) + float(cell.right - cell.left) * spots[0]
            b = float(cell.low) + float(cell.high - cell.low) * spots[1]
            rest = float(model.rest[0]) + float(model.rest[1] - model.rest[0]) * spots[2]
            phi = 1 - (np.clip(rest + 4 * b, 0, 5) / rest) ** 2 / (1 + a / 4) ** 2
            s = np.array([a, b, phi])
            values = np.einsum("in,ij,jn->n", s, S, s) + float(MULTIPLIERS[pick] * plane.pace)
            bound = float(plane.bound(cell, force, mode, pick))
            spread = np.ptp(values) + np.abs(values).max()
            assert values.max() <= bound + 1e-9 * abs(bound)
            assert bound <= values.max() + 2 * spread + 1e-6


def test_a_rig_with_an_offset_has_a_region() -> None:
    rig = rig_with(OFFSET)
    speed = 2 * math.sqrt(2 * rig.plant.gravity / (0.010 + 0.0042))
    design = make_design(rig, PoleSpec.double(1, speed))
    found = guaranteed_region(rig, design, (0.95, 1.05), gap=0.011)
    assert found.status is RegionStatus.GUARANTEED
    assert found.reach[1] > 0.05 * 0.011
    near = simulated_map(rig, design, region_extent(found), points=11, ratio=0.95, gap=0.011)
    assert contradictions(found, near) == ()


def test_what_is_unstable_has_no_region(paper_rig: Rig, design: Design) -> None:
    found = guaranteed_region(paper_rig, design, (0.05, 1.0))
    assert found.status is RegionStatus.NO_FORM
    assert found.area == 0.0
    assert found.reach == (0.0, 0.0)
    assert not found.contains(0.0, 0.0)
    assert region_extent(found) is None
    assert found.as_dict()["status"] == "no-form"


def test_what_cannot_be_treated_is_refused_with_a_reason(paper_rig: Rig) -> None:
    other = make_design(paper_rig, PoleSpec.double(1, 70), controller=Controller("fee-gpi"))
    with pytest.raises(InputError, match="controller = fee-gpi"):
        guaranteed_region(paper_rig, other)
    design = make_design(paper_rig, PoleSpec.double(1, 70))
    with pytest.raises(InputError, match=r"limits\.gap"):
        guaranteed_region(paper_rig, design, gap=0.0009)
    with pytest.raises(InputError, match=r"limits\.voltage"):
        guaranteed_region(paper_rig, design, (1, 9))
    with pytest.raises(InputError, match="greater than 0"):
        guaranteed_region(paper_rig, design, (0.0, 1.0))
    with pytest.raises(InputError, match="at least 2 points"):
        simulated_map(paper_rig, design, points=1)


def test_a_rig_without_a_largest_voltage_has_no_bound_of_the_integrator(design: Design) -> None:
    rig = rig_with(MINIMAL, {"limits": {"gap": [0.001, 0.05]}})
    model: Deviation = deviation(rig, design, ONE)
    assert [limit.name for limit in model.limits] == ["gap"]
    assert model.actuator == (fmpq(0), None)


def test_the_document_holds_what_a_check_needs(region: Region) -> None:
    document = region.as_dict()
    assert document["states"] == ["e", "q", "v", "x2"]
    P = fmpq_mat([[exact(Fraction(entry)) for entry in row] for row in document["P"]])
    assert P == region.P
    assert exact(Fraction(document["level"])) == region.level
    assert document["area"] == region.area


def picture(region: Region, near: RegionMap | None, whole: RegionMap) -> Figure:
    return region_figure(region_curves(region, whole, near), "a $rig$")


def test_the_figure_shows_the_map_and_the_outline(
    region: Region, paper_rig: Rig, design: Design, tmp_path: Path
) -> None:
    whole = simulated_map(paper_rig, design, points=11)
    near = simulated_map(paper_rig, design, region_extent(region), points=11)
    with house_style():
        figure = picture(region, near, whole)
    assert len(figure.axes) == 2
    for axes in figure.axes:
        assert axes.get_xlabel().endswith("[mm]")
        (line,) = axes.lines
        assert np.asarray(line.get_xdata()).max() == pytest.approx(1e3 * region.outline()[0].max())
    assert figure.axes[0].get_ylabel().endswith("[m/s]")
    with house_style():
        files = [save_figure(picture(region, near, whole), tmp_path / f"{n}.svg") for n in "ab"]
    assert files[0].read_bytes() == files[1].read_bytes()
    assert len(picture(region, None, whole).axes) == 1


def test_presets_other_than_the_papers_have_regions_that_survive() -> None:
    rig = load_rig("quanser-maglev")
    point = rig.operating_point.gap + rig.plant.gap_offset
    design = make_design(rig, PoleSpec.double(1, 2 * math.sqrt(2 * rig.plant.gravity / point)))
    found = guaranteed_region(rig, design)
    assert found.status is RegionStatus.GUARANTEED
    near = simulated_map(rig, design, region_extent(found), points=11)
    assert contradictions(found, near) == ()
