"""Writer of JIGSAWS trials: text of 76 columns, one line per sample, the inverse of `jigsaws`."""

from typing import Final

import numpy as np
import scipy

from tis.common.channels import MASTER
from tis.common.sources.jigsaws import COLUMNS, N_COLUMNS, RATE_HZ
from tis.common.sources.trajectory import Array, PoseTrack, Recording

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
