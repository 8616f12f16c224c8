"""The mapping of a device's poses to master and commanded arm: rotation, scale, places, clutch, and jumps.

``master = a + R d`` and ``arm = b + scale R d`` for the device's position d. The anchors a and b change only where
the arm must not follow: while the clutch is pressed b does, at a jump both do.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, dist, radians, sin, sqrt
from typing import Final

from tis.common.channels import Hand
from tis.common.devices.gate import DeviceSample
from tis.common.scenario.live_source import LiveSource
from tis.common.units import MM_PER_M, NS_PER_S
from tis.surgeon_side.motion import HandPoses, Placed

Vector = tuple[float, float, float]
Turn = tuple[float, float, float, float]

_UNTURNED: Final[Turn] = (0.0, 0.0, 0.0, 1.0)
_ORIGIN: Final[Vector] = (0.0, 0.0, 0.0)
_MAX_M: Final = 1e6
"""Distance beyond which no hand moves: far beyond any room, and far below what a message can hold (`MAX_SIZE`)."""


def quaternion_of(rotation_deg: Vector) -> Turn:
    """Return axis times angle, in degrees, as a unit quaternion x y z w (oracle: scipy's rotations)."""
    x, y, z = (radians(each) for each in rotation_deg)
    angle = sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return _UNTURNED
    share = sin(angle / 2.0) / angle
    return share * x, share * y, share * z, cos(angle / 2.0)


def product(one: Turn, other: Turn) -> Turn:
    """Return the rotation by ``other``, then by ``one`` (Hamilton's product; oracle: scipy's rotations)."""
    x, y, z, w = one
    a, b, c, d = other
    return (
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    )


def turned(by: Turn, vector: Vector) -> Vector:
    """Return a vector turned by a unit quaternion (oracle: scipy's rotations)."""
    x, y, z, w = by
    inverse = (-x, -y, -z, w)
    a, b, c, _ = product(product(by, (*vector, 0.0)), inverse)
    return a, b, c


@dataclass
class Mapping:
    """Follows the device of one hand. `move` takes the poses of one tick; `poses` tells where master and arm are.

    Oracle: the formula evaluated at once over random movements, tests/surgeon_side/live/test_mapping.
    """

    source: LiveSource
    hand: Hand
    n_jumps: int = 0
    _last: Vector | None = None  # the device's position, turned into the master's axes
    _moved_ns: int = 0
    _was_clutched: bool = False
    _master_anchor: Vector = field(init=False, repr=False)
    _arm_anchor: Vector = field(init=False, repr=False)
    _wrist: tuple[Turn, float] = (_UNTURNED, 0.0)
    _arm_wrist: tuple[Turn, float] = (_UNTURNED, 0.0)

    def __post_init__(self) -> None:
        self._turn = quaternion_of(self.source.rotation_deg)
        self._master_anchor = self.source.master_at_mm.of_m(self.hand)
        self._arm_anchor = self.source.arm_at_mm.of_m(self.hand)

    @property
    def has_begun(self) -> bool:
        """Tell whether the device has sent a pose."""
        return self._last is not None

    def move(self, samples: Sequence[DeviceSample], t_ns: int, period_ns: int) -> None:
        """Follow the poses that came up to the tick at ``t_ns``, in their order; there is at least one.

        A movement faster than the limit, over the time since the last poses and one period, is a jump, and one that
        would lead beyond `_MAX_M` is, too: master and arm stay where they are, and go on from the device's new place.
        """
        scale = self.source.scale
        begun_at, master_anchor, arm_anchor = self._last, self._master_anchor, self._arm_anchor
        for sample in samples:
            here = turned(self._turn, sample.position_m)
            if self._last is None and self.source.origin == "first":
                self._master_anchor = _minus(self._master_anchor, here)
                self._arm_anchor = _minus(self._arm_anchor, _times(scale, here))
            elif self._last is not None and (sample.clutch or self._was_clutched):
                self._arm_anchor = _minus(self._arm_anchor, _times(scale, _minus(here, self._last)))
            self._last, self._was_clutched = here, sample.clutch
            self._wrist = (product(self._turn, sample.orientation), sample.gripper_rad)
            if not sample.clutch:
                self._arm_wrist = self._wrist
        allowed_m = self.source.max_speed_mm_s / MM_PER_M * (t_ns - self._moved_ns + period_ns) / NS_PER_S
        here = self._last or _ORIGIN
        if (begun_at is not None and dist(begun_at, here) > allowed_m) or self._is_too_far():
            self.n_jumps += 1
            moved = _minus(here, begun_at or _ORIGIN)
            self._master_anchor = _minus(master_anchor, moved)
            self._arm_anchor = _minus(arm_anchor, _times(scale, moved))
        self._moved_ns = t_ns

    def poses(self) -> HandPoses:
        """Return master and commanded arm; both rest in their places until the device's first pose."""
        moved = self._last or _ORIGIN
        return HandPoses(
            Placed(_plus(self._master_anchor, moved), *self._wrist),
            Placed(_plus(self._arm_anchor, _times(self.source.scale, moved)), *self._arm_wrist),
        )

    def _is_too_far(self) -> bool:
        return any(dist(placed.position_m, _ORIGIN) > _MAX_M for placed in self.poses())


def _plus(one: Vector, other: Vector) -> Vector:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def _minus(one: Vector, other: Vector) -> Vector:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


def _times(factor: float, vector: Vector) -> Vector:
    return factor * vector[0], factor * vector[1], factor * vector[2]
