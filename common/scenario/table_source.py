"""Source of a movement in a table, CSV or Parquet, of any columns, units and rate."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import PurePath
from typing import Annotated, Final, Literal, Self

from pydantic import Discriminator, Field, StrictBool, StringConstraints, Tag, model_validator

from tis.common.channels import FOLLOWER, Arm, Hand
from tis.common.scenario.base import (
    HANDS_MEANING,
    START_MEANING,
    AnySource,
    Hands,
    Part,
    Positive,
    RuleText,
    Start,
    refuse,
)

TABLE_SUFFIXES: Final = (".csv", ".parquet")

ColumnName = Annotated[str, StringConstraints(min_length=1, max_length=200), RuleText("must be the name of a column")]
TablePath = Annotated[
    str, StringConstraints(pattern=r"(?i)^.+\.(csv|parquet)$"), RuleText("must be a file ending in .csv or .parquet")
]
_Name = Annotated[
    str,
    # not {0,99}: the letters of all scripts, 99 times over, take longer to compile than all other patterns
    StringConstraints(pattern=r"^\w[\w .()+-]*$", max_length=100),
    RuleText("must consist of at most 100 letters, digits, blanks and any of _.()+-"),
]
MAX_RESAMPLED: Final = 1_000_000
"""Most rows that are interpolated for each recorded one."""
Resampled = Annotated[
    Literal["auto"] | StrictBool | Annotated[float, Field(ge=1, le=MAX_RESAMPLED)],
    RuleText("must be auto, true, false or a number from 1 on"),
]


class PoseUnits(Part):
    """Units of a device's columns."""

    position: Literal["m", "cm", "mm"] | None = Field(None, description="Unit of positions; not given: m.")
    angle: Literal["rad", "deg"] = Field("rad", description="Unit of Euler angles.")
    gripper: Literal["rad", "deg"] = Field("rad", description="Unit of gripper angles.")


class TableUnits(PoseUnits):
    """Units of a table's columns; canonical names carry their own."""

    time: Literal["s", "ms", "us", "ns"] = Field("s", description="Unit of the time column.")


class PoseColumns(Part):
    """Columns of one device. Without an orientation it does not turn, without a gripper its angle is 0."""

    position: tuple[ColumnName, ColumnName, ColumnName] = Field(description="Columns of x, y and z.")
    quaternion: tuple[ColumnName, ColumnName, ColumnName, ColumnName] | None = Field(
        None, description="Columns of the orientation as a quaternion."
    )
    quaternion_order: Literal["xyzw", "wxyz"] = Field(
        "xyzw", description="Place of the scalar w among the columns of the quaternion: last or first."
    )
    matrix: Annotated[tuple[ColumnName, ...], Field(min_length=9, max_length=9)] | None = Field(
        None, description="Columns of the orientation as a rotation matrix, row by row."
    )
    euler: Annotated[tuple[ColumnName, ...], Field(min_length=1, max_length=3)] | None = Field(
        None, description="Columns of the orientation as Euler angles, in the order of euler_axes."
    )
    euler_axes: Annotated[
        str,
        StringConstraints(min_length=1, max_length=3),
        RuleText("must be one to three of xyz (fixed axes) or of XYZ (turning axes)"),
    ] = Field(
        "xyz",
        description="Axes of the Euler angles as SciPy names them: small letters for fixed axes, capitals for axes "
        "that turn with the device. xyz: roll, pitch, yaw.",
    )
    gripper: ColumnName | None = Field(None, description="Column of the gripper's opening angle.")
    units: PoseUnits | None = Field(None, description="Units of these columns; not given: those of the table.")

    @model_validator(mode="after")
    def _one_orientation(self) -> Self:
        faults = []
        if sum(part is not None for part in (self.quaternion, self.matrix, self.euler)) > 1:
            faults.append("only one of quaternion, matrix and euler can be given")
        names = [*self.position, *(self.quaternion or ()), *(self.matrix or ()), *(self.euler or ())]
        names += [] if self.gripper is None else [self.gripper]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            faults.append(f"each column can be named once: {', '.join(twice)}")
        axes = self.euler_axes
        known = set(axes) <= set("xyz") or set(axes) <= set("XYZ")
        if not known or any(a == b for a, b in pairwise(axes)):
            faults.append("euler_axes must be one to three of xyz or of XYZ, neighbours different, like xyz or ZYX")
        if self.euler is not None and len(self.euler) != len(axes):
            faults.append(f"euler must name a column for each of euler_axes ({axes})")
        refuse(faults)
        return self


def _prefix_or_columns(value: object) -> str | None:
    if isinstance(value, Mapping | PoseColumns):
        return "PoseColumns"
    return "prefix" if isinstance(value, str) else None


