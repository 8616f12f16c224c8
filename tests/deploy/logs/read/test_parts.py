"""A log of several parts is read as one, with the gaps between them."""

from pathlib import Path
from typing import Any

import pytest

from tis.common.errors import DataError
from tis.common.node import Record
from tis.common.records import COUNTERS, TICKS, CounterNote, TickNote
from tis.common.runtime.log_parts import CLOCK_FILE, PartClock
from tis.common.runtime.mcap_log import McapLog
from tis.deploy.logs.read.load import load_parts, load_run, load_side, run_id_in, scenario_in

S = 1_000_000_000


def _part(
    path: Path, ticks: range, joined_s: float | None = None, run_id: int = 7, counts: bool = True, epoch_ns: int = 5
) -> Path:
    """Write a tick a second with a counter at the end."""
    clock = PartClock(
        epoch_monotonic_ns=epoch_ns, epoch_unix_ns=1000 * S, run_id=run_id, boot="b",
        joined_ns=None if joined_s is None else int(joined_s * S), counts_gap=counts,
    )  # fmt: skip
    with McapLog(path, {"side": "patient", "digest": "d"}) as log:
        log.attach(CLOCK_FILE, clock.model_dump_json().encode())
        log.attach("model.json", b"first" if joined_s is None else b"later")
        for k in ticks:
            log.record(Record(TICKS, k * S, TickNote(tick=k, due_ns=k * S, begin_ns=k * S)))
            log.flush()
        for name, value in (("received", len(ticks)), ("lead_ns", ticks.start)):
            log.record(Record(COUNTERS, ticks.stop * S, CounterNote(name=name, value=value)))
    return path


def test_parts_are_read_as_one_log(tmp_path: Path) -> None:
    paths = [_part(tmp_path / "patient.mcap", range(4)), _part(tmp_path / "patient_2.mcap", range(7, 10), 6.5)]
    log = load_parts(paths, "patient")
    assert log.of(TICKS).column("tick").tolist() == [0, 1, 2, 3, 7, 8, 9]
    assert {row["name"]: row["value"] for row in log.of(COUNTERS)} == {"received": 7, "lead_ns": 7}
    assert (log.last_ns, log.n_messages) == (10 * S, 11)
    assert log.attachments["model.json"] == b"first"
    assert log.coverage.away == ((4 * S, 6 * S + S // 2),)
    assert (log.coverage.whole, log.coverage.problem) == (True, None)
    assert load_run(tmp_path).sides["patient"].coverage == log.coverage


def test_figures_leave_a_gap_out_where_the_scenario_says_so(tmp_path: Path) -> None:
    first, second = tmp_path / "patient.mcap", tmp_path / "patient_2.mcap"
    paths = [_part(first, range(4)), _part(second, range(7, 10), 6.5, counts=False)]
    coverage = load_parts(paths, "patient").coverage
    gap = ((4 * S, 6 * S + S // 2),)
    assert (coverage.unknown, coverage.away, coverage.left_out, coverage.problem) == (gap, gap, gap, None)


def test_a_part_whose_process_was_killed_is_unknown_for_a_second_at_most(tmp_path: Path) -> None:
    first = _part(tmp_path / "patient.mcap", range(4))
    first.write_bytes(first.read_bytes()[:-2000])
    last_ns = load_side(first, "patient").last_ns
    coverage = load_parts([first, _part(tmp_path / "patient_2.mcap", range(7, 10), 6.5)], "patient").coverage
    assert last_ns < 4 * S
    assert coverage.unknown == ((last_ns, last_ns + S),)
    assert coverage.away == ((last_ns, 6 * S + S // 2),)
    assert coverage.problem is None


@pytest.mark.parametrize(
    ("changed", "why"), [({"run_id": 8}, "of another run"), ({"joined_s": None}, "of another run"),
                         ({"epoch_ns": 2_000_000}, "on another clock")],
)  # fmt: skip
def test_a_part_that_does_not_continue_the_log_is_refused(
    tmp_path: Path, changed: dict[str, float], why: str
) -> None:
    words: dict[str, Any] = {"joined_s": 6.5, **changed}
    _part(tmp_path / "patient.mcap", range(4))
    _part(tmp_path / "patient_2.mcap", range(7, 10), **words)
    with pytest.raises(DataError, match=f"patient_2.mcap: does not continue patient.mcap: it is {why}|{why}"):
        load_run(tmp_path)


def test_a_part_of_a_process_that_was_in_no_run_is_passed_over(tmp_path: Path) -> None:
    paths = [_part(tmp_path / f"patient{end}.mcap", range(1)) for end in ("", "_2", "_3")]
    with McapLog(tmp_path / "other", {"side": "patient"}) as void:
        void.attach("scenario.yaml", b"version: 1")
    (tmp_path / "other").replace(paths[1])
    paths[2].unlink()
    paths[2] = _part(paths[2], range(3, 5), 2.5)
    log = load_parts(paths, "patient")
    assert log.of(TICKS).column("tick").tolist() == [0, 3, 4]
    paths[1].write_bytes(b"")
    assert load_parts(paths, "patient").coverage == log.coverage


def test_a_later_part_without_the_first_lacks_all_before_it(tmp_path: Path) -> None:
    first = tmp_path / "patient.mcap"
    first.write_bytes(b"")
    coverage = load_parts([first, _part(tmp_path / "patient_2.mcap", range(7, 10), 6.5)], "patient").coverage
    assert coverage.away == ((0, 6 * S + S // 2),)
    assert coverage.unknown == ((0, S),)


def test_logs_of_different_runs_do_not_belong_together(tmp_path: Path) -> None:
    _part(tmp_path / "patient.mcap", range(4))
    surgeon = _part(tmp_path / "surgeon.mcap", range(4))
    assert run_id_in(load_run(tmp_path)) == 7
    surgeon.unlink()
    _part(surgeon, range(4), run_id=8)
    with pytest.raises(DataError, match="holds logs of different runs"):
        scenario_in(load_run(tmp_path))
