"""The summary's figures of set points, against the messages of the log read one by one."""

import json
from dataclasses import replace
from itertools import pairwise
from math import dist
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from msgspec import to_builtins

from tis.common.audit import AUDIT_FILE, Chain, Happening
from tis.common.channels import FOLLOWER
from tis.common.records import COUNTERS
from tis.common.safety_records import STOPS, StopNote
from tis.common.scenario import reading
from tis.common.scenario.safety import Safety
from tis.deploy.logs.read.load import load_run, models_in
from tis.deploy.present.plot_style import time_range
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.plots.errors import safety_figure
from tis.deploy.report.run_view import hand_view
from tis.deploy.report.subjects.safety import (
    LimitedFigures,
    SetPoints,
    _limited,
    limit_texts,
    safety_summary,
    set_points,
    stop_texts,
)
from tis.deploy.report.subjects.tracking import HandTrack, track_of_hand
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder
from tis.patient_side.safety.limits import limits_of

_OUTAGE = "network.timeline=[{at_s: 3, for_s: 4, direction: forward, set: {outage: true}}]"


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = resolve("default", (_OUTAGE, "estimators=[hold, innovations_kf]"), seed=11, duration_s=9.0)
    nodes, models, _ = build_sides(scenario)
    path = tmp_path_factory.mktemp("run")
    (path / "scenario.yaml").write_text(reading.dump_scenario(scenario))
    run_twin(scenario, nodes, models, path)
    return path


def _messages(path: Path, ending: str) -> list[dict[str, object]]:
    with path.open("rb") as file:
        return [
            json.loads(message.data)
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False)
            if channel.topic.endswith(ending)
        ]


def test_the_figures_are_those_of_the_messages(run_dir: Path) -> None:
    logs, scenario = load_run(run_dir), folder.read_scenario(run_dir)
    found = safety_summary(logs, scenario, {"left": track_of_hand(logs, scenario, "left")})["left"]
    assert found is not None
    points = _messages(run_dir / "patient.mcap", "/servo_cp")
    estimates = {
        row["tick"]: row["position_m"] for row in _messages(run_dir / "patient.mcap", "estimates/innovations_kf")
    }
    modes = [point["mode"] for point in points]
    assert found["time_s"] == {mode: modes.count(mode) / 30 for mode in found["time_s"]}
    assert found["time_s"]["hold"] == pytest.approx(1.5, abs=0.04)
    assert found["time_s"]["slow_stop"] == pytest.approx(1.0, abs=0.2)
    assert found["changes"] == sum(a != b for a, b in pairwise(modes))
    assert found["shaped_ticks"] == sum(point["position_m"] != estimates[point["tick"]] for point in points)
    places = [tuple(point["position_m"].values()) for point in points]  # type: ignore[attr-defined]
    assert found["largest_step_mm"] == pytest.approx(1e3 * max(dist(a, b) for a, b in pairwise(places)))
    assert found["largest_step_mm"] <= 8.0 + 1e-9
    assert found["rmse_3d_mm"] > 0
    assert found["emergency_stops"] == 0


def test_states_and_errors_are_drawn(run_dir: Path) -> None:
    logs, scenario = load_run(run_dir), folder.read_scenario(run_dir)
    view = hand_view(MeasuredRun(logs, scenario, FOLLOWER), "left", "left hand")
    driven = set_points(logs, scenario, view.track, "left")
    figure = safety_figure(view, driven, time_range(9.0))
    assert figure is not None
    assert {key.name for key in figure.keys} == {
        "set point", "innovations_kf, the estimate", "hold", "slow stop", "resuming",
    }  # fmt: skip
    assert "hold 1.5 s" in figure.caption
    assert "unless a limit of workspace, speed or acceleration" in figure.caption


def test_what_shapes_after_a_break_is_no_limit_to_raise(run_dir: Path) -> None:
    logs, scenario = load_run(run_dir), folder.read_scenario(run_dir)
    left = safety_summary(logs, scenario, {"left": track_of_hand(logs, scenario, "left")}, models_in(logs))["left"]
    assert left is not None
    assert left.limited is not None
    assert left["shaped_ticks"] > 60
    assert (left.limited.ticks, left.limited.off_mm, left.limited.field) == (0, None, None)
    assert limit_texts({"left": left, "right": None}) == []


