"""Commands on a scenario and its data: `new`, `validate`, `identify`, `synth`, `import`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.markup import escape

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.deploy.cli.group import Commands, JsonOption, OptionalScenarioArg, ScenarioArg, SeedOption, SetOption
from tis.deploy.shell.guard import ERR, OUT, print_json, print_warnings

app = Commands("Scenarios and data")


@app.command(example="tis new my_scenario")
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the scenario, and of its file without .yaml.")],
) -> int:
    """Write a commented scenario to start from, NAME.yaml, with the schema by which editors check it."""
    from tis.deploy.tools.shipped import write_new

    return write_new(name, OUT)


@app.command(example="tis scenarios")
def scenarios(as_json: JsonOption = False) -> int:
    """List the scenarios that are shipped, each with a line on what it is."""
    from tis.deploy.tools.shipped import list_scenarios

    return list_scenarios(OUT, as_json)


@app.command(example="tis estimators")
def estimators(as_json: JsonOption = False) -> int:
    """List the estimators by the names that scenarios give them, each with a line on what it is."""
    from tis.deploy.tools.shipped import list_estimators

    return list_estimators(OUT, as_json)


@app.command(example="tis validate my_scenario.yaml --set seed=2")
def validate(
    scenario: OptionalScenarioArg = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of scenarios.")] = False,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: Annotated[float | None, typer.Option(help="Override the duration, in s.")] = None,
    as_json: JsonOption = False,
) -> int:
    """Check a scenario and the traces it names, and print it with all defaults.

    A file that holds a network of its own, or a profile, is checked as such, and
    its network printed.
    """
    # imported late, here and below: a command that fails or helps need not wait for numpy
    from tis.common.scenario import reading
    from tis.deploy.run.resolve import resolve, scenario_path
    from tis.deploy.shell.shipped_scenarios import shipped_names

    if schema:
        print(reading.schema_json())  # noqa: T201
        return EXIT_OK
    from tis.common.runtime.scenario_files import load_traces
    from tis.netem.build import build_netem

    if scenario is None:
        names = ", ".join(shipped_names())
        raise InputError(Fault("tis validate", "SCENARIO", f"is required: a file, or one of {names}"))
    if seed is None and duration_s is None:
        from tis.deploy.net.check_network import check_network

        code = check_network(scenario_path(scenario), settings or (), ERR, as_json)
        if code is not None:
            return code
    resolved = resolve(scenario, settings or (), seed, duration_s)
    # as a run would: faults of traces and of rules that tie show only when the links are built
    build_netem(resolved, load_traces(resolved.network), scenario)
    from tis.common.runtime.credentials import certified_names, expiry_warnings

    print_warnings(ERR, *resolved.surgeon.warnings(), *expiry_warnings(resolved.security, *certified_names(resolved)))
    if as_json:
        print_json(resolved.model_dump(mode="json", exclude_none=True))
    else:
        print(reading.dump_scenario(resolved), end="")  # noqa: T201
    return EXIT_OK


@app.command(example="tis identify default -o arm.json")
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


@app.command(example="tis synth trials --people 8")
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
    from tis.common.scenario.reading import setting
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
            source = setting("source", {"kind": "jigsaws", "path": str(out_dir), "task": task})
            command = command_line(["compare", "default", "--set", source])
            OUT.print(escape(f"or compare, each person with models of the others\n{command}"), soft_wrap=True)
    return print_calibration(seed, OUT) if check else EXIT_OK


_COMMAND = "tis import"

PositionUnit = Annotated[Literal["m", "cm", "mm"], typer.Option(help="LeRobot: unit of positions.")]
AngleUnit = Annotated[Literal["rad", "deg"], typer.Option(help="LeRobot: unit of roll, pitch and yaw.")]
GripperUnit = Annotated[Literal["rad", "deg"], typer.Option(help="LeRobot: unit of gripper angles.")]
RateOption = Annotated[
    float | None,
    typer.Option(
        min=0.001,
        max=1_000_000,
        help="Rows per second; by default the streams' own instants, where they share them, else the rate of the "
        "first.",
    ),
]
TopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="DEVICE=TOPIC",
        help="Poses of MTML, MTMR, PSM1 or PSM2, of TF /tf:PARENT:CHILD; "
        "those named are all that are read. By default CRTK's names, or the only one there is.",
    ),
]
JawOption = Annotated[
    list[str] | None,
    typer.Option("--jaw", metavar="DEVICE=TOPIC", help="Joint states whose first angle is the gripper's."),
]
NamesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--names",
        metavar="VECTOR=NAME,...",
        help="LeRobot: names of all elements of observation.state or action, like left_x,left_y,left_z,-,left_jaw.",
    ),
]


@app.command("import", example="tis import recording.mcap -o movement.parquet")
def import_(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE",
            help="An .mcap file, a rosbag2 folder, a .bag, a LeRobot set (its folder), a trajectory of TUM or EuRoC, "
            "or a JIGSAWS trial (.txt).",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="The table to write: .parquet or .csv.")],
    rate_hz: RateOption = None,
    topic: TopicOption = None,
    jaw: JawOption = None,
    names: NamesOption = None,
    episode: Annotated[int, typer.Option(min=0, help="LeRobot: the episode.")] = 0,
    position_unit: PositionUnit = "m",
    angle_unit: AngleUnit = "rad",
    gripper_unit: GripperUnit = "rad",
    skip_unreadable: Annotated[
        bool, typer.Option("--skip-unreadable", help="Leave out messages that cannot be read, and count them.")
    ] = False,
    task: Annotated[str | None, typer.Option(help="Name of the task, for reports.")] = None,
    person: Annotated[str | None, typer.Option(help="Who moves, for identification.train: others.")] = None,
) -> int:
    """Import a recording of poses into a table that `source: {kind: table}` plays.

    It lists what it found. Streams of different instants are put on one
    clock; rows within gaps are left out. MCAP logs of tis need no options.
    """
    from tis.deploy.recordings_import.command import import_recording
    from tis.deploy.recordings_import.found import Wanted

    wanted = Wanted(
        topics=_pairs("--topic", topic),
        jaws=_pairs("--jaw", jaw),
        names={vector: tuple(text.split(",")) for vector, text in _pairs("--names", names).items()},
        position_unit=position_unit,
        angle_unit=angle_unit,
        gripper_unit=gripper_unit,
        episode=episode,
        skips_unreadable=skip_unreadable,
    )
    stated = {name: value for name, value in (("task", task), ("person", person)) if value}
    return import_recording(source, out, wanted, rate_hz, stated, OUT, ERR)


def _pairs(option: str, given: Sequence[str] | None) -> dict[str, str]:
    """Return the values of a repeated option NAME=VALUE; raises `InputError`."""
    pairs, faults = {}, []
    for text in given or ():
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            faults.append(Fault(_COMMAND, option, "must read NAME=VALUE", text))
        elif name in pairs:
            faults.append(Fault(_COMMAND, option, "names one thing twice", name))
        pairs[name] = value
    if faults:
        raise InputError(faults)
    return pairs
