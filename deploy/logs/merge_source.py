"""One side's log as a source of the merge: pieces with new channel numbers, on the reference clock."""

import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from tis.common.channels import Direction, Side, direction_of
from tis.common.clocks import SHARED, ClockModel
from tis.common.runtime.chunk_writer import Ints
from tis.deploy.logs.blocks import FIELDS, OF_FIELDS, Block, record_heads
from tis.deploy.logs.coverage import FOREVER
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.read.clocks import Clocks
from tis.deploy.logs.read.load import check_written_by_tis

Register = Callable[[Side, Channel, Schema | None], int]

_STAMP: Final = struct.Struct("<Q")
_SENDER: Final[dict[Direction, Side]] = {"forward": "surgeon", "feedback": "patient"}


class Piece(NamedTuple):
    """N messages as records of the merged file, with the columns of their headers, (N,) each."""

    records: list[bytes]
    channel: Ints
    seq: Ints
    log_ns: Ints
    publish_ns: Ints


class MergeSource:
    """Reads one side's log piece by piece; no later message is before `watermark_ns`.

    The publish stamp of a received message is on its sender's clock. A side writes some records ahead of time or in
    batches, so the order within its log is loose; the chunks' earliest instants give the watermark.
    """

    def __init__(self, path: Path, side: Side, session: str, clocks: Clocks, register: Register) -> None:
        self.file, self.side = LogFile(path), side
        self.n_messages = 0
        self._session, self._clocks, self._register = session, clocks, register
        self._blocks = self.file.blocks()
        self._ids: dict[int, int] = {}
        self._clock: ClockModel = clocks.get(side, SHARED)
        self._publish_clocks: dict[int, ClockModel] = {}
        self._starts_ns = _no_earlier_than(self._clock.to_reference_ns(np.fromiter(_heads(path), dtype=np.int64)))
        self._ended = False

    @property
    def watermark_ns(self) -> int:
        """Return the earliest possible instant of the messages still to come; `FOREVER` at the end."""
        n_read = self.file.n_chunks
        return int(self._starts_ns[n_read]) if n_read < len(self._starts_ns) and not self._ended else FOREVER

    def next_piece(self) -> Piece | None:
        """Return the next messages; None at the end or at damage."""
        block = next(self._blocks, None)
        self._ended = block is None
        check_written_by_tis(self.file)  # the header is known only once the first block has been read
        return None if block is None else self._piece(block)

    def _piece(self, block: Block) -> Piece:
        old, which = np.unique(block.channel, return_inverse=True)
        channel = np.array([self._merged_id(i) for i in old.tolist()], dtype=np.int64)[which]
        # MCAP stamps are unsigned: an aligned stamp before run time 0 becomes 0
        log_ns = np.maximum(self._clock.to_reference_ns(block.log_ns), 0)
        publish_ns = block.publish_ns.copy()
        for i, clock in ((i, self._publish_clocks[i]) for i in old.tolist()):
            its = block.channel == i
            publish_ns[its] = clock.to_reference_ns(publish_ns[its])
        publish_ns = np.maximum(publish_ns, 0)
        # headers are replaced in one copy of the body; payloads stay untouched
        heads = np.empty(len(channel), dtype=FIELDS)
        heads["channel"], heads["seq"], heads["log"], heads["publish"] = channel, block.seq, log_ns, publish_ns
        body = bytearray(block.body)
        if len(channel):
            places = block.start[:, np.newaxis] + OF_FIELDS
            np.frombuffer(body, dtype=np.uint8)[places] = heads.view(np.uint8).reshape(-1, FIELDS.itemsize)
        content = bytes(body)
        records = [content[a:b] for a, b in zip(block.start.tolist(), block.end.tolist(), strict=True)]
        self.n_messages += len(records)
        return Piece(records, channel, block.seq, log_ns, publish_ns)

    def _merged_id(self, channel_id: int) -> int:
        if channel_id not in self._ids:
            channel = self.file.channels[channel_id]
            self._ids[channel_id] = self._register(self.side, channel, self.file.schemas.get(channel.schema_id))
            direction = direction_of(channel.topic, self._session)
            sender = self.side if direction is None else _SENDER[direction]
            self._publish_clocks[channel_id] = self._clocks.get(sender, SHARED)
        return self._ids[channel_id]


def _no_earlier_than(starts_ns: Ints) -> Ints:
    """Return for each chunk the earliest instant in it and in all later chunks."""
    return np.minimum.accumulate(starts_ns[::-1])[::-1]


def _heads(path: Path) -> Iterator[int]:
    with path.open("rb") as file, suppress(ValueError):
        for opcode, length in record_heads(file, path.stat().st_size):
            if opcode == Opcode.DATA_END:
                return
            # a chunk's record begins with its earliest stamp
            if opcode == Opcode.CHUNK and length >= _STAMP.size:
                yield min(_STAMP.unpack(file.read(_STAMP.size))[0], FOREVER)
