"""Liveliness across the bridge: a token of one network is mirrored on the other, with the delay of the link.

A change of a token is a packet. A lost one is sent again until it arrives, first after a round trip or
`_MIN_RETRY_S`, then at growing intervals, as a reliable transport does: a token is a state, and a lost change would
leave it wrong permanently, which no network does.

An outage longer than the lease removes all mirrored tokens in both directions, since two real networks would have
closed their connection. They return after the outage.
"""

import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from tis.common.channels import DESTINATION, OPPOSITE, ORIGIN, Direction, Network
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.standstill import SerialExecutor
from tis.netem.link.packet import Packet
from tis.netem.link.queue.lines import CONTROL

_MIN_RETRY_S: Final = 0.2
_MAX_RETRY_S: Final = 3.0
_QUERY_S: Final = 5.0
_RECENT_S: Final = 2.0
_STEP_S: Final = 0.02


@dataclass(slots=True)
class _Retry:
    """The instant of the next attempt to send a change."""

    at_s: float = 0.0
    pause_s: float = 0.0


class _DirectionState:
    """The state of one direction: the origin's tokens, and their mirrors in the destination."""

    def __init__(self) -> None:
        self.alive: dict[str, bool] = {}
        self.numbers: dict[str, int] = {}
        self.applied: dict[str, int] = {}
        self.n_crossing: dict[str, int] = {}
        self.retries: dict[str, _Retry] = {}
        self.mirrors: dict[str, Any] = {}
        self.withdrawn_s: dict[str, float] = {}
        self.asked: dict[str, object] = {}
        self.last_number = 0
        self.void_up_to = 0
        self.round_trip_s = 0.0

    def note(self, key: str, alive: bool) -> None:
        """Note a token's new state, as the latest change of this direction."""
        self.last_number += 1
        self.alive[key] = alive
        self.numbers[key] = self.last_number

    def left(self, key: str) -> None:
        """Note that a change, or its copy, has left the link."""
        n = self.n_crossing.pop(key, 0) - 1
        if n > 0:
            self.n_crossing[key] = n

    def forget(self, key: str) -> None:
        """Forget a token that is gone, unless something of it is still to come: else every name would stay."""
        if not (self.alive.get(key) or key in self.mirrors or key in self.retries or key in self.n_crossing):
            for known in (self.alive, self.numbers, self.applied):
                known.pop(key, None)

    def withdrew(self, key: str, now_s: float) -> None:
        """Note when a mirror was withdrawn; earlier withdrawals are forgotten when they no longer count."""
        self.withdrawn_s.pop(key, None)
        self.withdrawn_s[key] = now_s
        while now_s - self.withdrawn_s[oldest := next(iter(self.withdrawn_s))] >= _RECENT_S:
            del self.withdrawn_s[oldest]


