"""The design record: what ran, from which parameters, with which versions, and what came out.

``design.json`` holds everything that later verbs need; ``design.npz`` the curves that the plots
show. Neither holds a time, a path or a name of a machine: the same inputs give the same bytes.
"""

from __future__ import annotations

import copy
import io
import math
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maglev_design import __version__
from maglev_design.arrays import arrays_sha256, read_arrays
from maglev_design.controller.data import design_as_data, design_from_data
from maglev_design.controller.design import (
    Design,
    coefficient_inputs,
    difference_coefficients,
    reference_of,
    tangent_matrices,
)
from maglev_design.controller.matching import plant_words
from maglev_design.errors import InputError
from maglev_design.files import digest, finite, json_bytes, read_document, write_bytes
from maglev_design.options import SCHEMA_VERSION, TAN_GPI
from maglev_design.programs import gains_program, slope_program
from maglev_design.rig import Rig, make_rig
from maglev_design.simulation import simulate

if TYPE_CHECKING:
    from maglev_design.certification.lyapunov.lmi import LmiCertificate
    from maglev_design.certification.margins import Margins
    from maglev_design.tuning import TradeOff, TuneResult

KIND = "maglev-design"
RECORD_VERSION = 2
"""Of the layout of a design record; a record of another layout is made anew."""
PACKAGES = ("casadi", "control", "cvxpy", "numpy", "scipy", "sympy")
CERTIFICATE_FIELDS = ("loop", "certified", "status", "decay", "largest_beta_error", "solver")
SAME_POLES = 1e-6
"""Relative: poles that were computed from given gains are the roots of a polynomial."""
LARGEST_RECORD = 10_000_000
"""[bytes]"""

Curves = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True)
class DesignRecord:
    """One saved design.

    Attributes
    ----------
    rig : Rig
        As it was used, command-line changes included.
    design : Design
        The controller with all its numbers.
    document : dict
        The whole of ``design.json``.
    curves : mapping of str to array
        What the plots show; empty when read back without ``design.npz``, which is read and
        compared with the hash in `document` when they are looked at.
    """

    rig: Rig
    design: Design
    document: dict[str, Any]
    curves: Curves

    @property
    def given_beta_error(self) -> float | None:
        """Half the width of the interval of beta_c/beta [-] where it was asked for.

        None where the family is that of the rig's own ``[uncertainty]``.
        """
        given: float | None = self.document["beta_error_given"]
        return given

    def controller(self) -> Any:
        """Return the controller's linear core as a python-control state space, dt = T [s].

        From what the law reads, for TAN-GPI e = y - y* [m], to the voltage beside its feedforward
        [V]; the clamp is not in it. The slope of the command is the one that it has at rest at Y,
        under the voltage U that the controller takes to hold the ball there; of FEE-GPI, whose
        command is a root, it is another one elsewhere. The plant's gain is negative, so the loop of
        both is ``control.feedback(plant * controller, sign=1)``.
        """
        import control  # noqa: PLC0415 - heavy

        from maglev_design.programs.derived import core  # noqa: PLC0415 - SymPy

        design, rig = self.design, self.rig
        linear, names = core(design.method, design.controller)
        known = {symbol: design.coefficients[symbol.name] for symbol in names}
        parts = [
            np.array(part.subs(known), dtype=float)
            for part in (linear.A, linear.B, linear.C, linear.D)
        ]
        slope, _ = slope_program(design.controller).scalar()(
            design.believed.U,
            design.Y,
            design.believed.beta,
            rig.plant.gap_offset,
            design.believed.C_U,
        )
        parts[2], parts[3] = slope * parts[2], slope * parts[3]
        return control.ss(*parts, self.design.period)

    def plant(self, gap: float | None = None, ratio: float = 1.0) -> Any:
        """Return the plant's tangent at rest as a python-control state space, continuous.

        From the voltage's deviation [V] to that of the gap [m]; states (y_delta, y_delta') and,
        behind a drive with a lag or a coil, the current's over C [V]. The rig's delay, which the
        exported loop has, is not in it.

        Parameters
        ----------
        gap : float, optional
            [m]; default: Y.
        ratio : float
            beta_c/beta [-].
        """
        import control  # noqa: PLC0415 - heavy

        at = self.design.Y if gap is None else gap
        return control.ss(*tangent_matrices(self.rig, self.design.beta_at(ratio), at))


def called(document: Mapping[str, Any]) -> str:
    """Return what a record's design is called beside others: found by a search, or given."""
    return "given" if document["status"] == "judged" else "tuned"


