import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.surgeon_side.devices.handle import Handle
from tis.surgeon_side.devices.mouse import MouseEvent, Moved, Pressed, Turned, after

PX = st.integers(-500, 500)


def test_pixels_are_tenths_of_a_millimetre_in_the_plane_of_the_screen() -> None:
    handle = after(after(Handle(), Moved(100, 0)), Moved(0, 50))
    assert (handle.x_m, handle.y_m, handle.z_m) == pytest.approx((0.01, -0.005, 0.0))


def test_the_wheel_is_depth() -> None:
    assert after(Handle(), Turned(-3)).z_m == pytest.approx(0.006)


def test_buttons_close_the_gripper_and_press_the_clutch() -> None:
    handle = after(Handle(), Pressed("left", is_down=True))
    assert (handle.gripper_rad, handle.clutch) == (0.0, False)
    handle = after(handle, Pressed("right", is_down=True))
    assert (handle.gripper_rad, handle.clutch) == (0.0, True)
    handle = after(after(handle, Pressed("left", is_down=False)), Pressed("right", is_down=False))
    assert (handle.gripper_rad, handle.clutch) == (0.8, False)


@given(st.lists(st.one_of(st.builds(Moved, PX, PX), st.builds(Turned, PX))))
def test_the_place_is_the_sum_of_all_movements(events: list[MouseEvent]) -> None:
    handle = Handle()
    for event in events:
        handle = after(handle, event)
    moved = [event for event in events if isinstance(event, Moved)]
    assert handle.x_m == pytest.approx(sum(event.x_px for event in moved) / 10_000, abs=1e-9)
    assert handle.y_m == pytest.approx(-sum(event.y_px for event in moved) / 10_000, abs=1e-9)
    turned = sum(event.steps for event in events if isinstance(event, Turned))
    assert handle.z_m == pytest.approx(-turned / 500, abs=1e-9)


def test_the_message_of_a_handle() -> None:
    pose = Handle(0.1, 0.2, 0.3, 0.4, clutch=True).pose(7)
    assert (pose.stamp_ns, pose.position_m.z, pose.gripper_rad, pose.clutch) == (7, 0.3, 0.4, True)
