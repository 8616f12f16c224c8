"""Queryables through the bridge: each one of a network is mirrored on the other, complete or not.

Routing depends on them: a query that nobody answers ends at once, one that wants complete queryables only (the
services of ROS 2 do) finds them, and the nearest complete one is asked first. They are read from the router's admin
space. What cannot be read, for that is closed or the keys have chunks that begin with ``@`` (the caches of advanced
publishers), a queryable that is not complete stands for.

The admin space is read seldom, and not at all where no application's queryables are to be mirrored one by one: up to
Zenoh 1.10 its answers take the routing tables' lock twice, and when anybody declares something in between, that
router routes nothing ever after (zenoh's pull request 2619).
"""

import json
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import zenoh

from common.channels import DESTINATION, ORIGIN, Direction, Network
from netem.bridge import Bridge
from netem.bridge_keys import is_private
from netem.bridge_queries import Queries

_PAUSE_S: Final = 1.0
_SHARE: Final = 20
_ANSWER_S: Final = 1.0
_REMOTE: Final = zenoh.Locality.REMOTE


class _Mirror:
    """A queryable of the origin's side that stands for one of the destination's; ``within`` is what crosses."""

    def __init__(self, within: zenoh.KeyExpr, expr: zenoh.KeyExpr, querier: zenoh.Querier | None) -> None:
        self.within: Final = within
        self.expr: Final = expr
        self.querier: Final = querier
        self.complete = self.is_complete()
        self.queryable: Any = None

    def is_complete(self) -> bool:
        """Tell whether the other side has a complete queryable here."""
        return self.querier is not None and self.querier.matching_status.matching  # type: ignore[attr-defined]

    @property
    def rank(self) -> tuple[bool, str]:
        """Return its place among those that get the same query; complete ones always get it."""
        return not self.complete, str(self.expr)


