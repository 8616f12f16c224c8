"""The arms as an observer of both networks sees them: true motion, estimates, hold's, and the displays."""

from bisect import bisect_right
from collections import deque
from itertools import islice
from math import degrees, dist, sqrt
from typing import Final, Generic, NamedTuple, TypeVar

import numpy as np
from msgspec import DecodeError
from numpy.typing import NDArray

from tis.common.channels import FOLLOWER, Channel, HandChannels, Network, hand_channels
from tis.common.messages import FeedbackPose, Pose, PredictedPose, decode, position_m
from tis.common.units import MM_PER_M, NS_PER_S
from tis.patient_side.rotations import turned, turned_by

T = TypeVar("T")


class Trail(Generic[T]):
    """Keeps the newest ``max_rows`` rows; a slow reader misses old rows and never blocks the writer."""

    def __init__(self, max_rows: int) -> None:
        self._rows: deque[T] = deque(maxlen=max_rows)
        self.n = 0

    def append(self, row: T) -> None:
        """Add a row; beyond ``max_rows`` the oldest one is dropped."""
        self._rows.append(row)
        self.n += 1

    def since(self, n_read: int) -> list[T]:
        """Return the rows after the first ``n_read`` ever added, as far as they are still kept.

        Oracle: a list that keeps everything (tests/deploy/watch/test_arms).
        """
        n_new = min(self.n - n_read, len(self._rows))
        return list(islice(self._rows, len(self._rows) - n_new, None)) if n_new > 0 else []

    def all(self) -> list[T]:
        """Return all rows kept, oldest first."""
        return list(self._rows)


Place = tuple[float, float, float]
Turn = NDArray[np.float64]
"""A unit quaternion x, y, z, w."""

_MAX_SAMPLES: Final = 600
_MAX_PENDING: Final = 600


class TrackRow(NamedTuple):
    """True position, the patient's estimate and hold's at a tick, in m; errors in mm (3D).

    ``turn_error_deg`` and ``hold_turn_error_deg`` are the angles to the true orientation; None: not known.
    """

    t_ns: int
    truth_m: Place
    estimate_m: Place
    hold_m: Place
    error_mm: float
    hold_error_mm: float
    turn_error_deg: float | None = None
    hold_turn_error_deg: float | None = None


class _Held(NamedTuple):
    sample_ns: int
    place_m: Place
    turn: Turn | None


class _PendingEstimate(NamedTuple):
    t_ns: int
    estimate_m: Place
    hold_m: Place
    turn: Turn | None
    hold_turn: Turn | None


