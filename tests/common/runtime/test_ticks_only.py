"""The instrument that measures what recording costs: ticks and nothing else, none of them before the end."""

import json
from pathlib import Path

import pytest

from tests.log_reader import LogReader
from tis.common.node import Record
from tis.common.records import FATES, TICKS, CounterNote, FateBatch, TickNote
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.recorder import RECORD_VARIABLE, ThreadedRecorder, TicksOnly, recorder_for


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
