"""The gate of a device: what it sends, decoded and checked in the order of arrival; the rest is counted by reason.

A device is a foreign program. Whatever it sends costs bounded work and memory, and none of it is an exception.
"""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite, sqrt
from typing import Final, NamedTuple

from pydantic import ValidationError

from tis.common.devices.pose import MAX_DEVICE_BYTES, DevicePose
from tis.common.devices.pose_stamped import decode_pose_stamped
from tis.common.devices.records import Refusal
from tis.common.messages import MAX_SIZE

MAX_PER_TICK: Final = 128
"""Messages of one device that a tick decodes: the newest. A device at 1 kHz sends 34 between ticks of 30 Hz."""

_LEAST_NORM: Final = 1e-6


class DeviceSample(NamedTuple):
    """A checked pose of a device: position in m, unit quaternion x y z w, gripper in rad, and its arrival in ns."""

    recv_ns: int
    stamp_ns: int | None
    position_m: tuple[float, float, float]
    orientation: tuple[float, float, float, float]
    gripper_rad: float
    clutch: bool


class Refused(Exception):  # noqa: N818  (it never leaves this module)
    """A message that is not used."""

    def __init__(self, reason: Refusal) -> None:
        super().__init__(reason)
        self.reason: Refusal = reason


@dataclass
class DeviceGate:
    """Keeps the newest messages of a device until the next tick, which takes the poses among them.

    Poses whose stamps do not increase are refused, until the device was silent for ``silent_ns``: then another
    program, or another clock, begins anew.
    """

    decode: Callable[[bytes], DeviceSample]
    silent_ns: int
    refusals: Counter[Refusal] = field(default_factory=Counter)
    n_poses: int = 0
    _waiting: deque[tuple[int, bytes]] = field(default_factory=deque, repr=False)
    _last: DeviceSample | None = None

    def take(self, recv_ns: int, payload: bytes) -> None:
        """Keep a message for the next tick; of more than `MAX_PER_TICK` the oldest is dropped and counted."""
        if len(payload) > MAX_DEVICE_BYTES:
            self.refusals["undecodable"] += 1
            return
        if len(self._waiting) == MAX_PER_TICK:
            self._waiting.popleft()
            self.refusals["flooded"] += 1
        self._waiting.append((recv_ns, payload))

    def drain(self) -> list[DeviceSample]:
        """Return the poses since the last call, in the order of arrival."""
        found = []
        while self._waiting:
            recv_ns, payload = self._waiting.popleft()
            try:
                pose = self._in_order(self.decode(payload)._replace(recv_ns=recv_ns))
            except Refused as error:
                self.refusals[error.reason] += 1
                continue
            self._last = pose
            self.n_poses += 1
            found.append(pose)
        return found

    def _in_order(self, pose: DeviceSample) -> DeviceSample:
        last = self._last
        if last is None or pose.stamp_ns is None or last.stamp_ns is None or pose.stamp_ns > last.stamp_ns:
            return pose
        if pose.recv_ns - last.recv_ns > self.silent_ns:
            return pose
        raise Refused("backwards")


def from_json(payload: bytes) -> DeviceSample:
    """Return the pose in a `DevicePose`; raises `Refused`. Oracle: literal payloads in the tests."""
    try:
        pose = DevicePose.model_validate_json(payload)
    except ValidationError as error:
        is_number = all(fault["type"] == "finite_number" for fault in error.errors(include_input=False))
        raise Refused("not_finite" if is_number else "undecodable") from None
    p, q = pose.position_m, pose.orientation
    return DeviceSample(0, pose.stamp_ns, (p.x, p.y, p.z), _unit((q.x, q.y, q.z, q.w)), pose.gripper_rad, pose.clutch)


def from_ros2(payload: bytes) -> DeviceSample:
    """Return the pose in a PoseStamped, which has no gripper and no clutch; raises `Refused`."""
    try:
        stamp_ns, position_m, orientation = decode_pose_stamped(payload)
    except ValueError:
        raise Refused("undecodable") from None
    if not all(isfinite(value) and abs(value) <= MAX_SIZE for value in (*position_m, *orientation)):
        raise Refused("not_finite")
    return DeviceSample(0, stamp_ns, position_m, _unit(orientation), 0.0, clutch=False)


def _unit(quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return a quaternion at length 1; raises `Refused` where it has none."""
    x, y, z, w = quaternion
    norm = sqrt(x * x + y * y + z * z + w * w)
    if norm < _LEAST_NORM:
        raise Refused("no_rotation")
    return x / norm, y / norm, z / norm, w / norm
