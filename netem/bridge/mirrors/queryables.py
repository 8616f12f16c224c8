"""Queryables across the bridge: each one of a network is mirrored on the other, complete or not.

Zenoh's routing depends on them: a query without a queryable ends at once, one for complete queryables only (ROS 2
services) finds them, and the nearest complete one is queried first. A client of the network's router lists them
(`tis.netem.bridge.mirrors.listing`), and `tis.netem.bridge.mirrors.listing` removes our own mirrors.

Without a list, because there is no router or its access control hides queryables, one incomplete queryable represents
all. The same holds for keys with chunks that begin with ``@`` (the caches of advanced publishers).
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import zenoh

from tis.common.channels import DESTINATION, OPPOSITE, ORIGIN, Direction, Network
from tis.common.scenario.control import control_prefix
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.keys import is_private
from tis.netem.bridge.mirrors.listing import Listing, owned_by_others, sample
from tis.netem.bridge.mirrors.queries import Queries
from tis.netem.bridge.standstill import end_process, is_answered, is_deadlocked, router_deadlock

_PAUSE_S: Final = 0.1
_PAUSE_RATIO: Final = 20  # pause over processor time of a step: bounds the load of many queryables
_FIRST_S: Final = 3.0
_SLOW_S: Final = 30.0
_REMOTE: Final = zenoh.Locality.REMOTE


class _Listed:
    """A listed queryable of the destination, with the answers of others than ourselves.

    ``expr`` is its part of ``within``, a key expression that crosses.
    """

    def __init__(self, session: zenoh.Session, within: zenoh.KeyExpr, expr: zenoh.KeyExpr) -> None:
        self.within: Final = within
        self.expr: Final = expr
        self._any = session.declare_querier(sample(expr), target=zenoh.QueryTarget.ALL, allowed_destination=_REMOTE)
        self._complete = session.declare_querier(
            expr, target=zenoh.QueryTarget.ALL_COMPLETE, allowed_destination=_REMOTE
        )

    @property
    def is_answered(self) -> bool:
        """Tell whether others answer its sample."""
        return self._any.matching_status.matching  # type: ignore[attr-defined, no-any-return]

    @property
    def is_complete(self) -> bool:
        """Tell whether others have a complete queryable that includes it."""
        return self._complete.matching_status.matching  # type: ignore[attr-defined, no-any-return]

    def forget(self) -> None:
        """Undeclare its queriers."""
        for querier in (self._any, self._complete):
            querier.undeclare()  # type: ignore[no-untyped-call]


@dataclass(eq=False)
class _Mirror:
    """A queryable in the origin that represents one of the destination, or all if it is not ``listed``."""

    within: Final[zenoh.KeyExpr]
    expr: Final[zenoh.KeyExpr]
    listed: Final[bool]
    complete: Final[bool]
    queryable: Any = None

    @property
    def rank(self) -> tuple[bool, str]:
        """Return its rank among mirrors of the same query; complete ones, which always get it, come first."""
        return not self.complete, str(self.expr)


class Queryables:
    """The mirrors of both directions; call `step` every few ms to tens of ms.

    ``listers`` has the configuration of a client that lists the queryables of a network (`Listing`); a network
    without one gets a single incomplete mirror. ``on_news`` gets a line when a network stops listing, and when it
    resumes.
    """

    def __init__(
        self,
        bridge: Bridge,
        sessions: Mapping[Network, zenoh.Session],
        queries: Queries,
        expressions: Sequence[str],
        listers: Mapping[Network, zenoh.Config],
        on_news: Callable[[str], None],
    ) -> None:
        self._bridge = bridge
        self._sessions = sessions
        self._queries = queries
        self._within = [zenoh.KeyExpr(expression) for expression in expressions]
        self._listers = listers
        self._on_news = on_news
        self._lock = threading.Lock()
        self._mirrors: dict[Direction, dict[str, _Mirror]] = {direction: {} for direction in bridge.links}
        self._listed: dict[Direction, dict[str, _Listed]] = {direction: {} for direction in bridge.links}
        self._listings: dict[Direction, Listing] = {}
        self._proofs: list[Any] = []
        self._next_s = 0.0

    def open(self) -> None:
        """Begin to list, and mirror the first lists."""
        for direction in self._mirrors:
            self._start_listing(direction)
        until_s = time.monotonic() + _FIRST_S
        for direction in self._mirrors:
            listing = self._listings.get(direction)
            has_list = listing is not None and listing.await_first(max(0.0, until_s - time.monotonic()))
            for within in self._within:
                if not (has_list and _is_listed(within)):
                    self._declare(direction, _Mirror(within, within, listed=False, complete=False))
            if listing is not None and not has_list:
                self._on_news(
                    f"the {DESTINATION[direction]} network does not list its queryables: an incomplete one "
                    "represents all, and a query without an answer takes a round trip"
                )
        self.step(time.monotonic(), cut=False)

    def step(self, now_s: float, cut: bool) -> None:
        """Update the mirrors to the latest lists; while the networks are ``cut`` off there are no mirrors."""
        if now_s < self._next_s:
            return
        began_s = time.thread_time()
        for direction, listing in self._listings.items():
            keys = listing.keys
            if keys is not None:
                self._update_listed(direction, keys)
                self._update_mirrors(direction, cut)
        took_s = time.thread_time() - began_s
        self._next_s = now_s + max(_PAUSE_S, _PAUSE_RATIO * took_s)

    def close(self) -> None:
        """Withdraw every mirror."""
        for listing in self._listings.values():
            listing.close()
        self._listings.clear()
        for direction, mirrors in self._mirrors.items():
            for key in tuple(mirrors):
                self._withdraw(direction, key)
            self._update_listed(direction, frozenset())
        for proof in self._proofs:
            proof.undeclare()
        self._proofs.clear()

    def _start_listing(self, direction: Direction) -> None:
        network = DESTINATION[direction]
        within = [str(expression) for expression in self._within if _is_listed(expression)]
        if network not in self._listers or not within:
            return
        session = self._sessions[network]
        proof = f"{control_prefix(str(session.zid()))}listed"  # private, but listed: it has no ``@``
        self._proofs.append(session.declare_queryable(proof, _drop, allowed_origin=_REMOTE))
        self._listings[direction] = Listing(
            self._listers[network], within, proof, self._silence_report(network), self._return_report(network)
        )

    def _return_report(self, network: Network) -> Callable[[float], None]:
        def report(silent_s: float) -> None:
            self._on_news(f"the {network} network is back after {silent_s:.0f} s: its queryables are listed again")

        return report

    def _silence_report(self, network: Network) -> Callable[[float], bool]:
        session = self._sessions[network]
        joins = bool(session.info.routers_zid())

        def report(silent_s: float) -> bool:
            if is_deadlocked(session):
                end_process(self._bridge, router_deadlock(network), self._on_news)
                return True
            if joins and not session.info.routers_zid():
                self._on_news(
                    f"the router of the {network} network has been gone for {silent_s:.0f} s: nothing crosses until "
                    "it is back; the known queryables stay mirrored"
                )
                return True
            if silent_s < _SLOW_S and is_answered(session):
                return False  # a busy machine: the process that lists comes too late, the router does not
            self._on_news(
                f"the {network} network has not listed its queryables for {silent_s:.0f} s; the known ones stay "
                "mirrored. If its router answers no other client either, restart it"
            )
            return True

        return report

    def _update_listed(self, direction: Direction, keys: frozenset[str]) -> None:
        """Declare queriers for newly listed queryables, and remove those of others."""
        parts: dict[str, tuple[zenoh.KeyExpr, zenoh.KeyExpr]] = {}
        for key in keys:
            expr = zenoh.KeyExpr(key)
            for within in filter(_is_listed, () if is_private(key) else self._within):
                if within.intersects(expr):
                    part = within if expr.includes(within) else expr
                    parts[str(part)] = within, part
        listed = self._listed[direction]
        for key in listed.keys() - parts.keys():
            listed.pop(key).forget()
        for key in parts.keys() - listed.keys():
            listed[key] = _Listed(self._sessions[DESTINATION[direction]], *parts[key])

    def _update_mirrors(self, direction: Direction, cut: bool) -> None:
        """Mirror the queryables of others, and nothing else."""
        listed, mirrors = self._listed[direction], self._mirrors[direction]
        there = set() if cut else owned_by_others(listed, self._mirrors[OPPOSITE[direction]])
        for key, mirror in tuple(mirrors.items()):
            stands_for_one = mirror.listed and key in there and listed[key].is_complete == mirror.complete
            if _is_listed(mirror.within) and not stands_for_one:
                self._withdraw(direction, key)
        for key in there - mirrors.keys():
            one = listed[key]
            self._declare(direction, _Mirror(one.within, one.expr, listed=True, complete=one.is_complete))

    def _declare(self, direction: Direction, mirror: _Mirror) -> None:
        take = self._bridge.guarded(partial(self._take, direction, mirror))
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

    def _take(self, direction: Direction, mirror: _Mirror, query: zenoh.Query) -> None:
        """Accept a query once, although every mirror that it matches receives it."""
        expr = query.key_expr
        with self._lock:
            others = [m for m in self._mirrors[direction].values() if m is not mirror and m.within == mirror.within]
        if is_private(str(expr)) or any(m.rank < mirror.rank and m.expr.intersects(expr) for m in others):
            query.drop()  # type: ignore[no-untyped-call]
            return
        # a query for more than what crosses is reduced to what crosses
        self._queries.take(direction, str(mirror.within if expr.includes(mirror.within) else expr), query)


def _is_listed(within: zenoh.KeyExpr) -> bool:
    return "@" not in str(within)


def _drop(query: zenoh.Query) -> None:
    """Answer nothing: the queryable exists to be listed."""
    query.drop()  # type: ignore[no-untyped-call]
