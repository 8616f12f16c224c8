"""Poses in a table's columns, in the units and the orientation's form of its layout, and the clock of its rows.

The clock of the rows is their order, their rate and their gaps; it gives the instants that a run plays.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final, Literal

import numpy as np
import scipy

from tis.common.errors import MAX_SHOWN, Fault, capped
from tis.common.messages import MAX_SIZE
from tis.common.scenario.table_source import MAX_RESAMPLED
from tis.common.sources.plausibility import RATES_HZ
from tis.common.sources.table_columns import MAX_ROWS, DeviceLayout
from tis.common.sources.trajectory import Array, PoseTrack, not_rotations, one_hemisphere

SECONDS_PER: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

_GAP_PERIODS: Final = 1.8  # one row that is missing leaves 2 periods
_RATE_TOLERANCE: Final = 0.005
_ON_GRID_S: Final = 1e-6
_MOST_RAISED: Final = 4.0  # more rows between two recorded ones are a straight line's, and no movement


@dataclass(frozen=True)
class RowClock:
    """Times (N,) of the rows in s, from the first one, their rate, and the gaps as rows before them."""

    t_s: Array
    found_hz: float
    gaps: tuple[int, ...]

    def gaps_in_words(self) -> str:
        """Return number, place and length of the gaps."""
        lengths_s = [self.t_s[row + 1] - self.t_s[row] for row in self.gaps]
        shown = ", ".join(
            f"{self.t_s[row]:.3f} s (row {row}; {1e3 * length:.0f} ms)"
            for row, length in list(zip(self.gaps, lengths_s, strict=True))[:3]
        )
        rest = f" and {len(self.gaps) - 3} more" if len(self.gaps) > 3 else ""
        return f"{len(self.gaps)} {'gap' if len(self.gaps) == 1 else 'gaps'}, after {shown}{rest}"


@dataclass(frozen=True)
class Played:
    """Instants (M,) in s at which rows are interpolated, None where they are played as they are, and warnings."""

    at_s: Array | None
    warnings: tuple[str, ...] = ()


def row_clock(t_s: Array, where: str, column: str) -> tuple[RowClock | None, list[Fault]]:
    """Return the clock of finite times (N,) in s, N >= 2, or the faults of times that repeat or go back.

    The rate is that of the rows without the gaps; a gap is a step of 1.8 times the median or more. Oracle: grids
    with rows cut out, test_table_poses.
    """
    steps_s = np.diff(t_s)
    bad = np.flatnonzero(steps_s <= 0.0)
    if bad.size:
        rule = f"must be later than the row before (column {column}): sort the rows, or leave repeated ones out"
        found = [
            Fault(where, f"row {i + 1}", rule, f"{t_s[i + 1]:.9g} s after {t_s[i]:.9g} s") for i in bad[:MAX_SHOWN]
        ]
        return None, capped(found, len(bad), where, rule)
    long = steps_s > _GAP_PERIODS * float(np.median(steps_s))
    found_hz = 1.0 / float(steps_s[~long].mean())
    return RowClock(t_s - t_s[0], found_hz, tuple(int(i) for i in np.flatnonzero(long))), []


def played(
    clock: RowClock, rate_hz: int, resample: bool | float, gaps: Literal["refuse", "bridge"], where: str,
    time_unit: str | None = None,
) -> tuple[Played, list[Fault]]:  # fmt: skip
    """Return the instants that a run at ``rate_hz`` plays, or the faults of gaps and of another rate.

    Rows on the grid of ``rate_hz`` are played as they are. ``resample`` interpolates others: True where the rate is
    that of a recorder, and raised four times at most; a number where it is raised so many times at most. Rows that
    are counted have no ``time_unit``. Oracle: test_table_poses.
    """
    faults, warnings = [], []
    if clock.gaps and gaps == "refuse":
        rule = (
            "cut the table at them into files of one folder, and compare on these: tis compare --trials "
            "me_1.csv,me_2.csv; or set source.gaps: bridge to play over them"
        )
        faults.append(Fault(where, "", f"has {clock.gaps_in_words()}: {rule}"))
    elif clock.gaps:
        done = "interpolated" if resample else "played without the time that is missing"
        warnings.append(f"{clock.gaps_in_words()}: {done}")
    grid_s = np.arange(len(clock.t_s)) / rate_hz
    off_s = float(np.abs(clock.t_s - grid_s).max())
    if off_s <= _ON_GRID_S:
        return Played(None, tuple(warnings)), faults
    other = rate_hz / clock.found_hz
    likely, question = other_unit(clock.found_hz, float(clock.t_s[-1]), time_unit)
    usual = not likely and other <= _MOST_RAISED * (1.0 + _RATE_TOLERANCE)
    n = int(np.floor(clock.t_s[-1] * rate_hz + 1e-6)) + 1
    if usual if resample is True else other <= resample * (1.0 + _RATE_TOLERANCE):
        if n > MAX_ROWS:
            return Played(None), [*faults, Fault(where, "", f"must have at most {MAX_ROWS} rows at {rate_hz} Hz", n)]
        about = f"resampled from {clock.found_hz:.6g} rows a second to {rate_hz}: positions and angles linearly"
        warnings.append(f"{about}, orientations along great arcs")
        return Played(np.minimum(np.arange(n) / rate_hz, clock.t_s[-1]), tuple(warnings)), faults
    if resample or abs(other - 1.0) > _RATE_TOLERANCE:
        raised = max(1, ceil(other - 1e-6 * other))
        nearest = round(clock.found_hz)
        is_whole = not likely and abs(clock.found_hz / max(nearest, 1) - 1.0) <= _RATE_TOLERANCE
        choices = [f"rate_hz: {nearest}"] if is_whole else []
        if n <= MAX_ROWS and raised <= MAX_RESAMPLED:  # else it would be refused in turn
            few = "" if other <= _MOST_RAISED else f", {raised} from each recorded one"
            choices.append(f"source.resample: {'true' if usual else raised} to interpolate rows at {rate_hz} Hz{few}")
        rule = f"has {clock.found_hz:.6g} rows a second and the scenario's rate_hz is {rate_hz}: "
        rule += f"{question} Then set source.columns.time and source.units.time: {likely}" if likely else ""
        rule += "; else " if likely and choices else ""
        rule += f"set {', or '.join(choices)}" if choices else ""
        return Played(None), [*faults, Fault(where, "", rule)]
    if not clock.gaps and off_s > 0.5 / rate_hz:
        warnings.append(
            f"its times depart from {rate_hz} rows a second by up to {1e3 * off_s:.0f} ms; rows are played evenly "
            "(source.resample: true interpolates them)"
        )
    return Played(None, tuple(warnings)), faults


def other_unit(found_hz: float, span_s: float, unit: str | None) -> tuple[str, str]:
    """Return the likely unit of times, and it as a question, where ``unit`` gives no recorder's rate; else "", "".

    Times of ``unit`` give ``found_hz`` rows a second over ``span_s``; rows that are counted have none. Oracle: one
    clock in every unit, test_table_poses.
    """
    if unit is None or RATES_HZ[0] <= found_hz <= RATES_HZ[1]:
        return "", ""
    for other, seconds in SECONDS_PER.items():
        factor = seconds / SECONDS_PER[unit]
        if RATES_HZ[0] <= found_hz / factor <= RATES_HZ[1]:
            about = f"{found_hz / factor:.6g} rows a second over {span_s * factor:.4g} s instead of {span_s:.4g} s"
            return other, f"are its times in {other} ({about})?"
    return "", ""


def resampled(track: PoseTrack, t_s: Array, at_s: Array) -> PoseTrack:
    """Return the poses at instants (M,) within times (N,), in s: positions and angles linear, orientations by slerp.

    Shoemake, "Animating rotation with quaternion curves", 1985. Oracle: lines and
    a constant rotation, test_table_poses.
    """
    position = np.stack([np.interp(at_s, t_s, axis) for axis in track.position_m.T], axis=1)
    turns = scipy.spatial.transform.Rotation.from_quat(track.orientation)
    orientation = scipy.spatial.transform.Slerp(t_s, turns)(at_s).as_quat()
    return PoseTrack(position, one_hemisphere(orientation), np.interp(at_s, t_s, track.gripper_rad))


Columns = Mapping[str, Array]
"""Columns (N,) of a table by their names."""

_M_PER: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_RAD_PER: Final = {"rad": 1.0, "deg": np.pi / 180.0}
_NORM_TOLERANCE: Final = 0.01
_MIN_REACH_M: Final = 5e-4  # a movement within half a millimetre is more likely one of half a metre in other units
_MAX_ANGLE_RAD: Final = 4.0 * np.pi


def finite_faults(columns: Columns, where: str) -> list[Fault]:
    """Return the faults of numbers that are not finite, capped for each column."""
    found = []
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        rule = "must be finite"
        shown = [Fault(where, f"row {i}, column {name}", rule, float(values[i])) for i in bad[:MAX_SHOWN]]
        found += capped(shown, len(bad), where, f"{rule} in column {name}")
    return found


def pose_track(columns: Columns, device: DeviceLayout, where: str) -> tuple[PoseTrack, list[Fault]]:
    """Return the poses of a device from finite columns: m, unit quaternions x y z w in one hemisphere, rad.

    Faults name rows whose quaternion is not of norm 1 or whose matrix is no rotation, within 0.01, and those with a
    number that no message holds, at most five of each; quaternions within are normalised, and matrices replaced by
    the nearest rotation. Oracle: the same rotation in every form, test_table_poses.
    """
    pose, units = device.columns, device.units
    position_m = _M_PER[units.position or "m"] * _stacked(columns, pose.position)
    n_rows = len(position_m)
    gripper = np.zeros(n_rows) if pose.gripper is None else _RAD_PER[units.gripper] * columns[pose.gripper]
    orientation, faults = np.tile([0.0, 0.0, 0.0, 1.0], (n_rows, 1)), list[Fault]()
    if pose.quaternion is not None:
        given = _stacked(columns, pose.quaternion)
        orientation, faults = _of_quaternions(given, pose.quaternion_order, pose.quaternion, where)
    elif pose.matrix is not None:
        orientation, faults = _of_matrices(_stacked(columns, pose.matrix).reshape(-1, 3, 3), pose.matrix, where)
    elif pose.euler is not None:
        angles_rad = _RAD_PER[units.angle] * _stacked(columns, pose.euler)
        orientation = scipy.spatial.transform.Rotation.from_euler(pose.euler_axes, angles_rad).as_quat()
    faults += _too_large(position_m, "m", pose.position, where)
    faults += _too_large(gripper[:, np.newaxis], "rad", [pose.gripper or ""], where)
    return PoseTrack(position_m, one_hemisphere(orientation), gripper), faults


def _too_large(values: Array, unit: str, names: Sequence[str], where: str) -> list[Fault]:
    """Return the faults of rows (N, C) with numbers that no message holds: they would overflow between two rows."""
    bad = np.flatnonzero((np.abs(values) > MAX_SIZE).any(axis=1))
    rule = f"must be of at most {MAX_SIZE:g} {unit} (columns {' '.join(names)})"
    found = [Fault(where, f"row {i}", rule, float(np.abs(values[i]).max())) for i in bad[:MAX_SHOWN]]
    return capped(found, len(bad), where, rule)


def unit_doubts(columns: Columns, device: DeviceLayout) -> list[str]:
    """Return sentences on positions, angles and quaternions that likely have other units, or another order.

    Positions that span more than an arm are found by `tis.common.sources.plausibility`.
    """
    pose, units, found = device.columns, device.units, []
    unit = units.position or "m"
    reach_m = _M_PER[unit] * float(np.ptp(_stacked(columns, pose.position), axis=0).max())
    if 0.0 < reach_m < _MIN_REACH_M:
        found.append(f"{device.name} moves within {1e3 * reach_m:.2g} mm, taken for {unit}: are these other units?")
    angles = [(name, units.angle) for name in pose.euler or ()]
    angles += [] if pose.gripper is None else [(pose.gripper, units.gripper)]
    for name, unit_of_angle in angles:
        largest_rad = _RAD_PER[unit_of_angle] * float(np.abs(columns[name]).max())
        if largest_rad > _MAX_ANGLE_RAD:
            found.append(f"{device.name} has angles up to {largest_rad:.3g} rad in column {name}: are these degrees?")
    return found + _order_doubts(device)


_LETTER: Final = re.compile(r"[wxyz](?![a-z])")


def _order_doubts(device: DeviceLayout) -> list[str]:
    """Return a sentence where the names of a quaternion's columns tell another order than the layout."""
    pose = device.columns
    letters = [_LETTER.findall(name.partition("[")[0].lower())[-1:] for name in pose.quaternion or ()]
    named = "".join(letter for found in letters for letter in found)
    if sorted(named) != sorted("wxyz") or named == pose.quaternion_order:
        return []
    rule = f"is read in the order {pose.quaternion_order}, and its columns are named {named}: quaternion_order?"
    return [f"{device.name}: the quaternion {rule}"]


