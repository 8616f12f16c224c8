"""Tables of a run, against its logs read record by record with another reader."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from tests.log_reader import LogReader
from tests.nodes import a_pose
from tis.common.channels import hand_channels
from tis.common.errors import DataError
from tis.common.messages import Pose, Quaternion, encode
from tis.common.scenario import Scenario
from tis.common.sources.jigsaws import COLUMNS, parse_trial, pose_track
from tis.deploy.export import jigsaws
from tis.deploy.export.export import write_csv
from tis.deploy.export.jigsaws import jigsaws_files
from tis.deploy.export.tables import tables
from tis.deploy.logs.viewer.drawn import RunTopics
from tis.deploy.report import load

TRIALS = Path("Suturing/kinematics/AllGestures")


def _records(path: Path, topic: str) -> list[dict[str, Any]]:
    return [json.loads(m.data) for name, m in LogReader(path).messages() if name == topic]


@pytest.fixture(scope="module")
def found(run_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, str]]]:
    """Return every table as it is read back from CSV."""
    out = tmp_path_factory.mktemp("csv")
    rows = {}
    for name, table in tables(load(run_dir)):
        write_csv(out / f"{name}.csv", table)
        with (out / f"{name}.csv").open(newline="") as file:
            rows[name] = list(csv.DictReader(file))
    return rows


def test_ticks_and_truth_are_the_logs_own(found: dict[str, list[dict[str, str]]], run_dir: Path) -> None:
    ticks = [row for row in found["ticks"] if row["side"] == "patient"]
    logged = _records(run_dir / "patient.mcap", "/tis/ticks")
    assert [(int(row["tick"]), int(row["begin_ns"]), row["missed"]) for row in ticks] == [
        (row["tick"], row["begin_ns"], str(int(row["missed"]))) for row in logged
    ]
    for hand in ("left", "right"):
        expected = [row for row in _records(run_dir / "surgeon.mcap", "/tis/truth") if row["hand"] == hand]
        truth = [row for row in found["truth"] if row["hand"] == hand]
        assert [float(row["position_y_m"]) for row in truth] == [row["position_m"]["y"] for row in expected]


def test_estimates_without_a_position_are_empty_fields(found: dict[str, list[dict[str, str]]], run_dir: Path) -> None:
    expected = _records(run_dir / "patient.mcap", "/tis/estimates/moesp_kf")
    rows = [row for row in found["estimates"] if row["estimator"] == "moesp_kf"]
    assert rows[0]["position_x_m"] == ""
    assert [row["position_x_m"] for row in rows] == [
        "" if row["position_m"] is None else repr(row["position_m"]["x"]) for row in expected
    ]


def test_forces_are_those_on_the_hand_and_on_the_tool(touch_dir: Path) -> None:
    found = {name: table[0]() for name, table in tables(load(touch_dir)) if name in ("forces", "contacts")}
    for side, topic, name in (("surgeon", "tis/MTML/servo_cf", "forces"), ("patient", "/tis/contacts", "contacts")):
        logged = _records(touch_dir / f"{side}.mcap", topic)
        for axis in "xyz":
            assert found[name][f"force_{axis}_n"].tolist() == [row["force_n"][axis] for row in logged]


def test_messages_and_packets_are_complete(found: dict[str, list[dict[str, str]]], run_dir: Path) -> None:
    for side in ("surgeon", "patient"):
        logged = [t for t, _ in LogReader(run_dir / f"{side}.mcap").messages() if not t.startswith("/")]
        end, table = {"surgeon": ("/predicted_cp", "displays"), "patient": ("/servo_cp", "set_points")}[side]
        local = [topic for topic in logged if topic.endswith(end)]
        assert sum(row["side"] == side for row in found["messages"]) == len(logged) - len(local)
        assert len(found[table]) == len(local) > 0
    counters = {row["name"]: int(row["value"]) for row in found["netem_counters"]}
    for direction in ("forward", "feedback"):
        its = [row for row in found["fates"] if row["direction"] == direction]
        assert len(its) == counters[f"{direction}.offered"]
        assert {row["outcome"] for row in its} <= {"deliver", "loss"}
        left = [row for row in found["releases"] if row["direction"] == direction and row["departure"] == "released"]
        assert len(left) == counters[f"{direction}.released"]


def test_parquet_holds_what_csv_holds(found: dict[str, list[dict[str, str]]], run_dir: Path, tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed: the extra parquet")
    from tis.deploy.export.export import write_parquet

    for name, table in tables(load(run_dir)):
        write_parquet(tmp_path / f"{name}.parquet", table)
        read = pq.read_table(tmp_path / f"{name}.parquet")
        assert read.column_names == list(found[name][0])
        assert read.num_rows == len(found[name])
    ticks = pq.read_table(tmp_path / "ticks.parquet")
    assert [int(row["due_ns"]) for row in found["ticks"]] == ticks["due_ns"].to_pylist()
    assert [row["side"] for row in found["ticks"]] == ticks["side"].to_pylist()


def test_jigsaws_trials_read_back_as_what_was_sent(run_dir: Path, scenario: Scenario) -> None:
    files = dict(jigsaws_files(run_dir, scenario, RunTopics.of(scenario, {})))
    assert set(files) == {TRIALS / "Suturing_R001.txt", TRIALS / "Suturing_R002.txt"}
    sent = parse_trial(files[TRIALS / "Suturing_R001.txt"], "R001")
    assert sent.shape == (scenario.n_samples, 76)
    for device, suffix in (("MTML", "measured_cp"), ("PSM2", "setpoint_cp"), ("MTMR", "measured_cp")):
        poses = _records(run_dir / "surgeon.mcap", f"tis/{device}/{suffix}")
        track = pose_track(sent, device, "R001")
        expected = np.array([[pose["position_m"][axis] for axis in "xyz"] for pose in poses])
        turned = np.array([[pose["orientation"][axis] for axis in "xyzw"] for pose in poses])
        assert np.abs(track.position_m - expected).max() <= 1e-8
        assert np.abs(np.sum(track.orientation * turned, axis=1)) == pytest.approx(1, abs=1e-6)


def test_the_second_jigsaws_trial_is_what_the_patient_made_of_it(run_dir: Path, scenario: Scenario) -> None:
    files = dict(jigsaws_files(run_dir, scenario, RunTopics.of(scenario, {})))
    rows = parse_trial(files[TRIALS / "Suturing_R002.txt"], "R002")
    key = hand_channels("left", "PSM2").estimated.key("tis")
    answers = {pose["tick"]: pose["position_m"]["x"] for pose in _records(run_dir / "patient.mcap", key)}
    first = min(answers)
    x = rows[:, COLUMNS["PSM2"].position][:, 0]
    assert first > 0
    assert x[:first] == pytest.approx([answers[first]] * first, abs=1e-8)
    assert [x[tick] for tick in sorted(answers)] == pytest.approx([answers[t] for t in sorted(answers)], abs=1e-8)


@pytest.mark.parametrize(
    "turn", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1e-9), (3.0, 0.0, 0.0, 0.0), (1e9, 0.0, 0.0, 1.0)]
)
def test_an_orientation_that_is_no_rotation_is_one_line(turn: tuple[float, float, float, float]) -> None:
    """A log is only as sound as who wrote it; scipy refuses a quaternion without length."""
    x, y, z, w = turn
    pose = replace(a_pose(0), orientation=Quaternion(x=x, y=y, z=z, w=w))
    with pytest.raises(DataError, match="tis/PSM2/setpoint_cp"):
        jigsaws._pose(Pose, encode(pose), "tis/PSM2/setpoint_cp")
