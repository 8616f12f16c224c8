"""The recorder's bounds: what is dropped when the disk is slow, and that a lost log is told at once."""

import json
import shutil
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from tests.log_reader import LogReader
from tis.common.messages import Vector3
from tis.common.node import Record
from tis.common.records import COUNTERS, ESTIMATES, FATES, TICKS, CounterNote, EstimateNote, FateBatch, TickNote
from tis.common.runtime import recorder as recorder_module
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.recorder import RECORD_VARIABLE, ThreadedRecorder, TicksOnly, is_recomputable, recorder_for


class SlowLog:
    """A log that takes its first record only when it may."""

    def __init__(self) -> None:
        self.may = threading.Event()
        self.records: list[Record] = []

    def record(self, record: Record) -> None:
        self.may.wait(20)
        self.records.append(record)

    def flush(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def _tick(k: int) -> Record:
    return Record(TICKS, k, TickNote(tick=k, due_ns=k, begin_ns=k))


def _estimate(k: int) -> Record:
    note = EstimateNote(tick=k, t_ns=k, hand="left", estimator="hold", position_m=Vector3(x=0, y=0, z=0))
    return Record(f"{ESTIMATES}/hold", k, note)


def test_a_record_that_no_json_holds_is_counted_and_the_others_are_written(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorder = ThreadedRecorder(McapLog(path, {"side": "patient"}))
    recorder.record(_tick(0))
    recorder.record(Record(COUNTERS, 1, CounterNote(name="a lone surrogate \udce9", value=1)))
    recorder.record(_tick(1))
    recorder.close()
    assert recorder.error is None
    notes = [(topic, json.loads(message.data)) for topic, message in LogReader(path).messages()]
    assert [row["tick"] for topic, row in notes if topic == TICKS] == [0, 1]
    assert [(row["name"], row["value"]) for topic, row in notes if topic == COUNTERS] == [
        (f"unrecorded.{COUNTERS}", 1)
    ]


def test_what_a_replay_computes_again_is_dropped_first_and_everything_at_the_limit() -> None:
    log = SlowLog()
    recorder = ThreadedRecorder(log, max_bytes=300_000, soft_bytes=150_000)
    for k in range(400):
        recorder.record(_tick(k))
        recorder.record(_estimate(k))
    assert recorder.waiting_bytes <= 300_000
    n_ticks, n_estimates = recorder.unrecorded[TICKS], recorder.unrecorded[f"{ESTIMATES}/hold"]
    log.may.set()
    recorder.close()
    ticks = [record.data.tick for record in log.records if isinstance(record.data, TickNote)]
    estimates = [record.data.tick for record in log.records if isinstance(record.data, EstimateNote)]
    assert ticks == list(range(400 - n_ticks))
    assert estimates == list(range(400 - n_estimates))
    assert n_estimates > n_ticks + 50 > 50
    counters = {r.data.name: r.data.value for r in log.records if isinstance(r.data, CounterNote)}
    assert counters == {f"unrecorded.{TICKS}": n_ticks, f"unrecorded.{ESTIMATES}/hold": n_estimates}
    assert all(record.topic == COUNTERS for record in log.records[-2:])


def test_a_batch_counts_with_the_rows_that_the_largest_so_far_had() -> None:
    def batch() -> list[Record]:
        rows = tuple(range(1000))
        names = ("seq", "offered_ns", "delay_ns", "release_ns", "n_bytes", "copies", "flipped")
        columns: dict[str, Any] = dict.fromkeys(names, rows) | {"outcome": ("loss",) * 1000}
        return [Record(FATES, 0, FateBatch(direction="forward", key="k", **columns))]

    log = SlowLog()
    log.may.set()
    recorder = ThreadedRecorder(log, max_bytes=4_000_000)
    recorder.record_later(batch)
    while recorder.waiting_bytes:
        threading.Event().wait(0.001)
    log.may.clear()
    for _ in range(12):
        recorder.record_later(batch)
    assert recorder.unrecorded["batches"] == 2  # ten of 400 kB
    log.may.set()
    recorder.close()


def test_after_a_slow_moment_everything_is_recorded_again() -> None:
    log = SlowLog()
    recorder = ThreadedRecorder(log, max_bytes=30_000, soft_bytes=15_000)
    for k in range(30):
        recorder.record(_tick(k))
    log.may.set()
    while recorder.waiting_bytes:
        threading.Event().wait(0.001)
    recorder.record(_tick(99))
    recorder.close()
    assert [r.data.tick for r in log.records if isinstance(r.data, TickNote)][-1] == 99


def test_estimates_set_points_and_the_plant_are_computed_again_and_arrivals_are_not() -> None:
    assert is_recomputable("/tis/estimates/hold")
    assert is_recomputable("tis/PSM2/servo_cp")
    assert is_recomputable("/tis/plant")
    assert not is_recomputable("tis/PSM2/setpoint_cp")
    assert not is_recomputable(TICKS)


def test_a_deleted_folder_is_told_at_once(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    told = threading.Event()
    reasons: list[str] = []

    def on_error(error: OSError) -> None:
        reasons.append(str(error.strerror))
        told.set()

    recorder = ThreadedRecorder(McapLog(folder / "a.mcap", {}), on_error)
    recorder.record(_tick(0))
    shutil.rmtree(folder)
    assert told.wait(20)
    recorder.record(_tick(1))
    recorder.close()
    assert reasons == ["the file or its folder was deleted"]
    assert recorder.error is not None
    assert recorder.n_dropped == 1


def test_a_writer_that_lags_takes_turns_with_the_loops_until_it_has_caught_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[int, bool]] = []
    monkeypatch.setattr(recorder_module, "stand_behind", lambda thread, behind: asked.append((thread, behind)))
    log = SlowLog()
    recorder = ThreadedRecorder(log)
    recorder.keep_up()
    assert asked == [(0, True)]
    recorder.record(_tick(0))
    time.sleep(0.3)  # a real lag: the writer waits for the log
    assert recorder.lag_s >= 0.3
    recorder.keep_up()
    recorder.keep_up()
    (writer,) = [thread.native_id for thread in threading.enumerate() if thread.name == "recorder"]
    assert asked[1:] == [(writer, False)]
    log.may.set()
    while recorder.waiting_bytes:
        time.sleep(0.01)
    recorder.keep_up()
    assert asked[2:] == [(writer, True)]
    recorder.close()


def test_a_backlog_gives_the_writer_its_turn_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []
    monkeypatch.setattr(recorder_module, "stand_behind", lambda _, behind: asked.append(behind))
    log = SlowLog()
    recorder = ThreadedRecorder(log)
    for k in range(2000):
        recorder.record(_tick(k))
    assert asked == [True, False]
    log.may.set()
    recorder.close()
    recorder.keep_up()
    assert asked == [True, False, True]


def test_ticks_are_written_at_the_end_and_all_else_is_counted(tmp_path: Path) -> None:
    made = []

    def make() -> list[Record]:
        made.append(1)
        return [Record(FATES, 0, FateBatch(direction="forward", key="a"))]

    path = tmp_path / "a.mcap"
    recorder = TicksOnly(McapLog(path, {"side": "patient"}))
    for k in range(3):
        recorder.record(Record(TICKS, k, TickNote(tick=k, due_ns=k, begin_ns=k + 1)))
        recorder.record(Record("/tis/counters", k, CounterNote(name="x", value=k)))
    recorder.record_later(make)
    assert path.read_bytes() == b""
    recorder.close()
    found = [(topic, json.loads(m.data)["tick"]) for topic, m in LogReader(path).messages()]
    assert found == [(TICKS, 0), (TICKS, 1), (TICKS, 2)]
    assert (recorder.n_dropped, recorder.error, made) == (4, None, [])


def test_a_full_disk_is_told_at_the_end() -> None:
    class FullDisk:
        def record(self, record: Record) -> None:
            raise OSError(28, "No space left on device")

        def flush(self) -> None:
            pass

        def close(self) -> None:
            pass

    recorder = TicksOnly(FullDisk())
    recorder.record(Record(TICKS, 0, TickNote(tick=0, due_ns=0, begin_ns=1)))
    assert recorder.error is None
    recorder.close()
    assert recorder.error is not None


def test_only_the_environment_asks_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for value, kind in ((None, ThreadedRecorder), ("all", ThreadedRecorder), ("ticks", TicksOnly)):
        monkeypatch.delenv(RECORD_VARIABLE, raising=False)
        if value is not None:
            monkeypatch.setenv(RECORD_VARIABLE, value)
        recorder = recorder_for(McapLog(tmp_path / f"{value}.mcap", {}), lambda _: None)
        recorder.close()
        assert isinstance(recorder, kind)
