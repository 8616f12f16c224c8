import hashlib
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.common.runtime.recordings.tables import movement, scenario_of
from tests.deploy.commands import call_in_one_line
from tests.deploy.recordings_import.foreign_files import json_mcap, lerobot_set, open_h_set, ros_mcap, rosbag
from tis.common.extras import GET_PARQUET, GET_ROSBAG
from tis.common.runtime.recordings import load_recording, synthetic_trials
from tis.common.scenario.table_source import TableSource
from tis.deploy.tools.synth import write_trials


def test_an_import_lists_what_it_found_and_says_how_to_play_it(tmp_path: Path) -> None:
    file, table = ros_mcap(tmp_path / "a.mcap", movement(461)), tmp_path / "ann_1.parquet"
    code, out, err = call_in_one_line("import", str(file), "--out", str(table), "--task", "Peg", "--person", "Ann")
    assert (code, err) == (0, "")
    assert "/MTML/measured_cp: 461 of geometry_msgs/msg/PoseStamped -> poses of MTML" in out
    assert "/MTML/measured_cp: 461 poses in 15.333 s, 30 a second; no gap" in out
    assert f"{table}: 461 rows of MTML, PSM2, 15.333 s at 30 a second" in out
    assert f"--set 'source={{kind: table, path: {table}, hands: [left]}}' --set" in out
    about = json.loads(pq.read_schema(table).metadata[b"tis"])
    assert (about["kind"], about["from"], about["task"], about["person"]) == ("mcap", "a.mcap", "Peg", "Ann")
    assert about["sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
    recording = load_recording(scenario_of(table))
    assert (recording.label, recording.person, recording.warnings) == ("Peg ann_1", "Ann", ())


def test_a_set_of_open_h_is_a_table_of_arms_with_forces_beside(tmp_path: Path) -> None:
    table = tmp_path / "t.parquet"
    code, out, err = call_in_one_line("import", str(open_h_set(tmp_path / "set", 300)), "-o", str(table))
    assert code == 0, err
    assert "action: the set points of PSM1, PSM2" in out
    schema = pq.read_schema(table)
    assert schema.names[0] == "time_s"
    assert schema.names[-1] == "force_torque_tz_n_m"
    assert json.loads(schema.metadata[b"tis"])["units"]["force_torque_fx_n"] == "N"
    recording = load_recording(scenario_of(table, hands=("left", "right")))
    assert [hand.arm for hand in recording.hands] == ["PSM2", "PSM1"]
    assert all("has no columns of MTM" in warning for warning in recording.warnings)


def test_synthetic_movement_stays_so_in_what_is_shown(tmp_path: Path) -> None:
    (trial,) = write_trials(tmp_path / "t", 1, "Suturing", 1, 20.0, "a test")
    table, text = tmp_path / "t.parquet", tmp_path / "t.csv"
    for file in (table, text):
        code, _, err = call_in_one_line("import", str(trial), "--out", str(file))
        assert (code, "the movement is synthetic, which a .csv file cannot say" in err) == (0, file == text)
    source = scenario_of(table).source
    assert isinstance(source, TableSource)
    assert synthetic_trials(source, ["t.parquet", "t.csv"]) == ("t.parquet",)
    source_text = f"source={{kind: table, path: {table}, hands: [left]}}"
    words = ("--set", source_text, "--set", "identification.train_samples=300", "--duration-s", "4", "--no-merge")
    code, out, err = call_in_one_line("twin", "default", *words, "--run-dir", str(tmp_path / "run"))
    assert code == 0, err
    assert "(twin, synthetic table t, left hand)" in out
    page = (tmp_path / "run" / "report.html").read_text()
    assert "synthetic movement, not a recording of a person" in page


def test_a_device_without_orientation_or_gripper_is_told(tmp_path: Path) -> None:
    messages = [(33_333_333 * k, {"position": {"x": 0.001 * k, "y": 0, "z": 0}}) for k in range(20)]
    file = json_mcap(tmp_path / "a.mcap", {"/PSM2/measured_cp": messages})
    code, _, err = call_in_one_line("import", str(file), "-o", str(tmp_path / "t.csv"))
    assert code == 0
    assert "warning: PSM2 has no orientation: it does not turn" in err
    assert "warning: PSM2 has no gripper: its angle is 0" in err
    assert (tmp_path / "t.csv").read_text().splitlines()[0] == "time_s,PSM2_x_m,PSM2_y_m,PSM2_z_m"


def test_mistakes_are_lines_and_leave_nothing(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.mcap").write_bytes(b"nothing")
    (tmp_path / "a.bag").write_bytes(b"nothing")
    (tmp_path / "a.txt").write_text("1 2 3\n")
    out = str(tmp_path / "t.csv")
    for words, expected, code in (
        (("none", "-o", out), "none: does not exist", 4),
        (("folder", "-o", out), "SOURCE: must be an .mcap file, a rosbag2 folder", 2),
        (("a.mcap", "-o", "t.xlsx"), "--out: must end in .csv or .parquet (got 't.xlsx')", 2),
        (("a.mcap", "-o", out), "a.mcap: is no MCAP file", 4),
        (("a.bag", "-o", out), "a.bag: cannot be read as a bag: ", 4),
        (("a.txt", "-o", out), "a.txt: line 1: must have 76 columns", 4),
        (("a.mcap", "-o", out, "--topic", "MTML"), "--topic: must read NAME=VALUE (got 'MTML')", 2),
    ):
        found = call_in_one_line("import", str(tmp_path / words[0]), *words[1:])
        assert found[0] == code, found
        assert expected in found[2]
    assert not Path(out).exists()


def test_a_damaged_bag_is_refused(tmp_path: Path) -> None:
    bag = rosbag(tmp_path / "bag", movement(20))
    [database] = bag.glob("*.db3")
    database.write_bytes(database.read_bytes()[:3000])
    code, _, err = call_in_one_line("import", str(bag), "-o", str(tmp_path / "t.csv"))
    assert code == 4
    assert "bag: cannot be read as a bag: " in err
    (bag / "metadata.yaml").write_text("{")
    code, _, err = call_in_one_line("import", str(bag), "-o", str(tmp_path / "t.csv"))
    assert code == 4


def test_a_missing_extra_is_named_with_its_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, folder = ros_mcap(tmp_path / "a.mcap", movement(20)), lerobot_set(tmp_path / "set", movement(20), 2)
    for module in (
        "tis.deploy.recordings_import.messages",
        "tis.deploy.recordings_import.lerobot",
        "tis.deploy.recordings_import.command",
    ):
        monkeypatch.setattr(f"{module}.find_spec", lambda _: None)
    out = str(tmp_path / "t.csv")
    code, _, err = call_in_one_line("import", str(file), "-o", out)
    assert (code, str(GET_ROSBAG) in err) == (2, True)
    code, _, err = call_in_one_line("import", str(folder), "-o", out)
    assert (code, str(GET_PARQUET) in err) == (2, True)
    code, _, err = call_in_one_line("import", str(file), "-o", str(tmp_path / "t.parquet"))
    assert (code, str(GET_PARQUET) in err) == (2, True)
