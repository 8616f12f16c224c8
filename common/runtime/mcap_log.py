"""A side's log: MCAP, JSON messages with their schemas, readable up to the last flush after a crash.

Times in the log are run time (ns since the run's epoch). Every flush writes a complete chunk; with the mcap package's
default of 1 MiB per chunk the log of a killed process could be empty. A side's log has no index, since it is read
from its beginning; the merged file has one.
"""

import errno
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock
from functools import cache
from inspect import cleandoc
from pathlib import Path
from types import ModuleType
from typing import Any, Final, Self

import msgspec
import numpy as np

from tis.common.errors import DataError, Fault, file_faults
from tis.common.messages import Message, encode
from tis.common.node import Record
from tis.common.runtime.chunk_writer import MESSAGE_HEAD_BYTES, QUICK, THOROUGH, ChunkWriter, encode_message
from tis.common.units import NS_PER_S

_CHUNK_BYTES: Final = 128 * 1024
_UNLIMITED_BYTES: Final = 1 << 40  # chunks are closed here, not by the writer
_SLOW_NS: Final = NS_PER_S // 4
_MEDIA_TYPES: Final = {"json": "application/json", "yaml": "application/yaml", "csv": "text/csv"}


def is_being_written(path: Path) -> bool:
    """Tell whether a living process of this machine has the log open for writing."""
    try:
        with path.open("rb") as file:
            flock(file, LOCK_SH | LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


class McapLog:
    """Writes records to one file; not thread-safe. Raises `DataError` when the file cannot be created.

    A chunk is written when it is full, at each `flush`, and when it spans ``flush_every_ns`` of log time, if given.
    A chunk that spans a quarter of a second or more leaves the time for thorough compression. With ``keep_void``
    false a log without any record is deleted when its context ends: the run never began.
    """

    def __init__(
        self, path: Path, metadata: Mapping[str, str], flush_every_ns: int | None = None, keep_void: bool = True
    ) -> None:
        self._path, self._keep_void = path, keep_void
        try:
            self._file = path.open("xb")
        except FileExistsError:
            raise DataError(Fault(str(path), "", "exists, from an earlier run: give another --run-dir")) from None
        except OSError as error:
            raise DataError(Fault(str(path), "", f"cannot be written: {error.strerror}")) from None
        with suppress(OSError):  # of a file system without locks nobody can tell
            flock(self._file, LOCK_EX | LOCK_NB)  # held while the process lives: `is_being_written`
        self._writer = ChunkWriter(self._file, "tis", chunk_bytes=_UNLIMITED_BYTES, indexed=False, beside=False)
        self._writer.add_metadata("run", metadata)
        self._flush_every_ns = flush_every_ns
        self._records: list[bytes] = []
        self._channel_of: list[int] = []
        self._log_ns: list[int] = []
        self._n_bytes = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[type[Message], int] = {}

    @property
    def path(self) -> Path:
        """Return the path of the file."""
        return self._path

    def move(self, path: Path) -> None:
        """Go on in another place of the same disk; raises `DataError`."""
        with file_faults(path, "cannot be written"):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._path = self._path.rename(path)

    def record(self, record: Record) -> None:
        """Write one record."""
        data, log_ns, publish_ns = record.data, record.log_ns, record.publish_ns
        if isinstance(data, bytes):
            payload, schema = data, record.schema
        else:
            payload, schema = encode(data), type(data)
        channel = self._channels.get(record.topic)
        if channel is None:
            channel = self._register(record.topic, schema)
        if publish_ns is None:
            publish_ns = log_ns
        if log_ns < 0 or publish_ns < 0:  # MCAP's times are unsigned, and its sequence numbers have 32 bits
            log_ns, publish_ns = max(0, log_ns), max(0, publish_ns)
        if self._flush_every_ns is not None and self._log_ns and log_ns - self._log_ns[0] >= self._flush_every_ns:
            self.flush()
        self._records.append(encode_message(channel, record.seq & 0xFFFF_FFFF, log_ns, publish_ns, payload))
        self._channel_of.append(channel)
        self._log_ns.append(log_ns)
        self._n_bytes += MESSAGE_HEAD_BYTES + len(payload)
        if self._n_bytes >= _CHUNK_BYTES:
            self.flush()

    def attach(self, name: str, data: bytes) -> None:
        """Add a file to the log."""
        media_type = _MEDIA_TYPES.get(name.rpartition(".")[2], "application/octet-stream")
        self._writer.attach(name, media_type, data)

    def flush(self) -> None:
        """Write all records so far to disk as complete chunks."""
        if self._records:
            channel, log_ns = (np.array(column, dtype=np.int64) for column in (self._channel_of, self._log_ns))
            records, self._records, self._channel_of, self._log_ns, self._n_bytes = self._records, [], [], [], 0
            self._writer.add(records, channel, log_ns)
            self._writer.flush(THOROUGH if log_ns[-1] - log_ns[0] >= _SLOW_NS else QUICK)
        self._file.flush()
        if os.fstat(self._file.fileno()).st_nlink == 0:  # what follows would be written to nowhere
            raise OSError(errno.ENOENT, "the file or its folder was deleted")

    def close(self) -> None:
        """Write the remaining records and the footer, and close the file; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self.flush()
            self._writer.finish()
        finally:
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
        if not self._channels and not self._keep_void:
            self._path.unlink(missing_ok=True)

    def _register(self, topic: str, schema: type[Message] | None) -> int:
        schema_id = 0
        if schema is not None:
            if schema not in self._schemas:
                self._schemas[schema] = self._writer.register_schema(
                    f"tis.{schema.__name__}", "jsonschema", flat_schema(schema)
                )
            schema_id = self._schemas[schema]
        self._channels[topic] = self._writer.register_channel(topic, "json" if schema else "", schema_id, {})
        return self._channels[topic]


# JSON Schemas that viewers understand: no references, no ``anyOf``.


@cache
def flat_schema(model: type[Message]) -> bytes:
    """Return the model's JSON Schema with definitions inlined and ``X | None`` written as ``X``."""
    (schema,), definitions = msgspec.json.schema_components([model], ref_template="{name}")
    return json.dumps(_inline(schema, definitions)).encode()


def prepare_schemas(module: ModuleType) -> None:
    """Compute the schemas of all models of a module in advance: each takes milliseconds, too long for a tick."""
    for value in vars(module).values():
        if isinstance(value, type) and issubclass(value, Message) and value is not Message:
            flat_schema(value)


def _inline(node: Any, definitions: dict[str, Any]) -> Any:
    if isinstance(node, list):
        return [_inline(item, definitions) for item in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:  # what a field says of itself stands before what its model says
        own = {key: value for key, value in node.items() if key != "$ref"}
        return _inline(definitions[node["$ref"]] | own, definitions)
    # X | None becomes X; its description and other keywords stay, a default null goes.
    if "anyOf" in node:
        chosen = next(branch for branch in node["anyOf"] if branch.get("type") != "null")
        rest = {key: value for key, value in node.items() if key not in ("anyOf", "default")}
        return _inline(chosen | rest, definitions)
    if "enum" in node and "type" not in node:  # Foxglove reads no field without a type; all of ours are words
        node = {"type": "string"} | node
    if isinstance(node.get("description"), str):  # a docstring as it stands in the code
        node = node | {"description": cleandoc(node["description"])}
    return {key: _inline(value, definitions) for key, value in node.items()}
