"""The comparison of controllers as tables and as markdown, from its saved document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from maglev_design.figures import DESCRIBED, INDICES, MARGINS, PARTS
from maglev_design.reporting.escape import markdown_code, markdown_line
from maglev_design.reporting.words import headed

COLUMNS = (
    *((headed(index), index) for index in INDICES),
    ("peak u [V]", "peak_voltage"),
    ("TV u [V]", "total_variation"),
    ("settling [s]", "settling"),
    ("undershoot", "undershoot"),
)
FACTOR_NAMES = {
    "variant": "variant of the PID",
    "equilibrium": "equilibrium reading",
    "discretisation": "discretisation",
    "sample_time": "sampling period",
    "initial_error": "sign of e(0)",
    "position_noise": "sensor noise",
    "": "nothing",
}


@dataclass(frozen=True)
class TextTable:
    """A table of text: title, column heads, rows, and how many columns hold words."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int = 1


def short(value: float | None, digits: int = 3) -> str:
    """Return a number in few characters; a dash for what never happened."""
    return "-" if value is None else f"{value:.{digits}g}"


def named(result: Mapping[str, Any]) -> str:
    """Return a controller with its variant; a star says that its reading is a guess."""
    label = result["label"] + ("*" if result["guess"] else "")
    return label if result["variant"] == "default" else f"{label}, {result['variant']}"


def result_tables(document: Mapping[str, Any]) -> tuple[TextTable, ...]:
    """Return one table for each test; a star marks a controller whose reading is a guess."""
    several = len({(r["method"], r["equilibrium"]) for r in document["results"]}) > 1
    tables = []
    for trial in document["tests"]:
        rows = [r for r in document["results"] if r["test"] == trial["name"]]
        lines = [
            (
                named(r) + (f", {r['method'] or 'continuous'}" if several else ""),
                *(short(r[key]) for _, key in COLUMNS),
            )
            for r in rows
        ]
        seeds = max(r["seeds"] for r in rows)
        title = trial["title"] + (f": median of {seeds} seeds" if seeds > 1 else "")
        head = ("controller", *(name for name, _ in COLUMNS))
        tables.append(TextTable(title, head, tuple(lines)))
    return tuple(tables)


def margin_table(document: Mapping[str, Any]) -> TextTable:
    """Return the margins of every sampled loop; a dash where the loop is unstable."""
    several = len({m["method"] for m in document["margins"]}) > 1
    rows = [
        (
            named(m) + (f", {m['method']}" if several else ""),
            short(m["ms"]["value"]),
            short(m["ms_one_more_sample"]),
            *(short(_scaled(m[key]["value"], DESCRIBED[key].scale)) for key in MARGINS),
        )
        for m in document["margins"]
    ]
    margins = ("gain up", "gain down", "phase [deg]", "delay [ms]")
    head = ("controller", "Ms", "Ms, +1 sample", *margins)
    title = "Margins of the sampled loop, worst over the path and the rig's uncertainty of beta"
    return TextTable(title, head, tuple(rows))


def _scaled(value: float | None, scale: float) -> float | None:
    return None if value is None else scale * value


def spread_table(document: Mapping[str, Any]) -> TextTable:
    """Return the 95 % intervals of the indices where noise enters."""
    rows = [
        (
            named(r),
            r["test"],
            *(
                f"{short(r['spread'][k]['low'])} to {short(r['spread'][k]['high'])}"
                for k in INDICES
            ),
        )
        for r in document["results"]
        if r["spread"]
    ]
    head = ("controller", "test", *map(headed, INDICES))
    return TextTable("95 % of the seeds lie in", head, tuple(rows), words=2)


def ordering_table(document: Mapping[str, Any], trial: Mapping[str, Any]) -> TextTable:
    """Return for one test in how many readings TAN-GPI has the smaller figure."""
    rows = [
        (
            o["name"],
            o["than"],
            f"{o['stated_held']} of {o['stated_readings']}",
            FACTOR_NAMES[o["stated_decided_by"]] if o["stated_outcome"] == "depends" else "-",
            f"{o['held']} of {o['readings']}",
            FACTOR_NAMES[o["decided_by"]] if o["outcome"] == "depends" else "-",
        )
        for o in document["orderings"]
        if o["test"] == trial["name"]
    ]
    head = ("TAN-GPI has the smaller", "than", "as stated", "decided by", "all", "decided by")
    return TextTable(trial["title"], head, tuple(rows), words=2)


