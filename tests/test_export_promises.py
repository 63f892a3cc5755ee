"""A promise that belongs to another controller, or to another plant, is found by `verify`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import judged, with_document
from rigs import SHORT, rig_with

from maglev_design import linear_loop as loops
from maglev_design.cli.commands.verify import VerifyOptions
from maglev_design.cli.verify_verb import verify
from maglev_design.controller.data import design_as_data
from maglev_design.controller.design import PoleSpec, make_design
from maglev_design.errors import InputError
from maglev_design.exporting import Verdict, export_folder, verify_folder
from maglev_design.exporting.controller import controller_of, doubts, emulated_at_own_period
from maglev_design.exporting.emulation import emulated_run
from maglev_design.exporting.promises import PromiseSubject, certificate
from maglev_design.exporting.vectors import Recorder
from maglev_design.record import DesignRecord
from maglev_design.simulation import loop_for, nominal_scenario, simulate
from maglev_design.tuning.document import difference_equation

COIL = {"emulator.resistance": 10.0, "emulator.inductance": 0.3}
"""A coil of 30 ms, under which no design without it holds the ball."""
SAME_TRACK = 0.01
"""Relative: the ITAE at the samples against the integral between them."""


def verdict_of(record: DesignRecord, folder: Path) -> Verdict:
    export_folder(record, "python", folder, allow_unverified=True)
    return verify_folder(folder)


def failed(verdict: Verdict) -> set[str]:
    return {check.name for check in verdict.checks if not check.passed}


def with_controller(record: DesignRecord, poles: PoleSpec) -> DesignRecord:
    """Return a record whose controller is another one, with all promises left as they were."""
    design = make_design(record.rig, poles)
    document = {
        **record.document,
        "design": design_as_data(design),
        "gains": design.named_gains,
        "difference_equation": difference_equation(design),
        "controller_sha256": design.sha256,
    }
    return replace(record, design=design, document=document)


def changed(document: Mapping[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Return the top entry of a document with one value below it replaced."""
    top, *below = path.split(".")
    entry = json.loads(json.dumps(document[top]))
    place = entry
    for name in below[:-1]:
        place = place[name]
    place[below[-1]] = value
    return {top: entry}


def test_the_promises_of_another_controller_are_found(
    tuned_record: DesignRecord, tmp_path: Path
) -> None:
    forged = with_controller(tuned_record, PoleSpec.double(1.0, 40.0))
    found = failed(verdict_of(forged, tmp_path / "out"))
    assert {"promised worst ITAE of the family", "promised peak voltage", "promised Ms"} <= found
    assert "one controller in every place" not in found


@pytest.mark.parametrize(
    ("path", "factor", "name"),
    [
        ("worst_case.itae", 1 - 1e-5, "promised worst ITAE of the family"),
        ("worst_case.peak_voltage", 1 - 1e-5, "promised peak voltage"),
        ("worst_case.min_voltage", 1 + 1e-5, "promised smallest voltage"),
        ("worst_case.ms", 1 - 1e-5, "promised Ms"),
        ("worst_case.ms_one_more_sample", 1 - 1e-5, "promised Ms, one more sample of delay"),
        ("margins.delay_s.value", 1.01, "promised delay, linear loop at every corner"),
    ],
)
def test_one_promise_that_is_a_little_too_good_is_found(
    tuned_record: DesignRecord, tmp_path: Path, path: str, factor: float, name: str
) -> None:
    document: Any = tuned_record.document
    for part in path.split("."):
        document = document[part]
    forged = with_document(tuned_record, **changed(tuned_record.document, path, factor * document))
    assert failed(verdict_of(forged, tmp_path / "out")) == {name}


def test_a_wider_family_needs_other_promises(tuned_record: DesignRecord, tmp_path: Path) -> None:
    wider = changed(tuned_record.document, "family.ratios", [0.8, 1.2])
    found = failed(verdict_of(with_document(tuned_record, **wider), tmp_path / "out"))
    assert {"promised worst ITAE of the family", "promised Ms"} <= found


