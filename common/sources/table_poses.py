"""Poses in a table's columns, in the units and the orientation's form of its layout."""

import re
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import scipy

from tis.common.errors import MAX_SHOWN, Fault, capped
from tis.common.messages import MAX_SIZE
from tis.common.sources.table_columns import DeviceLayout
from tis.common.sources.trajectory import Array, PoseTrack, not_rotations, one_hemisphere


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