def following(track: PoseTrack, gain: float) -> PoseTrack:
    """Return the poses of a device that repeats another one's: positions times ``gain``, the same orientation."""
    return PoseTrack(gain * track.position_m, track.orientation, track.gripper_rad)


def _stacked(columns: Columns, names: Sequence[str]) -> Array:
    return np.stack([columns[name] for name in names], axis=1)


def _of_quaternions(given: Array, order: str, names: Sequence[str], where: str) -> tuple[Array, list[Fault]]:
    scalar_last = given if order == "xyzw" else np.roll(given, -1, axis=1)
    norms = np.linalg.norm(scalar_last, axis=1)
    bad = np.flatnonzero(~(np.abs(norms - 1.0) <= _NORM_TOLERANCE))
    rule = f"must be a quaternion of norm 1 (columns {' '.join(names)})"
    found = [Fault(where, f"row {i}", rule, f"norm {norms[i]:.4g}") for i in bad[:MAX_SHOWN]]
    if bad.size:
        return np.tile([0.0, 0.0, 0.0, 1.0], (len(given), 1)), capped(found, len(bad), where, rule)
    return scalar_last / norms[:, np.newaxis], []


def _of_matrices(given: Array, names: Sequence[str], where: str) -> tuple[Array, list[Fault]]:
    bad = not_rotations(given)
    rule = f"must be a rotation matrix (columns {names[0]} ... {names[-1]})"
    found = [Fault(where, f"row {i}", rule, [float(v) for v in given[i].ravel()]) for i in bad[:MAX_SHOWN]]
    if bad.size:
        return np.tile([0.0, 0.0, 0.0, 1.0], (len(given), 1)), capped(found, len(bad), where, rule)
    return scipy.spatial.transform.Rotation.from_matrix(given).as_quat(), []
