"""Far end of a probe: stamps arrivals by its own clock, serves that clock and returns the stamps."""

import contextlib
import platform
import queue
import secrets
from collections.abc import Callable
from typing import Any, Final

import zenoh

from tis.common.runtime.clock import monotonic_ns
from tis.common.runtime.clock_watch import ClockServer
from tis.deploy.net.probing.far_keys import MAX_ROWS, Batch, clock_key, stamps_key
from tis.deploy.net.probing.message_pairing import Stamp
from tis.deploy.net.probing.receiving_end import read_arrival

_MAX_KEPT: Final = 1_000_000
_MAX_QUEUED: Final = 256
_POLL_S: Final = 0.1


class Reflector:
    """Server for any number of probes on a key. Callbacks only stamp; the newest million stamps is kept."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.n_received = 0
        self._key = stamps_key(key)
        self._name = f"{platform.node() or '?'} {secrets.token_hex(8)}"
        self._received: list[tuple[int, Any]] = []
        self._rows: list[Stamp] = []
        self._error: BaseException | None = None
        self._queries: queue.Queue[zenoh.Query] = queue.Queue(_MAX_QUEUED)
        self._clock = ClockServer([session], clock_key(key))
        self._declarations: list[Any] = [
            session.declare_subscriber(key, zenoh.handlers.Callback(self._on_sample, indirect=False)),
            session.declare_queryable(self._key, self._on_query, complete=True),
        ]

    def serve(self, over: Callable[[], bool]) -> None:
        """Return stamps until ``over``; raises an error of a callback."""
        while not over():
            with contextlib.suppress(queue.Empty), self._queries.get(timeout=_POLL_S) as query:
                self._read_received()
                self._reply(query)
            self._read_received()
            if self._error is not None:
                raise self._error

    def close(self) -> None:
        """Stop receiving and answering."""
        self._clock.close()
        for declaration in self._declarations:
            declaration.undeclare()
        self._declarations.clear()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        try:
            self._received.append((monotonic_ns(), sample.attachment))
        except BaseException as error:
            self._error = error

    def _on_query(self, query: zenoh.Query) -> None:
        with contextlib.suppress(queue.Full):
            self._queries.put_nowait(query)

    def _read_received(self) -> None:
        """Parse the new arrivals. Safe without a lock: the callback only appends behind the part removed here."""
        n = len(self._received)
        self._rows += [read_arrival(came_ns, attachment) for came_ns, attachment in self._received[:n]]
        del self._received[:n]
        self.n_received += n
        if len(self._rows) > 2 * _MAX_KEPT:
            del self._rows[:-_MAX_KEPT]

    def _reply(self, query: zenoh.Query) -> None:
        oldest = self.n_received - len(self._rows)
        requested = str(query.parameters).removeprefix("from=")
        first = (
            max(oldest, int(requested))
            if requested.isascii() and requested.isdigit() and len(requested) < 16
            else self.n_received
        )
        begin = min(first, self.n_received) - oldest
        batch = Batch(self._name, begin + oldest, self.n_received, self._rows[begin : begin + MAX_ROWS])
        payload, about = batch.pack()
        with contextlib.suppress(zenoh.ZError):  # the querier may have left
            query.reply(self._key, payload, attachment=about, express=True)
