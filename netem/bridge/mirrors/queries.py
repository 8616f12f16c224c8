"""Queries through the bridge: the question, each reply and the end of the replies are packets of their own.

A reliable transport would hide each of these losses; here a message is what is lost. So a question, or the end of the
replies, that is lost leaves the querier to its own time-out, and a lost reply is missing. What the binding does not
let us read is chosen so that no reply is missing: all matching queryables are asked, nothing is consolidated.

Not so where an advanced subscriber asks a cache: while its question is open it holds back what comes meanwhile, which
has crossed already, and over the reliable links that it is made for no end is ever lost. There a question or an end
that is lost ends the query, so that what is lost is what the cache would have said and nothing else.
"""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Final

import zenoh

from common.channels import DESTINATION, OPPOSITE, Direction, Network
from netem.bridge.bridge import Bridge
from netem.bridge.keys import is_advanced
from netem.bridge.mirrors.stamps import Stamps
from netem.link.packet import Due

TIME_OUT_S: Final = 600.0
_MOST_OPEN: Final = 10_000
_REMOTE: Final = zenoh.Locality.REMOTE
_TIMED_OUT: Final = b"Timeout"
_LOST_SOURCE: Final = (
    "a cache numbers its replies for miss detection, and Zenoh's Python binding lets no reply that is handed on "
    "carry the numbers: an advanced subscriber may get what it recovers twice, out of order, and count it as missed"
)


class Queries:
    """The queries that are under way, in both directions.

    ``time_out_s`` bounds how long one may stay open: it cannot be read from the query. The querier's own time-out is
    at work whatever it is; beyond `_MOST_OPEN` the oldest is let go of.
    """

    def __init__(
        self,
        bridge: Bridge,
        sessions: Mapping[Network, zenoh.Session],
        time_out_s: float,
        on_warning: Callable[[str], None],
    ) -> None:
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
        """Let go of the queries whose time-out has passed, and say what is to be known; ``now_s`` is monotonic."""
        if self.has_lost_a_source and not self._has_warned:
            self._has_warned = True
            self._on_warning(_LOST_SOURCE)
        with self.lock:
            late: list[_Question] = []
            for question, asked_s in self._open.items():  # in the order of asking
                if now_s - asked_s < self.time_out_s and len(self._open) - len(late) <= _MOST_OPEN:
                    break
                late.append(question)
        for question in late:
            self.n_timed_out += 1
            question.finish()

    def n_open(self) -> int:
        """Return how many queries are under way."""
        return len(self._open)

    def close(self) -> None:
        """Let go of those under way."""
        for question in tuple(self._open):
            question.finish()

    def counters(self) -> dict[str, int]:
        """Return what was counted, by name."""
        return {
            "queries.asked": self.n_asked,
            "queries.replies": self.n_replies,
            "queries.finished": self.n_finished,
            "queries.timed_out": self.n_timed_out,
            "queries.unsent": self.n_unsent,
        }

    def forget(self, question: "_Question") -> bool:
        """Strike a query off the list; False: it was not on it."""
        with self.lock:
            return self._open.pop(question, None) is not None

    def take(self, direction: Direction, key: str, query: zenoh.Query) -> None:
        """Send a query on its way, as one for ``key``."""
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


