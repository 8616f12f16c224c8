"""Command on foreign recordings: ``tis import``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from tis.common.errors import Fault, InputError
from tis.deploy.cli.group import Commands
from tis.deploy.shell.guard import ERR, OUT, guarded

app = Commands("Scenarios and data")

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
        "--topic", metavar="DEVICE=TOPIC", help="Poses of MTML, MTMR, PSM1 or PSM2; by default CRTK's names."
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
        help="LeRobot: names of the elements of observation.state or action, like left_x,left_y,left_z,left_jaw.",
    ),
]


@app.command("import")
@guarded
def import_(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE",
            help="An .mcap file, a rosbag2 folder, a .bag, a LeRobot set (its folder) or a JIGSAWS trial (.txt).",
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
