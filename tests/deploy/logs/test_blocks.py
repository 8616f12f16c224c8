"""Files read in pieces, against the mcap package's own readers, message by message."""

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from tis.common.errors import DataError
from tis.common.runtime.chunk_writer import ChunkWriter, by_channel, encode_message
from tis.deploy.logs.blocks import parse_records
from tis.deploy.logs.log_file import LogFile

U32, U62 = st.integers(0, 2**32 - 1), st.integers(0, 2**62)
MESSAGES = st.lists(st.tuples(st.integers(0, 2), U32, U62, U62, st.binary(max_size=40)), max_size=60)
Read = list[tuple[str, int, int, int, bytes]]


def _by_package(path: Path) -> Read:
    with path.open("rb") as file:
        found = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [(c.topic, m.sequence, m.log_time, m.publish_time, m.data) for _, c, m in found]


def _by_blocks(log: LogFile) -> Read:
    return [
        (log.topic(channel), seq, log_ns, publish_ns, payload)
        for block in log.blocks()
        for channel, seq, log_ns, publish_ns, payload in zip(
            *(column.tolist() for column in (block.channel, block.seq, block.log_ns, block.publish_ns)),
            block.payloads(slice(None)),
            strict=True,
        )
    ]


@settings(max_examples=30)
@given(MESSAGES, st.sampled_from(list(CompressionType)), st.booleans(), st.integers(60, 2000))
def test_blocks_hold_what_the_packages_reader_finds(
    tmp_path_factory: pytest.TempPathFactory,
    messages: list[tuple[int, int, int, int, bytes]],
    compression: CompressionType,
    chunked: bool,
    chunk_size: int,
) -> None:
    path = tmp_path_factory.mktemp("blocks") / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=compression, use_chunking=chunked)
        writer.start()
        ids = [writer.register_channel(f"/{k}", "json", 0) for k in range(3)]
        for which, seq, log_ns, publish_ns, data in messages:
            writer.add_message(ids[which], log_ns, data, publish_ns, seq)
        writer.finish()  # type: ignore[no-untyped-call]
    log = LogFile(path)
    assert _by_blocks(log) == _by_package(path)
    assert log.damage is None


@settings(max_examples=30)
@given(MESSAGES, st.integers(1, 7))
def test_what_the_chunk_writer_writes_the_package_reads(
    tmp_path_factory: pytest.TempPathFactory, messages: list[tuple[int, int, int, int, bytes]], at_once: int
) -> None:
    path = tmp_path_factory.mktemp("writer") / "a.mcap"
    with path.open("wb") as file:
        writer = ChunkWriter(file, "test", chunk_bytes=300)
        schema = writer.register_schema("s", "jsonschema", b"{}")
        ids = np.array([writer.register_channel(f"/{k}", "json", schema, {"k": str(k)}) for k in range(3)])
        for first in range(0, len(messages), at_once):
            some = messages[first : first + at_once]
            records = [encode_message(int(ids[m[0]]), m[1], m[2], m[3], m[4]) for m in some]
            channel, log_ns = ids[[m[0] for m in some]], np.array([m[2] for m in some], dtype=np.int64)
            writer.add(records, channel, log_ns)
        writer.attach("a.json", "application/json", b"{}")
        writer.add_metadata("m", {"x": "y"})
        writer.finish()
    expected = [(f"/{which}", seq, log_ns, publish_ns, data) for which, seq, log_ns, publish_ns, data in messages]
    assert _by_package(path) == expected
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(messages)
        assert summary.statistics.attachment_count == summary.statistics.metadata_count == 1
        for k in range(3):  # through the message indexes, in order of time
            found = [(m.log_time, m.data) for _, _, m in reader.iter_messages(topics=[f"/{k}"])]
            assert found == sorted(((m[2], m[3 + 1]) for m in messages if m[0] == k), key=lambda entry: entry[0])
        assert [(a.name, a.data) for a in reader.iter_attachments()] == [("a.json", b"{}")]
        assert [dict(m.metadata) for m in reader.iter_metadata()] == [{"x": "y"}]


def test_message_indexes_point_at_their_messages(tmp_path: Path) -> None:
    """Each entry's offset in the chunk's data is that of a record of its channel and time."""
    from mcap.records import Chunk, MessageIndex
    from mcap.stream_reader import StreamReader, get_chunk_data_stream

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = ChunkWriter(file, "test")
        ids = [writer.register_channel(f"/{k}", "", 0, {}) for k in range(2)]
        records = [encode_message(ids[k % 2], k, 100 + k, 100 + k, bytes(k)) for k in range(7)]
        writer.add(records, np.array([ids[k % 2] for k in range(7)]), np.arange(100, 107))
        writer.finish()
    found, body = [], b""
    for record in StreamReader(io.BytesIO(path.read_bytes()), emit_chunks=True).records:
        if isinstance(record, Chunk):
            stream, length = get_chunk_data_stream(record)
            body = stream.read(length)
        elif isinstance(record, MessageIndex):
            for log_ns, offset in record.records:
                assert body[offset:].startswith(records[log_ns - 100])
                found.append((record.channel_id, log_ns))
    assert sorted(found) == sorted((ids[k % 2], 100 + k) for k in range(7))


def test_channels_are_told_apart_in_their_order() -> None:
    found = {channel: which.tolist() for channel, which in by_channel(np.array([7, 3, 7, 7, 3]))}
    assert found == {3: [1, 4], 7: [0, 2, 3]}
    assert list(by_channel(np.array([], dtype=np.int64))) == []


@pytest.mark.parametrize("cut", [1, 8, 20, 31])
def test_records_that_end_early_are_damaged(cut: int) -> None:
    with pytest.raises(ValueError, match="damaged"):
        parse_records(encode_message(1, 0, 5, 5, b"abc")[:-cut])


def test_a_file_that_is_none_or_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"hello")
    with pytest.raises(DataError, match="is no MCAP file"):
        list(LogFile(tmp_path / "a.mcap").blocks())
    with pytest.raises(DataError, match="cannot be read: No such file"):
        list(LogFile(tmp_path / "b.mcap").blocks())
