"""`tis recover`: the intact content of a damaged MCAP file as a new file, which states its gaps."""

from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_LOSSY_RECOVERY, EXIT_OK, DataError, Fault
from tis.common.runtime.chunk_writer import ChunkWriter, encode_message
from tis.common.runtime.process import command_line
from tis.common.units import NS_PER_S
from tis.deploy.logs.blocks import Block
from tis.deploy.logs.coverage import FOREVER, RECOVERED, Span, lost_bytes_of, recovery_metadata, spans
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.log_paths import recovered_name
from tis.deploy.shell import run_dir as folder


@dataclass(frozen=True)
class Recovery:
    """The result of a recovery: ``damage`` describes the first damage, None for an intact file.

    ``n_gaps`` counts the damaged places that are followed by intact chunks, ``gap_bytes`` all unreadable bytes.
    """

    n_messages: int
    last_ns: int
    damage: str | None
    n_gaps: int
    gap_bytes: int
    unknown: tuple[Span, ...] = ()
    """Spans in which messages may be missing, on the log's own clock."""


@dataclass
class _Gaps:
    """Collects, block by block, the spans in which messages may be missing."""

    log: LogFile
    last_ns: int = 0
    found: list[Span] = field(default_factory=list)
    _n_before: int = 0

    def pass_block(self, block: Block) -> None:
        """Take the next block: what was skipped before it lay between the previous block and this one."""
        n_skipped, ends_ns = self._n_skipped(), int(block.log_ns.max(initial=self.last_ns))
        # bytes were skipped since the last block: something is missing between the two
        if n_skipped > self._n_before:
            begins_ns = int(block.log_ns.min(initial=ends_ns))
            # messages without a channel were in the block itself
            self.found.append((min(self.last_ns, begins_ns), ends_ns if self.log.n_orphans else begins_ns))
        self._n_before, self.last_ns = n_skipped, max(self.last_ns, ends_ns)

    def end(self) -> tuple[Span, ...]:
        """Return all gaps; the last one is open when the file's end was lost."""
        if not self.log.data_ended or self._n_skipped() > self._n_before:
            self.found.append((self.last_ns, FOREVER))
        return tuple(self.found)

    def _n_skipped(self) -> int:
        return self.log.gap_bytes + self.log.n_orphans


def recover(damaged: Path, recovered: Path) -> Recovery:
    """Write all intact chunks of ``damaged``, and intact records outside of chunks, to a new file.

    An intact file is not copied. Schemas, channels, messages in their order, attachments and metadata are kept, also
    of chunks after a damaged place. The metadata `coverage.RECOVERED` states the gaps. Raises `DataError`. Oracle: a
    file with a gap at a known place, tests/deploy/logs/test_recover.
    """
    log = LogFile(damaged, search=True)
    blocks = log.blocks()
    first = next(blocks, None)  # reads the header, or raises for a file that is no MCAP
    n_messages, gaps = 0, _Gaps(log)
    # written under another name first: an interrupted recovery leaves no file that looks complete
    partial = recovered.with_suffix(recovered.suffix + ".part")
    try:
        with partial.open("wb") as file:
            writer = ChunkWriter(file, "tis", profile=log.header.profile if log.header else "")
            ids: dict[int, int] = {}
            for block in chain(() if first is None else (first,), blocks):
                _copy(block, log, writer, ids)
                n_messages += len(block.start)
                gaps.pass_block(block)
            for name, attachment in log.attachments.items():
                writer.attach(name, attachment.media_type, attachment.data)
            unknown = () if log.damage is None else gaps.end()
            for name, entries in _marked(log, log.damage or "", damaged, unknown).items():
                writer.add_metadata(name, entries)
            writer.finish()
        if log.damage is not None:
            partial.replace(recovered)
    except OSError as error:
        raise DataError(Fault(str(recovered), "", f"cannot be written: {error.strerror}")) from None
    finally:
        with suppress(OSError):  # a disk that cannot be written cannot be cleaned up either
            partial.unlink(missing_ok=True)
    return Recovery(n_messages, gaps.last_ns, log.damage, log.n_gaps, log.gap_bytes, unknown)


def recover_and_print(file: Path, target: Path, out: Console, err: Console) -> int:
    """Recover a file and print its losses; return `EXIT_LOSSY_RECOVERY` if there are any. Raises `DataError`."""
    if target.exists():
        raise DataError(Fault(str(target), "", "exists already"))
    found = recover(file, target)
    messages = f"{found.n_messages} messages up to {found.last_ns / NS_PER_S:.3f} s"
    if found.damage is None:
        text = f"{file}: is intact, {messages}: nothing to recover, no file was written"
        out.print(escape(text), soft_wrap=True)
        return EXIT_OK
    out.print(escape(f"{target}: {messages}"), soft_wrap=True)
    if not found.unknown:
        text = f"{file}: was damaged: {found.damage}; only in the index at its end, no message is lost"
        out.print(escape(text), soft_wrap=True)
    else:
        beyond = f", {found.n_gaps} gaps" if found.n_gaps > 1 else ", one gap" if found.n_gaps else ""
        read = f"{found.gap_bytes} bytes could not be read{beyond}"
        lost = read if found.gap_bytes else "the content is intact, but the end is missing"
        err.print(escape(f"tis: {file}: was damaged: {found.damage}; {lost}"), style="red", soft_wrap=True)
    in_a_run = any(file.with_name(name).is_file() for name in (folder.SCENARIO_FILE, folder.NETWORK_FILE))
    if target == recovered_name(file) and in_a_run:
        again = command_line(["summarize", str(file.parent)])
        text = f"It now replaces {file.name}; {again} computes the summary again"
        out.print(escape(text), soft_wrap=True)
    return EXIT_LOSSY_RECOVERY if found.unknown else EXIT_OK


def _marked(log: LogFile, damage: str, damaged: Path, unknown: tuple[Span, ...]) -> dict[str, dict[str, str]]:
    """Return the metadata with old and new gaps, as a recovered log may be damaged again."""
    earlier = log.metadata.get(RECOVERED, {})
    both = tuple(sorted({*spans(earlier.get("unknown_ns", "")), *unknown}))
    lost_bytes = log.gap_bytes + (lost_bytes_of(earlier) or 0)
    found = recovery_metadata(damage, damaged.name, damaged.stat().st_size, lost_bytes, both)
    return {**log.metadata, RECOVERED: dict(found)}


def _copy(block: Block, log: LogFile, writer: ChunkWriter, ids: dict[int, int]) -> None:
    for channel_id in sorted(set(block.channel.tolist()) - ids.keys()):
        channel = log.channels[channel_id]
        schema = log.schemas.get(channel.schema_id)
        schema_id = 0 if schema is None else writer.register_schema(schema.name, schema.encoding, schema.data)
        ids[channel_id] = writer.register_channel(
            channel.topic, channel.message_encoding, schema_id, channel.metadata
        )
    # the writer numbers channels by itself
    renumbered = block.channel.copy()
    for old in set(renumbered.tolist()):
        renumbered[block.channel == old] = ids[old]
    headers = zip(
        renumbered.tolist(), block.seq.tolist(), block.log_ns.tolist(), block.publish_ns.tolist(), strict=True
    )
    payloads = block.payloads(slice(None))
    records = [encode_message(*head, payload) for head, payload in zip(headers, payloads, strict=True)]
    writer.add(records, renumbered, block.log_ns)
