import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import scipy

from tests.common.runtime.recordings.tables import Columns, movement, scenario_of, write_csv, write_parquet
from tis.common.errors import DataError
from tis.common.runtime.recordings import load_recording, load_training, located


def faults_of(path: Path, **source: Any) -> list[str]:
    with pytest.raises(DataError) as caught:
        load_recording(scenario_of(path, **source))
    return [str(fault).replace(str(path), "FILE") for fault in caught.value.faults]


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_the_usual_table_is_played_without_a_map(tmp_path: Path, suffix: str) -> None:
    columns = movement(161)
    write = write_csv if suffix == "csv" else write_parquet
    recording = load_recording(scenario_of(write(tmp_path / f"ann_1.{suffix}", columns)))
    [hand] = recording.hands
    assert (recording.label, recording.person, recording.start, len(recording)) == ("ann_1", "ann", 100, 161)
    assert (hand.hand, hand.arm, recording.warnings, recording.anomalies) == ("left", "PSM2", (), ())
    for k, axis in enumerate("xyz"):
        assert np.array_equal(hand.command.position_m[:, k], columns[f"MTML_{axis}_m"])
        assert np.array_equal(hand.follower.position_m[:, k], columns[f"PSM2_{axis}_m"])
    assert hand.follower.orientation[:, 2] == pytest.approx(columns["PSM2_qz"], abs=1e-15)
    assert np.array_equal(hand.command.gripper_rad, columns["MTML_gripper_rad"])
    assert recording.pairing.startswith("MTML -> PSM2 (by the table; a static gain leaves 0.000 mm rms of PSM2")


def test_a_table_of_other_names_units_and_times(tmp_path: Path) -> None:
    columns = movement(161)
    own: Columns = {"stamp": 1_700_000_000_000 + 1000.0 * columns["time_s"]}
    own |= {axis: 1000.0 * columns[f"PSM2_{axis}_m"] for axis in "xyz"}
    own["yaw"] = np.degrees(2.0 * np.arcsin(columns["PSM2_qz"]))
    arm = {"position": ["x", "y", "z"], "euler": ["yaw"], "euler_axes": "z"}
    recording = load_recording(
        scenario_of(
            write_csv(tmp_path / "t.csv", own),
            columns={"time": "stamp", "left": {"arm": arm, "gain": 0.5}},
            units={"time": "ms", "position": "mm", "angle": "deg"},
            task="Peg transfer",
            person="Eve",
        )
    )
    [hand] = recording.hands
    assert (recording.label, recording.person) == ("Peg transfer t", "Eve")
    assert hand.follower.position_m[:, 1] == pytest.approx(columns["PSM2_y_m"], abs=1e-12)
    assert hand.command.position_m == pytest.approx(2.0 * hand.follower.position_m)
    assert hand.follower.orientation[:, 2] == pytest.approx(columns["PSM2_qz"], abs=1e-9)
    assert recording.warnings == (
        "Peg transfer t: it has no columns of MTML: the command is the pose of PSM2, positions times 2",
    )
    assert recording.pairing == "MTML -> PSM2 (by gain 0.5)"


def test_a_table_of_the_hand_alone_is_no_fault_and_the_pairing_tells_it(tmp_path: Path) -> None:
    alone = {name: values for name, values in movement(161).items() if "PSM" not in name}
    recording = load_recording(scenario_of(write_csv(tmp_path / "t.csv", alone)))
    assert recording.warnings == ()
    words, twice = (
        "the table has the hand alone: the arm is taken to follow it exactly",
        "so each position is sent twice",
    )
    assert recording.pairing == f"MTML -> PSM2 ({words}, {twice})"
    columns = {"left": {"master": "MTML", "gain": 0.5}}
    scaled = load_recording(scenario_of(tmp_path / "t.csv", columns=columns))
    assert scaled.pairing == f"MTML -> PSM2 ({words}, positions times 0.5, {twice})"


