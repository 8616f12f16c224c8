"""Figures of sight from records written by hand: frames, hand to eye, freezes, theory, touch beside sight, waits."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tis.common.channels import VIDEO, Direction, hand_channels
from tis.common.records import CONTACTS, COUNTERS, FATES, RELEASES
from tis.common.scenario import Scenario
from tis.common.scenario.limits import Limits, Metric
from tis.common.sight_records import CAMERA, SCREEN
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import MESSAGES, SideLog
from tis.deploy.report.plots.sight import by_second
from tis.deploy.report.subjects.pictures import Pictures
from tis.deploy.report.subjects.requirements import Measured, verdicts
from tis.deploy.report.subjects.sight import SightFigures, sight_summary
from tis.deploy.report.subjects.sight_tables import answer_text, sight_tables, sight_text, sight_texts
from tis.deploy.run.resolve import resolve

Measurements = dict[tuple[Metric, Direction | None], Measured]

MS = 1_000_000
FRAME = 100 * MS


def scenario(*settings: str, name: str = "default") -> Scenario:
    return resolve(name, ("duration_s=4", "rate_hz=10", "sight={fps: 10}", *settings), None, None)


def camera(frame: int, **changed: Any) -> dict[str, Any]:
    at_ns = frame * FRAME
    return {
        "frame": frame, "captured_ns": at_ns + 5 * MS, "command": frame - 1, "left_x": 1, "left_y": 1,
        "right_x": None, "right_y": None, "is_key": True, "n_bytes": 2000, "n_fragments": 2, "first_seq": 2 * frame,
        "sent_ns": at_ns + 6 * MS,
    } | changed  # fmt: skip


def screen(frame: int, state: str = "complete", **changed: Any) -> dict[str, Any]:
    read = None if state in ("lost", "undecodable") else frame
    command = None if read is None else frame - 1
    return {
        "frame": frame, "state": state, "top_frame": read, "top_command": command, "bottom_frame": read,
        "bottom_command": command, "first_ns": frame * FRAME + 30 * MS, "last_ns": frame * FRAME + 31 * MS,
        "shown_ns": None if read is None else frame * FRAME + 45 * MS, "fragments": 2, "expected": 2, "missing": "",
    } | changed  # fmt: skip


def logs(cameras: list[dict[str, Any]], screens: list[dict[str, Any]], **counters: int) -> RunLogs:
    found = RunLogs(Path(), {side: SideLog(side) for side in ("surgeon", "netem", "patient")})
    found.sides["patient"].add_rows(CAMERA, cameras)
    found.sides["surgeon"].add_rows(SCREEN, screens)
    counted = [{"name": name, "value": value} for name, value in counters.items()]
    found.sides["surgeon"].add_rows(COUNTERS, counted)
    return found


def figures(run: RunLogs, of: Scenario) -> SightFigures:
    found = sight_summary(Pictures.of(run, of), run, of, {"left": "PSM2"})["sight"]
    assert isinstance(found, SightFigures)
    return found


def test_frames_are_counted_by_what_became_of_them() -> None:
    """Frame 5 has no record; frame 6 came, but a newer one was shown in its place; frame 9 was never sent."""
    screens = [
        screen(0), screen(1, "concealed", fragments=1, missing="1"), screen(2, "torn", bottom_frame=1),
        screen(3, "undecodable", fragments=1),
        screen(4, "lost", fragments=0, first_ns=None, last_ns=None, expected=None),
        screen(6, shown_ns=None), screen(7), screen(9),
    ]  # fmt: skip
    run = logs([camera(n) for n in range(8)], screens, video_duplicated=3, video_late=1)
    found = figures(run, scenario())
    assert found.frames == {"sent": 8, "complete": 3, "concealed": 1, "torn": 1, "undecodable": 1, "lost": 2}
    assert found.pictures == 4
    assert found.decodable_pct == pytest.approx(100 * 3 / 8)
    assert found.incomplete_pct == pytest.approx(50)
    assert found.fragments["duplicated"] == 3
    assert found.fragments["forged"] == 0
    assert found.kbit_s == pytest.approx(160.0)
    for text in (sight_text(found), answer_text(found)):
        assert "37.5" in text


def test_a_starved_camera_or_screen_is_told() -> None:
    """What waits at the surgeon's side, and what is not captured, is no network."""
    of = scenario().model_copy(update={"duration_s": 1.2})  # 12 frames
    whole, some = [camera(n) for n in range(12)], [camera(n) for n in range(0, 12, 2)]
    calm = figures(logs(whole, [screen(n) for n in range(12)]), of)
    assert (calm.frames_due, calm.screen_ms["p50"]) == (12, 14.0)
    assert sight_texts(calm) == sight_texts(None) == []
    late = [screen(n, shown_ns=n * FRAME + 731 * MS) for n in range(0, 12, 2)]
    [text] = sight_texts(figures(logs(some, late), of))
    assert "the camera sent 6 of 12 frames, and a picture was shown 700.0 ms after it had arrived (median);" in text


