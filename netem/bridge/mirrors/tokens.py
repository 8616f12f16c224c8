"""Liveliness through the bridge: a token on one network is mirrored on the other, as late as the link makes it.

A change of a token is a packet. One that is lost is sent again until it arrives, first after a round trip or
`_SHORTEST_RETRY_S`, then ever more seldom, as a reliable transport does: a token tells a state, and a lost change
would falsify it for ever, which no network does.
An outage that lasts longer than the lease takes every mirrored token away, whichever way it goes: the two networks
would have given up their connection. They come back when it is over.
"""

import threading
import time
from collections.abc import Mapping
from typing import Any, Final

import zenoh

from common.channels import DESTINATION, OPPOSITE, ORIGIN, Direction, Network
from netem.bridge.bridge import Bridge
from netem.link.packet import Due

_SHORTEST_RETRY_S: Final = 0.2
_LONGEST_RETRY_S: Final = 3.0
_QUERY_S: Final = 5.0
_RECENT_S: Final = 2.0


class _Retry:
    """When a change is sent again."""

    __slots__ = ("at_s", "pause_s")

    def __init__(self, now_s: float) -> None:
        self.at_s = now_s
        self.pause_s = 0.0


class _Way:
    """What is known of one direction: the origin's tokens, and their mirrors at the destination."""

    def __init__(self) -> None:
        self.alive: dict[str, bool] = {}
        self.numbers: dict[str, int] = {}
        self.applied: dict[str, int] = {}
        self.retries: dict[str, _Retry] = {}
        self.mirrors: dict[str, Any] = {}
        self.withdrawn_s: dict[str, float] = {}
        self.last_number = 0
        self.void_up_to = 0
        self.round_trip_s = 0.0

    def note(self, key: str, alive: bool) -> None:
        """Note a token's new state, as the latest of this direction."""
        self.last_number += 1
        self.alive[key] = alive
        self.numbers[key] = self.last_number


