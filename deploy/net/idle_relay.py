"""Delay added by the measuring machine: messages through two Zenoh networks and a relay within this process.

The relay forwards immediately, so the variation of its delays comes from Zenoh, the interpreter and the machine
alone. It runs as long as the probe, because the load of a machine changes.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Final

import numpy as np
import zenoh

from tis.common.errors import Fault, PeerError
from tis.common.messages import Header
from tis.common.runtime.clock import monotonic_ns
from tis.common.runtime.connections import closing
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.scheduling import sharpen_timers
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client, open_router
from tis.deploy.net.probe import LocalReceivingEnd
from tis.netem.fit.record import Spread

_RATE_HZ: Final = 50  # high enough for a p99 after seconds, low enough not to disturb the probe
_MIN_MESSAGES: Final = 30
_N_WARM_UP: Final = 5  # the first messages set up the route
_TIMEOUT_S: Final = 2.0
_KEY: Final = "idle"
_QOS: Final[dict[str, Any]] = {
    "congestion_control": zenoh.CongestionControl.DROP,
    "reliability": zenoh.Reliability.RELIABLE,
    "priority": zenoh.Priority.REAL_TIME,
    "express": True,
}


class IdleRelay:
    """Sending thread in one network and receiving end in the other."""

    def __init__(self, sender: zenoh.Session, receiver: LocalReceivingEnd) -> None:
        self._receiver = receiver
        self._publisher = sender.declare_publisher(_KEY, **_QOS)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._send, name="idle relay", daemon=True)
        self._thread.start()

    def _send(self) -> None:
        sharpen_timers()
        n = 0
        while not self._stopped.wait(1.0 / _RATE_HZ):
            self._publisher.put(b"", attachment=Header(n, monotonic_ns()).pack())
            n += 1

    def stop(self) -> None:
        """Stop sending."""
        self._stopped.set()
        self._thread.join(_TIMEOUT_S)

    def spread(self) -> Spread | None:
        """Return the spread of the delays, None for too few messages."""
        delays_ns = [
            came_ns - sent_ns for seq, sent_ns, came_ns in self._receiver.arrivals().rows if seq >= _N_WARM_UP
        ]
        return Spread.of(np.array(delays_ns, dtype=np.int64)) if len(delays_ns) >= _MIN_MESSAGES else None


@contextmanager
def open_idle_relay() -> Iterator[IdleRelay | None]:
    """Send through a relay until the end of the block; yields None when loopback is unavailable."""
    with ExitStack() as stack:
        try:
            west, east = (_network(stack, endpoint) for endpoint in free_endpoints())
        except (PeerError, OSError):
            yield None
            return
        relay = east[0].declare_publisher(_KEY, **_QOS)
        # a put in a callback may stall its session; this session has no other work
        subscriber = west[0].declare_subscriber(_KEY, lambda sample: relay.put(b"", attachment=sample.attachment))
        stack.callback(subscriber.undeclare)
        receiver = LocalReceivingEnd(east[1], _KEY)
        stack.callback(receiver.close)
        idle_relay = IdleRelay(west[1], receiver)
        stack.callback(idle_relay.stop)
        yield idle_relay


def _network(stack: ExitStack, endpoint: str) -> tuple[zenoh.Session, zenoh.Session]:
    """Open a router and a client of it; raises `PeerError`."""
    options = ZenohOptions(listen=[endpoint])
    listening = configure("router", options)
    router = stack.enter_context(closing(open_router(listening, endpoint, "probe"), listening))
    give_up = time.monotonic() + _TIMEOUT_S
    config = configure("client", ZenohOptions(connect=[endpoint]))
    client = open_client(config, lambda: time.monotonic() >= give_up, lambda: None)
    if client is None:
        raise PeerError(Fault("probe", endpoint, f"no answer within {_TIMEOUT_S:g} s"))
    return router, stack.enter_context(closing(client, config))
