"""Recorded movements in memory: commands of masters and poses of arms, row by row at a fixed rate."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Arm, Hand, HandChannels, hand_channels

Array = NDArray[np.float64]


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
