from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.common.runtime.recordings.tables import movement
from tests.deploy.recordings_import.foreign_files import frames, odometry, ros_mcap_of, rosbag_of
from tis.common.errors import DataError, InputError
from tis.deploy.recordings_import.command import read
from tis.deploy.recordings_import.files import pair_topics, take_pairs
from tis.deploy.recordings_import.found import Wanted, rows_of

Messages = Sequence[tuple[str, str, int, Any]]
Write = Callable[[Path, Messages], Path]

COLUMNS = movement(20)
PLACES = np.stack([COLUMNS[f"MTML_{axis}_m"] for axis in "xyz"], axis=1)
TURNS = np.stack([COLUMNS[f"MTML_q{axis}"] for axis in "xyzw"], axis=1)


def _mcap(folder: Path, messages: Messages) -> Path:
    return ros_mcap_of(folder.with_suffix(".mcap"), messages)


@pytest.fixture(params=[rosbag_of, _mcap], ids=["rosbag2", "mcap"])
def write(request: pytest.FixtureRequest) -> Write:
    made: Write = request.param
    return made


@pytest.mark.parametrize("kind", ["nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseWithCovarianceStamped"])
def test_a_single_topic_of_poses_is_the_left_masters(tmp_path: Path, write: Write, kind: str) -> None:
    found = read(write(tmp_path / "a", odometry(COLUMNS, kind)), Wanted())
    [stream] = found.streams
    assert (stream.device, stream.origin) == ("MTML", "/odom")
    assert np.array_equal(stream.position_m, PLACES)
    assert stream.orientation == pytest.approx(TURNS)
    assert found.notes[0] == f"/odom: 20 of {kind} -> poses of MTML"


def test_a_pair_of_frames_is_a_topic(tmp_path: Path, write: Write) -> None:
    file = write(tmp_path / "a", frames(COLUMNS))
    found = read(file, Wanted(topics={"MTML": "/tf:odom:base_link", "PSM2": "/tf:base_link:tool"}))
    by_device = {stream.device: stream for stream in found.streams}
    assert np.array_equal(by_device["MTML"].position_m, PLACES)
    assert np.array_equal(by_device["PSM2"].position_m[:, 0], COLUMNS["PSM2_x_m"])
    assert by_device["MTML"].orientation == pytest.approx(TURNS)


def test_pairs_are_listed_where_none_or_another_is_named(tmp_path: Path, write: Write) -> None:
    file = write(tmp_path / "a", frames(COLUMNS))
    with pytest.raises(DataError, match=r"its topics: /tf:odom:base_link .*, /tf:base_link:tool .*, /tf_static:"):
        read(file, Wanted())
    with pytest.raises(InputError, match="of poses: /tf:odom:base_link, /tf:base_link:tool, /tf_static:base_link"):
        read(file, Wanted(topics={"MTML": "/tf:map:odom"}))
    with pytest.raises(InputError, match="must be a topic of poses: /tf:odom:base_link, /tf:base_link:tool"):
        read(file, Wanted(topics={"MTML": "/tf"}))


def test_a_single_pair_that_moves_needs_no_name(tmp_path: Path, write: Write) -> None:
    master = {name: values for name, values in COLUMNS.items() if "PSM2" not in name}
    [stream] = read(write(tmp_path / "a", frames(master)), Wanted()).streams
    assert (stream.device, stream.origin, len(stream.t_ns)) == ("MTML", "/tf:odom:base_link", 20)


def test_transforms_that_cannot_be_read_are_counted() -> None:
    def broken() -> Any:
        raise ValueError

    rows = rows_of({"MTML": "/tf:odom:base_link", "PSM2": "/other"}, {})
    assert pair_topics("/tf", "tf2_msgs/msg/TFMessage", [broken]) == []
    take_pairs("/tf", broken, 0, rows)
    assert [into.n_undecodable for into in rows.values()] == [1, 0]
