"""The logs of a run as one file: in order of time, on one clock, indexed, with what viewers draw beside the records.

Piece by piece: what is held at a time is the few seconds that the logs are out of step.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final, get_args

import numpy as np
from mcap.records import Channel, Schema
from pydantic import BaseModel

from common.channels import Side
from common.errors import DataError, Fault
from common.runtime.json_schema import flat_schema
from common.units import NS_PER_S
from deploy.logs import foxglove
from deploy.logs.alignment import Clocks
from deploy.logs.blocks import MESSAGE_HEAD_BYTES, Ints, by_channel
from deploy.logs.chunk_writer import ChunkWriter, encode_message
from deploy.logs.coverage import lack
from deploy.logs.drawn import DRAWN_HZ, Drawn, Records
from deploy.logs.scene import Scene
from deploy.logs.side_log import FOREVER, Piece, SideLog
from deploy.logs.topics import RunTopics, merged_topic

MERGED_VERSION: Final = "1"
_WORTH_A_SORT: Final = 20_000
_QUICK, _THOROUGH = 3, 9
_MEDIA: Final = {".json": "application/json", ".yaml": "application/yaml"}


@dataclass(frozen=True)
class Merged:
    """What a merged file holds: messages of each side and those drawn, and what was wrong with a log."""

    n_messages: Mapping[str, int]
    n_drawn: int
    problems: Sequence[str]


def merge_logs(
    logs: Mapping[Side, Path],
    target: Path,
    topics: RunTopics,
    clocks: Clocks,
    attachments: Mapping[str, bytes],
    lines: Iterable[Drawn] = (),
) -> Merged:
    """Write the merged file, whole or not at all; raises `DataError`.

    ``lines`` are of the run as a whole. A damaged log gives what can be read of it. Oracle: all messages sorted at
    once (tests/deploy/logs/test_merge).
    """
    partial = target.with_name(f".{target.name}.part")
    try:
        with partial.open("wb") as file:
            merged = _Merger(file, topics, clocks).run(logs, attachments, lines)
        partial.replace(target)
    except OSError as error:
        raise DataError(Fault(str(target), "", f"cannot be written: {error.strerror}")) from None
    finally:
        with suppress(OSError):  # nothing can be taken away from a disk that cannot be written
            partial.unlink(missing_ok=True)
    return merged


class _Merger:
    def __init__(self, file: BinaryIO, topics: RunTopics, clocks: Clocks) -> None:
        self._writer = ChunkWriter(file, "tis", level=_THOROUGH if topics.rate_hz <= DRAWN_HZ else _QUICK)
        self._topics, self._clocks = topics, clocks
        self._scene = Scene(topics, clocks)
        self._from: dict[int, tuple[Side, str]] = {}
        self._drawn_ids: dict[str, int] = {}
        self._n_drawn = 0
        # drawn messages may be of instants a little before the records that they were drawn at
        self._lag_ns = max(NS_PER_S // 2, 2 * NS_PER_S // topics.rate_hz)

    def run(self, logs: Mapping[Side, Path], attachments: Mapping[str, bytes], lines: Iterable[Drawn]) -> Merged:
        """Write everything."""
        sides = [
            SideLog(logs[side], side, self._topics.session, self._clocks, self._register)
            for side in get_args(Side)
            if side in logs
        ]
        incoming: list[Piece] = []
        held = [self._pieces_of(lines)]
        while True:
            behind = min(sides, key=lambda side: side.watermark_ns, default=None)
            piece = None if behind is None else behind.next_piece()
            if piece is not None:
                incoming.append(piece)
            until_ns = min((side.watermark_ns for side in sides), default=FOREVER)
            if until_ns == FOREVER:  # up to the logs' very ends, where one learns of damage
                incoming += [piece for side in sides for piece in iter(side.next_piece, None)]
            if until_ns < FOREVER and sum(len(piece.records) for piece in incoming) < _WORTH_A_SORT:
                continue
            complete, rest = _split(incoming, until_ns)
            incoming = [rest]
            held = self._write([*held, complete, self._pieces_of(self._draw(complete))], until_ns)
            if until_ns == FOREVER:
                break
        for name, data in {**_attached(sides), **attachments}.items():
            self._writer.attach(name, _MEDIA.get(Path(name).suffix, "application/octet-stream"), data)
        self._writer.add_metadata("run", self._metadata(sides))
        self._writer.finish()
        problems = [text for side in sides if (text := lack(side.file))]
        return Merged({side.side: side.n_messages for side in sides}, self._n_drawn, problems)

    def _write(self, held: list[Piece], until_ns: int) -> list[Piece]:
        """Write what is old enough for nothing to come before it; return the rest."""
        ready, rest = _split(held, until_ns if until_ns == FOREVER else until_ns - self._lag_ns)
        self._writer.add(ready.records, ready.channel, ready.log_ns)
        return [rest]

    def _draw(self, piece: Piece) -> Iterable[Drawn]:
        found = {}
        for channel_id, which in by_channel(piece.channel):
            name = self._from[channel_id]
            if self._scene.draws(*name):
                payloads = [piece.records[i][MESSAGE_HEAD_BYTES:] for i in which.tolist()]
                found[name] = Records(piece.log_ns[which], piece.publish_ns[which], piece.seq[which], payloads)
        return self._scene.take(found)

    def _pieces_of(self, drawn: Iterable[Drawn]) -> Piece:
        records, channels, times = [], [], []
        for one in drawn:
            channel_id = self._drawn_ids.get(one.topic) or self._register_drawn(one)
            channels.append(channel_id)
            times.append(one.log_ns)
            records.append(encode_message(channel_id, 0, one.log_ns, one.log_ns, one.payload))
        self._n_drawn += len(records)
        log_ns = np.array(times, dtype=np.int64)
        return Piece(records, np.array(channels, dtype=np.int64), np.zeros_like(log_ns), log_ns, log_ns)

    def _register(self, side: Side, channel: Channel, schema: Schema | None) -> int:
        schema_id = 0 if schema is None else self._writer.register_schema(schema.name, schema.encoding, schema.data)
        topic = merged_topic(side, channel.topic)
        metadata = {**channel.metadata, "side": side, "topic": channel.topic}
        channel_id = self._writer.register_channel(topic, channel.message_encoding, schema_id, metadata)
        self._from[channel_id] = (side, channel.topic)
        return channel_id

    def _register_drawn(self, drawn: Drawn) -> int:
        if isinstance(drawn.kind, str):
            name, descriptors = foxglove.schema(drawn.kind)
            encoding, schema_id = "protobuf", self._writer.register_schema(name, "protobuf", descriptors)
        else:
            encoding, schema_id = "json", self._writer.register_schema(*_json_schema(drawn.kind))
        self._drawn_ids[drawn.topic] = self._writer.register_channel(drawn.topic, encoding, schema_id, {})
        return self._drawn_ids[drawn.topic]

    def _metadata(self, sides: Sequence[SideLog]) -> dict[str, str]:
        found: dict[str, str] = {}
        for side in sides:
            found |= side.file.metadata.get("run", {})
        found.pop("side", None)
        found |= {"merged": MERGED_VERSION, "sides": ",".join(side.side for side in sides)}
        return found


def _json_schema(model: type[BaseModel]) -> tuple[str, str, bytes]:
    return f"tis.{model.__name__}", "jsonschema", flat_schema(model)


def _attached(sides: Sequence[SideLog]) -> dict[str, bytes]:
    """Return the sides' own attachments: what all share once, what each has of its own under its name."""
    found: dict[str, bytes] = {}
    for side in sides:
        for name, attachment in side.file.attachments.items():
            shared = name in ("scenario.yaml", "model.json")
            found[name if shared else f"{side.side}/{name}"] = attachment.data
    return found


def _split(pieces: Sequence[Piece], until_ns: int) -> tuple[Piece, Piece]:
    """Return the messages before ``until_ns`` in order of time, equal ones in the order given; and the others."""
    records = [record for piece in pieces for record in piece.records]
    channel, seq, log_ns, publish_ns = (
        np.concatenate([np.empty(0, dtype=np.int64), *(piece[i] for piece in pieces)]) for i in range(1, 5)
    )

    def chosen(which: Ints) -> Piece:
        return Piece(
            [records[i] for i in which.tolist()], channel[which], seq[which], log_ns[which], publish_ns[which]
        )

    ready = np.flatnonzero(log_ns < until_ns) if until_ns < FOREVER else np.arange(len(records))
    ready = ready[np.argsort(log_ns[ready], kind="stable")]
    rest = np.flatnonzero(log_ns >= until_ns) if until_ns < FOREVER else ready[:0]
    return chosen(ready), chosen(rest)
