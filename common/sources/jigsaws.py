"""Parser of JIGSAWS trials: text of 76 columns, one line per sample at 30 Hz, to poses of masters and arms.

The columns are those of the data set's description (Gao et al., "JHU-ISI Gesture and Skill Assessment Working Set",
M2CAI 2014). The velocity columns are smoothed over later frames, so they look ahead; only an identification with
``identification.allow_lookahead`` uses them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from tis.common.errors import DataError, Fault
from tis.common.sources.hemisphere import one_hemisphere
from tis.common.sources.trajectory import Array, PoseTrack

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
_MAX_SHOWN: Final = 5  # faults of a kind
_COLUMNS_RULE: Final = f"must have {N_COLUMNS} columns"
_ROTATION_TOLERANCE: Final = 0.01  # the masters' matrices miss orthogonality by up to 0.0013


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
    # A rotation matrix is orthogonal, up to the rounding of the file, and has determinant +1.
    matrices = rows[:, columns.rotation].reshape(-1, 3, 3)
    departure = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero((departure > _ROTATION_TOLERANCE) | (np.linalg.det(matrices) < 0))
    if bad.size:
        place = f"columns {columns.rotation.start + 1}-{columns.rotation.stop} ({device})"
        rule = "must be a rotation matrix"
        found = [
            Fault(where, f"line {i + 1}, {place}", rule, [float(v) for v in matrices[i].ravel()])
            for i in bad[:_MAX_SHOWN]
        ]
        raise DataError(_capped(found, len(bad), where, rule))
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
    if len(lines) > _MAX_SHOWN and len(widths) == 1 and N_COLUMNS not in widths:  # another layout, not damaged lines
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
    faults = [f for rule, found in kinds.items() for f in _capped(found, len(found), where, rule)]
    if len(lines) < MIN_ROWS:
        faults.append(Fault(where, "", f"must have at least {MIN_ROWS} rows", len(lines)))
    return faults


def _separators(lines: Sequence[str]) -> str:
    """Return an addition to the rule on columns where commas or semicolons separate the numbers."""
    names = {",": "commas", ";": "semicolons"}
    marks = [name for mark, name in names.items() if any(mark in line for line in lines)]
    return f", separated by spaces and not by {' and '.join(marks)}" if marks else ""


def _capped(found: Sequence[Fault], count: int, where: str, rule: str) -> list[Fault]:
    """Return the first faults of a kind, and one that counts the other lines."""
    shown = list(found[:_MAX_SHOWN])
    if count > len(shown):
        shown.append(Fault(where, f"and {count - len(shown)} more lines", rule))
    return shown
