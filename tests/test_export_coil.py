"""A controller of third order, exported, on plants that were not lowered from the statement."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from exported import EXACT, compiled, judged, run
from rigs import SHORT, changed, rig_with
from test_plants import COIL

from maglev_design.controller.design import PoleSpec, believed_equilibrium, reference_path
from maglev_design.controller.family import family_of
from maglev_design.exporting import export_folder, verify_folder
from maglev_design.exporting.controller import controller_of, own_modulus, state_bounds
from maglev_design.exporting.loops import ExportedRun, FlownPlant, close, fly
from maglev_design.exporting.promises import PromiseSubject
from maglev_design.exporting.vectors import Recorder
from maglev_design.linear_loop import loop_of
from maglev_design.options import Target
from maglev_design.record import DesignRecord
from maglev_design.rig import Rig
from maglev_design.simulation import nominal_scenario

LATENCY = 0.0004
TARGETS: tuple[Target, ...] = ("c", "python", "matlab")
UNCERTAIN = 0.1
"""Of the force constant."""
SAME_TRACK = 1e-6
"""[m] Two integrators."""

MAIN = """
/* A main loop of one's own: coil with the energy's inductance, latency, explicit Euler at 2 us. */
#include <stdio.h>
#include <stdlib.h>
#include "lev.h"

