"""The probe: messages at a steady rate through a path, heard in this process, on one clock, or by a far end."""

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

import numpy as np
import zenoh
from numpy.typing import NDArray

from common.clocks.exchange import Exchanges
from common.clocks.model import ClockModel
from common.errors import Fault, PeerError
from common.header import Header
from common.runtime.clock import monotonic_ns
from common.runtime.inbox import sharpen_timers
from common.units import NS_PER_S, s_to_ns
from deploy.net.probing.message_pairing import Paired, last_received, pair
from deploy.net.probing.receiving_end import WARM_UP, ReceivingEnd

_WARM_UP_EVERY_S: Final = 0.05
_SETTLE_S: Final = 0.2
_POLL_S: Final = 0.02
_SWITCH_INTERVAL_S: Final = 0.0005


class Plan(NamedTuple):
    """What is to be sent, and how long it is waited for: for the path to be there, and for the last message."""

    key: str
    rate_hz: float
    n_messages: int
    n_bytes: int
    timeout_s: float
    wait_s: float


class Probed(NamedTuple):
    """N messages sent, in order: when, (N,) ns from the first on, and what became of them.

    ``n_skipped`` were not sent since their moment had passed; of the last ``n_unknown``, not among the N, nobody
    knows, since the far end was gone. ``clock`` is this host's against the far end's, found by ``exchanges``.
    """

    sent_ns: NDArray[np.int64]
    paired: Paired
    n_skipped: int
    n_unknown: int
    clock: ClockModel
    exchanges: Exchanges


def probe(sender: zenoh.Session, receiver: ReceivingEnd, plan: Plan) -> Probed:
    """Send from a session, with ``receiver`` at the other end; raises `PeerError` when nothing comes through at all.

    Each message is due at ``i / rate_hz`` after the first; a moment that has passed is skipped, so that a stall of
    this process makes no burst. The delay is from just before the call that sends to the callback (RFC 7679). A
    message that comes later than ``timeout_s`` counts as lost (RFC 7680). Ctrl-C ends the sending early, and so does
    a far end that is gone: then the messages up to the last that is known to have arrived are kept.
    """
    publisher = sender.declare_publisher(
        plan.key,
        congestion_control=zenoh.CongestionControl.DROP,
        reliability=zenoh.Reliability.RELIABLE,
        priority=zenoh.Priority.REAL_TIME,
        express=True,
    )
    try:
        with low_latency():
            _warm_up(publisher, receiver, plan)
            sent, n_skipped = _send(publisher, plan, receiver.unavailable)
            _drain(receiver, len(sent), plan.timeout_s)
    finally:
        publisher.undeclare()  # type: ignore[no-untyped-call]
    sent_ns, marks = np.array(sent, dtype=np.int64).reshape(-1, 2).T
    stamps = receiver.arrivals().rows
    n_known = last_received(marks, stamps) if receiver.unavailable() else len(sent)
    clock, exchanges = receiver.clock()
    kept_ns = sent_ns[:n_known]
    paired = pair(kept_ns, marks[:n_known], stamps, s_to_ns(plan.timeout_s), clock)
    origin_ns = kept_ns[0] if n_known else 0
    return Probed(kept_ns - origin_ns, paired, n_skipped, len(sent) - n_known, clock, exchanges)


def _warm_up(publisher: zenoh.Publisher, receiver: ReceivingEnd, plan: Plan) -> None:
    """Send messages that do not count until one arrives, then let the others go by."""
    payload = bytes(plan.n_bytes)
    give_up = time.monotonic() + plan.wait_s
    receiver.settle(hurry=True)
    while not receiver.arrivals().rows:
        if time.monotonic() >= give_up or receiver.unavailable():
            raise PeerError(Fault("probe", plan.key, f"nothing came through within {plan.wait_s:g} s"))
        publisher.put(payload, attachment=WARM_UP)
        time.sleep(_WARM_UP_EVERY_S)
    time.sleep(_SETTLE_S)
    receiver.settle(hurry=False)


def _send(
    publisher: zenoh.Publisher, plan: Plan, unavailable: Callable[[], bool]
) -> tuple[list[tuple[int, int]], int]:
    """Return when each message was sent and its mark, and how many were skipped."""
    payload = bytes(plan.n_bytes)
    sent: list[tuple[int, int]] = []
    n_skipped = 0
    period_ns = NS_PER_S / plan.rate_hz
    begin_ns = monotonic_ns()
    try:
        for i in range(plan.n_messages):
            due_ns = begin_ns + int(i * period_ns)
            now_ns = monotonic_ns()
            if now_ns > due_ns + period_ns:
                n_skipped += 1
                continue
            while now_ns < due_ns:
                time.sleep((due_ns - now_ns) * 1e-9)
                now_ns = monotonic_ns()
            if unavailable():
                break
            mark = now_ns - begin_ns
            attachment = Header(len(sent), mark).pack()
            sent.append((monotonic_ns(), mark))
            publisher.put(payload, attachment=attachment)
    except KeyboardInterrupt:
        pass
    return sent, n_skipped


def _drain(receiver: ReceivingEnd, n_expected: int, timeout_s: float) -> None:
    """Wait for the last messages; at most so long that whatever comes later would count as lost."""
    give_up = time.monotonic() + timeout_s
    receiver.settle(hurry=True)
    while receiver.arrivals().n_messages < n_expected and time.monotonic() < give_up and not receiver.unavailable():
        time.sleep(_POLL_S)
    time.sleep(_POLL_S)
    receiver.settle(hurry=False)


@contextmanager
def low_latency() -> Iterator[None]:
    """Keep the interpreter from stalling an end: exact timers, short turns, no collection of garbage."""
    switch_s, collects = sys.getswitchinterval(), gc.isenabled()
    sharpen_timers()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    gc.disable()
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
        if collects:
            gc.enable()
