"""A bridge at work in this process, with its control keys and a client on either network."""

import json
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Final, get_args

import zenoh

from tests.common.runtime.live_zenoh import a_client, a_router, soon
from tests.netem.making import KEY, link
from tis.common.channels import Direction, Network
from tis.common.messages import Header
from tis.common.node import Record
from tis.common.records import CONTROL, ControlNote
from tis.common.runtime.clock import WallClock
from tis.common.runtime.ports import free_endpoints
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.control import BridgeControl

BASE: Final = "tis/netem/control"
_MS: Final = 1_000_000


class Running:
    """A bridge at work, what was logged, and what came out on the east."""

    def __init__(
        self,
        sessions: dict[Network, zenoh.Session],
        west: zenoh.Session,
        east: zenoh.Session,
        endpoint: str,
        **network: Any,
    ) -> None:
        self.west, self.east, self.endpoint = west, east, endpoint
        self.records: list[Record] = []
        self.heard: list[tuple[int, int]] = []
        self.stray: list[str] = []
        self.bridge = Bridge(sessions, {way: link(way, **network) for way in get_args(Direction)})
        self.control = BridgeControl(self.bridge, sessions)
        self._stop = threading.Event()
        self._n_sent = 0
        self._held: list[Any] = []
        self._thread = threading.Thread(
            target=self.bridge.run, args=(self, 60_000 * _MS, self._stop.is_set), name="release"
        )

    def begin(self) -> None:
        for way in get_args(Direction):
            self.bridge.subscribe(way, "**")
        self.control.open()
        self._held += [
            self.east.declare_subscriber(KEY, self._hear),
            self.east.declare_subscriber("tis/netem/**", lambda sample: self.stray.append(str(sample.key_expr))),
        ]
        self.bridge.start(WallClock(time.monotonic_ns()))
        self._thread.start()
        assert soon(lambda: self.send() > 0 and bool(self.heard))
        time.sleep(0.05)
        self.heard.clear()
        self._n_sent = 0

    def end(self) -> None:
        self._stop.set()
        self.bridge.wake()
        if self._thread.ident is not None:
            self._thread.join()
        self.control.close()
        self.bridge.close()
        for held in self._held:
            held.undeclare()
        assert self.bridge.error is None

    def record(self, record: Record) -> None:
        self.records.append(record)

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        self.records += make()

    def send(self) -> int:
        header = Header(self._n_sent, time.monotonic_ns())
        self.west.put(KEY, b"payload", attachment=header.pack())
        self._n_sent += 1
        return self._n_sent

    def burst(self, n: int) -> list[float]:
        """Send n messages, a ms apart; return how late those that came were, in ms."""
        before, sent = len(self.heard), self._n_sent
        for _ in range(n):
            self.send()
            time.sleep(0.001)
        assert sent + n == self._n_sent
        soon(lambda: len(self.heard) - before >= n)
        return [(heard_ns - sent_ns) / _MS for sent_ns, heard_ns in self.heard[before:]]

    def ask(self, operation: str, request: Any = None, session: zenoh.Session | None = None) -> Any:
        payload = None if request is None else json.dumps(request)
        replies = [
            json.loads(reply.ok.payload.to_bytes())
            for reply in (session or self.west).get(f"{BASE}/{operation}", payload=payload, timeout=3)
            if reply.ok is not None
        ]
        assert len(replies) == 1, f"{len(replies)} answers"
        return replies[0]

    def notes(self) -> list[ControlNote]:
        return [one.data for one in self.records if one.topic == CONTROL and isinstance(one.data, ControlNote)]

    def _hear(self, sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        assert sample.attachment is not None
        header = Header.unpack(sample.attachment.to_bytes())
        assert header is not None
        self.heard.append((header.sent_ns, now_ns))


@contextmanager
def running_bridge(**network: Any) -> Iterator[Running]:
    west, east = free_endpoints()
    with ExitStack() as stack:
        sessions: dict[Network, zenoh.Session] = {
            "west": stack.enter_context(a_router(west)),
            "east": stack.enter_context(a_router(east)),
        }
        clients = stack.enter_context(a_client(west)), stack.enter_context(a_client(east))
        made = Running(sessions, *clients, west, **network)
        stack.callback(made.end)
        made.begin()
        yield made
