"""Tail drop: a message that finds the queue full is dropped at the door."""

from typing import NamedTuple, Self

from common.scenario.network import capacity


class TailDrop(NamedTuple):
    """The bounds of a queue, for a queue that CoDel manages too."""

    max_packets: int
    max_bytes: int | None = None

    @classmethod
    def of(cls, part: capacity.TailDrop | capacity.CoDel) -> Self:
        """Return the bounds that a scenario asks for."""
        return cls(part.max_packets, part.max_bytes)

    def admits(self, n_packets: int, n_bytes: int, arriving_bytes: int) -> bool:
        """Tell whether a message finds room where ``n_packets`` of ``n_bytes`` together are."""
        if n_packets >= self.max_packets:
            return False
        return self.max_bytes is None or n_bytes + arriving_bytes <= self.max_bytes
