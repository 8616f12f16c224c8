"""Links that peers tell netem's routers of, read in Zenoh's own log: who is connected to whom past netem.

Zenoh's admin space tells it, too, but reading it can stop a router (`tis.netem.bridge.standstill`). Peers that do not
gossip tell nothing, and a netem that is a client of another router hears nothing.
"""

import re
from collections.abc import Set
from typing import Final

GOSSIP_LEVEL: Final = "zenoh::net::protocol::network=trace"
"""A few lines for each connection that a peer opens or closes."""

Pair = tuple[str, str]
"""Identities of two programs; of the two networks, that of the west first."""

_MAX_PEERS: Final = 4096
_MARK: Final = b" mapped: LocalLinkState {"
_STATE: Final = re.compile(
    rb"Received from ([0-9a-f]{1,32}) mapped: LocalLinkState \{[^{]*? zid: \1,[^{]* links: \{([^}]*)\}"
)
_ZID: Final = re.compile(rb"[0-9a-f]{1,32}(?=: )")


class Gossip:
    """The links of each peer that tells them. Lines come from one thread; any other may ask."""

    def __init__(self) -> None:
        self.n_news = 0
        """How often a peer has told its links."""
        self._links: dict[str, frozenset[str]] = {}

    def take(self, line: bytes) -> None:
        """Take a line of Zenoh's log. Oracle: real peers, test_bypass."""
        found = _STATE.search(line) if _MARK in line else None
        if found is None:
            return
        peer = found[1].decode()
        if len(self._links) >= _MAX_PEERS and peer not in self._links:
            self._links.pop(next(iter(self._links)), None)
        self._links[peer] = frozenset(zid.decode() for zid in _ZID.findall(found[2]))
        self.n_news += 1

    def between(self, some: Set[str], others: Set[str]) -> list[Pair]:
        """Return the pairs of a member of ``some`` and one of ``others`` of which one tells that they are linked."""
        links, nobody = self._links, frozenset[str]()
        told = {(one, other) for one in some for other in links.get(one, nobody) & others}
        told |= {(one, other) for other in others for one in links.get(other, nobody) & some}
        return sorted(told)

    def beyond(self, some: Set[str], known: Set[str]) -> set[Pair]:
        """Return the pairs of a member of ``some`` and one to which it tells a link, and which is not ``known``."""
        links, nobody = self._links, frozenset[str]()
        return {(one, other) for one in some for other in links.get(one, nobody) - known}
