from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from exported import WARNINGS
from rigs import SHORT, rig_with
from typer.testing import CliRunner

from maglev_design import record
from maglev_design.cli import app
from maglev_design.controller.design import PoleSpec, believed_equilibrium, make_design
from maglev_design.errors import InfeasibleError, InputError
from maglev_design.exporting.controller import controller_of, doubts
from maglev_design.exporting.printing import printed
from maglev_design.options import Controller
from maglev_design.programs import gains_program
from maglev_design.rig import load_rig
from maglev_design.symbolic import laws
from maglev_design.symbolic import plant as p
from maglev_design.tuning import build_problem, judge
from maglev_design.tuning.placed import gains_of, judged, parse_gains, placed_by

PID = Controller("lin-pid")
RIG = """
name = "given"
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
beta = 0.1
"""


@pytest.fixture
def rig_file(tmp_path: Path) -> str:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, "utf-8")
    return str(path)


def call(*words: str, code: int = 0) -> tuple[str, str]:
    """Run the verb; return stdout, and stderr or the message of what was raised."""
    found = CliRunner().invoke(app, ["design", *words])
    if isinstance(found.exception, InputError | InfeasibleError):
        assert found.exception.exit_code == code
        return found.stdout, str(found.exception)
    assert found.exit_code == code, (found.exit_code, found.exception, found.stderr)
    return found.stdout, found.stderr


# --- whose gains ---------------------------------------------------------------------------


def test_the_gains_of_a_pid_give_the_law_its_transfer_function() -> None:
    own = laws.lin_pid(PID).transfer().subs(laws.gains_of_pid())
    known = laws.K_p + laws.K_i / p.s + laws.K_d * p.s * laws.omega_f / (p.s + laws.omega_f)
    assert sp.simplify(own - known) == 0


def test_a_positive_gain_pulls_the_ball_back() -> None:
    rig = rig_with(SHORT)
    found = {}
    for sign in (1, -1):
        given = {"Kp": sign * 400.0, "Ki": sign * 2000.0, "Kd": sign * 8.0}
        try:
            gains_of(given, PID, believed_equilibrium(rig, "model"))
            found[sign] = "placed"
        except InfeasibleError as error:
            found[sign] = error.constraint
    assert found == {1: "placed", -1: "Routh-Hurwitz"}


@pytest.mark.parametrize("name", ["N", "omega_f"])
def test_a_pid_by_its_practitioners_gains_is_the_pid_by_its_own(name: str) -> None:
    believed = believed_equilibrium(rig_with(SHORT), "model")
    k1, k2, k3 = 343000.0, 14700.0, 210.0
    given = {
        "Kp": (k2 + believed.C_Y) / believed.C_U,
        "Ki": k1 / believed.C_U,
        "Kd": k3 / believed.C_U,
        name: 700.0,
    }
    controller, gains, poles = gains_of(given, PID, believed)
    assert gains == pytest.approx((k1, k2, k3, 700.0), rel=1e-13)
    assert poles.values == pytest.approx((1, 70, 1, 70), rel=1e-4)
    assert controller.filter == pytest.approx(10, rel=1e-4)
    own = gains_of({"k1": k1, "k2": k2, "k3": k3, "omega_f": 700.0}, PID, believed)
    assert own == (PID, (k1, k2, k3, 700.0), PoleSpec.double(1, 70))
    assert gains_of({"k1": k1, "k2": k2, "k3": k3}, PID, believed) == own


@pytest.mark.parametrize(
    "poles",
    [
        PoleSpec.double(1, 70),
        PoleSpec.double(0.7, 40),
        PoleSpec((0.5, 30.0), (0.9, 90.0)),
        PoleSpec((0.6, 30.0), (1.7, 90.0)),
        PoleSpec((1.3, 30.0), (1.7, 90.0)),
    ],
)
@pytest.mark.parametrize("law", ["tan-gpi", "state-feedback"])
def test_gains_are_read_back_as_the_poles_that_place_them(law: Any, poles: PoleSpec) -> None:
    program = gains_program(Controller(law))
    gains = dict(zip(program.outputs, program.scalar()(*poles.values), strict=True))
    found = placed_by(gains, gains)
    again = program.scalar()(*found.values)
    assert again == pytest.approx(tuple(gains.values()), rel=1e-9)
    if poles.first == poles.second and law == "tan-gpi":
        assert found.values == pytest.approx(poles.values, rel=1e-12)


