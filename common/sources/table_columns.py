"""Columns of a table: those that a source reads among the names that there are, and limits of all that is read."""

import difflib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tis.common.channels import FOLLOWER, MASTER, Arm, Hand
from tis.common.errors import DataError, Fault
from tis.common.scenario.table_source import HandColumns, PoseColumns, PoseUnits, TableSource

MAX_TABLE_BYTES: Final = 500_000_000
"""Size of a Parquet file."""
MAX_TEXT_BYTES: Final = 200_000_000
"""Size of a CSV file, which takes five times as much memory: an hour of two devices at 150 Hz, with all digits."""
MAX_ROWS: Final = 4_000_000
"""Rows of a table: an hour at 1 kHz."""
MAX_VALUES: Final = 64_000_000
"""Numbers that are read of a table: 512 MB in memory."""
MAX_COLUMNS: Final = 10_000
MIN_ROWS: Final = 2
"""Truth is interpolated between rows, so at least two are needed."""


def in_few(names: Sequence[str], most: int = 12) -> str:
    """Return names, at most so many, and the count of the others."""
    rest = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + rest


TIME: Final = "time_s"
"""Canonical name of the time column, in s."""


@dataclass(frozen=True)
class DeviceLayout:
    """Columns of one device with their units; ``name`` is what messages call it."""

    name: str
    columns: PoseColumns
    units: PoseUnits

    @property
    def names(self) -> tuple[str, ...]:
        """All columns of the device."""
        pose = self.columns
        turning = pose.quaternion or pose.matrix or pose.euler or ()
        return (*pose.position, *turning, *([] if pose.gripper is None else [pose.gripper]))


@dataclass(frozen=True)
class HandLayout:
    """A master and the arm that it drives; one of them may have no columns and follows by ``gain``."""

    hand: Hand
    arm: Arm
    master: DeviceLayout | None
    follower: DeviceLayout | None
    gain: float


@dataclass(frozen=True)
class TableLayout:
    """All columns that are read: ``time`` with the seconds of its unit, None where rows are counted."""

    time: str | None
    time_unit: str
    hands: tuple[HandLayout, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """All columns, each once."""
        devices = [device for hand in self.hands for device in (hand.master, hand.follower) if device is not None]
        timed = [] if self.time is None else [self.time]
        return tuple(dict.fromkeys([*timed, *(name for device in devices for name in device.names)]))


def canonical_names(device: str) -> tuple[str, ...]:
    """Return the canonical columns of a device: position in m, quaternion x y z w, gripper in rad."""
    return tuple(f"{device}_{part}" for part in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "gripper_rad"))


def layout_of(source: TableSource, names: Sequence[str], where: str) -> TableLayout:
    """Return the layout of a table with columns ``names``; raises `DataError` with all missing and repeated ones.

    A hand without a map has the canonical columns of its devices; where those of its master or of its arm are all
    missing, that one has no columns. Oracle: tables with every kind of map, test_table_columns.
    """
    there = frozenset(names)
    hands = tuple(_hand(source, hand, there) for hand in source.hands)
    time = None if source.rate_hz is not None else source.columns.time or TIME
    unit = "s" if source.columns.time is None else source.units.time
    layout = TableLayout(time, unit, hands)
    counts = Counter(names)
    faults = [
        Fault(where, f"column {name}", "must be there once", counts[name])
        for name in layout.names
        if counts[name] > 1
    ]
    missing = [name for name in layout.names if name not in there]
    if missing == [TIME] and source.columns.time is None:
        rule = (
            "has no column time_s: set source.columns.time to the time's column, or source.rate_hz to its rows per s"
        )
        faults.append(Fault(where, "", f"{rule}; its columns: {in_few(names)}"))
    elif missing:
        near = {name: difflib.get_close_matches(name, names, n=1, cutoff=0.7) for name in missing[:3]}
        hints = [f"{found[0]} for {name}" for name, found in near.items() if found]
        hint = f"; did you mean {', '.join(hints)}?" if hints else ""
        rule = f"has no column {in_few(missing)}; its columns: {in_few(names) or 'none'}{hint}"
        faults.append(Fault(where, "", f"{rule}; source.columns names those to read"))
    if faults:
        raise DataError(faults)
    return layout


def _hand(source: TableSource, hand: Hand, there: frozenset[str]) -> HandLayout:
    given = source.hand(hand)
    master = _device(source, given, MASTER[hand], there)
    arm = _device(source, given, given.arm_of(hand), there)
    if (source.columns.left if hand == "left" else source.columns.right) is None:
        # the usual table may hold the usual master or arm alone
        devices = MASTER[hand], FOLLOWER[hand]
        has_master, has_arm = (bool(there & set(canonical_names(device))) for device in devices)
        master, arm = (None if has_arm and not has_master else master, None if has_master and not has_arm else arm)
    return HandLayout(hand, given.arm_of(hand), master, arm, given.gain)


def _device(source: TableSource, given: HandColumns, name: str, there: frozenset[str]) -> DeviceLayout | None:
    columns = given.master if name in MASTER.values() else given.arm
    if columns is None:
        return None
    if isinstance(columns, PoseColumns):
        return DeviceLayout(name, columns, columns.units or source.units)
    # orientation and gripper are optional, but not parts of an orientation
    x, y, z, qx, qy, qz, qw, gripper = canonical_names(columns)
    turns, grips = not there.isdisjoint((qx, qy, qz, qw)), gripper in there
    pose = PoseColumns(
        position=(x, y, z), quaternion=(qx, qy, qz, qw) if turns else None, gripper=gripper if grips else None
    )
    return DeviceLayout(name, pose, PoseUnits(position="m"))
