"""Poses that programs of others send: the message of a device, PoseStamped of ROS 2, and the gate that checks both.

A device is a foreign program. Whatever it sends costs bounded work and memory, and none of it is an exception.

PoseStamped comes in the Common Data Representation, OMG DDS-XTypes 1.3, section 7.4: an encapsulation header of four
bytes, whose second one tells the order of bytes, then the fields, each aligned to its own size counted from the end
of that header.
"""

import struct
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite, sqrt
from typing import Annotated, Final, Literal, NamedTuple

from msgspec import DecodeError, Meta

from tis.common.messages import MAX_SIZE, Instant, Message, Quaternion, Vector3, decode
from tis.common.units import NS_PER_S

MAX_DEVICE_BYTES: Final = 2048
"""Largest payload of a device; a pose has some 300 bytes."""

MAX_BUTTONS: Final = 32

Refusal = Literal["undecodable", "not_finite", "no_rotation", "backwards", "flooded", "jump"]
"""Reason why a message of a device is not used."""

Angle = Annotated[float, Meta(ge=-6.3, le=6.3)]
"""An angle in rad, at most a turn."""


Newtons = Annotated[float, Meta(ge=-10_000, le=10_000)]


class ToolForce(Message, frozen=True):
    """The force on the tool of an arm of another program, on the axes of its positions."""

    x: Annotated[Newtons, Meta(description="Component along x, in N.")]
    y: Annotated[Newtons, Meta(description="Component along y, in N.")]
    z: Annotated[Newtons, Meta(description="Component along z, in N.")]


class TargetRun(Message, frozen=True, kw_only=True):
    """How the arm was brought to the targets of the live page, from the first to the last."""

    delay_ms: Annotated[float, Meta(ge=0, le=1e6, description="Delay there and back that it was played with, in ms.")]
    with_ghost: Annotated[bool, Meta(description="true: the ghost was shown beside the late picture.")]
    time_s: Annotated[float, Meta(ge=0, le=1e6, description="Time from the first target to the last, in s.")]
    path_mm: Annotated[float, Meta(ge=0, le=1e9, description="Path of the arm in that time, in mm.")]
    n_misses: Annotated[int, Meta(ge=0, le=10**6, description="How often the arm left a target too soon.")]


class DevicePose(Message, frozen=True, kw_only=True):
    """One pose of an operator's device, in the device's own frame; only the position is required."""

    stamp_ns: Annotated[
        Instant | None,
        Meta(description="The device's own clock, in ns from any origin; null: none. Only its order is checked."),
    ] = None
    position_m: Annotated[Vector3, Meta(description="Position of the device's handle, in m.")]
    orientation: Annotated[
        Quaternion, Meta(description="Orientation of the handle, a quaternion of any length but 0.")
    ] = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    gripper_rad: Annotated[Angle, Meta(description="Opening angle of the gripper, in rad.")] = 0.0
    clutch: Annotated[
        bool, Meta(description="true: the operator moves the device to another place, the arm holds.")
    ] = False
    buttons: Annotated[
        tuple[bool, ...],
        Meta(max_length=MAX_BUTTONS, description="Further buttons of the device; the testbed uses none."),
    ] = ()
    force_n: Annotated[
        ToolForce | None,
        Meta(description="Of an arm: force on its tool at this pose, CRTK's measured_cf, in N; null: not measured."),
    ] = None
    target_run: Annotated[
        TargetRun | None, Meta(description="Of the live page: a run at its targets that has just ended, for the log.")
    ] = None


_HEADER_BYTES: Final = 4
_ORDER: Final = {0x0000: ">", 0x0001: "<"}  # CDR_BE and CDR_LE: plain CDR, version 1
_POSE_ALIGNMENT: Final = 8


class StampedPose(NamedTuple):
    """A decoded message: its stamp in ns, position (x, y, z) in m, and quaternion (x, y, z, w)."""

    stamp_ns: int
    position_m: tuple[float, float, float]
    orientation: tuple[float, float, float, float]


def decode_pose_stamped(payload: bytes) -> StampedPose:
    """Return the pose in a payload; numbers may be anything that a double can be.

    Raises
    ------
    ValueError
        If the payload is no PoseStamped in plain CDR.

    Notes
    -----
    Oracle: bytes written by hand, and the rosbags package, tests/common/test_device.
    """
    try:
        (representation,) = struct.unpack_from(">H", payload)
        order = _ORDER.get(representation)
        if order is None:
            raise ValueError(f"the encapsulation {representation:#06x} is no plain CDR")
        body = payload[_HEADER_BYTES:]
        sec, nanosec, n_chars = struct.unpack_from(f"{order}iII", body)
        # the frame's name, which ends with a NUL that counts; then padding up to the first double
        end = 12 + n_chars
        begin = -(-end // _POSE_ALIGNMENT) * _POSE_ALIGNMENT
        x, y, z, qx, qy, qz, qw = struct.unpack_from(f"{order}7d", body, begin)
    except struct.error as error:
        raise ValueError(f"it is no PoseStamped: {error}") from None
    return StampedPose(sec * NS_PER_S + nanosec, (x, y, z), (qx, qy, qz, qw))


MAX_PER_TICK: Final = 128
"""Messages of one device that a tick decodes: the newest. A device at 1 kHz sends 34 between ticks of 30 Hz."""

_LEAST_NORM: Final = 1e-6


class DeviceSample(NamedTuple):
    """A checked pose of a device: position in m, unit quaternion x y z w, gripper in rad, and its arrival in ns.

    ``force_n`` is the force on an arm's tool in N; None: not measured.
    """

    recv_ns: int
    stamp_ns: int | None
    position_m: tuple[float, float, float]
    orientation: tuple[float, float, float, float]
    gripper_rad: float
    clutch: bool
    force_n: tuple[float, float, float] | None = None
    target_run: TargetRun | None = None


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
        pose = decode(payload, DevicePose)
    except DecodeError as error:
        # JSON has no such numbers, but most programs write them.
        is_number = b"NaN" in payload or b"Infinity" in payload or "out of range" in str(error)
        raise Refused("not_finite" if is_number else "undecodable") from None
    p, q, f = pose.position_m, pose.orientation, pose.force_n
    turn = _unit((q.x, q.y, q.z, q.w))
    force_n = None if f is None else (f.x, f.y, f.z)
    return DeviceSample(
        0, pose.stamp_ns, (p.x, p.y, p.z), turn, pose.gripper_rad, pose.clutch, force_n, pose.target_run
    )


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
