from math import cos, pi, radians, sin
from pathlib import Path

import numpy as np
import pytest

from tests.deploy.report.hand_made import ARM, MS, a_scenario, estimate, message, write_run
from tis.common.messages import Quaternion, Vector3
from tis.common.node import Record
from tis.common.records import ORIENTATIONS, TRUTH, OrientationNote, TruthRow
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.subjects.orientation import (
    WristTrack,
    gripper_rad,
    orientation_by_age,
    orientation_deg,
    orientation_table,
    wrist_track,
)
from tis.deploy.report.subjects.tracking import HandTrack, track_of_hand


def turning(k: int, gripper: float | None = 0.0, still: bool = False) -> Record:
    """The arm turns by 9 degrees about z each 100 ms, past half a turn too, and opens by 0.01 rad; or it is still."""
    angle = 0.0 if still else radians(9 * k) if k <= 20 else radians(9 * k) - 2 * pi
    note = TruthRow(
        hand="left",
        index=k,
        sample_ns=100 * k * MS,
        position_m=Vector3(x=0.001 * k, y=0, z=0),
        rotation_rad=Vector3(x=0, y=0, z=angle),
        gripper_rad=None if gripper is None else 0.0 if still else 0.01 * k,
    )
    return Record(TRUTH, note.sample_ns, note)


def stated(tick: int, t_ms: int, method: str, degrees: float | None, std_deg: float | None = None) -> Record:
    """A method's estimate of a rotation about z, and of a gripper that is open by 0.01 rad for each 9 degrees."""
    half = 0.0 if degrees is None else radians(degrees) / 2
    std = None if std_deg is None else radians(std_deg)
    note = OrientationNote(
        tick=tick,
        t_ns=t_ms * MS,
        hand="left",
        method=method,
        orientation=None if degrees is None else Quaternion(x=0, y=0, z=sin(half), w=cos(half)),
        std_rad=None if std is None else Vector3(x=std, y=std, z=std),
        gripper_rad=None if degrees is None else degrees / 900,
        gripper_std_rad=std,
        step_ns=1000 * (tick + 1),
    )
    return Record(f"{ORIENTATIONS}/{method}", note.t_ns, note)


def read(
    tmp_path: Path, patient: list[Record], gripper: float | None = 0.0, still: bool = False
) -> tuple[RunLogs, HandTrack, WristTrack]:
    rows = [estimate(k, 2100 + 100 * k, "hold", (0.02, 0, 0)) for k in range(4)]
    arrivals = [message(ARM, k, 100 * k, log_ms=100 * k + 50, sample_ms=100 * k) for k in range(24)]
    surgeon = [turning(k, gripper, still) for k in range(40)]
    logs = write_run(tmp_path, surgeon=surgeon, patient=[*arrivals, *rows, *patient])
    track = track_of_hand(logs, a_scenario(), "left")
    return logs, track, wrist_track(logs, a_scenario(), track, "left")


def test_errors_of_a_turning_arm_are_degrees_by_hand(tmp_path: Path) -> None:
    # truth at the ticks: 189, 198, 207 and 216 degrees
    held = [stated(k, 2100 + 100 * k, "hold", 180) for k in range(4)]
    ahead = [stated(k, 2100 + 100 * k, "tangent_ls", d, 3.0) for k, d in enumerate((189, 201, 207, 212))]
    logs, track, wrist = read(tmp_path, [*held, *ahead])
    found = orientation_deg(logs, track, wrist, "left")
    assert list(found) == ["hold", "tangent_ls"]
    hold_rms = ((9**2 + 18**2 + 27**2 + 36**2) / 4) ** 0.5
    assert found["hold"]["rms"] == pytest.approx(hold_rms, abs=1e-6)
    assert found["hold"]["max"] == pytest.approx(36, abs=1e-6)
    assert found["hold"]["ratio_to_hold"] == pytest.approx(1.0)
    assert "nees" not in found["hold"].as_json()
    assert found["tangent_ls"]["rms"] == pytest.approx(2.5, abs=1e-6)
    assert found["tangent_ls"]["ratio_to_hold"] == pytest.approx(2.5 / hold_rms, rel=1e-6)
    # squares about z: 0, 1, 0 and 16/9 of the stated 3 degrees
    assert found["tangent_ls"]["nees"]["mean"][2] == pytest.approx((1 + 16 / 9) / 4, rel=1e-6)
    assert found["tangent_ls"]["nees"]["n"] == 4
    assert found["tangent_ls"]["step_us"] == {"p50": 2.0, "p99": 4.0}
    grippers = gripper_rad(track, wrist)
    assert grippers["hold"]["rms"] == pytest.approx(hold_rms / 900, rel=1e-6)
    assert grippers["tangent_ls"]["ratio_to_hold"] == pytest.approx(2.5 / hold_rms, rel=1e-6)


