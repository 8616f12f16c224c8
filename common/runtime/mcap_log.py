"""A side's log: MCAP, JSON messages with their schemas, readable up to the last flush after a crash.

Times in the log are run time (ns since the run's epoch). A chunk is closed at least at every flush: with the
writer's default of 1 MiB a killed process leaves nothing behind.
"""

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from mcap.writer import CompressionType, Writer
from pydantic import BaseModel

from common.errors import DataError, Fault
from common.node import Record
from common.runtime.json_schema import flat_schema

_CHUNK_BYTES: Final = 32 * 1024
_MEDIA_TYPES: Final = {"json": "application/json", "yaml": "application/yaml", "csv": "text/csv"}


class McapLog:
    """Writes records to one file; not thread-safe. Raises `DataError` when the file cannot be created."""

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        try:
            self._file = path.open("xb")
        except OSError as error:
            raise DataError(Fault(str(path), "", f"cannot be written: {error.strerror}")) from None
        self._writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="tis")
        self._writer.add_metadata("run", dict(metadata))
        self._channels: dict[str, int] = {}
        self._schemas: dict[type[BaseModel], int] = {}

    def record(self, record: Record) -> None:
        """Write one record."""
        data, schema = record.data, record.schema
        if isinstance(data, BaseModel):
            schema = type(data)
            data = data.model_dump_json().encode()
        channel = self._channels.get(record.topic)
        if channel is None:
            channel = self._register(record.topic, schema)
        publish_ns = record.log_ns if record.publish_ns is None else record.publish_ns
        # MCAP's times are unsigned and its sequence numbers have 32 bits.
        self._writer.add_message(channel, max(0, record.log_ns), data, max(0, publish_ns), record.seq & 0xFFFF_FFFF)

    def attach(self, name: str, data: bytes) -> None:
        """Add a file to the log."""
        media_type = _MEDIA_TYPES.get(name.rpartition(".")[2], "application/octet-stream")
        self._writer.add_attachment(0, 0, name, media_type, data)

    def flush(self) -> None:
        """Bring everything written so far to disk as whole chunks."""
        # The writer has no public name for closing a chunk early; test_mcap_log reads back after a flush.
        self._writer._Writer__finalize_chunk()  # type: ignore[attr-defined]
        self._file.flush()

    def close(self) -> None:
        """Write the index and close the file; a second call does nothing."""
        if self._file.closed:
            return
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _register(self, topic: str, schema: type[BaseModel] | None) -> int:
        schema_id = 0
        if schema is not None:
            if schema not in self._schemas:
                self._schemas[schema] = self._writer.register_schema(
                    f"tis.{schema.__name__}", "jsonschema", flat_schema(schema)
                )
            schema_id = self._schemas[schema]
        self._channels[topic] = self._writer.register_channel(topic, "json" if schema else "", schema_id)
        return self._channels[topic]
