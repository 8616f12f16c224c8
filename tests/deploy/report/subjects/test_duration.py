"""A run cut short went on for as long as it ticked, and its rates are of that time."""

from pathlib import Path

import pytest

from tests.deploy.report.hand_made import COMMAND, a_scenario, counter, tick, write_run
from tis.common.records import SENT_BYTES, SENT_PACKETS
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.subjects.ticks import active_duration_s
from tis.deploy.report.summarise import build_summary


def test_what_was_sent_in_8_of_20_s_is_60_a_second(tmp_path: Path) -> None:
    """240 ticks at 30 Hz are 8 s; 480 packets in them are 60 a second."""
    ticks = [tick(k, 33 * k, 33 * k) for k in range(240)]
    counters = [counter(f"{SENT_PACKETS}.{COMMAND}", 480), counter(f"{SENT_BYTES}.{COMMAND}", 48_000)]
    logs = write_run(tmp_path, surgeon=[*ticks, *counters])
    scenario = a_scenario(duration_s=20.0)
    assert active_duration_s(logs, "surgeon", scenario) == 8.0
    summary = build_summary(logs, scenario, (), "live", 0, "")
    assert summary["duration_s"] == 8.0
    rates = summary["surgeon_traffic"][COMMAND]
    assert (rates["packets_per_s"], rates["bytes_per_s"]) == pytest.approx((60.0, 6000.0))
    assert (summary["surgeon_ticks"]["count"], summary["surgeon_ticks"]["planned"]) == (240, 600)


def test_a_whole_run_and_one_that_nobody_knows_of_last_as_long_as_planned(tmp_path: Path) -> None:
    logs = write_run(tmp_path, surgeon=[tick(k, 33 * k, 33 * k) for k in range(3)])
    assert active_duration_s(logs, "surgeon", a_scenario()) == 0.1
    assert active_duration_s(logs, "patient", a_scenario()) == 0.1
    (tmp_path / "surgeon.mcap").unlink()
    assert active_duration_s(load_run(tmp_path), "surgeon", a_scenario()) == 0.1
