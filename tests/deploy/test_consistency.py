"""Fates of two runs, packet by packet."""

from pathlib import Path

import pytest

from common.node import Record
from common.records import CONTROL, ControlNote
from common.scenario import Scenario
from deploy.consistency import FateComparison, compare_fates
from deploy.report.load import RunLogs, load_run
from tests.deploy.report.hand_made import ARM, COMMAND, MS, a_scenario, fate, write_log

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


def test_copies_and_flipped_bits_are_compared_and_what_found_no_room_only_for_its_loss(tmp_path: Path) -> None:
    live = [
        fate(COMMAND, 0, 0, 20, copies=1),
        fate(COMMAND, 1, 1, 20, flipped=2),
        fate(COMMAND, 2, 2, None, "queue_full"),
        fate(COMMAND, 3, 3, None, "overflow"),
        fate(COMMAND, 4, 4, None, "queue_full"),
    ]
    twin = [
        fate(COMMAND, 0, 0, 20),
        fate(COMMAND, 1, 1, 20),
        fate(COMMAND, 2, 2, 20),
        fate(COMMAND, 3, 3, 25, copies=1),
        fate(COMMAND, 4, 4, None, "loss"),
    ]
    found = _compared(tmp_path, live, twin, a_scenario())
    assert (found.n_compared, found.n_different) == (5, 3)
    # a copy may find the queue of a rate full without a word in the log
    limited = a_scenario(network={"forward": {"rate": {"kbit_s": 100}}})
    again = compare_fates(load_run(tmp_path / "live"), load_run(tmp_path / "twin"), limited)
    assert (again.n_compared, again.n_different) == (5, 2)


@pytest.mark.parametrize(
    ("forward", "n_set_aside"),
    [
        ({"delay": {"kind": "constant", "delay_ms": 20}}, 0),
        ({"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 2}, "correlation": {"half_life_s": 1}}, 1),
        ({"delay": {"kind": "trace", "path": "t.csv", "advance": "time"}}, 1),
        ({"delay": {"kind": "trace", "path": "t.csv"}}, 0),
        ({"loss": {"kind": "trace", "path": "t.csv", "advance": "time"}}, 1),
    ],
)
def test_processes_in_time_set_aside_what_moved_over_a_cells_edge(
    tmp_path: Path, forward: dict[str, object], n_set_aside: int
) -> None:
    """0 stayed within a ms, 1 moved from one to the next; both got another delay."""
    live = [fate(COMMAND, 0, 5.1, 20), fate(COMMAND, 1, 7.9, 20)]
    twin = [fate(COMMAND, 0, 5.9, 21), fate(COMMAND, 1, 8.1, 21)]
    found = _compared(tmp_path, live, twin, a_scenario(network={"forward": forward}))
    assert (found.n_set_aside, found.n_compared, found.n_different) == (n_set_aside, 2 - n_set_aside, 2 - n_set_aside)


def test_steps_of_the_timeline_and_ramps_set_aside_what_moved_over_them(tmp_path: Path) -> None:
    """Steps at 100 and 200 ms with ramps of 30 ms, of which every ms differs; between them nothing does."""
    ramp = {"at_s": 0.1, "for_s": 0.1, "ramp_s": 0.03, "set": {"add_delay_ms": 9}}
    moved_ms = ((50.9, 51.0), (99.9, 100.1), (120.9, 121.1), (150.9, 151.1), (180.9, 181.1), (250.9, 251.1))
    live = [fate(COMMAND, k, ms, 20) for k, (ms, _) in enumerate(moved_ms)]
    twin = [fate(COMMAND, k, ms, 30) for k, (_, ms) in enumerate(moved_ms)]
    found = _compared(tmp_path, live, twin, a_scenario(network={"timeline": [ramp]}))
    assert (found.n_set_aside, found.n_compared, found.n_different) == (2, 4, 4)


def test_what_came_after_a_change_while_running_is_set_aside(tmp_path: Path) -> None:
    note = ControlNote(at_ns=14 * MS, applied_ns=15 * MS, request="{}", accepted=True)
    live = [fate(COMMAND, 0, 10, 20), fate(COMMAND, 1, 16, 99), Record(CONTROL, note.at_ns, note)]
    twin = [fate(COMMAND, 0, 10, 20), fate(COMMAND, 1, 16, 20)]
    found = _compared(tmp_path, live, twin, a_scenario())
    assert (found.n_set_aside, found.n_compared, found.n_different) == (1, 1, 0)
