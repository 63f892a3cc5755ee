"""What a certificate claims in words, made of its numbers alone."""

from __future__ import annotations

from fractions import Fraction

from maglev_design.certification.lyapunov.family import CertificateClaim, ExactSubject


def controller_in_words(of: ExactSubject) -> str:
    """Return of which controller, on which rig, a certificate speaks."""
    numbers = of.numbers
    gains = ", ".join(f"{name} = {value:.8g}" for name, value in numbers["gains"].items())
    bottom, top = numbers["voltage_limits"]
    limit = "no limit" if top is None else f"{top:g} V"
    return (
        f"controller {of.sha256}: tan-gpi, {gains}, U = {numbers['U']:.8g} V, C_U^ = "
        f"{numbers['C_U']:.8g} m/(s^2 V), C_Y^ = {numbers['C_Y']:.8g} 1/s^2, {of.method} at "
        f"{_milli(of.period)} ms, {bottom:g} V to {limit}; on the rig "
        f"{of.rig!r}, where the voltage acts {_milli(of.delay)} ms after its sample"
    )


def claim_in_words(of: ExactSubject, over: CertificateClaim, decay: Fraction) -> str:
    """Return what a certificate says, on which plants, and of which loop."""
    (low, high), (weak, strong) = over.gaps, (f"{float(ratio):.6g}" for ratio in over.ratios)
    sampled = over.loop == "sampled"
    law = "the difference equation" if sampled else "the continuous law with the same gains"
    first, last = (_milli(of.gap_offset + shift) for shift in over.shifts)
    offset = f"y0 = {first} mm taken as known"
    if first != last:
        offset = f"any y0 from {first} mm to {last} mm"
    if first != last and over.held:
        offset += (
            ", where each plant holds the ball at Y with its own voltage and the ratios are those "
            f"at y0 = {_milli(of.gap_offset)} mm"
        )
    pace = f"It decays at least as exp(-{float(decay):.6g} t)." if decay else "No rate is claimed."
    return (
        f"{over.loop} loop: {law} is stable, linearised and away from the limits of the voltage, "
        f"at every gap from {_milli(low)} mm to {_milli(high)} mm and every beta_c/beta from "
        f"{weak} to {strong} (beta_c = {float(of.beta):.8g} m^3/(s^2 V^2); {offset}). The gap may "
        f"move; the ratio {'is fixed' if sampled and of.delay > 0 else 'may move, too'}. {pace}"
    )


def _milli(exact: Fraction) -> str:
    return f"{1e3 * float(exact):.6g}"
