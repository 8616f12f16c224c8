"""The Python door against the command: the same study, the same figures."""

import dataclasses
import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.deploy.commands import call
from tis.common.errors import DataError, InputError
from tis.common.extras import GET_PANDAS, GET_PARQUET, GET_REPORT
from tis.deploy.compare import Study, compare
from tis.deploy.compare.comparison import Comparison

DELAY = "network.forward.delay.delay_ms"


@pytest.fixture
def study(small: Path) -> Study:
    axes: dict[str, Any] = {DELAY: [33, 100]}
    return Study(scenario=str(small), axes=axes, estimators=("damped_velocity",), seeds=2, duration_s=5)


def result_of(study: Study, **more: Any) -> Comparison:
    return compare(study, "kept", n_jobs=1, **more)


def test_it_returns_what_the_command_writes(
    study: Study, small: Path, in_this_process: None, without_figures: None, capsys: pytest.CaptureFixture[str]
) -> None:
    result = result_of(study)
    assert capsys.readouterr() == ("", "")
    words = ("--sweep", f"{DELAY}=33,100", "--estimators", "damped_velocity", "--seeds", "2", "--duration-s", "5")
    code, _, err = call("compare", "small.yaml", *words, "--out", "kept", "--jobs", "1")
    assert code == 0
    assert "8 of 8 twins were computed before" in err
    written = json.loads(Path("kept/table.json").read_text())
    same = [name for name in written if name not in ("command", "n_resumed")]
    assert {name: result.report[name] for name in same} == {name: written[name] for name in same}
    assert result.pooled == written["rows"]
    assert result.to_arrow().to_pylist() == [dict(row) for row in result.rows]
    # the command in the report makes the same comparison again
    again = eval(result.report["command"], {"Study": Study, "compare": lambda one: one})
    assert again == study


def test_its_files_are_those_of_the_command(study: Study, in_this_process: None, tmp_path: Path) -> None:
    result = result_of(study)
    files = result.write()
    assert {path.parent for path in files} == {tmp_path / "kept"}
    assert {"table.json", "table.csv", "table.md", "curves.svg", "cells.parquet"} <= {path.name for path in files}
    assert json.loads((tmp_path / "kept" / "table.json").read_text()) == result.report
    assert list(result.figures()) == ["curves", "error_by_age"]
    (tmp_path / "elsewhere").mkdir()
    assert all(path.is_file() for path in result.write("elsewhere"))


def test_it_is_frozen_and_shows_progress_only_when_told(
    study: Study, in_this_process: None, capsys: pytest.CaptureFixture[str]
) -> None:
    result = result_of(study, progress=True)
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.rows = ()  # type: ignore[misc]
    assert result.failed == []
    assert capsys.readouterr().out == ""


def test_a_package_that_is_missing_is_named_with_its_command(
    study: Study, in_this_process: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = result_of(study)
    monkeypatch.setattr("tis.deploy.compare.comparison.find_spec", lambda _: None)
    for method, line in (
        (result.to_pandas, f"Comparison.to_pandas: needs pandas: {GET_PANDAS}"),
        (
            result.to_arrow,
            f"Comparison.to_arrow: needs pyarrow: {GET_PARQUET}",
        ),
        (
            result.figures,
            f"Comparison.figures: needs matplotlib: {GET_REPORT}",
        ),
    ):
        with pytest.raises(InputError, match=f"^{re.escape(line)}$"):
            method()
    monkeypatch.setattr("tis.deploy.compare.comparison.find_spec", lambda name: name)
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=SimpleNamespace(from_records=tuple)))
    assert list(result.to_pandas()) == list(result.rows)


def test_what_cannot_be_computed_is_an_error_of_ours(small: Path, in_this_process: None, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^Study: estimators: no such estimator"):
        result_of(Study(scenario=str(small), estimators=("fnord",)))
    absent: dict[str, Any] = {"source.path": "absent"}
    with pytest.raises(DataError, match=r"does not exist \(folder given by source\.path\)"):
        result_of(Study(scenario=str(small), settings=absent))
    too_late: dict[str, Any] = {"identification": {"train": "own_head", "train_samples": 600}}
    with pytest.raises(DataError, match="is too short to compare on"):
        result_of(Study(scenario=str(small), settings=too_late))
