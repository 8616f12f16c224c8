"""The ways by which what netem sends comes to an observer: what they add to the delays that it sees."""

from typing import NamedTuple

from common.clocks.exchange import Exchanges
from common.units import NS_PER_MS


class ObserverPath(NamedTuple):
    """How long a message takes from netem to the observer, and how far off that can be, in ns."""

    ns: int = 0
    bound_ns: int = 0


class Vantage(NamedTuple):
    """From where a run is seen: from netem's own host, or not; then how far off a delay can be, in ms."""

    here: bool
    bound_ms: float = 0.0


def observer_path(exchanges: Exchanges) -> ObserverPath:
    """Return the way of one network, by the newest exchanges with netem's clock on it.

    The observer's clock cancels in a delay, since both its ends are stamped by it; the two ways do not. Of a round
    trip a way takes any share, so half the shortest one is off by as much as the longest leaves open. Oracle: random
    shares (tests/deploy/watch/test_observer_path). Raises `ValueError` without an exchange.
    """
    round_trip_ns = exchanges.round_trip_ns
    ns = int(round_trip_ns.min()) // 2
    return ObserverPath(ns, int(round_trip_ns.max()) - ns)


def vantage(paths: list[ObserverPath], shared: bool) -> Vantage:
    """Return from where both networks are seen: a delay is off by at most what both ways can be."""
    return Vantage(shared, sum(one.bound_ns for one in paths) / NS_PER_MS)
