"""Wave variables: force and velocity as two waves, whose energy no delay and no loss can increase.

``u = (b v + F) / sqrt(2 b)`` travels to the arm and ``w = (b v - F) / sqrt(2 b)`` back, with the impedance b, so that
``F v = (u^2 - w^2) / 2`` (Niemeyer and Slotine 1991). Each wave is used once, and a missing one is zero.

The hand's force is held for a tick, and its velocity over that tick is known only afterwards. The hand therefore
sends the wave of the velocity that it had, which keeps all of the movement; what the difference costs is counted, and
damped as a passivity controller does. The arm's spring takes a step of its set point with the mean force of the step.
"""

from collections import deque
from dataclasses import dataclass, field
from math import sqrt
from typing import Final

from tis.common.vector import ZERO, Vector, dot, minus, plus, scaled, size

_MOST_QUEUED: Final = 256
_SLACK_J: Final = 1e-5
"""Debt that the damping of the next tick repays; only beyond it a wave is made smaller, which loses movement."""


@dataclass
class WaveQueue:
    """The waves that have arrived and were not used, in their order of arrival; of too many the oldest go."""

    waves: deque[Vector] = field(default_factory=lambda: deque(maxlen=_MOST_QUEUED))
    n_missing: int = 0

    def put(self, wave: Vector) -> None:
        """Keep a wave for a tick to come."""
        self.waves.append(wave)

    def take(self) -> Vector:
        """Return the next wave, zero where there is none."""
        if self.waves:
            return self.waves.popleft()
        self.n_missing += 1
        return ZERO


@dataclass
class _Account:
    """Energy that a side's sampling has left over, in J; a wave is made smaller where it would owe too much."""

    period_s: float
    stored_j: float = 0.0

    def settle(self, incoming: Vector, outgoing: Vector, work_j: float, slack_j: float) -> Vector:
        """Return the wave that leaves, after ``work_j`` came in by force and movement, and ``incoming`` as a wave."""
        half_s = 0.5 * self.period_s
        before_j = self.stored_j + half_s * dot(incoming, incoming) + work_j
        leaves_j = half_s * dot(outgoing, outgoing)
        self.stored_j = before_j - leaves_j
        if self.stored_j >= -slack_j or leaves_j == 0.0:
            return outgoing
        kept_j = max(before_j + slack_j, 0.0)
        self.stored_j = before_j - kept_j
        return scaled(outgoing, sqrt(kept_j / leaves_j))


@dataclass
class WaveHand:
    """The hand's port: it turns waves into force. ``damping_max_ns_m`` bounds the passivity controller."""

    impedance_ns_m: float
    period_s: float
    damping_max_ns_m: float
    incoming: Vector = ZERO
    _account: _Account = field(init=False)

    def __post_init__(self) -> None:
        self._account = _Account(self.period_s)

    @property
    def stored_j(self) -> float:
        """Energy that the sampling has left over; below 0 it is owed."""
        return self._account.stored_j

    def force(self, velocity_m_s: Vector, incoming: Vector) -> Vector:
        """Return the force (N) of the hand on the coupling for the next tick, by the wave from the arm."""
        self.incoming = incoming
        b, owed_j, speed_2 = self.impedance_ns_m, -self.stored_j, dot(velocity_m_s, velocity_m_s)
        alpha = 0.0
        if owed_j > 0.0 and speed_2 > 0.0:
            alpha = min(owed_j / (self.period_s * speed_2), self.damping_max_ns_m)
        return minus(scaled(velocity_m_s, b + alpha), scaled(incoming, sqrt(2.0 * b)))

    def moved(self, force_n: Vector, moved_m: Vector) -> Vector:
        """Return the wave to the arm after a tick with this force of the hand, and its movement in m."""
        outgoing = minus(scaled(moved_m, sqrt(2.0 * self.impedance_ns_m) / self.period_s), self.incoming)
        return self._account.settle(self.incoming, outgoing, dot(force_n, moved_m), _SLACK_J)

    def reset(self) -> None:
        """Forget the energy that is left over; a debt stays."""
        self.incoming = ZERO
        self._account.stored_j = min(self.stored_j, 0.0)


@dataclass
class WaveArm:
    """The arm's port: it turns waves into steps of the set point of a spring of ``stiffness_n_m``."""

    impedance_ns_m: float
    period_s: float
    stiffness_n_m: float
    incoming: Vector = ZERO
    _account: _Account = field(init=False)

    def __post_init__(self) -> None:
        self._account = _Account(self.period_s)

    def step(self, incoming: Vector, stretch_m: Vector) -> Vector:
        """Return the step (m) of the set point, by the wave from the hand and how far the arm is behind."""
        self.incoming = incoming
        b, k, t = self.impedance_ns_m, self.stiffness_n_m, self.period_s
        pull = minus(scaled(incoming, sqrt(2.0 * b)), scaled(stretch_m, k))
        return scaled(pull, t / (b + 0.5 * k * t))

    def moved(self, stretch_m: Vector, step_m: Vector) -> tuple[Vector, Vector]:
        """Return the wave to the hand and the spring's mean force (N), after the step that was really taken."""
        force_n = scaled(plus(stretch_m, scaled(step_m, 0.5)), self.stiffness_n_m)
        outgoing = minus(self.incoming, scaled(force_n, sqrt(2.0 / self.impedance_ns_m)))
        return self._account.settle(self.incoming, outgoing, -dot(force_n, step_m), 0.0), force_n

    def reset(self) -> None:
        """Forget the energy that is left over."""
        self.incoming = ZERO
        self._account.stored_j = min(self._account.stored_j, 0.0)


def is_too_strong(wave: Vector, power_max_w: float) -> bool:
    """Tell whether a wave carries more than the power limit."""
    return 0.5 * size(wave) ** 2 > power_max_w
