"""Paths from netem to an observer: the delay they add to observed delays."""

from typing import NamedTuple

from tis.common.clocks import Exchanges
from tis.common.units import NS_PER_MS


class ObserverPath(NamedTuple):
    """Delay of a message from netem to the observer, and its uncertainty, in ns."""

    ns: int = 0
    bound_ns: int = 0


class Vantage(NamedTuple):
    """Vantage point of an observer: netem's own host (``here``) or another, and the uncertainty of delays, ms."""

    here: bool
    bound_ms: float = 0.0


def observer_path(exchanges: Exchanges) -> ObserverPath:
    """Return the path of one network from the newest exchanges with netem's clock on it.

    The observer's clock cancels in a delay, because it stamps both ends; the two paths do not. A path takes an
    unknown share of the round trip: half the shortest one is the estimate, the longest one bounds its error. Oracle:
    random shares (tests/deploy/watch/test_observer_path). Raises `ValueError` without an exchange.
    """
    round_trip_ns = exchanges.round_trip_ns
    ns = int(round_trip_ns.min()) // 2
    return ObserverPath(ns, int(round_trip_ns.max()) - ns)


def vantage(paths: list[ObserverPath], shared: bool) -> Vantage:
    """Return the vantage point on both networks: the bounds of both paths add up."""
    return Vantage(shared, sum(one.bound_ns for one in paths) / NS_PER_MS)
