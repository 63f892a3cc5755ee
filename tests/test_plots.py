from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from recorded import recorded
from rigs import SHORT, rig_with

from maglev_design.controller.design import PoleSpec
from maglev_design.errors import InputError
from maglev_design.record import DesignRecord
from maglev_design.reporting.plots import design as plots
from maglev_design.reporting.plots.response import response_figure
from maglev_design.reporting.plots.style import house_style, save_figure
from maglev_design.tuning import TuneResult, build_problem, solve

UNIT = re.compile(r"\[(mm|µm|m s²|m s|m² s|s|V|rad/s|-)\]$")
DRAWINGS = ("tracking", "error", "voltage", "landscape")


@pytest.fixture(scope="module")
def record() -> DesignRecord:
    problem = build_problem(rig_with(SHORT, {"uncertainty.beta": 0.1, "sampling.period": 0.002}))
    result = solve(problem, baseline=PoleSpec.double(1, 70))
    assert isinstance(result, TuneResult)
    return recorded(result)


def draw(name: str, record: DesignRecord, document: dict[str, Any] | None = None) -> Figure:
    drawing = getattr(plots, name)(record.curves, document or record.document)
    assert isinstance(drawing, Figure)
    return drawing


def test_every_figure_is_written_twice_with_the_same_bytes(
    record: DesignRecord, tmp_path: Path
) -> None:
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        folder.mkdir()
    first, second = (plots.design_figures(record.curves, record.document, f) for f in folders)
    assert sorted(p.name for p in first) == sorted(f"{name}.svg" for name in DRAWINGS)
    for one, two in zip(first, second, strict=True):
        content = one.read_bytes()
        assert content == two.read_bytes(), one.name
        assert content.startswith(b"<?xml")
        assert len(content) > 5000
    assert sorted(p.name for p in folders[0].iterdir()) == sorted(p.name for p in first)


def test_the_trade_off_is_drawn_where_it_was_asked_for(
    record: DesignRecord, tmp_path: Path
) -> None:
    front = {"zeta": [1.0, 1.2], "omega_n": [60.0, 70.0], "objective": [2e-5, 1e-5]}
    front |= {"certified": [0.7, 0.6], "front": [1.0, 1.0]}
    curves = {**record.curves, **{f"pareto_{k}": np.array(v) for k, v in front.items()}}
    written = plots.design_figures(curves, record.document, tmp_path)
    assert {p.stem for p in written} == {*DRAWINGS, "trade_off"}
    drawn = plots.trade_off(curves, record.document)
    for axis in (drawn.axes[0].xaxis, drawn.axes[0].yaxis):
        assert re.search(r"\[(%|m s²)\]$", axis.get_label_text())


def test_a_record_without_a_landscape_gives_the_other_figures(
    record: DesignRecord, tmp_path: Path
) -> None:
    curves = {k: v for k, v in record.curves.items() if "landscape" not in k}
    written = plots.design_figures(curves, record.document, tmp_path)
    assert {p.stem for p in written} == {"tracking", "error", "voltage"}


@pytest.mark.parametrize("name", DRAWINGS)
def test_axes_have_units_in_their_labels(record: DesignRecord, name: str) -> None:
    figure = draw(name, record)
    labels = [
        label for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel()) if label
    ]
    assert len(labels) >= 2
    for label in labels:
        assert UNIT.search(label), label


@pytest.mark.parametrize("name", DRAWINGS)
def test_the_rig_is_named_in_every_figure(record: DesignRecord, name: str) -> None:
    document = copy.deepcopy(record.document)
    document["rig"]["name"] = "Rig 7"
    texts = [text.get_text() for text in draw(name, record, document).findobj(Text)]
    assert any("Rig 7" in text for text in texts)


