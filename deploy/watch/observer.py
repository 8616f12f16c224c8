"""Observer of a run: a Zenoh client on each of netem's two networks that only listens.

It does not connect the networks and holds no liveliness token, so it is invisible to the sides and to netem. Its
callbacks stamp and append to a bounded queue; a separate thread does everything else.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, TypeVar

import zenoh
from zenoh.handlers import Callback

from tis.common.channels import Network, Side, local_keys, stopped_key
from tis.common.clocks import Exchanges
from tis.common.errors import PeerError
from tis.common.runtime.clock_watch import ClockWatch
from tis.common.runtime.connections import closing
from tis.common.runtime.control import ControlKeys, Roster
from tis.common.runtime.tls_links import of_netem_only
from tis.common.runtime.zenoh_session import ZenohOptions, open_client, visitor
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.watch.book import MISSING, LiveBook, Sighting
from tis.deploy.watch.streams import watched_streams


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
    random shares (tests/deploy/watch/test_observer). Raises `ValueError` without an exchange.
    """
    round_trip_ns = exchanges.round_trip_ns
    ns = int(round_trip_ns.min()) // 2
    return ObserverPath(ns, int(round_trip_ns.max()) - ns)


def vantage(paths: list[ObserverPath], shared: bool) -> Vantage:
    """Return the vantage point on both networks: the bounds of both paths add up."""
    return Vantage(shared, sum(one.bound_ns for one in paths) / NS_PER_MS)


T = TypeVar("T")

_STEP_S: Final = 0.02
_MAX_QUEUED: Final = 20_000
_MAX_DECODED_PER_S: Final = 1_500
_MAX_TOLD_BYTES: Final = 8192
_NICENESS: Final = 10
_COMPARE_EVERY_S: Final = 1.0
_MAX_SILENCE_NS: Final = 3 * NS_PER_S


@dataclass(frozen=True)
class Attendance:
    """Present sides (by their tokens), sides that have left, and the reason of the run's end, if any."""

    connected: bool = False
    present: frozenset[Side] = field(default_factory=frozenset)
    left: frozenset[Side] = field(default_factory=frozenset)
    end_reason: str | None = None


