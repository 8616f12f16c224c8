"""Jumps of a recorded movement: steps far larger than the recording's own, within a movement that was slow.

A recorder that loses rows leaves a step of any size: over a still arm none, over a slow one some millimetres. No
absolute bound finds those without also finding the brisk movements of other recordings.
"""

from typing import Final

import numpy as np

from tis.common.sources.trajectory import Array, PoseTrack, Recording

MAX_REACH_M: Final = 2.0
"""The span of human arms; a da Vinci arm reaches less than half of it. Larger ranges are in wrong units."""

_TIMES_LARGE: Final = 5.0
_LARGE_SHARE: Final = 0.99
# Of 23 trials the largest steps of 21 are 0.9 to 3 times the trial's 99th percentile of steps; one has a step of 3.9,
# another one of 5.6 to 10, by device, where rows are missing.
_TIMES_NEIGHBOURS: Final = 4.0  # a minimum-jerk reach that spans three rows has 2.8, a jump in those trials 10 to 15
_MIN_ACCELERATION_M_S2: Final = 5.0  # half of gravity: 6 mm from one row to the next at 30 Hz
_MAX_STEPS: Final = 2  # into and out of one wrong row


def jumps(position_m: Array, rate_hz: float) -> list[int]:
    """Return the rows before which positions (N, 3) in m jump: such a row begins a new stretch.

    One or two steps, each five times larger than 99 % of the recording's (those that move), stand alone: the steps
    before and after are at most a quarter of them. None are found where wrong units are likely. Oracle: movements
    with rows cut out, reaches of any speed, and 23 recorded trials, test_jumps.
    """
    sizes_m = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    moving_m = sizes_m[sizes_m > 0]
    if not len(moving_m) or float(np.ptp(position_m, axis=0).max()) > MAX_REACH_M:
        return []
    usual_m = float(np.quantile(moving_m, _LARGE_SHARE, method="lower"))  # of few steps, all but the largest
    large = sizes_m > max(_TIMES_LARGE * usual_m, _MIN_ACCELERATION_M_S2 / rate_hz**2)
    found: list[int] = []
    for first, last in runs_of(large):
        beside = [sizes_m[i] for i in (first - 1, last + 1) if 0 <= i < len(sizes_m)]
        alone = _TIMES_NEIGHBOURS * max(beside, default=0.0) <= sizes_m[first : last + 1].min()
        if alone and last - first < _MAX_STEPS:
            found += range(first + 1, last + 2)
    return found


def stretches(recording: Recording) -> list[tuple[int, int]]:
    """Return the uninterrupted stretches of a recording, each as its first row and the row after its last.

    All devices are cut where one of them jumps, as a recorder loses the rows of all, and what an arm does after its
    master has jumped is no answer to the rows before.
    """
    tracks: list[PoseTrack] = [track for hand in recording.hands for track in (hand.command, hand.follower)]
    cuts = sorted({row for track in tracks for row in jumps(track.position_m, recording.rate_hz)})
    return list(zip([0, *cuts], [*cuts, len(recording)], strict=True))


def runs_of(holds: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Return the first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    return [(int(first), int(stop) - 1) for first, stop in edges.reshape(-1, 2)]
