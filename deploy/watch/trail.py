"""Bounded list of the newest rows with independent read positions."""

from collections import deque
from itertools import islice
from typing import Generic, TypeVar

T = TypeVar("T")


class Trail(Generic[T]):
    """Keeps the newest ``max_rows`` rows; a slow reader misses old rows and never blocks the writer."""

    def __init__(self, max_rows: int) -> None:
        self._rows: deque[T] = deque(maxlen=max_rows)
        self.n = 0

    def append(self, row: T) -> None:
        """Add a row; beyond ``max_rows`` the oldest one is dropped."""
        self._rows.append(row)
        self.n += 1

    def since(self, n_read: int) -> list[T]:
        """Return the rows after the first ``n_read`` ever added, as far as they are still kept.

        Oracle: a list that keeps everything (tests/deploy/watch/test_trail).
        """
        n_new = min(self.n - n_read, len(self._rows))
        return list(islice(self._rows, len(self._rows) - n_new, None)) if n_new > 0 else []

    def all(self) -> list[T]:
        """Return all rows kept, oldest first."""
        return list(self._rows)
