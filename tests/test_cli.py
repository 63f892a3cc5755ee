from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import reference

from maglev_design.rig import preset_names, preset_text

SLOW = 240
"""[s] A start costs seconds, more on a busy machine."""
SAME = 1e-9
"""The search and ``simulate`` halve their steps differently."""

METRICS = {
    "ise",
    "iae",
    "itae",
    "itae_split",
    "peak_voltage",
    "min_voltage",
    "peak_applied",
    "min_gap",
    "max_gap",
    "final_error",
    "crashed",
}
LOOP = {"ms", "ms_one_more_sample", "noise_voltage", "ratio"}
TUNE = {
    "schema_version",
    "status",
    "objective",
    "zeta",
    "omega_n",
    "poles",
    "gains",
    "difference_equation",
    "worst_case",
    "nominal",
    "baseline",
    "constraints",
    "verification",
    "alternatives",
    "evaluations",
}
HEAVY = ("numpy", "scipy", "sympy", "casadi", "control", "cvxpy", "matplotlib", "pydantic", "rich")

QUICK = """
name = "quick </script> $x$ \\u2028"
[plant]
mass = 0.02
gravity = 9.81
current_gain = 1.05
force_constant = 2.48315625e-5
[operating_point]
gap = 0.0246
[reference]
start_gap = 0.0242
end_gap = 0.0180
start_time = 0.05
end_time = 0.35
horizon = 0.4
[sampling]
period = {period}
[limits]
voltage = [0.0, {volts}]
gap = [0.001, 0.05]
[noise]
position = 1e-6
[uncertainty]
beta = 0.1
"""


def rig_file(folder: Path, *, period: float = 0.002, volts: float = 5.0) -> str:
    path = folder / "quick.toml"
    path.write_text(QUICK.format(period=period, volts=volts), "utf-8")
    return str(path)


