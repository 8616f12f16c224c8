"""No way past the bridge, and no ring: probes that nobody forwards, and probes that every netem hands on.

A probe that nobody forwards and that turns up on the other network came by a bypass. One that every netem hands on,
and that turns up, came through another netem: messages would go round between the two for ever.
"""

import json
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Literal

import zenoh

from common.channels import Network
from common.errors import Fault, PeerError
from netem.bridge.keys import PROBES

Leak = Literal["past", "round"]

_MOST_HOPS: Final = 16
_LONGEST: Final = 20_000
_PROBES: Final = 5
_PAUSE_S: Final = 0.05
_OTHER: Final[dict[Network, Network]] = {"west": "east", "east": "west"}
_REMOTE: Final = zenoh.Locality.REMOTE


class Watch:
    """Looks for leaks between the two networks, before forwarding begins and while it lasts.

    ``keys`` are the key expressions that cross: two netems beside each other on different keys are no ring.
    """

    def __init__(
        self, sessions: Mapping[Network, zenoh.Session], keys: Sequence[str], on_leak: Callable[[str], None]
    ) -> None:
        self._sessions = sessions
        self._keys = [zenoh.KeyExpr(key) for key in keys]
        self._body = json.dumps({"keys": list(keys), "hops": 0})
        self._id = secrets.token_hex(8)
        self._on_leak = on_leak
        self._leaks: dict[tuple[Leak, Network], bool] = {}
        self._unsaid: list[Network] = []
        self._hands_on = False
        self._held: list[Any] = []
        for network in sessions:
            self._listen(network, "past", f"{PROBES}/past/{self._id}/*")
            self._listen(network, "round", f"{PROBES}/round/*/*")

    def refuse_leaks(self) -> None:
        """Probe for a quarter of a second; raise `PeerError` when the networks can see each other.

        From then on the probes of other netems are handed on, as messages are.
        """
        for _ in range(_PROBES):
            self.probe()
            time.sleep(_PAUSE_S)
        if self._leaks:
            raise PeerError([Fault("netem", "zenoh", text) for text in self._texts()])
        self._hands_on = True

    def probe(self) -> None:
        """Send one probe of each kind on each network, and say what the last ones found of rings.

        A bypass that has just come up may show as a ring first.
        """
        while self._unsaid:
            origin = self._unsaid.pop()
            if ("past", origin) not in self._leaks:
                self._on_leak(_text("round", origin))
        for network, session in self._sessions.items():
            for leak in ("past", "round"):
                session.put(f"{PROBES}/{leak}/{self._id}/{network}", self._body, allowed_destination=_REMOTE)

    def close(self) -> None:
        """Stop listening."""
        for declaration in self._held:
            declaration.undeclare()
        self._held.clear()

    def _listen(self, network: Network, leak: Leak, expression: str) -> None:
        receiver = self._receiver(leak, network)
        self._held.append(self._sessions[network].declare_subscriber(expression, receiver, allowed_origin=_REMOTE))

    def _texts(self) -> list[str]:
        """Return what is wrong; a bypass brings both kinds of probes, and only it is named then."""
        kinds = {leak for leak, _ in self._leaks}
        worst = "past" if "past" in kinds else "round"
        return sorted(_text(worst, origin) for leak, origin in self._leaks if leak == worst)[:1]

    def _receiver(self, leak: Leak, network: Network) -> Callable[[zenoh.Sample], None]:
        def receive(sample: zenoh.Sample) -> None:
            *_, probe_id, origin = str(sample.key_expr).split("/")
            if probe_id == self._id:
                if origin == _OTHER[network]:
                    self._found(leak, origin)
            elif self._hands_on and leak == "round":
                self._hand_on(sample, network)

        return receive

    def _found(self, leak: Leak, origin: Network) -> None:
        is_new = (leak, origin) not in self._leaks
        self._leaks[leak, origin] = True
        if is_new and self._hands_on:
            if leak == "past":
                self._on_leak(_text(leak, origin))
            else:
                self._unsaid.append(origin)

    def _hand_on(self, sample: zenoh.Sample, network: Network) -> None:
        """Put another netem's probe on the other network, when what it is about crosses here, too."""
        payload = sample.payload.to_bytes()
        try:
            content: Any = json.loads(payload) if len(payload) <= _LONGEST else None
            hops, theirs = int(content["hops"]), [zenoh.KeyExpr(key) for key in content["keys"]]
        except (ValueError, KeyError, TypeError, RecursionError, zenoh.ZError):
            return
        if hops < _MOST_HOPS and any(one.intersects(other) for one in self._keys for other in theirs):
            body = json.dumps({"keys": content["keys"], "hops": hops + 1})
            self._sessions[_OTHER[network]].put(sample.key_expr, body, allowed_destination=_REMOTE)


def refuse_one_router(sessions: Mapping[Network, zenoh.Session]) -> None:
    """Raise `PeerError` when both sides are connected to the same router or peer."""
    seen = [{str(zid) for zid in (*s.info.routers_zid(), *s.info.peers_zid())} for s in sessions.values()]
    for zid in set.intersection(*seen):
        raise PeerError(Fault("netem", "zenoh", f"both sides are connected to {zid}: it would be one network"))


def _text(leak: str, origin: Network) -> str:
    if leak == "past":
        return f"messages from {origin} reach the other network past netem"
    return f"another netem joins the two networks: messages from {origin} would go round in circles"