def rig_as_data(rig: Rig) -> dict[str, Any]:
    """Return the rig as JSON data; an unlimited upper bound is None."""
    return dict(finite(rig.model_dump(exclude_none=True)))


def rig_from_data(data: Any, origin: str) -> Rig:
    """Return the rig of :func:`rig_as_data`."""
    if not isinstance(data, dict):
        raise InputError(f"{origin}: rig: must be a table")
    data = copy.deepcopy(data)
    limits = data.get("limits")
    if isinstance(limits, dict):
        for name, bounds in limits.items():
            if isinstance(bounds, list):
                limits[name] = [math.inf if bound is None else bound for bound in bounds]
    return make_rig(data, origin)


def make_record(
    result: TuneResult,
    margins: Margins,
    certificate: LmiCertificate | None,
    trade_off: TradeOff | None = None,
) -> DesignRecord:
    """Return the record of a tuning, with what was certified of its sampled loop.

    Without a `certificate` the record says that none is made for the loop.
    """
    from maglev_design.tuning import as_json  # noqa: PLC0415 - not for reading a record back

    rig, design = result.problem.rig, result.design
    versions = {name: metadata.version(name) for name in PACKAGES}
    document = {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "record_version": RECORD_VERSION,
        "versions": {"maglev-design": __version__, "python": platform.python_version()} | versions,
        "rig": rig_as_data(rig),
        "design": design_as_data(design),
        **as_json(result),
        "margins": margins,
        "certificate": _certificate(result, certificate),
    }
    curves = _curves(result)
    if trade_off is not None:
        document["pareto"] = trade_off.as_dicts()
        curves |= {f"pareto_{name}": column for name, column in vars(trade_off).items()}
        curves["pareto_front"] = trade_off.front.astype(float)
    document["curves_sha256"] = arrays_sha256(curves)
    return DesignRecord(rig, design, finite(document), curves)


def _certificate(result: TuneResult, found: LmiCertificate | None) -> dict[str, Any]:
    """Return whether and of what there is a proof; the proof itself `certify` writes."""
    if found is None:
        over, rig = result.problem.family, result.problem.rig
        of = plant_words(rig) or f"the law {result.design.controller.name}"
        return dict.fromkeys(CERTIFICATE_FIELDS) | {
            "loop": "sampled",
            "certified": False,
            "status": f"not made for this loop: Lyapunov certificates are of {TAN_GPI.name} on an "
            f"inverse-square force under ideal current drive, not of {of}; margins are",
            "gaps": list(over.gaps),
            "ratios": list(over.ratios),
        }
    whole = found.as_dict()
    return {name: whole[name] for name in CERTIFICATE_FIELDS} | {
        "gaps": [float(x) for x in found.claim.gaps],
        "ratios": [float(x) for x in found.claim.ratios],
    }


def _curves(result: TuneResult) -> dict[str, NDArray[np.float64]]:
    """Return the responses and the landscape behind the plots."""
    from maglev_design.tuning.evaluation import design_at, scenario_at  # noqa: PLC0415
    from maglev_design.tuning.problem import TuningCase  # noqa: PLC0415

    problem = result.problem
    curves: dict[str, NDArray[np.float64]] = {}
    shown = [
        ("worst", problem, result.poles, result.figures.case, result.figures.ratio),
        ("nominal", problem, result.poles, TuningCase(), 1.0),
    ]
    if result.baseline is not None:
        found = result.baseline
        figures = found.figures
        shown.append(("baseline", found.problem, found.poles, figures.case, figures.ratio))
    for label, of, poles, case, ratio in shown:
        scenario = scenario_at(of, case, ratio)
        response = simulate(of.runs, design_at(of, poles), scenario)
        curves[f"{label}_gap"] = response.gap
        curves[f"{label}_commanded"] = response.commanded
        curves["times"], curves["reference"] = response.times, response.reference
    if result.landscape is not None:
        curves["landscape_zeta"] = result.landscape.zeta
        curves["landscape_omega_n"] = result.landscape.omega_n
        curves["landscape_objective"] = result.landscape.objective
        for name, slack in result.landscape.slack.items():
            curves[f"slack: {name}"] = slack
    return curves


def document_bytes(document: Mapping[str, Any]) -> bytes:
    """Return the content of ``design.json``, with the digest over all the rest of it."""
    return json_bytes({**document, "sha256": digest(document)})


