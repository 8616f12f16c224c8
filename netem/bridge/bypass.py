"""Detection of ways around the bridge: bypasses and loops, by probes and by what peers tell of their links.

A ``past`` probe is forwarded by nobody: if it arrives on the other network, it came by a bypass. A ``round`` probe is
forwarded by every netem: if it arrives, it came through another netem, and messages would circulate forever. A peer
of both networks forwards no probe, but its identity is in both. Nor do two peers that are connected to each other,
one of each network or one of neither: they tell it to netem's routers if they gossip. A peer does not tell that such
a link has ended with the other program, so who was in a network is remembered.
"""

import json
import secrets
import threading
import time
from collections.abc import Callable, Mapping, Sequence, Set
from contextlib import ExitStack
from typing import Any, Final, Literal

import zenoh

from tis.common.channels import Network
from tis.common.errors import Fault, PeerError
from tis.netem.bridge.gossip import Gossip, Pair
from tis.netem.bridge.keys import PROBES

Leak = Literal["past", "round"]

_MAX_HOPS: Final = 16
_MAX_BYTES: Final = 20_000
_N_PROBES: Final = 5
_MAX_SEEN: Final = 4096
_N_STEADY: Final = 4  # a program may connect to netem later than to another one
_PAUSE_S: Final = 0.05
_OPPOSITE: Final[dict[Network, Network]] = {"west": "east", "east": "west"}
_REMOTE: Final = zenoh.Locality.REMOTE
_OUTSIDE: Final = "which is in neither network: what they send each other does not cross netem"


class Bypasses:
    """Ways past netem, and loops, each counted and told once.

    Two programs that reach each other are one way, by whatever that shows first; what shows it later goes to
    ``tell_more``, as does what is none for certain.
    """

    def __init__(self, tell: Callable[[str], None], tell_more: Callable[[str], None]) -> None:
        self.n = 0
        self._tell, self.tell_more = tell, tell_more
        self._pairs: set[Pair] = set()
        self._lock = threading.Lock()

    def add(self, text: str, pairs: Set[Pair] = frozenset()) -> None:
        """Tell of a way, of these pairs where it is known which programs it joins."""
        with self._lock:
            n_new = len(pairs - self._pairs) if pairs else 1
            self._pairs |= pairs
        (self._tell if n_new else self.tell_more)(text)
        with self._lock:
            self.n += n_new  # after the text: who sees the count finds it

    def has(self, pairs: Set[Pair]) -> bool:
        """Tell whether all these pairs are counted."""
        return pairs <= self._pairs


