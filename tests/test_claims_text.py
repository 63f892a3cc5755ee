"""The ledger and the comparison as text: complete, aligned, and safe from what a user wrote."""

from __future__ import annotations

from typing import Any

import pytest

from maglev_design.reporting import claims_text, comparison_text

HOSTILE = "a | b `c` <script>alert(1)</script> \\input{x} $x$ **bold** [l](u)"


def claim(identity: str, verdict: str, correction: str = "") -> dict[str, Any]:
    return {
        "id": identity,
        "place": "sec. 1",
        "statement": f"What {identity} says.",
        "verdict": verdict,
        "correction": correction,
        "evidence": "Because 1 < 2.",
        "command": "maglev-design claims",
        "values": {},
    }


DOCUMENT: dict[str, Any] = {
    "rig": {"name": HOSTILE},
    "rigs": 3,
    "claims": [
        claim("eq-1", "verified"),
        claim("eq-A1", "corrected", "u = U\nw = 0"),
        claim("4.1-x", "contradicted"),
        claim("5-y", "not-checkable"),
    ],
}


def test_the_page_has_every_claim_once_and_the_wrong_ones_first() -> None:
    page = claims_text.markdown(DOCUMENT, "maglev-design claims")
    for c in DOCUMENT["claims"]:
        assert page.count(f'<a id="{claims_text.anchor(c["id"])}"></a>') == 1
        assert page.count(f"(#{claims_text.anchor(c['id'])})") == 1
    order = [page.index(f"## {claims_text.SIGNS[v]}") for v in ("contradicted", "corrected")]
    assert order == sorted(order)
    assert "1 verified, 1 corrected, 1 contradicted, 1 not-checkable" in page
    assert "u = U\nw = 0" in page


def test_what_a_user_wrote_stays_text() -> None:
    page = claims_text.markdown(DOCUMENT, "maglev-design claims `rm`\n# head")
    assert "<script>" not in page.replace("\\<script\\>", "")
    assert "\n# head" not in page
    assert "\\`c\\`" in page


@pytest.mark.parametrize("verdict", claims_text.VERDICTS)
def test_a_claim_in_full_says_its_verdict(verdict: str) -> None:
    lines = claims_text.details(claim("x", verdict, "c"))
    assert any(verdict in line for line in lines)
    assert any("correct:" in line for line in lines)


def result(label: str, test: str, **changes: Any) -> dict[str, Any]:
    base: dict[str, Any] = {
        "test": test,
        "label": label,
        "variant": "default",
        "guess": "" if label == "TAN-GPI" else "who knows",
        "method": "tustin",
        "equilibrium": "model",
        "seeds": 1,
        "spread": {},
        "settling": None,
    }
    figures = {key: 1.5 for _, key in comparison_text.COLUMNS if key != "settling"}
    split = {f"{i}_split": {"start": 3.0, "move": 1.0, "hold": 0.0} for i in ("ise", "iae", "itae")}
    return {**base, **figures, **split, **changes}


COMPARISON: dict[str, Any] = {
    "rig": {"name": HOSTILE},
    "tests": [{"name": "nominal", "title": "Test 1"}, {"name": "noise", "title": "Test 2"}],
    "results": [
        result("TAN-GPI", "nominal"),
        result("LIN-PID", "nominal", variant="bumpless start"),
        result(
            "TAN-GPI",
            "noise",
            seeds=5,
            spread={k: {"low": 1.0, "high": 2.0} for k in ("ise", "iae", "itae")},
        ),
    ],
    "margins": [
        {
            "label": "TAN-GPI",
            "variant": "default",
            "guess": "",
            "method": "tustin",
            "ms_one_more_sample": None,
            **{
                name: {"value": 2.0, "gap": 0.01, "ratio": 1.0}
                for name in ("ms", "gain_up", "gain_down", "phase_deg")
            },
            "delay_s": {"value": 0.0015, "gap": 0.01, "ratio": 1.0},
        }
    ],
    "orderings": [
        {
            "test": "nominal",
            "figure": "itae",
            "name": "ITAE",
            "than": "LIN-PID",
            "stated_held": 1,
            "stated_readings": 2,
            "stated_outcome": "depends",
            "stated_decided_by": "variant",
            "held": 0,
            "readings": 4,
            "outcome": "never",
            "decided_by": "",
        }
    ],
}


def test_tables_name_guesses_seeds_and_what_never_happens() -> None:
    nominal, noise = comparison_text.result_tables(COMPARISON)
    assert [row[0] for row in nominal.rows] == ["TAN-GPI", "LIN-PID*, bumpless start"]
    assert "-" in nominal.rows[0]
    assert noise.title == "Test 2: median of 5 seeds"
    assert comparison_text.guesses(COMPARISON) == ("LIN-PID* is a guess: who knows.",)


def test_the_split_is_in_per_cent() -> None:
    rows = comparison_text.split_table(COMPARISON).rows
    assert rows[0] == ("TAN-GPI", "ISE", "75 %", "25 %", "0 %")


def test_margins_show_milliseconds_and_a_dash_for_an_unstable_loop() -> None:
    (row,) = comparison_text.margin_table(COMPARISON).rows
    assert row == ("TAN-GPI", "2", "-", "2", "2", "2", "1.5")


def test_an_ordering_says_on_what_it_depends() -> None:
    (row,) = comparison_text.ordering_table(COMPARISON, COMPARISON["tests"][0]).rows
    assert row == ("ITAE", "LIN-PID", "1 of 2", "variant of the PID", "0 of 4", "-")


def test_the_comparison_page_escapes_the_rig_and_shows_the_figures() -> None:
    page = comparison_text.markdown(COMPARISON, "maglev-design compare", ["figure_03.svg"])
    assert "<script>" not in page.replace("\\<script\\>", "")
    assert "(figure_03.svg)" in page
    assert "Counterpart of Fig. 3" in page
    widths = {line.count("|") - line.count("\\|") for line in page.splitlines() if line[:2] == "| "}
    assert widths == {9, 8, 7, 6}


def test_the_comparison_opens_with_both_stories() -> None:
    assert comparison_text.headline(COMPARISON) is None
    rows = [
        *COMPARISON["results"],
        result("TAN-GPI tuned", "nominal", itae=0.5, total_variation=3.0),
        result("TAN-GPI tuned", "noise", itae=3.0, total_variation=0.75),
    ]
    alive = [{**row, "crashed_share": 0.0} for row in rows]
    told = comparison_text.headline({**COMPARISON, "results": alive})
    assert told is not None
    assert "Test 1: ITAE 3 times smaller, with 2 times the voltage variation" in told
    assert "Test 2: ITAE 2 times larger, with 0.5 times the voltage variation" in told
    alive[-1]["crashed_share"] = 0.2
    told = comparison_text.headline({**COMPARISON, "results": alive})
    assert told is not None
    assert "Test 2: balls lost (tuned)" in told
