"""Merging of a run's logs into one file: in order of time, on one clock, indexed, with messages for viewers.

The merge is streamed: memory holds only the few seconds by which the logs are out of step.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple, get_args

import numpy as np
from mcap.records import Channel, Schema

from tis.common.channels import Side
from tis.common.errors import DataError, Fault
from tis.common.runtime.chunk_writer import QUICK, THOROUGH, ChunkWriter, by_channel, encode_message
from tis.common.runtime.mcap_log import flat_schema
from tis.common.sources.provenance import MODEL_FILES
from tis.common.units import NS_PER_S
from tis.deploy.logs.coverage import FOREVER, damage_text
from tis.deploy.logs.merge_source import MergeSource, Piece
from tis.deploy.logs.read.clocks import Clocks
from tis.deploy.logs.viewer import foxglove
from tis.deploy.logs.viewer.drawn import DRAWN_HZ, Drawn, Payloads, Records, RunTopics, merged_topic
from tis.deploy.logs.viewer.scene import Scene

MERGED_VERSION: Final = "1"
_MIN_SORTED: Final = 60_000
_MEDIA: Final = {".json": "application/json", ".yaml": "application/yaml"}


@dataclass(frozen=True)
class Merged:
    """The content of a merged file: counts of messages by side and of drawn ones, and the logs' damage."""

    n_messages: Mapping[str, int]
    n_drawn: int
    problems: Sequence[str]


class Conclusion(NamedTuple):
    """The parts of a merged file that exist only at the end of a run: attachments, and messages at its end."""

    attachments: Mapping[str, bytes]
    lines: Sequence[Drawn] = ()


def _nothing() -> Conclusion:
    return Conclusion({})


def merge_logs(
    logs: Mapping[Side, Sequence[Path]],
    target: Path,
    topics: RunTopics,
    clocks: Clocks,
    lines: Iterable[Drawn] = (),
    conclude: Callable[[], Conclusion] = _nothing,
    end_ns: int = FOREVER,
) -> Merged:
    """Write the merged file, complete or not at all; raises `DataError`.

    ``logs`` are the files of each side, several where it was started anew.
    ``lines`` are log lines of the whole run. ``conclude`` is called once, after everything before ``end_ns`` is
    written; its messages are at that instant or later. Damaged logs are merged as far as they can be read. Oracle:
    all messages sorted at once (tests/deploy/logs/test_merge).
    """
    partial = partial_of(target)
    try:
        with partial.open("wb") as file:
            merged = _Merger(file, topics, clocks).run(logs, lines, conclude, end_ns)
        partial.replace(target)
    except OSError as error:
        raise DataError(Fault(str(target), "", f"cannot be written: {error.strerror}")) from None
    finally:
        with suppress(OSError):  # a disk that cannot be written cannot be cleaned up either
            partial.unlink(missing_ok=True)
    return merged


def partial_of(target: Path) -> Path:
    """Return the path of a merged file while it is incomplete."""
    return target.with_name(f".{target.name}.part")


