"""The queues of a link: a server for each group of keys, on the terms that hold for it from instant to instant."""

from collections.abc import Mapping
from typing import Any, Final

from tis.common.scenario.network.capacity import Capacity
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.streams import Address
from tis.common.trace import Trace
from tis.netem.conditions.conditions import Condition, Conditions, merged
from tis.netem.link.queue.lines import DATA
from tis.netem.link.queue.server import MEMORY_NS, Departed, Server
from tis.netem.link.queue.transmission import Service
from tis.netem.link.rules import LINK

_MAX_KEPT: Final = 256
_ALWAYS_NS: Final = 1 << 62
_Changes = tuple[Change, ...]


class Queues:
    """The servers of a link by group, driven through the changes of its conditions at their exact instants.

    A condition replaces stages of pipelines, so also capacities; it may scale them, and be a stall. Each change holds
    for all that waits, and for the rest of what is being sent. Without a capacity and a stall nothing waits, so
    everything that did leaves at that instant.

    ``pipelines`` has the pipeline whose capacity a group shares; ``address`` is that of the link, without a key.
    Conditions are followed only while something waits. Instants must not decrease. ``servers`` has the groups whose
    messages have met a queue so far.
    """

    def __init__(
        self, conditions: Conditions, pipelines: Mapping[str, Pipeline], address: Address,
        traces: Mapping[str, Trace],
    ) -> None:  # fmt: skip
        self._conditions: Final = conditions
        self._pipelines: Final = pipelines
        self._address: Final = address
        self._traces: Final = traces
        self.servers: Final[dict[str, Server]] = {}
        self._capacities: dict[tuple[str, _Changes], Capacity | None] = {}
        self._held: Condition | None = None
        self._until_ns = 0

    def offer(self, group: str, service: Service, item: Any, n_bytes: int, now_ns: int, priority: int = DATA) -> bool:
        """Put a message into the queue of its group, whose terms are ``service`` now; False if the queue is full."""
        return self._server(group, service, now_ns).offer(item, n_bytes, now_ns, priority)

    def has_room(self, group: str, service: Service, n_bytes: int, now_ns: int) -> bool:
        """Tell whether a message fits into the queue of its group, on the terms ``service``, or never will."""
        return self._server(group, service, now_ns).has_room(n_bytes, now_ns)

    def _server(self, group: str, service: Service, now_ns: int) -> Server:
        """Return the server of a group on these terms."""
        self._follow(now_ns)
        server = self.servers.get(group)
        if server is None:
            server = Server(service, self._address._replace(key=group), self._traces)
            self.servers[group] = server
        server.set_service(service, now_ns)
        return server

    def service(self, group: str) -> Service:
        """Return the terms on which a group's queue is served."""
        return self.servers[group].service

    def depart(self, now_ns: int) -> list[Departed]:
        """Return the messages sent or dropped until ``now_ns``, for each group in order."""
        if not self.servers:
            return []
        self._follow(now_ns)
        return [departed for server in self.servers.values() for departed in server.depart(now_ns)]

    def next_ns(self) -> int | None:
        """Return the instant of the next departure, or of a change before it; None if nothing waits."""
        instants = [ns for server in self.servers.values() if (ns := server.next_departure_ns()) is not None]
        return min(*instants, self._until_ns) if instants else None

    def depth(self) -> tuple[int, int]:
        """Return the messages and bytes that wait, without those of others."""
        servers = self.servers.values()
        return sum(server.n_packets for server in servers), sum(server.n_bytes for server in servers)

    @property
    def n_too_long(self) -> int:
        """Return the messages so far that were longer than the queue they came to."""
        return sum(server.n_too_long for server in tuple(self.servers.values()))

    def look_again(self, now_ns: int) -> None:
        """Forget how long the present condition holds, since a change was added at ``now_ns``."""
        self._until_ns = min(self._until_ns, now_ns)

    def _follow(self, now_ns: int) -> None:
        """Set the terms of all conditions that began until ``now_ns``, each at its instant."""
        while self._until_ns <= now_ns:
            from_ns = max(self._until_ns, now_ns - self._memory_ns())
            condition = self._conditions.at(from_ns)
            self._until_ns = condition.until_ns
            held, self._held = self._held, condition
            if held is None or not _serves_alike(held, condition):
                for group, server in self.servers.items():
                    server.set_service(self._service_of(group, condition), from_ns)

    def _memory_ns(self) -> int:
        """Return how far back changes matter: to the last one while something waits."""
        servers = self.servers.values()
        if any(server.n_packets for server in servers):
            return _ALWAYS_NS
        return MEMORY_NS if any(server.is_shared for server in servers) else 0

    def _service_of(self, group: str, condition: Condition) -> Service:
        """Return the terms of a group under a condition; one that shares the link's capacity has none itself."""
        key = group, condition.changes
        if key not in self._capacities:
            if len(self._capacities) >= _MAX_KEPT:
                self._capacities.clear()
            own = self._pipelines[group]
            capacity = merged(own, condition.changes).rate
            if isinstance(capacity, str):
                capacity = own.rate if group == LINK and not isinstance(own.rate, str) else None
            self._capacities[key] = capacity
        return Service(self._capacities[key], condition.scale_rate, condition.stall)


def _serves_alike(one: Condition, other: Condition) -> bool:
    return one.changes is other.changes and one.scale_rate == other.scale_rate and one.stall == other.stall
