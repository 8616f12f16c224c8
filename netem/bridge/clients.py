"""The clients of a relay of datagrams: who is known by which address, and who is forgotten."""

import heapq
import socket
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

MAX_CLIENTS: Final = 512
IDLE_S: Final = 300.0
"""A client that is silent in both directions for so long is forgotten (RFC 4787 recommends it for translators)."""

_YIELDS_S: Final = 30.0  # where all places are taken, the one that is silent for longest gives way after it


@dataclass(eq=False, slots=True)
class Client:
    """An address that datagrams come from: its place, which names its flow, and its way to the other end."""

    place: int
    address: Any
    way: socket.socket
    used_s: float
    n_overrun: int = 0


class Clients:
    """The clients by address, at most `MAX_CLIENTS`; their places are used again, since a link keeps their flows.

    Instants are in s and must not decrease (oracle: literal times, tests/netem/bridge/test_clients).
    """

    def __init__(self, make: Callable[[], socket.socket]) -> None:
        self.n_seen = 0
        self._make: Final = make
        self._by_use: OrderedDict[Any, Client] = OrderedDict()
        self._free = list(range(1, MAX_CLIENTS + 1))  # a heap

    def __iter__(self) -> Iterator[Client]:
        """Iterate over those that are known, the one silent for longest first."""
        return iter(tuple(self._by_use.values()))

    def of(self, address: Any, now_s: float) -> Client | None:
        """Return the client at an address, which speaks now, or None where there is no place for it.

        Raises OSError where it cannot have a socket.
        """
        client = self._by_use.get(address)
        if client is not None:
            self.used(client, now_s)
        elif self._free:
            way = self._make()
            client = self._by_use[address] = Client(heapq.heappop(self._free), address, way, now_s)
            self.n_seen += 1
        return client

    def used(self, client: Client, now_s: float) -> None:
        """Note that a client speaks or is spoken to."""
        client.used_s = now_s
        self._by_use.move_to_end(client.address)

    def silent(self, now_s: float) -> list[Client]:
        """Forget the clients that are silent for too long, and return them."""
        bound_s = IDLE_S if self._free else _YIELDS_S
        gone: list[Client] = []
        for client in self:
            if now_s - client.used_s < bound_s:
                break
            del self._by_use[client.address]
            heapq.heappush(self._free, client.place)
            gone.append(client)
            bound_s = IDLE_S
        return gone
