"""The command line: parse, call, print, exit code; no mathematics.

Only typer is imported here; what a command needs is imported when it runs, so that asking for help
costs nothing.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from maglev_design import __version__
from maglev_design.errors import MaglevError
from maglev_design.options import (
    CONTROLLERS,
    DEFAULT_MAX_MS,
    DEFAULT_PRESET,
    Backend,
    ControllerName,
    Derivative,
    Equilibrium,
    Feedforward,
    Method,
    Objective,
    Scenarios,
    Start,
    Target,
    TestName,
)

app = typer.Typer(
    name="maglev-design",
    help="From a magnetic-levitation rig's equations to a controller that runs on it.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
presets_app = typer.Typer(
    help="List the rigs that come with the program, or print one to start from.",
    invoke_without_command=True,
    rich_markup_mode=None,
)
app.add_typer(presets_app, name="presets")


RigOption = Annotated[
    str, typer.Option("--rig", help="A rig file (FILE.toml) or the name of a preset.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document and nothing else on stdout.")
]
EquilibriumOption = Annotated[
    Equilibrium, typer.Option(help="How the controller learns U, C_U and C_Y.")
]
SeedOption = Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Seed of the noise stream.")]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Write into a folder that this program did not make.")
]


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"maglev-design {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@presets_app.callback()
def presets(context: typer.Context, json: JsonOption = False) -> None:
    """List the rigs that come with the program."""
    if context.invoked_subcommand is None:
        from maglev_design.cli.verbs import list_presets  # noqa: PLC0415

        list_presets(as_json=json)


@presets_app.command("show")
def presets_show(name: Annotated[str, typer.Argument(help="Name of a preset.")]) -> None:
    """Print the TOML of a preset, with its sources, to start a rig file of your own."""
    from maglev_design.rig import preset_text  # noqa: PLC0415

    typer.echo(preset_text(name), nl=False)


@app.command()
def derive(
    form: Annotated[
        Literal["text", "markdown", "latex"], typer.Option("--format", help="How to write it.")
    ] = "text",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write to this file, not to stdout.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Print the whole derivation, every equation with its machine-checked residual."""
    from maglev_design.cli.verbs import print_derivation  # noqa: PLC0415

    print_derivation(form, output, as_json=json)


