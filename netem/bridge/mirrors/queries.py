"""Queries across the bridge: the question, each reply and the end of the replies are separate packets.

Losses are losses of whole messages, which a reliable transport would hide. After the loss of a question, or of the
end of the replies, the querier waits for its own time-out; a lost reply is missing. The binding cannot read two
options of a query: its target is the one configured (`QueryTargetName`), and nothing is consolidated here, since the
querier's own session does that.

Queries of an advanced subscriber to a cache differ: while such a query is open, the subscriber holds back live
messages that have already crossed, and it is made for reliable links, on which no end is lost. So the loss of its
question or end finishes the query, and only the replies of the cache are lost.
"""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

import zenoh

from tis.common.channels import DESTINATION, OPPOSITE, Direction, Network
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.keys import is_advanced
from tis.netem.bridge.mirrors.stamps import Stamps
from tis.netem.link.packet import Packet

QueryTargetName = Literal["best_matching", "all", "all_complete"]

TARGETS: Final[dict[QueryTargetName, zenoh.QueryTarget]] = {
    "best_matching": zenoh.QueryTarget.BEST_MATCHING,
    "all": zenoh.QueryTarget.ALL,
    "all_complete": zenoh.QueryTarget.ALL_COMPLETE,
}
TIME_OUT_S: Final = 600.0
_MAX_OPEN: Final = 10_000
_REMOTE: Final = zenoh.Locality.REMOTE
_TIMED_OUT: Final = b"Timeout"
_LOST_SOURCE: Final = (
    "a cache numbers its replies for miss detection, but Zenoh's Python binding cannot forward these numbers: "
    "an advanced subscriber may receive recovered messages twice or out of order, and count them as missed"
)


class Queries:
    """The open queries of both directions.

    ``time_out_s`` bounds the life of a query, since the querier's own time-out cannot be read; that one applies
    independently. Beyond `_MAX_OPEN` queries the oldest ones are finished. ``target`` selects the queryables of the
    other network that are queried; caches of advanced publishers are all queried, as their subscribers do.
    """

    def __init__(
        self,
        bridge: Bridge,
        sessions: Mapping[Network, zenoh.Session],
        time_out_s: float,
        on_warning: Callable[[str], None],
        target: QueryTargetName = "best_matching",
    ) -> None:
        self.target: Final = TARGETS[target]
        self.bridge: Final = bridge
        self.sessions: Final = sessions
        self.time_out_s: Final = time_out_s
        self.stamps: Final = Stamps(sessions["west"])
        self.lock: Final = threading.Lock()
        self.n_asked = 0
        self.n_replies = 0
        self.n_finished = 0
        self.n_timed_out = 0
        self.n_unsent = 0
        self._on_warning = on_warning
        self.has_lost_a_source = False
        self._has_warned = False
        self._open: dict[_Question, float] = {}

    def expire(self, now_s: float) -> None:
        """Finish the queries whose time-out has passed, and warn of lost source numbers; ``now_s`` is monotonic."""
        if self.has_lost_a_source and not self._has_warned:
            self._has_warned = True
            self._on_warning(_LOST_SOURCE)
        with self.lock:
            late: list[_Question] = []
            for question, asked_s in self._open.items():  # in the order of asking
                if now_s - asked_s < self.time_out_s and len(self._open) - len(late) <= _MAX_OPEN:
                    break
                late.append(question)
        for question in late:
            self.n_timed_out += 1
            question.finish()

    def close(self) -> None:
        """Finish all open queries."""
        for question in tuple(self._open):
            question.finish()

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        return {
            "queries.asked": self.n_asked,
            "queries.replies": self.n_replies,
            "queries.finished": self.n_finished,
            "queries.timed_out": self.n_timed_out,
            "queries.unsent": self.n_unsent,
        }

    def forget(self, question: "_Question") -> bool:
        """Remove a query from the open ones; False if it was not open."""
        with self.lock:
            return self._open.pop(question, None) is not None

    def take(self, direction: Direction, key: str, query: zenoh.Query) -> None:
        """Offer a query to the link, as one for ``key``."""
        question = _Question(self, direction, key, query)
        with self.lock:
            self.n_asked += 1
            self._open[question] = time.monotonic()
        fate = self.bridge.offer(
            direction, f"query {key}", _bytes(query.attachment),
            len(str(query.parameters)) + _length(query.payload), question,
        )  # fmt: skip
        if fate is None or fate.outcome == "refused":
            question.finish()
        elif fate.outcome != "deliver":
            question.drop()