def run(*arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(  # noqa: S603 - this interpreter, our own module
        [sys.executable, "-m", "maglev_design", *arguments],
        capture_output=True,
        encoding="utf-8",
        timeout=SLOW,
        check=False,
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == code, done.stderr
    if code:
        assert done.stderr.strip()
    return done


def document(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    def refuse(word: str) -> None:
        raise AssertionError(word)

    found = json.loads(done.stdout, parse_constant=refuse)
    assert isinstance(found, dict)
    assert next(iter(found)) == "schema_version"
    assert found["schema_version"] == 1
    return found


def contents(folder: Path) -> Mapping[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


# --- help and presets ----------------------------------------------------------------------


def test_help_names_every_verb_and_imports_nothing_heavy() -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "maglev_design", "--help"],
        capture_output=True,
        encoding="utf-8",
        timeout=SLOW,
        check=True,
    )
    for verb in ("presets", "derive", "simulate", "tune"):
        assert verb in done.stdout
    imported = {line.rpartition("|")[2].strip().split(".")[0] for line in done.stderr.splitlines()}
    assert "typer" in imported
    assert not imported & set(HEAVY)


def test_the_version_is_printed() -> None:
    from maglev_design import __version__  # noqa: PLC0415

    assert run("--version").stdout == f"maglev-design {__version__}\n"


def test_presets_are_listed_for_programs_and_shown_for_people() -> None:
    found = document(run("presets", "--json"))
    assert tuple(entry["name"] for entry in found["presets"]) == preset_names()
    assert all(entry["source"] for entry in found["presets"])
    assert run("presets", "show", "belmonte2021").stdout == preset_text("belmonte2021")


# --- simulate ------------------------------------------------------------------------------


def test_a_rig_file_of_a_presets_text_is_the_preset_with_the_known_figures(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(preset_text("belmonte2021"), "utf-8")
    csv, plot = tmp_path / "a.csv", tmp_path / "a.png"
    options = ("simulate", "--sample-time", "0", "--json")
    own = run(*options, "--rig", str(path), "--csv", str(csv), "--plot", str(plot))
    assert own.stdout == run(*options).stdout
    found = document(own)
    assert set(found) >= METRICS
    for name, value in reference.NOMINAL.items():
        digits = reference.NOMINAL_DIGITS[name]
        assert found[name] == pytest.approx(value, rel=0.6 * 10 ** (1 - digits))
    header, *rows = csv.read_text("utf-8").splitlines()
    assert header.split(",")[:2] == ["t [s]", "y [m]"]
    first, last = (rows[n].split(",") for n in (0, -1))
    assert (float(first[0]), float(first[1])) == (0.0, 0.0246)
    assert float(last[0]) == pytest.approx(7.0)
    assert float(last[1]) - float(last[3]) == pytest.approx(found["final_error"], abs=1e-15)
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_tables_go_to_stdout_and_prose_to_stderr(tmp_path: Path) -> None:
    csv = tmp_path / "a.csv"
    done = run("simulate", "--rig", rig_file(tmp_path), "--csv", str(csv))
    assert "ITAE" in done.stdout
    assert "written" not in done.stdout
    assert str(csv) in done.stderr


def test_a_lost_ball_is_a_result(tmp_path: Path) -> None:
    done = run("simulate", "--rig", rig_file(tmp_path), "--initial-velocity", "5", "--json")
    found = document(done)
    assert found["crashed"] is True
    assert found["crash"]["where"] == "dropped"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "--rig", "belmonte2020"), ("belmonte2020", "did you mean 'belmonte2021'")),
        (("simulate", "--rig", "nowhere.toml"), ("nowhere.toml", "cannot be read")),
        (("simulate", "--omega-nn", "70"), ("--omega-nn", "--omega-n")),
        (("simulate", "--zeta", "nan"), ("zeta = nan", "greater than 0")),
        (("simulate", "--beta-ratio", "0"), ("beta-ratio = 0.0 [-]", "0.01 to 20")),
        (
            ("simulate", "--initial-error", "0.04"),
            ("initial-error = 0.04 m", "0.0642 m", "0.05 m"),
        ),
        (("simulate", "--design", "nowhere.json"), ("nowhere.json", "cannot be read")),
        (("tune", "--objective", "itea"), ("itea", "itae")),
    ],
    ids=lambda value: " ".join(value[1:]) if isinstance(value, tuple) else None,
)
def test_bad_input_ends_with_two_and_says_what_is_allowed(
    arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    done = run(*arguments, code=2)
    assert done.stdout == ""
    for word in words:
        assert word in done.stderr


def test_a_gap_in_millimetres_is_recognised(tmp_path: Path) -> None:
    path = tmp_path / "mm.toml"
    path.write_text(preset_text("belmonte2021").replace("gap = 0.0246", "gap = 24.6"), "utf-8")
    done = run("simulate", "--rig", str(path), code=2)
    for word in (str(path), "operating_point.gap = 24.6", "24.6 mm is 0.0246 m"):
        assert word in done.stderr


def test_a_voltage_range_that_cannot_hold_the_ball_is_refused_with_the_need(
    tmp_path: Path,
) -> None:
    done = run("simulate", "--rig", rig_file(tmp_path, volts=1.5), code=2)
    assert "limits.voltage = [0, 1.5] V" in done.stderr
    # more than sqrt(g/beta) Y = 2.08 V at rest: the ball is pulled up
    assert "the path needs 2.118 V at the gap 0.02386 m" in done.stderr


# --- derive --------------------------------------------------------------------------------


def test_every_equation_of_the_derivation_has_residual_zero() -> None:
    equations = document(run("derive", "--json"))["equations"]
    assert len(equations) > 20
    assert all({"id", "title", "latex", "residual"} <= set(one) for one in equations)
    assert len({one["id"] for one in equations}) == len(equations)
    proved = [one for one in equations if one["residual"] == "0"]
    assert len(proved) >= len(equations) - 3
    assert {one["residual"] for one in equations} - {"0"} <= {None, "", "postulate"}


# --- tune ----------------------------------------------------------------------------------


def test_a_tuning_is_saved_replayed_and_repeated(tmp_path: Path) -> None:
    rig, folder = rig_file(tmp_path), tmp_path / "out"
    arguments = ("tune", "--rig", rig, "-o", str(folder), "--json")
    done = run(*arguments)
    found = document(done)
    assert set(found) >= TUNE
    assert found["status"] == "optimal"
    assert set(found["worst_case"]) >= METRICS - {"min_gap", "max_gap", "final_error"} | LOOP
    assert set(found["gains"]) == {"k0", "k1", "k2", "k3"}
    assert found["baseline"] is None  # the paper's poles belong to the paper's rig
    assert all({"name", "limit", "value", "satisfied"} <= set(c) for c in found["constraints"])
    assert set(found["verification"]) >= {"integrator", "itae", "relative_difference"}
    first = contents(folder)
    assert {"design.json", "design.npz", "tracking.svg", "landscape.svg"} <= set(first)
    assert all(name in done.stderr for name in first if not name.startswith("."))

    ratio = found["worst_case"]["ratio"]
    replay = document(
        run("simulate", "--design", str(folder), "--beta-ratio", repr(ratio), "--json")
    )
    assert replay["poles"] == found["poles"]
    bound = replay["relative_error_bounds"]["itae"]
    assert replay["itae"] == pytest.approx(found["worst_case"]["itae"], rel=max(SAME, bound))

    again = run(*arguments)
    assert again.stdout == done.stdout
    assert contents(folder) == first


def test_a_rig_on_which_nothing_moves_says_so_first(tmp_path: Path) -> None:
    path = tmp_path / "minimal.toml"
    path.write_text(
        "[plant]\nmass = 0.2\ngravity = 9.81\ncurrent_gain = 1.0\nforce_constant = 3.13e-4\n"
        "[operating_point]\ngap = 0.0263668\n[sampling]\nperiod = 0.002\n"
    )
    arguments = ("tune", "--rig", str(path), "--baseline", "1", "60", "--omega-bounds", "40", "90")
    done = run(*arguments)
    assert done.stdout.startswith("Nothing moves on this rig")
    assert "+0.527 mm" in done.stdout.splitlines()[0]
    found = document(run(*arguments, "--json"))
    assert found["excitation"]["initial_gap"] == found["rig"]["initial"]["gap"] > 0.0263668
    assert found["worst_case"]["itae"] > 0
    assert set(found["baseline"]) >= {"zeta", "omega_n", "worst_case"}
    assert found["baseline"]["zeta"] == 1


@pytest.mark.parametrize("place", ["foreign", "foreign/thesis.tex", "foreign/thesis.tex/below"])
def test_a_place_that_is_not_ours_is_refused_before_any_work(tmp_path: Path, place: str) -> None:
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "thesis.tex").write_text("years of work")
    done = run("tune", "-o", str(tmp_path / place), code=2)
    assert str(tmp_path / place) in done.stderr
    assert contents(foreign) == {"thesis.tex": b"years of work"}