class Observer:
    """Observes a run from outside. Call `start`, `read` from any thread, `stop`.

    Messages beyond its capacity are dropped; the run never waits for it.
    """

    def __init__(
        self, endpoints: Mapping[Network, str], session: str, clock_ns: Callable[[], int] | None = None,
        zenoh: ZenohOptions | None = None,
    ) -> None:  # fmt: skip
        self.error: Exception | None = None
        self.session: Final = session
        self._endpoints = endpoints
        self._zenoh = zenoh or ZenohOptions()
        self._clock_ns = clock_ns or time.monotonic_ns
        self._book = LiveBook(session)
        self._queue: deque[Sighting] = deque(maxlen=_MAX_QUEUED)
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._rosters = {network: Roster(ControlKeys(session), lambda: None) for network in endpoints}
        self._connected = False
        self._paths: dict[Network, ObserverPath] = dict.fromkeys(endpoints, ObserverPath())
        self._vantage: Vantage | None = None
        self._n_seen = 0
        self._heard_ns: dict[Network, int] = {}
        self._thread = threading.Thread(target=self._run, name="observer", daemon=True)

    def start(self) -> None:
        """Wait for netem in the background, then listen."""
        self._thread.start()

    def stop(self) -> None:
        """Stop listening and close the sessions; the book can still be read."""
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join()

    def read(self, look: Callable[[LiveBook], T]) -> T:
        """Return the result of ``look`` on the book; it holds the lock and must be fast."""
        with self._lock:
            return look(self._book)

    def attendance(self) -> Attendance:
        """Return the present attendance."""
        rosters = tuple(self._rosters.values())
        present = frozenset(side for roster in rosters for side in roster.sides())
        left = frozenset(one.side for roster in rosters for one in tuple(roster.left)) - present
        reason = next((roster.end_reason for roster in rosters if roster.end_reason is not None), None)
        return Attendance(self._connected, present, left, reason)

    def vantage(self) -> Vantage | None:
        """Return the vantage point; None before netem's clock has answered."""
        return self._vantage

    def _run(self) -> None:
        with suppress(OSError):  # Zenoh's threads inherit it: the run itself has priority
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
        try:
            with ExitStack() as stack:
                clocks: dict[Network, ClockWatch] = {}
                for network, endpoint in self._endpoints.items():
                    config = visitor(endpoint, self._zenoh)
                    session = open_client(config, self._over.is_set, lambda: None)
                    if session is None:
                        return
                    stack.enter_context(closing(session, config))
                    stack.enter_context(of_netem_only(session, config, f"netem at {endpoint}"))
                    self._listen(network, session, stack)
                    clocks[network] = ClockWatch(session, ControlKeys(self.session).clock)
                self._connected = True
                comparing = threading.Thread(target=self._compare, args=[clocks], name="ways", daemon=True)
                comparing.start()
                stack.callback(comparing.join)
                self._follow()
        except Exception as error:
            self.error = error

    def _listen(self, network: Network, session: zenoh.Session, stack: ExitStack) -> None:
        self._rosters[network].watch(session)
        ours, queue, clock_ns = [*watched_streams(self.session)], self._queue, self._clock_ns
        ours += self._book.displays.keys(network)
        if network == "east":
            ours += local_keys(self.session, network)
        else:
            ours += self._book.forces.keys()

        def on_sample(sample: zenoh.Sample) -> None:
            at_ns, attachment = clock_ns(), sample.attachment
            if attachment is not None and self._connected:  # before, the other end may not be listened to
                self._n_seen += 1
                payload = sample.payload.to_bytes()
                queue.append(Sighting(network, str(sample.key_expr), at_ns, attachment.to_bytes(), payload))

        def on_told(sample: zenoh.Sample) -> None:
            if len(sample.payload) <= _MAX_TOLD_BYTES:
                queue.append(Sighting(network, str(sample.key_expr), clock_ns(), b"", sample.payload.to_bytes()))

        # In Zenoh's own thread: with a thread for each subscriber, an estimate may overtake its sample.
        held: list[Any] = [session.declare_subscriber(key, Callback(on_sample, indirect=False)) for key in ours]
        if network == "east":
            told = [*(ControlKeys(self.session).beat(side) for side in MISSING), stopped_key(self.session)]
            held += [session.declare_subscriber(key, on_told) for key in told]
        stack.callback(held.clear)

    def _follow(self) -> None:
        n_before, counted_s = self._n_seen, time.monotonic()
        while not self._over.wait(_STEP_S):
            # callbacks append meanwhile, so the batch is bounded by count, not by an empty queue
            batch: list[Sighting] = []
            while self._queue and len(batch) < _MAX_QUEUED:
                batch.append(self._queue.popleft())
            with self._lock:
                for seen in batch:
                    self._heard_ns[seen.network] = seen.at_ns
                    self._book.take(seen._replace(at_ns=seen.at_ns - self._paths[seen.network].ns))
                self._book.settle(heard_until_ns(self._clock_ns(), self._heard_ns, self._endpoints))
            # once a second: fewer decoded messages at high rates
            now_s = time.monotonic()
            if now_s - counted_s >= 1:
                self._adapt_thinning((self._n_seen - n_before) / (now_s - counted_s))
                n_before, counted_s = self._n_seen, now_s

    def _compare(self, clocks: Mapping[Network, ClockWatch]) -> None:
        """Follow netem's clock on both networks to correct delays for the paths to here; not on netem's own host."""
        unconnected = list(clocks.values())
        with ExitStack() as stack:
            while not self._over.is_set():
                for clock in tuple(unconnected):
                    with suppress(PeerError, zenoh.ZError):  # netem's clock may not be up yet
                        clock.meet()
                        unconnected.remove(clock)
                        stack.callback(clock.close)
                if not unconnected:
                    found = {
                        network: observer_path(clock.recent())
                        for network, clock in clocks.items()
                        if not clock.shared
                    }
                    self._paths.update(found)
                    self._vantage = vantage(list(found.values()), not found)
                    if not found:
                        return
                self._over.wait(_COMPARE_EVERY_S)

    def _adapt_thinning(self, per_s: float) -> None:
        """Decode only every second, fourth, ... message at rates above `_MAX_DECODED_PER_S`."""
        while per_s / self._book.thinning > _MAX_DECODED_PER_S:
            with self._lock:
                self._book.set_thinning(2 * self._book.thinning)


def heard_until_ns(now_ns: int, heard_ns: Mapping[Network, int], networks: Collection[Network]) -> int:
    """Return the instant up to which all networks were heard: what a late thread has yet to hear is not lost.

    ``heard_ns`` is the instant of the last message of each. A network that is silent for long holds nothing up.
    """
    last_ns = min((heard_ns.get(network, 0) for network in networks), default=0)
    return min(max(last_ns, now_ns - _MAX_SILENCE_NS), now_ns)
