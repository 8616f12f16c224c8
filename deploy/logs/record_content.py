"""Content of a record, from which no more can be read than it has."""

from io import BytesIO
from typing import Final

from mcap.data_stream import ReadDataStream

from tis.deploy.logs.limits import (
    FREE_BYTES,
    FREE_READ_BYTES,
    FREE_RECORDS,
    MAX_EXPANSION,
    MAX_READ_TIMES,
)


class RecordContent(ReadDataStream):
    """A record's content for the mcap package's decoders, which trust the lengths in it.

    Raises `ValueError` where a length exceeds the record. Oracle: mutated records, tests/deploy/logs/test_hostile.
    """

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO(content))
        self._n_bytes: Final = len(content)

    def read(self, length: int) -> bytes:
        """Return the next ``length`` bytes."""
        if length > self._n_bytes - self.count:
            raise ValueError("a record's lengths exceed the record")
        return super().read(length)


class ReadingBudget:
    """Bytes and records that a file of ``n_bytes`` may still take; raises `SpentError` beyond."""

    def __init__(self, n_bytes: int) -> None:
        self._read_bytes = FREE_READ_BYTES + MAX_READ_TIMES * n_bytes
        self._bytes = FREE_BYTES + MAX_EXPANSION * n_bytes
        self._records = FREE_RECORDS + n_bytes

    def read(self, n_bytes: int) -> None:
        """Take bytes that are read from the file."""
        self._read_bytes -= n_bytes
        if self._read_bytes < 0:
            raise SpentError("the file's damaged places overlap too often")

    def unpack(self, n_bytes: int) -> None:
        """Take bytes that a chunk has decompressed."""
        self._bytes -= n_bytes
        if self._bytes < 0:
            raise SpentError(f"the chunks hold more than {MAX_EXPANSION} times the bytes of the file")

    def parse(self, n_records: int) -> None:
        """Take records."""
        self._records -= n_records
        if self._records < 0:
            raise SpentError(f"the file has more than {FREE_RECORDS} records, and one for each of its bytes")


class SpentError(Exception):
    """A file that takes more than its size admits; nothing more of it is read."""
