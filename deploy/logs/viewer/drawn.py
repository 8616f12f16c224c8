"""Messages for viewers in the merged file, and the thinning of record streams for them."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple, Protocol, overload

import numpy as np
from pydantic import BaseModel

from tis.common.runtime.chunk_writer import MESSAGE_HEAD_BYTES, Ints

DRAWN_HZ: Final = 100
"""Highest rate of drawn messages; faster streams are thinned, the logs' own records never."""
FRAMES_HZ: Final = 10


class Drawn(NamedTuple):
    """One message to add; ``kind`` is a name in `foxglove.SCHEMAS`, or the model of a JSON payload."""

    topic: str
    kind: str | type[BaseModel]
    log_ns: int
    payload: bytes


class Payloads(Sequence[bytes]):
    """The payloads of some message records, by index; each is sliced at access."""

    def __init__(self, records: Sequence[bytes], which: Ints) -> None:
        self._records, self._which = records, which

    def __len__(self) -> int:
        return len(self._which)

    @overload
    def __getitem__(self, i: int) -> bytes: ...
    @overload
    def __getitem__(self, i: slice) -> "Payloads": ...
    def __getitem__(self, i: int | slice) -> "bytes | Payloads":
        if isinstance(i, slice):
            return Payloads(self._records, self._which[i])
        return self._records[int(self._which[i])][MESSAGE_HEAD_BYTES:]

    def __iter__(self) -> Iterator[bytes]:
        records = self._records
        return (records[i][MESSAGE_HEAD_BYTES:] for i in self._which.tolist())


class Records(NamedTuple):
    """N records of one channel in order of aligned time: stamps and sequence numbers (N,), and payloads."""

    log_ns: Ints
    publish_ns: Ints
    seq: Ints
    payloads: Sequence[bytes]


_NONE: Final = np.empty(0, dtype=np.int64)
NO_RECORDS: Final = Records(_NONE, _NONE, _NONE, ())


class Stream(Protocol):
    """A stream that draws the records of one side and topic."""

    def take(self, records: Records) -> Iterable[Drawn]:
        """Take the next records; return messages for them, or for earlier ones."""
        ...


class EveryNth:
    """Thins a stream of ``rate_hz`` to at most ``max_hz`` by picking every n-th record.

    Records of several hands alternate: a group of ``n_together`` is kept or dropped as a whole.
    """

    def __init__(self, rate_hz: int, n_together: int = 1, max_hz: int = DRAWN_HZ) -> None:
        self._every = -(-rate_hz // max_hz)
        self._n_together, self._n_seen = n_together, 0

    def of(self, n_records: int) -> Ints:
        """Return the indices to keep of the next ``n_records``."""
        group = (self._n_seen + np.arange(n_records)) // self._n_together
        self._n_seen += n_records
        return np.flatnonzero(group % self._every == 0)
