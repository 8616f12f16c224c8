"""A full buffer: its drops are not part of the configured network, so the user is warned at once."""

from collections.abc import Callable, Mapping
from typing import Final

from tis.common.channels import Direction
from tis.common.records import Departure, Outcome
from tis.common.scenario.network import Buffer
from tis.netem.expected.synopsis import direction_label
from tis.netem.link.link import Link

DROPPED_NEW: Final[Outcome] = "overflow"
"""The outcome of a message that finds no room."""

DROPPED_OLDEST: Final[Departure] = "evicted"
"""The departure of the message held longest, under the policy that drops it."""


def full_buffer(buffer: Buffer, most_held: int | None) -> str:
    """Return the bound that was reached, as ``buffer of 20 MB full``.

    ``most_held`` is the largest number of messages held at a time; None if unknown, then both bounds are named.
    """
    packets, size = f"{buffer.max_packets} messages", f"{buffer.max_mb:g} MB"
    if most_held is None:
        return f"buffer of {size} or {packets} full"
    return f"buffer of {packets if most_held >= buffer.max_packets else size} full"


class BufferWatch:
    """A warning for each direction, once, after a full buffer has dropped messages; any thread may call `look`."""

    def __init__(self, links: Mapping[Direction, Link], buffer: Buffer, warn: Callable[[str], None]) -> None:
        self._left: dict[Direction, Link] = dict(links)
        self._buffer = buffer
        self._warn = warn

    def look(self) -> None:
        """Warn of the directions in which the first drop has occurred."""
        for direction, link in list(self._left.items()):
            if link.dropped[DROPPED_NEW] or link.dropped[DROPPED_OLDEST]:
                del self._left[direction]
                full = full_buffer(self._buffer, link.most_held)
                rule = "it drops messages, which is not part of the configured network"
                self._warn(f"{direction_label(direction)}: {full}: {rule}")
