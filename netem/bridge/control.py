"""Control over Zenoh: requests on the control keys of both networks, answered from a separate thread.

A query is answered with the acknowledgement, the state, or the schema of the requests. A put is acknowledged on
``.../acknowledged``, on the network it came from. The callbacks only enqueue, since messages wait behind them.
"""

import json
import queue
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, Final, NamedTuple

import zenoh
from pydantic import BaseModel

from tis.common.audit import Happening
from tis.common.channels import Direction, Network
from tis.common.node import Record
from tis.common.scenario.control import (
    ACKNOWLEDGED,
    EVERY_STATE,
    SCHEMA,
    STATE,
    Acknowledgement,
    RecentDelays,
    control_prefix,
    request_schema,
)
from tis.common.scenario.reading import Profiles
from tis.common.scenario.sight import SightPart
from tis.netem.bridge.audit import AuditTrail
from tis.netem.bridge.driver import Driver
from tis.netem.control.control import Control, Snapshot, describe, snapshot
from tis.netem.control.request import MAX_BYTES, Adapt

_MAX_WAITING: Final = 64
_PAUSE_S: Final = 0.001
_MAX_CLOSE_S: Final = 2.0
_REMOTE: Final = zenoh.Locality.REMOTE

Delays = Callable[[int], Mapping[Direction, RecentDelays | None]]
"""Tells the delays of what left in the seconds before an instant, by direction."""


class _Incoming(NamedTuple):
    """A request that waits; ``payload`` is None if it is too large. Without a ``query`` it was put."""

    network: Network
    operation: str
    payload: bytes | None
    n_bytes: int
    query: zenoh.Query | None