def test_no_limit_is_to_be_raised_for_a_loop_of_touch_that_swings(run_dir: Path) -> None:
    logs, scenario = load_run(run_dir), folder.read_scenario(run_dir)
    left = safety_summary(logs, scenario, {"left": track_of_hand(logs, scenario, "left")}, models_in(logs))["left"]
    assert left is not None
    limited = LimitedFigures(ticks=60, of_ticks=270, off_mm=10.99, field="acceleration_m_s2")
    limited_hand = left.model_copy(update={"limited": limited})
    (text,) = limit_texts({"left": limited_hand}, ["left"])
    assert "60 of 270 ticks" in text
    assert "raise" not in text


def test_a_limit_is_to_be_raised_only_for_a_movement_and_only_if_the_arm_may_follow(tmp_path: Path) -> None:
    slow = "patient.safety={speed_m_s: 0.03, resume_speed_m_s: 0.03}"
    scenario = resolve("default", (slow, "estimators=[hold, innovations_kf]"), seed=11, duration_s=6.0)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, tmp_path)
    logs = load_run(tmp_path)
    track = track_of_hand(logs, scenario, "left")
    too_fast = safety_summary(logs, scenario, {"left": track}, models)
    assert too_fast["left"] is not None
    assert too_fast["left"].limited is not None
    assert (too_fast["left"].limited.field, too_fast["left"].limited.by_movement) == ("speed_m_s", True)
    (text,) = limit_texts(too_fast)
    assert text.endswith("which did its work; raise it only if the arm may move that fast")
    still = replace(track, truth_m=np.broadcast_to(track.truth_m[-1], track.truth_m.shape))
    (text,) = limit_texts(safety_summary(logs, scenario, {"left": still}, models))
    assert "the estimate, not the movement, jumps beyond patient.safety.speed_m_s" in text
    assert "raise" not in text


def test_an_arm_stopped_before_its_first_set_point_counts_the_stop(run_dir: Path) -> None:
    logs, scenario = load_run(run_dir), folder.read_scenario(run_dir)
    rows = logs.sides["patient"].rows
    logs.sides["patient"].rows = {topic: found for topic, found in rows.items() if not topic.endswith("servo_cp")}
    # as a log of before holds it
    logs.sides["patient"].add_rows(STOPS, [{"at_ns": 5, "stop": True, "reason": ""}])
    found = safety_summary(logs, scenario, {"left": track_of_hand(logs, scenario, "left")})["left"]
    assert found is not None
    assert (found["emergency_stops"], set(found["time_s"].values()), found["rmse_3d_mm"]) == (1, {0.0}, None)
    assert (found["shaped_ticks"], found["largest_step_mm"]) == (0, None)


def test_a_log_without_set_points_has_no_figures(run_dir: Path) -> None:
    logs, scenario = load_run(run_dir), folder.read_scenario(run_dir)
    logs.sides["patient"].rows = {
        topic: rows for topic, rows in logs.sides["patient"].rows.items() if not topic.endswith("servo_cp")
    }
    track = track_of_hand(logs, scenario, "left")
    assert safety_summary(logs, scenario, {"left": track}) == {"left": None}


