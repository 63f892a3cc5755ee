"""``certify``."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_design.certification.rationals import short
from maglev_design.cli.arguments import flag
from maglev_design.cli.certify_tables import print_assessment
from maglev_design.cli.output import print_json, progress_bar, say, table, warn
from maglev_design.errors import InputError, VerificationError
from maglev_design.files import json_bytes, output_folder, write_bytes
from maglev_design.options import SCHEMA_VERSION

if TYPE_CHECKING:
    from maglev_design.certification.assessment import AssessmentSubject
    from maglev_design.certification.lyapunov.lmi import LmiCertificate
    from maglev_design.cli.commands.certify import CertifyOptions
    from maglev_design.record import DesignRecord

RESULT, CERTIFICATE = "robustness.json", "certificate.json"


def certify(options: CertifyOptions) -> None:
    """Assess, print, save; or only check."""
    if options.check is not None:
        check(options.check, options)
        return
    from maglev_design.certification.region.guaranteed import RegionStatus, status_as_data  # noqa: PLC0415
    from maglev_design.chain import proved  # noqa: PLC0415
    from maglev_design.controller.checks import voltage_warning  # noqa: PLC0415

    own = _subject(options)
    disagreement = voltage_warning(own.rig)
    folder = output_folder(options.output, force=options.force) if options.output else None
    region, refused = None, None
    with progress_bar() as progress:
        found = proved(own, lambda stage, done: progress(stage, 0.7 * done))
        certificates = found.certificates
        if certificates and found.assessment.spectral_radius.value < 1:
            progress("region of initial errors", 0.7)
            region = _region(own, progress)
        elif certificates:
            refused = status_as_data(RegionStatus.SAMPLED_UNSTABLE)
    document = {"rig": own.rig.name, **found.assessment.as_dict()}
    document["lmi"] = [certificate.as_dict() for certificate in certificates]
    document["region"] = region.as_dict() if region else refused
    if options.json:
        print_json(document)
    else:
        print_assessment(document)
    for text in (*([disagreement] if disagreement else []), *_warnings(document)):
        warn(text)
    if folder is not None:
        write_bytes(folder / RESULT, json_bytes({"schema_version": SCHEMA_VERSION} | document))
        for path in (folder / RESULT, *_proofs(certificates, folder), *_figures(region, folder)):
            say(f"written: {path}")
    if region is not None and region.contradictions:
        say("verification failed: a guaranteed start did not survive the simulation")
        sys.exit(VerificationError.exit_code)


def check(path: Path, options: CertifyOptions) -> None:
    """Verify a written certificate anew, and that it is of a design where one is given.

    Exit code 4 when something in it does not hold, or when it is another controller's.
    """
    from maglev_design.certification.lyapunov import certificate  # noqa: PLC0415
    from maglev_design.record import load  # noqa: PLC0415

    own = ("design", "check", "output", "force", "json")
    said = [x for x, value in vars(options).items() if value is not None and x not in own]
    if said:
        raise InputError(f"{flag(said[0])}: says nothing beside --check; leave one of the two out")
    record = load(options.design) if options.design else None
    found = certificate.check(path, (record.design, record.rig) if record else None)
    if options.json:
        print_json(found.as_dict())
    else:
        rows = [(c.name, "yes" if c.passed else "NO", c.detail) for c in found.checks]
        title = f"{path.name}: checked in exact arithmetic"
        table(title, ("check", "holds", "what"), rows, words=3)
        verb = "proves" if found.passed else "does NOT prove what it claims"
        sys.stdout.write(f"{path.name} {verb}, of {found.controller}:\n\n")
        sys.stdout.writelines(f"- {claim}\n" for claim in found.claims)
    if not found.passed:
        failed = ", ".join(f"{c.name} ({c.detail})" for c in found.checks if not c.passed)
        say(f"verification failed: {failed}")
        sys.exit(VerificationError.exit_code)


@dataclass(frozen=True)
class _Region:
    """The guaranteed region beside the simulated one, and where they contradict each other."""

    guaranteed: Any
    whole: Any
    near: Any
    contradictions: tuple[tuple[float, float], ...]

    def as_dict(self) -> dict[str, Any]:
        area = self.whole.area
        return {
            **self.guaranteed.as_dict(),
            "simulated": self.whole,
            "share_of_simulated": self.guaranteed.area / area if area else None,
            "contradictions": self.contradictions,
        }


def _region(own: AssessmentSubject, progress: Any) -> _Region:
    from maglev_design.certification.region import guaranteed, simulated  # noqa: PLC0415
    from maglev_design.simulation import cores  # noqa: PLC0415

    rig, design = own.rig, own.design
    low, high = (short(ratio) for ratio in own.family.ratios)
    found = guaranteed.guaranteed_region(rig, design, (low, high))
    progress("simulated map", 0.9)
    whole = simulated.simulated_map(rig, design, threads=cores())
    around = simulated.region_extent(found)
    maps = []
    if around is not None:
        maps = [
            simulated.simulated_map(rig, design, around, ratio=float(ratio), threads=cores())
            for ratio in dict.fromkeys((Fraction(1), low, high))
        ]
    against = [point for one in (whole, *maps) for point in simulated.contradictions(found, one)]
    return _Region(found, whole, maps[0] if maps else None, tuple(dict.fromkeys(against)))


def _proofs(certificates: tuple[LmiCertificate, ...], folder: Path) -> tuple[Path, ...]:
    """Write the certificate; without one, take away what an earlier run left there."""
    from maglev_design.certification.lyapunov.certificate import write  # noqa: PLC0415

    path = folder / CERTIFICATE
    if not any(c.certified or c.widest is not None for c in certificates):
        path.unlink(missing_ok=True)
        return ()
    write(path, certificates)
    return (path,)


def _figures(region: _Region | None, folder: Path) -> tuple[Path, ...]:
    from maglev_design.certification.region.simulated import region_curves  # noqa: PLC0415
    from maglev_design.reporting.plots.region import region_figure  # noqa: PLC0415
    from maglev_design.reporting.plots.style import house_style, save_figure  # noqa: PLC0415

    if region is None:
        return ()
    curves = region_curves(region.guaranteed, region.whole, region.near)
    gap = f"{1e3 * region.whole.gap:.4g} mm"
    title = f"Initial errors that the continuous law survives, regulating at {gap}"
    with house_style():
        figure = region_figure(curves, title)
        return (save_figure(figure, folder / "region.svg"),)


def _subject(options: CertifyOptions) -> AssessmentSubject:
    """Return which controller is judged on what."""
    from maglev_design.chain import to_prove  # noqa: PLC0415
    from maglev_design.cli.law import asked_poles  # noqa: PLC0415
    from maglev_design.controller.design import make_design  # noqa: PLC0415
    from maglev_design.controller.matching import law_named  # noqa: PLC0415
    from maglev_design.options import DEFAULT_PRESET  # noqa: PLC0415
    from maglev_design.rig import load_rig  # noqa: PLC0415

    if options.design is not None:
        saved = _saved(options.design, options)
        return to_prove(saved, None, options.beta_error, options.gap_range)
    rig = load_rig(options.rig or DEFAULT_PRESET)
    design = make_design(
        rig,
        asked_poles(options),
        controller=law_named(options.controller or "tan-gpi", rig),
        equilibrium=options.equilibrium or "model",
        method=options.method,
    )
    return to_prove(rig, design, options.beta_error, options.gap_range)


def _saved(path: Path, options: CertifyOptions) -> DesignRecord:
    """Return the record of a saved design; nothing of it may be changed."""
    from maglev_design.record import load  # noqa: PLC0415

    if options.rig is not None:
        raise InputError("--rig: the saved design brings its own rig; leave one of the two out")
    record = load(path)
    design = record.design
    zetas, speeds = zip(design.poles.first, design.poles.second, strict=True)
    for option, said, fixed in (
        ("equilibrium", options.equilibrium, (design.equilibrium,)),
        ("method", options.method, (design.method,)),
        ("controller", options.controller, (design.controller.name,)),
        ("zeta", options.zeta, zetas),
        ("omega-n", options.omega_n, speeds),
    ):
        if said is not None and any(said != value for value in fixed):
            raise InputError(
                f"--{option} = {said}: the saved design has {fixed[0]}, and its numbers are judged "
                "as they are; leave the option out, or the design"
            )
    return record


def _warnings(document: dict[str, Any]) -> list[str]:
    """Return what a person who reads the result must not miss."""
    found = []
    low, high = document["family"]["ratios"]
    if low == high:
        found.append("the uncertainty of beta is 0: the family holds exact beta alone")
    if document["sampled"]["spectral_radius"] >= 1:
        found.append("the sampled loop is unstable in the family: it has no margins there")
    if not document["sampled_interval"][-1]["stable"]:
        found.append("over the gaps no interval of beta_c/beta was proved for the sampled loop")
    refused = [row for row in document["lmi"] if not row["certified"]]
    found += [f"{row['loop']} loop {row['status']}" for row in refused]
    for name, limit in (("period", "max_period"), ("delay", "max_delay")):
        if document["sampled"][limit]["status"] == "gave-up":
            found.append(f"largest {name}: {document['sampled'][limit]['message']}")
    first, last = document["family"]["gap_offsets"]
    if first != last:
        found.append(
            "intervals, largest period and delay, and the region take y0 as known; margins and "
            "Lyapunov functions do not"
        )
    region = document["region"]
    if region is None:
        found.append("Lyapunov functions and the region are there for tan-gpi alone")
    elif region["status"] != "guaranteed":
        found.append(region["message"])
    return found