@pytest.mark.parametrize(
    ("gains", "pole"),
    [
        ((24010000.0, 1372000.0, 29400.0, -280.0), None),
        ((24010000.0, 1e9, 29400.0, 280.0), None),
        ((0.0, 1372000.0, 29400.0, 280.0), 0.0),
    ],
)
def test_gains_that_place_an_unstable_pole_are_told_with_it(
    gains: tuple[float, ...], pole: float | None
) -> None:
    named = dict(zip(("k0", "k1", "k2", "k3"), gains, strict=True))
    with pytest.raises(InfeasibleError, match="a pole at") as caught:
        placed_by(named, named)
    told = float(str(caught.value).split("a pole at ")[1].split()[0])
    true = max(np.roots([1.0, *gains[::-1]]).real)
    assert told == pytest.approx(true if pole is None else pole, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Kp", "must be name=value"),
        ("Kp=1,Kp=2", "given twice"),
        ("Kp=fast", "must be a number"),
        ("Kp=inf", "must be finite"),
        ("kp=1,Ki=1,Kd=1", "did you mean 'Kp'"),
        ("omegaf=1", "did you mean 'omega_f'"),
        ("k0=1", "no gain of lin-pid"),
        ("Kp=1,Kd=1", "missing: Ki"),
        ("Kp=1,Ki=1,Kd=1,k1=1", "not together with these: k1"),
        ("Kp=572,Ki=9102,Kd=9.4,N=10,omega_f=10", "are the same"),
        ("Kp=572,Ki=9102,Kd=9.4,N=0", "must be greater than 0"),
    ],
)
def test_unusable_gains_are_named(text: str, message: str) -> None:
    believed = believed_equilibrium(rig_with(SHORT), "model")
    with pytest.raises(InputError, match=message):
        gains_of(parse_gains(text), PID, believed)


# --- what is judged ------------------------------------------------------------------------


def test_poles_outside_the_search_box_are_judged_as_they_are() -> None:
    rig = rig_with(SHORT)
    poles = PoleSpec.double(4.0, 71.0)
    narrow = build_problem(rig, zeta_bounds=(0.9, 1.1), omega_bounds=(40, 50))
    wide = build_problem(rig, zeta_bounds=(0.1, 9.0), omega_bounds=(1, 900))
    one, other = (judge(problem, poles).worst.itae for problem in (narrow, wide))
    assert one == pytest.approx(other, rel=1e-12)


@pytest.mark.parametrize("law", ["tan-gpi", "fee-gpi", "lin-pid", "state-feedback"])
def test_every_law_is_judged_and_verified(law: Any) -> None:
    rig, poles = rig_with(SHORT, {"uncertainty.beta": 0.1}), PoleSpec.double(1, 70)
    result = judged(build_problem(rig, controller=Controller(law)), poles)
    assert result.verification.passed
    assert result.verification.value > 0
    assert result.figures.spectral_radius < 1
    assert result.design == make_design(rig, poles, controller=Controller(law))


def test_a_pid_is_compared_with_the_placement_of_the_other_law() -> None:
    rig, poles = rig_with(SHORT), PoleSpec.double(1, 70)
    problem = build_problem(rig, controller=PID)
    result = judged(problem, poles, poles)
    assert result.baseline is not None
    alone = judge(build_problem(rig), poles)
    assert result.baseline.figures.worst == alone.worst
    assert result.baseline.figures.worst != result.figures.worst
    same = judged(build_problem(rig), poles, poles)
    assert same.baseline is None  # nothing to learn from a controller beside itself


def test_a_pid_and_the_placement_beside_it_run_on_the_emulated_rig() -> None:
    changes = {"emulator.sensor_step": 1e-5, "emulator.delay": 0.0005}
    rig, poles = rig_with(SHORT, changes), PoleSpec.double(1, 70)
    row = judged(build_problem(rig, controller=PID), poles, poles).emulated
    alone = judged(build_problem(rig), poles).emulated
    assert row is not None
    assert alone is not None
    assert row.baseline == alone.tuned
    assert row.tuned != alone.tuned


# --- the verb ------------------------------------------------------------------------------


def test_the_papers_placement_is_judged_saved_and_read_back(tmp_path: Path) -> None:
    folder = tmp_path / "paper"
    out, _ = call("--zeta", "1", "--omega-n", "70", "-o", str(folder), "--json")
    document = json.loads(out)
    assert document["status"] == "judged"
    assert "not searched for" in document["message"]
    assert document["baseline"] is None
    assert document["evaluations"] == 0
    assert all(limit["satisfied"] for limit in document["constraints"])
    assert document["verification"]["passed"] is True
    assert document["certificate"]["certified"] is True
    saved = record.load(folder)
    assert saved.design == make_design(load_rig("belmonte2021"), PoleSpec.double(1, 70))
    assert document["controller_sha256"] == saved.design.sha256
    assert {"tracking.svg", "error.svg", "voltage.svg"} <= {x.name for x in folder.iterdir()}
    assert doubts(saved) == ()


