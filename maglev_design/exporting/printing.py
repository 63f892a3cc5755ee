"""The sources and the README of an export: templates filled with programs and numbers."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maglev_design import __version__
from maglev_design.controller.design import PATH_ENDS
from maglev_design.exporting.controller import OUTPUTS, ExportedController
from maglev_design.exporting.misra import DEVIATIONS
from maglev_design.exporting.native import CORTEX_M4
from maglev_design.exporting.text import plain, wrapped
from maglev_design.figures import DESCRIBED
from maglev_design.lowering import Program
from maglev_design.options import Controller, Target
from maglev_design.record import DesignRecord
from maglev_design.rig import Rig
from maglev_design.simulation import nominal_scenario
from maglev_design.simulation.scenario import at_rest

TEMPLATES = {
    "c": ("header.h", "source.c", "example.c", "check.c", "proof.c"),
    "python": ("source.py", "example.py", "control_example.py", "check.py"),
    "matlab": (
        "init.m",
        "init_bumpless.m",
        "reset.m",
        "usable.m",
        "step.m",
        "reference_init.m",
        "reference_retarget.m",
        "reference_step.m",
        "example.m",
        "check.m",
    ),
}
_LANGUAGES = {"c": "C99", "python": "Python", "matlab": "MATLAB and Octave"}
_CHECKS = {"c": "`check.c`", "python": "`check.py`", "matlab": "`{}_check.m`"}
MORE = {
    "v_ref": {"name": "v_ref", "member": "velocity", "most": "vel_max", "unit": "m/s"},
    "jerk_ref": {"name": "jerk_ref", "member": "jerk", "most": "jerk_max", "unit": "m/s^3"},
}
"""What a law may read besides: its letter, its member of a point, its limit."""
EXAMPLE_PIECES = 20
"""Integration steps a sample of an example, at least."""
EXAMPLE_ROWS = 70
"""Rows that an example prints, about."""


def printed(controller: ExportedController, target: Target, rows: int) -> dict[str, bytes]:
    """Return the sources and the README of an export whose vectors have so many `rows`."""
    context = _context(controller, target, rows)
    files = {
        _file_name(template, controller.prefix, target): render(f"{target}/{template}.j2", context)
        for template in TEMPLATES[target]
    }
    files["README.md"] = render(f"{target}/README.md.j2", context)
    return {name: text.encode("ascii") for name, text in files.items()}


def _file_name(template: str, prefix: str, target: Target) -> str:
    if template.startswith(("header.", "source.")):
        return prefix + Path(template).suffix
    return f"{prefix}_{template}" if target == "matlab" else template


def _context(controller: ExportedController, target: Target, rows: int) -> dict[str, Any]:
    record = controller.record
    rig, document, design = record.rig, record.document, record.design
    path, worst = rig.reference, document["worst_case"]
    number = {name: repr(value) for name, value in controller.numbers.items()}
    samples = round(path.horizon / rig.sampling.period)
    family = document["family"]
    source = controller.prefix.upper()
    velocity = rig.initial.velocity
    delay = document["margins"]["delay_s"]["value"]
    radius = worst["spectral_radius_one_more_sample"]
    return {
        "p": controller.prefix,
        "P": source,
        "n": number,
        "T": number["T"],
        "title": plain(rig.name),
        "version": __version__,
        "language": _LANGUAGES[target],
        "warnings": controller.doubts,
        "banner": lambda style: _banner(controller, style),
        "symbols": _symbols(controller, target),
        "symbol_table": _symbol_table(controller),
        "declared": lambda program, indent=4: _declared(controller, program, target, indent),
        "code": lambda program, indent=4: _code(program, target, source, indent),
        "step": controller.step,
        "bumpless": controller.bumpless,
        "path": controller.path,
        "peak": controller.peak,
        "plant": controller.plant,
        "start": [_literal(x, target, source) for x in controller.start],
        "states": list(controller.states),
        "state_meanings": controller.states,
        "bounds": {name: repr(value) for name, value in controller.state_bounds.items()},
        "more": [MORE[name] for name in controller.more],
        "signals": list(controller.signals),
        "law_arguments": ", ".join(
            f"{x}: float" for x in (*controller.states, *controller.signals)
        ),
        "own_states": ", ".join(f"self.{x}" for x in controller.states),
        "struct_states": ", ".join(f"state.{x}" for x in controller.states),
        "next_states": ", ".join(f"{x}_next" for x in controller.states),
        "members": "".join(f", {MORE[name]['member']}" for name in controller.more),
        "drive": controller.drive,
        "hold": controller.hold_samples,
        "ticks": controller.most_ticks,
        "constants": [
            {"name": c.name, "value": repr(c.value), "unit": c.unit, "meaning": c.meaning}
            for c in (*controller.law_constants, *controller.guard_constants[1:])
        ],
        "plant_constants": [
            {"name": c.name, "value": repr(c.value), "unit": c.unit, "meaning": c.meaning}
            for c in controller.plant_constants
        ],
        "initial": {
            "gap": repr(rig.initial.gap),
            "current": repr(_first_current(record)),
            "velocity": _literal(velocity, target, source),
            "velocity_number": repr(velocity),
        },
        "path_ends": {x: repr(getattr(path, x)) for x in PATH_ENDS},
        "samples": samples,
        "pieces": _pieces(rig),
        "every": max(1, samples // EXAMPLE_ROWS),
        "law": law_in_words(design.controller),
        "method": design.method,
        "gaps": [f"{gap:g}" for gap in family["gaps"]],
        "assumptions": _assumptions(controller),
        "sha256": design.sha256,
        "objective": document["objective"].upper(),
        "objective_unit": DESCRIBED[document["objective"]].unit,
        "worst_objective": _shown(worst[document["objective"]]),
        "highest": _shown(worst["peak_voltage"]),
        "lowest": _shown(worst["min_voltage"]),
        "worst_ratio": _shown(worst["ratio"]),
        "ms": _shown(worst["ms"]),
        "ms_late": _shown(worst["ms_one_more_sample"]),
        "delay": "none" if delay is None else f"{1e3 * delay:.3g} ms",
        "late": "is unstable" if radius is None or radius >= 1 else "stays stable",
        "own_delay": repr(rig.sampling.delay),
        "own_delay_number": rig.sampling.delay,
        "equations": _equations(controller),
        "rows": rows,
        "check_command": _CHECKS[target].format(controller.prefix),
        "deviations": DEVIATIONS,
        "cortex_m4": " ".join(CORTEX_M4),
    }


def _pieces(rig: Rig) -> int:
    """Return the integration steps a sample of an example, enough for the drive."""
    if rig.kind.order == 2:
        return EXAMPLE_PIECES
    return max(EXAMPLE_PIECES, math.ceil(10 * rig.sampling.period / rig.drive.time_constant))


def _first_current(record: DesignRecord) -> float:
    """Return the current over C [V] that holds the ball where it starts, clamped."""
    start = nominal_scenario(record.rig, record.design.believed.beta)
    return at_rest(record.rig, start)[1]


def _assumptions(controller: ExportedController) -> list[str]:
    """Return under what every number of the README holds, in sentences."""
    record = controller.record
    rig, family, design = record.rig, record.document["family"], record.design
    low, high = family["ratios"]
    offsets = family["gap_offsets"]
    coil = rig.emulator.time_constant
    own = rig.drive
    drive = "The current follows the voltage at once, i = C u: no inductance is reckoned with."
    if own.kind == "voltage":
        drive = (
            f"The voltage drives a coil of R = {own.resistance:g} ohm and L = {own.inductance:g} H "
            f"at Y = {design.Y:g} m ("
            + ("with its back-EMF" if own.inductance_law == "energy" else "L at every gap")
            + ")."
        )
    elif own.lag:
        drive = f"The current follows the voltage with a lag of {1e3 * own.lag:g} ms."
    if own.input_offset:
        drive += f" It is zero at {own.input_offset:g} V."
    if coil and rig.kind.order == 2:
        drive += f" The rig file names a coil with L/R = {1e3 * coil:.3g} ms, which is not in them."
    plants = (
        "the plants that hold the ball at Y with the measured voltage"
        if family["voltage_held"]
        else "the plants whose force constant beta lies in an interval"
    )
    y0 = (
        f"y0 = {offsets[0]:g} m"
        if offsets[0] == offsets[-1]
        else f"y0 in [{offsets[0]:g}, {offsets[-1]:g}] m"
    )
    return [
        drive,
        f"The voltage of a sample acts {rig.sampling.delay:g} s after it and is held for "
        f"{rig.sampling.period:g} s.",
        "The gap is measured without error"
        + (
            ", and with the noise of the rig file; the worst of these runs and of both signs of "
            "the initial error counts."
            if record.document["scenarios"] == "robust"
            else "; noise and steps of the sensor are not in the worst case."
        ),
        f"The plants are {plants}: beta_c/beta in [{low:.4g}, {high:.4g}], {y0}, linearised at "
        f"gaps of {family['gaps'][0]:g} to {family['gaps'][1]:g} m. The controller's numbers stay.",
        f"beta_c = {design.believed.beta:.6g} {beta_unit(rig)}. Its numbers came from the reading "
        f"{design.equilibrium} of the equilibrium; nothing that runs depends on that.",
    ]


def beta_unit(rig: Rig) -> str:
    """Return the unit of beta: m^(1 + q)/(s^2 V^p)."""
    if rig.kind.force == "inverse-square":
        return "m^3/(s^2 V^2)"
    volts = "V" if rig.kind.exponent == 1 else "V^2"
    return f"m^{1 + (rig.plant.gap_exponent or 0):g}/(s^2 {volts})"


def law_in_words(controller: Controller) -> str:
    """Return a law's name, with what differs from its default."""
    return controller.name.upper() + (f" ({controller.variant})" if controller.variant else "")


