"""Decoding of geometry_msgs/PoseStamped from CDR, as ROS 2 middleware puts it on the wire.

Common Data Representation, OMG DDS-XTypes 1.3, section 7.4: an encapsulation header of four bytes, whose second one
tells the order of bytes, then the fields, each aligned to its own size counted from the end of that header.
"""

import struct
from typing import Final, NamedTuple

_HEADER_BYTES: Final = 4
_ORDER: Final = {0x0000: ">", 0x0001: "<"}  # CDR_BE and CDR_LE: plain CDR, version 1
_POSE_ALIGNMENT: Final = 8
_NS_PER_S: Final = 1_000_000_000


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
    Oracle: bytes written by hand, and the rosbags package, tests/common/devices/test_pose_stamped.
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
    return StampedPose(sec * _NS_PER_S + nanosec, (x, y, z), (qx, qy, qz, qw))