def test_hand_to_eye_is_read_from_the_stamps_and_not_from_headers() -> None:
    """Command n, sampled at n * 100 ms, is seen in frame n + 1, shown 145 ms later."""
    screens = [screen(n) for n in range(6)]
    run = logs([camera(n) for n in range(6)], screens)
    found = figures(run, scenario())
    assert found.hand_to_eye_ms == dict.fromkeys(("p50", "p95", "p99", "max"), 145.0)
    assert found.glass_to_glass_ms["max"] == 40.0
    changed = logs([camera(n, sent_ns=7, captured_ns=n) for n in range(6)], screens)
    assert figures(changed, scenario()).hand_to_eye_ms == found.hand_to_eye_ms


def test_a_movement_whose_own_picture_was_damaged_is_seen_with_the_next_whole_one() -> None:
    """Frames 3, which is torn, and 5 to 8, which are lost, would have shown commands 2 and 4 to 7."""
    screens = [screen(n) for n in range(12) if n not in (5, 6, 7, 8)]
    screens[3] = screen(3, "torn", bottom_command=0)
    run = logs([camera(n) for n in range(12)], screens)
    pictures = Pictures.of(run, scenario().model_copy(update={"duration_s": 1.2}))
    assert pictures is not None
    later = [(245, 2), (545, 4), (445, 5), (345, 6), (245, 7)]
    expected = [145] * 11
    for ms, command in later:
        expected[command] = ms
    assert (pictures.hand_to_eye_ns // MS).tolist() == expected
    found = figures(run, scenario().model_copy(update={"duration_s": 1.2}))
    assert found.hand_to_eye_ms["max"] == 545.0
    assert "145.0 ms later in the median, and 545.0 ms in 99 of 100 cases" in answer_text(found)


def test_a_movement_that_was_never_seen_counts_with_its_age_at_the_end() -> None:
    """After frame 4 nothing comes until 1 s: commands 4 to 7 have waited longer than the 145 ms of the others."""
    pictures = Pictures.of(
        logs([camera(n) for n in range(10)], [screen(n) for n in range(5)]),
        scenario().model_copy(update={"duration_s": 1.0}),
    )
    assert pictures is not None
    assert (pictures.hand_to_eye_ns // MS).tolist() == [145] * 4 + [600, 500, 400, 300, 200]


def test_a_picture_that_stops_is_a_freeze_until_the_end() -> None:
    run = logs([camera(n) for n in range(40)], [screen(n) for n in range(21)])
    found = figures(run, scenario())
    assert found.freezes == 1
    assert found.longest_freeze_ms == pytest.approx(4000 - 2045)
    assert found.freeze_pct == pytest.approx(100 * (4000 - 2045) / (4000 - 45))
    assert "froze" in answer_text(found)
    (whole,) = [dict(table.texts()) for table in sight_tables(found, {})]
    assert whole["freezes"].startswith("1, 49.43 %")


def test_theory_stands_beside_the_shares_where_there_is_one() -> None:
    run = logs([camera(n) for n in range(4)], [screen(n) for n in range(4)])
    plain = "network={feedback: {loss: {kind: bernoulli, p_loss: 0.1}}}"
    found = figures(run, scenario(plain))
    assert found.expected_incomplete_pct == pytest.approx(19.0)
    assert found.expected_decodable_pct == pytest.approx(81.0)
    varying = "network={feedback: {}, outages: [{kind: periodic, every_s: 1, for_s: 0.1}]}"
    assert figures(run, scenario(varying)).expected_decodable_pct is None


def test_without_sight_or_its_records_there_are_no_figures() -> None:
    run = logs([], [])
    assert sight_summary(Pictures.of(run, scenario()), run, scenario(), {}) == {}
    without = resolve("default", (), None, None)
    assert Pictures.of(logs([camera(0)], [screen(0)]), without) is None


def test_frames_that_never_came_leave_no_figure_but_their_count() -> None:
    found = figures(logs([camera(n) for n in range(5)], []), scenario())
    assert found.frames["lost"] == 5
    assert found.freeze_pct is None
    assert found.hand_to_eye_ms["p50"] is None
    assert sight_text(found)
    assert answer_text(found)


def test_the_strip_has_the_shares_of_each_second() -> None:
    run = logs([camera(n) for n in range(20)], [screen(n) for n in range(10)])
    pictures = Pictures.of(run, scenario())
    assert pictures is not None
    seconds, shares = by_second(pictures)
    assert seconds.tolist() == [0.0, 1.0]
    assert shares["complete"].tolist() == [100.0, 0.0]
    assert shares["lost"].tolist() == [0.0, 100.0]


def touching(rate: str) -> Scenario:
    rate_of = f"{{rate: {{kbit_s: 1000}}}}{rate}"
    return resolve("touch", ("duration_s=4", "sight={fps: 10}", f"network={{feedback: {rate_of}}}"), None, None)


def test_forces_behind_the_picture_have_their_wait_and_theorys() -> None:
    """Two fragments of 1000 bytes at 1 Mbit/s take 16 ms with their headers; the force after them waits."""
    of = touching("")
    run = logs([camera(n) for n in range(2)], [screen(n) for n in range(2)])
    video, force = VIDEO.key(of.session), hand_channels("left", "PSM2").force.key(of.session)
    fates = {"direction": "feedback", "foreign": False, "delay_ns": [0, 0], "release_ns": [0, 0], "copies": [0, 0]}
    fates |= {"outcome": ["deliver"] * 2, "flipped": [0, 0], "seq": [0, 1], "offered_ns": [5 * MS] * 2}
    netem = run.sides["netem"]
    netem.add_rows(FATES, [fates | {"key": video, "n_bytes": [1000, 1000]}])
    netem.add_rows(FATES, [fates | {"key": force, "n_bytes": [100, 100]}])
    left = {"direction": "feedback", "foreign": False, "seq": [0, 1], "copy_index": [0, 0], "release_ns": [1, 1]}
    left |= {"released_ns": [50 * MS] * 2, "departure": ["released"] * 2}
    video_left = {"offered_ns": [5 * MS] * 2, "queued_ns": [8_160_000, 16_320_000]}
    netem.add_rows(RELEASES, [left | {"key": video} | video_left])
    force_left = {"offered_ns": [1 * MS, 5 * MS], "queued_ns": [960_000, 17_280_000]}
    netem.add_rows(RELEASES, [left | {"key": force} | force_left])
    waits = figures(run, of).force_waits
    assert waits is not None
    assert (waits.n, waits.behind_video) == (2, 1)
    assert waits.wait_ms["max"] == pytest.approx(17.28)
    assert waits.expected_max_ms == pytest.approx(8 * (2 * 1020 + 120) / 1e3)
    apart = touching(f", rules: [{{key: '{force}', direction: feedback, pipeline: {{rate: {{kbit_s: 1000}}}}}}]")
    assert (found := figures(run, apart).force_waits) is not None
    assert found.expected_max_ms == 0.0


def test_contacts_are_felt_beside_what_is_seen() -> None:
    """A contact at 250 ms: its force is felt at the tick of 290 ms; the picture of 305 at 345 ms."""
    of = touching("")
    run = logs([camera(n) for n in range(6)], [screen(n) for n in range(6)])
    contacts = [
        {"tick": n, "t_ns": n * 50 * MS, "hand": "left", "force_n": {"x": 0, "y": 0, "z": float(n > 4)}, "sent": True,
         "active": True} for n in range(12)
    ]  # fmt: skip
    run.sides["patient"].add_rows(CONTACTS, contacts)
    found = figures(run, of).asynchrony
    assert found is not None
    assert found.n == 0  # nothing was felt
    surgeon, n = run.sides["surgeon"], np.arange(12)
    key = hand_channels("left", "PSM2").force.key(of.session)
    columns = dict.fromkeys(MESSAGES, n * 50 * MS) | {"log_ns": n * 50 * MS + 40 * MS}
    surgeon.messages[key] = Frame.of_arrays(**columns)
    surgeon.rows[hand_channels("left", "PSM2").shown.key(of.session)] = Frame.of_arrays(
        tick=np.arange(60), sample_ns=np.arange(60) * 10 * MS, hand=np.full(60, "left")
    )
    felt = figures(run, of).asynchrony
    assert felt is not None
    assert (felt.n, felt.noticed) == (1, 1)
    assert felt.touch_after_sight_ms["p50"] == pytest.approx(290 - 345)


def test_limits_of_sight_are_judged() -> None:
    measured: Measurements = {
        ("freeze", None): Measured(np.array([12.5])),
        ("hand_to_eye", None): Measured(np.full(500, 90.0)),
    }
    own, *_ = verdicts(measured, Limits(freeze_max_pct=10, hand_to_eye_p99_ms=100))
    by_metric = {one.metric: one for one in own.findings}
    assert by_metric["freeze"].outcome == "missed"
    assert "12.5 % of the time" in by_metric["freeze"].sentence
    assert by_metric["hand_to_eye"].outcome == "met"


def test_one_freeze_is_once() -> None:
    run = logs([camera(n) for n in range(40)], [screen(n) for n in range(21)])
    assert "froze once" in answer_text(figures(run, scenario()))


EXTERNAL = "sight.camera=external"
UNREAD: dict[str, Any] = {"top_frame": None, "top_command": None, "bottom_frame": None, "bottom_command": None}


def test_what_a_picture_without_stamps_does_not_tell_is_named() -> None:
    """Glass to glass is that of frames that came whole, by the instants that the camera's program tells."""
    screens = [screen(n, **UNREAD) for n in range(4)]
    screens[2] = screen(2, "concealed", fragments=1, missing="1", **UNREAD)
    found = figures(logs([camera(n, command=-1) for n in range(4)], screens), scenario(EXTERNAL))
    assert found.not_measured[:2] == ["hand to eye", "torn frames"]
    assert found.frames == {"sent": 4, "complete": 3, "concealed": 1, "undecodable": 0, "lost": 0}
    assert set(found.hand_to_eye_ms.values()) == {None}
    assert found.glass_to_glass_ms["max"] == 40.0
    (table,) = [dict(one.texts()) for one in sight_tables(found, {})]
    assert "hand to eye" not in table
    assert table["not measured"].startswith("hand to eye; torn frames; ")
    assert "hand to eye is not measured" in sight_text(found)
    assert "Not measured: hand to eye, torn frames" in answer_text(found)


def test_stamps_of_an_external_camera_tell_the_command_whatever_frame_they_name() -> None:
    screens = [screen(n, top_frame=n + 70, bottom_frame=n + 70) for n in range(4)]
    screens[3] |= {"state": "torn", "bottom_frame": 3}
    found = figures(logs([camera(n, command=-1) for n in range(4)], screens), scenario(EXTERNAL))
    assert found.hand_to_eye_ms["p50"] == 145.0
    assert found.frames["torn"] == 1
    assert len(found.not_measured) == 1
    assert "hand to eye" in sight_text(found)
    assert "Left out are movements that only damaged or lost frames showed, 1 of 4. " in answer_text(found)


def test_a_frame_that_came_whole_and_was_no_picture_is_the_cameras_fault() -> None:
    screens = [screen(0, **UNREAD), screen(1, "undecodable"), screen(2, "undecodable", fragments=1)]
    screens.append(screen(3, "undecodable"))  # it refers to others, which may be lost
    pictures = Pictures.of(
        logs([*(camera(n) for n in range(3)), camera(3, is_key=False)], screens), scenario(EXTERNAL)
    )
    assert pictures is not None
    assert pictures.n_unreadable == 1