@dataclass(eq=False)
class _Question:
    """A query, and the state of its replies."""

    queries: Final[Queries]
    direction: Final[Direction]
    key: Final[str]
    query: Final[zenoh.Query]
    _asked_s: float = -1.0
    _n_crossing: int = 0
    _ended: bool = False

    @property
    def _holds_back(self) -> bool:
        return is_advanced(self.key)

    def forward(self, packet: Packet) -> None:
        """Query the other side. A second copy is ignored, since Zenoh numbers its requests."""
        if self._asked_s >= 0.0:
            return
        self._asked_s = time.monotonic()
        queries, query, guarded = self.queries, self.query, self.queries.bridge.guarded
        try:
            payload, stack = query.payload, query.timestamp_stack
            queries.sessions[DESTINATION[self.direction]].get(
                zenoh.Selector(self.key, query.parameters),
                # direct: an extra thread would cost more than the query
                zenoh.handlers.Callback(guarded(self._reply), guarded(self._end), indirect=False),
                target=zenoh.QueryTarget.ALL if self._holds_back else queries.target,
                consolidation=zenoh.ConsolidationMode.NONE,
                accept_replies=query.accepts_replies(),
                timeout=queries.time_out_s,
                payload=None if payload is None else queries.bridge.payload(self.direction, packet, payload),
                encoding=query.encoding,
                attachment=query.attachment,
                source_info=query.source_info,
                timestamp_instrumentation=None if stack is None else stack.instrumentation,
                allowed_destination=_REMOTE,
            )
        except zenoh.ZError:  # finished meanwhile, or refused by Zenoh
            queries.n_unsent += 1
            self.finish()

    def drop(self) -> None:
        """Handle a lost question: the querier waits for its time-out, unless it holds back messages."""
        if self._holds_back and self._asked_s < 0.0:  # else another copy has arrived
            self.finish()

    def finish(self) -> None:
        """End the query for the querier."""
        if self.queries.forget(self):
            self.query.drop()  # type: ignore[no-untyped-call]

    def arrived(self, end: bool) -> None:
        """Note that a reply, or the end, has left the link; the end waits for replies that it has overtaken."""
        with self.queries.lock:
            if end:
                self._ended = True
            else:
                self._n_crossing -= 1
            done = self._ended and self._n_crossing <= 0
        if done:
            self.queries.n_finished += 1
            self.finish()

    def _reply(self, reply: zenoh.Reply) -> None:
        sample, error = reply.ok, reply.err
        if sample is not None:
            answer = _Reply(self, partial(self._send_sample, sample))
            if sample.source_info is not None:
                self.queries.has_lost_a_source = True
            name, attachment, payload = str(sample.key_expr), _bytes(sample.attachment), sample.payload
        elif error is None or self._is_own_time_out(error):
            return
        else:
            answer = _Reply(self, partial(self._send_error, error))
            name, attachment, payload = self.key, b"", error.payload
        with self.queries.lock:
            self._n_crossing += 1
        fate = self.queries.bridge.offer(OPPOSITE[self.direction], f"reply {name}", attachment, len(payload), answer)
        if fate is None or fate.outcome != "deliver":
            answer.drop()

    def _send_sample(self, sample: zenoh.Sample, packet: Packet) -> None:
        """Reply with a put or a delete of the other side."""
        queries, query = self.queries, self.query
        stamp = queries.stamps.stamp(self.key, sample)
        if sample.kind == zenoh.SampleKind.DELETE:
            query.reply_del(sample.key_expr, express=sample.express, attachment=sample.attachment, timestamp=stamp)
            return
        query.reply(
            sample.key_expr,
            queries.bridge.payload(OPPOSITE[self.direction], packet, sample.payload),
            encoding=sample.encoding,
            express=sample.express,
            attachment=sample.attachment,
            timestamp=stamp,
        )

    def _send_error(self, error: zenoh.ReplyError, packet: Packet) -> None:
        """Reply with an error of the other side."""
        payload = self.queries.bridge.payload(OPPOSITE[self.direction], packet, error.payload)
        self.query.reply_err(payload, encoding=error.encoding)

    def _end(self) -> None:
        end = _End(self)
        fate = self.queries.bridge.offer(OPPOSITE[self.direction], f"end {self.key}", b"", 0, end)
        if fate is None or fate.outcome == "refused":
            self.finish()
        elif fate.outcome != "deliver":
            end.drop()

    def lost_end(self) -> None:
        """Handle a lost end: the querier waits for its time-out, unless it holds back messages."""
        if self._holds_back:
            self.arrived(end=True)

    def _is_own_time_out(self, error: zenoh.ReplyError) -> bool:
        """Tell whether an error is the time-out of our own get, not an answer of the other side."""
        waited_s = time.monotonic() - self._asked_s
        return waited_s >= self.queries.time_out_s - 0.1 and error.payload.to_bytes() == _TIMED_OUT


@dataclass
class _Reply:
    """A reply that crosses back; ``send`` replies on the querier's side."""

    question: Final[_Question]
    send: Final[Callable[[Packet], None]]
    left: bool = False

    def forward(self, packet: Packet) -> None:
        """Reply; a second copy of a reply is a second reply."""
        try:
            self.send(packet)
            self.question.queries.n_replies += 1
        except zenoh.ZError:  # the query has ended: by its time-out, or before this copy
            self.question.queries.n_unsent += 1
        self.drop()

    def drop(self) -> None:
        """Count it as arrived or lost, once."""
        if not self.left:
            self.left = True
            self.question.arrived(end=False)


@dataclass(frozen=True)
class _End:
    """The end of the replies, which crosses back."""

    question: _Question

    def forward(self, packet: Packet) -> None:  # noqa: ARG002
        self.question.arrived(end=True)

    def drop(self) -> None:
        """Handle its loss."""
        self.question.lost_end()


def _bytes(attachment: zenoh.ZBytes | None) -> bytes:
    return b"" if attachment is None else attachment.to_bytes()


def _length(payload: zenoh.ZBytes | None) -> int:
    return 0 if payload is None else len(payload)
