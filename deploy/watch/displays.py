"""The surgeon's displays as an observer of both networks sees them, beside the arms themselves."""

from math import dist, sqrt
from typing import Final, NamedTuple, TypeVar

from pydantic import ValidationError

from tis.common.channels import FOLLOWER, Channel, HandChannels, Network, hand_channels
from tis.common.messages import FeedbackPose, PredictedPose, position_m
from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.watch.motion import Place, Trail

_MAX_ROWS: Final = 4000
_MAX_AHEAD_NS: Final = 10 * NS_PER_S


class DisplayRow(NamedTuple):
    """A display at a tick of the surgeon: delayed feedback, prediction, and how late the feedback is."""

    t_ns: int
    shown_m: Place
    predicted_m: Place
    late_ns: int


class ArmRow(NamedTuple):
    """The arm at a tick of the patient, and the newest command that the patient has then."""

    t_ns: int
    arm_m: Place
    command_ns: int


Row = TypeVar("Row", DisplayRow, ArmRow)


class DisplayErrors(NamedTuple):
    """Root mean squares in mm: distance to the arm at the tick that has the command, of feedback and prediction."""

    feedback_mm: float
    predicted_mm: float


class Displays:
    """Displays and arms of a session, by arm. Not thread-safe; rows are bounded."""

    def __init__(self, session: str) -> None:
        self.rows: dict[str, Trail[DisplayRow]] = {arm: Trail(_MAX_ROWS) for arm in FOLLOWER.values()}
        self.arms: dict[str, Trail[ArmRow]] = {arm: Trail(_MAX_ROWS) for arm in FOLLOWER.values()}
        self._arm_of = {
            (network, channel.key(session)): channel.device
            for hand, arm in FOLLOWER.items()
            for network, channel in _channels(hand_channels(hand, arm))
        }

    def keys(self, network: Network) -> list[str]:
        """Return the keys to listen to on a network."""
        return [key for on, key in self._arm_of if on == network]

    def knows(self, network: Network, key: str) -> bool:
        """Tell whether a key is that of a display or an arm on a network."""
        return (network, key) in self._arm_of

    def take(self, network: Network, key: str, payload: bytes, now_ns: int) -> None:
        """Add a message; what cannot be read, is not newer, or is far ahead of the run's time is ignored."""
        arm = self._arm_of[network, key]
        try:
            if network == "west":
                pose = PredictedPose.model_validate_json(payload)
                shown, late_ns = pose.shown_m, pose.sample_ns - pose.command_ns
                row = DisplayRow(pose.sample_ns, (shown.x, shown.y, shown.z), position_m(pose), late_ns)
                _add(self.rows[arm], row, now_ns)
            else:
                feedback = FeedbackPose.model_validate_json(payload)
                command_ns = feedback.command_sample_ns
                if command_ns is not None:
                    _add(self.arms[arm], ArmRow(feedback.sample_ns, position_m(feedback), command_ns), now_ns)
        except ValidationError:
            return

    def errors(self, begin_ns: int) -> DisplayErrors | None:
        """Return the errors of all displays from ``begin_ns`` on; None without any that took effect.

        Oracle: rows worked by hand, tests/deploy/watch/test_displays.
        """
        squares: list[tuple[float, float]] = []
        for arm, trail in self.rows.items():
            # both are ascending in time: each display meets the first tick that has its command
            ticks = iter(self.arms[arm].all())
            tick = next(ticks, None)
            for row in trail.all():
                if row.t_ns < begin_ns:
                    continue
                while tick is not None and tick.command_ns < row.t_ns:
                    tick = next(ticks, None)
                if tick is None:
                    break
                squares.append((dist(row.shown_m, tick.arm_m) ** 2, dist(row.predicted_m, tick.arm_m) ** 2))
        if not squares:
            return None
        feedback, predicted = (MM_PER_M * sqrt(sum(each) / len(squares)) for each in zip(*squares, strict=True))
        return DisplayErrors(feedback, predicted)


def _add(trail: Trail[Row], row: Row, now_ns: int) -> None:
    newest_ns = max((known.t_ns for known in trail.since(trail.n - 1)), default=-1)
    if newest_ns < row.t_ns <= now_ns + _MAX_AHEAD_NS:
        trail.append(row)


def _channels(row: HandChannels) -> list[tuple[Network, Channel]]:
    return [("west", row.predicted), ("east", row.measured)]
