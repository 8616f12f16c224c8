"""What all pages share: the picture of known rows, and who moves the hand."""

from typing import Any

import pytest

from tests.deploy.watch.making import LEFT, a_book, sighting
from tests.deploy.watch.test_displays import _arm, _display
from tis.common.device import DevicePose
from tis.common.scenario.control import EmulatorState
from tis.deploy.view.drive.device import Device
from tis.deploy.view.drive.hand_move import HandMove
from tis.deploy.view.drive.hub import NOT_CONNECTED, NOT_LIVE, OTHER_DRIVES, RIVAL, DriveHub, picture
from tis.deploy.watch.book import LiveBook


class _Door:
    """A device's door to a network that is there or not."""

    def __init__(self, scale: float = 0.5) -> None:
        self.device = Device("left", "device/MTML/measured_cp", scale, (0.0, 0.0, 0.0))
        self.sent: list[DevicePose] = []
        self.rivalled = False
        self.connected = True

    def is_rivalled(self, within_s: float) -> bool:
        return self.rivalled and within_s > 0

    def publish(self, pose: DevicePose) -> bool:
        self.sent += [pose] if self.connected else []
        return self.connected


class _Observer:
    def __init__(self, book: LiveBook) -> None:
        self._book = book

    def read(self, look: Any) -> Any:
        return look(self._book)


class _Steering:
    def state(self) -> EmulatorState | None:
        return None


def _hub(door: _Door | None, book: LiveBook | None = None) -> DriveHub:
    return DriveHub(_Observer(book or LiveBook("tis")), _Steering(), door)  # type: ignore[arg-type]


def test_a_move_is_published_as_the_pose_of_a_device() -> None:
    door = _Door()
    assert _hub(door).drive("page", HandMove(moved_mm=[5.0, 0.0, -1.0], gripper_rad=0.3, clutch=True), 1.0) == ""
    (pose,) = door.sent
    assert (pose.position_m.x, pose.position_m.y, pose.position_m.z) == (0.01, 0.0, -0.002)
    assert (pose.gripper_rad, pose.clutch) == (0.3, True)
    assert pose.stamp_ns is not None


def test_who_may_not_drive_is_told_why_and_moves_nothing() -> None:
    door, move = _Door(), HandMove(moved_mm=[1.0, 1.0, 1.0])
    hub = _hub(door)
    assert hub.drive("one", move, 1.0) == ""
    assert hub.drive("two", move, 1.1) == OTHER_DRIVES
    hub.leave("one")
    assert hub.drive("two", move, 1.2) == ""
    door.rivalled = True
    assert hub.drive("two", move, 1.3) == RIVAL
    door.rivalled, door.connected = False, False
    assert hub.drive("two", move, 1.4) == NOT_CONNECTED
    assert len(door.sent) == 2
    assert _hub(None).drive("page", move, 1.0) == NOT_LIVE


def test_the_picture_is_the_newest_of_each_row() -> None:
    book = LiveBook("tis")
    for network, channel, payload in (
        ("west", LEFT.predicted, _display(1000, 0.010, 0.014, 210)),
        ("east", LEFT.measured, _arm(1130, 0.0155, 1000)),
    ):
        book.take(sighting(network, channel, 0, 0, 0, payload))  # type: ignore[arg-type]
    book.newest["PSM2"] |= {"hand": (0.02, 0.0, 0.001), "estimate": (0.0153, 0.0, 0.0)}
    found = picture(book, None)
    assert found["arm"] == "PSM2"
    assert (found["hand_mm"], found["estimate_mm"]) == ([20.0, 0.0, 1.0], [15.3, 0.0, 0.0])
    assert (found["shown_mm"], found["ghost_mm"], found["arm_mm"]) == (
        [10.0, 0.0, 0.0],
        [14.0, 0.0, 0.0],
        [15.5, 0.0, 0.0],
    )
    assert found["late_ms"] == 210.0
    frame = _hub(_Door(), book).frame(1.0)
    assert {name: frame[name] for name in found} == found
    assert (frame["feedback_error_mm"], frame["ghost_error_mm"]) == (5.5, 1.5)


def test_before_anything_is_seen_the_picture_is_empty() -> None:
    assert _hub(None).frame(1.0) == {
        "now_s": 0.0, "arm": None, "feedback_error_mm": None, "ghost_error_mm": None, "outage": False,
    }  # fmt: skip
    found = _hub(_Door()).frame(1.0)
    assert {found[name] for name in ("hand_mm", "shown_mm", "ghost_mm", "arm_mm", "late_ms")} == {None}


def test_a_recorded_movement_has_a_hand_and_an_estimate_too() -> None:
    found = picture(a_book(), None)
    assert found["hand_mm"] == pytest.approx([299.0, 0.0, 0.0])
    assert found["estimate_mm"][0] < 299.0
    assert found["shown_mm"] is None
