"""What all pages share: the picture of known rows, and who moves the hand."""

import json
import time
from collections.abc import Callable
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.deploy.watch.making import LEFT, a_book, sighting
from tests.deploy.watch.test_arms import _arm, _display
from tests.deploy.watch.test_forces import _shown, _wrench
from tis.common.device import DevicePose, TargetRun
from tis.common.messages import SafetyMode
from tis.common.scenario.control import DirectionState, EmulatorState
from tis.common.scenario.network.conditions import Change, TimelineEntry
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.units import NS_PER_S
from tis.deploy.report.subjects.touch import loop_of, predicted_limit
from tis.deploy.run.resolve import resolve
from tis.deploy.view.device import Device
from tis.deploy.view.drive import (
    MAX_MESSAGE_CHARS,
    MAX_RATE_HZ,
    NOT_CONNECTED,
    NOT_LIVE,
    OTHER_DRIVES,
    RIVAL,
    DriveHub,
    HandMove,
    Rate,
    Seat,
    picture,
    queues,
    read_message,
    set_now,
)
from tis.deploy.view.felt import LoopLimit
from tis.deploy.view.hold_reason import about_of
from tis.deploy.view.page_text import MODES_IN_WORDS, _safety_html
from tis.deploy.view.requests import PageRequest
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.observer import Attendance
from tis.deploy.watch.safety import Stretch


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

    def attendance(self) -> Attendance:
        return Attendance()


class _Steering:
    """Netem's answers, at once."""

    def set_stage(self, direction: str, setting: str, on_answer: Callable[[str], None]) -> None:
        on_answer(f"done: {direction} {setting}")

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


def test_a_run_at_targets_goes_with_a_move_and_is_checked() -> None:
    told = '{"delay_ms": 300, "with_ghost": true, "time_s": %s, "path_mm": 402.5, "n_misses": 1}'
    move = read_message('{"moved_mm": [0.0, 0.0, 0.0], "target_run": ' + told % "12.3" + "}")
    assert isinstance(move, HandMove)
    door = _Door()
    assert _hub(door).drive("page", move, 1.0) == ""
    assert door.sent[0].target_run == TargetRun(delay_ms=300, with_ghost=True, time_s=12.3, path_mm=402.5, n_misses=1)
    for wrong in ("-1", '"x"', "NaN", "Infinity", "null"):
        refused = read_message('{"moved_mm": [0.0, 0.0, 0.0], "target_run": ' + told % wrong + "}")
        assert isinstance(refused, str)
        assert refused.startswith("target_run")


def test_who_may_not_drive_is_told_why_and_moves_nothing() -> None:
    door, move = _Door(), HandMove(moved_mm=[1.0, 1.0, 1.0])
    hub = _hub(door)
    assert hub.frame(0.9)["moved"] is False
    assert hub.drive("one", move, 1.0) == ""
    assert hub.frame(1.1)["moved"] is True
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
    frame = _hub(_Door(), book).frame(1.0)
    assert {name: frame[name] for name in found} == found
    assert (frame["late_ms"], frame["network_ms"]) == (210.0, None)
    assert (frame["feedback_error_mm"], frame["ghost_error_mm"]) == (5.5, 1.5)


def test_a_picture_has_all_of_the_arms_path_since_the_last_one() -> None:
    """A target task counts how long the arm stays in a target, which a slow page's pictures do not show."""
    book = LiveBook("tis")
    hub = _hub(_Door(), book)
    paths = []
    for first, n in ((0, 1), (1, 3), (4, 0)):
        for k in range(first, first + n):
            arm = _arm(1000 + 33 * k, 0.001 * k, 900 + k)
            book.take(sighting("east", LEFT.measured, k, 0, 0, arm))
        paths.append(hub.frame(1.0 + first)["arm_path"])
    # what was before the page is not told
    assert paths == [[], [[1000.0 + 33 * k, float(k), 0.0, 0.0] for k in (1, 2, 3)], []]


@pytest.mark.parametrize("mode", [one for one in get_args(SafetyMode) if one])
def test_the_picture_tells_what_the_arm_does_in_the_words_of_the_page(
    mode: SafetyMode, monkeypatch: pytest.MonkeyPatch
) -> None:
    book = a_book()
    monkeypatch.setattr(book.safety, "mode", lambda _: mode)
    found = picture(book, None)
    assert found["doing"] == MODES_IN_WORDS[mode]
    assert f"<strong>{found['doing']}</strong>" in _safety_html({"PSM2": [Stretch(mode, 0.0, 1.0)]})


