"""The chain as functions: from a rig to a controller that was checked, one call an arrow.

These are the functions of the package's front page. The verbs `tune`, `design` and `certify` of the
command line share their parts; the other verbs work with the rooms below.

A saved design is a whole subject: ``simulate``, ``sweep`` and ``certify`` take its record as it is,
with its rig, its controller and the family of plants that it was made for. A rig needs a controller
beside it, and its family is that of its own ``[uncertainty]``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from maglev_design.controller.checks import check_path_voltage
from maglev_design.controller.design import (
    PAPER_POLES,
    Design,
    PoleSpec,
    make_design,
)
from maglev_design.controller.matching import is_certified_law, only_papers_plant
from maglev_design.errors import InfeasibleError, InputError
from maglev_design.files import output_folder
from maglev_design.options import METHODS, TAN_GPI, Controller, Equilibrium, Method, Target
from maglev_design.rig import Rig, is_papers

if TYPE_CHECKING:
    from maglev_design.certification.assessment import Assessment, AssessmentSubject
    from maglev_design.certification.lyapunov.lmi import LmiCertificate
    from maglev_design.exporting import Export, Verdict
    from maglev_design.record import DesignRecord
    from maglev_design.reporting.write import Form
    from maglev_design.simulation import Response
    from maglev_design.sweeping import SweepResult
    from maglev_design.tuning import TradeOff, TuneResult, TuningProblem, Unstabilisable

Progress = Callable[[str, float], None]
"""Told the stage, and the share of it that is done [0, 1]."""


def _silent(_stage: str, _done: float) -> None:
    """Tell nobody."""


def design(
    rig: Rig,
    zeta: float,
    omega_n: float,
    *,
    law: Controller | None = None,
    equilibrium: Equilibrium = "model",
    method: Method | None = None,
) -> Design:
    """Return the controller of `rig` with a double pole pair, (24) of the paper.

    Parameters
    ----------
    rig : Rig
    zeta : float
        Damping ratio [-], positive.
    omega_n : float
        Natural frequency [rad/s], positive.
    law : Controller, optional
        Default: TAN-GPI of the order of the rig's plant.
    equilibrium : {"model", "appendix-a", "measured"}
        How U, C_U and C_Y are known.
    method : {"tustin", "euler", "zoh"}, optional
        Default: the rig's.

    Raises
    ------
    InputError
        For poles that are not positive, or a reading without its measured voltage.

    Examples
    --------
    >>> from maglev_design import design, load_rig
    >>> design(load_rig("belmonte2021"), zeta=1, omega_n=70).named_gains["k3"]
    280.0
    """
    poles = PoleSpec.double(zeta, omega_n)
    return make_design(rig, poles, controller=law, equilibrium=equilibrium, method=method)


def tune(
    rig: Rig,
    *,
    method: Method | Literal["auto"] | None = None,
    baseline: tuple[float, float] | None = None,
    certified: bool = False,
    pareto: bool = False,
    progress: Progress = _silent,
    **limits: Any,
) -> DesignRecord:
    """Return the controller with the smallest worst-case error that the limits allow, recorded.

    The record's ``document`` is what ``tune --json`` prints: its ``status`` says whether the limits
    are kept, ``design`` is the controller.

    Parameters
    ----------
    rig : Rig
    method : {"tustin", "euler", "zoh", "auto"}, optional
        Default: the rig's; ``auto`` tunes all and keeps the best.
    baseline : tuple of float, optional
        (zeta [-], omega_n [rad/s]) to compare with; default: the paper's poles on its own rig.
    certified : bool
        Whether a proof that the sampled loop is stable is a limit, too.
    pareto : bool
        Whether the record shows what robustness costs.
    progress : callable
    **limits
        ``objective``, ``equilibrium``, ``beta_error``, ``max_ms``, ``max_noise_voltage``,
        ``allow_saturation``, ``scenarios`` and others of
        :func:`maglev_design.tuning.build_problem`.

    Raises
    ------
    InfeasibleError
        Where no poles stabilise the sampled loop.
    InputError
        For limits that are not usable, or a path that the rig's voltage cannot follow.
    """
    from maglev_design.simulation import designed_for  # noqa: PLC0415
    from maglev_design.tuning import Unstabilisable  # noqa: PLC0415

    plant = designed_for(rig) if limits.get("scenarios") == "emulated" else rig
    if pareto:
        only_papers_plant(plant, "pareto")
    found = solved(
        plant, method=method, baseline=baseline, certified=certified, progress=progress, **limits
    )
    if isinstance(found, Unstabilisable):
        raise InfeasibleError(str(found), "spectral radius")
    return recorded(found, progress, pareto=pareto)


def solved(
    rig: Rig,
    *,
    method: Method | Literal["auto"] | None,
    baseline: tuple[float, float] | None,
    certified: bool,
    progress: Progress,
    **limits: Any,
) -> TuneResult | Unstabilisable:
    """Return the answer of :func:`tune` as the search has it, before it is recorded."""
    from maglev_design.tuning import build_problem, solve, solve_every_method  # noqa: PLC0415

    check_path_voltage(rig)
    if certified:
        only_papers_plant(rig, "--certify: a Lyapunov certificate")
    proof = _proof(rig, limits.get("beta_error")) if certified else None

    def problem(one: Method | None) -> TuningProblem:
        return build_problem(rig, method=one, certifies=proof, **limits)

    compared = baseline_of(rig, baseline)
    if method == "auto":
        return solve_every_method({name: problem(name) for name in METHODS}, progress, compared)
    return solve(problem(method), progress, compared)


def baseline_of(rig: Rig, asked: tuple[float, float] | None) -> PoleSpec | None:
    """Return the poles to compare with: those asked for, on the paper's rig the paper's."""
    if asked is not None:
        return PoleSpec.double(*asked)
    return PoleSpec.double(*PAPER_POLES) if is_papers(rig) else None


def recorded(result: TuneResult, progress: Progress, *, pareto: bool = False) -> DesignRecord:
    """Return the record of a result, with the margins and the certificate of its sampled loop."""
    from maglev_design.certification.lyapunov.lmi import certify_family  # noqa: PLC0415
    from maglev_design.certification.margins import sampled_margins  # noqa: PLC0415
    from maglev_design.record import make_record  # noqa: PLC0415

    problem, certificate = result.problem, None
    progress("margins", 0.0)
    margins = sampled_margins(problem.loop, result.poles.values, problem.family)
    progress("certificate", 0.3)
    if is_certified_law(problem.rig, problem.controller):
        (certificate,) = certify_family(
            result.design, problem.rig, beta_error=problem.given_beta_error, loops=("sampled",)
        )
    trade = _trade_off(result, progress) if pareto else None
    return make_record(result, margins, certificate, trade)


def _proof(rig: Rig, beta_error: float | None) -> Callable[[Design], bool]:
    """Return the question whether a controller's sampled loop is proved stable."""
    from maglev_design.certification.lyapunov.lmi import certify_sampled  # noqa: PLC0415

    return lambda made: certify_sampled(made, rig, beta_error=beta_error).certified


