"""Files made to exhaust memory or time: refused by their limits, in the space and time that their size admits."""

import os
import struct
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from rich.console import Console

from tests.deploy.logs.hostile_files import (
    MIB,
    channel,
    chunk,
    message,
    packed,
    record,
    repeated,
    text,
    write,
)
from tis.common.channels import Side
from tis.common.errors import DataError
from tis.common.node import Record
from tis.common.records import TickNote
from tis.common.runtime.mcap_log import McapLog
from tis.deploy.logs.blocks import FREE_RECORDS, MAX_CHANNELS, MAX_NUMBER
from tis.deploy.logs.describe import print_file
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.log_paths import recovery_of
from tis.deploy.logs.read.load import load_side
from tis.deploy.logs.recover import recover

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data" / "hostile"
SIDES: tuple[Side, ...] = ("surgeon", "netem", "patient")
NOTHING = Console(file=open(os.devnull, "w"), highlight=False)  # noqa: PTH123, SIM115


def _damage(path: Path) -> str:
    log = LogFile(path)
    list(log.blocks())
    return str(log.damage)


def _peak_mb(read: Callable[[], object]) -> float:
    tracemalloc.start()
    try:
        read()
        return tracemalloc.get_traced_memory()[1] * 1e-6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("n_bytes", [1000, 2**63])
def test_a_frame_larger_than_its_chunk_is_not_unpacked(tmp_path: Path, n_bytes: int) -> None:
    data = zstandard.ZstdCompressor().compressobj(size=10 << 30).compress(bytes(MIB))
    path = write(tmp_path / "a.mcap", chunk(data, n_bytes, "zstd"))
    assert _peak_mb(lambda: _damage(path)) < 5
    assert f"a chunk states {n_bytes} bytes" in _damage(path)


