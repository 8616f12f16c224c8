"""Last records of some topics, in a file that outlives a killed process: where the arm was left, and whether stopped.

The log may lack the last half second of a killed process, in which an arm moves centimetres. A mapped page is the
kernel's as soon as it is written.
"""

import json
import mmap
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple, Self

from tis.common.errors import file_faults
from tis.common.messages import Message, encode
from tis.common.node import Record
from tis.common.runtime.loop import Recorder

MEMORY_FILE: Final = "arm.memory"
RESUMED_FILE: Final = "resumed.json"
"""Attached to the log of a process that goes on after these records, for its replay."""
_HEAD: Final = struct.Struct("<QII")  # number of the record, bytes of its payload, their CRC
_SLOT_BYTES: Final = 2048
_N_SLOTS: Final = 2
"""Of each topic, written in turn: a process that is killed while it writes one leaves the other."""


class RememberingRecorder(NamedTuple):
    """A recorder that also keeps what outlives a kill."""

    recorder: Recorder
    memory: "ArmMemory"

    def record(self, record: Record) -> None:
        """Log one record, and keep it if it is of a topic of the memory."""
        self.memory.keep(record)
        self.recorder.record(record)


class ArmMemory:
    """Keeps the last record of each topic; no topics, no file. Raises `DataError` when the file cannot be made.

    ``last`` is what an earlier process left, by topic: it stays known until a newer record of its topic comes,
    however often processes are killed. So the new file takes the old one's place only when it holds all of it.
    """

    def __init__(self, path: Path, topics: Sequence[str], last: Mapping[str, bytes] = MappingProxyType({})) -> None:
        self._path, self._numbers = path, dict.fromkeys(topics, 0)
        self._page: mmap.mmap | None = None
        self._places = {topic: _N_SLOTS * _SLOT_BYTES * i for i, topic in enumerate(topics)}
        if not topics:
            return
        made = path.with_name(f"{path.name}.new")
        with file_faults(path, "cannot be written"):
            with made.open("w+b") as file:
                file.truncate(_N_SLOTS * _SLOT_BYTES * len(topics))
                self._page = mmap.mmap(file.fileno(), 0)
            for topic, data in last.items():
                self.keep(Record(topic, 0, data))
            made.replace(path)

    def around(self, recorder: Recorder) -> Recorder:
        """Return a recorder that logs with ``recorder`` and also keeps; the recorder itself without topics."""
        return RememberingRecorder(recorder, self) if self._numbers else recorder

    def keep(self, record: Record) -> None:
        """Keep a record of one of the topics; others, and what is too large, are passed over."""
        number = self._numbers.get(record.topic)
        if number is None or self._page is None:
            return
        data = encode(record.data) if isinstance(record.data, Message) else record.data
        if len(data) > _SLOT_BYTES - _HEAD.size:
            return
        self._numbers[record.topic] = number = number + 1
        place = self._places[record.topic] + number % _N_SLOTS * _SLOT_BYTES
        content = _HEAD.pack(number, len(data), zlib.crc32(data)) + data
        self._page[place : place + len(content)] = content

    def forget(self) -> None:
        """Delete the file: the run is over."""
        if self._page is not None:
            self._path.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._page is not None:
            self._page.close()


def remembered(path: Path, topics: Sequence[str]) -> Mapping[str, bytes]:
    """Return the last record of each topic in a file that `ArmMemory` wrote for the same topics; none without one."""
    try:
        content = path.read_bytes()
    except OSError:
        return {}
    found = {topic: _newest(content[_N_SLOTS * _SLOT_BYTES * i :]) for i, topic in enumerate(topics)}
    return {topic: data for topic, data in found.items() if data is not None}


def dump_resumed(last: Mapping[str, bytes]) -> bytes:
    """Return the records after which a process goes on as a file (inverse: `parse_resumed`)."""
    return json.dumps({topic: payload.decode() for topic, payload in last.items()}).encode()


def parse_resumed(data: bytes) -> dict[str, bytes]:
    """Return the records in a file of `dump_resumed`; none where it cannot be read."""
    try:
        found = json.loads(data)
        return {topic: payload.encode() for topic, payload in found.items()}
    except (ValueError, AttributeError, RecursionError):
        return {}


def _newest(content: bytes) -> bytes | None:
    """Return the payload of the whole slot with the highest number."""
    newest, highest = None, 0
    for place in range(0, min(len(content), _N_SLOTS * _SLOT_BYTES) - _HEAD.size, _SLOT_BYTES):
        number, n_bytes, crc = _HEAD.unpack_from(content, place)
        data = content[place + _HEAD.size : place + min(_HEAD.size + n_bytes, _SLOT_BYTES)]
        if number > highest and len(data) == n_bytes and zlib.crc32(data) == crc:
            newest, highest = data, number
    return newest
