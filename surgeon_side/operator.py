"""The simulated operator: a hand that holds a device where it intends to be, and yields to the force it feels."""

from dataclasses import dataclass, field
from math import pi, sqrt

from tis.common.coupling.stability import Limb
from tis.common.servo import servo_transition
from tis.common.vector import ZERO, Vector, plus, scaled


@dataclass
class Operator:
    """``M d'' + B d' + K d = F``: how far the hand is off what it intends, under a force that is held for a tick.

    M, B and K are those of hand and device together. Without a force the hand is where it intends to be, bit for bit.
    The transition over a tick is exact. Oracle: the differential equation solved numerically, test_operator.
    """

    limb: Limb
    period_s: float
    off_m: Vector = ZERO
    speed_m_s: Vector = ZERO
    _transition: list[list[float]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        mass, damping, stiffness = self.limb
        natural = sqrt(stiffness / mass)
        move = servo_transition(natural / (2.0 * pi), damping / (2.0 * mass * natural), self.period_s)
        self._transition = move.tolist()

    def move(self, force_n: Vector) -> None:
        """Go on for one tick under a force on the hand, in N."""
        if self.off_m == self.speed_m_s == force_n == ZERO:
            return
        (stay, drift), (pull, keep) = self._transition
        rest = scaled(force_n, 1.0 / self.limb.stiffness_n_m)
        error = plus(self.off_m, scaled(rest, -1.0))
        self.off_m, self.speed_m_s = (
            plus(rest, plus(scaled(error, stay), scaled(self.speed_m_s, drift))),
            plus(scaled(error, pull), scaled(self.speed_m_s, keep)),
        )
