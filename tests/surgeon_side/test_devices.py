from math import nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.surgeon_side.devices import (
    Handle,
    MouseEvent,
    Moved,
    Pressed,
    Sticks,
    Turned,
    deflection,
    moved_by_mouse,
    moved_by_sticks,
)

PX = st.integers(-500, 500)


def test_pixels_are_tenths_of_a_millimetre_in_the_plane_of_the_screen() -> None:
    handle = moved_by_mouse(moved_by_mouse(Handle(), Moved(100, 0)), Moved(0, 50))
    assert (handle.x_m, handle.y_m, handle.z_m) == pytest.approx((0.01, -0.005, 0.0))


def test_the_wheel_is_depth() -> None:
    assert moved_by_mouse(Handle(), Turned(-3)).z_m == pytest.approx(0.006)


def test_buttons_close_the_gripper_and_press_the_clutch() -> None:
    handle = moved_by_mouse(Handle(), Pressed("left", is_down=True))
    assert (handle.gripper_rad, handle.clutch) == (0.0, False)
    handle = moved_by_mouse(handle, Pressed("right", is_down=True))
    assert (handle.gripper_rad, handle.clutch) == (0.0, True)
    handle = moved_by_mouse(moved_by_mouse(handle, Pressed("left", is_down=False)), Pressed("right", is_down=False))
    assert (handle.gripper_rad, handle.clutch) == (0.8, False)


@given(st.lists(st.one_of(st.builds(Moved, PX, PX), st.builds(Turned, PX))))
def test_the_place_is_the_sum_of_all_movements(events: list[MouseEvent]) -> None:
    handle = Handle()
    for event in events:
        handle = moved_by_mouse(handle, event)
    moved = [event for event in events if isinstance(event, Moved)]
    assert handle.x_m == pytest.approx(sum(event.x_px for event in moved) / 10_000, abs=1e-9)
    assert handle.y_m == pytest.approx(-sum(event.y_px for event in moved) / 10_000, abs=1e-9)
    turned = sum(event.steps for event in events if isinstance(event, Turned))
    assert handle.z_m == pytest.approx(-turned / 500, abs=1e-9)


def test_the_message_of_a_handle() -> None:
    pose = Handle(0.1, 0.2, 0.3, 0.4, clutch=True).pose(7)
    assert (pose.stamp_ns, pose.position_m.z, pose.gripper_rad, pose.clutch) == (7, 0.3, 0.4, True)


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
        handle = moved_by_sticks(handle, REST._replace(left_x=1.0, left_y=-1.0, right_y=0.575), 20 * MS)
    assert (handle.x_m, handle.y_m, handle.z_m) == pytest.approx((0.03, 0.03, 0.015))


def test_a_pause_of_the_program_moves_the_handle_by_little() -> None:
    assert moved_by_sticks(Handle(), REST._replace(left_x=1.0), 60_000 * MS).x_m == pytest.approx(0.015)
    assert moved_by_sticks(Handle(), REST._replace(left_x=1.0), -5).x_m == 0.0


def test_trigger_and_clutch() -> None:
    handle = moved_by_sticks(Handle(), REST._replace(trigger=0.575, clutch=True), MS)
    assert handle.gripper_rad == pytest.approx(0.4)
    assert handle.clutch
    assert moved_by_sticks(Handle(), REST, MS) == Handle()
