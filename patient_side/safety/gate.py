"""The gate in front of the estimators: a sample that the surgeon cannot have sent, or no arm can make, is not used.

The surgeon's packets are known in advance but for their content: each sample has its instant and its sequence numbers
(`tis.common.ticker`). So a forged packet must take the number of a true one. Its content must continue the
movement of the whole pose.
"""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import dist, hypot, inf, pi, radians
from typing import Final, Literal, NamedTuple

from tis.common.messages import Pose, components, position_m
from tis.common.scenario.safety import USUAL_SAMPLES, Gate
from tis.common.ticker import SendPlan
from tis.common.units import NS_PER_MS, NS_PER_S, ms_to_ns, sample_index
from tis.common.vector import Vector, minus
from tis.patient_side.rotations import Quaternion, is_orientation, turn_to
from tis.patient_side.safety.limits import Three, limits_from
from tis.patient_side.safety.set_point import STILL, Place

Kind = Literal[
    "conflicting", "ahead", "number", "place", "speed", "acceleration", "turn_speed", "turn_acceleration", "gripper"
]

LIMIT_OF: Final[Mapping[Kind, str]] = {
    "ahead": "lead_ms",
    "place": "reach_m",
    "speed": "speed_m_s",
    "acceleration": "acceleration_m_s2",
    "turn_speed": "turn_deg_s",
    "turn_acceleration": "turn_acceleration_deg_s2",
    "gripper": "gripper_deg",
}
"""Field of `patient.gate` that a sample of this kind exceeds; others break the surgeon's plan."""

_MAX_DRIFT: Final = 100e-6
"""Drift of two clocks that were compared at the beginning: quartz keeps 50 parts in a million each."""
_NOISE_M: Final = 0.002
"""Distance that is no movement: noise of a sensor and rounding, which at 1 kHz would pass for speed."""
_NOISE_RAD: Final = 0.02
"""Angle that is no movement."""
BASE_NS: Final = 33 * NS_PER_MS
"""Time over which a velocity is measured at least, so that noise does not pass for acceleration."""
_UNIT: Final = 1e-6
"""Difference from 1 of the length of an orientation that counts as 1."""
_N_KEPT: Final = 512


class GateLimits(NamedTuple):
    """Limits of a sample: of its place and movement, of its lead over now, of its turning and of its gripper."""

    reach_m: float
    speed_m_s: float
    acceleration_m_s2: float
    lead_ns: int
    turn_rad_s: float = inf
    turn_acceleration_rad_s2: float = inf
    gripper_rad: float = inf
    gripper_rad_s: float = inf


def limits_of(part: Gate, is_arm: bool = True, trained: Three | None = None) -> GateLimits:
    """Return the limits of a scenario for a stream; how fast a master's gripper moves has none.

    Those of place and movement that are not given are the usual ones, or follow from reach, speed and acceleration of
    training rows, ``trained``, where these need more. Oracle: test_gate.
    """
    given = part.reach_m, part.speed_m_s, part.acceleration_m_s2
    return GateLimits(
        *limits_from(given, USUAL_SAMPLES, trained),
        ms_to_ns(part.lead_ms),
        radians(part.turn_deg_s),
        radians(part.turn_acceleration_deg_s2),
        radians(part.gripper_deg),
        radians(part.gripper_deg_s) if is_arm else inf,
    )


class _Known(NamedTuple):
    """An admitted sample, as others are measured against it.

    ``stated`` is its own orientation, None without one; ``turn`` then is that of the sample before it.
    """

    where: Place
    stated: Quaternion | None
    gripper_rad: float
    turn: Quaternion | None

    def is_same(self, other: "_Known") -> bool:
        """Tell whether both state one pose."""
        return self[:3] == other[:3]