def _shown(value: float | None) -> str:
    return "none" if value is None else f"{value:.4g}"


def _literal(value: float, target: Target, source: str) -> str:
    """Return a number in the target language."""
    if target != "c":
        return repr(value)
    digits = f"{source}_REAL({abs(value)!r})"
    return f"-{digits}" if value < 0 else digits


def _banner(controller: ExportedController, style: str) -> str:
    """Return the head of a file as comment lines."""
    mark = " *" if style == "c" else style
    rig = plain(controller.record.rig.name)
    lines = [
        f"Levitation controller for: {rig}",
        f"Controller {controller.record.design.sha256}",
        f"Printed by maglev-design {__version__} from a saved design; do not edit, export again.",
    ]
    found = controller.doubts
    if found:
        lines.append("NOT VERIFIED. Do not switch a coil on with it. " + " ".join(found))
    return "\n".join(wrapped(line, f"{mark} ", f"{mark}   ") for line in lines)


def _rows(controller: ExportedController) -> list[tuple[str, str, str, str]]:
    """Return (letter, value, unit, meaning) of everything that the law reads or gives."""
    tables = (controller.signals, controller.states, OUTPUTS)
    rows = [(name, "", *entry) for table in tables for name, entry in table.items()]
    constants = (*controller.law_constants, *controller.guard_constants)
    return rows + [(c.name, repr(c.value), c.unit, c.meaning) for c in constants]


