from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from records import document_of
from rigs import SHORT, rig_with
from typer.testing import CliRunner

from maglev_design import record
from maglev_design import sweeping as sweeps
from maglev_design.cli import app, sweep_verb
from maglev_design.cli.commands.sweep import SweepOptions
from maglev_design.cli.replay import replayed
from maglev_design.controller.design import PoleSpec, make_design
from maglev_design.errors import InputError
from maglev_design.files import finite
from maglev_design.rig import Rig, load_rig
from maglev_design.sweeping import executors

SLOW = 240
"""[s] A start costs seconds, more on a busy machine."""
LOOPS = 800
"""Interpreted, a few milliseconds each: long enough to be stopped on the way."""
CHUNK = 8
PLAIN: dict[str, Any] = {"samples": 8, "jobs": 1}

RIG = """
name = "swept </script>"
[plant]
mass = 0.02
gravity = 9.81
current_gain = 1.05
force_constant = 2.48315625e-5
[operating_point]
gap = 0.0246
[initial]
gap = 0.0244
[reference]
start_gap = 0.0242
end_gap = 0.0200
start_time = 0.1
end_time = 0.3
horizon = 0.4
[sampling]
period = 0.001
[limits]
voltage = [0.0, 5.0]
gap = [0.001, 0.05]
[noise]
position = 1e-6
[uncertainty]
beta = 0.15
initial_gap = {{ distribution = "normal", mean = 0.0244, deviation = 1e-4 }}
{more}
"""


@pytest.fixture
def rig_file(tmp_path: Path) -> str:
    path = tmp_path / "rig.toml"
    path.write_text(RIG.format(more=""), "utf-8")
    return str(path)


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "maglev_design", *arguments]


def run(*arguments: str) -> str:
    """Run a command in this process; return its stdout."""
    done = CliRunner().invoke(app, arguments)
    if done.exception is not None:
        raise done.exception
    return done.stdout


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def swept(folder: Path, **options: Any) -> dict[str, Any]:
    """Run the verb in this process; return sweep.json."""
    sweep_verb.sweep(SweepOptions(output=folder, json=True, **{**PLAIN, **options}))
    found = json.loads((folder / "sweep.json").read_text("utf-8"))
    assert isinstance(found, dict)
    return found


def save_design(
    folder: Path, rig: Rig, zeta: float, omega_n: float, beta_error: float | None = None
) -> Path:
    """Write a record such as `tune` writes, without tuning."""
    folder.mkdir(exist_ok=True)
    design = make_design(rig, PoleSpec.double(zeta, omega_n))
    document = document_of(rig, design, beta_error_given=beta_error)
    record.save(record.DesignRecord(rig, design, finite(document), {}), folder)
    return folder / "design.json"


# --- what comes out ------------------------------------------------------------------------