def test_an_lz4_frame_larger_than_its_chunk_is_not_unpacked(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", chunk(lz4.frame.compress(bytes(64 * MIB)), 1000, "lz4"))
    assert _peak_mb(lambda: _damage(path)) < 5
    assert "more than it states" in _damage(path)


def test_a_frame_of_unknown_size_takes_no_more_than_its_chunk_states(tmp_path: Path) -> None:
    packer = zstandard.ZstdCompressor().compressobj()
    data = packer.compress(bytes(8 * MIB)) + packer.flush()
    assert "cannot be decompressed" in _damage(write(tmp_path / "a.mcap", chunk(data, 1000, "zstd")))
    assert "a record is invalid" not in _damage(write(tmp_path / "b.mcap", chunk(data, 8 * MIB, "zstd")))


def test_many_messages_without_content_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", repeated(message(b""), 9 * MIB, channel(1, "/tis/ticks")))
    assert path.stat().st_size < 5000
    log = LogFile(path)
    assert _peak_mb(lambda: list(log.blocks())) < 60
    assert "a chunk has more than" in str(log.damage)


def test_many_chunks_of_messages_are_refused_and_the_first_are_kept(tmp_path: Path) -> None:
    one = repeated(message(b""), 2 * MIB, channel(1, "/tis/ticks"))
    path = write(tmp_path / "a.mcap", *[one] * 12)
    log = LogFile(path)
    n_messages = sum(len(block.start) for block in log.blocks())
    assert 0.7 * FREE_RECORDS < n_messages <= FREE_RECORDS + path.stat().st_size
    assert "records" in str(log.damage)
    assert log.gap_bytes > 0


def test_chunks_that_expand_too_far_are_refused(tmp_path: Path) -> None:
    one = repeated(record(0x70, bytes(MIB - 9)), 48 * MIB)
    assert "times the bytes of the file" in _damage(write(tmp_path / "a.mcap", *[one] * 4))


@pytest.mark.parametrize("zeros", [bytes(50_000), repeated(bytes(1), 32 * MIB), packed(bytes(50_000))], ids=range(3))
def test_zeros_are_no_records(tmp_path: Path, zeros: bytes) -> None:
    assert "damaged" in _damage(write(tmp_path / "a.mcap", zeros)) or zeros[:1] == b"\0"
    assert recover(tmp_path / "a.mcap", tmp_path / "b.mcap").n_messages == 0


def test_chunks_in_chunks_are_not_unpacked(tmp_path: Path) -> None:
    inner = packed(channel(1, "/a") + message(b"{}"))
    log = LogFile(write(tmp_path / "a.mcap", packed(inner)))
    assert sum(len(block.start) for block in log.blocks()) == 0


@pytest.mark.parametrize("length", [4, 2**31, 2**62, 2**64 - 1])
@pytest.mark.parametrize("opcode", [Opcode.ATTACHMENT, Opcode.METADATA, Opcode.CHANNEL, Opcode.SCHEMA, Opcode.CHUNK])
def test_lengths_beyond_the_file_or_the_record_are_damage(tmp_path: Path, opcode: int, length: int) -> None:
    """A record that is longer than the file, and texts within one that are longer than it."""
    long_record = struct.pack("<BQ", opcode, length) + bytes(3)
    inner = struct.pack("<I", min(length, 2**32 - 1))
    starts = {Opcode.ATTACHMENT: 16, Opcode.METADATA: 0, Opcode.CHANNEL: 4, Opcode.SCHEMA: 2, Opcode.CHUNK: 28}
    long_text = record(opcode, bytes(starts[opcode]) + inner + b"abc")  # type: ignore[index]
    for k, content in enumerate((long_record, long_text)):
        path = write(tmp_path / f"{k}.mcap", content)
        assert LogFile(path).damage is None
        assert _peak_mb(lambda p=path: _damage(p)) < 5  # type: ignore[misc]
        assert _damage(path) != "None"
        assert recover(path, tmp_path / f"{k}r.mcap").n_messages == 0


def test_an_attachment_longer_than_its_record_is_damage(tmp_path: Path) -> None:
    content = bytes(16) + text("a") + text("b") + struct.pack("<Q", 2**63) + b"abc"
    assert "exceed the record" in _damage(write(tmp_path / "a.mcap", record(Opcode.ATTACHMENT, content)))


def test_a_summary_that_is_nowhere_is_ignored(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", chunk(message(b"{}"), len(message(b"{}")), ""))
    for start in (2**63 + 5, 2**62, 30):
        footer = record(Opcode.FOOTER, struct.pack("<QQI", start, 2**62, 0)) + MCAP0_MAGIC
        (tmp_path / "b.mcap").write_bytes(path.read_bytes()[: -len(footer)] + footer)
        assert recover(tmp_path / "b.mcap", tmp_path / f"{start}.mcap").damage == "messages without a channel"
        assert recovery_of(tmp_path / "b.mcap") is None


def test_more_channels_than_any_recording_has_are_refused(tmp_path: Path) -> None:
    many = b"".join(channel(k, f"/{k}") for k in range(MAX_CHANNELS + 1))
    with pytest.raises(DataError, match=rf"a\.mcap: channels: must be at most {MAX_CHANNELS} \(got 4097\)"):
        _damage(write(tmp_path / "a.mcap", packed(many)))


def test_heads_of_chunks_that_overlap_are_searched_in_time(tmp_path: Path) -> None:
    """Each head claims the whole rest of the file: 5000 times 200 kB would be read."""
    n, size = 5000, 69
    fake = b"".join(
        record(Opcode.CHUNK, struct.pack("<QQQII", 0, 0, MIB, 7, 0) + struct.pack("<Q", (n - k - 1) * size + 20))[
            :size
        ]
        for k in range(n)
    )
    heads = bytearray(fake.ljust(n * size, b"\0"))
    for k in range(n):
        struct.pack_into("<Q", heads, k * size + 1, (n - k - 1) * size + 20 + 40)
    path = write(tmp_path / "a.mcap", b"\0", bytes(heads))
    assert recover(path, tmp_path / "b.mcap").n_messages == 0


@pytest.mark.parametrize("stamp", ["log_ns", "publish_ns"])
def test_stamps_beyond_63_bits_are_damage_and_can_be_recovered(tmp_path: Path, stamp: str) -> None:
    good = packed(channel(1, "/a") + message(b"{}"))
    path = write(tmp_path / "a.mcap", good, packed(message(b"{}", **{stamp: 2**63})))
    assert "beyond 2**63 ns" in _damage(path)
    assert recover(path, tmp_path / "b.mcap").n_messages == 1


@pytest.mark.parametrize("cut", range(1, 70))
def test_a_chunk_whose_head_the_file_cuts_is_none(tmp_path: Path, cut: int) -> None:
    path = write(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(path.read_bytes()[:40] + b"\0" + packed(message(b"{}"))[:cut])
    assert recover(tmp_path / "b.mcap", tmp_path / "c.mcap").n_messages == 0


PAYLOADS = [b"", b"[" * 100_000, b"{}},{", b"nonsense", b'{"tick":NaN}', b'{"name":"a","value":' + b"9" * 5000 + b"}"]


@pytest.mark.parametrize(
    "payload", [*PAYLOADS, b"5", b"[]", b'{"name":"a","value":4611686018427387905}', b'{"name":[]}'], ids=range(10)
)
@pytest.mark.parametrize("topic", ["/tis/counters", "/tis/ticks", "/tis/fates", "/tis/processors"])
def test_records_of_other_kinds_are_one_line(tmp_path: Path, topic: str, payload: bytes) -> None:
    path = write(tmp_path / "a.mcap", packed(channel(1, topic) + message(payload) + message(payload)))
    with pytest.raises(DataError, match=f"{topic}: holds records that this version does not know"):
        load_side(path, "patient")


@pytest.mark.parametrize(
    "payload", [b"", b"nonsense", b'{"sample_ns":"x"}', b'{"sample_ns":1e30}', b"[" * 1000], ids=range(5)
)
def test_messages_that_are_no_json_are_one_line(tmp_path: Path, payload: bytes) -> None:
    path = write(tmp_path / "a.mcap", packed(channel(1, "tis/PSM2/setpoint_cp") + message(payload)))
    with pytest.raises(DataError, match="tis/PSM2/setpoint_cp: holds records"):
        load_side(path, "patient")


@pytest.mark.parametrize(("stamp", "name"), [("log_ns", "log_time"), ("publish_ns", "publish_time")])
def test_an_instant_of_no_run_is_refused(tmp_path: Path, stamp: str, name: str) -> None:
    path = write(tmp_path / "a.mcap", packed(channel(1, "/a") + message(b"{}", **{stamp: MAX_NUMBER + 1})))
    with pytest.raises(DataError, match=f"{name}: must be at most {MAX_NUMBER} ns"):
        load_side(path, "patient")


def test_a_record_of_endless_lists_is_refused(tmp_path: Path) -> None:
    payload = b'{"a":[' + b"[]," * (2 * MIB) + b"0]}"
    path = write(tmp_path / "a.mcap", packed(channel(1, "/a") + message(payload)))
    assert path.stat().st_size < 2000
    with pytest.raises(DataError, match="/a: holds records"):
        load_side(path, "patient")


@pytest.mark.parametrize(
    "marked", [{"lost_bytes": "9" * 5000, "unknown_ns": "1" * 5000 + "-"}, {"lost_bytes": "x"}, {}]
)
def test_a_recovered_log_with_absurd_marks_is_read(tmp_path: Path, marked: dict[str, str]) -> None:
    about = text(b"".join(text(key) + text(value) for key, value in marked.items()))
    path = write(
        tmp_path / "a.mcap", record(Opcode.METADATA, text("recovered") + about), channel(1, "/a"), message(b"{}")
    )
    assert load_side(path, "netem").coverage.lost_bytes is None
    assert print_file(path, NOTHING, NOTHING) == 0
    (tmp_path / "cut.mcap").write_bytes(path.read_bytes()[:-8])
    assert recover(tmp_path / "cut.mcap", tmp_path / "b.mcap").n_messages == 1


def _whole_log(path: Path) -> bytes:
    with McapLog(path, {"side": "netem"}) as log:
        log.attach("scenario.yaml", b"x")
        for k in range(60):
            log.record(Record("/tis/ticks", 10 * k, TickNote(tick=k, due_ns=10 * k, begin_ns=10 * k + 1)))
            log.record(Record("tis/MTML/measured_cp", 10 * k, b'{"sample_ns":5}'))
            if k % 20 == 19:
                log.flush()
    return path.read_bytes()


CHANGES = st.lists(st.tuples(st.floats(0, 1), st.binary(max_size=9), st.integers(0, 9)), min_size=1, max_size=4)


@settings(max_examples=60)
@given(changes=CHANGES)
def test_a_mutated_log_is_read_recovered_or_refused(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[float, bytes, int]]
) -> None:
    folder = tmp_path_factory.mktemp("mutated")
    content = _whole_log(folder / "whole.mcap")
    for at, new, n_old in changes:
        place = int(at * len(content))
        content = content[:place] + new + content[place + n_old :]
    read_in_every_way(content, folder)


@settings(max_examples=80)
@given(content=st.binary(max_size=300))
def test_any_bytes_after_the_magic_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    read_in_every_way(MCAP0_MAGIC + content, tmp_path_factory.mktemp("any"))


@pytest.mark.parametrize("name", [f"crash_{k}.mcap" for k in range(4)])
def test_the_shared_hostile_files_are_read_or_refused(tmp_path: Path, name: str) -> None:
    if not SHARED.is_dir():
        pytest.skip("no hostile files here: ../shared/data/hostile beside the checkout")
    read_in_every_way((SHARED / name).read_bytes(), tmp_path)


def read_in_every_way(content: bytes, folder: Path) -> None:
    path = folder / "a.mcap"
    path.write_bytes(content)
    (folder / "b.mcap").unlink(missing_ok=True)
    with suppress(DataError):
        print_file(path, NOTHING, NOTHING)
    with suppress(DataError):
        recover(path, folder / "b.mcap")
    recovery_of(path)
    for side in SIDES:
        with suppress(DataError):
            load_side(path, side)
