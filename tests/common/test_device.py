import contextlib
import json
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import DecodeError

from tis.common.device import (
    MAX_PER_TICK,
    DeviceGate,
    DevicePose,
    DeviceSample,
    decode_pose_stamped,
    from_json,
    from_ros2,
)
from tis.common.messages import decode


def test_only_the_position_is_required() -> None:
    pose = decode(b'{"position_m": {"x": 0.1, "y": 0, "z": -0.2}}', DevicePose)
    assert (pose.position_m.x, pose.position_m.y, pose.position_m.z) == (0.1, 0.0, -0.2)
    assert pose.orientation.w == 1.0
    assert (pose.stamp_ns, pose.gripper_rad, pose.clutch, pose.buttons) == (None, 0.0, False, ())


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        '{"position_m": {"x": NaN, "y": 0, "z": 0}}',
        '{"position_m": {"x": 1e10, "y": 0, "z": 0}}',
        '{"position_m": {"x": 0, "y": 0, "z": 0}, "gripper_rad": 57}',
        '{"position_m": {"x": 0, "y": 0, "z": 0}, "clutch": 1}',
        '{"position_m": {"x": 0, "y": 0, "z": 0}, "position_mm": {}}',
        '{"position_m": {"x": 0, "y": 0, "z": 0}, "stamp_ns": 9223372036854775807}',
        '{"position_m": {"x": 0, "y": 0, "z": 0}, "buttons": ' + str([True] * 33).lower() + "}",
    ],
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(DecodeError):
        decode(text.encode(), DevicePose)


def test_a_message_of_faulty_buttons_is_not_read_to_its_end() -> None:
    """128 of them between two samples would take longer than a period of 30 Hz."""
    with pytest.raises(DecodeError, match=r"at `\$\.buttons\[0\]`"):
        decode(b'{"buttons": [' + b"{}," * 600 + b"{}]}", DevicePose)


# sec 1, nanosec 2, frame "base", x y z = 1 2 3, quaternion 0 0 0 1; little endian, written by hand
BY_HAND = bytes.fromhex(
    "00010000"
    "01000000"
    "02000000"
    "05000000"
    "6261736500"
    "00000000000000"
    "000000000000f03f"
    "0000000000000040"
    "0000000000000840"
    "0000000000000000"
    "0000000000000000"
    "0000000000000000"
    "000000000000f03f"
)


def test_bytes_written_by_hand() -> None:
    assert decode_pose_stamped(BY_HAND) == (1_000_000_002, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))


def test_big_endian() -> None:
    body = struct.pack(">iII5s7x7d", 1, 2, 5, b"base\0", 1, 2, 3, 0, 0, 0, 1)
    assert decode_pose_stamped(b"\x00\x00\x00\x00" + body) == decode_pose_stamped(BY_HAND)


@given(st.text(alphabet=st.characters(codec="ascii", exclude_characters="\0"), max_size=20), st.floats(), st.floats())
def test_rosbags_writes_what_we_read(frame: str, x: float, w: float) -> None:
    stores = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    types = store.types
    pose = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](x, 0.25, -4.0), types["geometry_msgs/msg/Quaternion"](0.0, 0.5, 0.0, w)
    )
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](-7, 999_999_999), frame)
    message = types["geometry_msgs/msg/PoseStamped"](header, pose)
    payload = bytes(store.serialize_cdr(message, "geometry_msgs/msg/PoseStamped"))
    found = decode_pose_stamped(payload)
    assert found.stamp_ns == -6_000_000_001
    assert struct.pack("<7d", *found.position_m, *found.orientation) == struct.pack(
        "<7d", x, 0.25, -4.0, 0.0, 0.5, 0.0, w
    )


@given(st.integers(0, len(BY_HAND) - 1))
def test_a_message_that_is_cut_off_is_refused(n_bytes: int) -> None:
    with pytest.raises(ValueError, match="PoseStamped"):
        decode_pose_stamped(BY_HAND[:n_bytes])


@given(st.binary(max_size=200))
def test_any_bytes_are_decoded_or_refused(payload: bytes) -> None:
    with contextlib.suppress(ValueError):
        assert len(decode_pose_stamped(payload).orientation) == 4


def test_other_encapsulations_are_refused() -> None:
    with pytest.raises(ValueError, match="0x0003 is no plain CDR"):
        decode_pose_stamped(b"\x00\x03" + BY_HAND[2:])


def test_a_frame_longer_than_the_message_is_refused() -> None:
    long = BY_HAND[:12] + b"\xff\xff\xff\xff" + BY_HAND[16:]
    with pytest.raises(ValueError, match="PoseStamped"):
        decode_pose_stamped(long)


