"""JIGSAWS trials as text, parsed and written: 76 columns, one line per sample at 30 Hz, poses of masters and arms.

The columns are those of the data set's description (Gao et al., "JHU-ISI Gesture and Skill Assessment Working Set",
M2CAI 2014). The velocity columns are smoothed over later frames, so they look ahead; only an identification with
``identification.allow_lookahead`` uses them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from tis.common.channels import MASTER
from tis.common.errors import MAX_SHOWN, DataError, Fault, capped
from tis.common.sources.trajectory import Array, PoseTrack, Recording, not_rotations, one_hemisphere

RATE_HZ: Final = 30
N_COLUMNS: Final = 76
MIN_ROWS: Final = 2
"""Truth is interpolated between rows, so at least two are needed."""

MAX_TRIAL_BYTES: Final = 150_000_000
"""Size of a trial's file: an hour at 30 Hz."""

_MAX_LINES: Final = 120_000  # an hour has 108 000
_MAX_LINE_CHARS: Final = 10_000  # 76 numbers take some 1200
_LINE_ENDS: Final = "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"
_MAX_DIAGNOSED: Final = 10_000  # lines in which faults are counted; a real trial has fewer
_COLUMNS_RULE: Final = f"must have {N_COLUMNS} columns"


@dataclass(frozen=True)
class Columns:
    """Columns of one device in a row (0-based); the angular velocity after the linear one is not read."""

    position: slice
    rotation: slice
    velocity: slice
    gripper: int


def _columns(first: int) -> Columns:
    return Columns(slice(first, first + 3), slice(first + 3, first + 12), slice(first + 12, first + 15), first + 18)


# "slave left" of the data set's description is PSM1, "slave right" PSM2.
COLUMNS: Final[dict[str, Columns]] = {
    "MTML": _columns(0),
    "MTMR": _columns(19),
    "PSM1": _columns(38),
    "PSM2": _columns(57),
}


def parse_trial(text: str, where: str) -> Array:
    """Return the trial as an array (N, 76), SI units as in the file.

    Raises `DataError` with the faults of every kind at once (number of columns, not a number, not finite, too few
    rows), at most five lines of a kind and the count of the others. Blank lines are ignored at the end and faults
    elsewhere, since a missing row would shift time. Oracle: round trips in the tests.
    """
    lines = _lines(text.rstrip(), where)
    rows = _parse_sound(lines)
    if rows is None or len(rows) < MIN_ROWS:
        raise DataError(_diagnose(lines, where))
    return rows


def _lines(text: str, where: str) -> list[str]:
    """Return the lines; raises `DataError` for more or longer ones than any trial has."""
    # counted first: a text of empty lines takes many times its size as a list
    n_lines = sum(text.count(end) for end in _LINE_ENDS) + 1
    if n_lines > _MAX_LINES:
        raise DataError(Fault(where, "", f"must have at most {_MAX_LINES} lines", n_lines))
    lines = text.splitlines()
    for number, line in enumerate(lines, start=1):
        if len(line) > _MAX_LINE_CHARS:
            raise DataError(
                Fault(where, f"line {number}", f"must have at most {_MAX_LINE_CHARS} characters", len(line))
            )
    return lines


def pose_track(rows: Array, device: str, where: str) -> PoseTrack:
    """Return the poses of ``device`` (a key of `COLUMNS`) from rows (N, 76): m, unit quaternions x y z w, rad.

    Quaternions stay in one hemisphere: neighbours never differ in sign, the first has w >= 0. Rounded matrices are
    mapped to the nearest rotation; raises `DataError` where a matrix is far from one. Oracle: half-angle quaternions
    and Rodrigues' formula in the tests.
    """
    columns = COLUMNS[device]
    matrices = rows[:, columns.rotation].reshape(-1, 3, 3)
    bad = not_rotations(matrices)
    if bad.size:
        place = f"columns {columns.rotation.start + 1}-{columns.rotation.stop} ({device})"
        rule = "must be a rotation matrix"
        found = [
            Fault(where, f"line {i + 1}, {place}", rule, [float(v) for v in matrices[i].ravel()])
            for i in bad[:MAX_SHOWN]
        ]
        raise DataError(capped(found, len(bad), where, rule, "lines"))
    return PoseTrack(
        position_m=position_m(rows, device),
        orientation=one_hemisphere(scipy.spatial.transform.Rotation.from_matrix(matrices).as_quat()),
        gripper_rad=rows[:, columns.gripper].copy(),
    )


def position_m(rows: Array, device: str) -> Array:
    """Return the positions of ``device`` (a key of `COLUMNS`) from rows (N, 76): shape (N, 3), m."""
    return rows[:, COLUMNS[device].position].copy()


def velocity_m_s(rows: Array, device: str) -> Array:
    """Return the linear velocity of ``device`` from rows (N, 76): shape (N, 3), m/s; it depends on later rows."""
    return rows[:, COLUMNS[device].velocity].copy()