@pytest.mark.parametrize(("units", "asks"), [({}, True), ({"position": "m"}, False)])
def test_a_flight_in_a_unit_that_is_named_raises_no_question(tmp_path: Path, units: Any, asks: bool) -> None:
    columns = movement(900)
    for device in ("MTML", "PSM2"):
        columns |= {f"{device}_{axis}_m": 3.8 * np.sin(0.8 * columns["time_s"] + k) for k, axis in enumerate("xyz")}
    own = {name.removesuffix("_m"): values for name, values in columns.items()}
    named = {device: [f"{device}_{axis}" for axis in "xyz"] for device in ("MTML", "PSM2")}
    left = {"master": {"position": named["MTML"]}, "arm": {"position": named["PSM2"]}}
    file = write_csv(tmp_path / "t.csv", own)
    mapped = load_recording(scenario_of(file, columns={"time": "time_s", "left": left}, units=units))
    assert any("further than any arm" in text for text in mapped.anomalies) == asks
    canonical = load_recording(scenario_of(write_csv(tmp_path / "c.csv", columns)))
    assert canonical.anomalies == ()  # its columns' names carry the unit


def test_instants_of_nanoseconds_since_1970_keep_their_differences(tmp_path: Path) -> None:
    columns = movement(161, rate_hz=1000.0)
    ticks = 1_763_990_000_123_456_789 + 1_000_000 * np.arange(161)
    for time in (ticks, pa.array(ticks, pa.timestamp("ns"))):
        file = write_parquet(tmp_path / "t.parquet", columns | {"time_s": time})
        scenario = scenario_of(file, duration_s=0.05, columns={"time": "time_s"}, units={"time": "ns"})
        if isinstance(time, pa.Array):  # dates carry their unit
            scenario = scenario_of(file, duration_s=0.05, columns={"time": "time_s"}, units={"time": "ms"})
        fast = scenario.model_copy(update={"rate_hz": 1000})
        assert load_recording(fast).warnings == ()


def test_rows_without_times_are_counted(tmp_path: Path) -> None:
    columns = movement(161)
    del columns["time_s"]
    recording = load_recording(scenario_of(write_csv(tmp_path / "t.csv", columns), rate_hz=30))
    assert recording.warnings == ()


def test_another_rate_is_interpolated_on_request_and_told(tmp_path: Path) -> None:
    file = write_parquet(tmp_path / "t.parquet", movement(600, rate_hz=100.0))
    assert faults_of(file) == [
        "FILE: has 100 rows a second and the scenario's rate_hz is 30: set rate_hz: 100, or source.resample: true to "
        "interpolate rows at 30 Hz"
    ]
    recording = load_recording(scenario_of(file, resample=True))
    expected = movement(len(recording))
    assert len(recording) == 180  # 5.99 s
    # linear interpolation between rows 10 ms apart errs by at most a h^2 / 8, with a = 0.02 * 3.3^2 m/s^2
    assert np.abs(recording.hands[0].command.position_m[:, 2] - expected["MTML_z_m"]).max() < 3e-6
    assert recording.warnings == (
        "t: resampled from 100 rows a second to 30: positions and angles linearly, orientations along great arcs",
    )


def test_an_arm_that_does_not_follow_is_told(tmp_path: Path) -> None:
    columns = movement(161)
    other = movement(161, rate_hz=7.0, seed=4)
    columns |= {f"PSM2_{axis}_m": other[f"PSM2_{axis}_m"] for axis in "xyz"}
    recording = load_recording(scenario_of(write_csv(tmp_path / "t.csv", columns)))
    assert "PSM2 does not follow MTML, not even late: a static gain leaves " in recording.warnings[0]


