"""Recorded movements in memory: commands of masters and poses of arms, row by row at a fixed rate."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Arm, Hand, HandChannels, hand_channels

Array = NDArray[np.float64]

_ROTATION_TOLERANCE: Final = 0.01  # matrices of JIGSAWS miss orthogonality by up to 0.0013


@dataclass(frozen=True)
class PoseTrack:
    """N poses: positions (N, 3) in m, unit quaternions x y z w (N, 4), gripper angles (N,) in rad."""

    position_m: Array
    orientation: Array
    gripper_rad: Array

    def __len__(self) -> int:
        return len(self.position_m)

    def rows(self, first: int, stop: int) -> "PoseTrack":
        """Return rows ``first`` .. ``stop - 1``."""
        part = slice(first, stop)
        return PoseTrack(self.position_m[part], self.orientation[part], self.gripper_rad[part])


@dataclass(frozen=True)
class HandRecording:
    """One master and the arm that follows it, of equal length.

    ``command_velocity_m_s`` (N, 3) is the recording's velocity, if requested; it depends on later rows.
    """

    hand: Hand
    arm: Arm
    command: PoseTrack
    follower: PoseTrack
    command_velocity_m_s: Array | None = None

    @property
    def channels(self) -> HandChannels:
        """Return the channels that carry this hand."""
        return hand_channels(self.hand, self.arm)

    def rows(self, first: int, stop: int) -> "HandRecording":
        """Return rows ``first`` .. ``stop - 1``."""
        velocity = None if self.command_velocity_m_s is None else self.command_velocity_m_s[first:stop]
        command, follower = self.command.rows(first, stop), self.follower.rows(first, stop)
        return HandRecording(self.hand, self.arm, command, follower, velocity)


@dataclass(frozen=True)
class Recording:
    """A trial with the hands that the scenario plays.

    ``start`` is the row that becomes sample 0 of the run; earlier rows may serve for training. ``digest`` identifies
    the content; ``warnings`` concern the pairing, ``anomalies`` the plausibility of the movement, and ``left_out``
    the damaged recordings that should have been used with this one. ``person`` is who moves, where that is known.
    """

    label: str
    rate_hz: int
    hands: tuple[HandRecording, ...]
    start: int
    pairing: str
    warnings: tuple[str, ...] = ()
    anomalies: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    digest: str = ""
    file: str | None = None
    person: str = ""

    def __len__(self) -> int:
        return len(self.hands[0].command)

    def head(self, n_rows: int) -> "Recording":
        """Return the first ``n_rows`` rows: the training part of ``own_head``."""
        hands = tuple(hand.rows(0, n_rows) for hand in self.hands)
        return replace(self, hands=hands, start=0)


def one_hemisphere(quaternions: Array) -> Array:
    """Return the same rotations (N, 4), x y z w, with signs such that each is nearest to the one before it.

    The first has w >= 0. Oracle: half-angle quaternions, test_jigsaws.
    """
    # The sign of a row is the product of all sign changes up to it.
    turns = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1.0, 1.0)
    first = -1.0 if quaternions[0, 3] < 0 else 1.0
    return quaternions * (first * np.concatenate([[1.0], np.cumprod(turns)]))[:, np.newaxis]


def not_rotations(matrices: Array) -> NDArray[np.int64]:
    """Return the indices of matrices (N, 3, 3) that are no rotations, within the rounding of a file.

    A rotation matrix is orthogonal and has determinant +1.
    """
    departure = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    return np.flatnonzero(~(departure <= _ROTATION_TOLERANCE) | (np.linalg.det(matrices) < 0))
