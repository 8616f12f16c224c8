"""Fates of two runs, packet by packet."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from tests.deploy.report.hand_made import ARM, COMMAND, MS, a_scenario, fate, write_log
from tis.common.node import Record
from tis.common.records import CONTROL, ControlNote, FateBatch
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.run.consistency import FateComparison, compare_fates
from tis.netem.expected.simulate import simulate

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
    assert found == FateComparison(n_compared=2, n_different=0, n_moved=0, n_set_aside=0, n_in_one_only=0)
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


def test_packets_that_moved_over_an_outages_edge_are_held_against_the_outage(tmp_path: Path) -> None:
    """Edges at 1000 and 1500 ms: moved is what lay inside in one run and outside in the other, only that.

    0 to 2 had the fate of their own ms, in both runs; 3 had it in neither, 4 in the twin only. 5 to 7 did not move.
    """
    moved_ms = ((999.9, 1000.0), (1000.0, 999.9), (1499.9, 1500.0), (999.9, 1000.0), (1499.9, 1500.0))
    stayed_ms = ((990.0, 999.9), (1000.0, 1499.9), (1500.0, 1500.1))
    pairs = list(enumerate(moved_ms + stayed_ms))

    def decided(k: int, ms: float, right: bool) -> Record:
        out = (1000 <= ms < 1500) is right
        return fate(COMMAND, k, ms, None, "outage" if out else "deliver")

    live = [decided(k, ms, k not in (3, 4)) for k, (ms, _) in pairs]
    twin = [decided(k, ms, k != 3) for k, (_, ms) in pairs]
    found = _compared(tmp_path, live, twin, a_scenario(network=OUTAGE))
    assert found == FateComparison(n_compared=8, n_different=2, n_moved=5, n_set_aside=0, n_in_one_only=0)


def test_foreign_packets_are_nobodys_to_compare_and_nothing_is_not_identical(tmp_path: Path) -> None:
    live = [fate(COMMAND, 0, 0, 20, foreign=True)]
    found = _compared(tmp_path, live, [fate(COMMAND, 0, 0, 30)], a_scenario())
    assert (found.n_compared, found.n_in_one_only, found.identical) == (0, 1, False)


def test_copies_and_flips_are_compared_and_a_full_buffer_only_by_its_loss(tmp_path: Path) -> None:
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


def _drawn(scenario: Scenario, offered_ms: list[float]) -> list[Record]:
    """What the models give packets of one key, by the vectorised path."""
    offered_ns = np.round(np.array(offered_ms) * MS).astype(np.int64)
    traces = load_traces(scenario.network)
    drawn = simulate(scenario.network, "forward", scenario.seed, offered_ns, 100, traces, COMMAND)
    return [
        fate(COMMAND, k, ms, drawn.delay_ns[k] / MS, "outage" if drawn.outage[k] else "loss" if lost else "deliver")
        for k, (ms, lost) in enumerate(zip(offered_ms, drawn.lost, strict=True))
    ]


CORRELATED = {"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 90}, "correlation": {"half_life_s": 0.01}}


@pytest.mark.parametrize(
    ("network", "n_moved", "n_unlike"),
    [
        ({"forward": {"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 90}}}, 0, 0),
        ({"forward": CORRELATED}, 300, 300),
        ({"forward": {"delay": {"kind": "trace", "path": "TRACE", "advance": "time"}}}, 300, 12),
        ({"forward": {"delay": {"kind": "trace", "path": "TRACE", "advance": "packet"}}}, 0, 0),
        ({"forward": {"loss": {"kind": "trace", "path": "TRACE", "advance": "time"}}}, 300, 24),
        ({"timeline": [{"at_s": 2, "for_s": 4, "ramp_s": 1, "set": {"add_delay_ms": 500}}]}, 60, 60),
    ],
)
def test_packets_that_moved_to_another_ms_are_held_against_the_models(
    tmp_path: Path, network: dict[str, Any], n_moved: int, n_unlike: int
) -> None:
    """300 packets at 30 Hz, in the live run 0.9 ms later: none is set aside, whether their fates are equal or not.

    A row of the trace begins every 400 ms, with every 12th packet: 24 cross one, every other is lost and has no delay
    of its own. What was drawn is from the vectorised path.
    """
    trace = tmp_path / "trace.csv"
    rows = [f"{0.4 * i + 0.001:.3f},{'' if i % 2 else 20 + i}" for i in range(1, 25)]
    trace.write_text("\n".join(["sent_s,delay_ms", "0,20", *rows]))
    scenario = a_scenario(10.0, network=json.loads(json.dumps(network).replace("TRACE", str(trace))))
    at_ms = [k * 100 / 3 + 0.5 for k in range(300)]
    live, twin = _drawn(scenario, [ms + 0.9 for ms in at_ms]), _drawn(scenario, at_ms)
    found = _compared(tmp_path, live, twin, scenario)
    assert found == FateComparison(300, n_different=0, n_moved=n_moved, n_set_aside=0, n_in_one_only=0)
    assert sum(_decision(one) != _decision(other) for one, other in zip(live, twin, strict=True)) == n_unlike
    late = [*live[:70], _a_ns_later(live[70]), *live[71:]]
    assert _again(tmp_path, late, scenario).n_different == 1


def _decision(record: Record) -> tuple[object, ...]:
    assert isinstance(record.data, FateBatch)
    return record.data.outcome, record.data.delay_ns


def _a_ns_later(record: Record) -> Record:
    assert isinstance(record.data, FateBatch)
    return structs.replace(record, data=structs.replace(record.data, delay_ns=(record.data.delay_ns[0] + 1,)))


def _again(tmp_path: Path, live: list[Record], scenario: Scenario) -> FateComparison:
    """Compare another live run with the twin that is there."""
    write_log(tmp_path / "live", "netem", live)
    return compare_fates(load_run(tmp_path / "live"), load_run(tmp_path / "twin"), scenario)


def test_what_moved_without_its_trace_is_set_aside(tmp_path: Path) -> None:
    scenario = a_scenario(network={"forward": {"delay": {"kind": "trace", "path": "no.csv", "advance": "time"}}})
    live = [fate(COMMAND, 0, 5.1, 20), fate(COMMAND, 1, 7.9, 20)]
    twin = [fate(COMMAND, 0, 5.9, 20), fate(COMMAND, 1, 8.1, 20)]
    found = _compared(tmp_path, live, twin, scenario)
    assert found == FateComparison(n_compared=1, n_different=0, n_moved=0, n_set_aside=1, n_in_one_only=0)
    assert found.set_aside_share == 0.5


def test_what_came_after_a_change_while_running_is_set_aside(tmp_path: Path) -> None:
    note = ControlNote(at_ns=14 * MS, applied_ns=15 * MS, request="{}", accepted=True)
    live = [fate(COMMAND, 0, 10, 20), fate(COMMAND, 1, 16, 99), Record(CONTROL, note.at_ns, note)]
    twin = [fate(COMMAND, 0, 10, 20), fate(COMMAND, 1, 16, 20)]
    found = _compared(tmp_path, live, twin, a_scenario())
    assert (found.n_set_aside, found.n_compared, found.n_different) == (1, 1, 0)