class _Question:
    """A query on its way, and what became of its replies."""

    def __init__(self, queries: Queries, direction: Direction, key: str, query: zenoh.Query) -> None:
        self.queries: Final = queries
        self.direction: Final = direction
        self.key: Final = key
        self.query: Final = query
        self._holds_back = is_advanced(key)
        self._asked_s = -1.0
        self._n_on_the_way = 0
        self._ended = False

    def forward(self, due: Due) -> None:
        """Ask the queryables of the other side. A second copy is ignored: Zenoh numbers its requests."""
        if self._asked_s >= 0.0:
            return
        self._asked_s = time.monotonic()
        queries, query, payload = self.queries, self.query, self.query.payload
        try:
            queries.sessions[DESTINATION[self.direction]].get(
                zenoh.Selector(self.key, query.parameters),
                # not by way of a thread of its own, which would cost more than the query
                zenoh.handlers.Callback(self._reply, self._end, indirect=False),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                accept_replies=query.accepts_replies(),
                timeout=queries.time_out_s,
                payload=None if payload is None else queries.bridge.payload(self.direction, due, payload),
                encoding=query.encoding,
                attachment=query.attachment,
                source_info=query.source_info,
                allowed_destination=_REMOTE,
            )
        except zenoh.ZError:  # let go of meanwhile, or refused by Zenoh
            queries.n_unsent += 1
            self.finish()

    def drop(self) -> None:
        """Leave the querier to its time-out, unless it holds back messages: the question does not arrive."""
        if self._holds_back and self._asked_s < 0.0:  # else its other copy did
            self.finish()

    def finish(self) -> None:
        """Tell the querier that nothing more will come."""
        if self.queries.forget(self):
            self.query.drop()  # type: ignore[no-untyped-call]

    def arrived(self, end: bool) -> None:
        """Note that a reply, or the end, has left the link; the end waits for replies that it overtook."""
        with self.queries.lock:
            if end:
                self._ended = True
            else:
                self._n_on_the_way -= 1
            done = self._ended and self._n_on_the_way <= 0
        if done:
            self.queries.n_finished += 1
            self.finish()

    def _reply(self, reply: zenoh.Reply) -> None:
        try:
            sample, error = reply.ok, reply.err
            if sample is not None:
                answer: _Reply = _Sample(self, sample)
                if sample.source_info is not None:
                    self.queries.has_lost_a_source = True
                name, attachment, payload = str(sample.key_expr), _bytes(sample.attachment), sample.payload
            elif error is None or self._is_own_time_out(error):
                return
            else:
                answer = _Error(self, error)
                name, attachment, payload = self.key, b"", error.payload
            with self.queries.lock:
                self._n_on_the_way += 1
            back = OPPOSITE[self.direction]
            fate = self.queries.bridge.offer(back, f"reply {name}", attachment, len(payload), answer)
            if fate is None or fate.outcome != "deliver":
                answer.drop()
        except BaseException as error:
            self.queries.bridge.failed(error)

    def _end(self) -> None:
        try:
            end = _End(self)
            fate = self.queries.bridge.offer(OPPOSITE[self.direction], f"end {self.key}", b"", 0, end)
            if fate is None or fate.outcome == "refused":
                self.finish()
            elif fate.outcome != "deliver":
                end.drop()
        except BaseException as error:
            self.queries.bridge.failed(error)

    def lost_end(self) -> None:
        """Leave the querier to its time-out, unless it holds back messages: the end does not arrive."""
        if self._holds_back:
            self.arrived(end=True)

    def _is_own_time_out(self, error: zenoh.ReplyError) -> bool:
        """Tell whether it is our own get that gave up: nobody on the other side said so."""
        waited_s = time.monotonic() - self._asked_s
        return waited_s >= self.queries.time_out_s - 0.1 and error.payload.to_bytes() == _TIMED_OUT


class _Reply:
    """A reply on its way back."""

    def __init__(self, question: _Question) -> None:
        self.question: Final = question
        self._left = False

    def forward(self, due: Due) -> None:
        """Reply on the querier's side; a second copy of a reply is a second reply."""
        try:
            self.send(due)
            self.question.queries.n_replies += 1
        except zenoh.ZError:  # the query is over: its time-out has passed, or its end came before a copy
            self.question.queries.n_unsent += 1
        self.drop()

    def drop(self) -> None:
        """Count it as no longer on its way, once."""
        if not self._left:
            self._left = True
            self.question.arrived(end=False)

    def send(self, due: Due) -> None:
        raise NotImplementedError


class _Sample(_Reply):
    """A put or delete in answer."""

    def __init__(self, question: _Question, sample: zenoh.Sample) -> None:
        super().__init__(question)
        self._sample = sample

    def send(self, due: Due) -> None:
        sample, query = self._sample, self.question.query
        if sample.kind == zenoh.SampleKind.DELETE:
            query.reply_del(
                sample.key_expr, express=sample.express, attachment=sample.attachment, timestamp=self._stamp()
            )
            return
        back = OPPOSITE[self.question.direction]
        query.reply(
            sample.key_expr,
            self.question.queries.bridge.payload(back, due, sample.payload),
            encoding=sample.encoding,
            express=sample.express,
            attachment=sample.attachment,
            timestamp=self._stamp(),
        )

    def _stamp(self) -> zenoh.Timestamp | None:
        return self.question.queries.stamps.stamp(self.question.key, self._sample)


class _Error(_Reply):
    """An error in answer."""

    def __init__(self, question: _Question, error: zenoh.ReplyError) -> None:
        super().__init__(question)
        self._error = error

    def send(self, due: Due) -> None:
        back = OPPOSITE[self.question.direction]
        payload = self.question.queries.bridge.payload(back, due, self._error.payload)
        self.question.query.reply_err(payload, encoding=self._error.encoding)


class _End:
    """The end of the replies, on its way back."""

    def __init__(self, question: _Question) -> None:
        self._question = question

    def forward(self, due: Due) -> None:  # noqa: ARG002
        self._question.arrived(end=True)

    def drop(self) -> None:
        """Note that it does not arrive."""
        self._question.lost_end()


def _bytes(attachment: zenoh.ZBytes | None) -> bytes:
    return b"" if attachment is None else attachment.to_bytes()


def _length(payload: zenoh.ZBytes | None) -> int:
    return 0 if payload is None else len(payload)