def _trade_off(result: TuneResult, progress: Progress) -> TradeOff:
    from maglev_design.certification.lyapunov.lmi import widest_sampled  # noqa: PLC0415
    from maglev_design.tuning import trade_off  # noqa: PLC0415

    def widest(made: Design) -> float:
        found = widest_sampled(made, result.problem.rig)
        return math.nan if found is None else float(found.claim.ratios[1] - 1)

    return trade_off(result, widest, progress)


def simulate(
    subject: DesignRecord | Rig,
    controller: Design | None = None,
    *,
    ratio: float = 1.0,
    noise: bool = False,
    seed: int = 0,
    continuous: bool = False,
) -> Response:
    """Run a controller on the nonlinear plant of its rig, from its start along its path.

    Parameters
    ----------
    subject : DesignRecord or Rig
    controller : Design, optional
        Made for this rig; a record brings its own.
    ratio : float
        beta_c/beta [-]: the plant's force constant is the controller's over it.
    noise : bool
        Whether the rig's input and position noise act.
    seed : int
        Of the noise.
    continuous : bool
        Whether the continuous law runs instead of the sampled one.

    Raises
    ------
    InputError
        For a rig without a controller, or a record with another one.

    Examples
    --------
    >>> from maglev_design import design, load_rig, simulate
    >>> rig = load_rig("belmonte2021")
    >>> f"{simulate(rig, design(rig, 1, 70), continuous=True).metrics.itae:.3e} m s^2"
    '8.191e-07 m s^2'
    """
    from maglev_design import simulation  # noqa: PLC0415 - CasADi

    rig, made, _ = _told(subject, controller)
    start = simulation.Scenario(
        made.beta_at(ratio), rig.initial.gap, rig.initial.velocity, noise=noise, seed=seed
    )
    loop = simulation.loop_for(rig, made, continuous=continuous)
    return simulation.simulate(loop, made, start)


def _told(
    subject: DesignRecord | Rig, controller: Design | None
) -> tuple[Rig, Design, float | None]:
    """Return a subject's rig and controller, and the error of beta that it was made with."""
    if not isinstance(subject, Rig):
        if controller is not None:
            raise InputError("a record brings its own controller: leave one of the two out")
        return subject.rig, subject.design, subject.given_beta_error
    if controller is None:
        raise InputError("a rig alone says no controller: give one of `design` beside it")
    return subject, controller, None