def headline(document: Mapping[str, Any]) -> str | None:
    """Return what the tuned poles bring in each test, the emulated rig included, in a sentence.

    None where the tuned design is not among the results.
    """
    parts = []
    for trial in document["tests"]:
        found = {
            r["label"]: r
            for r in reversed(document["results"])
            if r["test"] == trial["name"] and r["variant"] == "default"
        }
        tuned, paper = found.get("TAN-GPI tuned"), found.get("TAN-GPI")
        if tuned is None or paper is None:
            continue
        lost = [name for name, r in (("tuned", tuned), ("paper's", paper)) if r["crashed_share"]]
        if lost:
            parts.append(f"{trial['title']}: balls lost ({', '.join(lost)})")
            continue
        gain, effort = (tuned[key] / paper[key] for key in ("itae", "total_variation"))
        change = f"{1 / gain:.3g} times smaller" if gain < 1 else f"{gain:.3g} times larger"
        parts.append(
            f"{trial['title']}: ITAE {change}, with {effort:.3g} times the voltage variation"
        )
    if not parts:
        return None
    return f"The tuned poles against the paper's, TAN-GPI both. {'; '.join(parts)}."


def guesses(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return one sentence for each controller whose reading is a guess."""
    found = {r["label"]: r["guess"] for r in document["results"] if r["guess"]}
    return tuple(f"{label}* is a guess: {text}." for label, text in found.items())


SPLIT_HEADER = ("controller", "index", *PARTS)


def split_table(document: Mapping[str, Any]) -> TextTable:
    """Return which part of the nominal move each index is made of, in per cent."""
    rows = []
    for r in document["results"]:
        if r["test"] != "nominal":
            continue
        for index in INDICES:
            parts = r[f"{index}_split"]
            whole = sum(parts.values())
            shares = (f"{100 * parts[p] / whole:.3g} %" if whole else "-" for p in parts)
            rows.append((named(r), index.upper(), *shares))
    return TextTable("What the indices rank (nominal test)", SPLIT_HEADER, tuple(rows), words=2)


def markdown(document: Mapping[str, Any], command: str, figures: Sequence[str]) -> str:
    """Return the comparison as a markdown page.

    Parameters
    ----------
    document : mapping
        As ``comparison.json`` holds it.
    command : str
        What makes the page again.
    figures : sequence of str
        File names of the figures beside the page.
    """
    lines = [
        "# The paper's section 4 again",
        "",
        f"Rig: {markdown_line(document['rig']['name'])}. Made by {markdown_code(command)}; every "
        "number on this page is that run's.",
        "",
        "TAN-GPI is the paper's law (20); the poles are its zeta = 1, omega_n = 70 rad/s, but for "
        "the tuned one. Commanded voltages are before the clamp, the total variation (TV) is of "
        "the applied one; settling is to 2 % of the initial error before the move, undershoot a "
        "share of it.",
        "",
        *((f"**{markdown_line(told)}**", "") if (told := headline(document)) else ()),
        *(f"- {text}" for text in guesses(document)),
        "",
        "## Results",
        "",
    ]
    tables = (*result_tables(document), spread_table(document), split_table(document))
    for table in (*tables, margin_table(document)):
        if table.rows:
            lines += [*pipes(table), ""]
    if document["orderings"]:
        lines += [
            "## Which orderings survive",
            "",
            "Every combination of what the paper leaves open was run: variant of the PID, "
            "equilibrium reading, continuous or one of three discretisations. *As stated* keeps "
            "the period, the start and the noise that the paper states; *all* also varies the "
            "period (1 and 2 ms), the sign of the initial error and the sensor's noise. One seed "
            "each.",
            "",
        ]
        for trial in document["tests"]:
            table = ordering_table(document, trial)
            if table.rows:
                lines += [*pipes(table), ""]
    lines += ["## Figures", ""]
    for name in figures:
        lines += [f"![{CAPTIONS.get(name, name)}]({name})", "", f"*{CAPTIONS.get(name, name)}*", ""]
    return "\n".join(lines).rstrip() + "\n"


CAPTIONS = {
    f"figure_{number:02}.svg": f"Counterpart of Fig. {number}: {what}, {test}."
    for first, test in ((3, "test 1"), (6, "test 2"), (9, "test 3"), (15, "emulated rig"))
    for number, what in ((first, "gap"), (first + 1, "tracking error"), (first + 2, "voltage"))
} | {
    "figure_12.svg": "Counterpart of Fig. 12: ISE, IAE and ITAE in the three tests.",
    "figure_18.svg": "Counterpart of Fig. 18 on the emulated rig: ISE, IAE and ITAE.",
}


def pipes(table: TextTable) -> list[str]:
    """Return a table in markdown."""
    return [
        f"**{markdown_line(table.title)}**",
        "",
        "| " + " | ".join(table.header) + " |",
        "|"
        + "|".join(" --- " if n < table.words else " ---: " for n in range(len(table.header)))
        + "|",
        *("| " + " | ".join(markdown_line(cell) for cell in row) + " |" for row in table.rows),
    ]
