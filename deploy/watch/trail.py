"""The newest rows of something that grows: bounded, and each reader goes on where it stopped."""

from collections import deque
from itertools import islice
from typing import Generic, TypeVar

T = TypeVar("T")


class Trail(Generic[T]):
    """Keeps the newest ``most`` rows; a reader that comes late loses the oldest, never the writer time."""

    def __init__(self, most: int) -> None:
        self._rows: deque[T] = deque(maxlen=most)
        self.n = 0

    def append(self, row: T) -> None:
        """Add a row; beyond ``most`` the oldest one goes."""
        self._rows.append(row)
        self.n += 1

    def since(self, n_read: int) -> list[T]:
        """Return the rows after the first ``n_read`` ever added, as far as they are still here.

        Oracle: a list that keeps everything (tests/deploy/watch/test_trail).
        """
        n_new = min(self.n - n_read, len(self._rows))
        return list(islice(self._rows, len(self._rows) - n_new, None)) if n_new > 0 else []

    def all(self) -> list[T]:
        """Return every row that is kept, the oldest first."""
        return list(self._rows)
