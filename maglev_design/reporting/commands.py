"""The commands that make a design and its report again, reconstructed from the record."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping
from typing import Any

from maglev_design.controller.design import PAPER_POLES
from maglev_design.options import DEFAULT_MAX_MS
from maglev_design.programs import gains_program
from maglev_design.record import DesignRecord, rig_as_data
from maglev_design.rig import is_papers, load_rig, preset_names

RIG_FILE = "rig.toml"
"""What a rig that is no preset is called in the commands."""
DERIVE = "maglev-design derive --format latex"


def preset_of(record: DesignRecord) -> str | None:
    """Return the name of the preset that the record's rig is, None when it is none."""
    return next(
        (n for n in preset_names() if rig_as_data(load_rig(n)) == record.document["rig"]), None
    )


def design_command(record: DesignRecord) -> str:
    """Return the command that makes the design again, with every choice that is no default."""
    words = [*_choices(record), *_baseline(record)]
    judged = record.document["status"] == "judged"
    words += _given(record) if judged else _searched(record)
    verb = "design" if judged else "tune"
    return shlex.join(["maglev-design", verb, *words, "-o", "design"])


def _choices(record: DesignRecord) -> list[str]:
    """Return the options that a tuning and a judgement have in common."""
    from maglev_design.tuning import problem as defaults  # noqa: PLC0415 - imports the solvers

    document, rig = record.document, record.rig
    limits = {c["name"]: c["limit"] for c in document["constraints"]}
    low, high = rig.limits.voltage
    words = ["--rig", preset_of(record) or RIG_FILE]
    choices = (
        ("--objective", document["objective"], "itae"),
        ("--equilibrium", document["equilibrium"], "model"),
        ("--method", document["method"], rig.sampling.method),
        ("--beta-error", document["beta_error_given"], None),
        ("--max-ms", limits.get("Ms"), DEFAULT_MAX_MS),
        (
            "--max-noise-voltage",
            limits.get("noise voltage"),
            defaults.DEFAULT_NOISE_SHARE * (high - low),
        ),
        ("--scenarios", document["scenarios"], "nominal"),
        ("--seed", document["seed"], 0),
    )
    for option, value, default in choices:
        if value is not None and value != default:
            words += [option, _typed(value)]
    if not {"largest commanded voltage", "smallest commanded voltage"} & limits.keys():
        words += ["--allow-saturation"]
    return words


def _baseline(record: DesignRecord) -> list[str]:
    """Return the poles that the design was compared with, where that was asked for."""
    base = record.document["baseline"]
    if base is None or (is_papers(record.rig) and (base["zeta"], base["omega_n"]) == PAPER_POLES):
        return []
    return ["--baseline", _typed(base["zeta"]), _typed(base["omega_n"])]


def _given(record: DesignRecord) -> list[str]:
    """Return the poles, or the gains where no poles place exactly these."""
    design = record.design
    if gains_program(design.controller).scalar()(*design.poles.values) != design.gains:
        gains = ",".join(f"{name}={value!r}" for name, value in design.named_gains.items())
        return ["--gains", gains]
    (zeta, omega_n), second = design.poles.first, design.poles.second
    if (zeta, omega_n) != second:
        return ["--poles", *(_typed(x) for x in design.poles.values)]
    return ["--zeta", _typed(zeta), "--omega-n", _typed(omega_n)]


def _searched(record: DesignRecord) -> list[str]:
    """Return the options of the search alone."""
    from maglev_design.tuning import problem as defaults  # noqa: PLC0415 - imports the solvers

    document, words = record.document, []
    first, second = document["poles"]
    words += [] if first == second else ["--poles", "distinct"]
    limited = {c["name"] for c in document["constraints"]}
    words += ["--certify"] if defaults.CERTIFICATE in limited else []
    words += ["--pareto"] if document.get("pareto") else []
    searched = document["bounds"]
    for option, bounds, usual in (
        ("--zeta-bounds", searched["zeta"], defaults.ZETA_BOUNDS),
        ("--omega-bounds", searched["omega_n"], defaults.default_omega_bounds(record.rig)),
    ):
        if tuple(bounds) != tuple(usual):
            words += [option, *map(_typed, bounds)]
    return words


REPORT = "maglev-design report design/design.json -o report"
"""What writes the report again."""


def simulate_command(ratio: float) -> str:
    """Return the command that runs the design on a plant with another beta."""
    return (
        f"maglev-design simulate --design design/design.json --beta-ratio {_typed(ratio)} "
        "--plot response.svg"
    )


def _typed(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return repr(int(value)) if value == int(value) else repr(value)


def rig_toml(data: Mapping[str, Any]) -> str:
    """Return the rig of a record as the text of a rig file.

    Examples
    --------
    >>> print(rig_toml({"name": "a", "limits": {"gap": [0.001, None]}}))
    name = "a"
    <BLANKLINE>
    [limits]
    gap = [0.001, inf]
    <BLANKLINE>
    """
    plain = [f"{key} = {_toml(v)}" for key, v in data.items() if not isinstance(v, Mapping)]
    lines = [*plain, ""]
    for name, table in data.items():
        if isinstance(table, Mapping) and table:
            lines += [f"[{name}]", *(f"{key} = {_toml(v)}" for key, v in table.items()), ""]
    return "\n".join(lines)


def _toml(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isinf(value)):
        return "inf"
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key} = {_toml(item)}" for key, item in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
