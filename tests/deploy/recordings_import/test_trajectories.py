from pathlib import Path

import numpy as np
import pytest

from tests.common.runtime.recordings.tables import movement, write_csv
from tests.deploy.commands import call_in_one_line
from tis.common.errors import DataError, InputError
from tis.deploy.recordings_import.command import read
from tis.deploy.recordings_import.found import Found, Wanted

COLUMNS = movement(40, rate_hz=200)
PLACES = np.stack([COLUMNS[f"MTML_{axis}_m"] for axis in "xyz"], axis=1)
TURNS = np.stack([COLUMNS[f"MTML_q{axis}"] for axis in "xyzw"], axis=1)
START_NS = 1_403_636_579_763_555_584
STEP_NS = 5_000_000
PLACE = "p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m]"
TURN = "q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"


def _tum(file: Path) -> Path:
    ns = [START_NS + k * STEP_NS for k in range(40)]
    stamps = [f"{t // 10**9}.{t % 10**9:09d}" for t in ns]
    rows = [
        " ".join([t, *map(repr, [*p, *q])]) for t, p, q in zip(stamps, PLACES.tolist(), TURNS.tolist(), strict=True)
    ]
    file.write_text("# ground truth trajectory\n# timestamp tx ty tz qx qy qz qw\n" + "\n".join(rows) + "\n")
    return file


def _euroc(file: Path, header: str, n_cells: int) -> Path:
    rows = []
    for k, (place, turn) in enumerate(zip(PLACES.tolist(), TURNS.tolist(), strict=True)):
        cells = [*place, turn[3], *turn[:3], *[0.1] * 9]  # velocity and biases are not read
        rows.append(",".join([str(START_NS + k * STEP_NS), *map(repr, cells)][:n_cells]))
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


def _is_the_movement(found: Found) -> bool:
    [stream] = found.streams
    assert stream.device == "MTML"
    assert stream.t_ns.tolist() == [START_NS + k * STEP_NS for k in range(40)]
    assert np.array_equal(stream.position_m, PLACES)
    return stream.orientation is not None and np.allclose(stream.orientation, TURNS)


@pytest.mark.parametrize("name", ["groundtruth.txt", "a.tum"])
def test_a_trajectory_of_tum(tmp_path: Path, name: str) -> None:
    assert _is_the_movement(read(_tum(tmp_path / name), Wanted()))


def test_trajectories_of_euroc_with_and_without_orientation(tmp_path: Path) -> None:
    more = ", ".join(f"v{k} []" for k in range(9))
    estimate = _euroc(tmp_path / "data.csv", f"#timestamp, {PLACE}, {TURN}, {more}", 17)
    assert _is_the_movement(read(estimate, Wanted()))
    assert _is_the_movement(read(_euroc(tmp_path / "vicon.csv", f"#timestamp [ns], {PLACE}, {TURN}", 8), Wanted()))
    assert not _is_the_movement(read(_euroc(tmp_path / "leica.csv", f"#timestamp [ns], {PLACE}", 4), Wanted()))


@pytest.mark.parametrize("bad", ["x 0 0 0 0 0 0 1", "5 0 0 0 0 0 1", "1e99999999 0 0 0 0 0 0 1", "nan 0 0 0 0 0 0 1"])
def test_lines_that_hold_no_pose_are_named(tmp_path: Path, bad: str) -> None:
    file = _tum(tmp_path / "a.txt")
    file.write_text(file.read_text() + bad + "\n")
    with pytest.raises(DataError, match=r"line 43: must hold 8 numbers, as a line of tum has \(got "):
        read(file, Wanted())
    found = read(file, Wanted(skips_unreadable=True))
    assert "poses of tum: 1 messages cannot be read and are left out" in found.notes


def test_a_table_needs_no_import(tmp_path: Path) -> None:
    file = write_csv(tmp_path / "own.csv", movement(900))
    code, _, err = call_in_one_line("import", str(file), "-o", str(tmp_path / "t.csv"))
    assert (code, f"it needs no import tis: {file}: play it with: tis twin default --set" in err) == (2, True), err
    assert not (tmp_path / "t.csv").exists()
    file.write_text(file.read_text().replace("time_s", "stamp"))
    with pytest.raises(InputError, match=r"source\.columns names what to read, .*; its columns: stamp, MTML_x_m"):
        read(file, Wanted())
