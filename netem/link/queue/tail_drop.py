"""Tail drop: a message that finds the queue full is dropped on arrival."""

from typing import NamedTuple, Self

from common.scenario.network import capacity


class TailDrop(NamedTuple):
    """The bounds of a queue, also of one that CoDel manages."""

    max_packets: int
    max_bytes: int | None = None

    @classmethod
    def of(cls, part: capacity.TailDrop | capacity.CoDel) -> Self:
        """Return the bounds of a scenario's queue."""
        return cls(part.max_packets, part.max_bytes)

    def admits(self, n_packets: int, n_bytes: int, arriving_bytes: int) -> bool:
        """Tell whether a message of ``arriving_bytes`` fits beside ``n_packets`` with ``n_bytes`` in total."""
        if n_packets >= self.max_packets:
            return False
        return self.max_bytes is None or n_bytes + arriving_bytes <= self.max_bytes
