"""A buffer that is full: what it drops belongs to no network that anybody asked for, so it is said at once."""

from collections.abc import Callable, Mapping
from typing import Final

from common.channels import Direction
from common.records import Departure, Outcome
from common.scenario.network import Buffer
from netem.expected.synopsis import way
from netem.link.link import Link

AT_THE_DOOR: Final[Outcome] = "overflow"
"""What becomes of a message that finds no room."""

AFTER_ALL: Final[Departure] = "evicted"
"""What becomes of the one held longest where the policy is to drop it."""


def full_buffer(buffer: Buffer, most_held: int | None) -> str:
    """Return the bound that was met, as ``buffer of 20 MB full``.

    ``most_held`` is the largest number of messages that were held at a time; None: nobody knows, so both are named.
    """
    packets, size = f"{buffer.max_packets} messages", f"{buffer.max_mb:g} MB"
    if most_held is None:
        return f"buffer of {size} or {packets} full"
    return f"buffer of {packets if most_held >= buffer.max_packets else size} full"


class BufferWatch:
    """Warns of each direction once, when a full buffer has dropped something; any thread may ask it to look."""

    def __init__(self, links: Mapping[Direction, Link], buffer: Buffer, warn: Callable[[str], None]) -> None:
        self._left: dict[Direction, Link] = dict(links)
        self._buffer = buffer
        self._warn = warn

    def look(self) -> None:
        """Look whether anything was dropped since the last time."""
        for direction, link in list(self._left.items()):
            if link.dropped[AT_THE_DOOR] or link.dropped[AFTER_ALL]:
                del self._left[direction]
                full = full_buffer(self._buffer, link.most_held)
                self._warn(f"{way(direction)}: {full}: it drops messages, which is no part of the network asked for")