class Watch:
    """A search for leaks between the two networks, before and during forwarding.

    ``keys`` are the key expressions that cross: two parallel netems with disjoint keys are no loop.
    """

    def __init__(
        self,
        sessions: Mapping[Network, zenoh.Session],
        keys: Sequence[str],
        bypasses: Bypasses,
        gossip: Gossip | None = None,
    ) -> None:
        self._sessions = sessions
        self._keys = [zenoh.KeyExpr(key) for key in keys]
        self._body = json.dumps({"keys": list(keys), "hops": 0})
        self._id = secrets.token_hex(8)
        self._bypasses = bypasses
        self._leaks: dict[tuple[Leak, Network], bool] = {}
        self._unreported: list[Network] = []
        self._gossip = gossip or Gossip()
        self._own = {str(session.zid()) for session in sessions.values()}
        self._joined: set[str] = set()
        self._linked: set[Pair] = set()
        self._beyond: dict[Pair, int] = {}
        self._seen: dict[str, None] = {}  # who is or was in a network, the latest last
        self._forwards = False
        self._held = ExitStack()
        for network in sessions:
            self._listen(network, "past", f"{PROBES}/past/{self._id}/*")
            self._listen(network, "round", f"{PROBES}/round/*/*")

    def refuse_leaks(self) -> None:
        """Probe for a quarter of a second; raise `PeerError` if the networks can reach each other.

        From then on the probes of other netems are forwarded, like messages.
        """
        for _ in range(_N_PROBES):
            self.probe()
            time.sleep(_PAUSE_S)
        if self._leaks:
            raise PeerError([Fault("netem", "zenoh", text) for text in self._texts()])
        self._forwards = True

    def probe(self) -> None:
        """Send one probe of each kind on each network, and report peers of both and loops since the previous call.

        Loops are reported one call late: a new bypass may first appear as one.
        """
        self.look()
        self._look_beyond()
        while self._unreported:
            origin = self._unreported.pop()
            if ("past", origin) not in self._leaks:
                self._bypasses.add(_text("round", origin))
        for network, session in self._sessions.items():
            for leak in ("past", "round"):
                session.put(f"{PROBES}/{leak}/{self._id}/{network}", self._body, allowed_destination=_REMOTE)

    def look(self) -> None:
        """Report peers of both networks, and peers of one that are connected to a member of the other."""
        self._note_members()
        peers = [{str(zid) for zid in session.info.peers_zid()} - self._own for session in self._sessions.values()]
        both = set.intersection(*peers)
        for zid in sorted(both - self._joined):
            self._joined.add(zid)
            self._bypasses.add(f"the peer {zid} is connected to both networks: what it sends reaches both past netem")
        for pair in self._gossip.between(
            *(members(session) - both - self._own for session in self._sessions.values())
        ):
            if pair not in self._linked:
                self._linked.add(pair)
                self._bypasses.add(
                    f"the peers {pair[0]} in the west and {pair[1]} in the east are connected to each other: "
                    "what they send reaches the other past netem",
                    {pair},
                )

    def _note_members(self) -> set[str]:
        """Return who is in either network, and remember it."""
        found = set[str]().union(*map(members, self._sessions.values()))
        for zid in found:
            self._seen.pop(zid, None)
            self._seen[zid] = None
        while len(self._seen) > _MAX_SEEN:
            del self._seen[next(iter(self._seen))]
        return found

    def _look_beyond(self) -> None:
        """Tell of a peer that is connected to a program never seen in a network, once it was so for some calls."""
        found = self._note_members()
        pairs = self._gossip.beyond(found, found | self._own | self._seen.keys()) if self._forwards else ()
        self._beyond = {pair: self._beyond.get(pair, 0) + 1 for pair in pairs}
        for (one, other), n in sorted(self._beyond.items()):
            if n == _N_STEADY:
                self._bypasses.tell_more(f"the peer {one} is connected to {other}, {_OUTSIDE}")

    def close(self) -> None:
        """Stop listening."""
        self._held.close()

    def _listen(self, network: Network, leak: Leak, expression: str) -> None:
        receiver = self._receiver(leak, network)
        subscriber = self._sessions[network].declare_subscriber(expression, receiver, allowed_origin=_REMOTE)
        self._held.callback(subscriber.undeclare)

    def _texts(self) -> list[str]:
        """Return the leaks found; a bypass delivers both kinds of probes, so it takes precedence over a loop."""
        kinds = {leak for leak, _ in self._leaks}
        kind = "past" if "past" in kinds else "round"
        return sorted(_text(kind, origin) for leak, origin in self._leaks if leak == kind)[:1]

    def _receiver(self, leak: Leak, network: Network) -> Callable[[zenoh.Sample], None]:
        def receive(sample: zenoh.Sample) -> None:
            *_, probe_id, origin = str(sample.key_expr).split("/")
            if probe_id == self._id:
                if origin == _OPPOSITE[network]:
                    self._found(leak, origin)
            elif self._forwards and leak == "round":
                self._forward_probe(sample, network)

        return receive

    def _found(self, leak: Leak, origin: Network) -> None:
        is_new = (leak, origin) not in self._leaks
        self._leaks[leak, origin] = True
        if is_new and self._forwards:
            if leak == "past":
                self._bypasses.add(_text(leak, origin))
            else:
                self._unreported.append(origin)

    def _forward_probe(self, sample: zenoh.Sample, network: Network) -> None:
        """Forward another netem's probe if one of its key expressions crosses here, too."""
        payload = sample.payload.to_bytes()
        try:
            content: Any = json.loads(payload) if len(payload) <= _MAX_BYTES else None
            hops, theirs = content["hops"], [zenoh.KeyExpr(key) for key in content["keys"]]
        except (ValueError, KeyError, TypeError, RecursionError, zenoh.ZError):
            return
        near = type(hops) is int and 0 <= hops < _MAX_HOPS
        if near and any(one.intersects(other) for one in self._keys for other in theirs):
            body = json.dumps({"keys": content["keys"], "hops": hops + 1})
            self._sessions[_OPPOSITE[network]].put(sample.key_expr, body, allowed_destination=_REMOTE)


def refuse_one_router(sessions: Mapping[Network, zenoh.Session]) -> None:
    """Raise `PeerError` if both sides are connected to the same router or peer."""
    seen = [{str(zid) for zid in (*s.info.routers_zid(), *s.info.peers_zid())} for s in sessions.values()]
    for zid in set.intersection(*seen):
        raise PeerError(Fault("netem", "zenoh", f"both sides are connected to {zid}: it would be one network"))


def _text(leak: str, origin: Network) -> str:
    if leak == "past":
        return f"messages from {origin} reach the other network past netem"
    return f"another netem joins the two networks: messages from {origin} would go round in circles"


def members(session: zenoh.Session) -> set[str]:
    """Return the members of a network to which netem is connected."""
    return {str(zid) for zid in (*session.info.peers_zid(), *session.info.routers_zid())}
