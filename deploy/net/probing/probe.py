"""Probe of a path: messages at a constant rate, received in this process on the same clock or by a far end."""

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

import numpy as np
import zenoh
from numpy.typing import NDArray

from tis.common.clocks import ClockModel, Exchanges
from tis.common.errors import Fault, PeerError
from tis.common.header import Header
from tis.common.runtime.clock import monotonic_ns
from tis.common.runtime.scheduling import sharpen_timers
from tis.common.units import NS_PER_S, s_to_ns
from tis.deploy.net.probing.ends import QUALITY_OF_SERVICE
from tis.deploy.net.probing.receiving_end import WARM_UP, Paired, ReceivingEnd, last_received, pair

_WARM_UP_EVERY_S: Final = 0.05
_SETTLE_S: Final = 0.2
_POLL_S: Final = 0.02
_SWITCH_INTERVAL_S: Final = 0.0005


class Plan(NamedTuple):
    """Messages to send, timeout of a message (``timeout_s``) and of the first arrival (``wait_s``)."""

    key: str
    rate_hz: float
    n_messages: int
    n_bytes: int
    timeout_s: float
    wait_s: float


class Probed(NamedTuple):
    """N sent messages in order: instants, (N,) ns after the first, and delays.

    ``n_skipped`` were not sent because their instant had passed; the last ``n_unknown``, not among the N, were sent
    to an unavailable far end. ``clock`` is this host's relative to the far end's, fitted to ``exchanges``.
    """

    sent_ns: NDArray[np.int64]
    paired: Paired
    n_skipped: int
    n_unknown: int
    clock: ClockModel
    exchanges: Exchanges


def probe(sender: zenoh.Session, receiver: ReceivingEnd, plan: Plan) -> Probed:
    """Send from a session to the ``receiver``; raises `PeerError` when no message arrives.

    Message i is due ``i / rate_hz`` after the first; an instant that has passed is skipped, so that a stall of this
    process causes no burst. The delay is from just before the call of ``put`` to the callback (RFC 7679). A message
    later than ``timeout_s`` counts as lost (RFC 7680). Ctrl-C ends the sending early, and so does an unavailable far
    end; then the messages up to the last one known to have arrived are kept.
    """
    publisher = sender.declare_publisher(plan.key, **QUALITY_OF_SERVICE)
    try:
        with low_latency():
            _warm_up(publisher, receiver, plan)
            sent, n_skipped = _send(publisher, plan, receiver.unavailable)
            _drain(receiver, len(sent), plan.timeout_s)
    finally:
        publisher.undeclare()  # type: ignore[no-untyped-call]
    # Without a far end the last messages are of unknown fate, so they are cut off.
    sent_ns, marks = np.array(sent, dtype=np.int64).reshape(-1, 2).T
    stamps = receiver.arrivals().rows
    n_known = last_received(marks, stamps) if receiver.unavailable() else len(sent)
    clock, exchanges = receiver.clock()
    kept_ns = sent_ns[:n_known]
    paired = pair(kept_ns, marks[:n_known], stamps, s_to_ns(plan.timeout_s), clock)
    origin_ns = kept_ns[0] if n_known else 0
    return Probed(kept_ns - origin_ns, paired, n_skipped, len(sent) - n_known, clock, exchanges)


def _warm_up(publisher: zenoh.Publisher, receiver: ReceivingEnd, plan: Plan) -> None:
    """Send messages that do not count until one arrives, then wait for the others."""
    payload = bytes(plan.n_bytes)
    give_up = time.monotonic() + plan.wait_s
    receiver.settle(hurry=True)
    while not receiver.arrivals().rows:
        if time.monotonic() >= give_up or receiver.unavailable():
            raise PeerError(Fault("probe", plan.key, f"no message arrived within {plan.wait_s:g} s"))
        publisher.put(payload, attachment=WARM_UP)
        time.sleep(_WARM_UP_EVERY_S)
    time.sleep(_SETTLE_S)
    receiver.settle(hurry=False)


def _send(
    publisher: zenoh.Publisher, plan: Plan, unavailable: Callable[[], bool]
) -> tuple[list[tuple[int, int]], int]:
    """Return the instant and mark of each sent message, and the number of skipped ones."""
    payload = bytes(plan.n_bytes)
    sent: list[tuple[int, int]] = []
    n_skipped = 0
    period_ns = NS_PER_S / plan.rate_hz
    begin_ns = monotonic_ns()
    try:
        for i in range(plan.n_messages):
            due_ns = begin_ns + int(i * period_ns)
            now_ns = monotonic_ns()
            # more than a period late: skip, or the stall would become a burst
            if now_ns > due_ns + period_ns:
                n_skipped += 1
                continue
            while now_ns < due_ns:
                time.sleep((due_ns - now_ns) * 1e-9)
                now_ns = monotonic_ns()
            if unavailable():
                break
            mark = now_ns - begin_ns  # tells this probe's messages from those of another on the same key
            attachment = Header(len(sent), mark).pack()
            sent.append((monotonic_ns(), mark))
            publisher.put(payload, attachment=attachment)
    except KeyboardInterrupt:
        pass
    return sent, n_skipped


def _drain(receiver: ReceivingEnd, n_expected: int, timeout_s: float) -> None:
    """Wait for the last messages, at most until a later one would count as lost."""
    give_up = time.monotonic() + timeout_s
    receiver.settle(hurry=True)
    while receiver.arrivals().n_messages < n_expected and time.monotonic() < give_up and not receiver.unavailable():
        time.sleep(_POLL_S)
    time.sleep(_POLL_S)
    receiver.settle(hurry=False)


@contextmanager
def low_latency() -> Iterator[None]:
    """Reduce stalls of the interpreter: exact timers, short switch interval, no garbage collection."""
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
