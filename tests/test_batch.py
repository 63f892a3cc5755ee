"""Many loops at once: what is compiled against what is interpreted, figure by figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from byhand import LAWS
from numpy.typing import NDArray
from rigs import MINIMAL, OFFSET, SHORT, rig_with

from maglev_design.controller.design import Design, PoleSpec, make_design, plant_beta
from maglev_design.options import METHODS, Method
from maglev_design.rig import Rig
from maglev_design.simulation import (
    LoopGraph,
    Scenario,
    Sensitivities,
    Summary,
    build,
    compiled,
    cores,
    lanes,
    loop_for,
    mirrored,
    nominal_scenario,
    pole_sensitivities,
    respond,
    simulate,
    simulate_batch,
    total_variation,
)
from maglev_design.simulation.batch import first_noise, summaries
from maglev_design.simulation.scenario import parameter_vector, start_state

AGREE = 1e-10
"""Relative: what the package states for its two back ends."""
INTEGRALS = ("ise", "iae", "itae")
VOLTAGES = ("peak_voltage", "min_voltage", "peak_applied")
GAPS = ("min_gap", "max_gap", "final_error")
EMULATOR = {
    "emulator.inductance": 8e-3,
    "emulator.resistance": 4.0,
    "emulator.sensor_step": 1e-6,
    "emulator.actuator_step": 2e-3,
}
SHARES = [("tustin", 0.0), ("euler", 0.3), ("zoh", 1.7), ("tustin", 2.0), (None, 0.0)]
"""Methods, None for the continuous loop, and delays as shares of the period."""


@pytest.fixture(autouse=True, scope="module")
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Keep what is compiled here out of the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MAGLEV_DESIGN_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


def flat(summary: Summary) -> NDArray[np.float64]:
    """Return every number of a summary in one row."""
    metrics = summary.metrics
    splits = (metrics.ise_split, metrics.iae_split, metrics.itae_split)
    named = [getattr(metrics, name) for name in (*INTEGRALS, *VOLTAGES, *GAPS)]
    crash = -1.0 if metrics.crash is None else metrics.crash.time
    numbers = [*named, *(x for split in splits for x in split.values()), crash]
    rows = [np.array([*numbers, summary.total_variation])]
    rows += [summary.gradients[name] for name in sorted(summary.gradients)]
    return np.concatenate(rows)


def same_bits(one: Sequence[Summary], other: Sequence[Summary]) -> bool:
    return len(one) == len(other) and all(
        flat(a).tobytes() == flat(b).tobytes() for a, b in zip(one, other, strict=True)
    )


def assert_agree(found: Summary, expected: Summary) -> None:
    """Hold a summary against one of the other back end."""
    ours, theirs = found.metrics, expected.metrics
    assert ours.crash == theirs.crash
    for name in INTEGRALS:
        total = getattr(theirs, name)
        assert getattr(ours, name) == pytest.approx(total, rel=AGREE), name
        split, other = getattr(ours, f"{name}_split"), getattr(theirs, f"{name}_split")
        assert split == pytest.approx(other, rel=AGREE, abs=AGREE * total), name
    volts = max(abs(getattr(theirs, name)) for name in VOLTAGES)
    for names, size in ((VOLTAGES, volts), (GAPS, theirs.max_gap)):
        for name in names:
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=AGREE * size)
    assert found.total_variation == pytest.approx(expected.total_variation, rel=AGREE)
    assert set(found.gradients) == set(expected.gradients)
    for name, slopes in expected.gradients.items():
        size = AGREE * max(1e-300, float(np.abs(slopes).max()))
        assert found.gradients[name] == pytest.approx(slopes, abs=size), name


def designed(
    name: str = "tan-gpi",
    method: Method | None = "tustin",
    changes: dict[str, Any] | None = None,
    *,
    base: dict[str, Any] = SHORT,
    share: float = 0.0,
    poles: tuple[float, float] = (0.9, 50.0),
) -> tuple[Rig, Design]:
    delay = {"sampling.delay": share * base["sampling"]["period"]}
    rig = rig_with(base, delay | (changes or {}))
    pair = PoleSpec.double(*poles)
    return rig, make_design(rig, pair, method=method or "tustin", controller=LAWS[name])


def some_scenarios(rig: Rig) -> list[Scenario]:
    """Return six unlike scenarios: quiet and noisy, either sign, another plant, two crashes."""
    beta = plant_beta(rig)
    rest = nominal_scenario(rig, beta)
    noisy = replace(rest, beta_plant=beta / 1.05, noise=True, seed=3, index=2)
    other = replace(noisy, seed=2**32 - 1, index=7, gravity=9.7, gap_offset=1e-4, input_noise=2e-3)
    return [
        rest,
        noisy,
        mirrored(rig, replace(rest, beta_plant=beta / 0.95, initial_velocity=0.01)),
        replace(rest, beta_plant=100 * beta),
        replace(other, position_noise=1e-7),
        replace(rest, beta_plant=0.01 * beta),
    ]


def both(
    loop: LoopGraph,
    designs: Sequence[Design],
    scenarios: Sequence[Scenario],
    sensitivities: Sequence[Sensitivities] | None = None,
    **options: Any,
) -> tuple[list[Summary], list[Summary]]:
    one, other = (
        simulate_batch(loop, designs, scenarios, sensitivities, backend=backend, **options)
        for backend in ("compiled", "interpreted")
    )
    return one, other


# --- compiled against interpreted ----------------------------------------------------------


@pytest.mark.parametrize(("method", "share"), SHARES)
@pytest.mark.parametrize("name", LAWS)
def test_both_back_ends_find_the_same_figures(
    name: str, method: Method | None, share: float
) -> None:
    rig, design = designed(name, method, share=share)
    loop = loop_for(rig, design, continuous=method is None)
    scenarios = some_scenarios(rig)
    found, expected = both(loop, [design] * len(scenarios), scenarios)
    for one, other in zip(found, expected, strict=True):
        assert_agree(one, other)
    crashes = [s.metrics.crash for s in found]
    assert None in crashes
    assert any(crashes), "the scenarios are not idle"


@pytest.mark.parametrize("method", [*METHODS, None])
def test_the_emulator_too(method: Method | None) -> None:
    rig, design = designed("tan-gpi", method, EMULATOR, share=0.3 if method else 0.0)
    loop = loop_for(rig, design, continuous=method is None, emulate=True)
    scenarios = some_scenarios(rig)[:2]
    found, expected = both(loop, [design] * 2, scenarios)
    plain = simulate_batch(
        loop_for(rig, design, continuous=method is None), [design] * 2, scenarios
    )
    for one, other, ideal in zip(found, expected, plain, strict=True):
        assert_agree(one, other)
        assert one.metrics.itae != pytest.approx(ideal.metrics.itae, rel=1e-6)


@pytest.mark.parametrize("clamped", [True, False])
@pytest.mark.parametrize(
    "changes",
    [
        {"limits.voltage": [0.0, math.inf]},
        {"limits": ...},
        {"initial.gap": 0.028},
        {"limits.voltage": [1.0, 3.0], "initial.gap": 0.026},
        {"reference.horizon": 0.3507},
        {"reference": ..., "initial": ...},
    ],
    ids=["no ceiling", "no limits", "clamp", "narrow", "short last period", "hold"],
)
def test_any_limits_and_horizons(changes: dict[str, Any], clamped: bool) -> None:
    rig, design = designed(changes=changes)
    loop = build(rig, "tustin", directions=2)
    sensitivities = pole_sensitivities(loop, design, DIRECTIONS[2])
    scenarios = [nominal_scenario(rig, plant_beta(rig) / ratio) for ratio in (0.9, 1.1)]
    found, expected = both(loop, [design] * 2, scenarios, [sensitivities] * 2, clamped=clamped)
    for one, other in zip(found, expected, strict=True):
        assert_agree(one, other)


FATES = {
    "in the first period": (MINIMAL, (1.0, 2000.0), 1 / 1.1, 0.0256),
    "absurd gains": (MINIMAL, (1.0, 1e5), 1.0, 0.0256),
    "starts beyond the floor": (SHORT, (1.0, 70.0), 1.0, 0.06),
    "starts inside the magnet": (SHORT, (1.0, 70.0), 1.0, 0.0005),
    "far too strong": (SHORT, (1.0, 70.0), 100.0, 0.0244),
    "far too weak": (SHORT, (1.0, 70.0), 0.01, 0.0244),
}


@pytest.mark.parametrize("name", FATES)
def test_a_crash_is_the_same_one(name: str) -> None:
    base, poles, factor, gap = FATES[name]
    rig, design = designed(base=base, poles=poles)
    loop = build(rig, "tustin", directions=2)
    sensitivities = pole_sensitivities(loop, design, DIRECTIONS[2])
    scenario = Scenario(plant_beta(rig) * factor, gap)
    found, expected = both(loop, [design], [scenario], [sensitivities])
    assert found[0].metrics.crash is not None
    assert_agree(found[0], expected[0])
    assert np.isfinite(flat(found[0])).all()


def test_the_paper_s_seven_seconds(paper_rig: Rig) -> None:
    design = make_design(paper_rig, PoleSpec.double(1.0, 70.0))
    loop = build(paper_rig, "tustin")
    base = nominal_scenario(paper_rig, plant_beta(paper_rig) / 1.1)
    scenarios = [base, mirrored(paper_rig, base), replace(base, noise=True, seed=1)]
    found, expected = both(loop, [design] * 3, scenarios)
    for one, other in zip(found, expected, strict=True):
        assert_agree(one, other)


# --- sensitivities -------------------------------------------------------------------------

DIRECTIONS = {
    1: np.array([[1.0], [0], [1], [0]]),
    2: np.array([[1.0, 0], [0, 1], [1, 0], [0, 1]]),
    4: np.eye(4),
}
CARRIED = [("tan-gpi", "tustin", 0.0), ("tan-gpi", None, 0.0), ("tan-gpi", "zoh", 1.7)]
CARRIED += [("fee-gpi", "euler", 0.3), ("state-feedback", "zoh", 0.0)]
CARRIED += [("bumpless lin-pid", "tustin", 0.0), ("lin-pid of the measurement", None, 0.0)]


@pytest.mark.parametrize("directions", DIRECTIONS)
@pytest.mark.parametrize(("name", "method", "share"), CARRIED)
def test_the_gradients_agree(
    name: str, method: Method | None, share: float, directions: int
) -> None:
    rig, design = designed(name, method, share=share)
    options: dict[str, Any] = {"controller": LAWS[name], "fastest": 0.0 if method else 150.0}
    loop = build(rig, method, directions=directions, **options)
    sensitivities = pole_sensitivities(loop, design, DIRECTIONS[directions])
    scenarios = some_scenarios(rig)
    found, expected = both(
        loop, [design] * len(scenarios), scenarios, [sensitivities] * len(scenarios)
    )
    plain = simulate_batch(
        build(rig, method, **options), [design] * len(scenarios), scenarios, backend="compiled"
    )
    for one, other, bare in zip(found, expected, plain, strict=True):
        assert_agree(one, other)
        assert all(g.shape == (directions,) for g in one.gradients.values())
        assert not bare.gradients
        assert_agree(Summary(one.metrics, one.total_variation, {}), bare)
    for figure in (*INTEGRALS, "peak_voltage", "min_voltage"):
        assert found[0].gradients[figure].any()


def test_every_loop_has_its_own_design_and_sensitivities() -> None:
    rig, _ = designed()
    loop = build(rig, "tustin", directions=2)
    pairs = [PoleSpec.double(0.8 + 0.1 * n, 45.0 + 3 * n) for n in range(6)]
    designs = [make_design(rig, pair) for pair in pairs]
    scenarios = some_scenarios(rig)
    sensitivities = [(1 + n) * np.ones((4, 2)) for n in range(6)]
    own = [pole_sensitivities(loop, d, t) for d, t in zip(designs, sensitivities, strict=True)]
    found, expected = both(loop, designs, scenarios, own)
    for one, other in zip(found, expected, strict=True):
        assert_agree(one, other)
    assert len({s.gradients["itae"][0] for s in found}) == 6


def test_without_sensitivities_a_carrying_loop_has_gradients_of_zero() -> None:
    rig, design = designed()
    loop = build(rig, "tustin", directions=2)
    for found in both(loop, [design], [nominal_scenario(rig, plant_beta(rig))]):
        assert all(not slopes.any() for slopes in found[0].gradients.values())


# --- one by one or together ----------------------------------------------------------------


def many(rig: Rig, count: int) -> list[Scenario]:
    some = some_scenarios(rig)
    rng = np.random.default_rng(5)
    return [
        replace(
            some[n % len(some)],
            beta_plant=some[n % len(some)].beta_plant * float(rng.uniform(0.9, 1.1)),
            initial_gap=float(rng.uniform(0.0238, 0.0250)),
            index=n,
        )
        for n in range(count)
    ]


@pytest.mark.parametrize("directions", [0, 2])
@pytest.mark.parametrize("method", ["tustin", None])
def test_nothing_depends_on_company_order_or_threads(
    method: Method | None, directions: int
) -> None:
    rig, design = designed(method=method)
    loop = build(rig, method, directions=directions, fastest=0.0 if method else 250.0)
    columns = DIRECTIONS[2]
    sensitivities = [pole_sensitivities(loop, design, columns)] if directions else None
    scenarios = many(rig, 23)
    count = len(scenarios)

    def run(chosen: Sequence[int], threads: int = 1) -> list[Summary]:
        own = None if sensitivities is None else sensitivities * len(chosen)
        picked = [scenarios[n] for n in chosen]
        return simulate_batch(
            loop, [design] * len(chosen), picked, own, threads=threads, backend="compiled"
        )

    together = run(range(count))
    for threads in (2, 3, 64):
        assert same_bits(run(range(count), threads), together)
    assert same_bits(run(range(count)[::-1])[::-1], together)
    for size in (2, 3, 4, 5, 9):
        apart = [
            s for k in range(0, count, size) for s in run([*range(count)[k : k + size], 0])[:-1]
        ]
        assert same_bits(apart, together), size
    shuffled = np.random.default_rng(1).permutation(count)
    assert same_bits([run(shuffled.tolist())[k] for k in np.argsort(shuffled)[:3]], together[:3])


@pytest.fixture
def lanes_of(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int], None]]:
    """Yield what sets another width; kernels are kept by their loop alone."""

    def wide(count: int) -> None:
        monkeypatch.setattr(lanes, "LANES", count)
        compiled.looked_for.cache_clear()

    yield wide
    monkeypatch.undo()
    compiled.looked_for.cache_clear()


@pytest.mark.parametrize("count", [1, 2, 8])
def test_the_width_of_the_lanes_changes_rounding_alone(
    count: int, lanes_of: Callable[[int], None]
) -> None:
    rig, design = designed()
    loop = build(rig, "tustin", directions=2)
    sensitivities, scenarios = pole_sensitivities(loop, design, DIRECTIONS[2]), many(rig, 7)
    arguments: Any = (loop, [design] * 7, scenarios, [sensitivities] * 7)
    expected = simulate_batch(*arguments, backend="compiled")
    lanes_of(count)
    for one, other in zip(simulate_batch(*arguments, backend="compiled"), expected, strict=True):
        assert_agree(one, other)


def test_a_single_loop_is_one_of_many() -> None:
    rig, design = designed()
    loop, scenarios = build(rig, "tustin"), many(rig, 5)
    together = simulate_batch(loop, [design] * 5, scenarios, backend="compiled")
    for scenario, expected in zip(scenarios, together, strict=True):
        (alone,) = simulate_batch(loop, [design], [scenario], backend="compiled")
        assert_agree(alone, expected)


def test_there_is_a_core() -> None:
    assert cores() >= 1


# --- the same as simulate ------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["auto", "compiled", "interpreted"])
def test_a_batch_is_simulate_in_a_row(backend: Any) -> None:
    rig, design = designed()
    loop, scenarios = build(rig, "tustin"), some_scenarios(rig)
    found = simulate_batch(loop, [design] * len(scenarios), scenarios, backend=backend)
    for one, scenario in zip(found, scenarios, strict=True):
        response = simulate(loop, design, scenario)
        variation = total_variation(response)
        assert_agree(one, Summary(response.metrics, variation, response.gradients))


@pytest.mark.parametrize("noise", [False, True], ids=["quiet", "noise"])
@pytest.mark.parametrize("share", [0.0, 1.3])
@pytest.mark.parametrize("method", ["tustin", None])
def test_the_trace_is_the_response(method: Method | None, share: float, noise: bool) -> None:
    rig, design = designed(method=method, share=share if method else 0.0, base=OFFSET)
    loop = loop_for(rig, design, continuous=method is None)
    start = nominal_scenario(rig, plant_beta(rig))
    scenario = replace(start, noise=noise, seed=4, index=1)
    kernel = compiled.kernel(loop)
    assert kernel is not None
    figures, trace = compiled.run(
        loop,
        kernel,
        start_state(loop, design, scenario, first_noise(loop, scenario))[None],
        parameter_vector(loop, design, scenario)[None],
        np.array([[scenario.seed, scenario.index]], dtype=np.uint32),
        np.array([scenario.deviations(rig)]),
        noisy=noise,
        trace=True,
    )
    response = simulate(loop, design, scenario)
    assert_agree(
        summaries(loop, figures)[0], Summary(response.metrics, total_variation(response), {})
    )
    (rows,) = trace
    expected = (response.gap[1:], response.velocity[1:], response.commanded, response.applied)
    for column, curve in zip(rows.T, expected, strict=True):
        assert column == pytest.approx(curve, abs=AGREE * float(np.abs(curve).max()))


@pytest.mark.parametrize("drop", [False, True], ids=["held", "dropped"])
@pytest.mark.parametrize("method", ["tustin", None])
def test_one_compiled_response_is_the_interpreted_one(method: Method | None, drop: bool) -> None:
    rig, design = designed(method=method, base=OFFSET)
    loop = loop_for(rig, design, continuous=method is None)
    scenario = nominal_scenario(rig, plant_beta(rig))
    if drop:
        scenario = replace(scenario, initial_velocity=3.0)
    expected, found = simulate(loop, design, scenario), respond(loop, design, scenario)
    assert (expected.metrics.crash is not None) == drop
    variation = total_variation(expected)
    assert_agree(Summary(found.metrics, variation, {}), Summary(expected.metrics, variation, {}))
    for name in ("times", "gap", "velocity", "reference", "commanded", "applied"):
        curve = getattr(expected, name)
        size = float(np.abs(curve).max())
        assert getattr(found, name) == pytest.approx(curve, abs=AGREE * size), name


def test_a_response_that_takes_a_compiler_long_is_interpreted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(compiled, "kernel", lambda *_: pytest.fail("compiled"))
    rig, design = designed(base=OFFSET)
    loop = build(rig, "tustin", refine=20)
    scenario = nominal_scenario(rig, plant_beta(rig))
    assert respond(loop, design, scenario).metrics == simulate(loop, design, scenario).metrics


# --- what is refused -----------------------------------------------------------------------


def test_no_loops_no_summaries() -> None:
    rig, _ = designed()
    assert simulate_batch(build(rig, "tustin"), [], []) == []


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
def test_a_scenario_too_many_is_refused(backend: Any) -> None:
    rig, design = designed()
    scenario = nominal_scenario(rig, plant_beta(rig))
    with pytest.raises(ValueError, match="zip"):
        simulate_batch(build(rig, "tustin"), [design], [scenario] * 2, backend=backend)


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
def test_a_design_of_another_controller_is_refused(backend: Any) -> None:
    rig, design = designed("fee-gpi")
    scenario = nominal_scenario(rig, plant_beta(rig))
    with pytest.raises(ValueError, match="cannot run"):
        simulate_batch(build(rig, "tustin"), [design], [scenario], backend=backend)