@pytest.mark.parametrize(
    ("lag_hz", "delay_rows", "rate_hz", "how"),
    [
        (3.0, 0, 50, "behind a lag of 3 Hz 0.000 mm"),
        (None, 13, 50, "behind a delay of 260 ms 0.000 mm"),
        (2.0, 1, 100, "behind a lag of 2 Hz and a delay of 10 ms 0.000 mm"),
        (1.7, 3, 100, "behind a lag of 1.7 Hz and a delay of 30 ms 0."),
    ],
)
def test_an_arm_that_is_late_does_follow(
    tmp_path: Path, lag_hz: float | None, delay_rows: int, rate_hz: int, how: str
) -> None:
    """Quick movements, of which a static gain leaves more than a fifth of the arm."""
    n = 400
    noise = np.random.default_rng(5).standard_normal((n + 100, 3))
    master = 0.02 * scipy.ndimage.gaussian_filter1d(noise, 0.06 * rate_hz, axis=0)
    arm, command = 0.5 * master[:n], master[delay_rows : delay_rows + n]
    if lag_hz is not None:
        for k in range(1, n):
            arm[k] = arm[k - 1] + (0.5 * master[k] - arm[k - 1]) * -np.expm1(-2 * np.pi * lag_hz / rate_hz)
    columns = movement(n, rate_hz)
    columns |= {f"MTML_{axis}_m": command[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"PSM2_{axis}_m": arm[:, k] for k, axis in enumerate("xyz")}
    scenario = scenario_of(write_csv(tmp_path / "t.csv", columns)).model_copy(update={"rate_hz": rate_hz})
    recording = load_recording(scenario)
    assert recording.warnings == ()
    assert how in recording.pairing


def test_an_arm_that_moves_before_its_command_is_told(tmp_path: Path) -> None:
    columns = movement(164)
    early = {f"PSM2_{axis}_m": columns[f"PSM2_{axis}_m"][3:] for axis in "xyz"}
    columns = {name: values[:161] for name, values in columns.items()} | early
    recording = load_recording(scenario_of(write_csv(tmp_path / "t.csv", columns)))
    assert recording.warnings == ("t: PSM2 moves 100 ms before MTML, which commands it, in rows 0 to 99",)


def test_clocks_that_drift_apart_are_told_though_the_first_rows_agree(tmp_path: Path) -> None:
    """The arm's clock runs 1 % fast, so after a minute its arm moves half a second before its command."""
    n, rate_hz = 3000, 50.0
    noise = np.random.default_rng(5).standard_normal((n + 200, 3))
    path = 0.02 * scipy.ndimage.gaussian_filter1d(noise, 6.0, axis=0)
    command = path[:n]
    at = np.arange(n) * 1.004 - 2.0
    arm = 0.5 * np.stack([np.interp(at, np.arange(len(path)), path[:, k]) for k in range(3)], axis=1)
    columns = movement(n, rate_hz)
    columns |= {f"MTML_{axis}_m": command[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"PSM2_{axis}_m": arm[:, k] for k, axis in enumerate("xyz")}
    scenario = scenario_of(write_csv(tmp_path / "t.csv", columns)).model_copy(update={"rate_hz": 50})
    warnings = load_recording(scenario).warnings
    assert "before MTML, which commands it, in rows" in warnings[-1]
    assert all(one.endswith("though it does at first: a clutch, or clocks that drift apart?") for one in warnings)


def test_an_arm_that_is_late_by_less_than_a_period_moves_not_before_its_command(tmp_path: Path) -> None:
    n, rate_hz = 400, 50.0
    phase = 2.0 * np.pi * 2.0 * np.arange(n) / rate_hz
    columns = movement(n, rate_hz)
    columns |= {f"MTML_{axis}_m": 0.02 * np.sin(phase) for axis in "xyz"}
    columns |= {f"PSM2_{axis}_m": 0.01 * np.sin(phase - 1.0) for axis in "xyz"}
    scenario = scenario_of(write_csv(tmp_path / "t.csv", columns)).model_copy(update={"rate_hz": 50})
    assert load_recording(scenario).warnings == ()


def test_a_model_may_learn_from_tables_of_other_people(tmp_path: Path) -> None:
    for name, seed in (("ann_1", 1), ("ann_2", 2), ("bob_1", 3), ("eve_1", 4)):
        write_csv(tmp_path / f"{name}.csv", movement(161, seed=seed))
    (tmp_path / "eve_2.csv").write_text("nothing\n")
    for name in ("a", "z"):  # tables of something else that lie in the same folder
        (tmp_path / f"{name}.csv").write_text("stamp,volt\n1,2\n2,3\n")
    scenario = scenario_of(tmp_path / "ann_1.csv", train="others")
    trainings = load_training(scenario, load_recording(scenario))
    assert [(each.label, each.person) for each in trainings] == [("bob_1", "bob"), ("eve_1", "eve")]
    assert "eve_2.csv: must have at least 2 rows" in trainings[0].left_out[0]
    assert trainings[0].left_out[1:] == ("trained without a.csv, z.csv: other columns than the source's",)


def test_metadata_name_person_and_task_and_mark_synthetic_ones(tmp_path: Path) -> None:
    about = {"task": "Suturing", "person": "S", "synthetic": True}
    file = write_parquet(tmp_path / "one.parquet", movement(161), json.dumps(about).encode())
    recording = load_recording(scenario_of(file))
    assert (recording.label, recording.person) == ("Suturing one (synthetic)", "S")
    for hostile in (b"[1]", b"{", b'{"person": 7, "task": "a\\u001b[31m"}', b"[" * 90_000):
        recording = load_recording(scenario_of(write_parquet(file, movement(161), hostile)))
        assert (recording.label, recording.person) == ("one", "one")


def test_training_on_others_without_others_names_the_ways_out(tmp_path: Path) -> None:
    file = write_csv(tmp_path / "ann_1.csv", movement(161))
    scenario = scenario_of(file, train="others")
    with pytest.raises(DataError) as caught:
        load_training(scenario, load_recording(scenario))
    assert "needs tables of other people than ann" in str(caught.value)
    assert "own_head trains on the recording's own first rows, a model file on none; found: ann_1.csv" in str(
        caught.value
    )


def test_a_table_too_short_says_how_long_the_run_may_be(tmp_path: Path) -> None:
    assert faults_of(write_csv(tmp_path / "t.csv", movement(160))) == [
        "FILE: must have 161 rows (100 before the start + 60 samples of 2 s + 1); duration_s can be at most 1.966, "
        "or auto to play all of it (got 160)"
    ]


def test_all_faults_of_a_table_are_told_at_once(tmp_path: Path) -> None:
    columns = movement(161)
    columns["time_s"][50] = columns["time_s"][49]
    columns["MTML_qz"][7] = columns["MTML_qw"][7] = 0.0
    assert faults_of(write_parquet(tmp_path / "t.parquet", columns)) == [
        "FILE: row 50: must be later than the row before (column time_s): sort the rows, or leave repeated ones out "
        "(got '1.63333333 s after 1.63333333 s')",
        "FILE: row 7: must be a quaternion of norm 1 (columns MTML_qx MTML_qy MTML_qz MTML_qw) (got 'norm 0')",
    ]
    columns = movement(161)
    columns["PSM2_x_m"][3] = np.nan
    assert faults_of(write_csv(tmp_path / "t.csv", columns)) == [
        "FILE: row 3, column PSM2_x_m: must be finite (got nan)"
    ]


def test_missing_values_of_a_parquet_file_are_named(tmp_path: Path) -> None:
    columns = movement(161)
    columns["MTML_y_m"] = pa.array([None if i == 5 else 0.0 for i in range(161)])
    columns["PSM2_x_m"] = pa.array(["1"] * 161)
    file = tmp_path / "t.parquet"
    assert faults_of(write_parquet(file, columns)) == ["FILE: column PSM2_x_m: must hold numbers (got 'string')"]
    columns["PSM2_x_m"] = movement(161)["PSM2_x_m"]
    assert faults_of(write_parquet(file, columns)) == ["FILE: row 5, column MTML_y_m: must be finite (got nan)"]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_byte_order_marks_are_understood(tmp_path: Path, encoding: str) -> None:
    file = write_csv(tmp_path / "t.csv", movement(161))
    file.write_bytes(file.read_text("utf-8").encode(encoding))
    assert len(load_recording(scenario_of(file))) == 161


def test_what_is_no_table_is_refused_in_words(tmp_path: Path) -> None:
    for suffix in ("csv", "parquet"):
        [text] = faults_of(tmp_path / f"none.{suffix}")
        assert text.startswith("FILE: does not exist (given by source.path, which counts from the current folder")
    latin = tmp_path / "latin.csv"
    latin.write_bytes("größe,b\n1,2\n".encode("latin-1"))
    assert faults_of(latin) == ["FILE: is not UTF-8 text (at byte 2): save it as UTF-8"]
    for name, content in (("text", b"a,b\n"), ("cut", b"PAR1" + b"\x00" * 40 + b"PAR1"), ("empty", b"")):
        file = tmp_path / f"{name}.parquet"
        file.write_bytes(content)
        [fault] = faults_of(file)
        assert fault.startswith("FILE: is no Parquet file, or damaged: ")


def test_columns_that_unpack_to_too_much_are_refused_unread(tmp_path: Path) -> None:
    # 5 million equal numbers take a few hundred bytes in the file
    n_rows = 5_000_000
    columns = dict.fromkeys(("time_s", "MTML_x_m", "MTML_y_m", "MTML_z_m"), np.zeros(n_rows))
    file = write_parquet(tmp_path / "bomb.parquet", columns)
    assert file.stat().st_size < 100_000
    assert faults_of(file) == ["FILE: must have 2 to 4000000 rows (got 5000000)"]


def test_damage_within_a_parquet_file_is_told(tmp_path: Path) -> None:
    file = write_parquet(tmp_path / "t.parquet", movement(161))
    content = bytearray(file.read_bytes())
    content[10:2000] = b"\xff" * 1990
    file.write_bytes(content)
    [fault] = faults_of(file)
    assert fault.startswith("FILE: is damaged: ")


def test_jumps_and_wrong_units_are_told_as_of_trials(tmp_path: Path) -> None:
    columns = movement(161)
    columns["MTML_x_m"][80:] += 0.5
    columns |= {f"PSM2_{axis}_m": 1000.0 * columns[f"PSM2_{axis}_m"] for axis in "xyz"}
    found = load_recording(scenario_of(write_csv(tmp_path / "t.csv", columns))).anomalies
    assert found[0].startswith("t: MTML jumps as no hand moves it, from row 79 to 80 (5")
    assert "t: PSM2 moves over" in found[1]
    assert found[1].endswith("further than any arm: are these millimetres?")


def test_the_path_is_recorded_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    source = located(scenario_of("t.csv")).source
    assert source.kind == "table"
    assert source.path == str(tmp_path / "t.csv")


def test_numbers_that_no_message_holds_are_refused_by_row(tmp_path: Path) -> None:
    """Between two of them an interpolation overflows, and a pose would fly with null for a number."""
    columns = movement(600, rate_hz=100.0)
    columns["MTML_x_m"][[7, 8]] = 1.7e308, -1.7e308
    columns["PSM2_gripper_rad"][3] = 2e9
    assert faults_of(write_parquet(tmp_path / "t.parquet", columns), resample=True) == [
        "FILE: row 7: must be of at most 1e+09 m (columns MTML_x_m MTML_y_m MTML_z_m) (got 1.7e+308)",
        "FILE: row 8: must be of at most 1e+09 m (columns MTML_x_m MTML_y_m MTML_z_m) (got 1.7e+308)",
        "FILE: row 3: must be of at most 1e+09 rad (columns PSM2_gripper_rad) (got 2000000000.0)",
    ]
