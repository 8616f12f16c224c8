"""The merged file made beside the summary, in a process of its own."""

import shutil
from pathlib import Path

import pytest

from tests.log_reader import LogReader
from tis.common.errors import DataError
from tis.common.scenario import Scenario
from tis.deploy.logs import merge_run
from tis.deploy.logs.merge_run import Opening


def _copy(run_dir: Path, target: Path) -> Path:
    shutil.copytree(run_dir, target)
    (target / "run.mcap").unlink()
    return target


def test_beside_the_summary_it_is_made_as_alone(
    tmp_path: Path, run_dir: Path, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a process of its own, which waits for the summary; and here, when the logs are small."""
    opening = Opening("tis run x", ("short training",))
    files = []
    for k, least_bytes in enumerate((0, 1 << 40)):
        folder = _copy(run_dir, tmp_path / str(k))
        monkeypatch.setattr(merge_run, "_MIN_PROCESS_BYTES", least_bytes)
        (folder / "summary.json").write_text('{"problems": ["stale"]}')
        with merge_run.merging(folder, scenario, {}, opening) as merging:
            (folder / "summary.json").write_text('{"problems": ["fresh"]}')
            merging.concluded()
            assert merging.merged().problems == ()
        files.append((folder / "run.mcap").read_bytes())
        lines = [m.data for topic, m in LogReader(folder / "run.mcap").messages() if topic == "/log"]
        assert b"tis run x" in lines[0]
        for text, n in ((b"short training", 1), (b"fresh", 1), (b"stale", 0)):
            assert sum(text in data for data in lines) == n
    assert files[0] == files[1]


def test_a_summary_that_fails_leaves_no_merged_file(
    tmp_path: Path, run_dir: Path, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = _copy(run_dir, tmp_path / "r")
    before = sorted(path.name for path in folder.iterdir())
    monkeypatch.setattr(merge_run, "_MIN_PROCESS_BYTES", 0)
    with pytest.raises(ZeroDivisionError), merge_run.merging(folder, scenario, {}, Opening()):
        raise ZeroDivisionError
    assert sorted(path.name for path in folder.iterdir()) == before


def test_a_merge_that_fails_beside_the_summary_says_why(
    tmp_path: Path, run_dir: Path, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = _copy(run_dir, tmp_path / "r")
    (folder / "run.mcap").mkdir()
    monkeypatch.setattr(merge_run, "_MIN_PROCESS_BYTES", 0)
    with merge_run.merging(folder, scenario, {}, Opening()) as merging:
        merging.concluded()
        with pytest.raises(DataError, match=r"run\.mcap: cannot be written: Is a directory"):
            merging.merged()