def sweep(
    subject: DesignRecord | Rig,
    controllers: Iterable[Design],
    folder: str | Path,
    *,
    samples: int,
    seed: int = 0,
    force: bool = False,
) -> SweepResult:
    """Run controllers on the same draws of the rig's uncertainty, into a folder.

    Stopped at any moment, the same call goes on where it was.

    Parameters
    ----------
    subject : DesignRecord or Rig
    controllers : iterable of Design
        Made for this rig; of a record those that run beside its own, maybe none.
    folder : path
    samples : int
        Draws.
    seed : int
        Of the draws and of the noise.
    force : bool

    Raises
    ------
    InputError
        When the folder belongs to another sweep, or this program did not write it, unless `force`;
        for no design, or designs of two families.
    """
    from maglev_design import sweeping  # noqa: PLC0415

    rig, error, made = subject, None, tuple(controllers)
    if not isinstance(rig, Rig):
        rig, own, error = _told(rig, None)
        made = (own, *made)
    setup = sweeping.make_setup(rig, made, samples=samples, seed=seed, beta_error=error)
    return sweeping.sweep(setup, output_folder(Path(folder), force=force), force=force)


@dataclass(frozen=True)
class Certification:
    """What is proved of one controller over one family of plants.

    Attributes
    ----------
    assessment : Assessment
        Exact intervals of beta_c/beta, largest period and delay, margins.
    certificates : tuple of LmiCertificate
        A common quadratic Lyapunov function of the continuous and of the sampled loop, found or
        refused; empty for other laws than TAN-GPI.
    """

    assessment: Assessment
    certificates: tuple[LmiCertificate, ...]

    @property
    def certified(self) -> bool:
        """Whether the sampled loop, the one that is exported, is proved stable over the family.

        What is proved of the continuous law, which does not run, stands in `certificates`.
        """
        return any(one.certified for one in self.certificates if one.claim.loop == "sampled")


def certify(
    subject: DesignRecord | Rig,
    controller: Design | None = None,
    *,
    beta_error: float | None = None,
    gap_range: tuple[float, float] | None = None,
    progress: Progress = _silent,
) -> Certification:
    """Prove what holds of a controller over its family of plants.

    Parameters
    ----------
    subject : DesignRecord or Rig
    controller : Design, optional
        Made for this rig; a record brings its own.
    beta_error : float, optional
        Half the width of the interval of beta_c/beta [-]; default: what the record was made with,
        else what the rig says for the controller's reading.
    gap_range : tuple of float, optional
        [m]; default: the hull of path, initial gap and Y.
    progress : callable

    Raises
    ------
    InputError
        For a family that is impossible, a path that the rig's voltage cannot follow, a rig without
        a controller, or a record with another one.
    """
    return proved(to_prove(subject, controller, beta_error, gap_range), progress)


def to_prove(
    subject: DesignRecord | Rig,
    controller: Design | None,
    beta_error: float | None,
    gap_range: tuple[float, float] | None,
) -> AssessmentSubject:
    """Return what :func:`certify` is asked to prove, checked; nothing is computed yet."""
    from maglev_design.certification import assessment  # noqa: PLC0415

    rig, made, error = _told(subject, controller)
    check_path_voltage(rig)
    only_papers_plant(rig, "certify", made.controller)
    return assessment.subject(
        rig, made, beta_error=error if beta_error is None else beta_error, gap_range=gap_range
    )


def proved(own: AssessmentSubject, progress: Progress) -> Certification:
    """Return the answer of :func:`certify`."""
    from maglev_design.certification.assessment import assess  # noqa: PLC0415
    from maglev_design.certification.lyapunov.lmi import certify_family  # noqa: PLC0415

    found = assess(own, lambda stage, done: progress(stage, 0.8 * done))
    if own.design.controller.name != TAN_GPI.name:
        return Certification(found, ())
    progress("Lyapunov functions", 0.8)
    return Certification(
        found,
        certify_family(own.design, own.rig, beta_error=own.beta_error, gap_range=own.family.gaps),
    )


def export(
    record: DesignRecord, target: Target, folder: str | Path, *, force: bool = False, **how: Any
) -> Export:
    """Write the controller of a record as a folder that stands alone.

    As :func:`maglev_design.exporting.export_folder`.
    """
    from maglev_design.exporting import export_folder  # noqa: PLC0415

    return export_folder(record, target, Path(folder), force=force, **how)


def verify(
    folder: str | Path, progress: Progress = _silent, *, run_untrusted: bool = False
) -> Verdict:
    """Print an exported folder again, compare, build it, run it, and recompute its promises.

    As :func:`maglev_design.exporting.verify_folder`: nothing that lies in the folder is run unless
    `run_untrusted`.
    """
    from maglev_design.exporting import verify_folder  # noqa: PLC0415

    return verify_folder(Path(folder), progress, run_untrusted=run_untrusted)


def report(
    record: DesignRecord,
    folder: str | Path,
    forms: Iterable[Form] = ("markdown",),
    *,
    force: bool = False,
) -> tuple[Path, ...]:
    """Write the report of a record; return its files.

    Raises
    ------
    InputError
        For a folder that this program did not write, unless `force`; for ``pdf`` without a tool.
    """
    from maglev_design.reporting.write import write_report  # noqa: PLC0415

    return write_report(record, output_folder(Path(folder), force=force), forms)