@dataclass
class StreamGate:
    """Gate of one stream; ``centre_m`` is the middle of its workspace, ``plan`` the surgeon's. Oracle: test_gate.

    After a true jump of d metres the movement is admitted again d / speed_m_s later, when a hand could be there; a
    second movement beside the true one never is, as each true sample is measured anew.
    """

    plan: SendPlan
    centre_m: Place
    limits: GateLimits
    _at_ns: list[int] = field(default_factory=list, repr=False)
    _known: list[_Known] = field(default_factory=list, repr=False)

    def refusal(self, pose: Pose, seq: int, recv_ns: int) -> Kind | None:
        """Return why a message's own sample is not to be used; None admits it.

        Later samples are measured against an admitted one.
        """
        kind = self._of_schedule(pose.sample_ns, seq, recv_ns)
        if kind is not None:
            return kind
        return self._of_pose(pose)

    def refusal_of_earlier(self, pose: Pose) -> Kind | None:
        """Return why an earlier sample in a message's history is not to be used; None admits it."""
        return self._of_pose(pose)

    def _number(self, at_ns: int) -> int:
        """Return the number in the plan of a sample: its instant may be up to half a period beside the plan's."""
        return sample_index(at_ns, self.plan.rate_hz)

    def _of_schedule(self, at_ns: int, seq: int, recv_ns: int) -> Kind | None:
        """Return the fault of a sample's instant, or of its number, against the plan."""
        plan = self.plan
        if at_ns > recv_ns + self.limits.lead_ns + _MAX_DRIFT * recv_ns + NS_PER_S / plan.rate_hz:
            return "ahead"
        k = self._number(at_ns)
        if k >= plan.n_samples:
            return "number"
        if plan.copies == 1:  # by far the most frequent plan
            return None if seq == k else "number"
        return None if any(plan.seq_of(k, copy) == seq for copy in range(plan.copies)) else "number"

    def _of_pose(self, pose: Pose) -> Kind | None:
        """Return the fault of a sample against the workspace and the admitted ones around it; keep it without one."""
        limits, known_ns, known = self.limits, self._at_ns, self._known
        at_ns, where, turn = pose.sample_ns, position_m(pose), _unit(components(pose.orientation))
        if dist(where, self.centre_m) > limits.reach_m:
            return "place"
        if abs(pose.gripper_rad) > limits.gripper_rad:
            return "gripper"
        # nearly always a sample is the newest one
        at = len(known_ns) if not known_ns or at_ns > known_ns[-1] else bisect_left(known_ns, at_ns)
        continued = known[at - 1].turn if turn is None and at else turn
        new = _Known(where, turn, pose.gripper_rad, continued)
        for i in (at, at - 1):
            if 0 <= i < len(known_ns) and self._number(known_ns[i]) == self._number(at_ns):
                return None if known_ns[i] == at_ns and known[i].is_same(new) else "conflicting"
        if at < len(known_ns):
            kind = self._of_neighbour(at, at_ns, new) or (self._of_neighbour(at - 1, at_ns, new) if at else None)
        else:
            kind = (self._of_neighbour(at - 1, at_ns, new) or self._of_acceleration(at_ns, new)) if at else None
        if kind is None:
            self._keep(at, at_ns, new)
        return kind

    def _of_neighbour(self, i: int, at_ns: int, new: _Known) -> Kind | None:
        """Return the fault of a sample that is farther from an admitted one than an arm can move."""
        limits, old = self.limits, self._known[i]
        span_s = abs(at_ns - self._at_ns[i]) / NS_PER_S
        if dist(new.where, old.where) > _NOISE_M + limits.speed_m_s * span_s:
            return "speed"
        if _turns_more(old.turn, new.turn, _NOISE_RAD + limits.turn_rad_s * span_s):
            return "turn_speed"
        if abs(new.gripper_rad - old.gripper_rad) > _NOISE_RAD + limits.gripper_rad_s * span_s:
            return "gripper"
        return None

    def _of_acceleration(self, at_ns: int, new: _Known) -> Kind | None:
        """Return the fault of a newest sample whose velocity differs too much from the one before it."""
        # Both velocities are of at least `BASE_NS`, so that of a fast arm at a high rate is no change of velocity.
        limits, last = self.limits, self._before(at_ns)
        base = -1 if last < 0 else self._before(self._at_ns[last])
        if base < 0:
            return None
        before_s = (self._at_ns[last] - self._at_ns[base]) / NS_PER_S
        after_s = (at_ns - self._at_ns[last]) / NS_PER_S
        half_s = (before_s + after_s) / 2
        known, at_base = self._known[last], self._known[base]
        after, before = minus(new.where, known.where), minus(known.where, at_base.where)
        if _change(after, after_s, before, before_s) > limits.acceleration_m_s2 * half_s + _NOISE_M / after_s:
            return "acceleration"
        most_rad_s = limits.turn_acceleration_rad_s2 * half_s + _NOISE_RAD / after_s
        # what the speed alone keeps within the limit needs no second turn, as nearly always
        if _turns_more(known.turn, new.turn, (most_rad_s - limits.turn_rad_s) * after_s):
            turned, before = _turn(known.turn, new.turn), _turn(at_base.turn, known.turn)
            if _change(turned, after_s, before, before_s) > most_rad_s:
                return "turn_acceleration"
        return None

    def _before(self, at_ns: int) -> int:
        """Return the newest admitted sample at least `BASE_NS` before an instant; -1 without one."""
        return bisect_left(self._at_ns, at_ns - BASE_NS + 1) - 1

    def _keep(self, at: int, at_ns: int, new: _Known) -> None:
        """Add an admitted sample in the order of instants; the oldest ones are forgotten."""
        self._at_ns.insert(at, at_ns)
        self._known.insert(at, new)
        if len(self._at_ns) > _N_KEPT:
            del self._at_ns[: -_N_KEPT // 2], self._known[: -_N_KEPT // 2]


def _unit(turn: Quaternion) -> Quaternion | None:
    """Return an orientation of length 1; None where the numbers are none."""
    norm = hypot(*turn)
    if abs(norm - 1.0) < _UNIT:
        return turn
    return (turn[0] / norm, turn[1] / norm, turn[2] / norm, turn[3] / norm) if is_orientation(turn) else None


def _turns_more(here: Quaternion | None, there: Quaternion | None, most_rad: float) -> bool:
    """Tell whether two orientations of length 1 differ by more than an angle."""
    if here is None or there is None or pi * dist(here, there) <= most_rad:  # a chord of 2 sin(angle / 4)
        return False
    return dist(turn_to(here, there), STILL) > most_rad


def _turn(here: Quaternion | None, there: Quaternion | None) -> Vector:
    return STILL if here is None or there is None else turn_to(here, there)


def _change(after: Vector, after_s: float, before: Vector, before_s: float) -> float:
    """Return the change between two velocities, which movements and their times state."""
    (x, y, z), (a, b, c) = after, before
    return dist((x / after_s, y / after_s, z / after_s), (a / before_s, b / before_s, c / before_s))