int main(int count, char **words)
{
    const double mass = 0.02, gravity = 9.81, force = 2.48315625e-5 * atof(words[1]);
    const double resistance = (1 / 1.05) * atof(words[2]), inductance = 0.0048 * atof(words[3]);
    const double latency = atof(words[4]), at = 0.0246, h = 2e-6;
    double gap = 0.0244, velocity = 0.0, current, voltage, next = 0.0, worst = 0.0;
    lev_state state;
    lev_reference reference;
    int k;

    if (count != 5) return 3;
    current = gap * sqrt(mass * gravity / force);
    voltage = resistance * current;
    lev_init(&state);
    if (!lev_reference_init(&reference, 0.0242)) return 2;
    if (!lev_reference_retarget(&reference, 0.0200, 0.1, 0.3)) return 2;
    for (k = 0; k < 1500; k++) {
        const lev_point point = lev_reference_step(&reference);
        int n;
        next = lev_step_at(&state, gap, &point);
        for (n = 0; n < 500; n++) {
            const double coil = inductance + 2 * force * (1 / gap - 1 / at);
            const double emf = -2 * force * current * velocity / (gap * gap);
            if (n * h >= latency) voltage = next;
            current += h * (voltage - resistance * current - emf) / coil;
            velocity += h * (gravity - force * current * current / (mass * gap * gap));
            gap += h * velocity;
            if (gap < 0.001 || gap > 0.05) {
                (void)printf("lost at %g s\\n", k * 1e-3 + n * h);
                return 1;
            }
        }
        if (k > 400 && fabs(gap - point.gap) > worst) worst = fabs(gap - point.gap);
    }
    (void)printf("held worst %.3g um\\n", worst * 1e6);
    return 0;
}
"""


@pytest.fixture(scope="module")
def record() -> DesignRecord:
    """A coil of 5 ms with 0.4 ms of latency."""
    changes = {"drive": COIL, "plant.current_gain": ..., "uncertainty.beta": UNCERTAIN}
    return judged(PoleSpec.double(1.7, 80.0), changes | {"sampling.delay": LATENCY})


@pytest.fixture(scope="module")
def folder(record: DesignRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("coil")
    export_folder(record, "c", place, prefix="lev", allow_unverified=True)
    return place


def test_it_levitates_in_a_plant_of_ones_own_at_every_corner(folder: Path, tmp_path: Path) -> None:
    for name in ("lev.c", "lev.h"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "main.c").write_text("#include <math.h>\n" + MAIN, "ascii")
    program = compiled("gcc", tmp_path, ["lev.c", "main.c"], *EXACT)
    ratios = (1 / (1 - UNCERTAIN), 1.0, 1 / (1 + UNCERTAIN))
    for force, resistance, coil, late in itertools.product(
        ratios, (0.97, 1.03), (0.95, 1.05), (0.0, LATENCY)
    ):
        said = run(tmp_path, str(program), *map(str, (force, resistance, coil, late))).stdout
        assert said.startswith("held worst ")
        assert float(said.split()[2]) < 100, (force, resistance, coil, late, said)


def test_the_second_order_law_never_comes_to_rest_there(tmp_path: Path) -> None:
    """The tuned gains of the ideal rig: what the coil is reckoned with for."""
    ideal = judged(PoleSpec.double(1.137, 107.3), {"sampling.delay": LATENCY})
    export_folder(ideal, "c", tmp_path, prefix="lev", allow_unverified=True)
    (tmp_path / "main.c").write_text("#include <math.h>\n" + MAIN, "ascii")
    program = compiled("gcc", tmp_path, ["lev.c", "main.c"], *EXACT)
    said = run(tmp_path, str(program), "1.1", "1", "1", str(LATENCY)).stdout
    assert float(said.split()[2]) > 500


@pytest.mark.parametrize("target", TARGETS)
def test_every_target_keeps_its_vectors_and_its_promises(
    record: DesignRecord, tmp_path: Path, target: Target
) -> None:
    export_folder(record, target, tmp_path / "folder", prefix="lev", allow_unverified=True)
    verdict = verify_folder(tmp_path / "folder")
    assert [check.name for check in verdict.checks if not check.passed] == []
    assert any("promised worst" in check.name for check in verdict.checks)


def test_the_old_step_is_the_new_one_at_rest(folder: Path, tmp_path: Path) -> None:
    for name in ("lev.c", "lev.h"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "main.c").write_text(
        '#include "lev.h"\n#include <string.h>\nint main(void)\n{\n    lev_state a, b;\n'
        "    lev_point point;\n    int k, same = 1;\n    (void)memset(&point, 0, sizeof point);\n"
        "    lev_init(&a);\n    lev_init(&b);\n    for (k = 0; k < 100; k++) {\n"
        "        const double gap = 0.0242 + 1e-5 * (k % 7);\n        point.gap = 0.0241;\n"
        "        point.acceleration = 0.1 * k;\n"
        "        same &= lev_step(&a, gap, point.gap, point.acceleration) =="
        " lev_step_at(&b, gap, &point);\n    }\n    return same ? 0 : 1;\n}\n",
        "ascii",
    )
    program = compiled("gcc", tmp_path, ["lev.c", "main.c"], *EXACT)
    run(tmp_path, str(program))


def test_states_stay_in_their_bounds_whatever_is_measured(record: DesignRecord) -> None:
    """Errors of the worst signs are the impulse response read backwards."""
    controller = controller_of(record, "lev")
    k, n = record.design.coefficients, controller.numbers
    reach = n["gap_high"] - n["gap_low"]
    a = np.array([[k["a22"], k["a23"]], [k["a32"], k["a33"]]])
    b = np.array([k["b2"], k["b3"]])
    powers = [b]
    for _ in range(3000):
        powers.append(a @ powers[-1])
    for row, name in enumerate(("x2", "x3")):
        worst = [reach * math.copysign(1, p[row]) for p in reversed(powers)]
        x = np.zeros(2)
        for error in worst:
            x = a @ x + b * error
        bound = controller.state_bounds[name]
        assert 0.99 * bound < abs(x[row]) < bound
    assert own_modulus(k) < 1
    assert state_bounds(k, reach) == controller.state_bounds


def flown(controller: object, rig: Rig) -> ExportedRun:
    class Device(Recorder):
        status = 0

        def __init__(self) -> None:
            super().__init__(controller)  # type: ignore[arg-type]

        def reset(self) -> None:
            self.forget()

        def step(  # type: ignore[override]
            self, gap: float, reference: float, acceleration: float, *more: float
        ) -> float:
            return super().step(gap, reference, acceleration, *more)[1]

    assert rig.kind.order == 3
    return ExportedRun(Device())


def test_the_quick_loop_is_the_independent_one(record: DesignRecord) -> None:
    controller = controller_of(record, "lev")
    quick, slow = flown(controller, record.rig), flown(controller, record.rig)
    assert not fly(controller, quick)
    start = nominal_scenario(record.rig, record.design.believed.beta)
    assert not close(controller, slow, start).crashed
    assert max(abs(a - b) for a, b in zip(quick.gaps, slow.gaps, strict=True)) < SAME_TRACK


def test_a_plant_at_rest_stays_where_it_is(record: DesignRecord) -> None:
    rig, gap = record.rig, 0.022
    beta = record.design.believed.beta
    voltage = gap * math.sqrt(rig.plant.gravity / beta)
    state = (gap, 0.0, voltage)
    assert FlownPlant(rig, beta, 0.0).after(0.01, voltage, state) == pytest.approx(state, rel=1e-9)


def test_the_linear_loop_of_the_promises_is_that_of_the_tuning(record: DesignRecord) -> None:
    subject = PromiseSubject(controller_of(record, "lev"))
    loop = loop_of(record.rig, record.design)
    for gap, ratio in itertools.product((0.020, 0.0244), (0.9, 1.1)):
        angles = np.array([0.01, 0.1, 0.5, 2.0])
        own = subject.linear(gap, ratio, 0.0).sensitivity(angles)
        told = [
            float(loop.sensitivity(record.design.poles.values, gap, ratio, x)[0]) for x in angles
        ]
        assert own == pytest.approx(told, rel=1e-7)


def test_the_reference_has_its_third_derivative(record: DesignRecord) -> None:
    times = np.linspace(0.1, 0.3, 401)
    rows = reference_path(record.rig, times, 3)
    slopes = np.gradient(rows[2], times)
    assert np.abs(rows[3] - slopes)[1:-1].max() < 1e-3 * np.abs(rows[3]).max()


def test_what_is_assumed_says_the_coil(folder: Path) -> None:
    text = (folder / "README.md").read_text("ascii")
    assert "coil of R = 0.952381 ohm and L = 0.0048 H at Y = 0.0246 m (with its back-EMF)" in text
    assert "TAN-GPI (third order)" in text


def test_a_measured_voltage_errs_in_what_is_beyond_the_offset() -> None:
    """1 % of 2.38 V is 1.14 % of the 2.08 V that make current."""
    plain = rig_with(changed({**record_data()}, {"operating_point.voltage": 2.0825396825}))
    offset = rig_with(
        changed(record_data(), {"drive.input_offset": 0.3, "operating_point.voltage": 2.3825396825})
    )
    (low, high), (lower, higher) = (family_of(r, "measured").ratios for r in (plain, offset))
    assert (low, high) == pytest.approx((0.99**2, 1.01**2))
    d = 0.01 * 2.3825396825 / 2.0825396825
    assert (lower, higher) == pytest.approx(((1 - d) ** 2, (1 + d) ** 2))
    assert believed_equilibrium(offset, "measured").beta == pytest.approx(
        believed_equilibrium(plain, "measured").beta
    )


def record_data() -> dict[str, object]:
    return changed(SHORT, {"drive.lag": 0.002})