class BridgeControl:
    """The control keys of an emulator. Close it before the sessions.

    At most 64 requests wait; further ones are dropped and counted, so that a flood takes neither the memory nor the
    processor time of the emulator.
    """

    def __init__(
        self,
        bridge: Driver,
        sessions: Mapping[Network, zenoh.Session],
        prefix: str = "tis",
        library: Profiles | None = None,
        adapt: Adapt | None = None,
        audit: AuditTrail | None = None,
        delays: Delays | None = None,
        sight: SightPart | None = None,
    ) -> None:
        self._audit, self._sight = audit, sight
        self._delays = delays
        self.control: Final = Control(bridge.links, library, adapt)
        self.n_flooded = 0
        self.n_unanswered = 0
        self._bridge = bridge
        self._sessions = sessions
        self._prefix: Final = control_prefix(prefix)
        self._waiting: queue.Queue[_Incoming] = queue.Queue(_MAX_WAITING)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="control", daemon=True)
        self._held = ExitStack()

    def open(self) -> None:
        """Begin to answer; requests before the bridge's `start` are refused."""
        keys = f"{self._prefix}*"
        self._bridge.also_counts.append(self.counters)
        self._thread.start()
        for network, session in self._sessions.items():
            asked, put = self._query_receiver(network), self._put_receiver(network)
            queryable = session.declare_queryable(keys, asked, complete=False, allowed_origin=_REMOTE)
            self._held.callback(queryable.undeclare)
            self._held.callback(session.declare_subscriber(keys, put, allowed_origin=_REMOTE).undeclare)

    def close(self) -> None:
        """Stop answering; a second call does nothing."""
        self._held.close()
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join(_MAX_CLOSE_S)
        while not self._waiting.empty():
            late = self._waiting.get_nowait().query
            if late is not None:
                late.drop()  # type: ignore[no-untyped-call]

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        own = {"control.flooded": self.n_flooded, "control.unanswered": self.n_unanswered}
        return self.control.counters() | own

    def _query_receiver(self, network: Network) -> Callable[[zenoh.Query], None]:
        def receive(query: zenoh.Query) -> None:
            self._take(network, str(query.key_expr), query.payload, query)

        return self._bridge.guarded(receive)

    def _put_receiver(self, network: Network) -> Callable[[zenoh.Sample], None]:
        def receive(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                self._take(network, str(sample.key_expr), sample.payload, None)

        return self._bridge.guarded(receive)

    def _take(self, network: Network, key: str, payload: zenoh.ZBytes | None, query: zenoh.Query | None) -> None:
        if key == EVERY_STATE and query is not None:
            key = f"{self._prefix}{STATE}"
        operation = key.removeprefix(self._prefix)
        answers_itself = query is None and operation in (STATE, SCHEMA, ACKNOWLEDGED)
        if not key.startswith(self._prefix) or "/" in operation or answers_itself:
            if query is not None:  # a query for all keys is not meant for the emulator
                query.drop()  # type: ignore[no-untyped-call]
            return
        n_bytes = 0 if payload is None else len(payload)
        content = b"" if payload is None else payload.to_bytes() if n_bytes <= MAX_BYTES else None
        try:
            self._waiting.put_nowait(_Incoming(network, operation, content, n_bytes, query))
        except queue.Full:
            self.n_flooded += 1
            if query is not None:
                query.drop()  # type: ignore[no-untyped-call]

    def _serve(self) -> None:
        while not self._over.is_set():
            try:
                request = self._waiting.get(timeout=0.1)
            except queue.Empty:
                continue
            try:
                self._answer(request)
            except zenoh.ZError:
                self.n_unanswered += 1  # the requester is gone
            except Exception:  # an error of control must not stop the messages
                self.n_unanswered += 1
                traceback.print_exc()
            time.sleep(_PAUSE_S)  # bounds the processor time of a flood

    def _answer(self, request: _Incoming) -> None:
        if request.query is None:
            answer: BaseModel = self._carry_out(request)
            self._sessions[request.network].put(
                f"{self._prefix}{ACKNOWLEDGED}",
                answer.model_dump_json(),
                encoding=zenoh.Encoding.APPLICATION_JSON,
                allowed_destination=_REMOTE,
            )
            return
        with request.query as query:
            if request.operation == STATE or "*" in request.operation:
                key, text = f"{self._prefix}{STATE}", self._state()
            elif request.operation == SCHEMA:
                key, text = str(query.key_expr), json.dumps(request_schema())
            else:
                key, text = str(query.key_expr), self._carry_out(request).model_dump_json()
            query.reply(key, text, encoding=zenoh.Encoding.APPLICATION_JSON)

    def _carry_out(self, incoming: _Incoming) -> Acknowledgement:
        control = self.control
        request = control.read(incoming.operation, incoming.payload, incoming.n_bytes)
        done = self._bridge.intervene(lambda now_ns: control.apply(request, now_ns))
        if self._audit is not None and done is not None:
            key = f"{self._prefix}{incoming.operation}"
            what = (incoming.payload or b"").decode("utf-8", "replace") if done.accepted else "refused"
            self._audit.note(Happening("network", what, incoming.network, key=key), is_by_somebody=True)
        return control.apply(request, None)[0] if done is None else done

    def _state(self) -> str:
        def read(now_ns: int) -> tuple[tuple[int, Mapping[Any, Snapshot]], Sequence[Record]]:
            return (now_ns, snapshot(self._bridge.links, now_ns)), ()

        found = self._bridge.intervene(read)
        now_ns, seen = (None, None) if found is None else found
        counters = self._bridge.counters() if seen else {}
        own = {name: n for name, n in counters.items() if not name.startswith(("forward.", "feedback."))}
        delays = None if self._delays is None or now_ns is None else self._delays(now_ns)
        state = describe(seen, now_ns, own, delays)
        return state.model_copy(update={"sight": self._sight}).model_dump_json(exclude_none=True)


def attach(
    bridge: Driver, sessions: Mapping[Network, zenoh.Session], prefix: str = "tis", library: Profiles | None = None,
    adapt: Adapt | None = None, audit: AuditTrail | None = None, delays: Delays | None = None,
    sight: SightPart | None = None,
) -> Callable[[], None]:  # fmt: skip
    """Open control of an emulator over its networks; return the function that closes it, before the sessions.

    ``delays`` tells what left lately, and is given by an emulator that runs by itself; ``sight`` is that of a run.
    """
    control = BridgeControl(bridge, sessions, prefix, library, adapt, audit, delays, sight)
    control.open()
    return control.close
