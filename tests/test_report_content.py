"""What a report is made of: the content model, numbers and units, escaping, the commands."""

from __future__ import annotations

import shlex
import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from records import HOSTILE, tuned
from rigs import SHORT, rig_with

from maglev_design.options import DEFAULT_PRESET
from maglev_design.record import DesignRecord, rig_as_data
from maglev_design.reporting.chapter_emulated import emulated_chapter
from maglev_design.reporting.chapters_result import summary_chapter, worst_chapter
from maglev_design.reporting.chapters_theory import routh_chapter
from maglev_design.reporting.commands import design_command, rig_toml
from maglev_design.reporting.content import (
    Figure,
    Formula,
    Quantity,
    Report,
    ReportSection,
    Table,
)
from maglev_design.reporting.derivation_steps import _read, derivation_steps
from maglev_design.reporting.escape import latex_text, markdown_code, markdown_text, one_line
from maglev_design.reporting.words import number_latex, number_text, unit_latex, unit_text
from maglev_design.rig import load_rig, make_rig


def table(name: str, rows: int = 1) -> Table:
    return Table(name, ("c",), (("a",), ("b",)), ((("1",), ("2",)),) * rows, "make", "lr")


def test_labels_count_tables_and_figures_apart_in_their_order() -> None:
    figure = Figure("picture", ("c",), "make")
    first = ReportSection("one", (table("x"), figure, Formula((("a", "= b"),), "25")))
    report = Report("t", "s", (first, ReportSection("two", (table("y"),), 2)))
    assert report.labels == {"x": "Table 1", "picture": "Figure 1", "25": "(25)", "y": "Table 2"}
    assert report.figures() == (figure,)


def test_two_blocks_of_one_name_and_ragged_tables_are_refused() -> None:
    with pytest.raises(ValueError, match="two blocks"):
        Report("t", "s", (ReportSection("one", (table("x"), table("x"))),))
    with pytest.raises(ValueError, match="different lengths"):
        Table("x", (), (("a",),), ((("1",), ("2",)),), "make", "l")


@pytest.mark.parametrize(
    ("value", "unit", "digits", "text", "latex"),
    [
        (0.012, "m", 4, "0.012 m", r"$0.012\,\mathrm{m}$"),
        (-1.5e-9, "m s^2", 4, "−1.5 × 10⁻⁹ m s²", r"$-1.5 \times 10^{-9}\,\mathrm{m\,s^{2}}$"),
        (1.25e10, "-", 2, "1.2 × 10¹⁰", r"$1.2 \times 10^{10}$"),
        (3, "-", 4, "3", "$3$"),
        (None, "V", 4, "none", "none"),
    ],
)
def test_numbers_with_units(
    value: float | None, unit: str, digits: int, text: str, latex: str
) -> None:
    assert number_text(value, unit, digits) == text
    assert number_latex(value, unit, digits) == latex


def test_units() -> None:
    assert unit_text("m^3/(s^2 V^2)") == "m³/(s² V²)"
    assert unit_latex("m^3/(s^2 V^2)") == r"\mathrm{m^{3}/(s^{2}\,V^{2})}"
    assert unit_text("1/s^(n-4)") == "1/sⁿ⁻⁴"
    assert unit_text("ohm") == "Ω"
    assert unit_latex("%") == r"\mathrm{\%}"


def test_latex_has_no_active_sign_of_the_user_left() -> None:
    escaped = latex_text(one_line(HOSTILE))
    assert escaped.isascii()
    assert r"\input" not in escaped
    assert r"\end" not in escaped
    assert r"\'{e}" in escaped
    assert "[U+7403]" in escaped


def test_markdown_takes_none_of_it_for_markup() -> None:
    escaped = markdown_text("<b> `c` *d* [e](f) | $g$ ![h](i) ~~j~~ &amp;")
    assert escaped == (r"\<b\> \`c\` \*d\* \[e\](f) \| \$g\$ \!\[h\](i) \~\~j\~\~ \&amp;")
    assert markdown_text("1. one") == r"1\. one"
    assert markdown_text("- one") == r"\- one"
    assert markdown_code("a`b``c") == "```a`b``c```"


def with_document(record: DesignRecord, **changes: Any) -> DesignRecord:
    return DesignRecord(record.rig, record.design, {**record.document, **changes}, record.curves)


def test_the_command_names_every_choice_that_is_no_default() -> None:
    record = tuned()
    assert design_command(record) == "maglev-design tune --rig rig.toml --pareto -o design"
    plain = with_document(record, pareto=None)
    assert design_command(plain) == "maglev-design tune --rig rig.toml -o design"
    changed = with_document(
        record,
        objective="ise",
        equilibrium="measured",
        method="euler",
        beta_error_given=0.25,
        scenarios="robust",
        seed=3,
        poles=[[1.0, 70.0], [0.9, 80.0]],
        bounds={"zeta": [0.5, 2.0], "omega_n": [20.0, 300.5]},
        constraints=[
            {"name": "Ms", "limit": 1.8},
            {"name": "noise voltage", "limit": 0.125},
            {"name": "Lyapunov certificate", "limit": 1.0},
        ],
    )
    words = design_command(changed)
    for option in (
        "--objective ise",
        "--equilibrium measured",
        "--method euler",
        "--beta-error 0.25",
        "--max-ms 1.8",
        "--max-noise-voltage 0.125",
        "--scenarios robust",
        "--poles distinct",
        "--seed 3",
        "--allow-saturation",
        "--certify",
        "--zeta-bounds 0.5 2",
        "--omega-bounds 20 300.5",
    ):
        assert option in words