class ArmMotion:
    """Joins the arm's samples as the surgeon sent them, as they arrived, and the patient's estimates.

    Truth at a tick is interpolated between the samples around it (``definitions``: truth(t)), so a row is known one
    sample after its tick. ``hold`` is the freshest sample that had arrived at the tick: the observer may see a sample
    before an estimate whose tick did not have it yet, so none newer than the newest that the patient tells counts.
    """

    def __init__(self) -> None:
        self._truth_ns: deque[int] = deque(maxlen=_MAX_SAMPLES)
        self._truth_m: deque[Place] = deque(maxlen=_MAX_SAMPLES)
        self._truth_turns: deque[Turn | None] = deque(maxlen=_MAX_SAMPLES)
        self._arrived: deque[_Held] = deque(maxlen=_MAX_SAMPLES)
        self._pending: deque[_PendingEstimate] = deque(maxlen=_MAX_PENDING)

    def sent(self, sample_ns: int, place_m: Place, turn: Turn | None = None) -> None:
        """Add a sample as sent by the surgeon; one that is not newer is a copy."""
        if not self._truth_ns or sample_ns > self._truth_ns[-1]:
            self._truth_ns.append(sample_ns)
            self._truth_m.append(place_m)
            self._truth_turns.append(turn)

    def arrived(self, sample_ns: int, place_m: Place, turn: Turn | None = None) -> None:
        """Add a sample as it reached the patient."""
        if not self._arrived or sample_ns > self._arrived[-1].sample_ns:
            self._arrived.append(_Held(sample_ns, place_m, turn))

    def estimated(self, t_ns: int, newest_ns: int, place_m: Place, turn: Turn | None = None) -> None:
        """Add the patient's estimate for the instant ``t_ns``, when its newest sample was of ``newest_ns``."""
        while len(self._arrived) > 1 and self._arrived[1].sample_ns <= newest_ns:
            self._arrived.popleft()
        if self._arrived and self._arrived[0].sample_ns <= newest_ns:
            hold = self._arrived[0]
            self._pending.append(_PendingEstimate(t_ns, place_m, hold.place_m, turn, hold.turn))

    def rows(self) -> list[TrackRow]:
        """Return the ticks whose truth is known by now, without those before the first sample."""
        found = []
        while self._pending and self._truth_ns and self._pending[0].t_ns <= self._truth_ns[-1]:
            pending = self._pending.popleft()
            truth_m = self._truth(pending.t_ns)
            if truth_m is not None:
                errors_mm = (MM_PER_M * dist(pending.estimate_m, truth_m), MM_PER_M * dist(pending.hold_m, truth_m))
                true_turn = self._true_turn(pending.t_ns)
                errors_deg = (_angle_deg(pending.turn, true_turn), _angle_deg(pending.hold_turn, true_turn))
                places = (truth_m, pending.estimate_m, pending.hold_m)
                found.append(TrackRow(pending.t_ns, *places, *errors_mm, *errors_deg))
        return found

    def _truth(self, t_ns: int) -> Place | None:
        after = bisect_right(self._truth_ns, t_ns)
        if after == 0:
            return None
        before_ns, before_m = self._truth_ns[after - 1], self._truth_m[after - 1]
        if before_ns == t_ns:
            return before_m
        share = (t_ns - before_ns) / (self._truth_ns[after] - before_ns)
        x, y, z = ((1 - share) * a + share * b for a, b in zip(before_m, self._truth_m[after], strict=True))
        return x, y, z

    def _true_turn(self, t_ns: int) -> Turn | None:
        """Return the true orientation, at constant speed between the samples around ``t_ns``, one of them known."""
        after = bisect_right(self._truth_ns, t_ns)
        before_ns, before = self._truth_ns[after - 1], self._truth_turns[after - 1]
        if before_ns == t_ns or before is None:
            return before
        later = self._truth_turns[after]
        if later is None:
            return None
        return turned_by(before, (t_ns - before_ns) / (self._truth_ns[after] - before_ns) * turned(before, later))


def _angle_deg(turn: Turn | None, truth: Turn | None) -> float | None:
    if turn is None or truth is None:
        return None
    vector = turned(turn, truth)
    return degrees(sqrt(float(vector @ vector)))


_MAX_ROWS: Final = 4000
_MAX_AHEAD_NS: Final = 10 * NS_PER_S


class DisplayRow(NamedTuple):
    """A display at a tick of the surgeon: delayed feedback, prediction, and how late the feedback is."""

    t_ns: int
    shown_m: Place
    predicted_m: Place
    late_ns: int

    @property
    def command_ns(self) -> int:
        """Return the instant of the newest command behind the feedback."""
        return self.t_ns - self.late_ns


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
        self.fresh_ns = -1
        """Run time at which a display last showed an answer to a newer command; -1 before the first."""
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
                pose = decode(payload, PredictedPose)
                shown, late_ns = pose.shown_m, pose.sample_ns - pose.command_ns
                row = DisplayRow(pose.sample_ns, (shown.x, shown.y, shown.z), position_m(pose), late_ns)
                last = self.rows[arm].since(self.rows[arm].n - 1)
                if _add(self.rows[arm], row, now_ns) and all(known.command_ns < row.command_ns for known in last):
                    self.fresh_ns = max(self.fresh_ns, row.t_ns)
            else:
                feedback = decode(payload, FeedbackPose)
                command_ns = feedback.command_sample_ns
                if command_ns is not None:
                    _add(self.arms[arm], ArmRow(feedback.sample_ns, position_m(feedback), command_ns), now_ns)
        except DecodeError:
            return

    def errors(self, begin_ns: int) -> DisplayErrors | None:
        """Return the errors of all displays from ``begin_ns`` on; None without any that took effect.

        Oracle: rows worked by hand, tests/deploy/watch/test_arms.
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


def _add(trail: Trail[Row], row: Row, now_ns: int) -> bool:
    newest_ns = max((known.t_ns for known in trail.since(trail.n - 1)), default=-1)
    is_new = newest_ns < row.t_ns <= now_ns + _MAX_AHEAD_NS
    if is_new:
        trail.append(row)
    return is_new


def _channels(row: HandChannels) -> list[tuple[Network, Channel[Pose]]]:
    return [("west", row.predicted), ("east", row.measured)]
