"""Damaged files: everything that is whole comes out, also behind the damage."""

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.deploy.logs.conftest import write_ros2
from tests.log_reader import LogReader
from tis.common.errors import DataError
from tis.common.node import Record
from tis.common.records import TickNote
from tis.common.runtime.mcap_log import McapLog
from tis.deploy.logs.recover import recover

N = 2000


def _log(path: Path) -> bytes:
    with McapLog(path, {"side": "netem"}) as log:
        log.attach("scenario.yaml", b"x")
        for k in range(N):
            log.record(Record("/tis/ticks", 10 * k, TickNote(tick=k, due_ns=10 * k, begin_ns=10 * k + 1)))
            if k % 100 == 99:
                log.flush()
    return path.read_bytes()


def _ticks(path: Path) -> list[int]:
    log = LogReader(path)
    ticks = [json.loads(m.data)["tick"] for _, m in log.messages()]
    assert log.damage is None
    return ticks


def test_a_file_that_ends_early_gives_its_beginning(tmp_path: Path) -> None:
    whole = _log(tmp_path / "a.mcap")
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    found = recover(tmp_path / "cut.mcap", tmp_path / "b.mcap")
    assert found.damage is not None
    assert "ends early" in found.damage
    assert found.n_gaps == 0
    ticks = _ticks(tmp_path / "b.mcap")
    assert ticks == list(range(found.n_messages))
    assert 0 < len(ticks) < N
    again = LogReader(tmp_path / "b.mcap")
    list(again.messages())
    assert again.metadata["side"] == "netem"
    assert again.attachments["scenario.yaml"] == b"x"


@pytest.mark.parametrize("hole", [b"\x00" * 500, b"\xff" * 500, b"\x06" * 500])
def test_chunks_behind_a_hole_are_found(tmp_path: Path, hole: bytes) -> None:
    """The hole tears one chunk or two: at most 200 of 2000 ticks, each chunk holding 100."""
    whole = _log(tmp_path / "a.mcap")
    at = len(whole) // 2
    (tmp_path / "holed.mcap").write_bytes(whole[:at] + hole + whole[at + len(hole) :])
    found = recover(tmp_path / "holed.mcap", tmp_path / "b.mcap")
    ticks = _ticks(tmp_path / "b.mcap")
    lost = sorted(set(range(N)) - set(ticks))
    assert found.damage is not None
    assert found.n_gaps >= 1
    assert len(ticks) == len(set(ticks)) == found.n_messages
    assert 100 <= len(lost) <= 200
    assert lost == list(range(lost[0], lost[-1] + 1))
    assert ticks[-1] == N - 1
    assert ticks == sorted(ticks)


def test_a_flipped_bit_costs_its_chunk_alone(tmp_path: Path) -> None:
    whole = bytearray(_log(tmp_path / "a.mcap"))
    at = whole.index(b"zstd", len(whole) // 3) + 60
    whole[at] ^= 0x10
    (tmp_path / "flipped.mcap").write_bytes(whole)
    found = recover(tmp_path / "flipped.mcap", tmp_path / "b.mcap")
    lost = set(range(N)) - set(_ticks(tmp_path / "b.mcap"))
    assert found.damage is not None
    assert len(lost) == 100


def test_without_the_first_chunk_channels_come_from_the_summary(tmp_path: Path) -> None:
    whole = bytearray(_log(tmp_path / "a.mcap"))
    at = whole.index(b"zstd") + 40
    whole[at : at + 4] = b"\x00\x11\x22\x33"
    (tmp_path / "b.mcap").write_bytes(whole)
    recover(tmp_path / "b.mcap", tmp_path / "c.mcap")
    assert _ticks(tmp_path / "c.mcap") == list(range(100, N))


def test_of_a_whole_file_nothing_is_written(tmp_path: Path) -> None:
    _log(tmp_path / "a.mcap")
    found = recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert (found.damage, found.gap_bytes, found.n_messages) == (None, 0, N)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.parametrize("chunked", [True, False])
def test_other_peoples_files_keep_their_profile_and_encoding(tmp_path: Path, chunked: bool) -> None:
    write_ros2(tmp_path / "a.mcap", chunked)
    (tmp_path / "a.mcap").write_bytes((tmp_path / "a.mcap").read_bytes()[:-8])  # the closing magic alone
    assert recover(tmp_path / "a.mcap", tmp_path / "b.mcap").n_messages == 100
    with (tmp_path / "b.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        schema, channel, message = next(iter(reader.iter_messages()))
        assert schema is not None
        assert (schema.name, schema.encoding, channel.message_encoding) == ("std_msgs/msg/String", "ros2msg", "cdr")
        assert message.log_time == 1_700_000_000_000_000_000
        assert [a.name for a in reader.iter_attachments()] == ["notes.txt"]


@pytest.mark.parametrize("content", [b"", b"hello, this is no log at all", b"\x89MCAP0\r\n"[:5]])
def test_a_file_that_is_no_log_is_refused_and_nothing_is_written(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(DataError, match="is no MCAP file"):
        recover(tmp_path / "x.mcap", tmp_path / "y.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["x.mcap"]
