from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from exported import needs

from maglev_design.controller.design import plant_beta
from maglev_design.errors import InputError
from maglev_design.exporting import Verdict, export_folder, verify_folder
from maglev_design.exporting.behaviour import longest_delay
from maglev_design.exporting.classes import class_samples, single, wrong_answers
from maglev_design.exporting.controller import ExportedController, controller_of
from maglev_design.exporting.folder import sha256
from maglev_design.exporting.loops import ExportedRun, NewDevice, close, fault_cases, fly
from maglev_design.exporting.printing import printed
from maglev_design.exporting.running import Runnable
from maglev_design.exporting.vectors import Recorder
from maglev_design.files import digest
from maglev_design.record import DesignRecord
from maglev_design.simulation import nominal_scenario

SAME = "every file as its design.json prints it"
SAME_TRACK = 1e-9
"""[m] Runge-Kutta at half a period against DOP853, on a path of centimetres."""


@pytest.fixture(scope="module")
def controller(tuned_record: DesignRecord) -> ExportedController:
    return controller_of(tuned_record, "maglev")


@pytest.fixture(scope="module")
def exported(tuned_record: DesignRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("out")
    for target in ("c", "python", "matlab"):
        export_folder(tuned_record, target, place / target, allow_unverified=True)
    return place


@pytest.fixture
def copies(exported: Path, tmp_path: Path) -> Path:
    shutil.copytree(exported, tmp_path / "copy")
    return tmp_path / "copy"


def rehashed(folder: Path) -> None:
    """Make the manifest fit, as somebody would who means to hide a change."""
    manifest = json.loads((folder / "manifest.json").read_text("ascii"))
    for name in manifest["files"]:
        manifest["files"][name] = sha256((folder / name).read_bytes())
    manifest["sha256"] = digest(manifest)
    (folder / "manifest.json").write_text(json.dumps(manifest), "ascii")


@pytest.fixture(scope="module")
def device(
    controller: ExportedController, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[NewDevice]:
    """The class that the Python export defines, in a process of its own."""
    source = tmp_path_factory.mktemp("own") / "maglev.py"
    source.write_bytes(printed(controller, "python", 0)["maglev.py"])
    with Runnable.python(source).started() as new:
        yield new


def failed(verdict: Verdict) -> set[str]:
    return {check.name for check in verdict.checks if not check.passed}


def test_exported_c_passes_every_check(exported: Path) -> None:
    for tool in ("gcc", "clang", "cppcheck", "frama-c", "arm-none-eabi-gcc", "qemu-system-arm"):
        needs(tool)
    before = {path: path.read_bytes() for path in (exported / "c").iterdir()}
    verdict = verify_folder(exported / "c")
    assert failed(verdict) == set()
    assert verdict.skipped == ()
    assert verdict.ran == "c"
    names = " | ".join(check.name for check in verdict.checks)
    for word in ("gcc", "clang", "sanitizers", "MISRA", "proof", "Python", "nan", "in turns"):
        assert word in names
    for word in ("Cortex-M4, double: vectors", "Cortex-M4, single: vectors", "a step", "RAM"):
        assert word in names
    for word in ("nominal", "noise", "beta_c = 1.15 beta", "late", "stuck", "delay", "single"):
        assert word in names
    assert {path: path.read_bytes() for path in (exported / "c").iterdir()} == before


def test_exported_python_passes_every_check(exported: Path) -> None:
    verdict = verify_folder(exported / "python")
    assert failed(verdict) == set()
    assert verdict.ran == "python"


def test_exported_matlab_passes_every_check(exported: Path) -> None:
    needs("octave-cli")
    verdict = verify_folder(exported / "matlab")
    assert failed(verdict) == set()
    assert {check.name for check in verdict.checks} >= {"vectors, Octave"}


@pytest.mark.parametrize("target", ["c", "python", "matlab"])
def test_a_changed_byte_in_any_file_is_noticed_and_nothing_is_run(
    copies: Path, target: str
) -> None:
    folder = copies / target
    names = [p.name for p in folder.iterdir() if not p.name.startswith(".")]
    for name in names:
        if name == "manifest.json":
            continue
        kept = (folder / name).read_bytes()
        (folder / name).write_bytes(kept[:-2] + b"~" + kept[-1:])
        (check,) = verify_folder(folder).checks
        assert not check.passed
        assert name in check.note
        (folder / name).unlink()
        assert f"{name} (missing)" in verify_folder(folder).checks[0].note
        (folder / name).write_bytes(kept)


def test_a_changed_manifest_is_noticed(copies: Path) -> None:
    path = copies / "c" / "manifest.json"
    text = path.read_text("ascii")
    path.write_text(text.replace('"hold_samples": ', '"hold_samples": 1'), "ascii")
    (check,) = verify_folder(copies / "c").checks
    assert not check.passed
    assert "manifest.json" in check.note


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"kind": "maglev-design export"}', "\x00"])
def test_a_folder_that_is_no_export_is_refused(tmp_path: Path, content: str) -> None:
    with pytest.raises(InputError, match=r"manifest\.json"):
        verify_folder(tmp_path)
    (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(InputError, match=r"manifest\.json"):
        verify_folder(tmp_path)


def test_a_manifest_cannot_name_files_outside_its_folder(copies: Path) -> None:
    path = copies / "c" / "manifest.json"
    manifest = json.loads(path.read_text("ascii"))
    manifest["files"]["../python/maglev.py"] = "0"
    manifest["sha256"] = digest(manifest)
    path.write_text(json.dumps(manifest), "ascii")
    with pytest.raises(InputError, match="damaged"):
        verify_folder(copies / "c")


def test_a_changed_law_is_found_by_running_it(copies: Path) -> None:
    folder = copies / "python"
    source = (folder / "maglev.py").read_text("ascii")
    changed, count = re.subn(r"^d: Final = ", "d: Final = 1.0001 * ", source, flags=re.MULTILINE)
    assert count == 1
    (folder / "maglev.py").write_text(changed, "ascii")
    rehashed(folder)
    assert failed(verify_folder(folder)) == {SAME}
    found = failed(verify_folder(folder, run_untrusted=True))
    assert {SAME, "vectors, Python", "closed loop, nominal", "nan, infinities, edges"} <= found


def test_a_state_that_is_not_the_callers_own_is_found(copies: Path) -> None:
    folder = copies / "python"
    source = (folder / "maglev.py").read_text("ascii")
    shared = source.replace(
        "            self.unusable = 0\n            self.status = Status.OK\n",
        "            self.unusable = 0\n            self.status = Status.OK\n"
        "            seen.append(gap)\n            self.x1 += 1e-9 * (len(seen) % 2)\n",
    ).replace("class Controller:", "seen: list[float] = []\n\n\nclass Controller:")
    assert shared.count("seen") == 3
    (folder / "maglev.py").write_text(shared, "ascii")
    rehashed(folder)
    assert "two controllers in turns" in failed(verify_folder(folder, run_untrusted=True))


def test_vectors_of_another_design_are_found(copies: Path) -> None:
    path = copies / "python" / "vectors.csv"
    lines = path.read_text("ascii").splitlines()
    path.write_text("\n".join(lines[:-3]) + "\n", "ascii")
    rehashed(copies / "python")
    verdict = verify_folder(copies / "python")
    assert failed(verdict) == {SAME}
    assert "vectors.csv" in verdict.checks[0].note
    assert failed(verify_folder(copies / "python", run_untrusted=True)) == {SAME}


def test_a_controller_that_passes_a_nan_on_is_found(controller: ExportedController) -> None:
    class Naive(Recorder):
        status = 0

        def __init__(self) -> None:
            super().__init__(controller)

        def reset(self) -> None:
            self.forget()

        def step(  # type: ignore[override]
            self, gap: float, reference: float, acceleration: float, *more: float
        ) -> float:
            return super().step(gap, reference, acceleration, *more)[1] + 0.0 * gap

    wrong, answers = wrong_answers(controller, Naive, exact=False)
    assert 0 < wrong < answers


def test_a_delay_that_the_loop_does_not_stand_is_not_promised(
    controller: ExportedController, device: NewDevice
) -> None:
    margin = controller.record.document["margins"]["delay_s"]
    plant = margin["gap"], controller.record.design.beta_at(margin["ratio"]), 0.0
    assert longest_delay(controller, device, margin["value"], *plant).passed
    assert not longest_delay(controller, device, 1.25 * margin["value"], *plant).passed


def test_every_class_of_number_is_tried(controller: ExportedController) -> None:
    gaps = {sample[0] for sample in class_samples(controller) if not math.isnan(sample[0])}
    n = controller.numbers
    assert {math.inf, -math.inf, 0.0, n["gap_low"], n["gap_high"]} <= gaps
    assert any(math.isnan(sample[2]) for sample in class_samples(controller))
    assert single(1e300) == math.inf
    assert single(0.1) != 0.1


def test_the_quick_loop_is_the_independent_one(
    controller: ExportedController, exported: Path
) -> None:
    class Device(Recorder):
        status = 0

        def __init__(self) -> None:
            super().__init__(controller)

        def reset(self) -> None:
            self.forget()

        def step(  # type: ignore[override]
            self, gap: float, reference: float, acceleration: float, *more: float
        ) -> float:
            return super().step(gap, reference, acceleration, *more)[1]

    rig = controller.record.rig
    quick, slow = ExportedRun(Device()), ExportedRun(Device())
    assert not fly(controller, quick)
    assert not close(controller, slow, nominal_scenario(rig, plant_beta(rig))).crashed
    assert len(quick.gaps) == len(slow.gaps) == 400
    assert max(abs(a - b) for a, b in zip(quick.gaps, slow.gaps, strict=True)) < SAME_TRACK


def test_faults_are_what_their_names_say(controller: ExportedController) -> None:
    missed, lost, outside, stuck, late, delayed, worst = fault_cases(controller, 400)
    seen = [missed.fault(k, 0.02, 0.03) for k in range(100)]
    assert [k for k, gap in enumerate(seen) if math.isnan(gap)] == [49, 99]
    struck = [k for k in range(400) if math.isnan(lost.fault(k, 0.02, 0.03))]
    assert len(struck) == 10 * max(1, controller.hold_samples // 8)
    assert all(outside.fault(k, 0.02, 0.03) > controller.numbers["gap_high"] for k in struck)
    assert all(stuck.fault(k, 0.02, 0.03) == 0.03 for k in struck)
    assert sum(late.late(k) for k in range(100)) == 10
    assert all(delayed.late(k) and worst.late(k) for k in range(100))
    assert worst.ratio == controller.record.document["margins"]["delay_s"]["ratio"] != 1.0


def test_what_a_machine_without_tools_cannot_check_is_said(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    without_octave = verify_folder(exported / "matlab")
    assert failed(without_octave) == set()
    assert {why for _, why in without_octave.skipped} == {"octave is not installed"}
    without_compiler = verify_folder(exported / "c")
    assert failed(without_compiler) == {"a C compiler"}
    assert without_compiler.ran == "python"
    names = " ".join(why for _, why in without_compiler.skipped)
    assert "cppcheck" in names
    assert "frama-c" in names