def test_a_missing_estimate_counts_with_holds(tmp_path: Path) -> None:
    held = [stated(k, 2100 + 100 * k, "hold", 180) for k in range(4)]
    ahead = [stated(k, 2100 + 100 * k, "tangent_ls", d) for k, d in enumerate((189, None, 207))]
    logs, track, wrist = read(tmp_path, [*held, *ahead])
    found = orientation_deg(logs, track, wrist, "left")["tangent_ls"]
    assert found["n_scored"] == 4
    assert found["n_missing"] == 2
    assert found["rms"] == pytest.approx(((18**2 + 36**2) / 4) ** 0.5, abs=1e-6)


def test_errors_are_binned_by_the_age_of_the_newest_sample(tmp_path: Path) -> None:
    n = 24
    rows = [estimate(4 + k, 2500 + 20 * k, "hold", (0.02, 0, 0)) for k in range(n)]
    held = [stated(4 + k, 2500 + 20 * k, "hold", 216 + 1.8 * k) for k in range(n)]  # 9 degrees behind at each tick
    logs, track, wrist = read(tmp_path, [*rows, *held])
    found = orientation_by_age(logs, track, wrist, "left")
    assert all(rms == pytest.approx(9.0, abs=1e-6) for rms in found["hold"]["rms_deg"])


def test_logs_from_before_orientations_were_estimated_have_no_scores(tmp_path: Path) -> None:
    logs, track, wrist = read(tmp_path, [])
    assert orientation_deg(logs, track, wrist, "left") == {}
    assert gripper_rad(track, wrist) == {}


def test_without_the_grippers_truth_only_orientations_are_scored(tmp_path: Path) -> None:
    held = [stated(k, 2100 + 100 * k, "hold", 180) for k in range(4)]
    logs, track, wrist = read(tmp_path, held, gripper=None)
    assert orientation_deg(logs, track, wrist, "left")["hold"]["n_scored"] == 4
    assert gripper_rad(track, wrist)["hold"]["n_scored"] == 0
    assert gripper_rad(track, wrist)["hold"]["rms"] is None


def test_a_recording_without_orientation_and_gripper_has_no_errors_of_them(tmp_path: Path) -> None:
    held = [stated(k, 2100 + 100 * k, "hold", 0) for k in range(4)]
    stating = [stated(k, 2100 + 100 * k, "tangent_ls", 0, 3.0) for k in range(4)]
    logs, track, wrist = read(tmp_path, [*held, *stating], still=True)
    turns, openings = orientation_deg(logs, track, wrist, "left"), gripper_rad(track, wrist)
    assert not any(np.isfinite(each).any() for each in wrist.turns_deg.values())  # nothing is drawn over time
    assert not any(bins.n for bins in orientation_by_age(logs, track, wrist, "left").values())
    assert [each["rms"] for each in (*turns.values(), *openings.values())] == [None] * 4
    assert not orientation_table(turns, openings, "left hand", "hold").rows