def test_a_preset_is_named() -> None:
    rig = load_rig(DEFAULT_PRESET)
    record = tuned()
    own = DesignRecord(rig, record.design, {**record.document, "rig": rig_as_data(rig)}, {})
    assert f"--rig {DEFAULT_PRESET}" in design_command(own)


def test_the_rig_file_of_a_report_reads_back_as_the_rig() -> None:
    rig = rig_with(
        SHORT,
        {
            "name": HOSTILE[:200],
            "notes": HOSTILE + "\x7f\t\x01",
            "limits.voltage": [0.0, float("inf")],
            "uncertainty": {
                "beta": 0.1,
                "mass": {"distribution": "normal", "mean": 0.02, "deviation": 1e-4},
                "initial_gap": [0.024, 0.0245],
            },
        },
    )
    text = rig_toml(rig_as_data(rig))
    assert make_rig(tomllib.loads(text), "again") == rig


def test_the_derivation_is_whole() -> None:
    found = derivation_steps()
    assert derivation_steps() == found
    assert {step.residual for step in found.steps} == {"0", None}
    assert len({step.id for step in found.steps}) == len(found.steps) > 40
    assert [power for power, _ in found.routh] == ["s^4", "s^3", "s^2", "s^1", "s^0"]
    assert found.routh[2][1] == (r"\frac{a_3 a_2 - a_1}{a_3}", "a_0")


@pytest.mark.parametrize("text", ["{}", '{"steps": [{}], "symbols": [], "routh": []}', "[]"])
def test_what_is_no_derivation_is_made_anew(text: str) -> None:
    with pytest.raises(ValueError, match="not a derivation"):
        _read(text)


def test_the_routh_table_has_the_array_of_the_designed_polynomial_first() -> None:
    record = tuned()
    (zeta, omega_n), _ = record.design.poles.first, record.design.poles.second
    pair = np.polymul([1, 2 * zeta * omega_n, omega_n**2], [1, 2 * zeta * omega_n, omega_n**2])
    _, a3, a2, a1, a0 = pair
    b1 = (a3 * a2 - a1) / a3
    section = routh_chapter(record, derivation_steps())
    (routh,) = [b for b in section.blocks if isinstance(b, Table) and b.id == "routh"]
    designed, *corners = routh.rows
    shown = [cell[0].value for cell in designed[2:7] if isinstance(cell[0], Quantity)]
    assert shown == pytest.approx([1, a3, b1, (b1 * a1 - a3 * a0) / b1, a0])
    assert len(corners) == 4
    assert {row[-1] for row in routh.rows} == {("yes",)}


def test_what_becomes_of_the_design_on_the_emulated_rig_is_told() -> None:
    record = tuned()
    assert emulated_chapter(with_document(record, emulated=None)) is None
    part: dict[str, Any] = {
        "ratio": 1.0,
        "seeds": 4,
        "lost": 0,
        "itae": {"median": 2e-4, "low": 1e-4, "high": 3e-4},
        "total_variation": {"median": 9.0},
    }
    own = part | {"worst": part, "effects": ["delay 1 ms"], "period": 0.002, "baseline": None}
    for found, words in (
        (own, "Every ball levitates"),
        (own | {"lost": 2}, "the ball is lost"),
    ):
        chapter = emulated_chapter(with_document(record, emulated=found))
        assert chapter is not None
        text = repr(chapter)
        assert words in text
        assert "delay 1 ms" in text
        summary = repr(summary_chapter(with_document(record, emulated=found)))
        assert ("the ball is lost" in summary) == bool(found["lost"])


def as_judged(record: DesignRecord, **more: Any) -> DesignRecord:
    return with_document(record, status="judged", message="judged", alternatives=[], **more)


def test_a_design_that_was_given_is_not_called_the_best_nor_tuned() -> None:
    record = tuned()
    whole = str(summary_chapter(record))
    assert "the smallest" in whole
    for status in ("judged", "interrupted", "infeasible"):
        assert "the smallest" not in str(summary_chapter(with_document(record, status=status)))
    told = str(worst_chapter(as_judged(record)))
    assert "given, nominal" in told
    assert "tuned, nominal" not in told


def test_the_command_of_a_given_design_gives_it_again() -> None:
    record = tuned()
    words = shlex.split(design_command(as_judged(record)))
    assert words[:2] == ["maglev-design", "design"]
    zeta, omega_n = record.design.poles.first
    assert float(words[words.index("--zeta") + 1]) == zeta
    assert float(words[words.index("--omega-n") + 1]) == omega_n
    gains = (1e7, 1.1e6, 3.1e4, 270.0)
    other = replace(as_judged(record), design=replace(record.design, gains=gains))
    words = shlex.split(design_command(other))
    assert words[words.index("--gains") + 1] == "k0=10000000.0,k1=1100000.0,k2=31000.0,k3=270.0"


def test_a_yardstick_that_is_better_is_said_to_be() -> None:
    record = tuned()
    base = {
        "zeta": 0.9,
        "omega_n": 60.0,
        "improvement": 0.5,
        "feasible": True,
        "violated": [],
        "worst_case": record.document["worst_case"],
    }
    changed = with_document(record, baseline=base)
    assert "times larger than" in str(summary_chapter(changed))
    assert "--baseline 0.9 60" in design_command(changed)
