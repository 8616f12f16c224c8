"""The log that a side opens: a new one, the next part of its own, or one of another run."""

import time
from pathlib import Path

import pytest

from tis.common.errors import DataError, PeerError
from tis.common.node import Record
from tis.common.records import TICKS, TickNote
from tis.common.runtime.control import boot_digest
from tis.common.runtime.log_parts import CLOCK_FILE, PartClock
from tis.common.runtime.run_folders import latest_folders
from tis.common.runtime.side_log import SideOptions, continued, earlier_part, open_log
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario

S = 1_000_000_000
RUN_ID = 7


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def scenario() -> Scenario:
    return build_scenario({"version": 1, "name": "s", "duration_s": 20, "source": {"kind": "synthetic"}}, "s")


def _killed(options: SideOptions, scenario: Scenario, age_s: float = 5) -> Path:
    """Leave the log of a surgeon that was killed in a run that began some seconds ago; return its path."""
    with open_log(options, scenario, "surgeon") as log:
        unix_ns = time.time_ns() - int(age_s * S)
        clock = PartClock(epoch_monotonic_ns=1, epoch_unix_ns=unix_ns, run_id=RUN_ID, boot=boot_digest())
        log.attach(CLOCK_FILE, clock.model_dump_json().encode())
        log.record(Record(TICKS, 1, TickNote(tick=0, due_ns=0, begin_ns=1)))
    log.path.write_bytes(log.path.read_bytes()[:-300])
    return log.path


def test_a_side_that_was_killed_goes_on_beside_its_log(here: None, scenario: Scenario) -> None:
    """With the folder that the user names, and without one in the newest folder of the scenario."""
    for run_dir in (Path("mine"), None):
        options = SideOptions(run_dir)
        path = _killed(options, scenario)
        earlier = earlier_part(options, scenario, "surgeon")
        assert earlier is not None
        assert earlier.path == path
        with open_log(options, scenario, "surgeon", earlier) as log:
            assert log.path == path.with_name("surgeon_2.mcap")
            assert continued(log, options, scenario, "surgeon", earlier, RUN_ID) == earlier


def test_a_log_of_another_run_is_refused_in_the_users_folder_and_moves_elsewhere(
    here: None, scenario: Scenario
) -> None:
    named = SideOptions(Path("mine"))
    _killed(named, scenario)
    earlier = earlier_part(named, scenario, "surgeon")
    refused = pytest.raises(PeerError, match=r"is of another run .* give another --run-dir")
    with refused, open_log(named, scenario, "surgeon", earlier) as log:
        continued(log, named, scenario, "surgeon", earlier, RUN_ID + 1)
    assert [path.name for path in Path("mine").iterdir()] == ["surgeon.mcap"], "no trace is left"

    path = _killed(SideOptions(None), scenario)
    earlier = earlier_part(SideOptions(None), scenario, "surgeon")
    with open_log(SideOptions(None), scenario, "surgeon", earlier) as log:
        assert continued(log, SideOptions(None), scenario, "surgeon", earlier, RUN_ID + 1) is None
        log.record(Record(TICKS, 1, TickNote(tick=0, due_ns=0, begin_ns=1)))
    assert log.path.name == "surgeon.mcap"
    assert log.path.parent != path.parent
    assert log.path.stat().st_size > 300
    assert [one.name for one in path.parent.iterdir()] == ["surgeon.mcap"]


def test_a_run_that_is_over_is_neither_continued_nor_written_over(here: None, scenario: Scenario) -> None:
    named = SideOptions(Path("mine"))
    for options in (named, SideOptions(None)):
        _killed(options, scenario, age_s=23)
        assert earlier_part(options, scenario, "surgeon") is None
        assert earlier_part(options, scenario, "patient") is None
    refused = pytest.raises(DataError, match=r"surgeon\.mcap: exists, from an earlier run: give another --run-dir")
    with refused, open_log(named, scenario, "surgeon"):
        pass


def test_a_side_that_the_user_ended_begins_in_a_new_folder(here: None, scenario: Scenario) -> None:
    path = _killed(SideOptions(None), scenario)
    whole = Path("whole")
    with open_log(SideOptions(whole), scenario, "patient") as log:
        clock = PartClock(epoch_monotonic_ns=1, epoch_unix_ns=time.time_ns(), run_id=RUN_ID, boot=boot_digest())
        log.attach(CLOCK_FILE, clock.model_dump_json().encode())
        log.record(Record(TICKS, 1, TickNote(tick=0, due_ns=0, begin_ns=1)))
    (whole / "patient.mcap").rename(path.with_name("patient.mcap"))
    assert earlier_part(SideOptions(None), scenario, "patient") is None
    assert earlier_part(SideOptions(path.parent), scenario, "patient") is not None


def test_the_newest_folders_of_a_scenario_are_found_by_their_names(tmp_path: Path) -> None:
    names = ["20260101_000000_s", "20260102_000000_s_2", "20260102_000000_s", "20260103_000000_s_twin", "s", "x_s"]
    for name in names:
        (tmp_path / name).mkdir()
    found = [path.name for path in latest_folders(tmp_path, "s")]
    assert found == ["20260102_000000_s_2", "20260102_000000_s", "20260101_000000_s"]
    assert latest_folders(tmp_path / "nowhere", "s") == []


def test_a_run_that_did_not_begin_leaves_neither_log_nor_folder(here: None, scenario: Scenario) -> None:
    for run_dir, left in ((None, set()), (Path("mine/run"), set()), (Path("there"), {Path("there")})):
        if left:
            Path("there").mkdir()
        with open_log(SideOptions(run_dir), scenario, "patient"):
            pass
        assert set(Path().iterdir()) == left
