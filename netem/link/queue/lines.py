"""The messages that wait in a queue: in one line, or in a line for each of Zenoh's priorities."""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

CONTROL: Final = 0
"""The priority of Zenoh's own declarations, above all that publishers may have: 1, real time, to 7, background."""

DATA: Final = 5
"""The priority of publishers that ask for none."""

_N_PRIORITIES: Final = 8


class Waiting(NamedTuple):
    """A message that waits; ``n_bytes`` include the overhead at the time of its offer."""

    item: Any
    n_bytes: int
    offered_ns: int
    priority: int


class Fifo(deque[Waiting]):
    """One line for all."""

    def in_order(self) -> Sequence[Waiting]:
        """Return all messages in the order of their offers."""
        return tuple(self)

    def below(self, priority: int) -> tuple[int, int]:  # noqa: ARG002
        """Return the messages that would give way, and their bytes: none."""
        return 0, 0

    def pop_last(self) -> Waiting:
        """Take out the newest message."""
        return self.pop()


class Lines:
    """A line for each priority, strictly one before the other."""

    def __init__(self) -> None:
        self._lines: Final = tuple(deque[Waiting]() for _ in range(_N_PRIORITIES))
        self._bytes: Final = [0] * _N_PRIORITIES
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def append(self, message: Waiting) -> None:
        """Put a message at the end of the line of its priority."""
        self._lines[message.priority].append(message)
        self._bytes[message.priority] += message.n_bytes
        self._n += 1

    def extend(self, messages: Iterable[Waiting]) -> None:
        """Append messages."""
        for one in messages:
            self.append(one)

    def popleft(self) -> Waiting:
        """Take out the oldest message of the highest priority."""
        return self._taken(next(line for line in self._lines if line).popleft())

    def pop_last(self) -> Waiting:
        """Take out the newest message of the lowest priority."""
        return self._taken(next(line for line in reversed(self._lines) if line).pop())

    def in_order(self) -> Sequence[Waiting]:
        """Return all messages in the order of their offers, those of one instant by priority."""
        return sorted((one for line in self._lines for one in line), key=lambda one: one.offered_ns)

    def below(self, priority: int) -> tuple[int, int]:
        """Return how many messages would give way to one of this priority, and their bytes."""
        return sum(map(len, self._lines[priority + 1 :])), sum(self._bytes[priority + 1 :])

    def _taken(self, message: Waiting) -> Waiting:
        self._n -= 1
        self._bytes[message.priority] -= message.n_bytes
        return message
