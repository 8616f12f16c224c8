"""Fates of two runs, packet by packet."""

from pathlib import Path

from common.node import Record
from common.scenario import Scenario
from deploy.consistency import FateComparison, compare_fates
from deploy.report.load import RunLogs, load_run
from tests.deploy.report.hand_made import ARM, COMMAND, a_scenario, fate, write_log

OUTAGE: dict[str, object] = {"timeline": [{"at_s": 1, "for_s": 0.5, "set": {"outage": True}}]}


def _netem(run_dir: Path, *fates: Record) -> RunLogs:
    run_dir.mkdir()
    write_log(run_dir, "netem", fates)
    return load_run(run_dir)


def _compared(tmp_path: Path, live: list[Record], twin: list[Record], scenario: Scenario) -> FateComparison:
    return compare_fates(_netem(tmp_path / "live", *live), _netem(tmp_path / "twin", *twin), scenario)


def test_equal_draws_are_equal_fates_whenever_the_packets_were_offered(tmp_path: Path) -> None:
    live = [fate(COMMAND, 0, 0.3, 20), fate(COMMAND, 1, 33.4, None, "loss")]
    twin = [fate(COMMAND, 1, 33, None, "loss"), fate(COMMAND, 0, 0, 20)]
    found = _compared(tmp_path, live, twin, a_scenario())
    assert found == FateComparison(n_compared=2, n_different=0, n_set_aside=0, n_in_one_only=0)
    assert found.identical


def test_another_outcome_or_another_delay_is_different(tmp_path: Path) -> None:
    live = [fate(COMMAND, 0, 0, 20), fate(COMMAND, 1, 33, 20), fate(COMMAND, 2, 66, 20)]
    twin = [fate(COMMAND, 0, 0, 20), fate(COMMAND, 1, 33, None, "loss"), fate(COMMAND, 2, 66, 20.000001)]
    found = _compared(tmp_path, live, twin, a_scenario())
    assert (found.n_compared, found.n_different) == (3, 2)
    assert not found.identical


def test_packets_are_matched_by_direction_key_and_number(tmp_path: Path) -> None:
    live = [fate(COMMAND, 0, 0, 20), fate(ARM, 0, 0, 30), fate(ARM, 0, 0, 40, direction="feedback")]
    twin = [fate(ARM, 0, 0, 40, direction="feedback"), fate(COMMAND, 0, 0, 20), fate(ARM, 1, 0, 30)]
    found = _compared(tmp_path, live, twin, a_scenario())
    assert (found.n_compared, found.n_different, found.n_in_one_only) == (2, 0, 2)


def test_packets_that_moved_over_an_outages_edge_are_set_aside(tmp_path: Path) -> None:
    """Edges at 1000 and 1500 ms: set aside is what lay inside in one run and outside in the other, only that."""
    moved_ms = ((999.9, 1000.0), (1000.0, 999.9), (1499.9, 1500.0))
    stayed_ms = ((990.0, 999.9), (1000.0, 1499.9), (1500.0, 1500.1))
    pairs = list(enumerate(moved_ms + stayed_ms))
    live = [fate(COMMAND, k, ms, None, "outage") for k, (ms, _) in pairs]
    twin = [fate(COMMAND, k, ms, 20) for k, (_, ms) in pairs]
    found = _compared(tmp_path, live, twin, a_scenario(network=OUTAGE))
    assert (found.n_set_aside, found.n_compared, found.n_different) == (3, 3, 3)


def test_foreign_packets_are_nobodys_to_compare_and_nothing_is_not_identical(tmp_path: Path) -> None:
    live = [fate(COMMAND, 0, 0, 20, foreign=True)]
    found = _compared(tmp_path, live, [fate(COMMAND, 0, 0, 30)], a_scenario())
    assert (found.n_compared, found.n_in_one_only, found.identical) == (0, 1, False)
