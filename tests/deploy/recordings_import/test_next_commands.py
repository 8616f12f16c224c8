import shlex
from pathlib import Path

import numpy as np
import pytest

from tests.common.runtime.recordings.tables import Columns, movement, write_csv
from tests.deploy.commands import call
from tis.deploy.recordings_import.command import next_commands


def _printed(line: str) -> list[str]:
    said, command = line.split(": tis ", 1)
    assert said in ("play it with", "compare estimators on it with")
    return shlex.split(command)


def _cut(columns: Columns, *rows: int) -> Columns:
    return {name: np.delete(values, rows) for name, values in columns.items()}


def test_the_commands_run_as_printed_for_a_short_table_with_gaps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    columns = _cut(movement(600, tremor_m=1e-4), 100, 101, 102, 450)
    file = write_csv(Path("it's, mine {1}.csv"), columns)
    for line in next_commands(file, columns):
        code, _, err = call(*_printed(line))
        assert code == 0, err


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (movement(3000, tremor_m=1e-4), ["source={kind: table, path: t.csv, hands: [left]}", "duration_s=auto"]),
        (movement(3000), ["identification.sensor_noise_mm=0.01"]),
        (movement(1000, rate_hz=50), ["rate_hz=50", "identification.train_samples=500"]),
        (movement(5000, 1000, tremor_m=1e-4), ["rate_hz=1000", "patient.tick_phase_ms=0.5"]),
        (movement(1000, rate_hz=12.3), ["rate_hz=12", "resample: true"]),
        (_cut(movement(3000), 700), ["resample: true, gaps: bridge"]),
        (movement(3000, tremor_m=1e-4) | {"MTML_z_m": np.zeros(3000)}, ["identification.sensor_noise_mm=0.01"]),
        ({n.replace("MTML", "MTMR"): v for n, v in movement(900).items() if "PSM" not in n}, ["hands: [right]"]),
    ],
)
def test_settings_fit_the_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, columns: Columns, expected: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    twin, compare = next_commands(write_csv(Path("t.csv"), columns), columns)
    assert _printed(twin)[:2] == ["twin", "default"]
    assert _printed(compare)[:2] == ["compare", "default"]
    assert "network.forward.delay.delay_ms=30,100,200" in _printed(compare)
    for part in expected:
        assert any(part in word for word in _printed(twin)), twin


def test_a_table_that_is_too_short_is_said_instead(tmp_path: Path) -> None:
    columns = movement(50)
    lines = next_commands(write_csv(tmp_path / "t.csv", columns), columns)
    assert [line.startswith("it cannot be played yet: ") for line in lines] == [True]