class Tokens:
    """The tokens of both directions. `step` has to be called every few ms to tens of ms: it sends again, and cuts.

    Our own mirrors are ignored where they are seen, so nothing plays ping-pong. Zenoh tells no second token of a
    key, so when a mirror is withdrawn the network is asked whether it has a token of its own.
    """

    def __init__(self, bridge: Bridge, sessions: Mapping[Network, zenoh.Session], lease_s: float) -> None:
        self.lease_s: Final = lease_s
        self.n_changes = 0
        self.n_retries = 0
        self.n_cuts = 0
        self._bridge = bridge
        self._sessions = sessions
        self._lock = threading.RLock()
        self._ways: dict[Direction, _Way] = {direction: _Way() for direction in bridge.links}
        self._out_since_s: float | None = None
        self._cut = False
        self._closed = False
        self._held: list[Any] = []

    def watch(self, direction: Direction, expression: str) -> None:
        """Let the tokens that match ``expression`` cross in ``direction``, those that are there already, too."""

        def take(sample: zenoh.Sample) -> None:
            try:
                self._take(direction, str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)
            except BaseException as error:
                self._bridge.failed(error)

        liveliness = self._sessions[ORIGIN[direction]].liveliness()
        self._held.append(liveliness.declare_subscriber(expression, take, history=True))

    def step(self, now_s: float) -> None:
        """Send again what was lost, and follow outages; ``now_s`` is monotonic."""
        out = any(self._bridge.in_outage(direction) for direction in self._ways)
        if not out:
            self._out_since_s = None
            if self._cut:
                self._restore()
        elif self._out_since_s is None:
            self._out_since_s = now_s
        elif not self._cut and now_s - self._out_since_s >= self.lease_s:
            self._withdraw_all()
        if self._cut:
            return
        for direction, way in self._ways.items():
            with self._lock:
                due = [key for key, retry in way.retries.items() if retry.at_s <= now_s]
            for key in due:
                self._send(direction, key)

    @property
    def is_cut(self) -> bool:
        """Tell whether an outage has outlasted the lease."""
        return self._cut

    def n_mirrored(self) -> int:
        """Return how many tokens are mirrored now."""
        return sum(len(way.mirrors) for way in self._ways.values())

    def close(self) -> None:
        """Watch no more and withdraw every mirror."""
        for declaration in self._held:
            declaration.undeclare()
        self._held.clear()
        self._closed = True
        self._withdraw_all()

    def counters(self) -> dict[str, int]:
        """Return what was counted, by name."""
        return {"tokens.changes": self.n_changes, "tokens.retries": self.n_retries, "tokens.cuts": self.n_cuts}

    def apply(self, direction: Direction, key: str, number: int, alive: bool) -> None:
        """Carry out a change that has arrived, unless a later one was faster or the connection broke meanwhile."""
        way = self._ways[direction]
        with self._lock:
            if self._cut or self._closed or number <= max(way.applied.get(key, 0), way.void_up_to):
                return
            way.applied[key] = number
            if way.numbers[key] == number:
                way.retries.pop(key, None)
            mirror = way.mirrors.get(key)
            if alive and mirror is None:
                way.mirrors[key] = self._sessions[DESTINATION[direction]].liveliness().declare_token(key)
            elif not alive and mirror is not None:
                self._withdraw(direction, key)

    def lost(self, direction: Direction, key: str, number: int) -> None:
        """Send a change that was lost again after a while, unless there is a later one."""
        with self._lock:
            way = self._ways[direction]
            if way.numbers.get(key) == number:
                self._again(way, key, max(_SHORTEST_RETRY_S, way.round_trip_s))

    def _take(self, direction: Direction, key: str, alive: bool) -> None:
        back = self._ways[OPPOSITE[direction]]
        with self._lock:
            if alive and key in back.mirrors:
                return
            recent = time.monotonic() - back.withdrawn_s.get(key, -_RECENT_S) < _RECENT_S
        if alive and recent:
            self._ask(direction, key)  # it may be our own, heard of late
        else:
            self._note(direction, key, alive)

    def _note(self, direction: Direction, key: str, alive: bool) -> None:
        way = self._ways[direction]
        with self._lock:
            if way.alive.get(key, False) == alive:
                return
            way.note(key, alive)
            way.retries.pop(key, None)
            self.n_changes += 1
            if self._cut:
                return
        self._send(direction, key)

    def _send(self, direction: Direction, key: str) -> None:
        way = self._ways[direction]
        with self._lock:
            number, alive = way.numbers[key], way.alive[key]
            retry = way.retries.get(key)
            if retry is not None:
                retry.at_s = float("inf")  # until it is known to be lost
        change = _Change(self, direction, key, number, alive)
        fate = None
        if self._bridge.is_running:
            fate = self._bridge.offer(direction, f"token {key}", b"", len(key), change)
        if fate is None:
            with self._lock:
                self._again(way, key, 0.0)
        elif fate.outcome == "deliver":
            way.round_trip_s = 2e-9 * fate.delay_ns
        elif fate.outcome != "refused":
            self.lost(direction, key, number)

    def _again(self, way: _Way, key: str, pause_s: float) -> None:
        retry = way.retries.setdefault(key, _Retry(0.0))
        if pause_s > 0.0:
            self.n_retries += 1
            retry.pause_s = min(_LONGEST_RETRY_S, max(pause_s, 2.0 * retry.pause_s))
        retry.at_s = time.monotonic() + retry.pause_s

    def _ask(self, direction: Direction, key: str) -> None:
        """Find out whether the origin has a token of its own; it is noted when it answers."""

        def hear(reply: zenoh.Reply) -> None:
            try:
                if reply.ok is not None and key not in self._ways[OPPOSITE[direction]].mirrors:
                    self._note(direction, key, alive=True)
            except BaseException as error:
                self._bridge.failed(error)

        if not self._closed:
            self._sessions[ORIGIN[direction]].liveliness().get(key, hear, timeout=_QUERY_S)

    def _withdraw(self, direction: Direction, key: str) -> None:
        way = self._ways[direction]
        token = way.mirrors[key]
        token.undeclare()
        del way.mirrors[key]
        way.withdrawn_s[key] = time.monotonic()
        self._ask(OPPOSITE[direction], key)

    def _withdraw_all(self) -> None:
        with self._lock:
            self._cut = True
            self.n_cuts += 0 if self._closed else 1
            for direction, way in self._ways.items():
                for key in tuple(way.mirrors):
                    self._withdraw(direction, key)
                way.retries.clear()

    def _restore(self) -> None:
        with self._lock:
            self._cut = False
            for way in self._ways.values():
                way.void_up_to = way.last_number
                for key in [key for key, alive in way.alive.items() if alive]:
                    way.note(key, alive=True)
                    self._again(way, key, 0.0)


class _Change:
    """A change of a token on its way."""

    def __init__(self, tokens: Tokens, direction: Direction, key: str, number: int, alive: bool) -> None:
        self._tokens = tokens
        self._direction: Direction = direction
        self._key = key
        self._number = number
        self._alive = alive

    def forward(self, due: Due) -> None:  # noqa: ARG002
        """Declare or withdraw the mirror."""
        self._tokens.apply(self._direction, self._key, self._number, self._alive)

    def drop(self) -> None:
        """See to it that it is sent again."""
        self._tokens.lost(self._direction, self._key, self._number)
