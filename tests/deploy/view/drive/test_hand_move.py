import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.deploy.view.drive.hand_move import MAX_MESSAGE_CHARS, HandMove, read_move


def test_a_move_is_read() -> None:
    text = '{"moved_mm": [1.5, -2, 0], "gripper_rad": 1, "clutch": true}'
    assert read_move(text) == HandMove(moved_mm=[1.5, -2.0, 0.0], gripper_rad=1.0, clutch=True)


@pytest.mark.parametrize(
    ("text", "field", "got"),
    [
        ('{"moved_mm": [NaN, 0, 0]}', "moved_mm.0", "nan"),
        ('{"moved_mm": [0, Infinity, 0]}', "moved_mm.1", "inf"),
        ('{"moved_mm": [0, 0, 501]}', "moved_mm.2", "501"),
        ('{"moved_mm": [0, 0]}', "moved_mm", "[0, 0]"),
        ('{"moved_mm": ["1", 0, 0]}', "moved_mm.0", "'1'"),
        ('{"moved_mm": [0, 0, 0], "gripper_rad": -1}', "gripper_rad", "-1"),
        ('{"moved_mm": [0, 0, 0], "clutch": 1}', "clutch", "1"),
        ('{"moved_mm": [0, 0, 0], "speed": 3}', "speed", "3"),
        ('{"x": 1, "y": 2, "z": 3}', "moved_mm", "{'x': 1"),
        ("[]", "message", "[]"),
        ("mouse", "message", "'mouse'"),
    ],
)
def test_what_is_none_is_refused_by_field_and_value(text: str, field: str, got: str) -> None:
    refused = read_move(text)
    assert isinstance(refused, str)
    assert refused.startswith(f"{field}: ")
    assert f"(got {got}" in refused


def test_a_long_message_is_refused_unread() -> None:
    text = json.dumps({"moved_mm": [0, 0, 0], "note": "x" * MAX_MESSAGE_CHARS})
    assert read_move(text) == f"message: must have at most 400 characters (got {len(text)})"


@given(st.one_of(st.text(), st.binary(), st.recursive(st.floats() | st.text(), st.lists).map(json.dumps)))
def test_whatever_comes_is_read_or_refused_in_one_short_line(text: str | bytes) -> None:
    found = read_move(text)
    assert isinstance(found, HandMove) or len(found) < 300