def test_two_pairs_and_the_same_gains_are_the_same_controller(rig_file: str) -> None:
    pairs, _ = call("--poles", "0.8", "60", "1.2", "80", "--rig", rig_file, "--json")
    document = json.loads(pairs)
    assert document["poles"] == [[0.8, 60.0], [1.2, 80.0]]
    gains = ",".join(f"{name}={value!r}" for name, value in document["gains"].items())
    again = json.loads(call("--gains", gains, "--rig", rig_file, "--json")[0])
    assert again["controller_sha256"] == document["controller_sha256"]
    assert again["worst_case"]["itae"] == pytest.approx(document["worst_case"]["itae"], rel=1e-12)
    assert math.prod(w for _, w in again["poles"]) == pytest.approx(60 * 80, rel=1e-9)


def test_somebodys_pid_is_judged_saved_and_exported(rig_file: str, tmp_path: Path) -> None:
    folder = tmp_path / "pid"
    words = ["--controller", "lin-pid", "--gains", "Kp=572,Ki=9102,Kd=9.4", "--rig", rig_file]
    out, _ = call(*words, "-o", str(folder), "--json")
    document = json.loads(out)
    assert document["certificate"]["certified"] is False
    assert "not made for this loop" in document["certificate"]["status"]
    assert document["margins"]["delay_s"]["value"] > 0
    assert document["with_noise"]["seeds"] > 0
    saved = record.load(folder)
    believed = saved.design.believed
    assert saved.design.gains[0] == pytest.approx(9102 * believed.C_U, rel=1e-14)
    assert saved.design.named_gains == document["gains"]
    assert "no stability certificate" in " ".join(doubts(saved))
    for name, content in printed(controller_of(saved, "maglev"), "c", 0).items():
        (folder / name).write_bytes(content)
    assert "| law | LIN-PID" in (folder / "README.md").read_text("utf-8")
    if (compiler := shutil.which("gcc") or shutil.which("clang")) is not None:
        made = [compiler, *WARNINGS, "-fsyntax-only", str(folder / "maglev.c")]
        assert subprocess.run(made, check=False, timeout=60).returncode == 0  # noqa: S603
    report = CliRunner().invoke(app, ["report", str(folder / "design.json")])
    assert isinstance(report.exception, InputError)
    assert "its law is lin-pid" in str(report.exception)


def test_a_broken_limit_is_named_and_the_controller_is_saved(rig_file: str, tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    words = ["--zeta", "1", "--omega-n", "70", "--max-ms", "1.2", "--rig", rig_file]
    _, told = call(*words, "-o", str(folder), code=3)
    assert "infeasible: Ms is" in told
    assert "where 1.2 is allowed" in told
    assert "breaks a limit: Ms" in " ".join(doubts(record.load(folder)))


def test_a_sampled_loop_that_is_unstable_is_said_to_be(rig_file: str) -> None:
    slow = ["--zeta", "1", "--omega-n", "900", "--rig", rig_file]
    out, told = call(*slow, "--json", code=3)
    assert "the loop is unstable" in told
    assert json.loads(out)["worst_case"]["ms"] is None


def test_a_desired_polynomial_that_is_unstable_is_no_crash(rig_file: str, tmp_path: Path) -> None:
    words = ["--controller", "lin-pid", "--gains", "Kp=50,Ki=9102,Kd=9.4", "--rig", rig_file]
    out, told = call(*words, "-o", str(tmp_path / "x"), "--json", code=3)
    assert "Kp = 50" in told
    document = json.loads(out)
    assert (document["status"], document["tightest"]["name"]) == ("infeasible", "Routh-Hurwitz")
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "which controller"),
        (("--zeta", "1", "--omega-n", "70", "--gains", "k0=1"), "given: --zeta with --omega-n and"),
        (("--zeta", "1"), "needs both"),
        (("--zeta", "-1", "--omega-n", "70"), "zeta = -1.0: must be"),
        (("--zeta", "1", "--omega-n", "70", "--filter", "3"), "only for --controller lin-pid"),
        (
            ("--controller", "lin-pid", "--filter", "3", "--gains", "Kp=9,Ki=9,Kd=9,N=9"),
            "given as omega_f already",
        ),
        (("--zeta", "1", "--omega-n", "70", "--equilibrium", "measured"), "voltage .V. is missing"),
    ],
)
def test_bad_input_is_named(words: tuple[str, ...], message: str, rig_file: str) -> None:
    found = CliRunner().invoke(app, ["design", *words, "--rig", rig_file])
    assert isinstance(found.exception, InputError)
    assert re.search(message, str(found.exception))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": "fee-gpi"}, "fee-gpi: not exported"),
        ({"name": "state-feedback"}, "state-feedback: not exported"),
        ({"name": "lin-pid", "derivative": "measurement"}, "derivative of the measurement"),
        ({"name": "lin-pid", "start": "bumpless"}, "bumpless start is not exported"),
    ],
)
def test_a_law_without_words_in_the_targets_is_refused(
    options: dict[str, Any], message: str
) -> None:
    rig = rig_with(SHORT)
    design = make_design(rig, PoleSpec.double(1, 70), controller=Controller(**options))
    with pytest.raises(InputError, match=message):
        controller_of(record.DesignRecord(rig, design, {}, {}), "maglev")