def _parse_sound(lines: Sequence[str]) -> Array | None:
    """Return the array (N, 76), or None when anything is wrong: the fast path."""
    rows = np.empty((len(lines), N_COLUMNS))
    for row, line in zip(rows, lines, strict=True):
        tokens = line.split()
        values = _numbers(tokens) if len(tokens) == N_COLUMNS else None
        if values is None:
            return None
        row[:] = values
    return rows if np.isfinite(rows).all() else None


def _numbers(tokens: Iterable[str]) -> list[float] | None:
    try:
        # float() accepts the underscores of Python literals, which are not valid in a data file
        return None if "_" in "".join(tokens) else [float(token) for token in tokens]
    except ValueError:
        return None


def _diagnose(lines: Sequence[str], where: str) -> list[Fault]:
    """Return the faults of a trial that `_parse_sound` refused or that is too short."""
    if not lines:
        return [Fault(where, "", f"is empty, must have lines of {N_COLUMNS} numbers")]
    widths = {len(line.split()) for line in lines}
    if len(lines) > MAX_SHOWN and len(widths) == 1 and N_COLUMNS not in widths:  # another layout, not damaged lines
        return [Fault(where, f"all {len(lines)} lines", _COLUMNS_RULE + _separators(lines), widths.pop())]
    kinds: dict[str, list[Fault]] = {rule: [] for rule in (_COLUMNS_RULE, "must be a number", "must be finite")}
    of_columns, of_text, of_finite = kinds.values()
    for number, line in enumerate(lines[:_MAX_DIAGNOSED], start=1):
        tokens = line.split()
        if len(tokens) != N_COLUMNS:
            of_columns.append(Fault(where, f"line {number}", _COLUMNS_RULE + _separators([line]), len(tokens)))
        values = [_numbers([token]) for token in tokens]
        worded = [c for c, value in enumerate(values) if value is None]
        endless = [c for c, value in enumerate(values) if value is not None and not np.isfinite(value[0])]
        for found, columns, rule in ((of_text, worded, "must be a number"), (of_finite, endless, "must be finite")):
            if columns:
                rest = f" and {len(columns) - 1} more" if len(columns) > 1 else ""
                place = f"line {number}, column {columns[0] + 1}{rest}"
                found.append(Fault(where, place, rule, tokens[columns[0]]))
    faults = [f for rule, found in kinds.items() for f in capped(found, len(found), where, rule, "lines")]
    if len(lines) < MIN_ROWS:
        faults.append(Fault(where, "", f"must have at least {MIN_ROWS} rows", len(lines)))
    return faults


def _separators(lines: Sequence[str]) -> str:
    """Return an addition to the rule on columns where commas or semicolons separate the numbers."""
    names = {",": "commas", ";": "semicolons"}
    marks = [name for mark, name in names.items() if any(mark in line for line in lines)]
    return f", separated by spaces and not by {' and '.join(marks)}" if marks else ""


_LINE: Final = " ".join(["%15.8f"] * N_COLUMNS) + "\n"


def trial_text(recording: Recording) -> str:
    """Return the text of a recording of both hands at 30 Hz, all its rows; raises `ValueError` for others.

    SI units to 8 decimals. Linear and angular velocities are central differences of neighbouring rows (one-sided at
    the ends), the angular ones in the frame of the positions; like those of the recordings they depend on later rows.
    Oracle: `jigsaws.parse_trial` and `pose_track`; velocities of a steady screw motion.
    """
    if recording.rate_hz != RATE_HZ or len(recording.hands) != len(MASTER):
        raise ValueError(f"a JIGSAWS trial has both hands at {RATE_HZ} Hz")
    rows = np.zeros((len(recording), N_COLUMNS))
    for hand in recording.hands:
        _fill(rows, MASTER[hand.hand], hand.command)
        _fill(rows, hand.arm, hand.follower)
    return "".join(_LINE % tuple(row) for row in rows.tolist())


def _fill(rows: Array, device: str, track: PoseTrack) -> None:
    columns = COLUMNS[device]
    turned = scipy.spatial.transform.Rotation.from_quat(track.orientation)
    after = np.minimum(np.arange(len(track)) + 1, len(track) - 1)
    before = np.maximum(np.arange(len(track)) - 1, 0)
    per_s = RATE_HZ / (after - before)[:, np.newaxis]
    linear = columns.rotation.stop
    rows[:, columns.position] = track.position_m
    rows[:, columns.rotation] = turned.as_matrix().reshape(-1, 9)
    rows[:, linear : linear + 3] = (track.position_m[after] - track.position_m[before]) * per_s
    rows[:, linear + 3 : linear + 6] = (turned[after] * turned[before].inv()).as_rotvec() * per_s
    rows[:, columns.gripper] = track.gripper_rad
