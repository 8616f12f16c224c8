"""`tis info FILE.mcap`: content of an MCAP file of any program."""

from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK, DataError
from tis.common.runtime.chunk_writer import by_channel
from tis.common.units import NS_PER_S
from tis.deploy.logs.coverage import RECOVERED, damage_text
from tis.deploy.logs.log_file import LogFile
from tis.deploy.present.table import Column, Table
from tis.deploy.shell.guard import print_json

_MAX_CHARS: Final = 1000  # of a name or of metadata; the table of topics becomes slow with more
_A_DATE_NS: Final = 10**17  # three years: later stamps count from 1970, not from the begin of a run


@dataclass(frozen=True)
class Described:
    """A file after reading it: the number of messages of each channel, and their first and last instants."""

    log: LogFile
    counts: Counter[int]
    first_ns: int
    last_ns: int


def describe(path: Path) -> Described:
    """Read a file; raises `DataError` when it is no MCAP file."""
    log, counts = LogFile(path), Counter[int]()
    first_ns, last_ns = None, 0
    for block in log.blocks():
        for channel_id, which in by_channel(block.channel):
            counts[channel_id] += len(which)
        if len(block.log_ns):
            start_ns = int(block.log_ns.min())
            first_ns = start_ns if first_ns is None else min(first_ns, start_ns)
            last_ns = max(last_ns, int(block.log_ns.max()))
    return Described(log, counts, first_ns or 0, last_ns)


def _as_data(path: Path, found: Described) -> dict[str, Any]:
    """Return a file's content for JSON."""
    log = found.log
    topics = [
        {
            "topic": channel.topic,
            "schema": None if (schema := log.schemas.get(channel.schema_id)) is None else schema.name,
            "encoding": channel.message_encoding,
            "messages": found.counts[channel_id],
        }
        for channel_id, channel in sorted(log.channels.items(), key=lambda entry: entry[1].topic)
    ]
    span = {"first_ns": found.first_ns, "last_ns": found.last_ns}
    return {"file": str(path), "bytes": path.stat().st_size, **span, "damage": log.damage, "topics": topics}


def print_file(path: Path, out: Console, err: Console, as_json: bool = False) -> int:
    """Print damage and content of a file; return `DataError.exit_code` if it is damaged. Raises `DataError`."""
    found = describe(path)
    if found.log.damage is not None:
        rule = f"is damaged: {found.log.damage}; the readable part follows; see tis recover"
        err.print(escape(f"tis: {path}: {rule}"), style="red", soft_wrap=True)
    elif text := damage_text(found.log):
        out.print(escape(f"{text}: {_recovery(found.log)}"), style="yellow", soft_wrap=True)
    log, seconds = found.log, (found.last_ns - found.first_ns) / NS_PER_S
    size_mb = path.stat().st_size * 1e-6
    span = f"over {seconds:.3f} s from {_instant(found.first_ns)}"
    out.print(escape(f"{path}: {size_mb:.3f} MB, {found.counts.total()} messages {span}"), soft_wrap=True)
    if log.header is not None:
        profile = f", profile {_short(log.header.profile)}" if log.header.profile else ""
        library = _short(log.header.library) or "an unknown program"
        out.print(escape(f"written by {library}{profile}"), soft_wrap=True)
    rows = []
    for channel_id, channel in sorted(log.channels.items(), key=lambda entry: entry[1].topic):
        schema, count = log.schemas.get(channel.schema_id), found.counts[channel_id]
        rate = f"{(count - 1) / seconds:.1f}" if seconds > 0 and count > 1 else "-"
        names = (channel.topic, "-" if schema is None else schema.name, channel.message_encoding or "-")
        rows.append((*map(_short, names), str(count), rate))
    texts = [Column(name, words=True, wraps=True) for name in ("topic", "schema", "encoding")]
    out.print(Table("Topics", (*texts, "messages", "Hz"), rows).terminal())
    if as_json:
        print_json(_as_data(path, found))
    for name, entries in log.metadata.items():
        text = ", ".join(f"{key} {value}" for key, value in entries.items())
        out.print(escape(f"metadata {_short(name)}: {_short(text)}"), soft_wrap=True)
    if log.attachments:
        sizes = {_short(name): len(found.data) for name, found in log.attachments.items()}
        files = ", ".join(f"{name} ({n_bytes / 1000:.1f} kB)" for name, n_bytes in sizes.items())
        out.print(escape(f"attached: {files}"), soft_wrap=True)
    return EXIT_OK if log.damage is None else DataError.exit_code


def _recovery(log: LogFile) -> str:
    entries = log.metadata[RECOVERED]
    of, damage, lost_bytes = (entries.get(name, "unknown") for name in ("of", "damage", "lost_bytes"))
    return _short(f"{of}, {damage}, {lost_bytes} bytes of it could not be read")


def _short(text: str) -> str:
    return text if len(text) <= _MAX_CHARS else f"{text[: _MAX_CHARS - 3]}..."


def _instant(ns: int) -> str:
    if ns < _A_DATE_NS:
        return f"{ns / NS_PER_S:.3f} s"
    return datetime.fromtimestamp(ns / NS_PER_S, UTC).isoformat(timespec="milliseconds")