def _symbols(controller: ExportedController, target: Target) -> str:
    """Return the symbol table as comment lines."""
    mark = {"c": " *", "python": "#", "matlab": "%"}[target]
    lines = [f"{'symbol':<10} {'value':<23} {'unit':<9} meaning"]
    lines += [f"{a:<10} {b:<23} {c:<9} {d}" for a, b, c, d in _rows(controller)]
    return "\n".join(f"{mark} {line}" for line in lines)


def _symbol_table(controller: ExportedController) -> str:
    """Return the symbol table in markdown."""
    lines = ["| symbol | value | unit | meaning |", "|---|---|---|---|"]
    lines += [f"| `{a}` | {b} | {c} | {d} |" for a, b, c, d in _rows(controller)]
    return "\n".join(lines)


def _equations(controller: ExportedController) -> str:
    """Return the symbolic difference equation, state by state."""
    equation = controller.equation
    states = [f"{x.name}_next" for x in equation.law.states]
    lines = [f"u_cmd = {equation.commanded}", f"applied = {equation.applied}"]
    lines += [f"{a} = {b}" for a, b in zip(states, equation.next_states, strict=True)]
    wrap = textwrap.TextWrapper(width=100, subsequent_indent="    ", break_long_words=False)
    return "\n".join(wrap.fill(line) for line in lines)


def _declared(controller: ExportedController, program: Program, target: Target, indent: int) -> str:
    """Return the constants that a program reads and, in C, declarations of its outputs."""
    known = {
        c.name: c
        for c in (*controller.plant_constants, *controller.law_constants)
        if c.name in program.used
    }
    source = controller.prefix.upper()
    lines = []
    for name in program.inputs:
        if name in known:
            c = known[name]
            value, note = _literal(c.value, target, source), f"{c.unit}, {c.meaning}"
            if target == "c":
                lines.append(f"const real {name} = {value}; /* {note} */")
            else:
                lines.append(f"{name} = {value}; % {note}")
    if target == "c":
        lines += [f"real {name};" for name in program.outputs]
    return textwrap.indent("\n".join(lines), " " * indent)


def _code(program: Program, target: Target, source: str, indent: int) -> str:
    """Return the statements of a program in the target language."""
    literal = f"{source}_REAL({{}})" if target == "c" else "{}"
    lines = program.source(target, real="real", literal=literal)
    return textwrap.indent("\n".join(lines), " " * indent)


def render(name: str, context: Mapping[str, Any]) -> str:
    """Return a template of this package, filled; a name that it lacks is an error."""
    import jinja2  # noqa: PLC0415 - heavy, and only an export needs it

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("maglev_design.exporting"),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # noqa: S701 - no HTML; what a user wrote goes through `plain`
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name).render(context)