def test_a_family_that_leaves_out_a_gap_of_the_path_is_found(
    tuned_record: DesignRecord, tmp_path: Path
) -> None:
    narrow = changed(tuned_record.document, "family.gaps", [0.021, 0.0246])
    found = failed(verdict_of(with_document(tuned_record, **narrow), tmp_path / "out"))
    assert "family covers path, initial gap and Y" in found


@pytest.mark.parametrize("entry", ["gains", "controller_sha256", "difference_equation"])
def test_a_record_that_names_two_controllers_is_not_read(
    tuned_record: DesignRecord, tmp_path: Path, entry: str
) -> None:
    other = with_controller(tuned_record, PoleSpec.double(1.2, 80.0))
    record = with_document(tuned_record, **{entry: other.document[entry]})
    with pytest.raises(InputError, match=f"{entry} is not that of the design beside it"):
        verdict_of(record, tmp_path / "out")


def test_a_ratio_that_counts_from_another_beta_is_found(
    tuned_record: DesignRecord, tmp_path: Path
) -> None:
    design = tuned_record.design
    believed = replace(design.believed, beta=1.01 * design.believed.beta)
    document = changed(tuned_record.document, "design.beta_c", believed.beta)
    other = replace(tuned_record, design=replace(design, believed=believed))
    record = with_document(other, **document)
    assert "beta_c is that of U and Y, or of K, C and m" in failed(
        verdict_of(record, tmp_path / "out")
    )


def test_a_certificate_is_proved_again_for_the_interval_that_was_asked_for() -> None:
    record = judged(PoleSpec.double(1.0, 70.0), beta_error=0.2)
    assert record.document["family"]["ratios"] == [0.8, 1.2]
    (check,) = certificate(controller_of(record, "maglev"))
    assert check.passed


def test_a_certificate_is_proved_again_for_these_coefficients(tuned_record: DesignRecord) -> None:
    (check,) = certificate(controller_of(tuned_record, "maglev"))
    assert check.passed
    told = changed(tuned_record.document, "certificate.ratios", [0.5, 1.5])
    (check,) = certificate(controller_of(with_document(tuned_record, **told), "maglev"))
    assert not check.passed
    forged = with_controller(tuned_record, PoleSpec.double(0.3, 500.0))
    (check,) = certificate(controller_of(forged, "maglev"))
    assert not check.passed


