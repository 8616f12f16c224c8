import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from tests.common.runtime.recordings.tables import movement
from tests.deploy.recordings_import.foreign_files import (
    json_mcap,
    ros_mcap,
    ros_mcap_of,
    ros_messages,
    rosbag_of,
    wrenches,
)
from tis.common.errors import DataError
from tis.deploy.recordings_import.files import read_bag, read_mcap
from tis.deploy.recordings_import.found import Found, Rows, Wanted
from tis.deploy.recordings_import.one_clock import on_one_clock

TURN = {"x": 0.0, "y": 0.0, "z": 0.6, "w": 0.8}


def posed(x: float, **more: Any) -> dict[str, Any]:
    return {"pose": {"position": {"x": x, "y": 0, "z": 0}, "orientation": TURN}, **more}


def test_json_of_ros_foxglove_and_others(tmp_path: Path) -> None:
    ros = [(k, posed(k, header={"stamp": {"sec": 5, "nanosec": 100 * k}})) for k in range(3)]
    foxglove = [(k, posed(k, timestamp={"sec": 5, "nsec": 100 * k}, frame_id="")) for k in range(3)]
    plain = [(7 + k, {"position": {"x": k, "y": 0, "z": 0}}) for k in range(3)]
    jaw = [(7 + k, {"position": [0.1 * k]}) for k in range(3)]
    file = json_mcap(
        tmp_path / "a.mcap",
        {
            "/MTML/measured_cp": ros,
            "/PSM2/setpoint_cp": foxglove,
            "/PSM1/setpoint_cp": plain,
            "/PSM1/jaw/measured_js": jaw,
        },
    )
    found = read_mcap(file, Wanted())
    by_device = {stream.device: stream for stream in found.streams}
    for device in ("MTML", "PSM2"):
        assert by_device[device].t_ns.tolist() == [5 * 10**9 + 100 * k for k in range(3)]
        orientation = by_device[device].orientation
        assert orientation is not None
        assert orientation[0] == pytest.approx([0, 0, 0.6, 0.8])
    assert by_device["PSM1"].orientation is None
    assert by_device["PSM1"].t_ns.tolist() == [7, 8, 9]
    assert by_device["PSM1"].position_m[:, 0].tolist() == [0, 1, 2]
    assert found.jaws[0].gripper_rad == pytest.approx([0.0, 0.1, 0.2])
    assert "/PSM1/setpoint_cp: 3 messages hold no instant; that of the recorder counts" in found.notes


@pytest.mark.parametrize("form", ["mcap", "bag"])
def test_a_wrench_becomes_columns_with_units(tmp_path: Path, form: str) -> None:
    columns = movement(20)
    topic = "/PSM2/body/measured_cf"
    messages = ros_messages(columns) + wrenches(topic, [0.0, 0.1, 0.2, 0.3])
    found: Found
    if form == "mcap":
        found = read_mcap(ros_mcap_of(tmp_path / "a.mcap", messages), Wanted())
    else:
        found = read_bag(rosbag_of(tmp_path / "bag", messages), Wanted())
    assert [(extra.column, extra.unit) for extra in found.extras][::3] == [
        ("PSM2_body_measured_cf_force_x_n", "N"),
        ("PSM2_body_measured_cf_torque_x_n_m", "N m"),
    ]
    force_n = on_one_clock(found, 30, "a").extras["PSM2_body_measured_cf_force_x_n"]
    assert force_n[:4] == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])
    assert np.isnan(force_n[-1])  # nothing was felt after 0.3 s


def test_messages_of_another_kind_are_counted_as_unreadable() -> None:
    rows = Rows(False, width=6)
    rows.take(lambda: (1, (0.1,), True))
    rows.take(lambda: (2, (0.0,) * 6, True))
    assert rows.n_undecodable == 1
    assert rows.arrays()[1].shape == (1, 6)


def test_messages_are_sorted_and_each_instant_counts_once(tmp_path: Path) -> None:
    order = [3, 1, 1, 2, 0]
    messages = [(k, posed(at, sample_ns=at)) for k, at in enumerate(order)]
    found = read_mcap(json_mcap(tmp_path / "a.mcap", {"/MTML/measured_cp": messages}), Wanted())
    assert found.streams[0].t_ns.tolist() == [0, 1, 2, 3]
    assert found.streams[0].position_m[:, 0].tolist() == [0, 1, 2, 3]
    assert "/MTML/measured_cp: 2 messages are earlier than the one before; they are sorted" in found.notes
    assert "/MTML/measured_cp: 1 messages repeat an instant and are left out" in found.notes


@pytest.mark.parametrize(
    "broken",
    [b"{", b"[]", b"{}", b'{"position": {"x": true, "y": 0, "z": 0}}', b'{"position": {"x": 0, "y": 0}}',
     b'{"sample_ns": 1e300, "position": {"x": 0, "y": 0, "z": 0}}',
     b'{"sample_ns": 99999999999999999999, "position": {"x": 0, "y": 0, "z": 0}}',
     b'{"position": {"x": 1' + b"0" * 400 + b', "y": 0, "z": 0}}', b"[" * 100_000],
)  # fmt: skip
def test_messages_that_cannot_be_read_are_counted_and_refused(tmp_path: Path, broken: bytes) -> None:
    messages: list[tuple[int, object]] = [(k, posed(k, sample_ns=k)) for k in range(3)]
    file = json_mcap(tmp_path / "a.mcap", {"/MTML/measured_cp": [*messages, (9, broken)]})
    with pytest.raises(DataError, match=r"cannot be read; --skip-unreadable leaves them out \(got 1\)"):
        read_mcap(file, Wanted())
    found = read_mcap(file, Wanted(skips_unreadable=True))
    assert len(found.streams[0].t_ns) == 3
    assert "/MTML/measured_cp: 1 messages cannot be read and are left out" in found.notes


@pytest.mark.parametrize("encoding", ["cdr", "protobuf", ""])
def test_a_topic_s_channel_that_has_no_schema_is_counted(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "a.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        known, unknown = (writer.register_channel("/MTML/measured_cp", kind, 0) for kind in ("json", encoding))
        for k in range(3):
            writer.add_message(known, k, json.dumps(posed(k)).encode(), k)
            writer.add_message(unknown, k, b"", k)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(DataError, match=r"--skip-unreadable leaves them out \(got 3\)"):
        read_mcap(file, Wanted())
    found = read_mcap(file, Wanted(skips_unreadable=True))
    assert found.streams[0].position_m[:, 0].tolist() == [0, 1, 2]


def test_messages_of_ros_that_are_cut_short_are_counted(tmp_path: Path) -> None:
    file = ros_mcap(tmp_path / "a.mcap", {name: np.asarray(v) for name, v in movement(5).items()})
    content = file.read_bytes()
    assert read_mcap(file, Wanted()).streams[0].t_ns.size == 5
    for cut in (len(content) // 2, len(content) - 20, 30):
        file.write_bytes(content[:cut])
        with pytest.raises(DataError, match=r"is damaged: .*; `tis recover"):
            read_mcap(file, Wanted())


def test_quaternions_of_norm_zero_are_refused(tmp_path: Path) -> None:
    turn = dict.fromkeys("xyzw", 0.0)
    messages = [(k, {"position": {"x": 0, "y": 0, "z": 0}, "orientation": turn, "sample_ns": k}) for k in range(3)]
    with pytest.raises(DataError, match=r"/MTML/measured_cp: row 0: must be a quaternion of norm 1"):
        read_mcap(json_mcap(tmp_path / "a.mcap", {"/MTML/measured_cp": messages}), Wanted())