class _Listing:
    """Reads the queryables of a network from the admin space of the router that a session is, or is connected to."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._own = str(session.zid())
        routers = [self._own, *(str(zid) for zid in session.info.routers_zid())]
        found = (zid for zid in routers if self._answers(zid))
        self._router = next(found, None)

    @property
    def is_open(self) -> bool:
        """Tell whether there is anything to be read."""
        return self._router is not None

    def read(self, within: str) -> Iterator[str]:
        """Yield the expressions of queryables that share keys with ``within`` and are not ours."""
        prefix = f"@/{self._router}/router/queryable/"
        for reply in self._session.get(prefix + within, timeout=_ANSWER_S):
            if reply.ok is None:
                continue
            key = str(reply.ok.key_expr)
            if key.startswith(prefix) and self._has_others(reply.ok.payload):
                yield key[len(prefix) :]

    def _has_others(self, payload: zenoh.ZBytes) -> bool:
        """Tell whether any source is not this session; a router counts itself for each of its clients."""
        try:
            sources = json.loads(payload.to_bytes())
            clients, peers, routers = (set(sources.get(kind, ())) for kind in ("clients", "peers", "routers"))
        except (ValueError, TypeError, AttributeError):
            return False
        return bool((clients - {self._own}) | (peers - {self._own}) | (routers - {self._own, self._router}))

    def _answers(self, zid: str) -> bool:
        return any(reply.ok is not None for reply in self._session.get(f"@/{zid}/router", timeout=_ANSWER_S))


class Queryables:
    """The mirrors of both directions; `step` has to be called every few ms to tens of ms.

    ``listed``: one by one, as they are read from the admin space; else one that is not complete stands for all.
    """

    def __init__(
        self,
        bridge: Bridge,
        sessions: Mapping[Network, zenoh.Session],
        queries: Queries,
        expressions: Sequence[str],
        listed: bool = True,
    ) -> None:
        self._listed = listed
        self._bridge = bridge
        self._sessions = sessions
        self._queries = queries
        self._within = [zenoh.KeyExpr(expression) for expression in expressions]
        self._lock = threading.Lock()
        self._mirrors: dict[Direction, dict[str, _Mirror]] = {direction: {} for direction in bridge.links}
        self._listings: dict[Direction, _Listing] = {}
        self._next_s = 0.0

    def open(self) -> None:
        """Find out what can be read, and mirror what is there."""
        for direction in self._mirrors:
            listing = _Listing(self._sessions[DESTINATION[direction]]) if self._listed else None
            if listing is not None and listing.is_open:
                self._listings[direction] = listing
            for within in self._within:
                if not (direction in self._listings and _is_listed(within)):
                    self._declare(direction, _Mirror(within, within, None))
        self.step(time.monotonic(), cut=False)

    def step(self, now_s: float, cut: bool) -> None:
        """Follow what has come and gone on the other side; nothing is there while ``cut`` off."""
        if now_s < self._next_s:
            return
        began_s = time.monotonic()
        for direction, listing in self._listings.items():
            there = {} if cut else self._there(listing)
            mirrors = self._mirrors[direction]
            for key in [key for key, mirror in mirrors.items() if mirror.querier is not None and key not in there]:
                self._withdraw(direction, key)
            for key, (within, expr) in there.items():
                mirror = mirrors.get(key)
                if mirror is not None and mirror.is_complete() != mirror.complete:
                    self._withdraw(direction, key)
                    mirror = None
                if mirror is None:
                    querier = self._sessions[DESTINATION[direction]].declare_querier(
                        expr, target=zenoh.QueryTarget.ALL_COMPLETE, allowed_destination=_REMOTE
                    )
                    self._declare(direction, _Mirror(within, expr, querier))
        took_s = time.monotonic() - began_s
        self._next_s = began_s + max(_PAUSE_S, _SHARE * took_s)  # many queryables shall not eat up the processor

    def n_mirrored(self) -> int:
        """Return how many queryables are mirrored now, one by one."""
        return sum(m.querier is not None for mirrors in self._mirrors.values() for m in tuple(mirrors.values()))

    def close(self) -> None:
        """Withdraw every mirror."""
        for direction, mirrors in self._mirrors.items():
            for key in tuple(mirrors):
                self._withdraw(direction, key)
        self._listings.clear()

    def _there(self, listing: _Listing) -> dict[str, tuple[zenoh.KeyExpr, zenoh.KeyExpr]]:
        """Return by key what crosses of each queryable of the other side."""
        there: dict[str, tuple[zenoh.KeyExpr, zenoh.KeyExpr]] = {}
        for within in filter(_is_listed, self._within):
            for key in listing.read(str(within)):
                expr = zenoh.KeyExpr(key)
                if not is_private(key):
                    part = within if expr.includes(within) else expr
                    there[str(part)] = within, part
        return there

    def _declare(self, direction: Direction, mirror: _Mirror) -> None:
        def take(query: zenoh.Query) -> None:
            try:
                self._take(direction, mirror, query)
            except BaseException as error:
                self._bridge.failed(error)

        session = self._sessions[ORIGIN[direction]]
        mirror.queryable = session.declare_queryable(
            mirror.expr, take, complete=mirror.complete, allowed_origin=_REMOTE
        )
        with self._lock:
            self._mirrors[direction][str(mirror.expr)] = mirror

    def _withdraw(self, direction: Direction, key: str) -> None:
        with self._lock:
            mirror = self._mirrors[direction].pop(key)
        mirror.queryable.undeclare()
        if mirror.querier is not None:
            mirror.querier.undeclare()  # type: ignore[no-untyped-call]

    def _take(self, direction: Direction, mirror: _Mirror, query: zenoh.Query) -> None:
        """Take a query once, though every mirror that it matches hears of it."""
        expr = query.key_expr
        with self._lock:
            others = [m for m in self._mirrors[direction].values() if m is not mirror and m.within == mirror.within]
        if is_private(str(expr)) or any(m.rank < mirror.rank and m.expr.intersects(expr) for m in others):
            query.drop()  # type: ignore[no-untyped-call]
            return
        # who asks for more than what crosses is answered from what crosses
        self._queries.take(direction, str(mirror.within if expr.includes(mirror.within) else expr), query)


def _is_listed(within: zenoh.KeyExpr) -> bool:
    return "@" not in str(within)
