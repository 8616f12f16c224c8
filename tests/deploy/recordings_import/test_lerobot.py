import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.common.runtime.recordings.tables import movement
from tests.deploy.recordings_import.foreign_files import lerobot_set, open_h_set
from tis.common.errors import DataError, InputError
from tis.deploy.recordings_import.found import Wanted
from tis.deploy.recordings_import.lerobot import read_lerobot
from tis.deploy.recordings_import.one_clock import on_one_clock


def test_joints_are_refused_by_name(tmp_path: Path) -> None:
    folder = lerobot_set(tmp_path / "set", movement(50), 3)
    info = json.loads((folder / "meta/info.json").read_text())
    names = [
        "shoulder_pan.pos",
        "shoulder_lift.pos",
        "elbow_flex.pos",
        "wrist_flex.pos",
        "wrist_roll.pos",
        "gripper.pos",
    ]
    for feature in info["features"].values():
        feature["names"] = names
    (folder / "meta/info.json").write_text(json.dumps(info))
    with pytest.raises(InputError, match=r"angles of joints, .* ForwardKinematicsJointsToEE.* wrist_roll\.pos"):
        read_lerobot(folder, Wanted(episode=1))


def test_a_rotation_vector_turns_the_hand(tmp_path: Path) -> None:
    columns = movement(50)
    turn = np.array([0.1, -0.2, 0.3])
    for axis, value in zip("xyz", turn, strict=True):
        columns[f"MTML_q{axis}"] = np.full(50, value)
    folder = lerobot_set(tmp_path / "set", columns, 2)
    names = ("ee.x", "ee.y", "ee.z", "ee.wx", "ee.wy", "ee.wz", "-", "ee.gripper_pos")
    found = read_lerobot(folder, Wanted(episode=1, names={"action": names}))
    orientation = next(stream for stream in found.streams if stream.device == "MTML").orientation
    assert orientation is not None
    half = np.linalg.norm(turn) / 2
    assert orientation[7] == pytest.approx([*(np.sin(half) * turn / (2 * half)), np.cos(half)])


def test_an_action_of_set_points_is_the_arms_and_no_master_is_made_up(tmp_path: Path) -> None:
    found = read_lerobot(open_h_set(tmp_path / "set"), Wanted())
    assert [(stream.device, stream.origin) for stream in found.streams] == [("PSM2", "action"), ("PSM1", "action")]
    assert found.streams[1].position_m[0] == pytest.approx([0.001, 0.04, 0.0])
    assert found.streams[0].gripper_rad == pytest.approx(np.full(60, 0.4))
    assert any("set point" in note and "no master" in note for note in found.notes)


def test_forces_keep_their_units_on_the_way_into_a_table(tmp_path: Path) -> None:
    found = read_lerobot(open_h_set(tmp_path / "set"), Wanted())
    columns = on_one_clock(found, 60, "set").extras
    names = [f"force_torque_{part}" for part in ("fx_n", "fy_n", "fz_n", "tx_n_m", "ty_n_m", "tz_n_m")]
    assert list(columns) == names
    assert columns["force_torque_tx_n_m"] == pytest.approx(np.full(119, 4.0))
    assert any("observation.meta.probe" in note and "left out" in note for note in found.notes)


@pytest.mark.parametrize("damaged", [None, [[np.nan] * 6] * 60, [[0.0] * (1 + k % 2) for k in range(60)], ["a"] * 60])
def test_vectors_that_hold_no_numbers_are_left_out(tmp_path: Path, damaged: list[object] | None) -> None:
    folder = open_h_set(tmp_path / "set")
    file = folder / "data/chunk-000/episode_000000.parquet"
    table, name = pq.read_table(file), "observation.meta.force_torque"
    k = table.column_names.index(name)
    table = table.remove_column(k) if damaged is None else table.set_column(k, name, pa.array(damaged))
    pq.write_table(table, file)
    found = read_lerobot(folder, Wanted())
    assert found.extras == ()
    assert any("observation.meta.force_torque" in note and "left out" in note for note in found.notes)


@pytest.mark.parametrize("version", [2, 3])
def test_an_episode_of_a_set(tmp_path: Path, version: int) -> None:
    columns = movement(50)
    found = read_lerobot(lerobot_set(tmp_path / "set", columns, version), Wanted(episode=1))
    by_device = {stream.device: stream for stream in found.streams}
    assert set(by_device) == {"MTML", "PSM2"}
    assert np.array_equal(by_device["PSM2"].position_m[:, 1], columns["PSM2_y_m"])
    gripper_rad = by_device["MTML"].gripper_rad
    assert gripper_rad is not None
    assert np.array_equal(gripper_rad, columns["MTML_gripper_rad"])
    assert by_device["MTML"].t_ns.tolist() == [round(k / 30 * 1e9) for k in range(50)]


