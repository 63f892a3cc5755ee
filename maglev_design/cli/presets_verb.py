"""``presets``."""

from __future__ import annotations

import sys

from maglev_design.cli.output import number, print_json, table

PAPERS_KIND = "inverse-square force, ideal current drive"
"""In words, what the paper's plant is."""


def list_presets(*, as_json: bool) -> None:
    """Print every preset with its name, its poles' neighbourhood and its source."""
    from maglev_design.controller.checks import check_path_voltage  # noqa: PLC0415
    from maglev_design.controller.design import (  # noqa: PLC0415
        plant_beta,
        true_equilibrium,
    )
    from maglev_design.controller.matching import plant_words  # noqa: PLC0415
    from maglev_design.rig import load_rig, preset_names  # noqa: PLC0415

    rows = []
    for name in preset_names():
        rig = load_rig(name)
        check_path_voltage(rig)
        rest = true_equilibrium(rig, plant_beta(rig), rig.operating_point.gap)
        rows.append((name, rig, plant_beta(rig), rest))
    if as_json:
        print_json(
            {
                "presets": [
                    {
                        "name": name,
                        "title": rig.name,
                        "source": rig.source,
                        "notes": rig.notes,
                        "plant": plant_words(rig) or PAPERS_KIND,
                        "beta": beta,
                        "equilibrium": {"Y": rig.operating_point.gap, "U": rest.U}
                        | {"C_U": rest.C_U, "C_Y": rest.C_Y},
                    }
                    for name, rig, beta, rest in rows
                ]
            }
        )
        return
    table(
        "Presets",
        ("name", "m [kg]", "Y [mm]", "y0 [mm]", "U [V]", "C_U [m/s²V]", "C_Y [1/s²]", "T [ms]"),
        [
            (
                name,
                number(rig.plant.mass),
                number(1e3 * rig.operating_point.gap),
                number(1e3 * rig.plant.gap_offset),
                number(rest.U),
                number(rest.C_U),
                number(rest.C_Y),
                number(1e3 * rig.sampling.period),
            )
            for name, rig, _, rest in rows
        ],
    )
    for name, rig, _, _ in rows:
        sys.stdout.write(f"{name}: {rig.name}\n  source: {rig.source}\n")
        sys.stdout.write(f"  plant: {plant_words(rig) or PAPERS_KIND}\n")
        sys.stdout.write(f"  notes: {' '.join(rig.notes.split())}\n")