@pytest.mark.parametrize(
    "name", ["$\\frac{", "$$", "$", "\\", "a_b^c {", "$x$ \\input{y}", "%s \n two lines", "</svg>"]
)
def test_hostile_rig_names_are_text(record: DesignRecord, tmp_path: Path, name: str) -> None:
    document = copy.deepcopy(record.document)
    document["rig"]["name"] = name
    figure = draw("tracking", record, document)
    for end in (".png", ".svg"):
        assert save_figure(figure, tmp_path / f"a{end}").stat().st_size > 5000


def test_a_dollar_sign_is_drawn_and_not_interpreted(record: DesignRecord) -> None:
    document = copy.deepcopy(record.document)
    document["rig"]["name"] = "$x$"
    title: Any = draw("tracking", record, document).axes[0].title
    parsed, is_mathematics = title._preprocess_math(title.get_text())
    assert parsed.endswith("$x$")
    assert not is_mathematics


def test_the_curves_drawn_are_those_of_the_record(record: DesignRecord) -> None:
    lines = draw("tracking", record).axes[0].get_lines()
    drawn = [np.asarray(line.get_ydata()) for line in lines]
    for name in ("baseline_gap", "worst_gap", "reference"):
        assert any(np.array_equal(1e3 * record.curves[name], one) for one in drawn), name
    assert np.array_equal(lines[0].get_xdata(), record.curves["times"])


def test_the_tuned_poles_are_marked_in_the_landscape(record: DesignRecord) -> None:
    zeta, omega_n = record.document["poles"][0]
    marks = {
        (float(x), float(y))
        for line in draw("landscape", record).axes[0].get_lines()
        for x, y in np.asarray(line.get_xydata(), dtype=float)
    }
    assert (omega_n, zeta) in marks
    assert (70.0, 1.0) in marks


def test_without_poles_to_compare_with_the_figures_show_the_design_alone(
    record: DesignRecord,
) -> None:
    document = {**record.document, "baseline": None}
    for name in DRAWINGS:
        lines = [len(axes.get_lines()) for axes in draw(name, record, document).axes]
        before = [len(axes.get_lines()) for axes in draw(name, record).axes]
        assert sum(lines) < sum(before), name


def test_a_lone_response_is_drawn_with_units(record: DesignRecord, tmp_path: Path) -> None:
    curves = {
        "times": record.curves["times"],
        "gap": record.curves["worst_gap"],
        "reference": record.curves["reference"],
        "commanded": record.curves["worst_commanded"],
        "applied": np.clip(record.curves["worst_commanded"], 0, 5),
    }
    figure = response_figure(curves, "$\\frac{")
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "gap [mm]",
        "error $e$ [µm]",
        "voltage [V]",
    ]
    assert save_figure(figure, tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")


def test_a_pdf_is_the_same_twice(record: DesignRecord, tmp_path: Path) -> None:
    with house_style():
        figures = [draw("tracking", record) for _ in range(2)]
        one, two = (save_figure(f, tmp_path / f"{n}.pdf") for n, f in enumerate(figures))
    assert one.read_bytes() == two.read_bytes()


@pytest.mark.parametrize("name", ["a.bmp", "a", "a.png.txt", ".png"])
def test_an_unknown_ending_is_an_input_error(
    record: DesignRecord, tmp_path: Path, name: str
) -> None:
    with pytest.raises(InputError, match=r"must end in \.png, \.svg, \.pdf"):
        save_figure(Figure(), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_capital_endings_are_known(tmp_path: Path) -> None:
    assert save_figure(Figure(), tmp_path / "a.PNG").read_bytes().startswith(b"\x89PNG")


def test_drawing_changes_no_global_setting(record: DesignRecord, tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    plots.design_figures(record.curves, record.document, tmp_path)
    assert dict(mpl.rcParams) == before


def test_the_style_is_undone_after_a_fault() -> None:
    before = dict(mpl.rcParams)
    inside: dict[str, Any] = {}

    def fail() -> None:
        inside.update(mpl.rcParams)
        raise RuntimeError

    with pytest.raises(RuntimeError), house_style():
        fail()
    assert inside != before
    assert dict(mpl.rcParams) == before