class Tokens:
    """The tokens of both directions.

    Our own mirrors are ignored where they appear, so no token is mirrored back. Zenoh does not report a second token
    of a key, so after the withdrawal of a mirror the network is queried for a token of its own.

    All state belongs to one thread (`SerialExecutor`): Zenoh's callbacks and the link only post. Withdrawing a mirror
    lets Zenoh call netem's own subscribers before it returns, so a callback that waits would wait for itself.
    """

    def __init__(self, bridge: Bridge, sessions: Mapping[Network, zenoh.Session], lease_s: float) -> None:
        self.lease_s: Final = lease_s
        self.n_changes = 0
        self.n_retries = 0
        self.n_cuts = 0
        self.executor: Final = SerialExecutor("tokens", self._step, _STEP_S, bridge.failed)
        self._bridge = bridge
        self._sessions = sessions
        self._states: dict[Direction, _DirectionState] = {direction: _DirectionState() for direction in bridge.links}
        self._out_since_s: float | None = None
        self._cut = False
        self._closed = False
        self._held = ExitStack()

    def watch(self, direction: Direction, expression: str) -> None:
        """Let the tokens that match ``expression`` cross in ``direction``, including existing ones."""

        def take(sample: zenoh.Sample) -> None:
            key, alive, at_s = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT, time.monotonic()
            self.executor.post(lambda: self._take(direction, key, alive, at_s))

        liveliness = self._sessions[ORIGIN[direction]].liveliness()
        # direct: the binding's own thread would have a bounded channel before it, on which Zenoh waits
        handler = zenoh.handlers.Callback(take, indirect=False)
        self._held.callback(liveliness.declare_subscriber(expression, handler, history=True).undeclare)

    def start(self) -> None:
        """Begin to mirror."""
        self.executor.start()

    @property
    def is_cut(self) -> bool:
        """Tell whether an outage has lasted longer than the lease."""
        return self._cut

    def close(self) -> None:
        """Stop watching and withdraw every mirror."""
        self._held.close()
        self.executor.post(self._end)
        self.executor.close()

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        return {"tokens.changes": self.n_changes, "tokens.retries": self.n_retries, "tokens.cuts": self.n_cuts}

    def apply(self, direction: Direction, key: str, number: int, alive: bool) -> None:
        """Apply a change that has arrived, unless a later one came first or the networks were cut meanwhile."""
        state = self._states[direction]
        state.left(key)
        self._apply(direction, key, number, alive)
        state.forget(key)

    def _apply(self, direction: Direction, key: str, number: int, alive: bool) -> None:
        state = self._states[direction]
        if self._cut or self._closed or number <= max(state.applied.get(key, 0), state.void_up_to):
            return
        state.applied[key] = number
        if state.numbers.get(key) == number:
            state.retries.pop(key, None)
        mirror = state.mirrors.get(key)
        if alive and mirror is None:
            state.mirrors[key] = self._sessions[DESTINATION[direction]].liveliness().declare_token(key)
        elif not alive and mirror is not None:
            self._withdraw(direction, key)

    def dropped(self, direction: Direction, key: str, number: int) -> None:
        """Handle a change, or its copy, that the link drops after all."""
        self._states[direction].left(key)
        self.lost(direction, key, number)

    def lost(self, direction: Direction, key: str, number: int) -> None:
        """Schedule a lost change to be sent again, unless there is a later one or its copy has arrived."""
        state = self._states[direction]
        if state.numbers.get(key) == number > max(state.applied.get(key, 0), state.void_up_to):
            self._schedule(state, key, max(_MIN_RETRY_S, state.round_trip_s))
        state.forget(key)

    def _step(self) -> None:
        """Send lost changes again, and handle outages."""
        now_s = time.monotonic()
        out = any(self._bridge.in_outage(direction) for direction in self._states)
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
        for direction, state in self._states.items():
            for key in [key for key, retry in state.retries.items() if retry.at_s <= now_s]:
                self._send(direction, key)

    def _take(self, direction: Direction, key: str, alive: bool, at_s: float) -> None:
        """Note a change that Zenoh reported at ``at_s``; it may be our own mirror, also one withdrawn meanwhile."""
        back = self._states[OPPOSITE[direction]]
        if not alive:
            self._states[direction].asked.pop(key, None)
        if alive and key in back.mirrors:
            return
        if alive and at_s - back.withdrawn_s.get(key, -_RECENT_S) < _RECENT_S:
            self._query(direction, key)
        else:
            self._note(direction, key, alive)

    def _note(self, direction: Direction, key: str, alive: bool) -> None:
        state = self._states[direction]
        if state.alive.get(key, False) == alive:
            return
        state.note(key, alive)
        state.retries.pop(key, None)
        self.n_changes += 1
        if not self._cut:
            self._send(direction, key)

    def _send(self, direction: Direction, key: str) -> None:
        state = self._states[direction]
        number, alive = state.numbers[key], state.alive[key]
        retry = state.retries.get(key)
        if retry is not None:
            retry.at_s = float("inf")  # until a loss is reported
        change = _Change(self, direction, key, number, alive)
        fate = None
        if self._bridge.is_running:
            fate = self._bridge.offer(direction, f"token {key}", b"", len(key), change, CONTROL)
        if fate is None:
            self._schedule(state, key, 0.0)
        elif fate.outcome == "deliver":
            state.n_crossing[key] = state.n_crossing.get(key, 0) + 1 + fate.n_copies
            state.round_trip_s = 2e-9 * fate.delay_ns
        elif fate.outcome == "refused":
            state.retries.pop(key, None)
            state.forget(key)
        else:
            self.lost(direction, key, number)

    def _schedule(self, state: _DirectionState, key: str, pause_s: float) -> None:
        retry = state.retries.setdefault(key, _Retry())
        if pause_s > 0.0:
            self.n_retries += 1
            retry.pause_s = min(_MAX_RETRY_S, max(pause_s, 2.0 * retry.pause_s))
        retry.at_s = time.monotonic() + retry.pause_s

    def _query(self, direction: Direction, key: str) -> None:
        """Query the origin for a token of its own.

        A client's session first answers with what it has heard, which may be our own mirror. Its router answers in
        order: it reports that the mirror is gone before the end of the replies, which therefore decides.
        """
        state, question, answers = self._states[direction], object(), []

        def receive(reply: zenoh.Reply) -> None:
            answers.append(reply.ok is not None)

        def decide() -> None:
            is_open = state.asked.get(key) is question
            if is_open:
                del state.asked[key]
            if is_open and any(answers) and key not in self._states[OPPOSITE[direction]].mirrors:
                self._note(direction, key, alive=True)

        if not self._closed:
            state.asked[key] = question
            handler = zenoh.handlers.Callback(receive, lambda: self.executor.post(decide), indirect=False)
            self._sessions[ORIGIN[direction]].liveliness().get(key, handler, timeout=_QUERY_S)

    def _withdraw(self, direction: Direction, key: str) -> None:
        state = self._states[direction]
        state.mirrors.pop(key).undeclare()
        state.withdrew(key, time.monotonic())
        self._query(OPPOSITE[direction], key)

    def _withdraw_all(self) -> None:
        self._cut = True
        had_any = any(state.mirrors or state.retries for state in self._states.values())
        self.n_cuts += int(had_any and not self._closed)
        for direction, state in self._states.items():
            for key in tuple(state.mirrors):
                self._withdraw(direction, key)
            state.retries.clear()

    def _restore(self) -> None:
        self._cut = False
        for state in self._states.values():
            state.void_up_to = state.last_number
            state.retries.clear()
            for key, alive in list(state.alive.items()):
                if alive:
                    state.note(key, alive=True)
                    self._schedule(state, key, 0.0)
                state.forget(key)

    def _end(self) -> None:
        self._closed = True
        self._withdraw_all()


@dataclass(frozen=True)
class _Change:
    """A change of a token that crosses the link."""

    tokens: Tokens
    direction: Direction
    key: str
    number: int
    alive: bool

    def forward(self, packet: Packet) -> None:  # noqa: ARG002
        """Have the mirror declared or withdrawn."""
        self.tokens.executor.post(lambda: self.tokens.apply(self.direction, self.key, self.number, self.alive))

    def drop(self) -> None:
        """Schedule it to be sent again."""
        self.tokens.executor.post(lambda: self.tokens.dropped(self.direction, self.key, self.number))