def test_before_anything_is_seen_the_picture_is_empty() -> None:
    assert _hub(None).frame(1.0) == {
        "now_s": 0.0, "arm": None, "feedback_error_mm": None, "ghost_error_mm": None, "late_ms": None,
        "network_ms": None, "silent_s": None, "why": "", "outage": False, "unreached": False, "network": False,
        "left_s": None, "loop": None, "arm_path": [],
        "operator_n_m": None, "wall": None, "moved": None, "limit_n_m": None, "wall_n_m": None,
        "yields": False, "set": {"at_s": None, "delay": [None, None], "loss": [None, None]}, "queues": False,
        "settles": False,
    }  # fmt: skip
    found = _hub(_Door()).frame(1.0)
    assert {found[name] for name in ("hand_mm", "shown_mm", "ghost_mm", "arm_mm", "late_ms")} == {None}


def test_a_recorded_movement_has_a_hand_and_an_estimate_too() -> None:
    found = picture(a_book(), None)
    assert found["hand_mm"] == pytest.approx([299.0, 0.0, 0.0])
    assert found["estimate_mm"][0] < 299.0
    assert found["shown_mm"] is None


def _move(
    x: float = 0.0, y: float = 0.0, z: float = 0.0, gripper_rad: float = 0.0, release: bool = False
) -> HandMove:
    return HandMove(moved_mm=[x, y, z], gripper_rad=gripper_rad, release=release)


def test_the_first_page_drives_and_the_second_does_not() -> None:
    seat = Seat()
    assert seat.drive("one", _move(3.0, 4.0, 5.0, 0.5), 10.0)
    assert not seat.drive("two", _move(90.0), 10.1)
    assert (seat.driver, seat.hand_mm, seat.gripper_rad) == ("one", (3.0, 4.0, 5.0), 0.5)


def test_the_next_driver_moves_the_hand_on_from_where_it_is() -> None:
    seat = Seat()
    seat.drive("one", _move(10.0, 0.0, -2.0), 1.0)
    seat.leave("one")
    assert (seat.driver, seat.hand_mm) == (None, (10.0, 0.0, -2.0)), "the hand holds"
    assert seat.drive("two", _move(), 1.1)
    assert seat.hand_mm == (10.0, 0.0, -2.0)
    seat.drive("two", _move(1.0, 1.0, 1.0), 1.2)
    assert seat.hand_mm == (11.0, 1.0, -1.0)


@pytest.mark.parametrize(("waited_s", "is_taken"), [(2.9, False), (3.1, True)])
def test_a_driver_that_is_still_for_three_seconds_loses_the_seat(waited_s: float, is_taken: bool) -> None:
    seat = Seat()
    seat.drive("one", _move(), 5.0)
    assert seat.drive("two", _move(), 5.0 + waited_s) == is_taken
    assert seat.drive("one", _move(), 5.0 + waited_s) != is_taken


def test_a_page_lets_go_with_its_last_move_and_leaves_no_other_pages_seat() -> None:
    seat = Seat()
    seat.drive("one", _move(2.0, release=True), 1.0)
    assert (seat.driver, seat.hand_mm) == (None, (2.0, 0.0, 0.0))
    seat.drive("two", _move(), 1.0)
    seat.leave("one")
    assert seat.driver == "two"


@given(st.lists(st.floats(0.0, 0.5), max_size=300))
def test_no_page_moves_the_hand_faster_than_its_rate(gaps_s: list[float]) -> None:
    rate, now_s, n_taken = Rate(), 0.0, 0
    for gap_s in gaps_s:
        now_s += gap_s
        n_taken += rate.takes(now_s)
    assert n_taken <= 50 + MAX_RATE_HZ * now_s
    assert n_taken + rate.n_dropped == len(gaps_s)


def test_the_pages_own_forty_moves_a_second_are_all_taken() -> None:
    rate = Rate()
    assert all(rate.takes(k / 40) for k in range(400))
    assert rate.n_dropped == 0


def test_a_move_is_read() -> None:
    text = '{"moved_mm": [1.5, -2, 0], "gripper_rad": 1, "clutch": true}'
    assert read_message(text) == HandMove(moved_mm=[1.5, -2.0, 0.0], gripper_rad=1.0, clutch=True)


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
        ('{"ask": "shutdown"}', "ask", "'shutdown'"),
        ('{"ask": "delay", "value": -50}', "message", "{'ask'"),
        ('{"ask": "delay", "value": "abc"}', "value", "'abc'"),
        ('{"ask": "loss"}', "message", "{'ask'"),
        ('{"ask": "profile", "profile": "../../etc/passwd"}', "profile", "'../../etc/passwd'"),
    ],
)
def test_what_is_none_is_refused_by_field_and_value(text: str, field: str, got: str) -> None:
    refused = read_message(text)
    assert isinstance(refused, str)
    assert refused.startswith(f"{field}: ")
    assert f"(got {got}" in refused


