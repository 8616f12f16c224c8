"""The movement of live devices: their poses checked, mapped to master and commanded arm, and sampled.

At sample k the newest poses count that arrived at or before its instant. With the device's position d the mapping is
``master = a + R d`` and ``arm = b + scale R d``. The anchors a and b change only where the arm must not follow: while
the clutch is pressed b does, at a jump both do.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, dist, radians, sin, sqrt
from typing import Final, get_args

from msgspec.structs import asdict

from tis.common.channels import FOLLOWER, Hand, HandChannels, hand_channels
from tis.common.device import DeviceGate, DeviceSample, Refusal, from_json, from_ros2
from tis.common.device_records import DEVICES, TARGET_RUNS, DeviceEvent, DeviceNote, TargetRunNote
from tis.common.node import Arrival, Record
from tis.common.scenario.live_source import LiveSource
from tis.common.units import MM_PER_M, NS_PER_S, ms_to_ns
from tis.common.vector import ZERO, Vector, minus, plus, scaled
from tis.common.zenoh_syntax import key_matches
from tis.surgeon_side.motion import HandPoses, Placed

Turn = tuple[float, float, float, float]

_UNTURNED: Final[Turn] = (0.0, 0.0, 0.0, 1.0)
_MAX_TARGET_RUNS: Final = 1000
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
class DeviceMapping:
    """Follows the device of one hand. `move` takes the poses of one tick; `poses` tells where master and arm are.

    Oracle: the formula evaluated at once over random movements, tests/surgeon_side/test_live.
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
                self._master_anchor = minus(self._master_anchor, here)
                self._arm_anchor = minus(self._arm_anchor, scaled(here, scale))
            elif self._last is not None and (sample.clutch or self._was_clutched):
                self._arm_anchor = minus(self._arm_anchor, scaled(minus(here, self._last), scale))
            self._last, self._was_clutched = here, sample.clutch
            self._wrist = (product(self._turn, sample.orientation), sample.gripper_rad)
            if not sample.clutch:
                self._arm_wrist = self._wrist
        allowed_m = self.source.max_speed_mm_s / MM_PER_M * (t_ns - self._moved_ns + period_ns) / NS_PER_S
        here = self._last or ZERO
        if (begun_at is not None and dist(begun_at, here) > allowed_m) or self._is_too_far():
            self.n_jumps += 1
            moved = minus(here, begun_at or ZERO)
            self._master_anchor = minus(master_anchor, moved)
            self._arm_anchor = minus(arm_anchor, scaled(moved, scale))
        self._moved_ns = t_ns

    def poses(self) -> HandPoses:
        """Return master and commanded arm; both rest in their places until the device's first pose."""
        moved = self._last or ZERO
        return HandPoses(
            Placed(plus(self._master_anchor, moved), *self._wrist),
            Placed(plus(self._arm_anchor, scaled(moved, self.source.scale)), *self._arm_wrist),
        )

    def _is_too_far(self) -> bool:
        return any(dist(placed.position_m, ZERO) > _MAX_M for placed in self.poses())


_DECODERS: Final = {"json": from_json, "ros2": from_ros2}


@dataclass
class _Device:
    """The device of one hand, and what was told about it."""

    hand: Hand
    key: str
    gate: DeviceGate
    mapping: DeviceMapping
    heard_ns: int = 0
    is_silent: bool = False
    n_silences: int = 0
    n_silent_ticks: int = 0
    n_target_runs: int = 0