def test_the_ending_says_of_which_controller_and_with_which_code(
    tuned_record: DesignRecord, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = tuned_record.design.sha256
    export_folder(tuned_record, "c", tmp_path / "c", allow_unverified=True)
    manifest = json.loads((tmp_path / "c" / "manifest.json").read_text("ascii"))
    assert manifest["controller_sha256"] == name
    for file in ("README.md", "maglev.c", "maglev.h"):
        assert name in (tmp_path / "c" / file).read_text("ascii")
    forged = with_controller(tuned_record, PoleSpec.double(1.0, 40.0))
    export_folder(forged, "python", tmp_path / "out", allow_unverified=True)
    with pytest.raises(SystemExit) as ended:
        verify(VerifyOptions(folder=tmp_path / "out"))
    assert ended.value.code == 4
    assert capsys.readouterr().out.splitlines()[0] == f"controller {forged.design.sha256}"
    with pytest.raises(SystemExit):
        verify(VerifyOptions(folder=tmp_path / "out", json=True))
    assert json.loads(capsys.readouterr().out)["controller_sha256"] == forged.design.sha256


def test_a_ball_lost_on_the_rigs_own_emulator_is_no_export_and_no_pass(tmp_path: Path) -> None:
    record = judged(PoleSpec.double(1.1, 75.0), COIL)
    with pytest.raises(InputError, match=r"--allow-unverified") as caught:
        export_folder(record, "python", tmp_path / "out")
    assert "loses the ball in 5 of 5 seeds" in str(caught.value)
    assert failed(verdict_of(record, tmp_path / "out")) == {"emulated rig: ball lost"}


def test_what_the_record_says_of_the_emulated_rig_is_not_run_again(
    tuned_record: DesignRecord,
) -> None:
    assert doubts(tuned_record) == ()
    told = with_document(tuned_record, emulated={"lost": 1, "seeds": 7})
    assert "in 1 of 7 seeds" in doubts(told)[0]
    assert doubts(with_document(tuned_record, emulated=None)) == ()


def test_the_emulated_rig_runs_at_the_period_of_the_design(tmp_path: Path) -> None:
    effects = {"emulator.period": 0.002, "emulator.sensor_step": 1e-6}
    record = judged(PoleSpec.double(1.1, 75.0), effects)
    verdict = verdict_of(record, tmp_path / "out")
    assert failed(verdict) == set()
    (check,) = [x for x in verdict.checks if x.name.startswith("emulated")]
    assert "runs at its own period, 0.001 s" in check.note
    assert emulated_at_own_period(rig_with(SHORT, {"emulator.period": 0.002})) is None


def test_the_emulated_run_is_that_of_the_simulation() -> None:
    effects = {
        "emulator.resistance": 10.0,
        "emulator.inductance": 0.01,
        "emulator.sensor_step": 2e-6,
        "emulator.actuator_step": 1e-3,
        "emulator.delay": 0.0002,
    }
    record = judged(PoleSpec.double(1.1, 75.0), effects)
    rig = emulated_at_own_period(record.rig)
    assert rig is not None
    controller = controller_of(record, "maglev")

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

    loop = loop_for(rig, record.design, emulate=True)
    plain = nominal_scenario(rig, record.design.believed.beta)
    ideal = simulate(loop_for(rig, record.design), record.design, plain).metrics.itae
    for seed in (0, 1):
        told = simulate(loop, record.design, replace(plain, noise=True, seed=seed)).metrics.itae
        found = emulated_run(controller, Device, rig, seed)
        assert found == pytest.approx(told, rel=SAME_TRACK)
        assert abs(ideal / told - 1) > 2 * SAME_TRACK


def test_the_linear_loop_is_that_of_the_tuning_at_every_delay() -> None:
    for delay in (0.0, 0.0004, 0.001, 0.0023):
        record = judged(PoleSpec.double(1.1, 75.0), {"sampling.delay": delay})
        subject = PromiseSubject(controller_of(record, "maglev"))
        loop = loops.loop_of(record.rig, record.design)
        for gap, ratio in ((0.02, 0.9), (0.0246, 1.1)):
            own = subject.linear(gap, ratio, 0.0)
            polynomial = loop.characteristic([0, 0, 0, 0], gap, ratio)[0].full().ravel()
            assert own.radius() == pytest.approx(np.abs(np.roots(polynomial)).max(), rel=1e-9)
            for theta in (0.01, 0.3, 3.0):
                value = float(loop.sensitivity([0, 0, 0, 0], gap, ratio, theta)[0])
                assert own.sensitivity(np.array([theta]))[0] == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("reading", ["measured", "appendix-a"])
def test_every_reading_keeps_its_promises(tmp_path: Path, reading: Any) -> None:
    changes = {
        "plant.gap_offset": 0.001,
        "operating_point.voltage": 2.15,
        "uncertainty.gap_offset": [0.0005, 0.002],
    }
    record = judged(PoleSpec.double(1.1, 75.0), changes, equilibrium=reading)
    assert record.document["scenarios"] == "nominal"
    assert failed(verdict_of(record, tmp_path / "out")) - {"promised certificate"} == set()
    forged = changed(record.document, "family.gap_offsets", [0.0, 0.003])
    found = failed(verdict_of(with_document(record, **forged), tmp_path / "forged"))
    assert {"promised worst ITAE of the family", "promised Ms"} <= found