def test_a_sweep_prints_its_document_and_each_scenario_is_replayed(
    rig_file: str, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    options = ["--samples", "24", "--chunk", "8", "--rig", rig_file, "--seed", "3", "--jobs", "1"]
    laws = ["--controller", "tan-gpi", "--controller", "lin-pid"]
    document = json.loads(run("sweep", *options, *laws, "-o", str(folder), "--json"))
    assert document["schema_version"] == 1
    assert {"samples", "stable_fraction", "quantiles", "worst"} <= set(document)
    assert document == json.loads((folder / "sweep.json").read_text("utf-8"))
    assert document["samples"] == 24
    assert [d["controller"] for d in document["designs"]] == ["tan-gpi", "lin-pid"]
    assert str(tmp_path) not in (folder / "sweep.json").read_text("utf-8")
    one = document["designs"][1]["worst"][0]
    curve = tmp_path / "curve.csv"
    place = f"{folder / 'sweep.json'}:{one['scenario']}:1"
    again = json.loads(run("simulate", "--replay", place, "--csv", str(curve), "--json"))
    for name in ("itae", "iae", "ise", "peak_voltage", "min_voltage", "min_gap", "max_gap"):
        assert again[name] == pytest.approx(one[name], rel=1e-10)
    assert (again["controller"], again["seed"]) == ("lin-pid", one["seed"])
    assert again["replay"]["drawn"] == one["drawn"]
    assert again["replay"]["relative_difference"] < 1e-10
    assert again["ratio"] == pytest.approx(one["drawn"]["ratio"], rel=1e-14)
    first = curve.read_text("utf-8").splitlines()[1].split(",")
    assert float(first[1]) == one["drawn"]["initial_gap"]


def test_any_scenario_is_found_again(
    rig_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a:b"
    swept(folder, rig=rig_file, samples=20, sampling="sobol", chunk=8, seed=7)
    document = json.loads((folder / "sweep.json").read_text("utf-8"))
    worst = {one["scenario"] for one in document["worst"]}
    quiet = next(k for k in range(20) if k not in worst)
    with np.load(folder / "chunks" / f"{quiet // 8:06d}.npz") as archive:
        gap, itae = (float(archive[n][quiet % 8]) for n in ("drawn_initial_gap", "0_itae"))
    for name in ("sweep.json", "setup.json"):
        found = replayed(f"{folder / name}:{quiet}")
        assert found.scenario.initial_gap == found.drawn["initial_gap"] == gap
        assert (found.scenario.index, found.scenario.seed) == (quiet, 7)
        assert found.recorded is not None
        assert found.recorded["itae"] == itae
    chunk = folder / "chunks" / f"{quiet // 8:06d}.npz"
    shutil.copyfile(chunk, tmp_path / "kept.npz")
    with np.load(chunk) as archive:
        arrays = dict(archive)
    np.savez(chunk, **{**arrays, "0_itae": 2 * arrays["0_itae"]})
    with pytest.raises(InputError, match=r"chunk \d beside it is not the one"):
        replayed(f"{folder / 'sweep.json'}:{quiet}")
    shutil.copyfile(tmp_path / "kept.npz", chunk)
    old = {key: value for key, value in document.items() if key != "chunks_sha256"}
    (folder / "old.json").write_text(json.dumps(old), "utf-8")
    assert replayed(f"{folder / 'old.json'}:{quiet}").recorded is None
    (folder / "chunks").rename(tmp_path / "moved")
    assert replayed(f"{folder / 'sweep.json'}:{quiet}").recorded is None
    assert "Sobol" in capsys.readouterr().err


def test_saved_designs_run_the_same_scenarios(rig_file: str, tmp_path: Path) -> None:
    rig = load_rig(rig_file)
    paths = []
    for n, omega_n in enumerate((60.0, 80.0)):
        folder = tmp_path / str(n)
        folder.mkdir()
        paths.append(save_design(folder, rig, 1.0, omega_n))
    both = swept(tmp_path / "both", design=paths, seed=4)
    assert [d["poles"][0] for d in both["designs"]] == [[1.0, 60.0], [1.0, 80.0]]
    made = swept(
        tmp_path / "made", rig=rig_file, zeta=1.0, omega_n=80.0, controller=["tan-gpi"], seed=4
    )
    second = both["designs"][1]
    assert second["quantiles"] == made["quantiles"]
    assert second["controller_sha256"] == record.load(paths[1]).design.sha256
    assert second["controller_sha256"] != both["designs"][0]["controller_sha256"]
    assert [one["drawn"] for one in second["worst"]] == [one["drawn"] for one in made["worst"]]
    # The uncertainty of another file, for the same plant.
    other = tmp_path / "other.toml"
    other.write_text(RIG.format(more="gravity = [9.7, 9.9]"), "utf-8")
    found = swept(tmp_path / "other", rig=str(other), design=[paths[0]])
    assert list(found["drawn"]) == ["ratio", "gravity", "initial_gap"]


def test_a_design_for_another_plant_is_refused(rig_file: str, tmp_path: Path) -> None:
    heavy = rig_with(SHORT, {"plant.mass": 0.03})
    path = save_design(tmp_path, heavy, 1.0, 70.0)
    with pytest.raises(
        InputError, match=r"plant.mass = 0.03, not 0.02 as .*rig.toml has it; tune again"
    ):
        swept(tmp_path / "out", rig=rig_file, design=[path])
    other = tmp_path / "two"
    other.mkdir()
    second = save_design(other, rig_with(SHORT, {"plant.mass": 0.03, "noise.input": 0}), 1.0, 70.0)
    with pytest.raises(
        InputError, match=r"two.*noise.input = 0.0, not 0.001 as .*design.json has it; say"
    ):
        swept(tmp_path / "out", design=[path, second])


def test_saved_designs_are_swept_over_the_family_that_they_were_made_for(
    rig_file: str, tmp_path: Path
) -> None:
    rig = load_rig(rig_file)
    narrow = save_design(tmp_path / "narrow", rig, 1.0, 60.0, beta_error=0.01)
    found = swept(tmp_path / "out", design=[narrow])
    worst = found["worst"][0]
    assert (found["drawn"]["ratio"]["lower"], found["drawn"]["ratio"]["upper"]) == (0.99, 1.01)
    assert (
        replayed(f"{tmp_path / 'out' / 'sweep.json'}:{worst['scenario']}").drawn == worst["drawn"]
    )
    wide = swept(tmp_path / "wide", design=[narrow], rig=rig_file)
    assert (wide["drawn"]["ratio"]["lower"], wide["drawn"]["ratio"]["upper"]) == (0.85, 1.15)
    plain = save_design(tmp_path / "plain", rig, 1.0, 60.0)
    with pytest.raises(
        InputError, match=r"plain.*made with --beta-error left out, .*narrow.* with 0.01: two fam"
    ):
        swept(tmp_path / "both", design=[narrow, plain])


BAD: list[tuple[dict[str, Any], str]] = [
    ({"samples": 0}, "samples = 0: must be from 1 to"),
    ({"samples": 10**12}, "samples = 1000000000000: must be from 1 to"),
    ({"chunk": 3}, "chunk = 3: must be a multiple of 4"),
    ({"controller": ["tangpi"]}, "did you mean 'tan-gpi'"),
    ({"zeta": -1.0}, "zeta = -1.0: must be"),
    ({"equilibrium": "measured"}, "operating_point.voltage [V] is missing"),
    ({"rig": "nowhere.toml"}, "nowhere.toml: cannot be read"),
    ({"design": [Path("nowhere.json")]}, "nowhere.json: cannot be read"),
    ({"design": [Path("x.json")], "omega_n": 3.0}, "--omega-n: belongs to --controller"),
    ({"scheduler": "tcp://127.0.0.1:1", "jobs": 2}, "--jobs: not with --scheduler"),
    ({"scheduler": "127.0.0.1", "jobs": None}, "tcp://HOST:PORT"),
]


@pytest.mark.parametrize(("options", "words"), BAD, ids=[str(n) for n in range(len(BAD))])
def test_bad_input_is_refused_before_anything_is_written(
    options: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        swept(tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_a_folder_of_somebody_else_is_refused(rig_file: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not empty and not written by this program"):
        swept(tmp_path, rig=rig_file)


WARNED = [
    ({"uncertainty.beta": 0.0}, {}, "states no uncertainty: all scenarios are alike but for"),
    ({"noise.input": 0, "noise.position": 0}, {}, "all scenarios are one and the same"),
    (
        {"uncertainty.beta": 0.1, "uncertainty.mass": [0.019, 0.021]},
        {},
        "uncertainty.beta = 0.1 is not used",
    ),
    ({"uncertainty.mass": [19.0, 21.0]}, {}, "does not hold the rig's own 0.02"),
    ({"uncertainty.input_noise": [0, 1e-3]}, {"noise": False}, "does nothing"),
    ({"uncertainty.beta": 0.1}, {"sampling": "sobol", "samples": 9}, "power of 2"),
]


@pytest.mark.parametrize(("changes", "options", "words"), WARNED)
def test_what_makes_a_sweep_pointless_is_said(
    changes: dict[str, Any], options: dict[str, Any], words: str
) -> None:
    rig = rig_with(SHORT, changes)
    design = make_design(rig, PoleSpec.double(1, 70))
    setup = sweeps.make_setup(rig, (design,), **{"samples": 8, **options})
    (warning,) = sweep_verb._warnings(setup)
    assert words in warning


def test_a_sensible_sweep_has_no_warning() -> None:
    rig = rig_with(SHORT, {"uncertainty.beta": 0.1})
    design = make_design(rig, PoleSpec.double(1, 70))
    assert sweep_verb._warnings(sweeps.make_setup(rig, (design,), samples=9)) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sweep.json", "must be FILE:SCENARIO"),
        ("sweep.json:", "must be FILE:SCENARIO"),
        (":3", "must be FILE:SCENARIO"),
        ("sweep.json:-1", "must be FILE:SCENARIO"),
        ("nowhere/sweep.json:3", "cannot be read"),
        ("{0}/sweep.json:8", "scenario = 8: must be from 0 to 7"),
        ("{0}/sweep.json:1:1", "design = 1: must be from 0 to 0"),
        ("{0}/edited.json:1", "does not match its key"),
        ("{0}/broken.json:1", "not valid JSON"),
        ("{0}/list.json:1", "a table is needed"),
        ("{0}/other.json:1", "not the result of a sweep"),
        ("{0}/less.json:1", "damaged"),
    ],
)
def test_a_replay_that_cannot_be_is_refused(text: str, words: str, replayable: Path) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        replayed(text.format(replayable))


@pytest.fixture(scope="module")
def replayable(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("replay")
    (base / "rig.toml").write_text(RIG.format(more=""), "utf-8")
    folder = base / "out"
    document = swept(folder, rig=str(base / "rig.toml"))
    whole = json.dumps(document)
    (folder / "edited.json").write_text(whole.replace('"seed": 0', '"seed": 1'))
    (folder / "broken.json").write_text(whole[:-5])
    (folder / "list.json").write_text("[1]")
    (folder / "other.json").write_text('{"kind": "maglev-design"}')
    del document["setup"]["designs"][0]["poles"]
    (folder / "less.json").write_text(json.dumps(document))
    return folder


def test_a_replay_takes_nothing_else(replayable: Path) -> None:
    place = f"{replayable / 'sweep.json'}:1"
    with pytest.raises(InputError, match="--zeta, --emulate: a replay takes everything"):
        run("simulate", "--replay", place, "--zeta", "1", "--emulate")


def test_a_table_is_printed_for_a_person(
    replayable: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep_verb.sweep(
        SweepOptions(samples=8, jobs=1, rig=str(replayable.parent / "rig.toml"), output=replayable)
    )
    shown = capsys.readouterr()
    for words in ("drawn: ratio, initial_gap", "itae [m s²]", "levitates to the end in 100 %"):
        assert words in shown.out
    assert "every one of the 1 chunks was there already" in shown.err


# --- stopped on the way --------------------------------------------------------------------

LONG = ["--samples", str(LOOPS), "--chunk", str(CHUNK), "--backend", "interpreted", "--seed", "1"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The long sweep, computed at one go."""
    base = tmp_path_factory.mktemp("whole")
    (base / "rig.toml").write_text(RIG.format(more=""), "utf-8")
    long_sweep(base / "out", str(base / "rig.toml"))
    return contents(base / "out")


def long_sweep(folder: Path, rig: str) -> None:
    swept(folder, rig=rig, samples=LOOPS, chunk=CHUNK, backend="interpreted", seed=1)


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(  # noqa: S603 - this interpreter
        list(arguments),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def until(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + SLOW
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)


def chunks(folder: Path) -> int:
    return len(list((folder / "chunks").glob("0*.npz")))


def children(process: int) -> list[int]:
    path = Path(f"/proc/{process}/task/{process}/children")
    return [int(word) for word in path.read_text("ascii").split()] if path.exists() else []


def alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text("ascii").rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def test_a_sweep_killed_and_interrupted_on_the_way_gives_the_same_bytes(
    rig_file: str, tmp_path: Path, whole: dict[str, bytes]
) -> None:
    folder = tmp_path / "out"
    arguments = command("sweep", *LONG, "--rig", rig_file, "-o", str(folder), "--jobs", "2")
    with started(*arguments) as process:
        until(lambda: chunks(folder) >= 3, process)
        workers = children(process.pid)
        os.kill(process.pid, signal.SIGKILL)
        process.wait(SLOW)
    end = time.monotonic() + SLOW
    while any(map(alive, workers)):  # nobody stays behind
        assert time.monotonic() < end
        time.sleep(0.05)
    kept = chunks(folder)
    assert 3 <= kept < LOOPS // CHUNK
    with started(*arguments) as process:
        until(lambda: chunks(folder) >= kept + 3, process)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
        out, errors = process.communicate(timeout=SLOW)
    assert process.returncode == 130, errors
    assert (out, chunks(folder) < LOOPS // CHUNK) == ("", True)
    place = f"{chunks(folder)} of {LOOPS // CHUNK} chunks are kept in {folder}"
    assert errors == f"interrupted: {place}; the same command continues\n"
    long_sweep(folder, rig_file)
    found = contents(folder)
    torn = [name for name in found if name not in whole]
    assert all(Path(name).name.startswith(".0") for name in torn)  # half a file beside its place
    assert {name: found[name] for name in whole} == whole


# --- a cluster -----------------------------------------------------------------------------


def test_no_scheduler_is_said_soon(
    rig_file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "CONNECT", 0.5)
    with pytest.raises(InputError, match=r"no scheduler answers there within 0\.5 s"):
        swept(tmp_path / "out", rig=rig_file, jobs=None, scheduler="tcp://127.0.0.1:1")


def test_a_cluster_that_loses_a_worker_gives_the_same_bytes(
    rig_file: str, tmp_path: Path, whole: dict[str, bytes]
) -> None:
    place = tmp_path / "scheduler.json"
    folder = tmp_path / "out"
    dask = [sys.executable, "-m", "dask"]
    quiet = ["--no-dashboard"]
    with started(
        *dask,
        "scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--scheduler-file",
        str(place),
        *quiet,
    ) as scheduler:
        until(place.exists, scheduler)
        address = json.loads(place.read_text("utf-8"))["address"]
        worker = [*dask, "worker", address, "--no-nanny", "--nthreads", "1", *quiet]
        local = ["--local-directory", str(tmp_path)]
        with (
            started(*worker, *local) as first,
            started(*worker, *local) as second,
            started(
                *command("sweep", *LONG, "--rig", rig_file, "-o", str(folder)),
                "--scheduler",
                address,
            ) as process,
        ):
            until(lambda: chunks(folder) >= 4, process)
            assert second.poll() is None
            first.kill()
            lost_at = chunks(folder)
            _, errors = process.communicate(timeout=SLOW)
    assert process.returncode == 0, errors
    assert lost_at < LOOPS // CHUNK
    assert contents(folder) == whole
