"""Columns of a table: its text, the columns that a source reads among the names that it has, and the limits of both.

The text is a line of names, then a line of numbers per row, separated by commas, semicolons or tabs.
"""

import csv
import difflib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tis.common.channels import FOLLOWER, MASTER, Arm, Hand
from tis.common.errors import MAX_SHOWN, DataError, Fault, capped
from tis.common.scenario.table_source import HandColumns, PoseColumns, PoseUnits, TableSource
from tis.common.sources.trajectory import Array
from tis.common.units import NS_PER_S

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


_MAX_LINE_CHARS: Final = 200_000
_MAX_DIAGNOSED: Final = 200_000
_SEPARATORS: Final = ",;\t"


@dataclass(frozen=True)
class TableText:
    """Names of the columns, in order and possibly repeated, and the lines of the rows."""

    names: tuple[str, ...]
    separator: str
    lines: Sequence[str]


def split_table(text: str, where: str) -> TableText:
    """Return the names and lines of a table's text; raises `DataError` when it is none.

    The separator is the one that the first line has most of. Oracle: tables that the tests write.
    """
    n_lines = text.count("\n") + text.count("\r")
    if n_lines > 2 * MAX_ROWS:  # counted first: as a list, empty lines take many times their size
        raise DataError(Fault(where, "", f"must have at most {MAX_ROWS} rows", n_lines))
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.rstrip().split("\n")
    if not lines[0].strip():
        raise DataError(Fault(where, "line 1", "must hold the names of the columns", lines[0]))
    longest = max(range(len(lines)), key=lambda i: len(lines[i]))
    if len(lines[longest]) > _MAX_LINE_CHARS:
        rule = f"must have at most {_MAX_LINE_CHARS} characters"
        raise DataError(Fault(where, f"line {longest + 1}", rule, len(lines[longest])))
    separator = max(_SEPARATORS, key=lines[0].count)
    names = tuple(name.strip() for name in next(csv.reader([lines[0]], delimiter=separator)))
    faults = []
    if len(names) > MAX_COLUMNS:
        faults.append(Fault(where, "line 1", f"must name at most {MAX_COLUMNS} columns", len(names)))
    if len(lines) - 1 < MIN_ROWS:
        faults.append(Fault(where, "", f"must have at least {MIN_ROWS} rows", len(lines) - 1))
    if len(lines) - 1 > MAX_ROWS:
        faults.append(Fault(where, "", f"must have at most {MAX_ROWS} rows", len(lines) - 1))
    if all(_number(name) is not None for name in names):
        faults.append(Fault(where, "line 1", "must hold the names of the columns, not numbers", lines[0][:60]))
    if faults:
        raise DataError(faults)
    return TableText(names, separator, _with_points(lines[1:], separator))


def _with_points(lines: list[str], separator: str) -> list[str]:
    """Return the lines with points for decimal commas: commas that separate no cells, where no number has a point."""
    if separator == "," or any("." in _DATE.sub("", line) for line in lines):
        return lines
    return [line.replace(",", ".") for line in lines]


_DATE: Final = re.compile(r"((?:19|20|21)\d\d-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d{1,9})?)(Z|[+-]\d\d:?\d\d)?")


def _dates(table: TableText, name: str, where: str) -> Array | None:
    """Return times of ISO 8601, all of one offset, in s from the first; None where the first one is no date."""
    place = table.names.index(name)
    cells = [row[place].strip() for row in csv.reader(table.lines, delimiter=table.separator)]
    first = _DATE.fullmatch(cells[0])
    if first is None:
        return None
    dates = [_DATE.fullmatch(cell) for cell in cells]
    rule = f"must be a time like {cells[0]}, with the same offset from UTC"
    bad = [i for i, date in enumerate(dates) if date is None or date[2] != first[2]]
    if not bad:
        try:
            instants = np.array([date[1] for date in dates if date is not None], dtype="datetime64[ns]")
        except ValueError as error:
            raise DataError(Fault(where, f"column {name}", f"must hold times that there are: {error}")) from None
        return np.asarray((instants - instants[0]).astype(np.int64) / NS_PER_S, dtype=np.float64)
    found = [Fault(where, f"line {i + 2}, column {name}", rule, cells[i]) for i in bad[:MAX_SHOWN]]
    raise DataError(capped(found, len(bad), where, rule))


def read_columns(table: TableText, wanted: Sequence[str], where: str, time: str | None = None) -> Mapping[str, Array]:
    """Return the wanted columns, each there once; raises `DataError` with the faults of every kind at once.

    Of ``time`` the cells may be dates, which are returned in s from the first.
    Kinds are the number of cells of a line and what is no number; at most five lines of each are shown, and the
    others counted. NaN is a number here. Oracle: round trips and damaged tables in the tests.
    """
    if time is not None and time in wanted and len(wanted) > 1:
        of_first = next(csv.reader(table.lines[:1], delimiter=table.separator), [])
        place = table.names.index(time)
        if len(of_first) > place and _number(of_first[place]) is None:
            others = read_columns(table, [name for name in wanted if name != time], where)
            dates = _dates(table, time, where)
            if dates is not None:
                return {**others, time: dates}
    places = [table.names.index(name) for name in wanted]
    quoted = any('"' in line for line in table.lines)
    even = quoted or all(line.count(table.separator) + 1 == len(table.names) for line in table.lines)
    if even and all(table.lines):
        try:
            values = np.loadtxt(
                table.lines, delimiter=table.separator, usecols=places, comments=None, ndmin=2, quotechar='"'
            )
        except ValueError:
            pass  # told below, line by line
        else:
            if len(values) == len(table.lines):
                return {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(wanted)}
    raise DataError(_diagnose(table, wanted, places, where))


def _diagnose(table: TableText, wanted: Sequence[str], places: Sequence[int], where: str) -> list[Fault]:
    width_rule, number_rule = f"must have {len(table.names)} cells, as line 1", "must be a number"
    if table.separator == "," and table.lines[0].count(",") == 2 * len(table.names) - 1:
        width_rule += " (where the comma is the decimal mark, separate cells by semicolons)"
    if table.separator != "," and any("," in line for line in table.lines[:_MAX_DIAGNOSED]):
        number_rule += " (decimals must all have points, or all commas)"
    of_width: list[Fault] = []
    of_number: list[Fault] = []
    for number, line in enumerate(table.lines[:_MAX_DIAGNOSED], start=2):
        cells = next(csv.reader([line], delimiter=table.separator), [])
        if len(cells) != len(table.names):
            of_width.append(Fault(where, f"line {number}", width_rule, len(cells)))
            continue
        bad = [(name, cells[k]) for name, k in zip(wanted, places, strict=True) if _number(cells[k]) is None]
        if bad:
            rest = f" and {len(bad) - 1} more" if len(bad) > 1 else ""
            of_number.append(Fault(where, f"line {number}, column {bad[0][0]}{rest}", number_rule, bad[0][1]))
    found = [
        *capped(of_width, len(of_width), where, width_rule),
        *capped(of_number, len(of_number), where, number_rule),
    ]
    return found or [Fault(where, f"a line after {_MAX_DIAGNOSED}", f"{width_rule}, each a number")]


def _number(cell: str) -> float | None:
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None
