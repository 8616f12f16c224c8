import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import DecodeError
from msgspec.structs import asdict, replace

from tis.common.messages import (
    MAX_SIZE,
    FeedbackPose,
    Pose,
    Quaternion,
    SampledPose,
    Vector3,
    decode,
    encode,
    position_m,
)

finite = st.floats(-MAX_SIZE, MAX_SIZE)
vectors = st.builds(Vector3, x=finite, y=finite, z=finite)
quaternions = st.builds(Quaternion, x=finite, y=finite, z=finite, w=finite)
feedback = st.builds(
    FeedbackPose,
    sample_ns=st.integers(0, 2**62),
    position_m=vectors,
    orientation=quaternions,
    gripper_rad=finite,
    tick=st.integers(0, 2**40),
    command_sample_ns=st.none() | st.integers(-(2**62), 2**62),
)
POSE = Pose(
    sample_ns=7, position_m=Vector3(x=0.1, y=-0.2, z=0.3), orientation=Quaternion(x=0, y=0, z=0, w=1), gripper_rad=0.5
)


@settings(deadline=None, max_examples=50)
@given(feedback)
def test_every_bit_survives_the_wire(message: FeedbackPose) -> None:
    assert decode(encode(message), FeedbackPose) == message


def test_what_flies_is_plain_json_in_si_units() -> None:
    assert json.loads(encode(POSE)) == {
        "sample_ns": 7,
        "position_m": {"x": 0.1, "y": -0.2, "z": 0.3},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        "gripper_rad": 0.5,
    }


@pytest.mark.parametrize("bad", ["NaN", "Infinity", "null", '"a"', "1e999"])
def test_numbers_that_are_none_are_refused(bad: str) -> None:
    with pytest.raises(DecodeError):
        decode(f'{{"x": {bad}, "y": 0, "z": 0}}'.encode(), Vector3)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"x": 1, "y": 2}', '{"x": 1, "y": 2, "z": 3, "w": 4}'])
def test_damaged_or_foreign_payloads_are_refused(text: str) -> None:
    with pytest.raises(DecodeError):
        decode(text.encode(), Vector3)


def test_a_pose_is_not_a_feedback_pose() -> None:
    with pytest.raises(DecodeError):
        decode(encode(POSE), FeedbackPose)


def test_messages_do_not_change() -> None:
    with pytest.raises(AttributeError, match="immutable"):
        POSE.gripper_rad = 1.0  # type: ignore[misc]


def test_position_as_a_tuple() -> None:
    assert position_m(POSE) == (0.1, -0.2, 0.3)


def _before(sample_ns: int) -> Pose:
    return replace(POSE, sample_ns=sample_ns)


def test_a_sampled_pose_without_history_flies_as_a_pose_and_an_old_payload_is_one() -> None:
    plain = decode(encode(POSE), SampledPose)
    assert plain.history == ()
    assert encode(plain) == encode(POSE)


def test_history_survives_the_wire() -> None:
    message = SampledPose(**asdict(POSE), history=(_before(0), _before(6)))
    assert decode(encode(message), SampledPose) == message


@pytest.mark.parametrize("instants", [(-1,), (7,), (8,), (3, 3), (4, 2)])
def test_a_history_that_is_not_of_the_past_in_order_is_refused(instants: tuple[int, ...]) -> None:
    text = encode(POSE)[:-1] + b',"history":[' + b",".join(encode(_before(one)) for one in instants) + b"]}"
    with pytest.raises(DecodeError, match="history must be ordered"):
        decode(text, SampledPose)
