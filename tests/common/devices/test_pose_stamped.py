import contextlib
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.device import decode_pose_stamped

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
