"""The interactive figure: the page's numbers against Python's, in Node and in a browser."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import dom, node, screenshot
from records import chosen, tuned
from rigs import OFFSET, SHORT, rig_with

from maglev_design.controller.design import PoleSpec, believed_equilibrium, make_design
from maglev_design.controller.family import Family
from maglev_design.files import finite
from maglev_design.linear_loop import build_loop, peak_sensitivity
from maglev_design.options import Equilibrium, Method
from maglev_design.record import DesignRecord
from maglev_design.reporting.explorer import explorer_data, javascript, programs_of
from maglev_design.reporting.templates import text_of
from maglev_design.reporting.write import write_report
from maglev_design.rig import Rig
from maglev_design.simulation import Response, Scenario, simulate
from maglev_design.simulation.response import loop_for

SAME = 1e-9
"""The page adds up the reference's instants and the metrics in another order; e is a difference."""
ROOTS = 1e-5
"""Roots that lie close together: a share of their distance is lost by both methods."""
SCREEN = (1000, 1400)


def in_script(record: DesignRecord, settings: dict[str, float]) -> Any:
    """Return what the page's script computes for some settings of its sliders."""
    data = json.dumps(finite(explorer_data(record)))
    program = javascript(programs_of(record))
    own = text_of("explorer.js")
    return node(
        f"const D = {data};\nconst P = {program};\n{own}\n"
        f"const {{ run, loops, known }} = computed({json.dumps(settings)});\n"
        "answer({ run, loops, known });"
    )


def in_python(record: DesignRecord, poles: PoleSpec, ratio: float) -> Response:
    rig, design = record.rig, record.design
    moved = make_design(rig, poles, equilibrium=design.equilibrium, method=design.method)
    beta = moved.beta_at(ratio)
    scenario = Scenario(beta, rig.initial.gap, rig.initial.velocity)
    return simulate(loop_for(rig, moved), moved, scenario)


def settings_of(poles: PoleSpec, ratio: float) -> dict[str, float]:
    names = ("zeta_1", "omega_1", "zeta_2", "omega_2")
    return dict(zip(names, poles.values, strict=True)) | {"ratio": ratio}


CASES: list[tuple[dict[str, Any], dict[str, Any], Method, Equilibrium]] = [
    (SHORT, {}, "tustin", "model"),
    (SHORT, {"sampling.delay": 0.0004, "operating_point.voltage": 2.05}, "euler", "appendix-a"),
    (
        SHORT,
        {"sampling.delay": 0.001, "reference.horizon": 0.3995, "operating_point.voltage": 2.0},
        "zoh",
        "measured",
    ),
    (SHORT, {"operating_point.voltage": 2.1, "limits": ...}, "tustin", "measured"),
    (OFFSET, {"sampling.delay": 0.0006}, "tustin", "model"),
]


@pytest.mark.parametrize(("base", "changes", "method", "equilibrium"), CASES)
def test_the_page_runs_the_loop_that_python_runs(
    base: dict[str, Any], changes: dict[str, Any], method: Method, equilibrium: Equilibrium
) -> None:
    record = chosen(rig_with(base, changes), PoleSpec.double(1.0, 70.0), method, equilibrium)
    poles, ratio = PoleSpec((0.9, 80.0), (1.2, 95.0)), 1.07
    found, wanted = in_script(record, settings_of(poles, ratio)), in_python(record, poles, ratio)
    run, metrics = found["run"], wanted.metrics
    np.testing.assert_allclose(run["t"], wanted.times, rtol=1e-14)
    np.testing.assert_allclose(run["y"], wanted.gap, rtol=SAME)
    np.testing.assert_allclose(run["commanded"], wanted.commanded, rtol=SAME)
    np.testing.assert_allclose(run["applied"], wanted.applied, rtol=SAME)
    for name in ("ise", "iae", "itae"):
        assert run[name] == pytest.approx(getattr(metrics, name), rel=1e-7), name
    assert run["peak"] == pytest.approx(metrics.peak_voltage, rel=SAME)
    assert run["least"] == pytest.approx(metrics.min_voltage, rel=SAME)
    assert run["alive"]


@pytest.mark.parametrize(("base", "changes", "method", "equilibrium"), CASES)
def test_the_page_has_the_poles_and_the_sensitivity_of_the_loop(
    base: dict[str, Any], changes: dict[str, Any], method: Method, equilibrium: Equilibrium
) -> None:
    rig: Rig = rig_with(base, changes)
    record = chosen(rig, PoleSpec.double(1.0, 70.0), method, equilibrium)
    poles, ratio = PoleSpec((0.9, 80.0), (1.2, 95.0)), 0.93
    loop = build_loop(rig, believed_equilibrium(rig, equilibrium), method=method)
    for at in in_script(record, settings_of(poles, ratio))["loops"]:
        closed, _ = loop.characteristic(poles.values, at["gap"], ratio)
        roots = np.roots(closed.full().ravel())
        shown = np.array([complex(*z) for z in at["z"]])
        assert len(shown) == len(roots) or abs(shown).min() < ROOTS
        for root in roots:
            assert abs(shown - root).min() < ROOTS
        point = Family((at["gap"], at["gap"]), (ratio, ratio))
        peak = peak_sensitivity(loop, poles.values, point)
        assert at["s"]["ms"] == pytest.approx(peak.value, rel=1e-6)