@app.command()
def simulate(
    rig: Annotated[
        str | None,
        typer.Option("--rig", help="A rig file or preset; default: the paper's, belmonte2021."),
    ] = None,
    design: Annotated[
        Path | None,
        typer.Option(help="A saved design.json: exactly its controller runs, on its rig."),
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(help="With --design: a rig file or preset whose plant the controller meets."),
    ] = None,
    test: Annotated[
        TestName | None,
        typer.Option(help="nominal (default); noise; or noise with beta_c = 1.15 beta."),
    ] = None,
    controller: Annotated[
        ControllerName | None, typer.Option(help="Which law; default: tan-gpi.")
    ] = None,
    feedforward: Annotated[
        Feedforward | None, typer.Option(help="lin-pid: the voltage that holds the ball at y*.")
    ] = None,
    derivative: Annotated[
        Derivative | None, typer.Option(help="lin-pid: what is differentiated.")
    ] = None,
    filter: Annotated[  # noqa: A002 - the option's name
        float | None, typer.Option(help="lin-pid: filter's pole over the real closed-loop pole.")
    ] = None,
    start: Annotated[
        Start | None, typer.Option(help="lin-pid: whether the first error kicks the derivative.")
    ] = None,
    emulate: Annotated[
        bool, typer.Option("--emulate", help="Add the effects of the rig's [emulator] table.")
    ] = False,
    zeta: Annotated[float | None, typer.Option(help="Damping of the poles [-].")] = None,
    omega_n: Annotated[float | None, typer.Option(help="Frequency of the poles [rad/s].")] = None,
    equilibrium: Annotated[
        Equilibrium | None, typer.Option(help="How the controller learns U, C_U and C_Y.")
    ] = None,
    method: Annotated[Method | None, typer.Option(help="Discretisation of the law.")] = None,
    sample_time: Annotated[
        float | None,
        typer.Option(
            help="Sampling period [s]; 0 is a continuous controller. Another one than a design's "
            "own makes another controller, and is labelled so."
        ),
    ] = None,
    beta_ratio: Annotated[
        float | None,
        typer.Option(
            help="beta_c/beta [-], 0.1 to 10: with --design the plant moves, else beta_c."
        ),
    ] = None,
    noise: Annotated[
        bool | None, typer.Option("--noise/--no-noise", help="Whether the rig's noise acts.")
    ] = None,
    initial_error: Annotated[
        float | None, typer.Option(help="y(0) - y*(0) [m] instead of the rig's.")
    ] = None,
    initial_velocity: Annotated[
        float | None, typer.Option(help="y'(0) [m/s] instead of the rig's.")
    ] = None,
    seed: SeedOption = 0,
    replay: Annotated[
        str | None,
        typer.Option(
            metavar="FILE:SCENARIO[:DESIGN]",
            help="Run one scenario of a sweep (its sweep.json) again, with nothing else given.",
        ),
    ] = None,
    csv: Annotated[Path | None, typer.Option(help="Write the response to this file.")] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the response into this .png, .svg or .pdf.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Simulate one closed loop on the nonlinear plant and print its figures."""
    from maglev_design.cli import simulate_setup, simulate_verb  # noqa: PLC0415

    simulate_verb.simulate(
        simulate_setup.Request(
            rig=rig,
            design=design,
            plant=plant,
            test=test,
            controller=controller,
            options={
                "feedforward": feedforward,
                "derivative": derivative,
                "filter": filter,
                "start": start,
            },
            emulate=emulate,
            zeta=zeta,
            omega_n=omega_n,
            equilibrium=equilibrium,
            method=method,
            sample_time=sample_time,
            beta_ratio=beta_ratio,
            noise=noise,
            initial_error=initial_error,
            initial_velocity=initial_velocity,
            seed=seed,
            replay=replay,
        ),
        csv,
        plot,
        as_json=json,
    )


@app.command()
def sweep(
    samples: Annotated[int, typer.Option(help="Scenarios [-].")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the chunks and sweep.json.")
    ],
    rig: Annotated[
        str | None,
        typer.Option(
            "--rig", help="A rig file or preset; with --design, whose uncertainty is meant."
        ),
    ] = None,
    design: Annotated[
        list[Path] | None, typer.Option(help="A saved design.json; may be given several times.")
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            metavar=f"[{'|'.join(CONTROLLERS)}]",
            help="A law with --zeta and --omega-n; may be given several times.",
        ),
    ] = None,
    zeta: Annotated[float | None, typer.Option(help="Damping of the poles [-].")] = None,
    omega_n: Annotated[float | None, typer.Option(help="Frequency of the poles [rad/s].")] = None,
    equilibrium: Annotated[
        Equilibrium | None, typer.Option(help="How the controller learns U, C_U and C_Y.")
    ] = None,
    method: Annotated[Method | None, typer.Option(help="Discretisation of the law.")] = None,
    sampling: Annotated[
        Literal["lhs", "sobol", "random"],
        typer.Option(help="Latin hypercube, scrambled Sobol sequence, or independent draws."),
    ] = "lhs",
    noise: Annotated[
        bool | None,
        typer.Option("--noise/--no-noise", help="Whether noise acts; default: if the rig has any."),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed of the draws and of the noise.")
    ] = 0,
    chunk: Annotated[
        int | None, typer.Option(help="Scenarios a file, a multiple of 4; default: about a second.")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Processes; default: all cores, where it is worth it."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Compute on this Dask cluster."),
    ] = None,
    backend: Annotated[Backend, typer.Option(help="How a loop is computed.")] = "auto",
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Draw plants from the rig's uncertainty and see how many the controller holds, and how well.

    Interrupted or killed, the same command continues where it was.
    """
    from maglev_design.cli import sweep_verb  # noqa: PLC0415

    sweep_verb.sweep(
        sweep_verb.Request(
            rig=rig,
            designs=tuple(design or ()),
            controllers=tuple(controller or ()),
            zeta=zeta,
            omega_n=omega_n,
            equilibrium=equilibrium,
            method=method,
            samples=samples,
            sampling=sampling,
            noise=noise,
            seed=seed,
            chunk=chunk,
            jobs=jobs,
            scheduler=scheduler,
            backend=backend,
        ),
        output,
        force=force,
        as_json=json,
    )


@app.command()
def tune(
    rig: RigOption = DEFAULT_PRESET,
    objective: Annotated[Objective, typer.Option(help="What to minimise.")] = "itae",
    equilibrium: EquilibriumOption = "model",
    method: Annotated[
        Literal[Method, "auto"] | None,
        typer.Option(help="Discretisation; auto tunes all and keeps the best."),
    ] = None,
    beta_error: Annotated[
        float | None, typer.Option(help="u: worst case over beta_c/beta in [1-u, 1+u].")
    ] = None,
    allow_saturation: Annotated[
        bool, typer.Option("--allow-saturation", help="Let the command leave the voltage range.")
    ] = False,
    max_ms: Annotated[
        float, typer.Option(help="Largest |S| of the sampled loop [-].")
    ] = DEFAULT_MAX_MS,
    max_noise_voltage: Annotated[
        float | None,
        typer.Option(help="Voltage made by sensor noise [V]; default 5 % of the range."),
    ] = None,
    scenarios: Annotated[
        Scenarios,
        typer.Option(
            help="robust adds noise and both signs of the initial error; emulated tunes on the rig "
            "of [emulator], at its period."
        ),
    ] = "nominal",
    poles: Annotated[
        Literal["double", "distinct"],
        typer.Option(help="One double pair as in the paper, or two different pairs."),
    ] = "double",
    zeta_bounds: Annotated[
        tuple[float, float] | None, typer.Option(help="Search bounds of zeta [-].")
    ] = None,
    omega_bounds: Annotated[
        tuple[float, float] | None, typer.Option(help="Search bounds of omega_n [rad/s].")
    ] = None,
    certify: Annotated[
        bool,
        typer.Option("--certify", help="Require a proof that the sampled loop is stable."),
    ] = False,
    pareto: Annotated[
        bool,
        typer.Option(
            "--pareto", help="Show what robustness costs: error against certified range; a minute."
        ),
    ] = False,
    baseline: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="ZETA OMEGA",
            help="Poles to compare with; default: the paper's on the paper's rig, else none.",
        ),
    ] = None,
    seed: SeedOption = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for design.json and the plots.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Find the pole placement with the smallest worst-case error that the limits allow."""
    from maglev_design.cli import tune_verb  # noqa: PLC0415

    tune_verb.tune(
        tune_verb.Request(
            rig=rig,
            objective=objective,
            equilibrium=equilibrium,
            method=method,
            beta_error=beta_error,
            allow_saturation=allow_saturation,
            max_ms=max_ms,
            max_noise_voltage=max_noise_voltage,
            scenarios=scenarios,
            distinct=poles == "distinct",
            zeta_bounds=zeta_bounds,
            omega_bounds=omega_bounds,
            seed=seed,
            certify=certify,
            pareto=pareto,
            baseline=baseline,
        ),
        output,
        force=force,
        as_json=json,
    )


@app.command()
def design(
    rig: RigOption = DEFAULT_PRESET,
    controller: Annotated[ControllerName, typer.Option(help="Which law.")] = "tan-gpi",
    zeta: Annotated[float | None, typer.Option(help="Damping of the poles [-].")] = None,
    omega_n: Annotated[float | None, typer.Option(help="Frequency of the poles [rad/s].")] = None,
    poles: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="ZETA OMEGA ZETA OMEGA",
            help="Two different pairs [-, rad/s]; a law of third order has a real pole at the "
            "second frequency.",
        ),
    ] = None,
    gains: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=VALUE,...",
            help="Somebody's own. tan-gpi, fee-gpi: k0 [1/s^4], k1 [1/s^3], k2 [1/s^2], k3 [1/s]; "
            "state-feedback: k1 [1/s^3], k2 [1/s^2], k3 [1/s]; lin-pid: the same, or Kp [V/m], "
            "Ki [V/(m s)], Kd [V s/m], positive as gains of y - y*, with omega_f (or N) [rad/s], "
            "the pole of the derivative's filter.",
        ),
    ] = None,
    feedforward: Annotated[
        Feedforward | None, typer.Option(help="lin-pid: the voltage that holds the ball at y*.")
    ] = None,
    derivative: Annotated[
        Derivative | None, typer.Option(help="lin-pid: what is differentiated.")
    ] = None,
    filter: Annotated[  # noqa: A002 - the option's name
        float | None, typer.Option(help="lin-pid: filter's pole over the real closed-loop pole.")
    ] = None,
    start: Annotated[
        Start | None, typer.Option(help="lin-pid: whether the first error kicks the derivative.")
    ] = None,
    objective: Annotated[Objective, typer.Option(help="Whose worst case is shown.")] = "itae",
    equilibrium: EquilibriumOption = "model",
    method: Annotated[Method | None, typer.Option(help="Discretisation of the law.")] = None,
    beta_error: Annotated[
        float | None, typer.Option(help="u: worst case over beta_c/beta in [1-u, 1+u].")
    ] = None,
    allow_saturation: Annotated[
        bool, typer.Option("--allow-saturation", help="Let the command leave the voltage range.")
    ] = False,
    max_ms: Annotated[
        float, typer.Option(help="Largest |S| of the sampled loop [-].")
    ] = DEFAULT_MAX_MS,
    max_noise_voltage: Annotated[
        float | None,
        typer.Option(help="Voltage made by sensor noise [V]; default 5 % of the range."),
    ] = None,
    scenarios: Annotated[
        Scenarios, typer.Option(help="robust adds noise and both signs of the initial error.")
    ] = "nominal",
    baseline: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="ZETA OMEGA",
            help="Poles of tan-gpi to compare with; default: the paper's on the paper's rig.",
        ),
    ] = None,
    seed: SeedOption = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for design.json and the plots.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Judge a controller that is given by its poles or its gains; nothing is searched for."""
    from maglev_design.cli import design_verb  # noqa: PLC0415

    design_verb.design(
        design_verb.Request(
            rig=rig,
            controller=controller,
            options={
                "feedforward": feedforward,
                "derivative": derivative,
                "filter": filter,
                "start": start,
            },
            zeta=zeta,
            omega_n=omega_n,
            poles=poles,
            gains=gains,
            objective=objective,
            equilibrium=equilibrium,
            method=method,
            beta_error=beta_error,
            allow_saturation=allow_saturation,
            max_ms=max_ms,
            max_noise_voltage=max_noise_voltage,
            scenarios=scenarios,
            seed=seed,
            baseline=baseline,
        ),
        output,
        force=force,
        as_json=json,
    )


