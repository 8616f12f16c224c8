from math import nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.surgeon_side.devices.gamepad import Sticks, after, deflection
from tis.surgeon_side.devices.handle import Handle

MS = 1_000_000
REST = Sticks(0.0, 0.0, 0.0, 0.0, clutch=False)


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.0, 0.0), (0.15, 0.0), (-0.14, 0.0), (1.0, 1.0), (-1.0, -1.0), (0.575, 0.5), (1.2, 1.0), (nan, 0.0)],
)
def test_the_dead_zone(value: float, expected: float) -> None:
    assert deflection(value) == pytest.approx(expected)


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_more_way_is_never_less_speed(one: float, other: float) -> None:
    assert (deflection(one) <= deflection(other)) or one > other


def test_sticks_are_velocities() -> None:
    handle = Handle()
    for _ in range(10):
        handle = after(handle, REST._replace(left_x=1.0, left_y=-1.0, right_y=0.575), 20 * MS)
    assert (handle.x_m, handle.y_m, handle.z_m) == pytest.approx((0.03, 0.03, 0.015))


def test_a_pause_of_the_program_moves_the_handle_by_little() -> None:
    assert after(Handle(), REST._replace(left_x=1.0), 60_000 * MS).x_m == pytest.approx(0.015)
    assert after(Handle(), REST._replace(left_x=1.0), -5).x_m == 0.0


def test_trigger_and_clutch() -> None:
    handle = after(Handle(), REST._replace(trigger=0.575, clutch=True), MS)
    assert handle.gripper_rad == pytest.approx(0.4)
    assert handle.clutch
    assert after(Handle(), REST, MS) == Handle()
