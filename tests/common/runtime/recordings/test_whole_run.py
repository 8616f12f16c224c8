from pathlib import Path
from typing import Any

import pytest

from tests.common.runtime.recordings.tables import movement, write_csv
from tests.common.runtime.recordings.test_recordings import write_trial
from tis.common.errors import DataError, InputError
from tis.common.runtime.recordings import build_whole, load_recording
from tis.common.scenario import Scenario


def whole(source: dict[str, Any], n_train: int = 100, **fields: Any) -> Scenario:
    raw = {"version": 1, "name": "s", "duration_s": "auto", "source": source, **fields}
    return build_whole(raw | {"identification": {"train_samples": n_train}}, "s.yaml")


@pytest.mark.parametrize("n_rows", [102, 161, 200, 333])
def test_auto_plays_all_rows_after_the_training_rows(tmp_path: Path, n_rows: int) -> None:
    file = write_csv(tmp_path / "t.csv", movement(n_rows))
    scenario = whole({"kind": "table", "path": str(file)})
    assert scenario.n_samples == n_rows - 101  # the last row is for truth after the last sample
    assert len(load_recording(scenario)) == n_rows


def test_auto_plays_all_of_a_jigsaws_trial(tmp_path: Path) -> None:
    write_trial(tmp_path, "D002", 161)
    source = {"kind": "jigsaws", "path": str(tmp_path), "start": 130}
    assert whole(source).duration_s == 1.0


def test_auto_counts_rows_at_the_scenarios_rate(tmp_path: Path) -> None:
    file = write_csv(tmp_path / "t.csv", movement(401, rate_hz=100.0))
    source = {"kind": "table", "path": str(file), "resample": True}
    assert whole(source, rate_hz=50).n_samples == 100  # 201 rows of 4 s, 100 of them for training


def test_auto_without_an_end_or_a_row_or_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="auto plays all of a recording, and a synthetic movement has no end"):
        whole({"kind": "synthetic"})
    file = write_csv(tmp_path / "t.csv", movement(101))
    with pytest.raises(
        InputError, match=r"auto finds no row to play: .* has 101 rows, and the run begins at row 100"
    ):
        whole({"kind": "table", "path": str(file)})
    with pytest.raises(DataError) as caught:
        whole({"kind": "table", "path": str(tmp_path / "none.csv")})
    assert [str(fault).replace(str(tmp_path), "") for fault in caught.value.faults] == [
        "/none.csv: does not exist (given by source.path, which counts from the current folder, not from the "
        "scenario's file)",
        "s.yaml: duration_s: auto needs the recording on this host; else set the number of seconds, which `tis "
        "validate SCENARIO` prints on a host that has it",
    ]


def test_a_recording_that_does_not_fit_is_told_alone(tmp_path: Path) -> None:
    file = write_csv(tmp_path / "t.csv", movement(401, rate_hz=100.0))
    with pytest.raises(DataError) as caught:
        whole({"kind": "table", "path": str(file)})
    [fault] = caught.value.faults
    assert "set rate_hz: 100, or source.resample: true" in str(fault)


def test_other_faults_come_before_the_recording_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="seed"):
        whole({"kind": "table", "path": str(tmp_path / "none.csv")}, seed=-1)
