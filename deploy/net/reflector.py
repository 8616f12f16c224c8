"""Far end of a probe, which is the command ``tis net reflect``: it stamps arrivals and serves its clock.

Its keys are below the probe's own; the stamps return in batches.
"""

import contextlib
import json
import platform
import queue
import secrets
import signal
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from threading import Event
from typing import Any, Final, NamedTuple

import numpy as np
import zenoh
from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.clock import monotonic_ns
from tis.common.runtime.clock_watch import ClockServer
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.deploy.net.ends import check_key, low_latency, open_end
from tis.deploy.net.probe import Stamp, read_arrival

MAX_ROWS: Final = 5_000
"""Stamps in one batch, 120 kB."""

_ROW_BYTES: Final = 24


def clock_key(key: str) -> str:
    """Return the key of the far end's clock; not a control key, because it must take the path of the messages."""
    return f"{key}/clock"


def stamps_key(key: str) -> str:
    """Return the key of the far end's stamps; the selector ``?from=N`` gives the first one."""
    return f"{key}/stamps"


class Batch(NamedTuple):
    """Stamps of the far end named ``name``, from number ``first`` on, of the ``total`` so far."""

    name: str
    first: int
    total: int
    rows: Sequence[Stamp]

    def pack(self) -> tuple[bytes, bytes]:
        """Return a reply's payload, three big-endian int64 a row, and its attachment."""
        about = {"name": self.name, "first": self.first, "total": self.total}
        return np.array(self.rows, dtype=">i8").tobytes(), json.dumps(about).encode()

    @classmethod
    def unpack(cls, payload: bytes, attachment: bytes) -> "Batch | None":
        """Return the batch, None when it is malformed (oracle: tests/deploy/net/test_reflector)."""
        try:
            about = json.loads(attachment)
            name, first, total = about["name"], about["first"], about["total"]
        except (ValueError, KeyError, TypeError, RecursionError):
            return None
        counts = type(first) is int and type(total) is int and isinstance(name, str)
        if not counts or len(payload) % _ROW_BYTES or not 0 <= first <= first + len(payload) // _ROW_BYTES <= total:
            return None
        rows = np.frombuffer(payload, dtype=">i8").reshape(-1, 3).tolist()
        return cls(name, first, total, [(seq, mark, came_ns) for seq, mark, came_ns in rows])


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


_WHERE = "tis net reflect"


def run_reflector(
    connect: str | None, listen: str | None, options: ZenohOptions, key: str, wait_s: float, err: Console
) -> int:
    """Stamp messages and return the stamps until SIGINT or SIGTERM; raises `PeerError`, `InputError`."""
    check_key(key, _WHERE)
    endpoint = connect or listen
    if endpoint is None or (connect and listen):
        raise InputError(Fault(_WHERE, "--listen", "or --connect is required, but not both"))
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with ExitStack() as stack:
        session = stack.enter_context(open_end(endpoint, connect is None, options, wait_s, "reflect"))
        reflector = Reflector(session, key)
        stack.callback(reflector.close)
        err.print(escape(f"tis: far end of probes on {key}, at {endpoint}; Ctrl-C ends it"), soft_wrap=True)
        with low_latency():
            reflector.serve(stop.is_set)
    err.print(f"tis: {reflector.n_received} messages stamped")
    return EXIT_OK
