"""The queues of a link: a server for each group of keys, at the rate that holds for it from instant to instant."""

from collections.abc import Mapping
from typing import Any, Final

from common.scenario.network.capacity import Rate
from common.scenario.network.conditions import Change
from common.scenario.network.pipeline import Pipeline
from netem.conditions.conditions import Conditions, merged
from netem.link.queue.server import Departed, Server
from netem.link.rules import LINK

_MAX_KEPT: Final = 256
_Changes = tuple[Change, ...]


class Queues:
    """The servers of a link by group, driven through the changes of its conditions at their exact instants.

    A condition replaces stages of pipelines, so also rates: a change of a rate holds for all that waits, and for the
    rest of what is being sent. Without a rate nothing waits, so everything that did leaves at that instant.

    ``pipelines`` has the pipeline whose rate a group shares. Conditions are followed only while something waits.
    Instants must not decrease.
    """

    def __init__(self, conditions: Conditions, pipelines: Mapping[str, Pipeline]) -> None:
        self._conditions: Final = conditions
        self._pipelines: Final = pipelines
        self._servers: dict[str, Server] = {}
        self._rates: dict[tuple[str, _Changes], Rate | None] = {}
        self._changes: _Changes = ()
        self._until_ns = 0

    def __bool__(self) -> bool:
        """Tell whether any message has met a rate so far."""
        return bool(self._servers)

    def offer(self, group: str, rate: Rate, item: Any, n_bytes: int, now_ns: int) -> bool:
        """Put a message into the queue of its group, whose ``rate`` this is now; False if the queue is full."""
        self._follow(now_ns)
        server = self._servers.get(group)
        if server is None:
            server = self._servers[group] = Server(rate)
        elif server.rate is not rate:
            server.set_rate(rate, now_ns)
        return server.offer(item, n_bytes, now_ns)

    def rate(self, group: str) -> Rate | None:
        """Return the rate at which a group's queue is served."""
        return self._servers[group].rate

    def depart(self, now_ns: int) -> list[Departed]:
        """Return the messages sent or dropped until ``now_ns``, for each group in order."""
        if not self._servers:
            return []
        self._follow(now_ns)
        return [departed for server in self._servers.values() for departed in server.depart(now_ns)]

    def next_ns(self) -> int | None:
        """Return the instant of the next departure, or of a change before it; None if nothing waits."""
        instants = [ns for server in self._servers.values() if (ns := server.next_departure_ns()) is not None]
        return min(*instants, self._until_ns) if instants else None

    def depth(self) -> tuple[int, int]:
        """Return the messages and bytes that wait."""
        servers = self._servers.values()
        return sum(server.n_packets for server in servers), sum(server.n_bytes for server in servers)

    def look_again(self, now_ns: int) -> None:
        """Forget how long the present condition holds, since a change was added at ``now_ns``."""
        self._until_ns = min(self._until_ns, now_ns)

    def _follow(self, now_ns: int) -> None:
        """Set the rates of all conditions that began until ``now_ns``, each at its instant."""
        while self._until_ns <= now_ns:
            waits = any(server.n_packets for server in self._servers.values())
            from_ns = self._until_ns if waits else now_ns
            condition = self._conditions.at(from_ns)
            self._until_ns = condition.until_ns
            if condition.changes is not self._changes:
                self._changes = condition.changes
                for group, server in self._servers.items():
                    server.set_rate(self._rate_of(group), from_ns)

    def _rate_of(self, group: str) -> Rate | None:
        """Return the rate of a group under the present changes; of a group that shares the link's, None."""
        key = group, self._changes
        if key not in self._rates:
            if len(self._rates) >= _MAX_KEPT:
                self._rates.clear()
            own = self._pipelines[group]
            rate = merged(own, self._changes).rate
            if isinstance(rate, str):
                rate = own.rate if group == LINK and not isinstance(own.rate, str) else None
            self._rates[key] = rate
        return self._rates[key]