def test_requests_are_counted_by_what_came_of_them(run_dir: Path) -> None:
    logs, scenario = load_run(run_dir), folder.read_scenario(run_dir)
    notes = [
        StopNote(at_ns=5, stop=True, reason="", number=1, stopped=True, changed=True),
        StopNote(at_ns=6, stop=False, reason="", ends=1, stopped=True, changed=False, refused="wrong secret"),
        StopNote(at_ns=7, stop=False, reason="", ends=1, by_stopper=False, stopped=False, changed=True),
        StopNote(at_ns=8, stop=False, reason="", ends=2, stopped=False, changed=False),
    ]
    counts = {"stop_requests_refused": 3, "stop_requests_flooded": 29_000, "stops_unsigned": 1}
    chain = Chain()
    by = [("release", "of 2", ("tcp/192.0.2.9:1",)), ("release", "of 1", ("alice tcp/192.0.2.7:4001",))]
    lines = [chain.line("2026-01-01", 7, Happening(event, what, among=who)) for event, what, who in by]  # type: ignore[arg-type]
    (run_dir / AUDIT_FILE).write_bytes(b"".join(lines))
    del logs.sides["patient"].rows[COUNTERS]
    logs.sides["patient"].add_rows(STOPS, [to_builtins(note) for note in notes])
    logs.sides["patient"].add_rows(COUNTERS, [{"name": name, "value": n} for name, n in counts.items()])
    left = safety_summary(logs, scenario, {"left": track_of_hand(logs, scenario, "left")})["left"]
    assert left is not None
    names = ("emergency_stops", "releases", "releases_by_others", "stop_requests_refused", "stop_requests_flooded")
    assert [left[name] for name in names] == [1, 2, 1, 3, 29_000]
    assert left["released_by"] == ["alice tcp/192.0.2.7:4001"]
    stood_s = left["time_s"]["safe"]
    assert stop_texts({"left": left, "right": None}) == [
        f"an emergency stop stopped the set points, which stood still for {stood_s:.1f} s, outages included: "
        "the errors count that time",
        "a stop had no valid signature: the arms stop for anybody (the audit log names who was connected)",
        "a release came without the stop's token, by alice tcp/192.0.2.7:4001 (patient.safety.release says who may)",
        "the patient refused 3 requests to stop or to release (reasons in the log)",
        "a flood of 29006 requests to stop or to release: the patient carried out a stop and 2 releases, the others "
        "had no effect",
    ]


def test_an_arm_that_begins_within_a_movement_has_to_catch_up_with_it() -> None:
    """The estimate moves evenly from the first tick on, so nothing jumps, and no movement is beyond a limit."""
    k = np.arange(180)
    estimate_m = 0.05 * k[:, None] / 30 * np.array([1.0, 0.0, 0.0])
    differs = (k > 0) & (k < 40)
    driven = SetPoints(np.where(differs[:, None], 0.5 * estimate_m, estimate_m), np.full(180, "tracking"), differs)
    scored = np.ones(180, dtype=np.bool_)
    track = HandTrack(k * 10**9 // 30, k, estimate_m, {"hold": estimate_m}, scored, {})
    limits = limits_of(Safety(cautious_ms=1.0), 30, None)
    found = _limited(limits, driven, track, estimate_m, np.zeros(3))
    assert (found.ticks, found.field, found.by_movement) == (39, None, False)
    # what is shaped once it has met the estimate is not of the beginning
    later = SetPoints(driven.position_m, driven.mode, np.roll(differs, 60))
    assert _limited(limits, later, track, estimate_m, np.zeros(3)).field == "acceleration_m_s2"


def test_the_arm_behind_a_set_point_that_is_stopped_goes_on_and_that_is_told() -> None:
    """The set point stands at once, at tick 10; the arm lags by ten ticks and needs them to come there."""
    k = np.arange(60)
    stands_m = 0.005 * np.minimum(k, 9)[:, None] * np.array([1.0, 0.0, 0.0])
    arm_m = 0.005 * np.clip(k - 10, 0, 9)[:, None] * np.array([1.0, 0.0, 0.0])
    mode = np.where((k >= 10) & (k < 40), "safe", "tracking")
    driven = SetPoints(stands_m, mode, k >= 10)
    t_ns = k * 10**9 // 30
    ((way_m, time_ns, arm_way_m),) = driven.stops([int(t_ns[10]) - 5_000_000], t_ns, arm_m)
    assert (way_m, time_ns) == (0.0, 5_000_000)
    assert arm_way_m == pytest.approx(0.045)
    assert driven.stops([int(t_ns[10])], t_ns)[0][2] is None
    assert driven.stops([int(t_ns[10])], t_ns, np.full_like(arm_m, np.nan))[0][2] is None
