"""Time-domain passivity control with two ports: each side takes out no more energy than the other has put in.

Each message carries the energy that its sender has put in so far. Where a tick would take out more than was received,
a damper acts at the hand, ``F += alpha v``, and the arm's set point yields, ``v -= beta F`` (Ryu, Artigas; Hannaford
and Ryu 2002). Invariant: received - taken out >= 0, but for what a held force does within one tick.
"""

from dataclasses import dataclass, field
from math import sqrt

from tis.common.vector import Vector, dot, minus, plus, scaled

_ROUNDING_J = 1e-9


@dataclass
class ReceivedEnergy:
    """What the other side has put into the coupling, by the totals in its messages, in J.

    The first total is where the account begins, and so is a smaller one, of a side that was started anew: neither
    adds energy. A total that grows faster than ``power_max_w`` is refused. Older messages change nothing.
    """

    power_max_w: float
    period_s: float
    credit_j: float = 0.0
    last_j: float | None = None
    last_ns: int = -1

    def take(self, total_j: float, sample_ns: int) -> bool:
        """Take a message's total at its sample instant; return whether it can be true."""
        if sample_ns <= self.last_ns:
            return True
        if self.last_j is not None and total_j > self.last_j:
            most_j = self.power_max_w * ((sample_ns - self.last_ns) * 1e-9 + self.period_s)
            if total_j - self.last_j > most_j + _ROUNDING_J:
                return False
            self.credit_j += total_j - self.last_j
        self.last_j, self.last_ns = total_j, sample_ns
        return True


@dataclass
class Port:
    """Energies of one port since its begin, in J: put into the coupling, and taken out of it."""

    in_j: float = 0.0
    out_j: float = 0.0

    def add(self, work_j: float) -> None:
        """Add the work of a tick, positive where it goes into the coupling."""
        if work_j >= 0.0:
            self.in_j += work_j
        else:
            self.out_j -= work_j


@dataclass
class PassiveHand:
    """The hand's port. ``damping_max_ns_m`` is at most mass over tick, or the damper would turn the hand round."""

    period_s: float
    damping_max_ns_m: float
    received: ReceivedEnergy
    port: Port = field(default_factory=Port)

    def force(self, force_n: Vector, velocity_m_s: Vector) -> Vector:
        """Return the force of the hand on the coupling, damped where the tick would take out too much."""
        excess_j = self.port.out_j - self.received.credit_j - self.period_s * dot(force_n, velocity_m_s)
        speed_2 = dot(velocity_m_s, velocity_m_s)
        if excess_j <= 0.0 or speed_2 == 0.0:
            return force_n
        alpha = min(excess_j / (self.period_s * speed_2), self.damping_max_ns_m)
        return plus(force_n, scaled(velocity_m_s, alpha))

    def moved(self, force_n: Vector, moved_m: Vector) -> float:
        """Note a tick with this force and movement; return the energy put in so far, for the next message."""
        self.port.add(dot(force_n, moved_m))
        return self.port.in_j

    def reset(self) -> None:
        """Give up what may still be taken out."""
        self.received.credit_j = min(self.received.credit_j, self.port.out_j)


@dataclass
class PassiveArm:
    """The arm's port: steps of the set point of a spring, whose work is known before the step is taken."""

    stiffness_n_m: float
    received: ReceivedEnergy
    port: Port = field(default_factory=Port)

    def step(self, step_m: Vector, stretch_m: Vector) -> Vector:
        """Return the step, shortened against the spring's force where its work exceeds what was received."""
        k, room_j = self.stiffness_n_m, self.received.credit_j - self.port.out_j
        force_n = scaled(plus(stretch_m, scaled(step_m, 0.5)), k)
        excess_j = dot(force_n, step_m) - room_j
        force_2 = dot(force_n, force_n)
        if excess_j <= 0.0 or force_2 == 0.0:
            return step_m
        # work of step - beta F is excess_j - p beta + q beta^2: the least beta at which it is 0, or its minimum
        p = k * dot(plus(stretch_m, step_m), force_n)
        q = 0.5 * k * force_2
        root = p * p - 4.0 * q * excess_j
        beta = 2.0 * excess_j / (p + sqrt(root)) if p > 0.0 and root >= 0.0 else max(p, 0.0) / (2.0 * q)
        return minus(step_m, scaled(force_n, beta))

    def moved(self, stretch_m: Vector, step_m: Vector) -> tuple[float, Vector]:
        """Return the energy put in so far and the spring's mean force (N), after the step that was really taken."""
        force_n = scaled(plus(stretch_m, scaled(step_m, 0.5)), self.stiffness_n_m)
        self.port.add(-dot(force_n, step_m))
        return self.port.in_j, force_n

    def reset(self) -> None:
        """Give up what may still be taken out."""
        self.received.credit_j = min(self.received.credit_j, self.port.out_j)