class LiveMotion:
    """Follows one device for each hand; a device that is silent holds its last pose, and that is logged.

    Until its first pose a hand rests in its place. Truth is known with each sample, none ahead. Oracle: arrivals with
    literal instants, tests/surgeon_side/test_live.
    """

    def __init__(self, source: LiveSource, rate_hz: int) -> None:
        self._silent_ns = ms_to_ns(source.silent_after_ms)
        self._period_ns = NS_PER_S // rate_hz
        self.channels: Sequence[HandChannels] = [hand_channels(hand, FOLLOWER[hand]) for hand in source.hands]
        self._devices = [
            _Device(
                hand,
                source.keys.of(hand),
                DeviceGate(_DECODERS[source.encoding], self._silent_ns),
                DeviceMapping(source, hand),
            )
            for hand in source.hands
        ]
        self._told: set[tuple[Hand, Refusal]] = set()
        self._advanced = -1

    def listens(self) -> Sequence[str]:
        """Return the keys of the devices."""
        return [device.key for device in self._devices]

    def take(self, arrival: Arrival) -> None:
        """Keep a device's message for the next sample."""
        for device in self._devices:
            if key_matches(device.key, arrival.key):
                device.gate.take(arrival.recv_ns, arrival.payload)

    def advance(self, k: int, t_ns: int) -> Sequence[Record]:
        """Follow the poses that have arrived, and return notes about devices that began, fell silent or came back."""
        self._advanced = k
        return [note for device in self._devices for note in self._follow(device, t_ns)]

    def poses(self, k: int) -> Sequence[HandPoses]:  # noqa: ARG002  (the last one advanced to)
        """Return where masters and commanded arms are now."""
        return [device.mapping.poses() for device in self._devices]

    def truth(self, k: int, is_first: bool) -> Iterator[tuple[int, Sequence[HandPoses]]]:  # noqa: ARG002
        """Yield sample ``k``; nothing for a missed one, at which nobody knows where the device was."""
        if k == self._advanced:
            yield k, self.poses(k)

    def counters(self) -> Mapping[str, int]:
        """Return for each hand the numbers of used poses, of refused messages by reason, and of silences."""
        found: dict[str, int] = {}
        for device in self._devices:
            refused = {**device.gate.refusals, "jump": device.mapping.n_jumps}
            found[f"device_poses.{device.hand}"] = device.gate.n_poses
            found |= {f"device_{reason}.{device.hand}": refused.get(reason, 0) for reason in get_args(Refusal)}
            found[f"device_silences.{device.hand}"] = device.n_silences
            found[f"device_silent_ticks.{device.hand}"] = device.n_silent_ticks
        return found

    def _follow(self, device: _Device, t_ns: int) -> Iterator[Record]:
        samples = device.gate.drain()
        yield from _target_runs(device, samples)
        had_begun, n_jumps = device.mapping.has_begun, device.mapping.n_jumps
        if samples:
            device.mapping.move(samples, t_ns, self._period_ns)
            silent_for_ns = t_ns - device.heard_ns
            if not had_begun:
                yield _note(device, t_ns, "first", 0)
            elif device.is_silent:
                yield _note(device, t_ns, "back", silent_for_ns)
            device.heard_ns, device.is_silent = samples[-1].recv_ns, False
        elif t_ns - device.heard_ns > self._silent_ns:
            device.n_silent_ticks += 1
            if not device.is_silent:
                device.is_silent = True
                device.n_silences += 1
                yield _note(device, t_ns, "silent", t_ns - device.heard_ns)
        reasons = [*device.gate.refusals, *(["jump"] if device.mapping.n_jumps > n_jumps else [])]
        for reason in get_args(Refusal):
            if reason in reasons and (device.hand, reason) not in self._told:
                self._told.add((device.hand, reason))
                yield _note(device, t_ns, "refused", 0, reason)


def _target_runs(device: _Device, samples: Sequence[DeviceSample]) -> Iterator[Record]:
    for sample in samples:
        if sample.target_run is not None and device.n_target_runs < _MAX_TARGET_RUNS:
            device.n_target_runs += 1
            told = asdict(sample.target_run)
            yield Record(TARGET_RUNS, sample.recv_ns, TargetRunNote(at_ns=sample.recv_ns, hand=device.hand, **told))


def _note(device: _Device, t_ns: int, event: DeviceEvent, for_ns: int, reason: str = "") -> Record:
    note = DeviceNote(at_ns=t_ns, hand=device.hand, event=event, for_ns=for_ns, reason=reason)
    return Record(DEVICES, t_ns, note)
