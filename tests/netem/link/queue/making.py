"""What the tests of the queue are made of: rates, arrivals, and the oracle that sees all arrivals at once."""

from collections.abc import Sequence
from fractions import Fraction
from math import ceil
from typing import Any, NamedTuple

from tis.common.scenario.network.capacity import CoDel, Rate
from tis.common.streams import Address
from tis.netem.link.queue.server import Departed, Server
from tis.netem.link.queue.transmission import Service


class Offered(NamedTuple):
    at_ns: int
    n_bytes: int


def rate(kbit_s: float = 8_000, overhead_bytes: int = 0, **queue: Any) -> Rate:
    """Return a rate; at 8000 kbit/s a byte takes 1 us."""
    made = {"kbit_s": kbit_s, "overhead_bytes": overhead_bytes, "queue": {"kind": "tail_drop"} | queue}
    return Rate.model_validate(made)


def server_of(part: Rate) -> Server:
    """Return an idle server at a rate."""
    return Server(Service(part), Address(1, "forward", "link"))


def set_rate(server: Server, part: Rate, now_ns: int) -> None:
    """Change the rate of a server."""
    server.set_service(Service(part), now_ns)


def served(part: Rate, arrivals: Sequence[Offered]) -> tuple[list[int], list[Departed]]:
    """Offer everything, look only at the end; return the numbers of those refused, and all departures."""
    server = server_of(part)
    refused = [i for i, (at_ns, n_bytes) in enumerate(arrivals) if not server.offer(i, n_bytes, at_ns)]
    departed = server.depart(10**30)
    assert (server.n_packets, server.n_bytes, server.next_departure_ns()) == (0, 0, None)
    return refused, departed


def simulated(part: Rate, arrivals: Sequence[Offered]) -> tuple[list[int], list[Departed]]:
    """Return the same from a simulation of the whole list: event by event, in fractions of a ns, scanning lists.

    CoDel as section 4 of the RFC tells it: states first, one decision for all that are dropped at one dequeuing.
    """
    queue, per_byte = part.queue, Fraction(8_000_000) / Fraction(str(part.kbit_s))
    sizes = [n_bytes + part.overhead_bytes for _, n_bytes in arrivals]
    refused: list[int] = []
    out: list[Departed] = []
    waiting: list[int] = []
    seen: list[int] = []
    sending, free = None, Fraction(0)
    rest = list(range(len(arrivals)))
    above_since: int | None = None
    dropping, total, total_at_entry, due = False, 0, 0, 0

    def late(head: int | None, now: int) -> bool:
        """Tell whether the head is one that may be dropped."""
        nonlocal above_since
        assert isinstance(queue, CoDel)
        behind = sum(sizes[i] for i in waiting if i != head)
        if head is None or now - arrivals[head].at_ns < queue.target_ms * 1e6 or behind <= max(seen):
            above_since = None
            return False
        above_since = now if above_since is None else above_since
        return now - above_since >= queue.interval_ms * 1e6

    def drop(now: int) -> None:
        i = waiting.pop(0)
        out.append(Departed(i, arrivals[i].at_ns, now, dropped=True))

    def gap() -> int:
        assert isinstance(queue, CoDel)
        return int(queue.interval_ms * 1e6 / total**0.5)

    while rest or waiting or sending is not None:
        if sending is not None and (not rest or free <= arrivals[rest[0]].at_ns):
            now = ceil(free)
            out.append(Departed(sending, arrivals[sending].at_ns, now, dropped=False))
            sending = None
        else:
            now, i = arrivals[rest[0]].at_ns, rest.pop(0)
            present = [*waiting, *([] if sending is None else [sending])]
            full = len(present) >= queue.max_packets
            if queue.max_bytes is not None:
                full |= sum(sizes[j] for j in present) + sizes[i] > queue.max_bytes
            if full:
                refused.append(i)
                continue
            seen.append(sizes[i])
            waiting.append(i)
            if sending is not None:
                continue
        if isinstance(queue, CoDel):
            may = late(waiting[0] if waiting else None, now)
            if dropping:
                dropping = may
                while dropping and now >= due:
                    drop(now)
                    total += 1
                    dropping = late(waiting[0] if waiting else None, now)
                    if dropping:
                        due += gap()
            elif may:
                drop(now)
                late(waiting[0] if waiting else None, now)
                dropping, added = True, total - total_at_entry
                total = added if added > 1 and now - due < 16 * queue.interval_ms * 1e6 else 1
                total_at_entry, due = total, 0
                due = now + gap()
        if waiting:
            sending = waiting.pop(0)
            free = max(free, Fraction(arrivals[sending].at_ns)) + sizes[sending] * per_byte
    return refused, out
