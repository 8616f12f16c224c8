"""Sums of orientation errors: by hand, and against the summary of the same twin with logs."""

from pathlib import Path

import numpy as np
import pytest

from tis.common.channels import Side
from tis.common.runtime.recordings import load_recording
from tis.common.sources.trajectory import Array, HandRecording, PoseTrack, Recording
from tis.deploy.compare.cells.measured import MeasuredMethod
from tis.deploy.compare.cells.scores import unlogged_scores
from tis.deploy.compare.cells.sums import wrist_sums
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.subjects.tracking import HandTrack
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, drive
from tis.patient_side.orientation.wrist import WristEstimate
from tis.patient_side.playout import SourceBuffer

MS = 1_000_000


def about_z(degrees: float) -> Array:
    half = np.radians(degrees) / 2
    return np.array([0.0, 0.0, np.sin(half), np.cos(half)])


class Listed:
    """A method with a list of estimates."""

    name = "hold"

    def __init__(self, *estimates: WristEstimate) -> None:
        self.left = list(estimates)

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:
        return self.left.pop(0)


def measured(*estimates: WristEstimate) -> MeasuredMethod:
    method = MeasuredMethod(Listed(*estimates))  # type: ignore[arg-type]
    for _ in estimates:
        method.estimate(SourceBuffer(4), 0.0)
    return method


def test_errors_of_a_turning_arm_by_hand() -> None:
    """The arm turns by 9 degrees and opens by 0.1 rad each 100 ms, from row 2 on; of four ticks three are scored."""
    angles = [0.0, 0.0, *(9.0 * k for k in range(5))]
    follower = PoseTrack(
        np.zeros((7, 3)), np.array([about_z(a) for a in angles]), np.array([0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.4])
    )
    hand = HandRecording("left", "PSM2", follower, follower)
    recording = Recording("by hand", 10, (hand,), 2, "")
    t_ns = np.array([50, 150, 250, 350], dtype=np.int64) * MS  # truth: 4.5, 13.5, 22.5 and 31.5 degrees
    scored = np.array([False, True, True, True])
    track = HandTrack(t_ns, np.arange(4), np.zeros((4, 3)), {}, scored, {})
    held = measured(*(WristEstimate(about_z(9.0 * k), None, 0.1 * k) for k in range(4)))
    small, large = np.eye(3) * np.radians(1.0) ** 2, np.eye(3) * np.radians(9.0) ** 2
    other = measured(
        WristEstimate(None),
        WristEstimate(about_z(12.5), small, 0.15, 0.01),
        WristEstimate(None),
        WristEstimate(-about_z(22.5), large, 0.0, 0.01),
    )
    found = wrist_sums(track, recording, hand, {"hold": held, "tangent_ls": other})
    assert np.degrees(np.sqrt(found["hold"]["sse_rad2"])) == pytest.approx(np.sqrt(3) * 4.5)
    assert found["hold"]["sse_gripper_rad2"] == pytest.approx(3 * 0.05**2)
    one = found["tangent_ls"]
    assert np.degrees(np.sqrt(one["sse_rad2"])) == pytest.approx(np.sqrt(1 + 4.5**2 + 81))
    assert one["sse_gripper_rad2"] == pytest.approx(0.05**2 + 0.35**2)
    assert (one["n_scored"], one["n_missing"]) == (3, 1)
    assert (one["n_covered"], one["n_ellipsoids"]) == (2, 2)
    assert (one["n_gripper_covered"], one["n_gripper_intervals"]) == (1, 2)


@pytest.mark.parametrize(("turn_deg", "open_rad"), [(0.0, 0.0), (9.0, 0.0), (0.0, 0.1)])
def test_what_the_recording_lacks_is_not_scored(turn_deg: float, open_rad: float) -> None:
    rows = np.arange(7.0)
    follower = PoseTrack(np.zeros((7, 3)), np.array([about_z(turn_deg * k) for k in rows]), open_rad * rows)
    hand = HandRecording("left", "PSM2", follower, follower)
    t_ns = np.arange(4, dtype=np.int64) * 100 * MS
    track = HandTrack(t_ns, np.arange(4), np.zeros((4, 3)), {}, np.ones(4, dtype=np.bool_), {})
    stated = [WristEstimate(about_z(0.0), np.eye(3), 0.0, 0.01)] * 4
    (sums,) = wrist_sums(track, Recording("", 10, (hand,), 0, ""), hand, {"hold": measured(*stated)}).values()
    assert [sums[name] for name in ("n_scored", "n_ellipsoids")] == [4 * (turn_deg > 0)] * 2
    assert [sums[name] for name in ("n_gripper_scored", "n_gripper_intervals")] == [4 * (open_rad > 0)] * 2


def test_sums_are_those_of_the_summary_of_a_logged_twin() -> None:
    settings = ("estimators=[damped_velocity]", "active_estimator=damped_velocity", "identification.order=2")
    scenario = resolve("default", ("source.hands=[left, right]", "duration_s=6", *settings), None, None)
    recording = load_recording(scenario)
    scores = unlogged_scores(scenario, recording)
    nodes, models, _ = build_sides(scenario, recording=recording)
    memories: dict[Side, MemoryLog] = {side: MemoryLog(side) for side in nodes}
    drive(scenario, nodes, memories)
    logs = RunLogs(Path(), {side: memory.log for side, memory in memories.items()})
    summary = build_summary(logs, scenario, models, "twin", None, "")
    for hand, sums in scores.hands.items():
        for name, entry in sums["orientation"].items():
            expected, gripper = summary["orientation_deg"][hand][name], summary["gripper_rad"][hand][name]
            n = entry["n_scored"]
            assert n == expected["n_scored"] > 50
            assert np.degrees(np.sqrt(entry["sse_rad2"] / n)) == pytest.approx(expected["rms"], rel=1e-9)
            assert np.sqrt(entry["sse_gripper_rad2"] / n) == pytest.approx(gripper["rms"], rel=1e-9)
