"""Scores from hand-made logs: millimetres that can be added up in the head."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from tests.deploy.report.hand_made import (
    COMMAND,
    MS,
    Position,
    a_scenario,
    estimate,
    message,
    truth,
    write_log,
    write_run,
)
from tests.patient_side.arm_models import static_model
from tis.common.channels import Hand
from tis.common.messages import Vector3
from tis.common.node import Record
from tis.common.records import PLANT, EstimateNote, PlantNote
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.subjects.accuracy import Scores, pooled_accuracy
from tis.deploy.report.subjects.tracking import MAX_ALIGNED, Array, HandTrack, actuation_ms, offsets, track_of_hand

MODEL = static_model()  # its output range is 0.1 m on every axis
# The arm moves 1 mm in x every 100 ms; y and z stand still.
TRUTH = [truth(k, 100 * k, (0.001 * k, 0.0, 0.0)) for k in range(60)]
FIRST = message(COMMAND, 0, 0, log_ms=50)  # so the scored ticks begin at 2050 ms
TICKS_MS = (2000, 2050, 2150, 2250)  # the truth there: 20, 20.5, 21.5, 22.5 mm


def _accuracy(logs: RunLogs, scenario: Scenario, hand: Hand) -> dict[str, Scores]:
    return pooled_accuracy(logs, scenario, [(track_of_hand(logs, scenario, hand), MODEL)])


def _at_mm(*x_mm: float | None, name: str) -> list[Record]:
    points: list[Position | None] = [None if x is None else (x / 1000, 0.0, 0.0) for x in x_mm]
    return [estimate(k, t, name, point) for k, (t, point) in enumerate(zip(TICKS_MS, points, strict=True))]


def test_errors_are_scored_from_2_s_after_the_first_arrival(tmp_path: Path) -> None:
    hold = _at_mm(999, 18.5, 19.5, 20.5, name="hold")  # 2 mm behind at each scored tick
    kalman = _at_mm(999, 20.5, None, 23.5, name="innovations_kf")  # 0 mm, none (counts as hold's 2 mm), 1 mm
    logs = write_run(tmp_path, surgeon=TRUTH, patient=[FIRST, *hold, *kalman])
    accuracy = _accuracy(logs, a_scenario(), "left")
    assert list(accuracy) == ["hold", "innovations_kf"]
    assert accuracy["hold"]["rmse_3d_mm"] == pytest.approx(2)
    assert accuracy["hold"]["ratio_to_hold"] == 1
    entry = accuracy["innovations_kf"]
    assert (entry["n_scored"], entry["n_missing"]) == (3, 1)
    # squared errors 0, 4, 1 mm^2; the truth is -1, 0, 1 mm about its mean
    assert entry["rmse_3d_mm"] == pytest.approx((5 / 3) ** 0.5)
    assert entry["ratio_to_hold"] == pytest.approx((5 / 12) ** 0.5)
    assert entry["r2_pct"] == [pytest.approx(100 * (1 - 5 / 2)), None, None]
    assert entry["rmse_normalized"][0] == pytest.approx((5 / 3) ** 0.5 / 100)


def test_estimators_come_in_the_scenarios_order_and_unasked_ones_last(tmp_path: Path) -> None:
    names = ("another", "damped_velocity", "hold", "innovations_kf")
    rows = [row for name in names for row in _at_mm(20, 20, 20, 20, name=name)]
    logs = write_run(tmp_path, surgeon=TRUTH, patient=[FIRST, *rows])
    scenario = a_scenario(estimators=["innovations_kf", "hold", "damped_velocity"])
    assert list(_accuracy(logs, scenario, "left")) == [
        "innovations_kf",
        "hold",
        "damped_velocity",
        "another",
    ]


def test_step_times_are_percentiles_in_us_and_null_where_nobody_measured(tmp_path: Path) -> None:
    """In virtual time every step takes 0 ns, which is no measurement."""
    steps_ns = (10_000, 30_000, 20_000, 400_000)
    kalman = [estimate(k, t, "innovations_kf", (0.02, 0, 0), step_ns=steps_ns[k]) for k, t in enumerate(TICKS_MS)]
    logs = write_run(tmp_path, surgeon=TRUTH, patient=[FIRST, *_at_mm(20, 20, 20, 20, name="hold"), *kalman])
    accuracy = _accuracy(logs, a_scenario(), "left")
    assert accuracy["innovations_kf"]["step_us"] == {"p50": 20, "p99": 400}
    assert accuracy["hold"]["step_us"] == {"p50": None, "p99": None}


def test_two_hands_are_scored_apart(tmp_path: Path) -> None:
    right_truth = [truth(k, 100 * k, (0.0, 0.0, 0.01 * k), hand="right") for k in range(60)]
    left = _at_mm(999, 21.5, 22.5, 23.5, name="hold")  # 1 mm ahead
    # the right arm is at z = 205, 215, 225 mm; hold stands at 205
    right = [estimate(k, t, "hold", (0.0, 0.0, 0.205), hand="right") for k, t in enumerate(TICKS_MS)]
    logs = write_run(tmp_path, surgeon=[*TRUTH, *right_truth], patient=[FIRST, *left, *right])
    scenario = a_scenario()
    assert _accuracy(logs, scenario, "left")["hold"]["rmse_3d_mm"] == pytest.approx(1)
    found = _accuracy(logs, scenario, "right")["hold"]
    assert found["rmse_3d_mm"] == pytest.approx((500 / 3) ** 0.5)  # 0, 10, 20 mm
    assert found["r2_pct"] == [None, None, pytest.approx(100 * (1 - 500 / 200))]


def test_a_servos_arm_is_scored_beside_the_estimators(tmp_path: Path) -> None:
    plant = [
        Record(
            PLANT,
            t * MS,
            PlantNote(tick=k, t_ns=t * MS, hand="left", position_m=Vector3(x=x, y=0, z=0), clamped=k == 2),
        )
        for k, (t, x) in enumerate(zip(TICKS_MS, (0, 0.0235, 0.0245, 0.0255), strict=True))
    ]  # 3 mm ahead
    logs = write_run(tmp_path, surgeon=TRUTH, patient=[FIRST, *_at_mm(0, 18.5, 19.5, 20.5, name="hold"), *plant])
    servo = a_scenario(patient={"plant": {"kind": "servo"}})
    assert _accuracy(logs, servo, "left")["plant"]["rmse_3d_mm"] == pytest.approx(3)
    assert _accuracy(logs, servo, "left")["plant"]["ratio_to_hold"] == pytest.approx(1.5)
    assert _accuracy(logs, servo, "left")["plant"]["clamped_pct"] == pytest.approx(25)  # 1 tick of 4
    assert "plant" not in _accuracy(logs, a_scenario(), "left")


def test_without_truth_without_estimates_or_without_hold_there_is_no_score(tmp_path: Path) -> None:
    """A log can be torn between the first estimator's first record and hold's."""
    hold, kalman = _at_mm(20, 20, 20, 20, name="hold"), _at_mm(20, 20, 20, 20, name="innovations_kf")
    cases = {"truth": ([], [FIRST, *hold]), "estimates": (TRUTH, [FIRST]), "hold": (TRUTH, [FIRST, *kalman])}
    for name, (surgeon, patient) in cases.items():
        (tmp_path / name).mkdir()
        logs = write_run(tmp_path / name, surgeon=surgeon, patient=patient)
        assert _accuracy(logs, a_scenario(), "left") == {}, name


def test_without_an_arrival_nothing_is_scored_and_the_figures_are_null(tmp_path: Path) -> None:
    write_log(tmp_path, "netem", [])
    logs = write_run(tmp_path, surgeon=TRUTH, patient=_at_mm(20, 20, 20, 20, name="hold"))
    entry = _accuracy(logs, a_scenario(), "left")["hold"]
    assert entry["n_scored"] == 0
    assert entry["rmse_3d_mm"] is entry["ratio_to_hold"] is None


def test_nees_is_against_truth_nis_where_the_arms_samples_reached_the_patient(tmp_path: Path) -> None:
    """moesp_kf states 1 mm on each axis and errs by 2, 0 and 1 mm in x; the sample after 2200 ms was lost."""
    truths = [truth(k, k * 1000 / 30, (0.0, 0.0, 0.0)) for k in range(90)]
    instants_ms = [round(k * 1000 / 30, 6) for k in range(90)]
    arrived = [
        message("tis/PSM2/setpoint_cp", k, ms, log_ms=ms + 5, sample_ms=ms)
        for k, ms in enumerate(instants_ms)
        if k != 67
    ]
    at_ms, errors_m = (2102, 2202, 2302), (0.002, 0.0, 0.001)  # between samples 63 64, 66 67, 69 70
    one_mm = Vector3(x=0.001, y=0.001, z=0.001)
    stated = [
        structs.replace(record, data=structs.replace(record.data, std_m=one_mm))
        for record in (
            estimate(k, t, "moesp_kf", (x, 0, 0)) for k, (t, x) in enumerate(zip(at_ms, errors_m, strict=True))
        )
        if isinstance(record.data, EstimateNote)
    ]
    hold = [estimate(k, t, "hold", (0.005, 0, 0)) for k, t in enumerate(at_ms)]
    logs = write_run(tmp_path, surgeon=truths, patient=[*arrived, *hold, *stated])
    accuracy = _accuracy(logs, a_scenario(), "left")
    nees, nis = accuracy["moesp_kf"]["nees"], accuracy["moesp_kf"]["nis"]
    assert (nees["n"], nis["n"]) == (3, 2)
    assert nees["mean"] == [pytest.approx(5 / 3), 0, 0]
    assert nis["mean"] == [pytest.approx(5 / 2), 0, 0]
    assert nees["coverage_pct"][0] == pytest.approx(200 / 3)
    assert "nees" not in accuracy["hold"].as_json()


def movement(t_s: Array) -> Array:
    return 0.05 * np.column_stack([np.sin(2 * t_s), np.cos(3 * t_s), np.sin(t_s + 1)])


def a_track(n: int = 300, rate_hz: int = 30, **late_s: float) -> HandTrack:
    """Estimators that show the movement late by what their names say."""
    t_s = np.arange(n) / rate_hz
    estimates = {name: movement(t_s - late) for name, late in late_s.items()}
    t_ns = np.round(t_s * 1e9).astype(np.int64)
    return HandTrack(t_ns, np.arange(n), movement(t_s), estimates, np.ones(n, dtype=np.bool_), {})


def test_a_late_estimator_is_late_and_right() -> None:
    found = offsets([a_track(hold=0.1)], "hold", 30)
    json.dumps(found.as_json(), allow_nan=False)
    assert found["time_ms"]["p50"] == pytest.approx(100)
    assert found["value_mm"]["p50"] < 0.1
    assert found["n"] == 300
    assert found["delay_derivative_ms_per_s"] < 50  # where the movement begins and ends nothing is known


@pytest.mark.parametrize(("rate_hz", "late_s"), [(100, 0.102), (100, 0.062), (40, 0.102), (30, 0.033)])
def test_a_constant_delay_is_told_to_a_tenth_of_a_millisecond(rate_hz: int, late_s: float) -> None:
    found = offsets([a_track(10 * rate_hz, rate_hz, hold=late_s)], "hold", rate_hz)
    assert found["time_ms"]["p50"] == pytest.approx(1000 * late_s, abs=0.1)
    assert found["value_mm"]["p50"] < 0.1
    assert found["step_ms"] <= 0.1


def test_an_arm_is_as_late_as_it_follows_the_active_estimate() -> None:
    track = a_track(hold=0.1, kalman=0.0, plant=0.05)
    assert np.median(actuation_ms(track, "kalman", 30)) == pytest.approx(50)
    assert np.median(actuation_ms(track, "hold", 30)) == pytest.approx(-50)
    assert len(actuation_ms(a_track(hold=0.1), "hold", 30)) == 0


def test_an_arm_that_is_stopped_is_not_late() -> None:
    """Between two thirds of a movement it stands for 5 s, and comes back; else it follows 50 ms later."""
    track = a_track(900, kalman=0.0, plant=0.05)
    arm_m = track.estimates["plant"].copy()
    stopped = slice(300, 450)
    arm_m[stopped] = arm_m[300]
    track = replace(track, estimates=track.estimates | {"plant": arm_m})
    follows = np.ones(900, dtype=np.bool_)
    follows[stopped] = False
    late_ms = actuation_ms(track, "kalman", 30, follows)
    assert len(late_ms) == 750
    assert np.percentile(late_ms, [5, 50, 95]) == pytest.approx([50, 50, 50], abs=0.5)  # linear between samples
    assert np.percentile(actuation_ms(track, "kalman", 30), 95) > 500


def test_a_hand_at_rest_is_followed_with_no_offset_that_could_be_told() -> None:
    moving = a_track(kalman=0.1, plant=0.15)
    rest = {name: np.zeros_like(position_m) for name, position_m in moving.estimates.items()}
    still = replace(moving, truth_m=np.zeros_like(moving.truth_m), estimates=rest)
    assert len(actuation_ms(still, "kalman", 30)) == 0
    assert offsets([still], "kalman", 30).time_ms["p50"] is None


def test_of_a_long_run_every_second_tick_is_aligned_to_its_end() -> None:
    n = MAX_ALIGNED + 50
    track = a_track(n, hold=0.0, later=0.4)
    track.estimates["hold"][-n // 3 :] = track.estimates["later"][-n // 3 :]  # the network grew worse
    found = offsets([track], "hold", 30)
    assert found["n"] == n / 2
    assert found["time_ms"]["p50"] == pytest.approx(0)
    assert found["time_ms"]["p95"] == pytest.approx(400)
    assert found["value_mm"]["p50"] < 0.1


def test_missing_estimates_are_not_aligned() -> None:
    track = a_track(60, hold=0.0)
    track.estimates["hold"][:20] = np.nan
    assert offsets([track], "hold", 30)["n"] == 40
    track.estimates["hold"][:] = np.nan
    empty = offsets([track], "hold", 30)
    assert (empty["n"], empty["value_rms_mm"], empty["delay_derivative_ms_per_s"]) == (0, None, None)