def test_limits_that_cannot_be_met_end_with_three_and_name_the_tightest(tmp_path: Path) -> None:
    box = ("--zeta-bounds", "0.7", "1.5", "--omega-bounds", "50", "120")
    done = run("tune", "--rig", rig_file(tmp_path), *box, "--max-ms", "1.05", "--json", code=3)
    assert "tightest limit is Ms" in done.stderr
    assert "would do" in done.stderr
    found = document(done)
    assert found["status"] == "infeasible"
    assert found["tightest"]["name"] == "Ms"
    assert found["tightest"]["hint"] in done.stderr
    (broken,) = [c for c in found["constraints"] if c["name"] == "Ms"]
    assert not broken["satisfied"]


def test_a_period_too_long_ends_with_three_and_names_one_that_would_do(tmp_path: Path) -> None:
    done = run("tune", "--rig", rig_file(tmp_path, period=0.06), code=3)
    assert "spectral radius" in done.stderr
    assert "largest period" in done.stderr
    assert "p T = " in done.stderr
    assert done.stdout == ""


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_an_interrupted_tuning_ends_with_130(tmp_path: Path) -> None:
    process = subprocess.Popen(  # noqa: S603 - this interpreter, our own module
        # distinct poles and noise: longer than any machine needs to receive a signal
        [
            sys.executable,
            *("-m", "maglev_design", "tune", "--scenarios", "robust", "--poles", "distinct"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # noqa: PLW1509
    )
    try:
        time.sleep(4)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=SLOW)
    finally:
        process.kill()
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