MS = 1_000_000


def payload(x: float = 0.0, **more: Any) -> bytes:
    return json.dumps({"position_m": {"x": x, "y": 0, "z": 0}} | more).encode()


def a_gate(silent_ms: int = 500) -> DeviceGate:
    return DeviceGate(from_json, silent_ms * MS)


def xs(samples: list[DeviceSample]) -> list[float]:
    return [sample.position_m[0] for sample in samples]


def test_poses_come_in_the_order_of_arrival_with_their_instants() -> None:
    gate = a_gate()
    gate.take(5, payload(0.1))
    gate.take(7, payload(0.2, clutch=True, gripper_rad=0.5))
    first, second = gate.drain()
    assert (first.recv_ns, first.position_m, first.clutch) == (5, (0.1, 0.0, 0.0), False)
    assert (second.recv_ns, second.gripper_rad, second.clutch) == (7, 0.5, True)
    assert gate.drain() == []
    assert gate.n_poses == 2


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "undecodable"),
        (b"\xff\xfe", "undecodable"),
        (b"[" * 2000, "undecodable"),
        (b'{"position_m": {"x": NaN, "y": 0, "z": 0}}', "not_finite"),
        (b'{"position_m": {"x": 1e999, "y": 0, "z": 0}}', "not_finite"),
        (payload(orientation={"x": 0, "y": 0, "z": 0, "w": 0}), "no_rotation"),
        (payload(1e10), "undecodable"),
        (payload(nonsense=1), "undecodable"),
        (payload(text="x" * 3000), "undecodable"),
    ],
)
def test_what_is_no_pose_is_counted_by_its_reason(content: bytes, reason: str) -> None:
    gate = a_gate()
    gate.take(1, content)
    gate.take(2, payload(0.3))
    assert xs(gate.drain()) == [0.3]
    assert dict(gate.refusals) == {reason: 1}


def test_quaternions_of_other_lengths_are_normalised() -> None:
    gate = a_gate()
    gate.take(1, payload(orientation={"x": 0, "y": 0, "z": 3, "w": 4}))
    assert gate.drain()[0].orientation == (0.0, 0.0, 0.6, 0.8)


def test_a_clock_that_stands_or_goes_back_is_refused() -> None:
    gate = a_gate()
    for x, stamp_ns in ((1, 100), (2, 100), (3, 90), (4, 101)):
        gate.take(stamp_ns, payload(x, stamp_ns=stamp_ns))
    assert xs(gate.drain()) == [1, 4]
    assert gate.refusals["backwards"] == 2


def test_one_stamp_of_the_far_future_silences_a_device_for_the_silence_only() -> None:
    gate = a_gate(silent_ms=500)
    gate.take(0, payload(1, stamp_ns=1 << 62))
    gate.take(500 * MS, payload(2, stamp_ns=5))
    gate.take(501 * MS, payload(3, stamp_ns=6))
    gate.take(502 * MS, payload(4, stamp_ns=7))
    assert xs(gate.drain()) == [1, 3, 4]


def test_of_a_flood_the_newest_count_and_the_rest_is_counted() -> None:
    gate = a_gate()
    for i in range(100_000):
        gate.take(i, payload(i / 1000))
    found = gate.drain()
    assert len(found) == MAX_PER_TICK == 128
    assert found[-1].position_m[0] == 99.999
    assert gate.refusals["flooded"] == 100_000 - 128


@given(st.lists(st.binary(max_size=80)))
def test_every_message_is_used_or_counted_once(contents: list[bytes]) -> None:
    for reading in (from_json, from_ros2):
        gate = DeviceGate(reading, 500 * MS)
        for i, content in enumerate(contents):
            gate.take(i, content)
        gate.drain()
        assert gate.n_poses + sum(gate.refusals.values()) == len(contents)


def test_a_pose_of_ros_2() -> None:
    gate = DeviceGate(from_ros2, 500 * MS)
    gate.take(3, BY_HAND)
    assert gate.drain() == [DeviceSample(3, 1_000_000_002, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 0.0, clutch=False)]
    not_finite = BY_HAND[:36] + bytes.fromhex("000000000000f87f") + BY_HAND[44:]
    no_rotation = BY_HAND[:-8] + bytes(8)
    for content in (not_finite, no_rotation, payload(1.0)):
        gate.take(4, content)
    assert gate.drain() == []
    assert dict(gate.refusals) == {"not_finite": 1, "no_rotation": 1, "undecodable": 1}
