import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.common.runtime.recordings.tables import movement
from tests.deploy.recordings_import.foreign_files import lerobot_set
from tis.common.errors import DataError, InputError
from tis.deploy.recordings_import.found import Wanted
from tis.deploy.recordings_import.lerobot import elements_of, names_in, read_lerobot


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["left_x", "left_y", "left_z", "left_gripper"], ("PSM2", (0, 1, 2), None, None, 3)),
        (["x", "y", "z", "roll", "pitch", "yaw", "jaw"], ("PSM2", (0, 1, 2), None, (3, 4, 5), 6)),
        (["psm1_qw", "psm1_qx", "psm1_qy", "psm1_qz", "psm1_x", "psm1_y", "psm1_z"],
         ("PSM1", (4, 5, 6), (1, 2, 3, 0), None, None)),
        (["PSM2.position.x", "PSM2.position.y", "PSM2.position.z", "PSM2.orientation.x", "PSM2.orientation.y",
          "PSM2.orientation.z", "PSM2.orientation.w", "PSM2.jaw"], ("PSM2", (0, 1, 2), (3, 4, 5, 6), None, 7)),
        (["rightArmX", "rightArmY", "rightArmZ"], ("PSM1", (0, 1, 2), None, None, None)),
    ],
)  # fmt: skip
def test_names_of_elements_are_understood(names: list[str], expected: tuple[Any, ...]) -> None:
    [found] = elements_of(names, is_action=False)
    assert (found.device, found.position, found.quaternion, found.euler, found.gripper) == expected


def test_an_action_is_the_masters_and_joints_are_no_poses() -> None:
    names = [f"{side}_{axis}" for side in ("left", "right") for axis in "xyz"]
    assert [each.device for each in elements_of(names, is_action=True)] == ["MTML", "MTMR"]
    assert elements_of(["shoulder_pan.pos", "elbow_flex.pos", "gripper.pos"], is_action=True) == []


def test_names_stand_in_a_list_or_a_map() -> None:
    assert names_in({"names": ["a", "b"]}) == ("a", "b")
    assert names_in({"names": {"motors": ["a", "b"]}}) == ("a", "b")
    assert names_in({"names": None}) == names_in({"names": [1, 2]}) == names_in({}) == ()


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
    found = read_lerobot(folder, wanted).streams[0]
    metres = read_lerobot(folder, Wanted(episode=1)).streams[0]
    assert found.position_m == pytest.approx(metres.position_m / 1000)
    assert found.gripper_rad == pytest.approx(np.radians(metres.gripper_rad))  # type: ignore[arg-type]


def test_names_may_be_given(tmp_path: Path) -> None:
    folder = lerobot_set(tmp_path / "set", movement(50), 2)
    info = json.loads((folder / "meta/info.json").read_text())
    for feature in info["features"].values():
        feature["names"] = None
    (folder / "meta/info.json").write_text(json.dumps(info))
    with pytest.raises(InputError, match=r"--names VECTOR=left_x,left_y,\.\.\. names them"):
        read_lerobot(folder, Wanted(episode=1))
    found = read_lerobot(folder, Wanted(episode=1, names={"action": ("right_x", "right_y", "right_z")}))
    assert [stream.device for stream in found.streams] == ["MTMR"]
    with pytest.raises(DataError, match="action: must have the 9 elements that are named"):
        read_lerobot(folder, Wanted(episode=1, names={"action": (*["a"] * 6, "x", "y", "z")}))


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
