"""The gate in front of the estimators: a sample that the surgeon cannot have sent, or no arm can make, is not used.

The surgeon's packets are known in advance but for their content: each sample has its instant and its sequence numbers
(`common.send_plan`). So a forged packet must take the number of a true one. Its content must continue the movement.
"""

from bisect import bisect_left
from dataclasses import dataclass, field
from math import dist
from typing import Final, Literal, NamedTuple

from common.messages import Pose, position_m
from common.send_plan import SendPlan
from common.units import NS_PER_MS, NS_PER_S, sample_index, sample_instant_ns
from patient_side.safety.set_point import STILL, Place

Kind = Literal["conflicting", "ahead", "number", "place", "speed", "acceleration"]

_MAX_DRIFT: Final = 100e-6
"""Drift of two clocks that were compared at the beginning: quartz keeps 50 parts in a million each."""
_NOISE_M: Final = 0.002
"""Distance that is no movement: noise of a sensor and rounding, which at 1 kHz would pass for speed."""
_BASE_NS: Final = 33 * NS_PER_MS
"""Time over which a velocity is measured at least, so that noise does not pass for acceleration."""
_N_KEPT: Final = 512


class GateLimits(NamedTuple):
    """Limits of a sample: how far from the centre, how fast, and how far ahead of now."""

    reach_m: float
    speed_m_s: float
    acceleration_m_s2: float
    lead_ns: int


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
    _where: list[Place] = field(default_factory=list, repr=False)

    def refusal(self, pose: Pose, seq: int, recv_ns: int) -> Kind | None:
        """Return why a message's own sample is not to be used; None admits it.

        Later samples are measured against an admitted one.
        """
        kind = self._of_schedule(pose.sample_ns, seq, recv_ns)
        if kind is not None:
            return kind
        at_ns, where = pose.sample_ns, position_m(pose)
        kind = self._of_movement(at_ns, where)
        if kind is None:
            self._keep(at_ns, where)
        return kind

    def refusal_of_earlier(self, pose: Pose) -> Kind | None:
        """Return why an earlier sample in a message's history is not to be used; None admits it."""
        at_ns, where = pose.sample_ns, position_m(pose)
        k = sample_index(at_ns, self.plan.rate_hz)
        if sample_instant_ns(k, self.plan.rate_hz) != at_ns:
            return "number"
        kind = self._of_movement(at_ns, where)
        if kind is None:
            self._keep(at_ns, where)
        return kind

    def _of_schedule(self, at_ns: int, seq: int, recv_ns: int) -> Kind | None:
        """Return the fault of a sample's instant, or of its number, against the plan."""
        plan = self.plan
        if at_ns > recv_ns + self.limits.lead_ns + _MAX_DRIFT * recv_ns + NS_PER_S / plan.rate_hz:
            return "ahead"
        k = sample_index(at_ns, plan.rate_hz)
        if k >= plan.n_samples or sample_instant_ns(k, plan.rate_hz) != at_ns:
            return "number"
        if plan.copies == 1:  # by far the most frequent plan
            return None if seq == k else "number"
        return None if any(plan.seq_of(k, copy) == seq for copy in range(plan.copies)) else "number"

    def _of_movement(self, at_ns: int, where: Place) -> Kind | None:
        """Return the fault of a sample against the workspace and the admitted samples around it."""
        if dist(where, self.centre_m) > self.limits.reach_m:
            return "place"
        known_ns, known, speed_m_s = self._at_ns, self._where, self.limits.speed_m_s
        if not known_ns:
            return None
        # in order, as nearly always: only the last sample matters, and the velocity before it
        if at_ns > known_ns[-1]:
            if _is_faster(known_ns[-1], known[-1], at_ns, where, speed_m_s):
                return "speed"
            return "acceleration" if self._turns_too_fast(at_ns, where) else None
        i = bisect_left(known_ns, at_ns)
        if known_ns[i] == at_ns:
            return None if known[i] == where else "conflicting"
        around = (i - 1, i) if i else (i,)
        return "speed" if any(_is_faster(known_ns[j], known[j], at_ns, where, speed_m_s) for j in around) else None

    def _turns_too_fast(self, at_ns: int, where: Place) -> bool:
        """Tell whether the velocity to a newest sample differs too much from the one before it."""
        last_ns, (x1, y1, z1) = self._at_ns[-1], self._where[-1]
        base = bisect_left(self._at_ns, last_ns - _BASE_NS + 1) - 1
        if base < 0:
            return False
        (x0, y0, z0), (x2, y2, z2) = self._where[base], where
        before_s = (last_ns - self._at_ns[base]) / NS_PER_S
        after_s = max(at_ns - last_ns, _BASE_NS) / NS_PER_S
        change = (
            (x2 - x1) / after_s - (x1 - x0) / before_s,
            (y2 - y1) / after_s - (y1 - y0) / before_s,
            (z2 - z1) / after_s - (z1 - z0) / before_s,
        )
        most_m_s = self.limits.acceleration_m_s2 * (before_s + after_s) / 2 + _NOISE_M / after_s
        return dist(change, STILL) > most_m_s

    def _keep(self, at_ns: int, where: Place) -> None:
        """Add an admitted sample in the order of instants; the oldest ones are forgotten."""
        known_ns, known = self._at_ns, self._where
        if not known_ns or at_ns > known_ns[-1]:
            known_ns.append(at_ns)
            known.append(where)
        else:
            i = bisect_left(known_ns, at_ns)
            if known_ns[i] == at_ns:
                return
            known_ns.insert(i, at_ns)
            known.insert(i, where)
        if len(known_ns) > _N_KEPT:
            del known_ns[: -_N_KEPT // 2], known[: -_N_KEPT // 2]


def _is_faster(one_ns: int, one: Place, other_ns: int, other: Place, speed_m_s: float) -> bool:
    return dist(one, other) > _NOISE_M + speed_m_s * abs(other_ns - one_ns) / NS_PER_S
