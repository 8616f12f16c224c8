import json
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from tests.every_message import every_message
from tests.log_reader import LogReader
from tests.nodes import a_pose
from tis.common.errors import DataError
from tis.common.messages import FeedbackPose, Pose, encode
from tis.common.node import Record
from tis.common.records import TickNote
from tis.common.runtime.mcap_log import McapLog, flat_schema
from tis.common.runtime.recorder import ThreadedRecorder


def _tick(k: int) -> Record:
    return Record("/tis/ticks", 10 * k, TickNote(tick=k, due_ns=10 * k, begin_ns=10 * k + 1))


def test_a_log_opens_in_the_reference_reader_with_its_schemas(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    payload = encode(a_pose(0.1))
    with McapLog(path, {"side": "surgeon"}) as log:
        log.attach("scenario.yaml", b"version: 1")
        log.record(_tick(1))
        log.record(Record("tis/MTML/measured_cp", 7, payload, Pose, publish_ns=5, seq=3))
    with path.open("rb") as file:
        reader = make_reader(file)
        found = [
            (schema.name if schema else "", channel.topic, m.log_time, m.publish_time, m.sequence, m.data)
            for schema, channel, m in reader.iter_messages(log_time_order=False)
        ]
        names = [a.name for a in reader.iter_attachments()]
    assert found[0][:5] == ("tis.TickNote", "/tis/ticks", 10, 10, 0)
    assert found[1] == ("tis.Pose", "tis/MTML/measured_cp", 7, 5, 3, payload)
    assert json.loads(found[0][5])["begin_ns"] == 11
    assert names == ["scenario.yaml"]


def test_after_a_flush_everything_survives_a_kill(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    log = McapLog(path, {"side": "surgeon"})
    for k in range(5):
        log.record(_tick(k))
    log.flush()
    log.record(_tick(5))
    reader = LogReader(path)  # the log is not closed: what is on disk is what a kill leaves
    assert [json.loads(m.data)["tick"] for _, m in reader.messages()] == [0, 1, 2, 3, 4]
    assert reader.damage is not None
    assert reader.metadata["side"] == "surgeon"
    log.close()


def _chunks(path: Path) -> list[tuple[int, int]]:
    """Return the first and last instant of each chunk, by the package's reader."""
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True).records
        return [(r.message_start_time, r.message_end_time) for r in records if isinstance(r, Chunk)]


def test_a_chunk_is_closed_when_it_spans_the_time_that_was_asked_for(tmp_path: Path) -> None:
    """Ticks every 10 ns, chunks of 35 ns: the fifth tick begins the second chunk, as 40 - 0 >= 35."""
    with McapLog(tmp_path / "a.mcap", {}, flush_every_ns=35) as log:
        for k in range(9):
            log.record(_tick(k))
    assert _chunks(tmp_path / "a.mcap") == [(0, 30), (40, 70), (80, 80)]


def test_what_comes_fast_reaches_the_disk_without_a_flush(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    log = McapLog(path, {})
    for k in range(5000):  # half a MB
        log.record(Record("/tis/x", k, b"x" * 100))
    read = sum(1 for _ in LogReader(path).messages())
    assert 3500 < read < 5000
    log.close()


def test_a_side_s_log_has_no_index_and_is_read_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with McapLog(path, {}) as log:
        for k in (2, 0, 1):
            log.record(_tick(k))
        log.attach("a.json", b"{}")
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert (summary.statistics.message_count, summary.statistics.chunk_count) == (3, 1)
        assert not summary.chunk_indexes
        assert [m.log_time for _, _, m in reader.iter_messages(topics=["/tis/ticks"])] == [0, 10, 20]
        assert [a.name for a in reader.iter_attachments()] == ["a.json"]


def test_every_cut_of_a_log_reads_a_prefix_and_never_raises(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with McapLog(path, {"side": "patient"}) as log:
        for k in range(300):
            log.record(_tick(k))
            if k % 50 == 0:
                log.flush()
    whole = path.read_bytes()
    for cut in range(8, len(whole), 97):
        short = tmp_path / "short.mcap"
        short.write_bytes(whole[:cut])
        ticks = [json.loads(m.data)["tick"] for _, m in LogReader(short).messages()]
        assert ticks == list(range(len(ticks)))


def test_an_unwritable_log_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be written: No such file or directory"):
        McapLog(tmp_path / "missing" / "a.mcap", {})


def test_an_earlier_log_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"precious")
    with pytest.raises(DataError, match="exists, from an earlier run: give another"):
        McapLog(tmp_path / "a.mcap", {})
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"


def test_schemas_have_neither_references_nor_alternatives() -> None:
    for model in every_message():
        text = flat_schema(model).decode()
        assert "$ref" not in text
        assert "anyOf" not in text
        assert "$defs" not in text
    assert json.loads(flat_schema(FeedbackPose))["properties"]["position_m"]["properties"]["x"]["type"] == "number"


def test_the_threaded_recorder_writes_everything_in_order(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorder = ThreadedRecorder(McapLog(path, {}))
    for k in range(1000):
        recorder.record(_tick(k))
    recorder.close()
    assert [json.loads(m.data)["tick"] for _, m in LogReader(path).messages()] == list(range(1000))


def test_a_full_disk_does_not_stop_the_run(tmp_path: Path) -> None:
    class FullDisk(McapLog):
        def record(self, record: Record) -> None:
            raise OSError(28, "No space left on device")

    recorder = ThreadedRecorder(FullDisk(tmp_path / "a.mcap", {}))
    for k in range(3):
        recorder.record(_tick(k))
    recorder.close()
    assert recorder.error is not None
    assert recorder.error.strerror == "No space left on device"
    assert recorder.n_dropped == 3
