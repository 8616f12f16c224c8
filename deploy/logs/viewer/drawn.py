"""What is drawn of a run, as messages of the merged file; and how a stream of records is thinned for it."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple, Protocol, overload

import numpy as np
from pydantic import BaseModel

from common.runtime.mcap_chunks import MESSAGE_HEAD_BYTES, Ints

DRAWN_HZ: Final = 100
"""Streams that are faster are drawn at about this rate; the logs' own records are always all there."""
FRAMES_HZ: Final = 10


class Drawn(NamedTuple):
    """One message to add: ``kind`` is a name of `foxglove.SCHEMAS`, or the model whose JSON the payload is."""

    topic: str
    kind: str | type[BaseModel]
    log_ns: int
    payload: bytes


class Payloads(Sequence[bytes]):
    """The payloads of some of a list of message records, by index, each cut out when it is asked for."""

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
    """N records of one channel, in order of (aligned) time: log, publish and number (N,), and their payloads."""

    log_ns: Ints
    publish_ns: Ints
    seq: Ints
    payloads: Sequence[bytes]


_NONE: Final = np.empty(0, dtype=np.int64)
NO_RECORDS: Final = Records(_NONE, _NONE, _NONE, ())


class Stream(Protocol):
    """Draws what one side logs on one topic."""

    def take(self, records: Records) -> Iterable[Drawn]:
        """Take the next records and return what is to be added for them, or for earlier ones."""
        ...


class EveryNth:
    """Picks one of every so many records, so that a stream of ``rate_hz`` comes to at most ``most_hz``.

    Records of several hands take turns: a group of ``n_together`` is kept or left out as a whole.
    """

    def __init__(self, rate_hz: int, n_together: int = 1, most_hz: int = DRAWN_HZ) -> None:
        self._every = -(-rate_hz // most_hz)
        self._n_together, self._n_seen = n_together, 0

    def of(self, n_records: int) -> Ints:
        """Return the indices to keep of the next ``n_records``."""
        group = (self._n_seen + np.arange(n_records)) // self._n_together
        self._n_seen += n_records
        return np.flatnonzero(group % self._every == 0)
