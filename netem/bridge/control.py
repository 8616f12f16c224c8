"""Control over Zenoh: requests come on the control keys of both networks and are answered from a thread of their own.

A query is answered with the acknowledgement, with the state, or with the schema of the requests; what is put is
acknowledged on ``.../acknowledged``, on the network that it came from. The callbacks only enqueue, for they stand
between messages.
"""

import json
import queue
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import zenoh
from pydantic import BaseModel

from common.channels import Network
from common.node import Record
from common.scenario.control import (
    ACKNOWLEDGED,
    EVERY_STATE,
    SCHEMA,
    STATE,
    Acknowledgement,
    control_prefix,
    request_schema,
)
from common.scenario.reading import Profiles
from netem.bridge.bridge import Bridge
from netem.control.bounded_json import MAX_BYTES
from netem.control.control import Control
from netem.control.state import Snapshot, describe, snapshot

_MOST_WAITING: Final = 64
_PAUSE_S: Final = 0.001
_LONGEST_CLOSE_S: Final = 2.0
_REMOTE: Final = zenoh.Locality.REMOTE


class _Asked(NamedTuple):
    """A request that has come; ``payload`` None: it is too large. Without a ``query`` it was put."""

    network: Network
    operation: str
    payload: bytes | None
    n_bytes: int
    query: zenoh.Query | None


class BridgeControl:
    """The control keys of a bridge. Close it before the sessions.

    At most 64 requests wait; what comes beyond is dropped and counted, so that a flood neither fills the memory nor
    takes the emulator's time.
    """

    def __init__(
        self,
        bridge: Bridge,
        sessions: Mapping[Network, zenoh.Session],
        prefix: str = "tis",
        library: Profiles | None = None,
    ) -> None:
        self.control: Final = Control(bridge.links, library)
        self.n_flooded = 0
        self.n_unanswered = 0
        self._bridge = bridge
        self._sessions = sessions
        self._prefix: Final = control_prefix(prefix)
        self._waiting: queue.Queue[_Asked] = queue.Queue(_MOST_WAITING)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="control", daemon=True)
        self._held: list[Any] = []

    def open(self) -> None:
        """Begin to answer; before the bridge has started, requests are refused."""
        keys = f"{self._prefix}*"
        self._thread.start()
        for network, session in self._sessions.items():
            self._held.append(
                session.declare_queryable(keys, self._asking(network), complete=False, allowed_origin=_REMOTE)
            )
            self._held.append(session.declare_subscriber(keys, self._putting(network), allowed_origin=_REMOTE))

    def close(self) -> None:
        """Answer no more; a second call does nothing."""
        for declaration in self._held:
            declaration.undeclare()
        self._held.clear()
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join(_LONGEST_CLOSE_S)
        while not self._waiting.empty():
            late = self._waiting.get_nowait().query
            if late is not None:
                late.drop()  # type: ignore[no-untyped-call]

    def counters(self) -> dict[str, int]:
        """Return what was counted, by name."""
        own = {"control.flooded": self.n_flooded, "control.unanswered": self.n_unanswered}
        return self.control.counters() | own

    def _asking(self, network: Network) -> Any:
        def ask(query: zenoh.Query) -> None:
            try:
                self._take(network, str(query.key_expr), query.payload, query)
            except BaseException as error:
                self._bridge.failed(error)

        return ask

    def _putting(self, network: Network) -> Any:
        def put(sample: zenoh.Sample) -> None:
            try:
                if sample.kind == zenoh.SampleKind.PUT:
                    self._take(network, str(sample.key_expr), sample.payload, None)
            except BaseException as error:
                self._bridge.failed(error)

        return put

    def _take(self, network: Network, key: str, payload: zenoh.ZBytes | None, query: zenoh.Query | None) -> None:
        if key == EVERY_STATE and query is not None:
            key = f"{self._prefix}{STATE}"
        operation = key.removeprefix(self._prefix)
        answers_itself = query is None and operation in (STATE, SCHEMA, ACKNOWLEDGED)
        if not key.startswith(self._prefix) or "/" in operation or answers_itself:
            if query is not None:  # who asks for everything does not mean the emulator
                query.drop()  # type: ignore[no-untyped-call]
            return
        n_bytes = 0 if payload is None else len(payload)
        content = b"" if payload is None else payload.to_bytes() if n_bytes <= MAX_BYTES else None
        try:
            self._waiting.put_nowait(_Asked(network, operation, content, n_bytes, query))
        except queue.Full:
            self.n_flooded += 1
            if query is not None:
                query.drop()  # type: ignore[no-untyped-call]

    def _serve(self) -> None:
        while not self._over.is_set():
            try:
                asked = self._waiting.get(timeout=0.1)
            except queue.Empty:
                continue
            try:
                self._answer(asked)
            except zenoh.ZError:
                self.n_unanswered += 1  # who asked is gone
            except Exception:  # the messages go on, whatever is wrong here
                self.n_unanswered += 1
                traceback.print_exc()
            time.sleep(_PAUSE_S)  # leaves the emulator its time in a flood

    def _answer(self, asked: _Asked) -> None:
        if asked.query is None:
            answer: BaseModel = self._carry_out(asked)
            self._sessions[asked.network].put(
                f"{self._prefix}{ACKNOWLEDGED}",
                answer.model_dump_json(),
                encoding=zenoh.Encoding.APPLICATION_JSON,
                allowed_destination=_REMOTE,
            )
            return
        with asked.query as query:
            if asked.operation == STATE or "*" in asked.operation:
                key, text = f"{self._prefix}{STATE}", self._state()
            elif asked.operation == SCHEMA:
                key, text = str(query.key_expr), json.dumps(request_schema())
            else:
                key, text = str(query.key_expr), self._carry_out(asked).model_dump_json()
            query.reply(key, text, encoding=zenoh.Encoding.APPLICATION_JSON)

    def _carry_out(self, asked: _Asked) -> Acknowledgement:
        control = self.control
        request = control.read(asked.operation, asked.payload, asked.n_bytes)
        done = self._bridge.intervene(lambda now_ns: control.apply(request, now_ns))
        return control.apply(request, None)[0] if done is None else done

    def _state(self) -> str:
        def see(now_ns: int) -> tuple[tuple[int, Mapping[Any, Snapshot]], Sequence[Record]]:
            return (now_ns, snapshot(self._bridge.links, now_ns)), ()

        found = self._bridge.intervene(see)
        now_ns, seen = (None, None) if found is None else found
        counters = {**self._bridge.counters(), **self.counters()} if seen else {}
        own = {name: n for name, n in counters.items() if not name.startswith(("forward.", "feedback."))}
        return describe(seen, now_ns, own).model_dump_json(exclude_none=True)


def attach(
    bridge: Bridge, sessions: Mapping[Network, zenoh.Session], prefix: str = "tis", library: Profiles | None = None
) -> Callable[[], None]:
    """Let a bridge be controlled over both networks; return what ends that, to be called before they close."""
    control = BridgeControl(bridge, sessions, prefix, library)
    control.open()
    return control.close
