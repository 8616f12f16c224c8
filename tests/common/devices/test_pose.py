import pytest
from pydantic import ValidationError

from tis.common.device import DevicePose


def test_only_the_position_is_required() -> None:
    pose = DevicePose.model_validate_json('{"position_m": {"x": 0.1, "y": 0, "z": -0.2}}')
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
    with pytest.raises(ValidationError):
        DevicePose.model_validate_json(text)


def test_a_message_of_faulty_buttons_is_not_read_to_its_end() -> None:
    """128 of them between two samples would take longer than a period of 30 Hz."""
    with pytest.raises(ValidationError) as caught:
        DevicePose.model_validate_json(b'{"buttons": [' + b"{}," * 600 + b"{}]}")
    assert caught.value.error_count() == 2  # and there is no position
