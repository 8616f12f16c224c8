"""Compressed columns of integers that are close to their neighbours."""

from array import array
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.deploy.logs.limits import MAX_NUMBER

Ints = NDArray[np.int64]

_CHUNK: Final = 4096
_KINDS: Final = (np.uint8, np.uint16, np.uint32)


def integers(values: Iterable[int]) -> Ints:
    """Return the integers of records, (N,); raises `TypeError`, `OverflowError` or `ValueError` for anything else.

    `MAX_NUMBER` is the limit.
    """
    found = np.array(array("q", values), dtype=np.int64)
    if ((found > MAX_NUMBER) | (found < -MAX_NUMBER)).any():
        raise ValueError(f"an integer must be at most {MAX_NUMBER}")
    return found


class CompactInts:
    """A growing column of int64; full chunks are stored as their minimum and small unsigned differences to it.

    This takes half the memory for instants and a quarter for counters. Oracle: a list, test_compact_ints.
    """

    def __init__(self) -> None:
        self._low: list[int] = []
        self._above: list[NDArray[np.integer]] = []
        self._rest = array("q")

    def append(self, value: int) -> None:
        """Add one value."""
        self._rest.append(value)
        self._settle()

    def extend(self, values: Ints | Iterable[int]) -> None:
        """Add several values; raises `TypeError` or `OverflowError` when one is no int64."""
        if isinstance(values, np.ndarray):
            # bytes go into the array directly, without an object per value
            self._rest.frombytes(np.ascontiguousarray(values, dtype=np.int64).tobytes())
        else:
            self._rest.extend(values)
        self._settle()

    def values(self) -> Ints:
        """Return all values (N,) as a new array."""
        found = np.empty(len(self), dtype=np.int64)
        for i, (low, above) in enumerate(zip(self._low, self._above, strict=True)):
            place = found[i * _CHUNK : (i + 1) * _CHUNK]
            place[:] = above
            place += low
        found[len(self._low) * _CHUNK :] = self._rest
        return found

    def __len__(self) -> int:
        return len(self._low) * _CHUNK + len(self._rest)

    def __getitem__(self, i: int) -> int:
        chunk, place = divmod(i, _CHUNK)
        if chunk == len(self._low):
            return self._rest[place]
        return self._low[chunk] + int(self._above[chunk][place])

    def _settle(self) -> None:
        if len(self._rest) < _CHUNK:
            return
        values = np.array(self._rest, dtype=np.int64)
        n_full = len(values) // _CHUNK
        for chunk in values[: n_full * _CHUNK].reshape(n_full, _CHUNK):
            low, high = int(chunk.min()), int(chunk.max())
            kind = next((kind for kind in _KINDS if high - low <= np.iinfo(kind).max), None)
            # a range beyond 32 bits may overflow 64 bits as a difference: stored as it is
            self._low.append(0 if kind is None else low)
            self._above.append(chunk.copy() if kind is None else (chunk - low).astype(kind))
        self._rest = array("q", values[n_full * _CHUNK :].tobytes())