def test_units_are_options(tmp_path: Path) -> None:
    folder = lerobot_set(tmp_path / "set", movement(50), 2)
    wanted = Wanted(episode=1, position_unit="mm", gripper_unit="deg")
    read = read_lerobot(folder, wanted)
    found = read.streams[0]
    assert "action -> poses of MTML, position in mm, gripper in deg" in read.notes  # a quaternion has no unit
    metres = read_lerobot(folder, Wanted(episode=1)).streams[0]
    assert found.position_m == pytest.approx(metres.position_m / 1000)
    assert found.gripper_rad == pytest.approx(np.radians(metres.gripper_rad))  # type: ignore[arg-type]


def test_angles_that_look_like_degrees_are_doubted(tmp_path: Path) -> None:
    """Quaternions, which the table holds, tell nothing of it any longer."""
    columns = movement(50)
    for axis in "xyz":
        columns[f"MTML_q{axis}"] = np.linspace(-34.0, 34.0, 50)
    folder = lerobot_set(tmp_path / "set", columns, 2)
    names = ("ee.x", "ee.y", "ee.z", "ee.roll", "ee.pitch", "ee.yaw", "-", "ee.gripper_pos")
    wanted = Wanted(episode=1, names={"action": names})
    doubts = read_lerobot(folder, wanted).doubts
    assert len(doubts) == 3
    assert all("are these degrees?" in text and "--angle-unit" in text for text in doubts)
    assert not read_lerobot(folder, replace(wanted, angle_unit="deg")).doubts


def test_names_may_be_given(tmp_path: Path) -> None:
    folder = lerobot_set(tmp_path / "set", movement(50), 2)
    info = json.loads((folder / "meta/info.json").read_text())
    for feature in info["features"].values():
        feature["names"] = None
    (folder / "meta/info.json").write_text(json.dumps(info))
    with pytest.raises(InputError, match=r"--names VECTOR=left_x,left_y,\.\.\. names them"):
        read_lerobot(folder, Wanted(episode=1))
    found = read_lerobot(folder, Wanted(episode=1, names={"action": ("right_x", "right_y", "right_z", *"-----")}))
    assert [stream.device for stream in found.streams] == ["MTMR"]
    for names, n in ((("x", "y", "z"), 3), ((*["a"] * 6, "x", "y", "z"), 9)):
        with pytest.raises(DataError, match=rf"--names: must name all 8 elements of action, .* \(got {n}\)"):
            read_lerobot(folder, Wanted(episode=1, names={"action": names}))


def test_what_is_no_set_is_refused(tmp_path: Path) -> None:
    folder = lerobot_set(tmp_path / "set", movement(50), 3)
    with pytest.raises(DataError, match=r"--episode: is not in the data set: it has episodes 0 to 1 \(got 7\)"):
        read_lerobot(folder, Wanted(episode=7))
    file = folder / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file)
    ragged = pa.array([[0.0] * (15 + k % 2) for k in range(len(table))])
    pq.write_table(table.set_column(table.column_names.index("action"), "action", ragged), file)
    with pytest.raises(DataError, match="must hold vectors of one length"):
        read_lerobot(folder, Wanted(episode=1))
    file.write_bytes(b"PAR1")
    with pytest.raises(DataError, match="is no Parquet file, or damaged"):
        read_lerobot(folder, Wanted(episode=1))
    for text in ("{", "[]", '{"features": 3}', "[" * 200_000):
        (folder / "meta/info.json").write_text(text)
        with pytest.raises(DataError, match=r"info\.json: "):
            read_lerobot(folder, Wanted())


def test_vectors_that_unpack_to_too_much_are_refused_unread(tmp_path: Path) -> None:
    folder = lerobot_set(tmp_path / "set", movement(50), 3)
    n_rows = 70_000
    long = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(1000 * n_rows, dtype=np.float32)), 1000)
    index = pa.array(np.zeros(n_rows, dtype=np.int64))
    columns = {"action": long, "observation.state": long, "frame_index": index, "episode_index": index}
    file = folder / "data/chunk-000/file-000.parquet"
    pq.write_table(pa.table(columns | {"timestamp": pa.array(np.zeros(n_rows))}), file)
    assert file.stat().st_size < 1_000_000
    with pytest.raises(DataError, match=r"must hold at most 64000000 numbers to read"):
        read_lerobot(folder, Wanted(episode=0))


def test_missing_numbers_are_named(tmp_path: Path) -> None:
    columns = movement(50)
    columns["PSM2_x_m"][3] = np.nan
    with pytest.raises(DataError, match=r"row 3, column observation\.state\[0\]: must be finite"):
        read_lerobot(lerobot_set(tmp_path / "set", columns, 2), Wanted(episode=1))