def save(record: DesignRecord, folder: Path) -> tuple[Path, ...]:
    """Write ``design.json`` and ``design.npz`` into `folder`; return their paths."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **record.curves)
    paths = (folder / "design.json", folder / "design.npz")
    write_bytes(paths[0], document_bytes(record.document))
    write_bytes(paths[1], buffer.getvalue())
    return paths


def load(path: str | Path) -> DesignRecord:
    """Read a record, or the one in a folder, back and check that it is whole.

    Raises
    ------
    InputError
        When the file cannot be read, is not a design record, is of another schema, was changed
        since it was written, or holds numbers that do not belong together.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "design.json"
    document = read_document(path, "a design record", LARGEST_RECORD)
    try:
        whole = digest(document)
    except ValueError as error:
        raise InputError(f"{path}: not a design record (a number that is not finite)") from error
    if document.get("kind") != KIND:
        raise InputError(f"{path}: kind = {document.get('kind')!r}: must be {KIND!r}")
    version = (document.get("schema_version"), document.get("record_version"))
    if version != (SCHEMA_VERSION, RECORD_VERSION):
        raise InputError(
            f"{path}: schema_version, record_version = {version[0]!r}, {version[1]!r}: this "
            f"program reads {SCHEMA_VERSION}, {RECORD_VERSION}; make the record anew: "
            "maglev-design tune -o FOLDER"
        )
    if document.get("sha256") != whole:
        raise InputError(
            f"{path}: damaged or edited: its content does not match its sha256; tune again, or "
            "change the rig file and not the result"
        )
    try:
        rig = rig_from_data(document["rig"], str(path))
        design = design_from_data(document["design"], str(path))
        _check_numbers(rig, design, document, path)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(f"{path}: damaged: {type(error).__name__} at {error}") from error
    curves = path.with_suffix(".npz")
    stored = _StoredCurves(curves, document.get("curves_sha256")) if curves.exists() else {}
    return DesignRecord(rig, design, document, stored)


class _StoredCurves(Mapping[str, NDArray[np.float64]]):
    """The arrays of a ``design.npz``, read when they are first looked at.

    Raises
    ------
    InputError
        There, when the file is damaged or not that of the record beside it.
    """

    def __init__(self, path: Path, sha256: object) -> None:
        self._path, self._sha256 = path, sha256

    @cached_property
    def _arrays(self) -> Curves:
        if self._sha256 is None:
            raise InputError(
                f"{self._path}: the design.json beside it, of an earlier version, does not say "
                "which curves are its own; make the record anew, or take this file away to go "
                "without curves"
            )
        found = read_arrays(self._path)
        if arrays_sha256(found) != self._sha256:
            raise InputError(
                f"{self._path}: not the curves of the design.json beside it; put them back, make "
                "the record anew, or take this file away to go without curves"
            )
        return found

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)


def _check_numbers(rig: Rig, design: Design, document: Mapping[str, Any], path: Path) -> None:
    """Raise `InputError` where a record's numbers contradict each other."""
    from maglev_design.tuning.document import difference_equation  # noqa: PLC0415

    known = coefficient_inputs(rig, design.believed) | design.named_gains
    made = difference_coefficients(known, design.method, design.controller)
    mine = (
        rig.sampling.period,
        rig.operating_point.gap,
        (rig.limits.voltage[0], rig.limits.voltage[1]),
        reference_of(rig),
    )
    if (design.period, design.Y, design.voltage_limits, design.reference) != mine:
        raise InputError(f"{path}: period, Y, limits or reference do not belong to the rig")
    told = {
        "gains": design.named_gains,
        "difference_equation": difference_equation(design),
        "controller_sha256": design.sha256,
    }
    if made.keys() != design.coefficients.keys() or not all(
        math.isclose(made[name], design.coefficients[name], rel_tol=1e-12) for name in made
    ):
        raise InputError(
            f"{path}: the difference equation does not belong to the gains and the rig; tune again"
        )
    for name, value in told.items():
        if document[name] != finite(value):
            raise InputError(f"{path}: {name} is not that of the design beside it; tune again")
    if not _placed(design):
        raise InputError(f"{path}: the gains do not belong to the poles; tune again")


def _placed(design: Design) -> bool:
    """Whether the poles that stand beside the gains of TAN-GPI are those that the gains place."""
    if design.controller.name != TAN_GPI.name:
        return True
    gains = gains_program(design.controller).scalar()(*design.poles.values)
    return all(map(partial(math.isclose, rel_tol=SAME_POLES), gains, design.gains))