class _Merger:
    def __init__(self, file: BinaryIO, topics: RunTopics, clocks: Clocks) -> None:
        self._writer = ChunkWriter(file, "tis", level=THOROUGH if topics.rate_hz <= DRAWN_HZ else QUICK)
        self._topics, self._clocks = topics, clocks
        self._scene = Scene(topics, clocks)
        self._from: dict[int, tuple[Side, str]] = {}
        self._drawn_ids: dict[str, int] = {}
        self._n_drawn = self._drawn_until_ns = 0
        # drawn messages may be stamped a little earlier than the records that they derive from
        self._lag_ns = max(NS_PER_S // 2, 2 * NS_PER_S // topics.rate_hz)

    def run(
        self,
        logs: Mapping[Side, Sequence[Path]],
        lines: Iterable[Drawn],
        conclude: Callable[[], Conclusion],
        end_ns: int,
    ) -> Merged:
        """Merge all logs: read from the log that is furthest behind, and write up to the common watermark."""
        conclusion: Conclusion | None = None
        sides = [
            MergeSource(path, side, self._topics.session, self._clocks, self._register)
            for side in get_args(Side)
            for path in logs.get(side, ())
        ]
        pieces, n_new = [self._pieces_of(lines)], 0
        while True:
            # read the log that is furthest behind, so that the common watermark advances with the least memory
            behind = min(sides, key=lambda side: side.watermark_ns, default=None)
            piece = None if behind is None else behind.next_piece()
            if piece is not None:
                pieces.append(piece)
                n_new += len(piece.records)
            until_ns = min((side.watermark_ns for side in sides), default=FOREVER)
            if until_ns == FOREVER:  # read the ends too, which reveal damage
                pieces += [piece for side in sides for piece in iter(side.next_piece, None)]
            # sorting in large portions is much faster than after every piece
            if until_ns < FOREVER and n_new < _MIN_SORTED:
                continue
            # everything before the end of the run is out: ask for its conclusion, once
            if conclusion is None and (until_ns == FOREVER or until_ns - self._lag_ns > end_ns):
                conclusion = conclude()
                pieces.append(self._pieces_of(conclusion.lines))
            pieces, n_new = [self._write(pieces, until_ns)], 0
            if until_ns == FOREVER:
                assert conclusion is not None
                break
        for name, data in {**_attached(sides), **conclusion.attachments}.items():
            self._writer.attach(name, _MEDIA.get(Path(name).suffix, "application/octet-stream"), data)
        self._writer.add_metadata("run", self._metadata(sides))
        self._writer.finish()
        last = {side.side: side for side in sides}.values()  # that an earlier part ends early is no damage
        problems = [text for side in last if (text := damage_text(side.file))]
        n_messages: Counter[str] = Counter()
        for side in sides:
            n_messages[side.side] += side.n_messages
        return Merged(n_messages, self._n_drawn, problems)

    def _write(self, pieces: list[Piece], until_ns: int) -> Piece:
        """Draw the records before ``until_ns``, write all that is final in order of time, and return the rest."""
        together = _together(pieces)
        # drawing first: its messages are sorted in with the records
        drawn = self._pieces_of(self._draw(together, until_ns))
        together = _together([together, drawn])
        last_ns = until_ns if until_ns == FOREVER else until_ns - self._lag_ns
        old = together.log_ns < last_ns if until_ns < FOREVER else np.ones(len(together.records), dtype=np.bool_)
        ready = np.flatnonzero(old)
        # stable, so that equal stamps keep the order of reading
        ready = ready[np.argsort(together.log_ns[ready], kind="stable")]
        records = together.records
        self._writer.add([records[i] for i in ready.tolist()], together.channel[ready], together.log_ns[ready])
        rest = np.flatnonzero(~old)
        return Piece([records[i] for i in rest.tolist()], *(column[rest] for column in together[1:]))

    def _draw(self, piece: Piece, until_ns: int) -> Iterable[Drawn]:
        new = (piece.log_ns >= self._drawn_until_ns) & (piece.log_ns < until_ns)
        self._drawn_until_ns = until_ns
        found = {}
        for channel_id, which in by_channel(piece.channel):
            name = self._from.get(channel_id)
            if name is None or not self._scene.draws(*name):
                continue
            its = which[new[which]]
            its = its[np.argsort(piece.log_ns[its], kind="stable")]
            if len(its):
                payloads = Payloads(piece.records, its)
                found[name] = Records(piece.log_ns[its], piece.publish_ns[its], piece.seq[its], payloads)
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
        if (side, channel.topic) in self._from.values():  # of an earlier part
            return next(known for known, name in self._from.items() if name == (side, channel.topic))
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
            name = f"tis.{drawn.kind.__name__}"
            encoding, schema_id = "json", self._writer.register_schema(name, "jsonschema", flat_schema(drawn.kind))
        self._drawn_ids[drawn.topic] = self._writer.register_channel(drawn.topic, encoding, schema_id, {})
        return self._drawn_ids[drawn.topic]

    def _metadata(self, sides: Sequence[MergeSource]) -> dict[str, str]:
        found: dict[str, str] = {}
        for side in sides:
            found |= side.file.metadata.get("run", {})
        found.pop("side", None)
        found |= {"merged": MERGED_VERSION, "sides": ",".join(dict.fromkeys(side.side for side in sides))}
        return found


def _attached(sides: Sequence[MergeSource]) -> dict[str, bytes]:
    """Return the sides' attachments: shared ones once, others under the side's name."""
    found: dict[str, bytes] = {}
    for side in sides:
        for name, attachment in side.file.attachments.items():
            shared = name in ("scenario.yaml", *MODEL_FILES)
            found.setdefault(name if shared else f"{_folder(side)}/{name}", attachment.data)
    return found


def _folder(source: MergeSource) -> str:
    """Return the side's name, with the number of a later part."""
    return source.file.path.stem.removesuffix("_recovered")


def _together(pieces: Sequence[Piece]) -> Piece:
    """Return several pieces as one."""
    if len(pieces) == 1:
        return pieces[0]
    records = list(chain.from_iterable(piece.records for piece in pieces))
    return Piece(records, *(np.concatenate([piece[i] for piece in pieces]) for i in range(1, 5)))
