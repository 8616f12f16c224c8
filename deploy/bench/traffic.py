"""Traffic for measurements: messages at a constant rate or as fast as possible, and their arrivals."""

import struct
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import zenoh
from numpy.typing import NDArray

from tis.common.messages import Header
from tis.common.runtime.scheduling import sharpen_timers
from tis.common.runtime.zenoh_session import ZenohOptions, configure

_SETTLE_S: Final = 0.4
_QUIET_S: Final = 0.5


@dataclass
class Arrivals:
    """Stamps of arrived messages: instants of sending and arrival, in ns."""

    sent_ns: list[int] = field(default_factory=list)
    came_ns: list[int] = field(default_factory=list)

    def take(self, sample: zenoh.Sample) -> None:
        """Stamp one message; the callback of a subscriber."""
        came_ns = time.monotonic_ns()
        header = Header.unpack(b"" if sample.attachment is None else sample.attachment.to_bytes())
        if header is not None:
            self.sent_ns.append(header.sent_ns)
            self.came_ns.append(came_ns)

    def delays_us(self) -> NDArray[np.float64]:
        """Return the one-way delays, in us, in the order of arrival."""
        return np.asarray((np.array(self.came_ns) - np.array(self.sent_ns)) * 1e-3)


def client(endpoint: str) -> zenoh.Session:
    """Open a client of the router at ``endpoint``."""
    return zenoh.open(configure("client", ZenohOptions(connect=[endpoint])))


def paced(
    senders: Sequence[str], receivers: Sequence[str], n_keys: int, rate_hz: float, seconds: float, n_bytes: int
) -> tuple[int, NDArray[np.float64]]:
    """Send ``rate_hz`` messages a second on each of ``n_keys`` keys, from each sender to its receiver.

    Sender and receiver i are endpoints on the two sides of the same path. Returns the number of sent messages and
    the one-way delays in us of the arrived ones.
    """
    sharpen_timers()
    with ExitStack() as stack:
        arrivals = Arrivals()
        publishers: list[zenoh.Publisher] = []
        for i, (sender, receiver) in enumerate(zip(senders, receivers, strict=True)):
            here, there = stack.enter_context(client(sender)), stack.enter_context(client(receiver))
            stack.enter_context(there.declare_subscriber(f"tis/way{i}/**", arrivals.take))
            publishers += [
                here.declare_publisher(
                    f"tis/way{i}/{key}",
                    express=True,
                    congestion_control=zenoh.CongestionControl.DROP,
                    priority=zenoh.Priority.REAL_TIME,
                )
                for key in range(n_keys)
            ]
        payload = b"x" * n_bytes
        time.sleep(_SETTLE_S)
        for publisher in publishers:  # the first message of a key is slower: it is not measured
            publisher.put(payload)
        time.sleep(_SETTLE_S)
        # round robin over all keys at a constant total rate; each message carries its own send stamp
        n_each = int(seconds * rate_hz)
        start_ns = time.monotonic_ns() + 1_000_000
        gap_ns = 1e9 / (rate_hz * len(publishers))
        for k in range(n_each * len(publishers)):
            wait_ns = start_ns + int(k * gap_ns) - time.monotonic_ns()
            if wait_ns > 0:
                time.sleep(wait_ns * 1e-9)
            header = Header(k // len(publishers), time.monotonic_ns())
            publishers[k % len(publishers)].put(payload, attachment=header.pack())
        _until_quiet(arrivals.came_ns)
        return n_each * len(publishers), arrivals.delays_us()


def flood(sender: str, receiver: str, n: int, n_bytes: int) -> tuple[int, float]:
    """Send ``n`` messages as fast as the path accepts them; return the number of arrivals and their rate, Hz.

    The sender blocks while too many are in flight, so that it does not merely fill the queues of the libraries.
    """
    with client(sender) as here, client(receiver) as there:
        arrivals_ns: list[int] = []
        with there.declare_subscriber("tis/way0/**", lambda _: arrivals_ns.append(time.monotonic_ns())):
            publisher = here.declare_publisher("tis/way0/0", congestion_control=zenoh.CongestionControl.BLOCK)
            time.sleep(_SETTLE_S)
            payload, attachment = zenoh.ZBytes(b"x" * n_bytes), b""
            pack = struct.Struct("<I").pack
            for seq in range(n):
                attachment = pack(seq)
                publisher.put(payload, attachment=attachment)
            _until_quiet(arrivals_ns)
        span_s = (arrivals_ns[-1] - arrivals_ns[0]) * 1e-9 if len(arrivals_ns) > 1 else 0.0
        return len(arrivals_ns), (len(arrivals_ns) - 1) / span_s if span_s > 0 else 0.0


def _until_quiet(arrivals_ns: list[Any]) -> None:
    """Wait until no message has arrived for `_QUIET_S`."""
    seen = -1
    event = threading.Event()
    while len(arrivals_ns) != seen:
        seen = len(arrivals_ns)
        event.wait(_QUIET_S)
