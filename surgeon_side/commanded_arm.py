"""Forward model at the surgeon: where the arm is to be at any instant, by the commands sent until then."""

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from tis.common.servo import servo_transition
from tis.common.units import NS_PER_S, sample_instant_ns

Place = tuple[float, float, float]

MEMORY_S: Final = 60
"""Time for which commands are remembered: the longest outage over which the display predicts."""

_MAX_REMEMBERED: Final = 20_000  # 20 s at 1 kHz
_STILL: Final = (0.0, 0.0, 0.0)


class Servo(NamedTuple):
    """Natural frequency in Hz and damping ratio of the arm's servo."""

    bandwidth_hz: float
    damping: float

    def after(self, motion: "Motion", for_s: float) -> tuple[Place, Place]:
        """Return position in m and velocity in m/s after ``for_s`` at a constant command."""
        return self.moved(motion, servo_transition(self.bandwidth_hz, self.damping, for_s).tolist())

    def moved(self, motion: "Motion", transition: list[list[float]]) -> tuple[Place, Place]:
        """Return position and velocity after a `servo_transition` (2, 2)."""
        (stay, drift), (pull, keep) = transition
        axes = [
            (command + stay * (x - command) + drift * v, pull * (x - command) + keep * v)
            for command, x, v in zip(*motion, strict=True)
        ]
        (x, vx), (y, vy), (z, vz) = axes
        return (x, y, z), (vx, vy, vz)


class Motion(NamedTuple):
    """Command in force from a sample instant on; the arm's position in m and velocity in m/s at that instant."""

    command_m: Place
    position_m: Place
    velocity_m_s: Place


@dataclass
class CommandedArm:
    """An arm that follows its commands without delay: exactly (no servo), or as a second-order servo.

    Commands come at the sample instants of ``rate_hz``, in ascending order. Between two instants an arm without a
    servo moves linearly; a servo, at rest at first, follows the earlier command. Oracles: numpy's interpolation, and
    the differential equation solved numerically (tests/surgeon_side/test_commanded_arm).
    """

    rate_hz: int
    servo: Servo | None = None
    last: int = -1
    _ring: list[Motion | None] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._transition = [] if self.servo is None else servo_transition(*self.servo, 1.0 / self.rate_hz).tolist()
        self._ring = [None] * max(2, min(MEMORY_S * self.rate_hz, _MAX_REMEMBERED))

    def command(self, index: int, command_m: Place) -> None:
        """Take the command of sample ``index``; the command before it held for the samples that were missed."""
        before = self._known(self.last)
        if before is None:
            before = Motion(command_m, command_m, _STILL)
        else:
            for missed in range(max(self.last + 1, index - len(self._ring)), index):
                before = self._moved(before, before.command_m)
                self._ring[missed % len(self._ring)] = before
            before = self._moved(before, command_m)
        self.last = index
        self._ring[index % len(self._ring)] = before

    def at(self, instant_ns: int) -> Place | None:
        """Return the arm's position at an instant, at the latest that of the newest command; None if forgotten."""
        index = ((instant_ns + 1) * self.rate_hz - 1) // NS_PER_S  # newest sample at or before the instant
        here, there = self._known(min(index, self.last)), self._known(index + 1)
        if here is None or index >= self.last:
            return None if here is None else here.position_m
        begun_ns = sample_instant_ns(index, self.rate_hz)
        if self.servo is not None:
            return self.servo.after(here, (instant_ns - begun_ns) / NS_PER_S)[0]
        assert there is not None, "commands are remembered without a gap"
        share = (instant_ns - begun_ns) / (sample_instant_ns(index + 1, self.rate_hz) - begun_ns)
        (x, y, z), (to_x, to_y, to_z) = here.position_m, there.position_m
        return x + share * (to_x - x), y + share * (to_y - y), z + share * (to_z - z)

    def _known(self, index: int) -> Motion | None:
        is_kept = max(0, self.last - len(self._ring) + 1) <= index <= self.last
        return self._ring[index % len(self._ring)] if is_kept else None

    def _moved(self, before: Motion, command_m: Place) -> Motion:
        """Return the motion a period after ``before``, at a new command."""
        if self.servo is None:
            return Motion(command_m, command_m, _STILL)
        return Motion(command_m, *self.servo.moved(before, self._transition))