@app.command()
def certify(
    design: Annotated[
        Path | None, typer.Argument(help="A saved design.json; its rig and controller are used.")
    ] = None,
    rig: Annotated[
        str | None, typer.Option("--rig", help="A rig file (FILE.toml) or the name of a preset.")
    ] = None,
    controller: Annotated[ControllerName | None, typer.Option(help="Which law.")] = None,
    zeta: Annotated[float | None, typer.Option(help="Damping of the poles [-].")] = None,
    omega_n: Annotated[float | None, typer.Option(help="Frequency of the poles [rad/s].")] = None,
    equilibrium: Annotated[
        Equilibrium | None, typer.Option(help="How the controller learns U, C_U and C_Y.")
    ] = None,
    method: Annotated[Method | None, typer.Option(help="Discretisation of the law.")] = None,
    gap_range: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Gaps [m] instead of the hull of the path, the initial gap and Y."),
    ] = None,
    beta_error: Annotated[
        float | None, typer.Option(help="u: the family is beta_c/beta in [1-u, 1+u].")
    ] = None,
    check: Annotated[
        Path | None,
        typer.Option(
            "--check",
            help="Only verify a written certificate.json, without a solver; with a design: its.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the result, certificate and figure."),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Prove for which beta, gaps, periods, delays and errors a controller is stable."""
    from maglev_design.cli import certify_verb  # noqa: PLC0415

    request = certify_verb.Request(
        design=design,
        rig=rig,
        controller=controller,
        zeta=zeta,
        omega_n=omega_n,
        equilibrium=equilibrium,
        method=method,
        gap_range=gap_range,
        beta_error=beta_error,
    )
    if check is not None:
        certify_verb.check(check, request, as_json=json)
        return
    certify_verb.certify(request, output, force=force, as_json=json)


@app.command()
def report(
    design: Annotated[Path, typer.Argument(help="A saved design.json.")],
    form: Annotated[
        Literal["markdown", "latex", "html", "pdf", "all"],
        typer.Option("--format", help="How to write it; all is each that this machine can make."),
    ] = "all",
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the report and its figures.")
    ] = Path("report"),
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Write a design up for people: markdown, LaTeX, a page with sliders, PDF."""
    from maglev_design.cli import report_verb  # noqa: PLC0415

    report_verb.report(design, form, output, force=force, as_json=json)


@app.command()
def compare(
    rig: RigOption = DEFAULT_PRESET,
    design: Annotated[
        Path | None,
        typer.Option(help="A saved design.json as the tuned one; then the plant's beta moves."),
    ] = None,
    equilibrium: Annotated[
        Equilibrium | None, typer.Option(help="How the controllers learn U, C_U and C_Y.")
    ] = None,
    method: Annotated[
        Literal[Method, "all"] | None, typer.Option(help="Discretisation of the laws, or all.")
    ] = None,
    sample_time: Annotated[
        float | None, typer.Option(help="Sampling period [s]; 0 is continuous controllers.")
    ] = None,
    opposite_error: Annotated[
        bool, typer.Option("--opposite-error", help="Start on the other side of the reference.")
    ] = False,
    position_noise: Annotated[
        float | None, typer.Option(help="Standard deviation of the sensor's noise [m].")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, max=10_000, help="Runs where noise enters.")] = 20,
    seed: SeedOption = 0,
    tuned: Annotated[
        bool, typer.Option("--tuned/--no-tuned", help="Tune the TAN-GPI and show it, too.")
    ] = True,
    variants: Annotated[
        bool, typer.Option("--variants/--no-variants", help="Show other readings of the PID.")
    ] = True,
    emulate: Annotated[
        bool, typer.Option("--emulate/--no-emulate", help="Add the emulated rig as a fourth test.")
    ] = True,
    survey: Annotated[
        bool, typer.Option("--survey/--no-survey", help="Try every reading of the paper.")
    ] = True,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the page and the figures.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Run the paper's tests 1 to 3 with every controller, and see which orderings survive."""
    from maglev_design.cli import compare_verb  # noqa: PLC0415

    compare_verb.compare_controllers(
        compare_verb.Request(
            rig=rig,
            design=design,
            equilibrium=equilibrium,
            method=method,
            sample_time=sample_time,
            opposite_error=opposite_error,
            position_noise=position_noise,
            seeds=seeds,
            seed=seed,
            tuned=tuned,
            variants=variants,
            emulate=emulate,
            survey=survey,
        ),
        output,
        force=force,
        as_json=json,
        command=_command_line(),
    )


@app.command()
def claims(
    rig: RigOption = DEFAULT_PRESET,
    rigs: Annotated[
        int, typer.Option(min=1, max=1000, help="Random rigs on which general claims are tried.")
    ] = 20,
    seed: SeedOption = 0,
    only: Annotated[
        str | None, typer.Option(help="Show only claims whose id starts so, with their evidence.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for claims.json and claims.md.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Judge every equation and every quantitative claim of the paper, with evidence."""
    from maglev_design.cli import claims_verb  # noqa: PLC0415

    claims_verb.judge_claims(
        claims_verb.Request(rig=rig, rigs=rigs, seed=seed, only=only),
        output,
        force=force,
        as_json=json,
        command=_command_line(),
    )


@app.command()
def export(
    design: Annotated[Path, typer.Argument(help="A saved design.json, or its folder.")],
    target: Annotated[Target, typer.Option(help="The language of the controller.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the controller and its README.")
    ],
    prefix: Annotated[
        str, typer.Option(help="What every public name and file begins with.")
    ] = "maglev",
    allow_unverified: Annotated[
        bool,
        typer.Option(
            "--allow-unverified",
            help="Export a design whose re-simulation failed or that has no certificate.",
        ),
    ] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Print a saved design as a controller that stands alone, with tests, example and README."""
    from maglev_design.cli import export_verb  # noqa: PLC0415

    export_verb.export(
        design,
        target,
        output,
        prefix=prefix,
        allow_unverified=allow_unverified,
        force=force,
        as_json=json,
    )


@app.command()
def verify(
    folder: Annotated[Path, typer.Argument(help="A folder that `export` wrote.")],
    json: JsonOption = False,
) -> None:
    """Build an exported controller, run it, and compare it with the design it came from."""
    from maglev_design.cli import verify_verb  # noqa: PLC0415

    verify_verb.verify(folder, as_json=json)


def _command_line() -> str:
    """Return what was typed, without the output folder and without the places of files."""
    words, skip = ["maglev-design"], False
    for word in sys.argv[1:]:
        if skip or word in ("-o", "--output", "--force"):
            skip = word in ("-o", "--output") and not skip
            continue
        words.append(Path(word).name if os.sep in word else word)
    return " ".join(words)


def main() -> None:
    """Run the command line; end with the exit code of the contract, never with a traceback."""
    try:
        app()
    except MaglevError as error:
        _complain(str(error))
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, SystemExit) as stop:
        if not _interrupted(stop):
            raise
        _complain("interrupted, nothing was found yet")
        sys.exit(130)
    except BrokenPipeError:
        # Whoever read our output has gone; leave nothing for the interpreter to flush.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except Exception as error:  # noqa: BLE001 - the last line of defence: one sentence, exit 1
        place = error.__traceback__
        while place is not None and place.tb_next is not None:
            place = place.tb_next
        where = place.tb_frame.f_code.co_qualname if place is not None else "?"
        _complain(f"internal error in {where}: {type(error).__name__}: {error}")
        sys.exit(1)


def _interrupted(stop: BaseException | None) -> bool:
    """Whether Ctrl-C is behind `stop`: typer turns it into an exit code of 1."""
    while stop is not None and not isinstance(stop, KeyboardInterrupt):
        stop = stop.__cause__ or stop.__context__
    return stop is not None


def _complain(text: str) -> None:
    for line in text.splitlines() or [""]:
        typer.echo(f"maglev-design: {line}", err=True)
