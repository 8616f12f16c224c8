"""`tis recover`: everything that is whole in a damaged MCAP file, as a new file."""

from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_LOSSY_RECOVERY, EXIT_OK, DataError, Fault
from common.units import NS_PER_S
from deploy.logs.blocks import Block
from deploy.logs.chunk_writer import ChunkWriter, encode_message
from deploy.logs.log_file import LogFile


@dataclass(frozen=True)
class Recovery:
    """What came out of a damaged log: ``damage`` says what was wrong first, None when nothing was.

    ``n_gaps`` counts the places after which whole chunks followed, ``gap_bytes`` all that could not be read.
    """

    n_messages: int
    last_ns: int
    damage: str | None
    n_gaps: int
    gap_bytes: int


def recover(damaged: Path, recovered: Path) -> Recovery:
    """Write all whole chunks of ``damaged``, and whole records outside them, to a new file; raises `DataError`.

    Schemas, channels, messages in their order, attachments and metadata are kept. Chunks behind a damaged place are
    looked for. Oracle: a file with a hole of known place in tests/deploy/logs/test_recover.
    """
    log = LogFile(damaged, search=True)
    blocks = log.blocks()
    first = next(blocks, None)  # now the header is known, or the file refused
    n_messages, last_ns = 0, 0
    partial = recovered.with_suffix(recovered.suffix + ".part")
    try:
        with partial.open("wb") as file:
            writer = ChunkWriter(file, "tis", profile=log.header.profile if log.header else "")
            ids: dict[int, int] = {}
            for block in chain(() if first is None else (first,), blocks):
                _copy(block, log, writer, ids)
                n_messages += len(block.start)
                last_ns = max(last_ns, int(block.log_ns.max(initial=0)))
            for name, attachment in log.attachments.items():
                writer.attach(name, attachment.media_type, attachment.data)
            for name, entries in log.metadata.items():
                writer.add_metadata(name, entries)
            writer.finish()
        partial.replace(recovered)
    except OSError as error:
        raise DataError(Fault(str(recovered), "", f"cannot be written: {error.strerror}")) from None
    finally:
        partial.unlink(missing_ok=True)
    return Recovery(n_messages, last_ns, log.damage, log.n_gaps, log.gap_bytes)


def recover_and_print(file: Path, target: Path, out: Console, err: Console) -> int:
    """Recover a file and say what was lost; return `EXIT_LOSSY_RECOVERY` when anything was. Raises `DataError`."""
    if target.exists():
        raise DataError(Fault(str(target), "", "exists already"))
    found = recover(file, target)
    out.print(escape(f"{target}: {found.n_messages} messages up to {found.last_ns / NS_PER_S:.3f} s"), soft_wrap=True)
    if found.damage is None:
        return EXIT_OK
    beyond = f", {found.n_gaps} gaps" if found.n_gaps > 1 else ", one gap" if found.n_gaps else ""
    lost = f"{found.gap_bytes} bytes could not be read{beyond}" if found.gap_bytes else "the rest is whole"
    err.print(escape(f"tis: {file}: was damaged: {found.damage}; {lost}"), style="red", soft_wrap=True)
    return EXIT_LOSSY_RECOVERY


def _copy(block: Block, log: LogFile, writer: ChunkWriter, ids: dict[int, int]) -> None:
    for channel_id in sorted(set(block.channel.tolist()) - ids.keys()):
        channel = log.channels[channel_id]
        schema = log.schemas.get(channel.schema_id)
        schema_id = 0 if schema is None else writer.register_schema(schema.name, schema.encoding, schema.data)
        ids[channel_id] = writer.register_channel(
            channel.topic, channel.message_encoding, schema_id, channel.metadata
        )
    renumbered = block.channel.copy()
    for old in set(renumbered.tolist()):
        renumbered[block.channel == old] = ids[old]
    headers = zip(
        renumbered.tolist(), block.seq.tolist(), block.log_ns.tolist(), block.publish_ns.tolist(), strict=True
    )
    payloads = block.payloads(slice(None))
    records = [encode_message(*head, payload) for head, payload in zip(headers, payloads, strict=True)]
    writer.add(records, renumbered, block.log_ns)