Device = Annotated[
    Annotated[PoseColumns, Tag("PoseColumns")] | Annotated[ColumnName, Tag("prefix")],
    Discriminator(
        _prefix_or_columns,
        custom_error_type="in_words",
        custom_error_message="must be a prefix like MTML, of columns MTML_x_m ..., or {position: [X, Y, Z], ...}",
    ),
]


class HandColumns(Part):
    """Columns of a master and of the arm that follows it, or of one of them."""

    master: Device | None = Field(
        None, description="Columns of the master: a prefix of canonical names, or each column. Not given: the arm's."
    )
    arm: Device | None = Field(
        None, description="Columns of the arm: a prefix of canonical names, or each column. Not given: the master's."
    )
    gain: float = Field(
        1.0,
        ge=-1000,
        le=1000,
        description="Position of the arm per position of the master, where one of them has no columns.",
    )
    drives: Arm | None = Field(
        None, description="Arm that the master drives. Not given: the arm's prefix, else PSM2 (left), PSM1 (right)."
    )

    @model_validator(mode="after")
    def _at_least_one(self) -> Self:
        if self.master is None and self.arm is None:
            raise ValueError("at least one of master and arm must have columns")
        if self.gain == 0.0:
            raise ValueError("gain must not be 0")
        return self

    def arm_of(self, hand: Hand) -> Arm:
        """Return the arm that a hand with these columns drives."""
        if self.drives is not None:
            return self.drives
        named: dict[object, Arm] = {"PSM1": "PSM1", "PSM2": "PSM2"}
        return named.get(self.arm if isinstance(self.arm, str) else None, FOLLOWER[hand])


class TableColumns(Part):
    """Columns of a table. What is not given has canonical names."""

    time: ColumnName | None = Field(None, description="Column of the time. Not given: time_s.")
    left: HandColumns | None = Field(None, description="Columns of the left hand. Not given: MTML and PSM2.")
    right: HandColumns | None = Field(None, description="Columns of the right hand. Not given: MTMR and PSM1.")


class TableSource(AnySource):
    """A recording in a table: a row per sample, numbers in named columns."""

    kind: Literal["table"] = Field(description="table: a recording in a CSV or Parquet file, of any columns.")
    path: TablePath = Field(description="The file: .csv or .parquet; a relative path counts from the current folder.")
    hands: Hands = Field(("left",), description=HANDS_MEANING)
    columns: TableColumns = Field(
        TableColumns(),
        description="Names of the columns; not given: time_s and, for MTML, MTMR, PSM1 and PSM2, MTML_x_m, MTML_y_m, "
        "MTML_z_m, MTML_qx, MTML_qy, MTML_qz, MTML_qw, MTML_gripper_rad, as `tis import` writes them.",
    )
    units: TableUnits = Field(TableUnits(), description="Units of the columns that `columns` names.")
    rate_hz: Positive | None = Field(
        None, le=1_000_000, description="Rows per second of a table without a time column; a time column is not read."
    )
    resample: Resampled = Field(
        "auto",
        description="true: rows at the scenario's rate_hz are interpolated, from 3 to 5000 recorded a second and at "
        "most 4 for each; a number: at most so many for each recorded one; false: another rate is refused. auto: as "
        "false, but rows of this rate at uneven times are interpolated where their paths are smoother at these times "
        "than at even ones.",
    )
    gaps: Literal["refuse", "bridge"] = Field(
        "refuse",
        description="What is done where rows are missing. bridge: rows are interpolated (resample) or follow each "
        "other as if none were missing, with a warning.",
    )
    task: _Name | None = Field(
        None, description="Name of the task. Not given: the one in the Parquet file's metadata, if any."
    )
    person: _Name | None = Field(
        None,
        description="Who moves. Not given: the name in the Parquet file's metadata, else the file's name up to the "
        "first _.",
    )
    start: Start = Field("auto", description=START_MEANING)

    @property
    def label(self) -> str:
        """Return the name of the table, and of the task if it is given."""
        return f"table {'' if self.task is None else f'{self.task} '}{PurePath(self.path).stem}"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        faults = []
        if self.rate_hz is not None and self.columns.time is not None:
            faults.append("only one of rate_hz and columns.time can be given")
        arms = [self.hand(hand).arm_of(hand) for hand in self.hands]
        if len(set(arms)) < len(arms):
            faults.append(f"both hands must not drive {arms[0]}: set columns.left.drives or columns.right.drives")
        refuse(faults)
        return self

    def hand(self, hand: Hand) -> HandColumns:
        """Return the columns of a hand, by default of the canonical devices."""
        given = self.columns.left if hand == "left" else self.columns.right
        return CANONICAL[hand] if given is None else given


CANONICAL: Final[dict[Hand, HandColumns]] = {
    "left": HandColumns(master="MTML", arm="PSM2"),
    "right": HandColumns(master="MTMR", arm="PSM1"),
}