def test_a_lost_ball_is_lost_in_the_page_too() -> None:
    poles = PoleSpec.double(1.0, 70.0)
    record = chosen(rig_with(SHORT, {"initial.gap": 0.045, "initial.velocity": 1.0}), poles)
    wanted = in_python(record, poles, 1.0)
    run = in_script(record, settings_of(poles, 1.0))["run"]
    assert wanted.metrics.crashed
    assert not run["alive"]
    np.testing.assert_allclose(run["y"], wanted.gap, rtol=1e-6)
    assert run["peak"] == pytest.approx(wanted.metrics.peak_voltage, rel=1e-6)


def test_two_pairs_have_four_sliders_and_a_double_pair_two(short_rig: Rig) -> None:
    double = explorer_data(chosen(short_rig, PoleSpec.double(1.0, 70.0)))
    distinct = explorer_data(chosen(short_rig, PoleSpec((1.0, 70.0), (0.8, 90.0))))
    assert [s["id"] for s in double["sliders"]] == ["zeta", "omega_n", "ratio"]
    assert [s["id"] for s in distinct["sliders"]][:-1] == ["zeta_1", "omega_1", "zeta_2", "omega_2"]
    for slider in (*double["sliders"], *distinct["sliders"]):
        assert slider["low"] <= slider["value"] <= slider["high"]


# --- in the browser ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    (path,) = write_report(tuned(), folder, ["html"])
    return path


def shown(document: str) -> dict[str, float]:
    """Return every number that the page's script wrote, by its id."""
    outputs = re.findall(r'<output id="([\w-]+)" data-value="([^"]*)"', document)
    return {name: float(value) for name, value in outputs}


def drawn(document: str, plot: str) -> list[str]:
    """Return the curves of one chart that follow the sliders."""
    (chart,) = re.findall(rf'<svg id="plot-{plot}".*?</svg>', document, re.DOTALL)
    return re.findall(r'<path class="(?:curve|mark) now[^"]*" d="([^"]*)"', chart)


def agrees(found: dict[str, float], poles: PoleSpec, ratio: float) -> None:
    record = tuned()
    wanted = in_python(record, poles, ratio).metrics
    for name in ("ise", "iae", "itae"):
        assert found[name] == pytest.approx(getattr(wanted, name), rel=1e-7), name
    assert found["peak"] == pytest.approx(wanted.peak_voltage, rel=SAME)
    assert found["least"] == pytest.approx(wanted.min_voltage, rel=SAME)
    gains = make_design(record.rig, poles).gains
    assert [found[f"gain-k{n}"] for n in range(4)] == pytest.approx(gains, rel=1e-14)


def test_the_page_opens_at_the_design_and_a_moved_slider_moves_the_curves(page: Path) -> None:
    """A user's own event, and the address: numbers and curves follow both."""
    record = tuned()
    opened = dom(page)
    agrees(shown(opened), record.design.poles, 1.0)

    poles = PoleSpec.double(0.8, 66.0)
    addressed = dom(page, "zeta=0.8&omega_n=66&ratio=0.95&other=1")
    agrees(shown(addressed), poles, 0.95)
    assert shown(addressed)["itae"] != pytest.approx(shown(opened)["itae"], rel=1e-3)
    for plot in ("gap", "start", "rest", "voltage", "poles", "sensitivity"):
        assert drawn(opened, plot), plot
        assert drawn(addressed, plot) != drawn(opened, plot), plot

    moving = page.with_name("moved.html")
    slide = (
        "<script>const slider = document.getElementById('omega_n');"
        "slider.value = Math.log(80); slider.dispatchEvent(new Event('input'));</script></body>"
    )
    moving.write_text(page.read_text("utf-8").replace("</body>", slide), "utf-8")
    moved = dom(moving)
    (at,) = re.findall(r'id="omega_n"[^>]*data-value="([^"]*)"', moved)
    zeta = record.design.poles.first[0]
    assert float(at) == pytest.approx(80.0, rel=1e-3)
    agrees(shown(moved), PoleSpec.double(zeta, float(at)), 1.0)
    assert drawn(moved, "start") != drawn(opened, "start")


def test_the_page_is_drawn_light_and_dark(page: Path, tmp_path: Path) -> None:
    from PIL import Image  # noqa: PLC0415 - matplotlib brings it

    light, dark = (
        np.asarray(
            Image.open(screenshot(page, tmp_path / f"{n}.png", dark=bool(n))).convert("L"), int
        )
        for n in range(2)
    )
    assert light.shape == dark.shape == SCREEN[::-1]
    assert light[3, 3] > 240
    assert dark[3, 3] < 40
    for picture in (light, dark):
        assert np.ptp(picture) > 180  # something is written on it