def test_a_long_message_is_refused_unread() -> None:
    text = json.dumps({"moved_mm": [0, 0, 0], "note": "x" * MAX_MESSAGE_CHARS})
    assert read_message(text) == f"message: must have at most 400 characters (got {len(text)})"


@given(st.one_of(st.text(), st.binary(), st.recursive(st.floats() | st.text(), st.lists).map(json.dumps)))
def test_whatever_comes_is_read_or_refused_in_one_short_line(text: str | bytes) -> None:
    found = read_message(text)
    assert isinstance(found, (HandMove, PageRequest)) or len(found) < 300


def test_the_picture_has_what_the_hand_feels_while_that_is_new() -> None:
    book = a_book(100)
    assert picture(book, "PSM2")["felt"] is None
    book.forces.take("tis/PSM2/measured_cf", _wrench(960, 3.0), book.now_ns)
    book.forces.take("tis/MTML/servo_cf", _shown(990, 2.0, 0.0), book.now_ns)
    assert picture(book, "PSM2")["felt"] == {
        "hand_n": [0.0, 2.0, 0.0], "tool_n": [0.0, 3.0, 0.0], "late_ms": 30.0, "limited": "", "most_given_mj": 0.0,
        "place_mm": [0.0, 0.0, 0.0], "meant_mm": [0.0, 0.0, 0.0],
    }  # fmt: skip
    book.now_ns += 2 * NS_PER_S
    assert picture(book, "PSM2")["felt"] is None


def test_theorys_limit_is_that_of_the_summary_and_is_not_waited_for() -> None:
    scenario = resolve("drive_touch", [], None)
    limit = LoopLimit(about_of(scenario))
    assert limit.at(None) is limit.at(362.0) is None
    until_s = time.monotonic() + 20
    while (found := limit.at(361.0)) is None:
        assert time.monotonic() < until_s
        time.sleep(0.01)
    assert found == pytest.approx(predicted_limit(scenario, 0.36), abs=0.5)
    assert LoopLimit(about_of(resolve("drive", [], None))).at(361.0) is None


def test_for_some_seconds_after_a_change_the_lateness_settles() -> None:
    book = LiveBook("tis")
    hub = _hub(None, book)
    hub._edges.changed_ns, settles = 10 * NS_PER_S, []
    for now_s in (11.0, 12.9, 13.1):
        book.now_ns = round(now_s * NS_PER_S)
        settles.append(hub.frame(now_s)["settles"])
    assert settles == [True, True, False]


def _way(stages: dict[str, Any]) -> DirectionState:
    now = Pipeline.model_validate(stages)
    return DirectionState(
        outage=False, scale_delay=1.0, add_delay_ms=0.0, add_p_loss=0.0, pipeline=now, now=now, rules=(), added=(),
        counters={},
    )  # fmt: skip


def test_a_page_is_told_what_netem_is_set_to_where_one_number_tells_it() -> None:
    plain = _way({"delay": {"kind": "constant", "delay_ms": 50}, "loss": {"kind": "bernoulli", "p_loss": 0.07}})
    other = _way({"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 9}})
    assert set_now(EmulatorState(running=True, forward=plain, feedback=other)) == {
        "at_s": None, "delay": [50.0, None], "loss": [7.0, 0.0],
    }  # fmt: skip
    assert set_now(None) == {"at_s": None, "delay": [None, None], "loss": [None, None]}
    changed = [plain.model_copy(update={"added": (TimelineEntry(at_s=at_s, set=Change()),)}) for at_s in (3.5, 8.25)]
    assert set_now(EmulatorState(running=True, forward=changed[1], feedback=changed[0]))["at_s"] == 8.25
    assert not queues(EmulatorState(running=True, forward=plain, feedback=other))
    assert queues(EmulatorState(running=True, forward=plain, feedback=_way({"rate": {"kbit_s": 900}})))


def test_a_page_is_told_of_the_surface_where_the_scenario_tells_where_it_is() -> None:
    drive_touch = resolve("drive_touch", [], None)
    about = about_of(drive_touch)
    assert about.wall_mm == pytest.approx([50.0, 13.0, 25.0])
    assert about.wall_normal == (0.0, 1.0, 0.0)
    assert (about.operator_n_m, about.simulates_hand, about.loop) == (568.0, True, loop_of(drive_touch))
    assert about_of(resolve("touch", [], None)).wall_mm is None
    assert about_of(resolve("drive", [], None)).operator_n_m is None
