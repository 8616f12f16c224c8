"""All Zenoh traffic of applications across the bridge: messages, queries and liveliness."""

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Final, get_args

import zenoh

from tis.common.channels import DESTINATION, Direction, Network
from tis.common.errors import Fault
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.bypass import Bypasses, Watch
from tis.netem.bridge.gossip import Gossip
from tis.netem.bridge.keys import CrossingKeys
from tis.netem.bridge.mirrors.queries import TIME_OUT_S, Queries, QueryTargetName
from tis.netem.bridge.mirrors.queryables import Queryables
from tis.netem.bridge.mirrors.tokens import Tokens
from tis.netem.bridge.scouting import Scouting
from tis.netem.bridge.standstill import Pulse, StandstillWatch, end_process

_STEP_S: Final = 0.02
_STEPS_PER_EXPIRY: Final = 25
_STEPS_PER_PROBE: Final = 100


class Audience:
    """Whether anybody in a network has subscribed to what crosses to it. Of one thread."""

    def __init__(self, sessions: Mapping[Network, zenoh.Session], expressions: Iterable[str]) -> None:
        self._awaited = {
            network: [
                session.declare_publisher(one, allowed_destination=zenoh.Locality.REMOTE) for one in expressions
            ]
            for network, session in sessions.items()
        }

    def look(self) -> None:
        """Note in which networks somebody subscribes now."""
        for network, publishers in list(self._awaited.items()):
            if any(one.matching_status.matching for one in publishers):  # type: ignore[attr-defined]
                del self._awaited[network]
                for one in publishers:
                    one.undeclare()  # type: ignore[no-untyped-call]

    def counters(self) -> dict[str, int]:
        """Return 1 for a direction whose messages nobody has subscribed to so far."""
        return {f"{direction}.unheard": int(network in self._awaited) for direction, network in DESTINATION.items()}


class Applications:
    """Messages, queries and liveliness of a bridge's two networks.

    One thread does the periodic work: it mirrors queryables, expires queries and looks for a bypass, with ``scouts``
    also by multicast, which is needed for applications other than ours, and with ``gossip`` by what peers tell of
    their links. A bypass goes to ``on_bypass``, by default to ``warn``, as all other warnings do. A network with a
    configuration in ``listers`` has its queryables mirrored one by one (`Queryables`).
    Nothing passes before the bridge's `start`; close this before the sessions.
    """

    def __init__(
        self,
        bridge: Bridge,
        sessions: Mapping[Network, zenoh.Session],
        keys: CrossingKeys,
        lease_s: float,
        warn: Callable[[str], None],
        query_time_out_s: float = TIME_OUT_S,
        scouts: zenoh.Config | None = None,
        listers: Mapping[Network, zenoh.Config] | None = None,
        query_target: QueryTargetName = "best_matching",
        gossip: Gossip | None = None,
        on_bypass: Callable[[str], None] | None = None,
    ) -> None:
        self.queries: Final = Queries(bridge, sessions, query_time_out_s, warn, query_target)
        self.queryables: Final = Queryables(bridge, sessions, self.queries, keys.messages, listers or {}, warn)
        self.tokens: Final = Tokens(bridge, sessions, lease_s)
        self._audience = Audience(sessions, keys.messages)
        self._warn = warn
        self._bypasses = Bypasses(on_bypass or warn, warn)
        self._gossip = gossip or Gossip()
        self._n_news = 0
        self._watch = Watch(sessions, keys.messages, self._bypasses, self._gossip)
        self._scouting = None if scouts is None else Scouting(sessions, scouts, self._bypasses, warn)
        self._bridge = bridge
        self._keys = keys
        self._over = threading.Event()
        bridge.also_counts.append(self.counters)
        self._pulse: Final = Pulse("the thread 'housekeeping'")
        self._standstill = StandstillWatch(self._stands_still)
        for pulse in (bridge.pulse, self.tokens.executor.pulse, self._pulse):
            self._standstill.watch(pulse)
        self._thread = threading.Thread(target=self._housekeeping, name="housekeeping", daemon=True)

    @property
    def n_leaks(self) -> int:
        """How many ways past netem were found."""
        return self._bypasses.n

    def refuse_leaks(self) -> None:
        """Raise `PeerError` if the two networks can reach each other; call it before the bridge's `start`."""
        self._watch.refuse_leaks()

    def open(self) -> None:
        """Listen to both networks."""
        for direction in get_args(Direction):
            for expression in self._keys.messages:
                self._bridge.subscribe(direction, expression)
            for expression in self._keys.tokens:
                self.tokens.watch(direction, expression)
        self.tokens.start()
        self.queryables.open()
        self._thread.start()
        self._standstill.start()

    def close(self) -> None:
        """Stop listening, withdraw all mirrors and drop open queries; a second call does nothing."""
        self._over.set()
        self._standstill.close()
        if self._thread.ident is not None:
            self._thread.join()
        if self._scouting is not None:
            self._scouting.close()
        self._watch.close()
        self.queryables.close()
        self.queries.close()
        self.tokens.close()

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        of_all = self.queries.counters() | self.tokens.counters() | self._audience.counters()
        return of_all | {"leaks": self.n_leaks}

    def _stands_still(self, who: str, silent_s: float) -> None:
        rule = f"{who} has not returned from a call to Zenoh for {silent_s:.0f} s, so nothing crosses: restart netem"
        end_process(self._bridge, Fault("netem", "", rule), self._warn)

    def _housekeeping(self) -> None:
        n_steps = 0
        while not self._over.wait(_STEP_S):
            try:
                with self._pulse.busy():
                    self._work(n_steps)
                n_steps += 1
            except BaseException as error:
                self._bridge.failed(error)
                return

    def _work(self, n_steps: int) -> None:
        now_s = time.monotonic()
        self.queryables.step(now_s, self.tokens.is_cut)
        if n_steps % _STEPS_PER_EXPIRY == 0:
            self.queries.expire(now_s)
            self._audience.look()
        if (n_news := self._gossip.n_news) != self._n_news:
            self._n_news = n_news
            self._watch.look()
        if n_steps % _STEPS_PER_PROBE == _STEPS_PER_PROBE - 1:
            self._watch.probe()
        if self._scouting is not None:
            self._scouting.step(now_s)
