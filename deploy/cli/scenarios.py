"""Commands on a scenario and its data: `new`, `validate`, `identify`, `synth`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.deploy.cli.group import Commands, DurationOption, OptionalScenarioArg, ScenarioArg, SeedOption, SetOption
from tis.deploy.shell.guard import ERR, OUT, guarded, print_warnings

app = Commands("Scenarios and data")


@app.command()
@guarded
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the scenario, and of its file without .yaml.")],
) -> int:
    """Write a commented scenario to start from, NAME.yaml, with the schema by which editors check it."""
    from tis.deploy.tools.new import write_new

    return write_new(name, OUT)


@app.command()
@guarded
def validate(
    scenario: OptionalScenarioArg = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of scenarios.")] = False,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: DurationOption = None,
) -> int:
    """Check a scenario and the traces it names, and print it with all defaults."""
    # imported late, here and below: a command that fails or helps need not wait for numpy
    from tis.common.scenario import reading
    from tis.deploy.run.resolve import resolve
    from tis.deploy.shell.shipped_scenarios import shipped_names

    if schema:
        print(reading.schema_json())  # noqa: T201
        return EXIT_OK
    from tis.common.runtime.scenario_files import load_traces
    from tis.netem.build import build_netem

    if scenario is None:
        names = ", ".join(shipped_names())
        raise InputError(Fault("tis validate", "SCENARIO", f"is required: a file, or one of {names}"))
    resolved = resolve(scenario, settings or (), seed, duration_s)
    # as a run would: faults of traces and of rules that tie show only when the links are built
    build_netem(resolved, load_traces(resolved.network), scenario)
    print_warnings(ERR, *resolved.surgeon.warnings())
    print(reading.dump_scenario(resolved), end="")  # noqa: T201
    return EXIT_OK


@app.command()
@guarded
def identify(
    scenario: ScenarioArg,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write the model to this file (.json).")] = None,
    figure: Annotated[
        Path | None,
        typer.Option(help="Draw the singular values, the order rules and the validation (.svg, .pdf or .png)."),
    ] = None,
    dynamics: Annotated[
        bool,
        typer.Option(
            "--dynamics",
            help="Identify masses, inertias and friction of the simulated arm (patient.plant: mujoco) instead.",
        ),
    ] = False,
    settings: SetOption = None,
    seed: SeedOption = None,
) -> int:
    """Identify the arm's model from a scenario's training data; use the file as identification.train."""
    from tis.deploy.run.resolve import resolve

    resolved = resolve(scenario, settings or (), seed)
    if dynamics:
        from tis.deploy.tools.identify_dynamics import identify_dynamics_and_print

        return identify_dynamics_and_print(resolved, out, figure, OUT)
    from tis.deploy.tools.identify import identify_and_print

    return identify_and_print(resolved, out, figure, OUT, ERR)


@app.command()
@guarded
def synth(
    out_dir: Annotated[
        Path | None, typer.Argument(metavar="OUT_FOLDER", help="A new or empty folder for the trials.")
    ] = None,
    trials: Annotated[int, typer.Option(help="Number of trials to write, of each person: S001, S002, ...")] = 5,
    people: Annotated[
        int | None,
        typer.Option(
            help="Number of people, 1 to 8, who differ as recorded people do: S001, ..., T001, ...; by default one "
            "person, the calibrated one."
        ),
    ] = None,
    task: Annotated[str, typer.Option(help="Task in the trials' names; the movement is always that of suturing.")] = (
        "Suturing"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the movements.")] = 1,
    duration_s: Annotated[float, typer.Option(help="Length of a trial, in s.")] = 90.0,
    plant: Annotated[
        str | None,
        typer.Option(
            metavar="SCENARIO",
            help="Let the arm of this scenario (patient.plant: mujoco or servo) execute the movements: the trials' "
            "arms are its own; --set changes it.",
        ),
    ] = None,
    settings: SetOption = None,
    check: Annotated[
        bool, typer.Option("--check", help="Compare the movement's statistics with those of recorded suturing.")
    ] = False,
) -> int:
    """Write trials of synthetic surgeons in the format and folders of JIGSAWS, or check their calibration.

    On trials of several people, tis compare trains the models of each person
    on the others.
    """
    from tis.common.runtime.process import command_line
    from tis.deploy.run.resolve import resolve
    from tis.deploy.tools.synth import print_calibration, write_trials

    if out_dir is None and not check:
        raise InputError(Fault("tis synth", "OUT_FOLDER", "is required, or --check"))
    if settings and plant is None:
        raise InputError(Fault("tis synth", "--set", "must be given with --plant, whose scenario it changes"))
    if out_dir is not None:
        arm = None if plant is None else resolve(plant, settings or ())
        files = write_trials(out_dir, trials, task, seed, duration_s, command_line(), people, arm)
        OUT.print(
            escape(f"{len(files)} synthetic trials in {out_dir}; play one with\n")
            + escape(f"source: {{kind: jigsaws, path: {out_dir}, task: {task}, trial: S001}}"),
            soft_wrap=True,
        )
        if people is not None and people > 1:
            source = f"{{kind: jigsaws, path: {out_dir}, task: {task}}}"
            OUT.print(
                escape(
                    f"or compare, each person with models of the others\ntis compare default --set 'source={source}'"
                ),
                soft_wrap=True,
            )
    return print_calibration(seed, OUT) if check else EXIT_OK
